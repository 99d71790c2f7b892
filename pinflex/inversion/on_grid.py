"""Motor motion on the instants of a grid, by level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pinflex.arrays import Array, IntArray, distinct
from pinflex.description.motions.motion import Motion, hold
from pinflex.errors import ConvergenceError
from pinflex.inversion.exact import EIGHTH, flat, invert, padded, rates, spline
from pinflex.inversion.target import Balanced, Instant, Target, balanced, delayed, target
from pinflex.kernel.evaluate import Tangent
from pinflex.levels.modes import modes
from pinflex.levels.rigid import solve_rigid
from pinflex.linalg import eigh, lapack, null_space, saddle, saddle_matrix
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism

# What a mechanism does when the motors of a command stop at its end: free vibration about rest.
#
# Motors that stop with a way to go, or at speed, leave the mechanism off its equilibrium. Where
# they stop at once they give it a blow that keeps the momenta of everything else,
#
#     N' M_ff N z' = N' (M_ff v_f + M_fm v_m),      J_f N = 0
#
# where they stop softly the elastic speeds stay, N z' = v_f: the larger one counts. Each mode
# swings on with the energy that it then has. Damping is left out: a bar.

_SAFETY = 2.0  # to first order, and of loops neither a blow nor soft: seen up to 1.7
_STILL = 1e-6  # of the fastest rate, below which nothing holds a mode: it goes on, and is left out


def swing_after(instant: Instant, found: Balanced, rest: Balanced, n: int) -> Array:
    """Bar on the platform's error [m | rad] after the motors have stopped, shape (k,)."""
    d, motors, free = instant.dynamics, instant.system.motors, instant.free
    around = found.y[n - 1 - EIGHTH.reach : n + EIGHTH.reach]
    v = rates(d, around, float(instant.target.t[1]), EIGHTH)[0][0]
    y, still = rest.y[n - 1], np.zeros(instant.system.nv)
    M, _, K, J = d.tangent(y, still, still, rest.lam[n - 1], float(instant.target.t[n - 1]))
    P = instant.platform.at(d.kinematics(y[None]))[1][0]
    off = d.difference(y, found.y[n - 1])
    # the equilibrium of where the motors stop, and the way and speed from there
    J_f, stop = J[:, free], off[motors]
    balance, _ = saddle(
        K[np.ix_(free, free)], J_f, J_f, -K[np.ix_(free, motors)] @ stop, -J[:, motors] @ stop
    )
    N = null_space(J_f)
    m, k = (N.T @ x[np.ix_(free, free)] @ N for x in (M, K))
    squares, Z = eigh(0.5 * (k + k.T), 0.5 * (m + m.T))
    way = Z.T @ m @ N.T @ (off[free] - balance)
    blow, soft = Z.T @ N.T @ M[free] @ v, Z.T @ m @ N.T @ v[free]
    speed = np.maximum(np.abs(blow), np.abs(soft))
    rate = np.sqrt(np.maximum(squares, 0.0))
    held = rate > _STILL * np.max(rate, initial=0.0)
    swing = np.hypot(way[held], speed[held] / rate[held])
    shapes = np.abs(P[:, free] @ N @ Z[:, held])
    stays = np.abs(P[:, motors] @ stop + P[:, free] @ balance)
    return np.asarray(_SAFETY * (stays + shapes @ swing))


# How many instants an exact command needs: from the modes that ring after the motion.
#
# Where the fifth derivative of a motion jumps, as at the ends of a nonic, a mode of frequency f is
# left with a swing like f^-5. Differences of order 8 that are h apart see its inertia with a
# relative error e(2 pi f h), and a command leaves that share of its swing. Each of n modes may
# leave an n-th part of the share wanted of what the first one swings with the rigid command:
#
#     e(2 pi f h) (f_1 / f)^5 <= 1e-4 / n

_SHARE = 1e-4  # of the rigid command's swing
_CORNER = 5  # power of the frequency: the derivative of the motion that jumps
_FAST = 70.0  # periods in the motion, beyond which its ends leave 1e-9 of the way: none to lower
_LEAST = 150  # instants over the motion


