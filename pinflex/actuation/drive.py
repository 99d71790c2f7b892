"""What moves the motors: a prescribed motion (torque is the answer), or a torque (PD)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, comb, floor, log2
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.path import (
    MotorAxes,
    MotorPath,
    Path,
    joint_curve,
    motor_axes,
    underactuated,
)
from pinflex.arrays import Array, BoolArray, IntArray, distinct
from pinflex.description.motions.laws import SNAP
from pinflex.description.motions.motion import Motion
from pinflex.errors import SceneError
from pinflex.mechanics import assembly
from pinflex.mechanics.model.loads import Loads
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism


# The nominal motion: closed-loop inverse kinematics of the rigid mechanism along a path.
#
# Position by Newton on the closures (and the imposed platform coordinates), velocity and
# acceleration from the same Jacobian, so they are exact. The branch is kept: every instant starts
# from the last, or, where many are asked for, from a polynomial through some of them. The last few
# motions are kept with the mechanism: what runs, what compares and what draws asks for the same
# one.

# Of many instants every so manyth is known before the others; of a motion at least so many.
_EVERY, _LEAST = 16, 6
_CORRECTIONS = 5  # from a quintic two are usual
_FINE_GRID = (
    100  # steps that a motion is followed in where that is needed, however few are asked for
)
_NEAR = 0.1  # of the way between known instants: a prediction further off follows no branch


@frozen
class Nominal:
    """Rigid motion at given times: t (nt,), q (nt, nq), v and a (nt, nv).

    `said` tells where it is none: a sentence, or "".
    """

    t: Array
    q: Array
    v: Array
    a: Array
    said: str = ""

    def at(self, k: Any) -> Nominal:
        """Some of the instants."""
        return Nominal(self.t[k], self.q[k], self.v[k], self.a[k])

    def straight(self, n_eta: int) -> Array:
        """Poses with links that do not deform, shape (nt, nq + n_eta)."""
        return np.hstack([self.q, np.zeros((len(self.t), n_eta))])


Instant = tuple[float, Array, Array, Array]  # t [s], q (nq,), v and a (nv,)


def nominal(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal:
    """Follow a motion with the rigid mechanism."""
    return nominal_and_more(mechanism, motion, t, np.empty(0))[0]


def nominal_of(mechanism: Mechanism, motion: Motion, t: Array, some: Any) -> Nominal:
    """The nominal motion at some of the times t; where that at all of t is known, out of it."""
    known = _known(mechanism, motion, t)
    return nominal(mechanism, motion, t[some]) if known is None else known.at(some)


def nominal_and_more(
    mechanism: Mechanism, motion: Motion, t: Array, more: Array
) -> tuple[Nominal, Nominal]:
    """As `nominal`, and at other times `more` between the first and the last of t at once."""
    t = np.array(t, float)
    found = _known(mechanism, motion, t)
    if found is not None:
        return found, between(mechanism, motion, found, more) if len(more) else found.at([])
    every = distinct(t, more)
    both = _solved(mechanism, motion, every)
    found, others = (both.at(np.searchsorted(every, at)) for at in (t, more))
    for x in (found.t, found.q, found.v, found.a):
        x.setflags(write=False)
    return mechanism.followed.nominals.keep(motion, t.tobytes(), found), others


def _solved(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal:
    """The motion at times t alone, whatever was asked before."""
    solved = mechanism.followed.solved
    return solved.get(motion, t.tobytes(), lambda: _closed_loops(Path(mechanism, motion), t))


def _known(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal | None:
    """What needs no solving: open trees, and the last few motions."""
    if motion.target == "joints" and mechanism.rigid.closed.n == 0:
        return _open_tree(mechanism, motion, t)
    known: Nominal | None = mechanism.followed.nominals.find(motion, t.tobytes())
    return known


def _closed_loops(path: Path, t: Array, cut: bool = True) -> Nominal:
    """A few instants by a march, then more between them, then all; `cut`: halved if need be."""
    every = min(_EVERY, len(t) // _LEAST)
    if every > 1 and not path.dynamics.system.closed.contacts:
        some = distinct(np.arange(0, len(t), every), len(t) - 1)
        try:
            found = _filled(path, _closed_loops(path, t[some], False), t)
        except (SceneError, np.linalg.LinAlgError):
            found = None  # so far apart instants lose the way, or it is blocked: look closely
        if found is not None:
            return found
    widest = float(np.max(np.diff(t), initial=0.0)) / max(float(t[-1] - t[0]), 1e-300)
    return _march(path, t, ceil(log2(max(_FINE_GRID * widest, 1.0))) if cut else 0)


def between(mechanism: Mechanism, motion: Motion, known: Nominal, t: Array) -> Nominal:
    """The nominal motion at other times t within those of a known one, on the same branch."""
    if motion.target == "joints" and mechanism.rigid.closed.n == 0:
        return _open_tree(mechanism, motion, t)
    asked = known.q.tobytes(), known.t.tobytes(), t.tobytes()
    return mechanism.followed.between.get(
        motion, asked, lambda: _between(mechanism, motion, known, t)
    )


def _between(mechanism: Mechanism, motion: Motion, known: Nominal, t: Array) -> Nominal:
    path = Path(mechanism, motion)
    path.start_from(known.q[0])
    try:
        found = _filled(path, known, t)
    except (SceneError, np.linalg.LinAlgError):
        found = None
    if found is None:
        every = distinct(known.t, t)
        found = nominal(mechanism, motion, every).at(np.searchsorted(every, t))
    return found


def _march(path: Path, t: Array, cuts: int = 0) -> Nominal:
    """Instant by instant: each starts from the last, in so many halvings of the way at the most."""
    system, n = path.dynamics.system, len(t)
    q = np.empty((n, system.nq))
    v, a = np.empty((n, system.nv)), np.empty((n, system.nv))
    imposed = path.imposed(t)
    q[0], path.sign = path.start(imposed), 0.0
    v[0], a[0] = path.rates(q[0], imposed[1][0], imposed[2][0], t[0])
    path.dynamics.require_on_beams(q[0], path.mechanism.name, float(t[0]))
    times = t.tolist()
    now = times[0], q[0], v[0], a[0]
    for k in range(1, n):
        now = _step(path, now, times[k], (imposed[0][k], imposed[1][k], imposed[2][k]), cuts)
        _, q[k], v[k], a[k] = now
    return Nominal(t, q, v, a)


def _step(
    path: Path, before: Instant, t: float, imposed: tuple[Array, Array, Array], cuts: int
) -> Instant:
    """From one instant to another; by halves where it is so far that the branch is not plain."""
    begin, q, v, a = before
    dt, sign = t - begin, path.sign
    guess = path.dynamics.integrate(q, dt * v + 0.5 * dt * dt * a)
    try:
        pose = path.solve(guess, imposed[0], t)
        rates = path.rates(pose, imposed[1], imposed[2], t)
        if not cuts or path.near(guess, pose):
            path.dynamics.require_on_beams(pose, path.mechanism.name, t)
            return t, pose, *rates
    except SceneError:
        if not cuts:
            path.locate(q, begin, t)
            raise
    path.sign, middle = sign, 0.5 * (begin + t)
    p, v_in, a_in = (x[0] for x in path.imposed(np.array([middle])))
    half = _step(path, before, middle, (p, v_in, a_in), cuts - 1)
    return _step(path, half, t, imposed, cuts - 1)


def _filled(path: Path, known: Nominal, t: Array) -> Nominal | None:
    """The motion at times t between known instants, all at once.

    Returns:
        None where it is not plainly the same branch: far from the quintic through the instants
        around, not closed by a few iterations, near a singular pose or beyond one, on a sleeve.
    """
    d, unknown = path.dynamics, path.unknown
    if d.system.closed.contacts:
        return None
    p, v_in, a_in = path.imposed(t)
    left = np.clip(np.searchsorted(known.t, t, side="right") - 1, 0, len(known.t) - 2)
    moves = path.manifold.log(known.q[:-1], known.q[1:])
    move, reach = moves[left], _with_neighbours(np.max(np.abs(moves), axis=1))[left]
    q = path.manifold.retract(known.q[left], _quintic(known, move, left, t))
    if not path.platform:
        path.axes.write(q, p)
    gone = np.zeros((len(t), len(unknown)))
    for correction in itertools.count():
        error, J = path.equations(q, p)
        most, own = float(np.max(np.abs(error), initial=0.0)), J[:, :, unknown]
        if most < 1e-2 * assembly.CLOSED or correction == _CORRECTIONS or not np.isfinite(most):
            break
        step = np.zeros((len(t), d.system.nv))
        step[:, unknown] = np.linalg.solve(own, -error[:, :, None])[:, :, 0]
        q, gone = path.manifold.retract(q, step), gone + step[:, unknown]
    far = np.max(np.abs(gone), axis=1) > _NEAR * reach + 1e-9
    if not most < 100 * assembly.CLOSED or np.any(far):
        return None
    if _near_singular(path.scaled(own)) or np.any(np.linalg.slogdet(own)[0] != path.sign):
        return None
    return Nominal(t, q, *path.rates_of(q, J, v_in, a_in))


def _with_neighbours(sizes: Array) -> Array:
    """The largest of each size and those beside it: where a motion stops, moves fade."""
    beside = np.concatenate([[0.0], sizes, [0.0]])
    return np.asarray(np.maximum(sizes, np.maximum(beside[:-2], beside[2:])))


def _near_singular(J: Array) -> bool:
    """Whether one of J (n, k, k), without units, is singular; raises if exactly so."""
    # Frobenius norms bound the ratio of singular values from below, and are cheaper.
    size, inverse = (np.linalg.norm(x, axis=(1, 2)) for x in (J, np.linalg.inv(J)))
    doubtful = J[assembly.SINGULAR * size * inverse > 1.0]
    return any(assembly.singular_ratio(x) < assembly.SINGULAR for x in doubtful)


def _quintic(known: Nominal, move: Array, left: IntArray, t: Array) -> Array:
    """Moves from the known instants `left` to times t: positions, rates and second rates met.

    `move` is the one to the next known instant, shape (len(t), nv).
    """
    h = np.diff(known.t)[left]
    x = ((t - known.t[left]) / h)[:, None]
    h = h[:, None]
    v, a = known.v, known.a
    ends = (10 - 15 * x + 6 * x**2) * move + (-4 + 7 * x - 3 * x**2) * h * v[left + 1]
    ends += (0.5 - x + 0.5 * x**2) * h**2 * a[left + 1]
    start = (1 - 6 * x**2 + 8 * x**3 - 3 * x**4) * h * v[left]
    start += 0.5 * x * (1 - x) ** 3 * h**2 * a[left]
    return np.asarray(x * start + x**3 * ends)


def _open_tree(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal:
    """No loops: every joint follows its own law, nothing to solve."""
    system, axes = mechanism.rigid, motor_axes(mechanism)
    passive = system.free
    if len(passive):
        raise underactuated(mechanism, [mechanism.coordinates[k] for k in passive])
    position, velocity, acceleration = joint_curve(mechanism, motion)(t)
    q = np.tile(mechanism.home, (len(t), 1))
    axes.write(q, position)
    v, a = np.zeros((len(t), system.nv)), np.zeros((len(t), system.nv))
    v[:, axes.v_at], a[:, axes.v_at] = velocity, acceleration
    return Nominal(np.asarray(t, float), q, v, a)


# Interpolated motor motions (m, rad) are refined until the mid-interval error falls below this:
# far below any step error, far above round-off of the second derivative.
_FINE = 1e-10
# Of a run: how far beside a jump its sides are looked at, beyond what laws snap to.
_BESIDE = 1e-10


@dataclass(frozen=True, eq=False)
class MotorCurve:
    """Motor motion as a function of time.

    Attributes:
        curve: Positions, velocities and accelerations at times (nt,), each (nt, nm).
        pieces: Times (s), rising, between which it is a polynomial of fifth degree; None: it is no
            such.
    """

    curve: Callable[[Array], tuple[Array, Array, Array]]
    pieces: Array | None = None

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
        return MotorPath(t, *joint_curve(mechanism, motion)(t))
    return _interpolated(mechanism, motion, float(t[0]), float(t[-1]), len(t))(t)


def path_between(mechanism: Mechanism, motion: Motion, start: float, end: float) -> MotorCurve:
    """Motor motion as a function of times in [start, end] s."""

    def made() -> MotorCurve:
        if motion.target == "joints":
            return MotorCurve(joint_curve(mechanism, motion))
        return _interpolated(mechanism, motion, start, end)

    return mechanism.followed.paths.get(motion, (start, end), made)


def _interpolated(
    mechanism: Mechanism, motion: Motion, start: float, end: float, most: int = 4097
) -> MotorCurve:
    """Motor motion of a platform motion in [start, end] s; of fewer than `most` nodes, or exact."""
    nodes = 65
    while nodes < most:
        grid, inside, old = _nodes(motion, start, end, 2 * nodes - 1)
        x, v, a = motors_along(mechanism, motion, inside)
        rest = (grid - inside)[:, None]
        values = x + rest * (v + 0.5 * rest * a), v + rest * a, a
        coarse = _hermite(grid[old], [x[old] for x in values])
        error = np.max(np.abs(coarse(grid[~old])[0] - values[0][~old]), initial=0.0)
        # Halving the interval divides the quintic's error by 64.
        if error / 64.0 < _FINE:
            return MotorCurve(_hermite(grid, list(values)), grid)
        nodes = 2 * nodes - 1
    return MotorCurve(partial(motors_along, mechanism, motion))


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


def motors_along(mechanism: Mechanism, motion: Motion, t: Array) -> tuple[Array, Array, Array]:
    """Positions, velocities, accelerations of the motors on the nominal motion, each (nt, nm)."""
    path, axes = nominal(mechanism, motion, t), motor_axes(mechanism)
    position = axes.read(path.q)
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


@frozen
class TorqueDrive:
    """tau = feed_forward + kp (position error) + kd (velocity error), per motor.

    Attributes:
        kp: N m/rad | N/m, shape (nm,). kd: N m s/rad | N s/m, shape (nm,).
        feed_forward: N m | N at the steps of a run, shape (nt, nm).
        forward: The same as a function of times, (k,) to (k, nm).
    """

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


# A jump of an acceleration between steps, told from a bend: of a step, of the largest, of bends.
_ON, _SLIGHT, _SHARP = 1e-6, 1e-6, 8.0


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


def averaged(t: Array, values: Array, breaks: Sequence[float]) -> tuple[Array, IntArray]:
    """Values at equal steps, those beside a jump averaged over the step around them.

    A method of second order feels a jump half a step before the first step that knows of it: up to
    half a step early or late. The mean moves it to where it is; at the last step it is the value
    before a jump, since nothing comes after.

    Returns:
        Values (nt, k), the steps at which they are others.
    """
    last, found, at = len(t) - 1, values.copy(), []
    bends = np.zeros(len(t))
    bends[1:-1] = np.abs(np.diff(values, 2, axis=0)).max(axis=1, initial=0.0)
    least = _SLIGHT * np.max(np.abs(values), initial=0.0)
    for place in (np.asarray(breaks) - t[0]) * (last / (t[-1] - t[0])):
        k, left, right = round(place), ceil(place - _ON) - 1, floor(place + _ON) + 1
        if left < 2 or k > last:
            continue
        before, after = values[left] + (k - left) * (values[left] - values[left - 1]), values[-1]
        if right < last:
            after = values[right] - (right - k) * (values[right + 1] - values[right])
        smooth = bends[left - 1] + (bends[right + 1] if right + 1 < last else 0.0)
        if np.max(np.abs(after - before), initial=0.0) > max(_SHARP * smooth, least):
            share = 0.5 + k - place if k < last else 0.0  # of the step around it, after the jump
            found[k] = (1.0 - share) * before + share * after
            at.append(k)
    return found, np.array(at, dtype=np.intp)


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
