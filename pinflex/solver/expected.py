"""How far a run is going to move, before it is made: from the rigid motion and the stiffness.

At a few instants of the rigid motion, what the undeformed links do not balance is laid on their
stiffness. A vibration may double it; it is for scales only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.actuation.nominal import Nominal, nominal
from pinflex.arrays import Array
from pinflex.errors import SceneError
from pinflex.levels.outputs import between, platform_poses
from pinflex.levels.rigid import multipliers
from pinflex.mechanics.equations import Equations
from pinflex.solver.scene import Scene

_INSTANTS = 9


@dataclass(frozen=True)
class Expected:
    """Largest values over a run.

    Attributes:
        scale: Elastic displacement in the norm of the steps, 0: not known.
        sizes: By output, in its unit.
    """

    scale: float
    sizes: dict[str, float]


def few(motion: Nominal) -> Nominal:
    """As many instants of a rigid motion as scales take, its ends among them."""
    every = np.linspace(0, len(motion.t) - 1, min(_INSTANTS, len(motion.t)))
    return motion.at(np.round(every).astype(int))


def expected(
    scene: Scene, end: float, dynamics: Equations | None = None, reference: Nominal | None = None
) -> Expected:
    """Scales of a run."""
    mechanism, system = scene.mechanism, scene.mechanism.loose
    if scene.spec.level != "coupled" or not system.n_eta or scene.spec.drive == "torque":
        return Expected(0.0, {})
    if mechanism.rigid.closed.n != system.closed.n:
        return Expected(0.0, {})
    try:
        if reference is None:
            reference = nominal(mechanism, scene.motion, np.linspace(0.0, end, _INSTANTS))
    except SceneError:
        return Expected(0.0, {})
    dynamics = dynamics or Equations(system)
    n, t = dynamics.n_rigid, reference.t
    y, v, a = (
        np.concatenate([x, np.zeros((len(t), system.n_eta))], axis=1)
        for x in (reference.q, reference.v, reference.a)
    )
    r, J = dynamics.residual(y, v, a, np.zeros((len(t), system.closed.n)), t).r, dynamics.close(y).J
    lam, torque = multipliers(mechanism, J[:, :, :n], r[:, :n])
    force = r[:, n:] - (J[:, :, n:].swapaxes(1, 2) @ lam[:, :, None])[:, :, 0]
    eta = np.asarray(-np.linalg.solve(dynamics.strain.stiffness, force.T).T, dtype=float)
    weight = dynamics.strain.stiffness if scene.by_forces else _mass(dynamics, y[0])
    sizes = {"torque": _largest(torque), "deflection": _largest(eta)}
    # Loops that are left open would let the platform go much farther.
    if mechanism.description.platform and not system.closed.n:
        bent = y.copy()
        bent[:, dynamics.nq_rigid :] = eta
        p, R = platform_poses(mechanism, dynamics, np.concatenate([y, bent]))
        sizes["platform position"] = _largest(p[len(t) :] - p[: len(t)])
        sizes["platform rotation"] = _largest(between(R[: len(t)], R[len(t) :]))
    return Expected(_largest(np.sum((eta @ weight) * eta, axis=1)) ** 0.5, sizes)


def _mass(dynamics: Equations, y: Array) -> Array:
    k = dynamics.n_rigid
    return np.asarray(dynamics.mass(y)[k:, k:])


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
