"""What moves the motors: a prescribed motion (torque is the answer) or a torque (PD + feed-forward)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanism import Mechanism
from pinflex.motion import Motion
from pinflex.nominal import joint_path, motor_axes, nominal

# Interpolated motor motions (m, rad) are refined until the mid-interval error falls below this:
# far below any step error, far above round-off of the second derivative.
_FINE = 1e-10


@dataclass(frozen=True)
class MotorPath:
    """Motor positions, velocities, accelerations on a time grid, each (nt, nm)."""

    t: Array
    position: Array
    velocity: Array
    acceleration: Array


def motor_path(mechanism: Mechanism, motion: Motion, t: Array) -> MotorPath:
    """Motor motion at times t: exact for joints, by inverse kinematics for the platform.

    Inverse kinematics runs on a coarse grid; a quintic Hermite interpolant through its positions,
    velocities and accelerations carries it to every step, refined until it is exact to 1e-10.
    """
    t = np.asarray(t, float)
    if motion.target == "joints":
        return MotorPath(t, *joint_path(mechanism, motion, t))
    nodes = 65
    while True:
        if nodes >= len(t):
            return MotorPath(t, *_at_nodes(mechanism, motion, t))
        grid = np.linspace(t[0], t[-1], 2 * nodes - 1)
        values = _at_nodes(mechanism, motion, grid)
        coarse = _hermite(grid[::2], [x[::2] for x in values])
        error = np.max(np.abs(coarse(grid[1::2])[0] - values[0][1::2]), initial=0.0)
        # Halving the interval divides the quintic's error by 64.
        if error / 64.0 < _FINE:
            return MotorPath(t, *_hermite(grid, list(values))(t))
        nodes = 2 * nodes - 1


def _at_nodes(mechanism: Mechanism, motion: Motion, t: Array) -> tuple[Array, Array, Array]:
    path, axes = nominal(mechanism, motion, t), motor_axes(mechanism)
    position = np.array([axes.read(q) for q in path.q])
    if np.any(axes.paired):
        position = np.unwrap(position, axis=0)
    return position, path.v[:, axes.v_at], path.a[:, axes.v_at]


def _hermite(
    t: Array, values: list[Array]
) -> Callable[[Array], tuple[Array, Array, Array]]:
    from scipy.interpolate import BPoly

    curve = BPoly.from_derivatives(t, np.stack(values, axis=1))
    rate = curve.derivative()
    second = rate.derivative()
    return lambda at: (curve(at), rate(at), second(at))


@dataclass(frozen=True)
class TorqueDrive:
    """tau = feed_forward + kp (position error) + kd (velocity error), per motor.

    Attributes:
        kp: N m/rad | N/m, shape (nm,). kd: N m s/rad | N s/m, shape (nm,).
        feed_forward: N m | N on the run's time grid, shape (nt, nm).
    """

    kp: Array
    kd: Array
    feed_forward: Array
