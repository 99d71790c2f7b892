"""What a motion may ask: along its path, of the motors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from pinflex.actuation.drive import nominal
from pinflex.arrays import Array, BoolArray
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.motion import Motion
from pinflex.description.robots.urdf import Limits as UrdfLimits
from pinflex.description.robots.urdf import limits as urdf_limits
from pinflex.errors import ConvergenceError, DescriptionError, Ending, nearest
from pinflex.levels.rigid import multipliers
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.quickest.curves import Curve, curves_of, reduced
from pinflex.results.result import Result

KEYS = ("speed", "acceleration", "jerk", "torque", "motor_speed", "stress", "path")
_OF_PATH = KEYS[:3]
_TOLERANCES = 1e-5, 1e-4, 1e-3  # the last leaves a torque limit right to a thousandth


@dataclass(frozen=True)
class Limits:
    """Limits of a motion with one profile; infinite where there is none.

    Attributes:
        speed, acceleration, jerk: Along the path, where it is 1 long [1/s, 1/s^2, 1/s^3]; nan: a
            jerk that follows from the others.
        torque: Of each motor [N m | N], shape (nm,).
        motor_speed: Of each motor [rad/s | m/s], shape (nm,).
        stress: Of von Mises in each flexible link [Pa], shape (links,).
        path: Of the platform's distance from its path, where it would rest along the way [m].
        curves: Limit curves of motors, whose last speeds are in motor_speed too.
    """

    speed: float
    acceleration: float
    jerk: float
    torque: Array
    motor_speed: Array
    stress: Array
    path: float = np.inf
    curves: tuple[Curve, ...] = ()

    def push(self, torque: Array, speed: Array, acceleration: Array) -> Array:
        """Largest share of a torque limit or curve, of all motors (k, nm) each; shape (k,)."""
        shares = [np.max(np.abs(torque) / self.torque, axis=1)]
        shares += [curve.used(torque, speed, acceleration) for curve in self.curves]
        return np.asarray(np.max(shares, axis=0))

    @property
    def strains(self) -> bool:
        """Whether links or the path limit it."""
        return bool(np.any(np.isfinite(self.stress)) or np.isfinite(self.path))

    @property
    def jumps(self) -> bool:
        """Whether acceleration may jump."""
        return self.jerk == np.inf


def limits_of(
    mechanism: Mechanism, target: str, moves: Mapping[str, float], given: Mapping[str, Any] | None
) -> Limits:
    """Those that are given, over those of the URDF.

    Raises:
        DescriptionError: A limit or a name that there is not, or a number that is none.
    """
    asked = dict(given or {})
    for key in asked:
        if key not in KEYS:
            raise DescriptionError(f"fastest: limits.{key}: no such limit.{nearest(key, KEYS)}")
    known = urdf_limits(mechanism.description.urdf_text)
    urdf = [known.get(name, UrdfLimits()) for name in mechanism.motors]
    torque = np.array([x.effort or np.inf for x in urdf])
    speed = np.array([x.velocity or np.inf for x in urdf])
    curves = curves_of(mechanism)
    top = np.full(len(speed), np.inf)
    for curve in curves:
        top[curve.motor] = curve.speed[-1]
    if target == "joints" and "speed" in asked:
        asked.setdefault("motor_speed", asked["speed"])
    path = {key: _along(key, asked.get(key), moves) for key in _OF_PATH}
    if asked.get("jerk") is None:
        path["jerk"] = np.nan
    return Limits(
        **path,
        torque=_each("torque", asked.get("torque"), mechanism.motors, torque),
        motor_speed=np.minimum(
            top, _each("motor_speed", asked.get("motor_speed"), mechanism.motors, speed)
        ),
        stress=_stress(mechanism, asked.get("stress")),
        path=np.inf if asked.get("path") is None else _number("path", asked["path"]),
        curves=curves,
    )


def of_motion(mechanism: Mechanism, motion: Motion) -> dict[str, Any]:
    """The limits that a motion just keeps: speed, six times its jerk, torque of the coupled run.

    One number for all motors and one for all coordinates, as of equal motors.
    """
    t = np.linspace(0.0, motion.duration, 4001)
    _, v, a = motion.evaluate(t)
    run = closest(mechanism, motion, until=motion.duration, samples=1601)
    far = int(np.argmax(np.abs(v).max(axis=0)))
    return {
        "speed": float(np.abs(v[:, far]).max()),
        "jerk": 6.0 * float(np.abs(np.gradient(a[:, far], t)).max()),
        "torque": float(np.abs(run.torque).max()),
    }


def closest(mechanism: Mechanism, motion: Motion, **options: Any) -> Result:
    """A coupled run by the least tolerance that round-off leaves, of 1e-5, 1e-4 and 1e-3."""
    from pinflex.advice.solve import solve

    for tol in _TOLERANCES[:-1]:
        try:
            return solve(mechanism, motion, level="coupled", tol=tol, **options)
        except ConvergenceError as failed:
            if failed.ending is not Ending.ROUND_OFF:
                raise
    return solve(mechanism, motion, level="coupled", tol=_TOLERANCES[-1], **options)


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0.0:
        raise DescriptionError(f"fastest: limits.{key}: {value!r}. Give a number above 0, in SI.")
    return float(value)


def _along(key: str, value: Any, moves: Mapping[str, float]) -> float:
    """A limit of every coordinate as one along the path."""
    if value is None:
        return np.inf
    by_name = value if isinstance(value, Mapping) else dict.fromkeys(moves, value)
    for name in by_name:
        if name not in moves:
            raise DescriptionError(f"fastest: limits.{key}.{name}: it does not move."
                                   f"{nearest(name, moves)}")  # fmt: skip
    every = [
        _number(f"{key}.{name}", one) / abs(moves[name])
        for name, one in by_name.items()
        if moves[name]
    ]
    return min(every, default=np.inf)


def _stress(mechanism: Mechanism, value: Any) -> Array:
    links = tuple(mechanism.parts)
    if value is not None and not links:
        raise DescriptionError(
            f"{mechanism.name}: fastest: limits.stress: no link is flexible. Leave it out, or "
            "describe one under `flexible`."
        )
    return _each("stress", value, links, np.full(len(links), np.inf), "flexible link")


def _each(
    key: str, value: Any, motors: tuple[str, ...], known: Array, kind: str = "motor"
) -> Array:
    """A limit of every motor, over those of the URDF; or of every link."""
    if value is None:
        return known
    by_name = value if isinstance(value, Mapping) else dict.fromkeys(motors, value)
    for name in by_name:
        if name not in motors:
            raise DescriptionError(f"fastest: limits.{key}.{name}: not a {kind}."
                                   f"{nearest(name, motors)}")  # fmt: skip
    mine = {name: _number(f"{key}.{name}", one) for name, one in by_name.items()}
    return np.array([mine.get(name, x) for name, x in zip(motors, known, strict=True)])


def with_jerk(limits: Limits, jerk: float) -> Limits:
    """The same with a jerk where none was given."""
    return replace(limits, jerk=jerk) if np.isnan(limits.jerk) else limits


# A profile along a path, s(u) from 0 to 1 over u = t/T, as a few numbers that it is linear in.
#
# Jerk is constant in each of n intervals; where jerk has no limit, acceleration may jump at
# their ends too. The numbers x are jerks d^3s/du^3, shape (n,), then jumps of d^2s/du^2, (n + 1,).


def even(n: int) -> Array:
    """Ends of n equal intervals of u, shape (n + 1,)."""
    return np.asarray(np.arange(n + 1) / n)


def basis(ends: Array, jumps: bool, u: Array) -> Array:
    """s, ds/du and d^2s/du^2 of each number at u, shape (3, len(u), numbers).

    Beyond u = 1 each goes on with its last acceleration: those of a profile that ends cancel.
    """
    since, long = u[:, None] - ends[:-1], np.diff(ends)
    first, then = np.clip(since, 0.0, long), np.maximum(since - long, 0.0)
    a, v = first, 0.5 * first**2 + first * then
    s = first**3 / 6.0 + 0.5 * first**2 * then + 0.5 * first * then**2
    if not jumps:
        return np.stack([s, v, a])
    late = np.maximum(u[:, None] - ends, 0.0)
    on = (u[:, None] >= ends).astype(float)
    return np.stack([np.hstack(x) for x in ((s, 0.5 * late**2), (v, late), (a, on))])


@dataclass(frozen=True)
class Profile:
    """One profile.

    Attributes:
        ends: Of its intervals, shape (n + 1,). x: Its numbers, shape (n,) or (2 n + 1,).
        duration: Of the motion [s].
    """

    ends: Array = field(repr=False)
    x: Array = field(repr=False)
    duration: float

    @property
    def n(self) -> int:
        """Intervals."""
        return len(self.ends) - 1

    @property
    def jumps(self) -> bool:
        """Whether acceleration may jump."""
        return len(self.x) > self.n

    @property
    def nodes(self) -> Array:
        """Times at which jerk or acceleration jumps [s], shape (n + 1,)."""
        return np.asarray(self.duration * self.ends)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration along the path at times t [s], (nt,) each."""
        s, v, a = basis(self.ends, self.jumps, np.clip(t / self.duration, 0.0, 1.0)) @ self.x
        rest = t >= self.duration
        s, v, a = np.where(rest, 1.0, s), np.where(rest, 0.0, v), np.where(rest, 0.0, a)
        return s, v / self.duration, a / self.duration**2

    def split(self, some: BoolArray, parts: int) -> Profile:
        """The same profile with some of its intervals in equal parts."""
        n, k = self.n, np.where(some, parts, 1)
        inside = np.concatenate([np.arange(x) for x in k]) / np.repeat(k, k)
        ends = np.append(
            np.repeat(self.ends[:-1], k) + inside * np.repeat(np.diff(self.ends), k), 1
        )
        jumps = np.zeros(len(ends) if self.jumps else 0)
        if self.jumps:
            jumps[np.append(0, np.cumsum(k))] = self.x[n:]
        return Profile(ends, np.concatenate([np.repeat(self.x[:n], k), jumps]), self.duration)

    def motion(self, target: str, moves: Mapping[str, float]) -> Motion:
        """The motion of displacements by name along it."""
        names, far = tuple(moves), np.array([*moves.values()], float)
        law = partial(_law, self, far)
        corners = tuple(self.nodes[1:-1].tolist())
        return Motion("fastest", target, names, self.duration, law, corners=corners)


