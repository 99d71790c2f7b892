"""The nominal motion: closed-loop inverse kinematics of the rigid mechanism along a path.

Position by Newton on the closures (and the imposed platform coordinates), velocity and acceleration
from the same Jacobian, so they are exact. The branch is kept: every instant starts from the last,
or, where many are asked for, from a polynomial through some of them. The last few motions are kept
with the mechanism: what runs, what compares and what draws asks for the same one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import ceil, log2
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.motors import joint_path, motor_axes
from pinflex.actuation.path import Path, underactuated
from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.errors import SceneError
from pinflex.mechanics import assembly
from pinflex.mechanics.evaluation.equations import Followed
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism

# Of many instants every so manyth is known before the others; of a motion at least so many.
_EVERY, _LEAST = 16, 6
_KEPT = 4  # of a run: at its samples, where a platform's motor motion is interpolated, for scales
_CORRECTIONS = 5  # from a quintic two are usual
_FINE = 100  # steps that a motion is followed in where that is needed, however few are asked for
_NEAR = 0.1  # of the way between known instants: a prediction further off follows no branch


@dataclass(frozen=True)
class Nominal:
    """Rigid motion at given times: t (nt,), q (nt, nq), v and a (nt, nv).

    `said` tells where it is none: a sentence, or "".
    """

    __repr__ = brief

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
    """Follow a motion with the rigid mechanism.

    Returns:
        Rigid positions, velocities, accelerations.
    Raises:
        MotionError: A pose that cannot be reached, with the time and the reason.
        SingularityError: The path meets a singular pose, with loop, motion and sigma_min.
    """
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
    every = np.union1d(t, more)
    both = _solved(mechanism, motion, every)
    found, others = (both.at(np.searchsorted(every, at)) for at in (t, more))
    for x in (found.t, found.q, found.v, found.a):
        x.setflags(write=False)
    Followed.keep(mechanism.followed.nominals, (motion, found), _KEPT)
    return found, others


def _solved(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal:
    """The motion at times t alone, whatever was asked before."""
    for moved, known in mechanism.followed.solved:
        if moved is motion and np.array_equal(known.t, t):
            found: Nominal = known
            return found
    found = _closed_loops(Path(mechanism, motion), t)
    Followed.keep(mechanism.followed.solved, (motion, found), _KEPT)
    return found


def _known(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal | None:
    """What needs no solving: open trees, and the last few motions."""
    if motion.target == "joints" and mechanism.rigid.closed.n == 0:
        return _open_tree(mechanism, motion, t)
    for moved, known in mechanism.followed.nominals:
        if moved is motion and np.array_equal(known.t, t):
            found: Nominal = known
            return found
    return None


def _closed_loops(path: Path, t: Array, cut: bool = True) -> Nominal:
    """A few instants by a march, then more between them, then all; `cut`: halved if need be."""
    every = min(_EVERY, len(t) // _LEAST)
    if every > 1 and not path.dynamics.system.closed.contacts:
        some = np.unique(np.append(np.arange(0, len(t), every), len(t) - 1))
        try:
            found = _filled(path, _closed_loops(path, t[some], False), t)
        except (SceneError, np.linalg.LinAlgError):
            found = None  # so far apart instants lose the way, or it is blocked: look closely
        if found is not None:
            return found
    return _march(path, t, ceil(log2(max(_FINE / max(len(t) - 1, 1), 1.0))) if cut else 0)


def between(mechanism: Mechanism, motion: Motion, known: Nominal, t: Array) -> Nominal:
    """The nominal motion at other times t within those of a known one, on the same branch."""
    if motion.target == "joints" and mechanism.rigid.closed.n == 0:
        return _open_tree(mechanism, motion, t)
    path = Path(mechanism, motion)
    path.start_from(known.q[0])
    try:
        found = _filled(path, known, t)
    except (SceneError, np.linalg.LinAlgError):
        found = None
    if found is None:
        every = np.union1d(known.t, t)
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
    position, velocity, acceleration = joint_path(mechanism, motion, t)
    q = np.tile(mechanism.home, (len(t), 1))
    axes.write(q, position)
    v, a = np.zeros((len(t), system.nv)), np.zeros((len(t), system.nv))
    v[:, axes.v_at], a[:, axes.v_at] = velocity, acceleration
    return Nominal(np.asarray(t, float), q, v, a)
