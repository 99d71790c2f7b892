"""What moves the motors: a prescribed motion (torque is the answer), or a torque (PD)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from pinflex.actuation.motors import MotorAxes, joint_curve, joint_path, motor_axes
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.description.motions.laws import SNAP
from pinflex.description.motions.motion import Motion
from pinflex.mechanics.evaluation.equations import Followed
from pinflex.mechanics.model.loads import Loads
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism

# Interpolated motor motions (m, rad) are refined until the mid-interval error falls below this:
# far below any step error, far above round-off of the second derivative.
_FINE = 1e-10
# Of a run: how far beside a jump its sides are looked at, beyond what laws snap to.
_BESIDE = 1e-10
_KEPT = 4  # paths: whoever marches once more, or in other steps, asks for the same one


@dataclass(frozen=True)
class MotorPath:
    """Motor positions, velocities, accelerations on a time grid, each (nt, nm)."""

    __repr__ = brief

    t: Array
    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class Quintics:
    """Motor motion as a function of time that is a polynomial between some times.

    Attributes:
        pieces: These times in s, rising, shape (k,). Its polynomials are of fifth degree.
        curve: Positions, velocities and accelerations at times (nt,), each (nt, nm).
    """

    pieces: Array
    curve: Callable[[Array], tuple[Array, Array, Array]]

    def __call__(self, t: Array) -> MotorPath:
        """Motion of the motors at times t (nt,)."""
        return MotorPath(t, *self.curve(t))


def motor_path(mechanism: Mechanism, motion: Motion, t: Array) -> MotorPath:
    """Motor motion at times t: exact for joints, by inverse kinematics for the platform.

    Inverse kinematics runs on a coarse grid; a quintic Hermite interpolant through its positions,
    velocities and accelerations carries it to every step, refined until it is exact to 1e-10.
    """
    t = np.asarray(t, float)
    if motion.target == "joints":
        return MotorPath(t, *joint_path(mechanism, motion, t))
    curve, fine = _interpolated(mechanism, motion, float(t[0]), float(t[-1]), len(t))
    return curve(t) if fine else MotorPath(t, *_at_nodes(mechanism, motion, t))


def path_between(
    mechanism: Mechanism, motion: Motion, start: float, end: float
) -> Callable[[Array], MotorPath]:
    """Motor motion as a function of times in [start, end] s."""
    for moved, ends, path in mechanism.followed.paths:
        if moved is motion and ends == (start, end):
            known: Callable[[Array], MotorPath] = path
            return known
    if motion.target == "joints":
        found = _path(joint_curve(mechanism, motion))
    else:
        found = _interpolated(mechanism, motion, start, end)[0]
    Followed.keep(mechanism.followed.paths, (motion, (start, end), found), _KEPT)
    return found


def _interpolated(
    mechanism: Mechanism, motion: Motion, start: float, end: float, most: int = 4097
) -> tuple[Callable[[Array], MotorPath], bool]:
    """Motor motion of a platform motion as a function of times in [start, end] s.

    Returns:
        The function, and whether fewer than `most` nodes made it exact to 1e-10.
    """
    nodes = 65
    while nodes < most:
        grid, inside, old = _nodes(motion, start, end, 2 * nodes - 1)
        x, v, a = _at_nodes(mechanism, motion, inside)
        rest = (grid - inside)[:, None]
        values = x + rest * (v + 0.5 * rest * a), v + rest * a, a
        coarse = _hermite(grid[old], [x[old] for x in values])
        error = np.max(np.abs(coarse(grid[~old])[0] - values[0][~old]), initial=0.0)
        # Halving the interval divides the quintic's error by 64.
        if error / 64.0 < _FINE:
            return Quintics(grid, _hermite(grid, list(values))), True
        nodes = 2 * nodes - 1
    return _path(lambda t: _at_nodes(mechanism, motion, t)), False


def _nodes(motion: Motion, start: float, end: float, count: int) -> tuple[Array, Array, BoolArray]:
    """Nodes in [start, end] s, equally far apart and twice where accelerations may jump.

    Where they do at the end, which belongs to what follows, one more behind it.

    Returns:
        Their times; times a little inside the pieces between jumps; and which of them belong to
        half as many nodes.
    """
    span = end - start
    close = _BESIDE * span
    # A time that rounds to a jump is past it.
    at = np.array([t - SNAP * span for t in motion.switches if start + close < t <= end + close])
    more = [end + 1e-3 * span] if len(at) and at[-1] > end - close else []
    grid = np.linspace(start, end, count)
    alone = np.all(np.abs(grid[:, None] - at) > 10.0 * close, axis=1)
    inside = np.concatenate([grid[alone], at - close, at + close, more])
    order = np.argsort(inside)
    old = np.append((np.arange(count) % 2 == 0)[alone], np.ones(2 * len(at) + len(more), bool))
    return np.concatenate([grid[alone], at, at, more])[order], inside[order], old[order]


def _path(curve: Callable[[Array], tuple[Array, Array, Array]]) -> Callable[[Array], MotorPath]:
    return lambda t: MotorPath(t, *curve(t))


def _at_nodes(mechanism: Mechanism, motion: Motion, t: Array) -> tuple[Array, Array, Array]:
    path, axes = nominal(mechanism, motion, t), motor_axes(mechanism)
    position = np.array([axes.read(q) for q in path.q])
    if len(axes.paired):
        position = np.unwrap(position, axis=0)
    return position, path.v[:, axes.v_at], path.a[:, axes.v_at]


def _hermite(t: Array, values: list[Array]) -> Callable[[Array], tuple[Array, Array, Array]]:
    """The quintics through positions, velocities and accelerations (nt, nm) at times t (nt,).

    A time that comes twice has a value on either side.

    In Bernstein's form, whose k-th derivative at an end is a difference of the k + 1 coefficients
    there (Farouki 2012, eq. 30). By numpy: scipy's splines take longer to import than a run.
    """
    h, (x, v, a) = np.diff(t)[:, None], values
    h[h == 0.0] = 1.0  # between the two sides of a jump: no time lies there
    rise, bend = h / 5.0, h * h / 20.0
    begin = (x[:-1], x[:-1] + rise * v[:-1], x[:-1] + 2.0 * rise * v[:-1] + bend * a[:-1])
    end = (x[1:] - 2.0 * rise * v[1:] + bend * a[1:], x[1:] - rise * v[1:], x[1:])
    curve = np.stack([*begin, *end])
    rate = 5.0 / h * np.diff(curve, axis=0)
    second = 4.0 / h * np.diff(rate, axis=0)

    def at(times: Array) -> tuple[Array, Array, Array]:
        times = np.asarray(times, float)
        left = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(h) - 1)
        part = ((times - t[left]) / h[left, 0])[:, None]
        x, v, a = (_bernstein(of, left, part) for of in (curve, rate, second))
        return x, v, a

    return at


def _bernstein(coefficients: Array, left: IntArray, x: Array) -> Array:
    """Sum of C(n, k) x^k (1 - x)^(n - k) c_k of the pieces `left`, c (n + 1, pieces, m)."""
    n, total = len(coefficients) - 1, np.zeros((len(left), coefficients.shape[2]))
    for k, c in enumerate(coefficients):
        total += comb(n, k) * x**k * (1.0 - x) ** (n - k) * c[left]
    return total


# Of a step, how far before its end torques are read: a curve bends by the square of it, 1e-8, and
# tables hold their corners' values within 1e-9 of a run.
_BEFORE_END = 1e-4


@dataclass(frozen=True)
class TorqueDrive:
    """tau = feed_forward + kp (position error) + kd (velocity error), per motor.

    Attributes:
        kp: N m/rad | N/m, shape (nm,). kd: N m s/rad | N s/m, shape (nm,).
        feed_forward: N m | N at the steps of a run, shape (nt, nm).
        forward: The same as a function of times, (k,) to (k, nm).
    """

    __repr__ = brief

    kp: Array
    kd: Array
    feed_forward: Array
    forward: Callable[[Array], Array]

    def torque(self, k: int, path: MotorPath, axes: MotorAxes, y: Array, v: Array) -> Array:
        """Motor torques at step k in the state (y, v), shape (nm,)."""
        position = axes.behind(path.position[k], y)
        velocity = path.velocity[k] - v[axes.v_at]
        return np.asarray(self.feed_forward[k] + self.kp * position + self.kd * velocity)

    def pull(
        self, path: MotorPath, axes: MotorAxes, y: Array, v: Array, inside: bool = False
    ) -> Array:
        """Motor torques at the times of a path in the states (y, v), shape (k, nm).

        `inside`: these are the stages of a step, and the last ends it. Where what is fed forward
        jumps there it is that before: else an error of the order of h is left in every speed.
        """
        error, rate = axes.behind(path.position, y), path.velocity - v[:, axes.v_at]
        forward = np.array(self.forward(path.t))
        if inside:
            rest = _BEFORE_END * (path.t[-1] - path.t[0])
            near, far = self.forward(path.t[-1] - rest * np.array([1.0, 2.0]))
            forward[-1] = 2.0 * near - far  # straight on from the two
        return np.asarray(forward + self.kp * error + self.kd * rate)


def kinks(path: MotorPath) -> frozenset[int]:
    """Steps at which the motor accelerations bend: the start, and wherever a motion piece ends.

    There the slope of a jumps, and s has to follow, or lam is of first order after it. The second
    difference of a is h times the jump at a bend and of the order of h^2 elsewhere.
    """
    a = path.acceleration
    if len(a) < 8 or not a.shape[1]:
        return frozenset({0})
    bend = np.zeros(len(a))
    bend[1:-1] = np.max(np.abs(a[2:] - 2 * a[1:-1] + a[:-2]), axis=1)
    around = np.maximum(np.roll(bend, 2), np.roll(bend, -2))
    sharp = (bend > 4.0 * around) & (bend > 1e-6 * np.max(np.abs(a)))
    found = np.flatnonzero(sharp[3:-3]) + 3
    # A rough sampled motion bends everywhere: then the steps are what limits it.
    return frozenset({0, *found.tolist()}) if len(found) <= 32 else frozenset({0})


def breaks(motion: Motion, loads: Loads) -> tuple[float, ...]:
    """Times in s at which a motion or a load switches: where a piece of it ends."""
    times = set(motion.switches)
    for force, _ in loads.forces:
        times |= set(force.corners)
    return tuple(sorted(time for time in times if time > 0.0))


def sample_times(motion: Motion, end: float) -> tuple[float, ...]:
    """Times in s up to `end` of the samples of a motion: its pieces are polynomials between them.

    A periodic one comes round until then.
    """
    times = np.asarray(motion.spec["t"], float)
    rounds = range(int(np.ceil(end / times[-1])) if motion.spec["periodic"] else 1)
    return tuple(t for k in rounds for t in (times + k * times[-1]).tolist() if t <= end)