def _law(profile: Profile, far: Array, t: Array) -> Kinematics:
    s, v, a = (x[:, None] * far for x in profile.at(t))
    return s, v, a


def fitted(motion: Motion, far: Array, n: int, jumps: bool) -> Profile:
    """The profile nearest to a motion of displacements `far` from rest to rest."""
    u, parts = (np.arange(8 * n) + 0.5) / (8 * n), even(n)
    at = int(np.argmax(np.abs(far)))
    p, v, _ = (x[:, at] / far[at] for x in motion.evaluate(u * motion.duration))
    B = basis(parts, jumps, u)
    ends = basis(parts, jumps, np.array([1.0]))[:, 0]
    A, b = np.vstack([B[0], B[1], 1e4 * ends]), np.concatenate([p, v * motion.duration])
    x = np.linalg.lstsq(A, np.concatenate([b, 1e4 * np.array([1.0, 0.0, 0.0])]), rcond=None)[0]
    return Profile(parts, x, motion.duration)


# The rigid robot along its path, by the place s on it from 0 to 1.
#
#     tau = m(s) s'' + c(s) s'^2 + b(s) s' + g(s)
#
# Source: Bobrow, Dubowsky and Gibson (1985): along a path the dynamics have one coordinate.

_PLACES = 61  # between which all is interpolated; a path of a delta misses 1e-6 of its torque
_LOOKED_AT = 801  # instants of a motion
_CLOSE, _ROUND = 1e-6, 1e-6  # of a slowness; of a limit that a profile just reaches
_SPEEDS = (0.5, 1.0)  # of the typical one: what grows with its square, and with itself


