"""How far a run is going to move, before it is made: from the rigid motion and the stiffness.

At a few instants of the rigid motion, what the undeformed links do not balance is laid on their
stiffness. A vibration may double it; it is for scales only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import SceneError
from pinflex.levels.outputs import between, platform_poses
from pinflex.levels.rigid import solve_rigid
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


def expected(scene: Scene, end: float) -> Expected:
    """Scales of a run.

    Args:
        scene: What is to be solved. end: Of the run, s.
    """
    system = scene.mechanism.loose
    if scene.spec.level != "coupled" or not system.n_eta or scene.spec.drive == "torque":
        return Expected(0.0, {})
    t = np.linspace(0.0, end, _INSTANTS)
    try:
        rigid = solve_rigid(scene.mechanism, scene.motion, t)
    except SceneError:
        return Expected(0.0, {})
    if rigid.lam.shape[1] != system.closed.n or rigid.v.shape[1] != int(system.rigid.nv):
        return Expected(0.0, {})
    dynamics = Equations(system)
    y, v, a = (
        np.concatenate([x, np.zeros((len(t), system.n_eta))], axis=1)
        for x in (rigid.y, rigid.v, rigid.a)
    )
    force = dynamics.residual(y, v, a, rigid.lam, t).r[:, dynamics.n_rigid :]
    eta = np.asarray(-np.linalg.solve(dynamics.strain.stiffness, force.T).T, dtype=float)
    weight = dynamics.strain.stiffness if scene.by_forces else _mass(dynamics, y[0])
    sizes = {"torque": _largest(rigid.torque), "deflection": _largest(eta)}
    # Loops that are left open would let the platform go much farther.
    if scene.mechanism.description.platform and not system.closed.n:
        bent = y.copy()
        bent[:, dynamics.nq_rigid :] = eta
        p, R = platform_poses(scene.mechanism, dynamics, y)
        p_bent, R_bent = platform_poses(scene.mechanism, dynamics, bent)
        sizes["platform position"] = _largest(p_bent - p)
        sizes["platform rotation"] = _largest(between(R, R_bent))
    return Expected(_largest(np.sum((eta @ weight) * eta, axis=1)) ** 0.5, sizes)


def _mass(dynamics: Equations, y: Array) -> Array:
    k = dynamics.n_rigid
    return np.asarray(dynamics.mass(y)[k:, k:])


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
