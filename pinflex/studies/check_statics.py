"""Rest under gravity: how far the platform sags and what the motors hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import SceneError
from pinflex.levels.quasistatic import Equilibrium, linear_statics, rest, unstable_text
from pinflex.levels.rigid import multipliers
from pinflex.levels.start import acted_on
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import frame_jacobian, frame_pose
from pinflex.mechanics.mechanism import Mechanism
from pinflex.rotations import rotation_vector
from pinflex.text import brief

_ROUND_OFF = 1e-12  # [m | rad], and the same share of the largest torque: shown as zero


@dataclass(frozen=True)
class Sag:
    """Displacement of the platform from the undeformed pose: [m], rotation vector [rad]."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float]


@dataclass(frozen=True)
class Statics:
    """Rest at home; what could not be found is None and `reason` says why.

    Attributes:
        linear, full: Sag of the platform in linear statics about the undeformed pose, and in the
            full equilibrium.
        holding_rigid, holding_linear, holding_full: Motor torques (N m | N) that hold it.
        linear_reason, full_reason: Why there is none, "" when there is.
    """

    __repr__ = brief

    linear: Sag | None = None
    full: Sag | None = None
    holding_rigid: tuple[float, ...] | None = None
    holding_linear: tuple[float, ...] | None = None
    holding_full: tuple[float, ...] | None = None
    linear_reason: str = ""
    full_reason: str = ""


def statics(mechanism: Mechanism) -> Statics:
    """Sag of the platform and holding torques at home, motors locked, linear and full."""
    system, report = mechanism.flexible, mechanism.report
    if report.mobility > len(mechanism.motors):
        return _none("the motors do not hold every degree of freedom")
    rigid = _torques(rigid_holding(mechanism)[0])
    if not mechanism.compliant:
        why = "no flexible link and no elastic joint"
        return Statics(None, None, rigid, None, None, why, why)
    if not acted_on(system, mechanism.undeformed()):
        why = "nothing acts on it at rest"
        return Statics(None, None, rigid, None, None, why, why)
    linear, linear_reason = _try(lambda: linear_statics(mechanism))
    full, full_reason = _try(lambda: rest(mechanism))
    if full is not None and full.unstable:
        full, full_reason = None, unstable_text("static equilibrium")
    dynamics = Equations(system)
    return Statics(
        linear=_sag(mechanism, dynamics, linear, True),
        full=_sag(mechanism, dynamics, full, False),
        holding_rigid=rigid,
        holding_linear=_holding(mechanism, linear),
        holding_full=_holding(mechanism, full),
        linear_reason=linear_reason,
        full_reason=full_reason,
    )


def rigid_holding(mechanism: Mechanism) -> tuple[Array, Array]:
    """Motor torques at home without elasticity, and the couples that hold the spins of rods."""
    system = mechanism.rigid
    dynamics, still = Equations(system), np.zeros(system.nv)
    r, _ = dynamics.residual(mechanism.home, still, still, np.zeros(system.closed.n), 0.0)
    J = dynamics.close(mechanism.home).J
    lam, torque = multipliers(mechanism, J[None], r[None])
    return torque[0], lam[0, lam.shape[1] - len(mechanism.idle.spins) :]


def _none(why: str) -> Statics:
    return Statics(linear_reason=why, full_reason=why)


def _try(solve: Callable[[], Equilibrium]) -> tuple[Equilibrium | None, str]:
    try:
        return solve(), ""
    except SceneError as error:
        return None, str(error)
    except np.linalg.LinAlgError:
        return None, "something can move without any stiffness: the linear equations are singular"


def _torques(values: Array) -> tuple[float, ...]:
    scale = float(np.max(np.abs(values), initial=0.0))
    return tuple(float(x) if abs(x) > _ROUND_OFF * scale else 0.0 for x in values)


def _holding(mechanism: Mechanism, found: Equilibrium | None) -> tuple[float, ...] | None:
    return None if found is None else _torques(found.r[mechanism.flexible.motors])


def _sag(
    mechanism: Mechanism, dynamics: Equations, found: Equilibrium | None, linear: bool
) -> Sag | None:
    if found is None or mechanism.description.platform is None:
        return None
    flat, look = mechanism.undeformed(), Equations(dynamics.system)
    here = mechanism.frame(mechanism.description.platform)
    if linear:  # the differential of the pose, without the second order of its turns
        moved = frame_jacobian(look, flat, here) @ dynamics.difference(flat, found.y)
        return Sag(_triple(moved[:3]), _triple(moved[3:]))
    straight, bent = (frame_pose(look, y, here) for y in (flat, found.y))
    turned = rotation_vector((bent.rotation @ straight.rotation.T)[None])[0]
    return Sag(_triple(bent.translation - straight.translation), _triple(turned))


def _triple(vector: Array) -> tuple[float, float, float]:
    # what round-off leaves of a zero would read as a number
    kept = np.where(np.abs(vector) > _ROUND_OFF, vector, 0.0)
    return float(kept[0]), float(kept[1]), float(kept[2])