class RigidPath:
    """How the rigid robot moves along a path, and what that takes."""

    def __init__(
        self, mechanism: Mechanism, target: str, moves: Mapping[str, float], typical: float
    ) -> None:
        """Displacements by name; `typical` is a speed of s [1/s]."""
        from scipy.interpolate import CubicSpline

        s = np.linspace(0.0, 1.0, _PLACES)
        far = np.array([*moves.values()], float)
        path = nominal(mechanism, Motion("straight", target, tuple(moves), 1.0,
                                         partial(_straight, far)), s)  # fmt: skip
        self.poses, self.end = path.q, path.q[-1]
        self.motors = mechanism.rigid.motors
        self._first, self._second = CubicSpline(s, path.v), CubicSpline(s, path.a)
        self.top = np.abs(path.v[:, self.motors]).max(axis=0)  # speed of motors by ds/dt
        dynamics = Equations(mechanism.rigid)
        J = dynamics.close(path.q).J

        def torque(v: float, a: float) -> Array:
            rates = path.v * v, path.a * v**2 + path.v * a
            return multipliers(mechanism, J, dynamics.open(path.q, *rates, 0.0 * s))[1]

        slow, fast = (torque(x * typical, 0.0) for x in _SPEEDS)
        m = (torque(typical, typical**2) - fast) / typical**2
        rest = torque(1e-9 * typical, 0.0)  # dry friction has the sign of the speed
        x, y = (_SPEEDS[0] * typical, _SPEEDS[1] * typical)
        c = ((fast - rest) / y - (slow - rest) / x) / (y - x)
        b = (slow - rest) / x - c * x
        self._terms = [CubicSpline(s, term) for term in (m, c, b, rest)]

    def __call__(self, s: Array) -> tuple[Array, Array, Array]:
        """dq/ds and its two derivatives by s, at s (k,), each (k, nv)."""
        s = np.clip(s, 0.0, 1.0)
        return self._first(s), self._second(s), self._second(s, 1)

    def torque(self, s: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Array]:
        """Motor torques (k, nm) at s with rates v and a, (k,) each; and derivatives by s, v, a."""
        s, v, a = np.clip(s, 0.0, 1.0), v[:, None], a[:, None]
        m, c, b, g = (term(s) for term in self._terms)
        dm, dc, db, dg = (term(s, 1) for term in self._terms)
        tau = m * a + c * v**2 + b * v + g
        return tau, dm * a + dc * v**2 + db * v + dg, 2.0 * c * v + b, m

    def torque_by(self, B: Array, x: Array, T: float) -> tuple[Array, Array]:
        """Torques (k, nm) of numbers x, and by them and the duration T, (k, nm, numbers + 1).

        B: s, ds/du and d^2s/du^2 by the numbers, (3, k, numbers).
        """
        s, v, a = B @ x
        tau, by_s, by_v, by_a = (x[:, :, None] for x in self.torque(s, v / T, a / T**2))
        by = by_s * B[0][:, None] + by_v * B[1][:, None] / T + by_a * B[2][:, None] / T**2
        slower = -(by_v[..., 0] * v[:, None] / T + 2.0 * by_a[..., 0] * a[:, None] / T**2) / T
        return tau[..., 0], np.concatenate([by, slower[:, :, None]], axis=2)

    def turning(self, B: Array, x: Array, T: float) -> tuple[Array, Array, Array]:
        """Speeds and accelerations of the motors (k, nm), speeds by numbers and duration."""
        s, v, a = (y[:, None] for y in B @ x)
        first, second, _ = (y[:, self.motors] for y in self(s[:, 0]))
        by = (first[:, :, None] * B[1][:, None] + (second * v)[:, :, None] * B[0][:, None]) / T
        speed = first * v / T
        by = np.concatenate([by, -speed[:, :, None] / T], axis=2)
        return speed, (first * a + second * v**2) / T**2, by

    def motor_speed(self, s: Array) -> Array:
        """Of the motors by ds/dt, shape (k, nm)."""
        return np.asarray(self._first(np.clip(s, 0.0, 1.0))[:, self.motors])


