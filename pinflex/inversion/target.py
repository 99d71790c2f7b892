"""The path that the platform has to follow, on a uniform grid with rest before and after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pinflex.actuation.drive import Nominal, nominal
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array, IntArray, spans
from pinflex.description.motions.laws import PLATFORM_COORDINATES
from pinflex.description.motions.motion import Motion
from pinflex.description.robots.urdf import Limits, limits
from pinflex.errors import ConvergenceError, DescriptionError, MotionError, PinflexError
from pinflex.mechanics.assembly import independent_rows
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import PlatformCoordinates
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.drives import share_of_limit

if TYPE_CHECKING:
    from pinflex.inversion.command import Command


@dataclass(frozen=True)
class Target:
    """What the platform shall do.

    Attributes:
        t: Uniform times [s], shape (nt,). before: Rest before the motion begins [s].
        names: Platform coordinates that are imposed.
        position: Their values [m | rad], shape (nt, k).
        motors: Motor positions of the rigid mechanism on the path [m | rad], shape (nt, nm).
        gain: Platform coordinates by motor positions of the rigid mechanism, shape (nt, k, nm).
        idle: Motions of the motors that do not move the platform, shape (nt, nm - k, nm).
        path: The rigid mechanism's motion.
    """

    t: Array
    before: float
    names: tuple[str, ...]
    position: Array
    motors: Array
    gain: Array
    idle: Array
    path: Nominal

    def at(self, some: list[int]) -> Target:
        """Some of the instants."""
        keys = ("t", "position", "motors", "gain", "idle")
        cut = {key: getattr(self, key)[some] for key in keys}
        return replace(self, **cut, path=self.path.at(some))


def delayed(motion: Motion, before: float) -> Motion:
    """The motion with a rest of `before` [s] ahead of it."""
    law = motion.law

    def later(t: Array) -> tuple[Array, Array, Array]:
        p, v, a = law(np.maximum(t - before, 0.0))
        moving = (t >= before)[:, None]
        return p, np.where(moving, v, 0.0), np.where(moving, a, 0.0)

    corners = (before, *(before + t for t in motion.switches))
    return replace(motion, law=later, duration=motion.duration + before, spec={}, corners=corners)


def target(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    before: float,
    names: Sequence[str] | None = None,
) -> Target:
    """The platform's path of a motion of the platform, or of joints of the rigid mechanism.

    Raises:
        DescriptionError: No platform, or more coordinates than motors.
        MotionError: The rigid mechanism cannot follow the path.
    """
    frame = mechanism.description.platform
    if frame is None:
        raise DescriptionError(
            f"{mechanism.name}: a command needs the frame that shall follow the path. Write "
            "`platform: FRAME`."
        )
    path = nominal(mechanism, delayed(motion, before), t)
    dynamics, axes = Equations(mechanism.rigid), motor_axes(mechanism)
    every = PlatformCoordinates(
        dynamics, mechanism.rigid.expansion.frames[frame], PLATFORM_COORDINATES
    )
    at = dynamics.kinematics(path.q)
    position, J = every.at(at)
    position[:, 3:] = np.unwrap(position[:, 3:], axis=0)
    closed = dynamics.close(path.q).J
    gain = np.array([_by_motors(mechanism, *pair) for pair in zip(closed, J, strict=True)])
    nm = len(axes.v_at)
    chosen = tuple(names or (motion.names if motion.target == "platform" else ()))
    chosen = chosen or _independent(position, gain[0], nm)
    if len(chosen) > nm:
        raise DescriptionError(
            f"{mechanism.name}: {len(chosen)} platform coordinates ({', '.join(chosen)}) for {nm} "
            f"motors. Name at most {nm} of them in `coordinates`."
        )
    columns = [PLATFORM_COORDINATES.index(name) for name in chosen]
    gain = gain[:, columns]
    idle = np.array([np.linalg.svd(G)[2][len(chosen) :] for G in gain]).reshape(len(t), -1, nm)
    motors = axes.read(path.q)
    if len(axes.paired):
        motors = np.unwrap(motors, axis=0)
    if np.linalg.matrix_rank(gain[0]) < len(chosen):
        raise MotionError(
            f"{mechanism.name}: the motors cannot move {', '.join(chosen)} independently at the "
            "start. Name other platform coordinates."
        )
    return Target(t, before, chosen, position[:, columns], motors, gain, idle, path)


def _independent(position: Array, gain: Array, count: int) -> tuple[str, ...]:
    """Platform coordinates that motors move independently, at most `count` of them.

    Rotations are weighed by the size of the path `position` (nt, 6), in m; `gain` is (6, nm).
    Where the platform turns on the spot alone they need no weight.
    """
    size = np.linalg.norm(position[:, :3] - position[0, :3], axis=1).max() or 1.0
    unit = np.array([1.0, 1.0, 1.0, size, size, size])[:, None]
    kept, _ = independent_rows(gain * unit, PLATFORM_COORDINATES)
    return tuple(PLATFORM_COORDINATES[k] for k in kept[:count])


def _by_motors(mechanism: Mechanism, closed: Array, J: Array) -> Array:
    """Platform coordinates by motor positions, shape (6, nm): the passive joints follow."""
    motors, passive = mechanism.rigid.motors, mechanism.rigid.free
    if not len(closed):
        return np.asarray(J[:, motors])
    follow = -np.linalg.lstsq(closed[:, passive], closed[:, motors], rcond=1e-12)[0]
    return np.asarray(J[:, motors] + J[:, passive] @ follow)


# What a command asks of motors, against what they can do: URDF limits and limit curves.

_SLOWER = 5  # commands of slower motions that are tried, the most
_ROOM = 1.002  # times as slow as the last one asks for: limits are met from below


def require_within_limits(
    mechanism: Mechanism, found: Command, duration: float, slower: Callable[[float], Command]
) -> None:
    """Refuse what is beyond the URDF's torques and speeds, or beyond the limit curve of a drive.

    `slower`: the command of the motion, so many times as long as `duration` [s].
    """
    share, power, joint, words = _largest_use(mechanism, found)
    times, kept = 1.0, ""
    for _ in range(_SLOWER if share > 1.0 else 0):
        times *= _ROOM * min(share**power, 3.0)
        try:
            share, power, *_ = _largest_use(mechanism, slower(times))
        except PinflexError:
            break  # none that can be had
        if share <= 1.0:
            kept = f" to {times * duration:.4g} s, which keeps its limits"
            break
    if times > 1.0:
        raise MotionError(
            f"{mechanism.name}: command: {joint} {words}. Slow the motion down{kept}, or lift the "
            "check (limited=False, --beyond-limits).",
            joint=joint,
        )


def _largest_use(mechanism: Mechanism, found: Command) -> tuple[float, float, str, str]:
    """Share of a limit, the power of it by which to slow down, the joint, in words."""
    uses = [(0.0, 1.0, "", "")]
    known = limits(mechanism.description.urdf_text)
    for k, name in enumerate(mechanism.description.actuated):
        limit, speed = known.get(name, Limits()), "m/s" if found.units[k] == "N" else "rad/s"
        for values, most, unit, what, power in (
            (found.torque[:, k], limit.effort, found.units[k], "effort", 0.5),
            (found.velocity[:, k], limit.velocity, speed, "velocity", 1.0),
        ):
            at = int(np.argmax(np.abs(values)))
            size = abs(float(values[at]))
            words = (
                f"needs {size:.4g} {unit} at t = {found.t[at]:.4g} s, the URDF's {what} limit is "
                f"{most:g}"
            )
            if most > 0.0:
                uses.append((size / most, power, name, words))
    for name, side in found.drives.items():
        curve = np.array(found.limit_curves[name])
        if len(curve):
            used = share_of_limit(curve, side["motor_speed"], side["motor_torque"])
            fastest = float(np.max(np.abs(side["motor_speed"])))
            much = f"{100 * used:.0f} % of its motor's" if np.isfinite(used) else "more than its"
            words = f"needs {much} limit_curve; its motor turns at up to {fastest:.4g} rad/s"
            uses.append((used, 1.0, name, words))
    return max(uses, key=lambda use: use[0])


# The equations of one instant of a flexible mechanism whose platform follows a path.
#
#     r(y, v, a, lam) = 0 in the rows that no motor drives,   c(y) = 0,   p(y) = p_d(t)
#
# With as many platform coordinates p as motors this is a square system for (y, lam) where v and a
# are given; the motor torques are r in the motor rows, afterwards. With more motors than
# coordinates the motions of the motors that do not move the platform stay on the rigid motion.
#
# Source: Seifried (2014), Dynamics of Underactuated Multibody Systems, ch. 4 (servo constraints).

_BALANCED = 1e-11  # m or rad: the last Newton correction; the next is round-off
_SLOW = 0.1  # contraction above which a new tangent pays
_LONGEST = 0.3  # m or rad of one Newton step
_ROUND_OFF = 1e-8  # m or rad: corrections that no longer shrink below this are round-off
_MOST, _FEW = 40, 8  # iterations of one instant, of several
_TOGETHER = 16  # instants

Instants = slice | IntArray  # numbers of the grid


@dataclass(frozen=True)
class Tangents:
    """Derivatives of one instant's rows.

    Attributes:
        M, C, K: Of r in the rows that no motor drives, by a, v, y, each (free, nv).
        J: Of the closures, the imposed coordinates and what is held, shape (nv + rows - free, nv).
        lam: Of r by the multipliers, shape (free, rows).
    """

    M: Array
    C: Array
    K: Array
    J: Array
    lam: Array


class Instant:
    """Evaluates the rows of an instant and their derivatives."""

    def __init__(self, mechanism: Mechanism, target: Target, rubs: bool = True) -> None:
        """`rubs`: with dry friction, which at rest would hold every joint."""
        self.mechanism = mechanism
        self.system = system = mechanism.flexible if rubs else mechanism.flexible.sliding
        self.dynamics = Equations(system)
        self.target = target
        self.axes = motor_axes(mechanism)
        self.free = system.free
        self.rows = system.closed.n
        platform = mechanism.frame(str(mechanism.description.platform))
        self.platform = PlatformCoordinates(self.dynamics, platform, target.names)

    def residuals(
        self, at: Instants, y: Array, v: Array, a: Array, lam: Array
    ) -> tuple[Array, Array]:
        """Rows that have to vanish, shape (n, nv + rows), and motor torques (n, nm)."""
        d, target = self.dynamics, self.target
        r, c = d.residual(y, v, a, lam, target.t[at])
        here = self.platform.of(d, y)
        error = self.platform.error(here, target.position[at])
        idle = -target.idle[at] @ self.axes.behind(target.motors[at], y)[:, :, None]
        held = np.zeros((len(y), len(self.system.held)))  # never moved: nothing is ever open there
        rows = np.concatenate([r[:, self.free], c, error, idle[:, :, 0], held], axis=1)
        return rows, r[:, self.system.motors]

    def changing(self, *rates: Array) -> IntArray:
        """Instants at which the path, given rates (nt, nv) or the loads are not as just before."""
        target = self.target
        parts = (target.position, target.motors, *rates)
        new = np.any([np.any(x[1:] != x[:-1], axis=1) for x in parts], axis=0)
        if any(force.timed for force, _ in self.system.loads.forces):
            new[:] = True
        return np.flatnonzero(np.append(True, new))

    def tangents(self, k: int, y: Array, v: Array, a: Array, lam: Array) -> Tangents:
        """Derivatives of the rows at instant k."""
        return next(self.every_tangent([k], y[None], v[None], a[None], lam[None]))

    def every_tangent(
        self, at: Sequence[int], y: Array, v: Array, a: Array, lam: Array
    ) -> Iterator[Tangents]:
        """Derivatives of the rows of some instants, one after the other."""
        target, nv = self.target, self.system.nv
        held = np.eye(nv)[self.system.held]
        states = zip(y, v, a, lam, target.t[at].tolist(), strict=True)
        for k, state, placed in zip(at, states, self._placed(y), strict=True):
            *parts, J = self.dynamics.tangent(*state)
            M, C, K = (x[self.free] for x in parts)
            idle = np.zeros((len(target.idle[k]), nv))
            idle[:, self.axes.v_at] = target.idle[k]
            yield Tangents(M, C, K, np.concatenate([J, placed, idle, held]), -J[:, self.free].T)

    def _placed(self, y: Array) -> Array:
        """Jacobians of the imposed platform coordinates, shape (n, k, nv)."""
        d, joint = self.dynamics, self.platform.joint
        parts = (d.kinematics(y[s], joint) for s in spans(len(y)))
        return np.concatenate([self.platform.at(part)[1] for part in parts])


@dataclass(frozen=True)
class Balanced:
    """Balanced poses along the path: y (nt, nq), lam (nt, rows), torque (nt, nm)."""

    y: Array
    lam: Array
    torque: Array


def balanced(instant: Instant, guess: Balanced, v: Array, a: Array) -> Balanced:
    """Solve the square system at every instant with given v and a, each (nt, nv).

    Some instants at a time by one tangent; where that does not contract, half as many. Those of a
    rest are one.

    Raises:
        ConvergenceError: No pose found at an instant: the platform cannot be there.
    """
    return _Balance(instant, guess, v, a).solve()


class _Balance:
    """Newton's iteration over spans of instants; what is found stands in y, lam and torque."""

    def __init__(self, instant: Instant, guess: Balanced, v: Array, a: Array) -> None:
        self.instant, self.guess, self.v, self.a = instant, guess, v, a
        self._manifold = Manifold(instant.dynamics)
        self.y, self.lam, self.torque = (np.array(x) for x in (guess.y, guess.lam, guess.torque))
        self._inverse: Array | None = None
        self._lacked = np.zeros(instant.system.nv + instant.rows)  # by the guess, at the last one
        self._own = instant.changing(v, a)

    def solve(self) -> Balanced:
        """All instants."""
        n = len(self._own)
        todo = [(k, min(k + _TOGETHER, n)) for k in range(0, n, _TOGETHER)]
        while todo:
            first, last = todo.pop(0)
            if self._settles(self._own[first:last]):
                continue
            if last - first == 1:
                t = float(self.instant.target.t[self._own[first]])
                raise ConvergenceError(
                    f"t = {t:.6g} s: no balanced pose with the platform on its path. Slow the "
                    "motion down, or stiffen the links.",
                    time=t,
                )
            middle = (first + last) // 2
            todo[:0] = [(first, middle), (middle, last)]
        kept = np.searchsorted(self._own, np.arange(len(self.y)), side="right") - 1
        return Balanced(*(x[self._own[kept]] for x in (self.y, self.lam, self.torque)))

    def _settles(self, at: IntArray) -> bool:
        """Whether a span of instants is balanced; then it is kept."""
        guess, n = self.guess, self.instant.system.nv
        y = self._manifold.retract(guess.y[at], np.tile(self._lacked[:n], (len(at), 1)))
        lam = guess.lam[at] + self._lacked[n:]
        v, a, last, rate, middle = self.v[at], self.a[at], np.inf, 0.0, len(y) // 2
        e, torque = self.instant.residuals(at, y, v, a, lam)
        for _ in range(_MOST if len(y) == 1 else _FEW):
            if self._inverse is None:
                k = int(at[middle])
                found = self.instant.tangents(k, y[middle], v[middle], a[middle], lam[middle])
                none = np.zeros((len(found.J), found.lam.shape[1]))
                square = np.block([[found.K, found.lam], [found.J, none]])
                # a product each is cheaper than solving
                self._inverse = np.asarray(np.linalg.inv(square), float)
            step = -(e @ self._inverse.T)
            size = float(np.max(np.abs(step[:, :n])))
            if not size < 1e3:  # not a number either
                break
            step *= min(1.0, _LONGEST / max(size, 1e-300))
            y, lam = self._manifold.retract(y, step[:, :n]), lam + step[:, n:]
            e, torque = self.instant.residuals(at, y, v, a, lam)
            rate = size / last
            left = size * rate if 0.0 < rate < _SLOW else size  # what the next correction would be
            if left < _BALANCED or (len(y) == 1 and left < _ROUND_OFF and rate > 0.5):
                self._keep(at, y, lam, torque)
                return True
            if rate > _SLOW:
                self._inverse = None
            last = size
        self._inverse = None
        return False

    def _keep(self, at: IntArray, y: Array, lam: Array, torque: Array) -> None:
        self.y[at], self.lam[at], self.torque[at] = y, lam, torque
        n, last = self.instant.system.nv, at[-1]
        self._lacked[:n] = self.instant.dynamics.difference(self.guess.y[last], y[-1])
        self._lacked[n:] = lam[-1] - self.guess.lam[last]
