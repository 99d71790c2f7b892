"""Linear deviation of frames from the nominal motion: the errors of kineto-elastodynamics.

With the deviation d of the coordinates and the Jacobian J(t) of a frame along the nominal motion,
e = J d is the displacement of its origin and its small rotation, in the world frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import Frame
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
    m = int(system.rigid.nv)
    error = np.empty((3, len(run.t), len(names), 6))
    for k in range(len(run.t)):
        flat = np.concatenate([path.q[k], np.zeros(system.n_eta)])
        rate, acceleration = np.zeros(system.nv), np.zeros(system.nv)
        rate[:m], acceleration[:m] = path.v[k], path.a[k]
        d = dynamics.difference(flat, run.y[k])
        dv, da = run.v[k] - rate, run.a[k] - acceleration
        J = [
            _jacobians(
                dynamics, dynamics.integrate(flat, s * rate + 0.5 * s * s * acceleration), names
            )
            for s in (-_DELTA, 0.0, _DELTA)
        ]
        Jd = (J[2] - J[0]) / (2 * _DELTA)
        Jdd = (J[2] - 2 * J[1] + J[0]) / _DELTA**2
        error[0, k] = J[1] @ d
        error[1, k] = J[1] @ dv + Jd @ d
        error[2, k] = J[1] @ da + 2 * Jd @ dv + Jdd @ d
    keys = ("deviation", "deviation_rate", "deviation_acceleration")
    return {
        f"frame/{name}/{key}": error[order, :, number]
        for number, name in enumerate(names)
        for order, key in enumerate(keys)
    }


def _jacobians(dynamics: Equations, y: Array, names: Sequence[str]) -> Array:
    """World-aligned Jacobians of frames in minimal coordinates, shape (frames, 6, nv)."""
    if dynamics.in_parts:
        at, places = dynamics.kinematics(y), dynamics.system.expansion.frames
        frames = [Frame(dynamics.model, places[name]) for name in names]
        return np.concatenate([frame.jacobian(at) for frame in frames])
    model, data = dynamics.model, dynamics.data
    numbers = [model.getFrameId(name, pin.FrameType.BODY) for name in names]
    here = dynamics.at(y)
    pin.computeJointJacobians(model, data, here.Q[0])
    pin.updateFramePlacements(model, data)
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    rows = np.vstack([pin.getFrameJacobian(model, data, frame, aligned) for frame in numbers])
    return here.times_map(rows).reshape(len(names), 6, -1)