def instants_over(mechanism: Mechanism, duration: float) -> int:
    """Instants over a motion of some duration [s]."""
    found = modes(mechanism, count=mechanism.flexible.nv).frequencies
    f = found[(found > 0.0) & (found * duration < _FAST)]
    if not len(f):
        return _LEAST
    share = (f[0] / f) ** _CORNER
    allowed = _SHARE / np.sum(share > _SHARE) / share
    phase, reach = np.linspace(0.0, np.pi, 721)[1:], np.arange(-EIGHTH.reach, EIGHTH.reach + 1)
    seen = -np.cos(np.outer(phase, reach)) @ EIGHTH.second  # the square of the phase
    missed = np.abs(seen / phase**2 - 1.0)  # grows with the phase
    longest = np.interp(allowed, missed, phase, right=np.inf) / (2.0 * np.pi * f)
    return max(_LEAST, int(np.ceil(duration / float(np.min(longest)))))


# What a flexible mechanism does with a command: its vibration about the poses that were planned.
#
# Poses y(t) that put the platform on its path leave forces e = r(y, v, a, lam) open in the rows
# that no motor drives: the inertia of the last elastic change. With its motors on the command the
# mechanism departs from y by d,
#
#     M d'' + C d' + K d - J' dlam = -e,     J d = -c(y),     d = 0 at the motors and at the start
#
# a linear system that changes along the motion; what it rings with is in the answer, damped or not.
# One march of Newmark's rule finds d to first order. The rows of y + d, with differences of order
# 8, hold what large departures, the steps and the interpolation of the matrices leave of them; a
# second march tells what that is worth at the platform.
#
# Source: Geradin, Cardona (2001), Flexible Multibody Dynamics, ch. 7 (Newmark's rule with
# closures); Stetter (1978), Numer. Math. 29, 425 (the correction by a defect estimates the error).

_NODES = 16  # intervals over the motion in which matrices are straight lines: the defect tells


