"""Linear deviation of frames from the nominal motion: the errors of kineto-elastodynamics.

With the deviation d of the coordinates and the Jacobian J(t) of a frame along the nominal motion,
e = J d is the displacement of its origin and its small rotation, in the world frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import Frame
from pinflex.mechanics.geometry import spans
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism

# J is differentiated along the nominal motion over this time, s: its error, the square of it
# times the fourth rate of J, stays below 1e-6 of J for motions slower than a millisecond.
_DELTA = 1e-5


def frame_deviations(mechanism: Mechanism, run: Run) -> dict[str, Array]:
    """Deviation, its rate and acceleration, of every reported frame.

    Args:
        mechanism: Mechanism.
        run: A run with a nominal motion.
    Returns:
        frame/NAME/deviation, deviation_rate, deviation_acceleration: (nt, 6), displacement of the
        origin (m) and rotation (rad) about the world axes, and their derivatives.
    """
    path, names = run.path, mechanism.description.reported
    if path is None or not names:
        return {}
    dynamics, system = Equations(run.system), run.system
    m, places = int(system.rigid.nv), system.expansion.frames
    frames = [Frame(dynamics.model, places[name]) for name in names]
    manifold, straight = Manifold(dynamics), path.straight(system.n_eta)
    error = np.empty((3, len(run.t), len(names), 6))
    for s in spans(len(run.t)):
        flat = straight[s]
        rate, acceleration = np.zeros((2, len(flat), system.nv))
        rate[:, :m], acceleration[:, :m] = path.v[s], path.a[s]
        d = manifold.log(flat, run.y[s])
        dv, da = run.v[s] - rate, run.a[s] - acceleration
        J = [
            _jacobians(
                dynamics, manifold.retract(flat, x * rate + 0.5 * x * x * acceleration), frames
            )
            for x in (-_DELTA, 0.0, _DELTA)
        ]
        Jd = (J[2] - J[0]) / (2 * _DELTA)
        Jdd = (J[2] - 2 * J[1] + J[0]) / _DELTA**2
        d, dv, da = (x[:, None, :, None] for x in (d, dv, da))
        error[0, s] = (J[1] @ d)[..., 0]
        error[1, s] = (J[1] @ dv + Jd @ d)[..., 0]
        error[2, s] = (J[1] @ da + 2 * Jd @ dv + Jdd @ d)[..., 0]
    keys = ("deviation", "deviation_rate", "deviation_acceleration")
    return {
        f"frame/{name}/{key}": error[order, :, number]
        for number, name in enumerate(names)
        for order, key in enumerate(keys)
    }


def _jacobians(dynamics: Equations, y: Array, frames: Sequence[Frame]) -> Array:
    """World-aligned Jacobians of frames in minimal coordinates at y (n, nq), (n, frames, 6, nv)."""
    at = dynamics.kinematics(y)
    return np.stack([frame.jacobian(at) for frame in frames], axis=1)
