"""Cartesian stiffness of the platform: how far it gives way to a small force or moment."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.errors import DescriptionError, SingularityError
from pinflex.levels.modes import allowed_motions, linearised
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism, takes_model

_LOOSE = 1e-13  # smallest over largest eigenvalue of a stiffness scaled to a unit diagonal
_HELD = 1e-13  # of the largest entry of a Jacobian: round-off of a product
_RIGID = 1e-9  # of the stiffest member's own compliance: what gives way less is round-off


@public
@takes_model
def platform_compliance(
    mechanism: Mechanism, q: Array | None = None, *, preload: str = "gravity"
) -> Array:
    """Displacement of the platform by unit forces and moments, motors locked.

    C = J Z (Z' K Z)^-1 Z' J', with K the tangent stiffness at the pose, Z what the closures leave
    free and J the Jacobian of the platform's origin.

    Args:
        mechanism: Mechanism with a platform.
        q: Rigid pose, default home.
        preload: As in `modes`: "gravity" about the static equilibrium, "none" about the undeformed
            pose with the structure's stiffness alone.

    Returns:
        C, shape (6, 6), symmetric: translation of the platform's origin (m) and small rotation
        (rad), by force at that origin (N) and moment (N m), all along the world axes. Rows and
        columns of an axis that does not give way are exactly 0: what is below 1e-9 of the
        stiffest member's own compliance is round-off.

    Raises:
        DescriptionError: No platform.
        SingularityError: Something moves without stiffness though the motors are locked.
        ConvergenceError: No static equilibrium.
    """
    name = mechanism.description.platform
    if name is None:
        raise DescriptionError(
            f"{mechanism.name}: stiffness needs the frame it is of. Write `platform: FRAME`."
        )
    dynamics = Equations(mechanism.flexible)
    y, K = linearised(mechanism, dynamics, q, preload)
    free = mechanism.flexible.free
    Z = allowed_motions(dynamics, y, free)
    every = frame_jacobian(dynamics, y, mechanism.frame(name))[:, free]
    J = every @ Z
    # a platform that the closures hold moves by round-off, which is no compliance
    J[np.abs(J) < _HELD * np.max(np.abs(every), initial=0.0)] = 0.0
    S = Z.T @ K[np.ix_(free, free)] @ Z
    size = np.sqrt(np.abs(np.diag(S)))
    if not len(S):
        return np.zeros((6, 6))
    if (
        np.any(size == 0)
        or np.min(np.abs(np.linalg.eigvalsh(0.5 * (S + S.T) / np.outer(size, size)))) < _LOOSE
    ):
        raise SingularityError(
            f"{mechanism.name}: stiffness: something moves without any stiffness though the motors "
            "are locked. Actuate or spring the joints that are free."
        )
    C = J @ np.linalg.solve(S, J.T)
    rigid = np.abs(np.diag(C)) <= _RIGID * _stiffest(mechanism, every)
    C[rigid], C[:, rigid] = 0.0, 0.0
    return np.asarray(0.5 * (C + C.T))


def _stiffest(mechanism: Mechanism, J: Array) -> Array:
    """Compliance of the stiffest beam or spring alone along each axis, shape (6,)."""
    reach = float(np.max(np.abs(J[:3]), initial=0.0)) or 1.0  # levers of the machine, m
    alone = [p.length / (p.spec.material.E * p.spec.section.A) for p in mechanism.parts.values()]
    alone += [1.0 / s.stiffness for s in mechanism.description.springs if s.stiffness]
    k = mechanism.flexible.springs.stiffness
    alone += (min(reach, 1.0) ** 2 / k[k > 0]).tolist()
    return min(alone, default=0.0) * np.array([1.0] * 3 + [1.0 / reach**2] * 3)