class Forward:
    """The forward equations, linearised along the motion of poses that balance a path.

    For any poses near those: the motors' motion is that of the poses that are asked about.
    """

    def __init__(self, instant: Instant, found: Balanced) -> None:
        """Evaluate and factorise the system along `found`."""
        self._instant, self._manifold = instant, Manifold(instant.dynamics)
        self._h = float(instant.target.t[1] - instant.target.t[0])
        v, a, _ = self._rates(found.y, instant.axes.read(found.y))
        at = _nodes(instant.target.path.v)
        every = [self._matrices(int(k), found, v, a) for k in at]
        self._from = every
        self._rise = [
            Tangent(*(y - x for x, y in zip(*pair, strict=True)))
            for pair in zip(every, [*every[1:], every[-1]], strict=True)
        ]
        inside = np.clip(np.arange(len(found.y)), at[0], at[-1])
        self._node = np.searchsorted(at, inside, side="right") - 1
        width = np.append(np.diff(at), 1)
        self._part = (inside - at[self._node]) / width[self._node]
        self._factors: dict[tuple[int, float], tuple[Array, Array]] = {}

    def platform_error(self, found: Balanced, kept: slice = slice(None)) -> Array:
        """Bar on how far the platform is from its path [m | rad], shape (k,).

        The largest of what two marches find, and of what the second one changes.
        """
        motors = self._instant.axes.read(found.y)
        forces, gap, _ = self._open(found.y, found.lam, motors)
        d, lam = self._departure(forces, gap)
        y = self._manifold.retract(found.y, d)
        forces, gap, first = self._open(y, found.lam + lam, motors)
        d, _ = self._departure(forces, gap)
        platform, target = self._instant.platform, self._instant.target
        values = platform.of(self._instant.dynamics, self._manifold.retract(y, d))
        error = platform.error(values, target.position)
        parts = (np.max(np.abs(x[kept]), axis=0) for x in (error, error - first))
        return np.asarray(np.nan_to_num(sum(parts), nan=np.inf))

    def _rates(self, y: Array, motors: Array) -> tuple[Array, Array, IntArray]:
        """v and a of poses, those of the motors as the spline of the command has them.

        And the instants that differ from the one before them: those of a rest are one.
        """
        instant, t = self._instant, self._instant.target.t
        v, a = rates(instant.dynamics, padded(y, EIGHTH.reach), self._h, EIGHTH)
        own = instant.changing(y, v, a)
        curve, rows = spline(t, np.unwrap(motors, axis=0)), instant.system.motors
        v[:, rows], a[:, rows] = curve(t, 1), curve(t, 2)
        return v, a, own

    def _matrices(self, k: int, found: Balanced, v: Array, a: Array) -> Tangent:
        """Of the coordinates that no motor drives."""
        instant = self._instant
        free, t = instant.free, float(instant.target.t[k])
        M, C, K, J = instant.dynamics.tangent(found.y[k], v[k], a[k], found.lam[k], t)
        square = np.ix_(free, free)
        return Tangent(M[square], C[square], K[square], J[:, free])

    def _open(self, y: Array, lam: Array, motors: Array) -> tuple[Array, Array, Array]:
        """Forces left open (nt, free), of closures (nt, rows), of the platform (nt, k)."""
        instant = self._instant
        v, a, own = self._rates(y, motors)
        some, _ = instant.residuals(own, y[own], v[own], a[own], lam[own])
        rows = some[np.searchsorted(own, np.arange(len(y)), side="right") - 1]
        n, m, k = len(instant.free), instant.rows, len(instant.target.names)
        return rows[:, :n], rows[:, n : n + m], rows[:, n + m : n + m + k]

    def _departure(self, forces: Array, gap: Array) -> tuple[Array, Array]:
        """d (nt, nv) and dlam (nt, rows) under open forces (nt, free) and gaps (nt, rows)."""
        dgetrs = lapack().dgetrs
        n, h, quarter = forces.shape[1], self._h, 0.25 * self._h**2
        out, lam = np.zeros((len(forces), self._instant.system.nv)), np.zeros_like(gap)
        d, v, a = np.zeros((3, n))
        right = np.empty(n + gap.shape[1])
        for k in range(1, len(forces)):
            node, part = int(self._node[k]), float(self._part[k])
            here, rise = self._from[node], self._rise[node]
            d, v = d + h * v + quarter * a, v + 0.5 * h * a
            right[:n] = -forces[k] - here.C @ v - here.K @ d
            right[n:] = gap[k] + here.J @ d
            if part:
                right[:n] -= part * (rise.C @ v + rise.K @ d)
                right[n:] += part * (rise.J @ d)
            right[n:] /= -quarter
            x, _ = dgetrs(*self._factorised(node, part), right)
            a, lam[k] = x[:n], x[n:]
            d, v = d + quarter * a, v + 0.5 * h * a
            out[k, self._instant.free] = d
        return out, lam

    def _factorised(self, node: int, part: float) -> tuple[Array, Array]:
        """LU factors of a step's saddle matrix; at rest all steps have one."""
        if (node, part) not in self._factors:
            here, rise, h = self._from[node], self._rise[node], self._h
            M, C, K, J = (x + part * y for x, y in zip(here, rise, strict=True))
            S = saddle_matrix(M + 0.5 * h * C + 0.25 * h * h * K, J)
            self._factors[node, part] = lapack().dgetrf(S)[:2]
        return self._factors[node, part]


def _nodes(v: Array) -> IntArray:
    """Instants at which matrices are evaluated: evenly over the time in which the path moves."""
    moving = np.flatnonzero(np.any(v != 0.0, axis=1))
    if not len(moving):
        return np.zeros(1, dtype=np.intp)
    first, last = max(int(moving[0]) - 1, 0), min(int(moving[-1]) + 1, len(v) - 1)
    return distinct(np.linspace(first, last, _NODES + 1).round().astype(np.intp))


