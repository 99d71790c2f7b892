"""Linear deviation of frames from the nominal motion: the errors of kineto-elastodynamics.

With the deviation d of the coordinates and the Jacobian J(t) of a frame along the nominal motion,
e = J d is the displacement of its origin and its small rotation, in the world frame: the motion of
the frame where the coordinates move by d.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.kinematics import motion_of

# J d is differentiated along the motion over this time, s: its error, the square of it times the
# fourth rate of J, stays below 1e-6 of J d for motions slower than a millisecond.
_DELTA = 1e-5


def frame_deviations(mechanism: Mechanism, run: Run) -> dict[str, Array]:
    """Deviation, its rate and acceleration, of every reported frame.

    Returns:
        frame/NAME/deviation, deviation_rate, deviation_acceleration: (nt, 6), displacement of the
        origin (m) and rotation (rad) about the world axes, and their derivatives.
    """
    path, names = run.path, mechanism.description.reported
    if path is None or not names:
        return {}
    dynamics, system = Equations(run.system), run.system
    manifold, straight = Manifold(dynamics), path.straight(system.n_eta)
    rate, acceleration = np.zeros((2, len(run.t), system.nv))
    m, places = int(system.rigid.nv), [system.expansion.frames[name] for name in names]
    rate[:, :m], acceleration[:, :m] = path.v, path.a
    d = manifold.log(straight, run.y)
    dv, da = run.v - rate, run.a - acceleration

    def displaced(x: float) -> Array:
        """J d of every frame a time x [s] on, shape (frames, nt, 6)."""
        y = manifold.retract(straight, x * rate + 0.5 * x * x * acceleration)
        moved = d + x * dv + 0.5 * x * x * da
        joints = [place.joint for place in places]
        poses, rates = dynamics.motions(y, moved, 0.0 * moved, joints)
        each = zip(poses, rates, places, strict=True)
        return np.array([motion_of(R, V, place.placement)[2] for R, V, place in each])

    before, here, after = (displaced(x) for x in (-_DELTA, 0.0, _DELTA))
    error = (here, (after - before) / (2 * _DELTA), (after - 2 * here + before) / _DELTA**2)
    keys = ("deviation", "deviation_rate", "deviation_acceleration")
    return {
        f"frame/{name}/{key}": error[order][number]
        for number, name in enumerate(names)
        for order, key in enumerate(keys)
    }