def slowness(
    rigid: RigidPath, limits: Limits, moves: Mapping[str, float], make: Callable[[float], Motion],
    room: float = 1.0,
) -> float:  # fmt: skip
    """The least number with which `make` gives a motion within limits, were the robot rigid.

    Of its jerk nothing is asked. `room`: share of the torques that it may take.

    Raises:
        DescriptionError: There is none, or any will do.
    """
    at, far = max(enumerate(moves.values()), key=lambda move: abs(move[1]))

    def used(slower: float) -> float:
        motion = make(slower)
        t = np.linspace(0.0, motion.duration, _LOOKED_AT)
        s, v, a = (x[:, at] / far for x in motion.evaluate(t))
        tau, first, second = rigid.torque(s, v, a)[0], *rigid(s)[:2]
        faster = first * a[:, None] + second * v[:, None] ** 2
        turn, fast = (first * v[:, None])[:, rigid.motors], faster[:, rigid.motors]
        own = replace(limits, torque=room * limits.torque, curves=reduced(limits.curves, room))
        shares = own.push(tau, turn, fast), turn / limits.motor_speed
        along = v / limits.speed, a / limits.acceleration
        return max(float(np.max(np.abs(x))) for x in (*shares, *along))

    low = high = 1e3
    lasts = used(high) < 1.0
    while lasts and low > 1e-3 and used(low) <= 1.0 + _ROUND:  # from slow ones, which samples show
        low, high = 0.5 * low, low
    if lasts and low <= 1e-3 and make(low).duration == make(high).duration:
        return low  # the profile's own jerk and speed let it be no faster
    if not lasts or low <= 1e-3:
        raise DescriptionError(
            "fastest: limits: they hold no motion, or none at all is given. Give torque, speed or "
            "acceleration, more than rest takes."
        )
    while high / low > 1.0 + _CLOSE:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if used(middle) > 1.0 + _ROUND else (low, middle)
    return high


def _straight(far: Array, t: Array) -> Kinematics:
    return t[:, None] * far, np.tile(far, (len(t), 1)), np.zeros((len(t), len(far)))


def require_numbers(name: str, settle: float | Mapping[str, float], intervals: int) -> None:
    """Refuse a band, a box or a number of intervals that is none."""
    box = settle if isinstance(settle, Mapping) else {"": settle}
    if isinstance(settle, Mapping) and {*settle} != {"position", "speed"}:
        raise DescriptionError(
            f"{name}: fastest: settle: {dict(settle)!r}. Give a distance, or {{position: ..., "
            "speed: ...}, both of them."
        )
    for key, most in box.items():
        if not 0.0 < most < np.inf:
            raise DescriptionError(
                f"{name}: fastest: settle{key and '.' + key}: {most!r}. Give a number above 0, in "
                "SI: no motion is exactly still."
            )
    if intervals != int(intervals) or intervals < 1:
        raise DescriptionError(
            f"{name}: fastest: intervals: {intervals!r}. Give a whole number above 0."
        )