# The quasistatic command: an asymptotic series in (elastic period / time of the motion)^2.
#
# The pose that balances the rigid motion's inertia forces is differentiated in time, and balanced
# again with its own rates; every pass gains that factor until the series diverges. Of its passes
# the one with the smallest error of the platform is taken, which is what the forces that it leaves
# open do to the mechanism (above), vibration included.
#
# Source: Seifried (2014), ch. 6 (quasi-static approximation), taken further by iteration.

_PASSES = 8
_WORTH = 0.5  # of what the rigid command misses, below which the series is advised
RESOLVED = 1e-9  # m or rad: a smaller error is below what the differences resolve


@dataclass(frozen=True)
class Grid:
    """What is known on one grid, to begin with on a finer one.

    Attributes:
        slow, found: The quasistatic answer and the exact motion.
    """

    instant: Instant
    slow: Answer
    found: Balanced

    def carried(self, motion: Balanced, finer: Instant) -> Balanced:
        """A motion at the instants of a finer grid: how far it is from the rigid one is smooth."""
        here, there = (rigid_guess(x)[0] for x in (self.instant, finer))
        manifold, n = Manifold(finer.dynamics), motion.lam.shape[1]
        away = np.concatenate([motion.lam, manifold.log(here.y, motion.y)], axis=1)
        found = spline(self.instant.target.t, away)(finer.target.t)
        return Balanced(manifold.retract(there.y, found[:, n:]), found[:, :n], there.torque)


@dataclass(frozen=True)
class Answer:
    """Motor motion on a grid.

    Attributes:
        found: Poses, multipliers and torques.
        error: Largest error of each platform coordinate [m | rad], shape (k,).
        missed: By how much the rigid command misses them, shape (k,).
        iterations: Of Newton, level exact.
        changes: Of the motors by each term of the series, level quasistatic.
        curve: Motor positions by time and order of derivative, where known in closed form.
        swing: Bar on the platform when motors stop at the end [m | rad], shape (k,).
        grid: Level exact by inversion: what a finer grid starts from.
    """

    found: Balanced
    error: Array
    missed: Array
    iterations: int = 0
    changes: tuple[float, ...] = ()
    curve: Callable[..., Array] | None = None
    swing: Array | None = None
    grid: Grid | None = None


def rigid_guess(instant: Instant) -> tuple[Balanced, Array, Array]:
    """The undeformed mechanism on the path, and its v and a."""
    path, system = instant.target.path, instant.system
    nt, n = len(path.t), path.v.shape[1]
    v, a = np.zeros((nt, system.nv)), np.zeros((nt, system.nv))
    v[:, :n], a[:, :n] = path.v, path.a
    lam = np.zeros((nt, instant.rows))
    torque = np.zeros((nt, len(system.motors)))
    return Balanced(path.straight(system.n_eta), lam, torque), v, a


def series(instant: Instant, kept: slice = slice(None)) -> Answer:
    """Balance along the path, again and again, until the platform's error grows: the best pass."""
    guess, v, a = rigid_guess(instant)
    h = float(instant.target.t[1] - instant.target.t[0])
    last = balanced(instant, guess, v, a)
    forward, by_platform = Forward(instant, last), np.linalg.pinv(instant.target.gain[0])
    best, smallest, changes = last, np.inf, list[float]()
    bar = np.full(len(instant.target.names), np.inf)
    for _ in range(_PASSES):
        error = forward.platform_error(last, kept)
        size = float(np.max(np.abs(by_platform) @ error))  # in the motors' units: one for all
        if size < smallest:
            best, bar = last, error
        if not RESOLVED < size < smallest:
            break
        smallest = size
        v, a = rates(instant.dynamics, padded(last.y, EIGHTH.reach), h, EIGHTH)
        try:
            following = balanced(instant, last, v, a)
        except ConvergenceError:
            break
        moved = instant.axes.behind(instant.axes.read(following.y), last.y)
        changes.append(float(np.max(np.abs(moved))))
        last = following
    apart = instant.axes.behind(instant.target.motors, best.y)
    missed = _at_platform(instant.target.gain[kept], apart[kept])
    return Answer(best, bar, missed, changes=tuple(changes))


def on_grid(
    instant: Instant, motion: Motion, level: str, kept: slice, coarser: Grid | None = None
) -> Answer:
    """Find the motor motion at every instant, level exact from what a coarser grid has, if any."""
    wanted = instant.target
    if coarser is not None and level == "exact":
        reference, start = (
            coarser.carried(x, instant) for x in (coarser.slow.found, coarser.found)
        )
        return _exact(instant, motion, replace(coarser.slow, found=reference), start, kept)
    slow = series(instant, kept)
    if level == "quasistatic":
        return slow
    if level == "rigid":
        law = delayed(motion, wanted.before)
        torque = solve_rigid(instant.mechanism, law, wanted.t).torque
        return Answer(replace(rigid_guess(instant)[0], torque=torque), slow.missed, slow.missed)
    return _exact(instant, motion, slow, slow.found, kept)


def _exact(instant: Instant, motion: Motion, slow: Answer, start: Balanced, kept: slice) -> Answer:
    """Stable inversion, or its closed form where gears alone give way."""
    wanted = instant.target
    gain, t, missed = wanted.gain[kept], wanted.t, slow.missed
    smooth = flat(instant.mechanism, motion, wanted)
    if smooth is None:
        try:
            exact = invert(instant, slow.found, start)
        except ConvergenceError as open_end:
            raise ConvergenceError(f"{open_end} {_instead(wanted, slow)}") from None
        error, count = _at_platform(gain, exact.error[kept]), exact.iterations
        swing = swing_after(instant, exact.found, slow.found, len(gain))
        grid = Grid(instant, slow, exact.found)
        return Answer(exact.found, error, missed, iterations=count, swing=swing, grid=grid)
    found = Balanced(smooth.poses(t), np.zeros((len(t), instant.rows)), smooth.torque(t))
    error = _at_platform(gain, np.tile(smooth.error, (len(gain), 1)))
    return Answer(found, error, missed, curve=smooth.position)


def _instead(wanted: Target, slow: Answer) -> str:
    """What to do where an inversion does not settle, by what the series has at the worst."""
    k = int(np.argmax(slow.error / np.maximum(slow.missed, RESOLVED)))
    unit = "rad" if wanted.names[k].startswith("r") else "m"
    more, motors, names = "", wanted.motors.shape[1], ", ".join(wanted.names)
    if len(wanted.names) < motors:
        more = (
            f"Coordinates held: {names}, by {motors} motors; in what is not named the links swing "
            "freely about the rigid motion, here too far. Name more where motors can move them. "
        )
    misses = f"{slow.error[k]:.2g} {unit} of {wanted.names[k]}, the rigid one {slow.missed[k]:.2g}"
    if slow.error[k] < _WORTH * slow.missed[k]:
        return f"{more}Take level quasistatic, which misses {misses}, or slow the motion down."
    return f"{more}Slow the motion down: so fast level quasistatic misses {misses}."


def _at_platform(gain: Array, moves: Array) -> Array:
    """Largest platform motion that moves of the motors (nt, nm) make, shape (k,)."""
    return np.asarray(np.max(np.abs(np.einsum("tkm,tm->tk", gain, moves)), axis=0))


# Internal dynamics: the vibration that is left when motors keep the platform where it is.
#
# Its poles are the transmission zeros from motor torques to the platform. Those in the right half
# plane (not minimum phase) ask for motor motion ahead of the platform's.
#
# Source: Devasia, Chen, Paden (1996); Isidori (1995), Nonlinear Control Systems.

_FORGOTTEN = 1e-7  # share of a pre-actuation that is cut off
_GROWS = 1e-3  # of its rate: what grows slower is round-off, or gone with a little damping
_MASSLESS = 1e-9  # a rate so far above the fastest one of the stiffness is that of no mass
_PERIODS = 1.0  # of the slowest vibration, after and before a motion
_POSES = 51  # along a motion: near enough for its branch to be kept


@dataclass(frozen=True)
class Poles:
    """Poles of the internal dynamics at rest [1/s], complex, slowest first.

    Attributes:
        first, last: Where a motion begins, and where it ends.
    """

    first: Array
    last: Array

    @property
    def ahead(self) -> float:
        """How long motors move before the motion begins [s], but for `_FORGOTTEN`."""
        return _lasting(self.first)

    @property
    def rests(self) -> tuple[float, float]:
        """Rest ahead of a motion and after it [s]: so long, and a period of the slowest."""
        slowest = [float(np.abs(x[0])) for x in (self.first, self.last) if len(x)]
        period = _PERIODS * 2.0 * np.pi / min(slowest) if slowest else 0.0
        return max(period, self.ahead), max(period, _lasting(-self.last))

    def swing_from(self, before: float) -> float:
        """Rate [rad/s] of the fastest swing that grows so slowly that it is not held by a rest of
        `before` [s]: it grows on with all that drives it. 0 for none.
        """
        growth = self.first.real
        some = (growth > _GROWS * np.abs(self.first)) & (growth * before < -np.log(_FORGOTTEN))
        return float(np.max(np.abs(self.first[some]), initial=0.0))

    def cut_off(self, before: float) -> float:
        """Share of what motors do ahead of a motion that a rest of `before` [s] has no room for."""
        fast = _fast(self.first)
        return float(np.exp(-before * fast.min())) if len(fast) else 0.0


def internal_poles(
    mechanism: Mechanism, motion: Motion, coordinates: tuple[str, ...] = ()
) -> Poles:
    """Poles of the internal dynamics at rest where a motion begins and where it ends."""
    path = target(mechanism, motion, np.linspace(0.0, motion.duration, _POSES), 0.0, coordinates)
    return Poles(*_of(mechanism, path.at([0, -1])))


def zeros(mechanism: Mechanism, coordinates: tuple[str, ...] | None = None) -> Array:
    """Poles of the internal dynamics at home, at rest [1/s], complex, slowest first."""
    still = hold(duration=1.0)
    return _of(mechanism, target(mechanism, still, np.linspace(0.0, 1.0, 3), 0.0, coordinates))[0]


def _of(mechanism: Mechanism, poses: Target) -> tuple[Array, ...]:
    """Poles at each pose of a path, at rest."""
    instant = Instant(mechanism, poses, rubs=False)
    guess, v, a = rigid_guess(instant)
    rest = balanced(instant, guess, 0.0 * v, 0.0 * a)
    return tuple(_at(instant, k, rest) for k in range(len(poses.t)))


def _at(instant: Instant, k: int, rest: Balanced) -> Array:
    still = np.zeros(instant.system.nv)
    found = instant.tangents(k, rest.y[k], still, still, rest.lam[k])
    # y = N z on the closures and the platform's rows; L keeps what no multiplier reaches.
    N, L = null_space(found.J), null_space(found.lam.T)
    M, C, K = (L.T @ x @ N for x in (found.M, found.C, found.K))
    n, none = len(M), np.zeros_like(M)
    A = np.block([[none, np.eye(n)], [-K, -C]])
    E = np.block([[np.eye(n), none], [none, M]])
    real, imaginary, beta, *_, info = lapack().dggev(A, E, compute_vl=0, compute_vr=0)
    if info:
        raise np.linalg.LinAlgError(f"dggev: info {info}")
    alpha = real + 1j * imaginary
    finite = np.abs(beta) > _MASSLESS * np.abs(alpha) / max(float(np.max(np.abs(A))), 1e-300) ** 0.5
    poles = alpha[finite] / beta[finite]
    return np.asarray(poles[np.argsort(np.abs(poles))])


def _fast(poles: Array) -> Array:
    """Rates [1/s] of what grows fast; what swings, growing or fading slowly, asks for no rest."""
    growing = poles.real
    return np.asarray(growing[growing > 0.1 * np.abs(poles)])


def _lasting(poles: Array) -> float:
    """How long what grows fast takes from `_FORGOTTEN` to one [s]."""
    fast = _fast(poles)
    return -float(np.log(_FORGOTTEN)) / float(fast.min()) if len(fast) else 0.0
