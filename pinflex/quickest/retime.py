"""retime(): the same path, as fast as limits of speed, acceleration, jerk and effort allow.

The time of the whole motion is scaled by one factor k: speeds go with 1/k, accelerations with
1/k^2, jerks with 1/k^3, and rigid torques are a polynomial of second degree in 1/k at every
instant. A shaper convolves what comes of it with impulses of sum 1, so that no speed, acceleration
or jerk grows; where they shrink, a shorter motion is shaped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.actuation.drive import nominal
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array, IntArray, spans
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion, trajectory
from pinflex.description.motions.trajectory import ShaperSpec, read
from pinflex.description.robots.urdf import MotorLimits
from pinflex.description.trajectories.profiles import by_name
from pinflex.description.trajectories.waypoints import slowed
from pinflex.errors import DescriptionError, MotionError, nearest
from pinflex.levels.rigid import multipliers
from pinflex.levels.ringing import shaped_as
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.loads import require_staying
from pinflex.quickest.curves import Curve, curves_of
from pinflex.report import card, grid

QUANTITIES = tuple(field.name for field in fields(MotorLimits))
_CURVE = "limit_curve"  # of a drive: a limit that no number replaces
_POWER = {"velocity": 1, "acceleration": 2, "jerk": 3}
_INSTANTS, _A_PIECE = 600, 60  # at which a motion is looked at; in a short piece of it
_BESIDE = 1e-7  # of the duration: how far from a corner
_JUMP = 1e-3  # of the largest acceleration, at a corner: less is round-off
_ON_PATH = 1e-9  # [rad | m]: round-off
_KEPT = 1e-9  # of a limit: by how much a result may be beyond it
_ROUNDS = 60  # of halving a factor; 1e-12 of it is enough
_TRIES, _STRIDE = 12, 0.25  # of slowing a shaped motion down; of the logarithm of a factor
_FINE = 1e-6  # of that: where the search ends


@dataclass(frozen=True, repr=False)
class Retimed:
    """A motion under limits, and how much of each it takes.

    Attributes:
        motion: As `solve` takes it.
        factor: Its time over that of what was given, the shaper's own left out.
        held_by: What allows no shorter time, such as "effort of elbow_joint".
        shares: Largest value over limit of every motor that has one, by quantity: at most 1.
        off_path: Largest distance of a motor from the path given [rad | m]: 0 without a shaper.
    """

    motion: Motion
    factor: float
    held_by: str
    shares: Mapping[str, Mapping[str, float]]
    off_path: float = 0.0

    def __repr__(self) -> str:
        bent = f", {self.off_path:.2g} rad or m off the path" if self.off_path > _ON_PATH else ""
        return f"<Retimed {self.motion.duration:.4g} s, held by the {self.held_by}{bent}>"

    def _repr_html_(self) -> str:
        rows = [
            [quantity, name, f"{100 * share:.1f} %"]
            for quantity, by_motor in self.shares.items()
            for name, share in by_motor.items()
        ]
        title = f"{self.motion.duration:.4g} s, held by the {self.held_by}"
        return card(title, grid(("limit", "motor", "used"), rows))


@public
@takes_model
def retime(
    robot: Mechanism,
    path: Motion | str | Path | Mapping[str, Any],
    limits: Mapping[str, Any] | MotorLimits | None = None,
    *,
    shaper: str | Mapping[str, Any] | None = None,
) -> Retimed:
    """The same path in the least time under limits that one factor on its time allows.

    Faster or slower than given, all motors in step. Torques are those of the rigid mechanism; the
    `limit_curve` of a drive is kept as well.

    Args:
        robot: Mechanism whose motors move.
        path: A motion of joints or of the platform, or what `trajectory` takes: a file, a message.
        limits: velocity [rad/s | m/s], acceleration, jerk and effort [N m | N], each one number or
            {motor: number}, over those of the URDF; None for one takes it away.
        shaper: "zv", "zvd", "ei" or the block `shaper` of a YAML; the motion ends later by it, and
            leaves a bent path by `off_path`.
    Returns:
        The motion and what holds it there.
    Raises:
        DescriptionError: No limit at all, an unknown one.
        MotionError: A jump of the acceleration where the jerk is limited; a pose that motors
            cannot hold.
    """
    motion = path if isinstance(path, Motion) else trajectory(path)
    require_staying(robot.description, "retime")
    seen = _Seen(robot, motion)
    known = _limits(robot, limits, seen.curves)
    factor, held_by = _least(seen, known)
    asked = None if shaper is None else read(shaper, "retime: shaper")
    if asked is None:
        return Retimed(slowed(motion, factor), factor, held_by, seen.shares(factor, known))
    factor, made, shares = _shaped(robot, motion, asked, known, factor)
    away = _distance(seen, _Seen(robot, made))
    return Retimed(made, factor, _largest(shares), shares, away)


def _shaped(
    robot: Mechanism, motion: Motion, asked: ShaperSpec,
    known: Mapping[str, Mapping[str, float]], plain: float,
) -> tuple[float, Motion, dict[str, Any]]:  # fmt: skip
    """The least factor with which the shaped motion keeps all limits, that motion, its shares.

    Looked for from the factor of the `plain` motion on, which is too slow where impulses are far
    apart. Raises MotionError where none is found.
    """
    from scipy.optimize import brentq

    tried: dict[float, tuple[Motion, dict[str, Any]]] = {}

    @cache
    def over(log: float) -> float:
        made = shaped_as(robot, slowed(motion, np.exp(log)), asked)
        shares = _Seen(robot, made).shares(1.0, known)
        worst = max(max(by_motor.values()) for by_motor in shares.values())
        if worst <= 1.0 + _KEPT:
            tried[log] = made, shares
        return float(np.log(worst))

    slow = float(np.log(plain))
    for _ in range(_TRIES):
        if over(slow) <= 0.0:
            break
        slow += _STRIDE
    else:
        raise MotionError(
            f"{robot.name}: retime: shaped, which bends the path, it keeps its limits at no speed. "
            "Give higher ones, or another shaper."
        )
    while over(slow - _STRIDE) <= 0.0:
        slow -= _STRIDE
    brentq(over, slow - _STRIDE, slow, xtol=_FINE)
    least = min(tried)
    return float(np.exp(least)), *tried[least]


class _Seen:
    """A motion of the motors at its instants, and its rigid torques at any factor on its time."""

    def __init__(self, robot: Mechanism, motion: Motion) -> None:
        self.robot, self.motion, self.curves = robot, motion, curves_of(robot)
        self.t, self.sides = _instants(motion)
        path, axes = nominal(robot, motion, self.t), motor_axes(robot)
        self.path = path
        self.position = axes.read(path.q)
        if len(axes.paired):
            self.position = np.unwrap(self.position, axis=0)
        self.velocity, self.acceleration = path.v[:, axes.v_at], path.a[:, axes.v_at]

    def jerk(self) -> Array:
        """Largest jerk of each motor between corners [rad/s^3 | m/s^3]; refused where a jumps."""
        a, size = self.acceleration, np.abs(self.acceleration).max(axis=0)
        ends = np.abs(a[[0, -1]]).max(axis=0)
        jumps = np.abs(a[self.sides + 1] - a[self.sides]).max(axis=0, initial=0.0)
        for name, jump, most in zip(self.robot.motors, np.maximum(jumps, ends), size, strict=True):
            if jump > _JUMP * most > 0.0:
                raise MotionError(
                    f"{self.robot.name}: retime: the acceleration of {name} jumps by {jump:.3g} "
                    "(SI), which no limit of the jerk allows. Give waypoints with accelerations, "
                    "a quintic or an scurve; or take the limit away: limits={'jerk': None}."
                )
        first = np.concatenate([[0], self.sides + 1])
        last = np.concatenate([self.sides, [len(self.t) - 1]])
        pairs = zip(first, last, strict=True)
        every = [_slopes(self.t[i : j + 1], a[i : j + 1]) for i, j in pairs if j > i]
        return np.asarray(np.max(every, axis=0))

    def torque(self, factor: float) -> Array:
        """Rigid torques of the motors (nt, nm) of the motion `factor` times as long."""
        dynamics, path = Equations(self.robot.rigid), self.path
        found = np.empty(self.velocity.shape)
        for at in spans(len(self.t)):
            q, v, a = path.q[at], path.v[at] / factor, path.a[at] / factor**2
            r = dynamics.open(q, v, a, path.t[at] * factor)
            found[at] = multipliers(self.robot, dynamics.close(q).J, r)[1]
        return found

    def on_curves(self, torque: Array, factor: float) -> Array:
        """Shares of limit curves, 1 on them, of torques (nt, nm), shape (nt, curves)."""
        v, a = self.velocity / factor, self.acceleration / factor**2
        shares = [curve.used(torque, v, a) for curve in self.curves]
        return np.array(shares).reshape(-1, len(torque)).T

    def largest(self, quantity: str, factor: float) -> Array:
        """Largest value of each motor (nm,)."""
        if quantity == "effort":
            return _peaks(self.torque(factor), self.t)
        if quantity == "jerk":
            return self.jerk() / factor**3
        return _peaks(getattr(self, quantity), self.t) / factor ** _POWER[quantity]

    def shares(self, factor: float, known: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
        """Largest value over limit, by quantity and motor."""
        found: dict[str, Any] = {}
        for quantity, limit in known.items():
            if quantity == _CURVE:
                used = _peaks(self.on_curves(self.torque(factor), factor), self.t)
                found[_CURVE] = dict(zip(limit, used.tolist(), strict=True))
                continue
            values = dict(zip(self.robot.motors, self.largest(quantity, factor), strict=True))
            found[quantity] = {name: float(values[name] / most) for name, most in limit.items()}
        return found


def _instants(motion: Motion) -> tuple[Array, IntArray]:
    """Times of a motion, even between its corners, and the numbers of those just before these."""
    end = motion.duration
    gap = _BESIDE * end
    corners = np.array([0.0, *sorted(motion.switches), end])
    corners = corners[np.append(True, np.diff(np.minimum(corners, end)) > 4.0 * gap)]
    marks = np.append(corners[corners < end - 4.0 * gap], end)
    few = min(_A_PIECE, max(_INSTANTS // len(marks), 4))  # short ones: a motion that is shaped
    pieces = [
        np.linspace(a + gap, b - gap, max(few, round(_INSTANTS * (b - a) / end)))
        for a, b in pairwise(marks.tolist())
    ]
    return np.concatenate(pieces), np.cumsum([len(piece) for piece in pieces])[:-1] - 1


def _limits(robot: Mechanism, given: Any, curves: Sequence[Curve]) -> dict[str, dict[str, float]]:
    """Limits of motors by quantity: those given over those of the URDF; curves count as 1."""
    own = {name: dict(getattr(robot.limits, name)) for name in QUANTITIES}
    if isinstance(given, MotorLimits):
        given = {name: getattr(given, name) for name in QUANTITIES}
    for quantity, value in (given or {}).items():
        if quantity not in QUANTITIES:
            raise DescriptionError(
                f"retime: limits.{quantity}: no such limit.{nearest(str(quantity), QUANTITIES)}"
            )
        names = value if isinstance(value, Mapping) else robot.motors
        for name in names:
            if name not in robot.motors:
                known = nearest(str(name), robot.motors)
                raise DescriptionError(f"retime: limits.{quantity}.{name}: no motor.{known}")
        more = {} if value is None else by_name(value, names, "retime: limits", quantity)
        own[quantity] = own[quantity] | more if isinstance(value, Mapping) else more
    own[_CURVE] = {curve.name: 1.0 for curve in curves}
    found = {quantity: limit for quantity, limit in own.items() if limit}
    if not found:
        raise DescriptionError(
            f"{robot.name}: retime: no limit is known. Give limits={{'velocity': ..., "
            "'acceleration': ..., 'effort': ...}, or write them in the URDF."
        )
    return found


def _least(seen: _Seen, known: Mapping[str, Mapping[str, float]]) -> tuple[float, str]:
    """The smallest factor on the time that keeps all limits, and which of them holds it."""
    factor, held_by = 0.0, ""
    for quantity, power in _POWER.items():
        if quantity not in known:
            continue
        used = seen.shares(1.0, {quantity: known[quantity]})
        share = max(used[quantity].values())
        if share ** (1.0 / power) > factor:
            factor, held_by = share ** (1.0 / power), _largest(used)
    if not factor and max(np.abs(seen.velocity).max(axis=0), default=0.0) == 0.0:
        raise MotionError(f"{seen.robot.name}: retime: nothing moves. Give another path.")
    if known.keys() & {"effort", _CURVE}:
        slower, name = _by_torque(seen, known, factor)
        if slower > factor:
            factor, held_by = slower, name
    return factor, held_by


def _by_torque(
    seen: _Seen, known: Mapping[str, Mapping[str, float]], least: float
) -> tuple[float, str]:
    """The smallest factor from `least` on with torques in their limits, and the limit that binds.

    With s = 1/k torques are t0 + t1 s + t2 s^2: what holds, what damps, what accelerates.
    """
    limit = known.get("effort", {})
    names = [f"{of} of {name}" for of in ("effort", _CURVE) for name in known.get(of, {})]
    columns = [seen.robot.motors.index(name) for name in limit]
    most = np.array([*limit.values()])
    at = {k: seen.torque(k) for k in (1.0, 2.0, 4.0)}
    powers = np.linalg.inv(np.vander([1.0, 0.5, 0.25], 3, increasing=True))
    terms = np.einsum("ij,jtm->itm", powers, np.stack([*at.values()]))

    def used(s: float) -> Array:
        torque = terms[0] + s * (terms[1] + s * terms[2])
        curves = seen.on_curves(torque, 1.0 / s if s else np.inf)
        return _peaks(np.hstack([torque[:, columns] / most, curves]), seen.t)

    held = used(0.0)
    if held.max() > 1.0:
        of, _, name = names[int(held.argmax())].partition(" of ")
        of = of if of == _CURVE else f"{of} limit"
        raise MotionError(
            f"{seen.robot.name}: retime: {name} needs {held.max():.3g} of its {of} to hold "
            "still on this path: no speed keeps it. Give another limit, path or payload."
        )
    fast = 1.0 / least if least else 1.0
    while not least and used(fast).max() <= 1.0:
        fast *= 2.0
    if used(fast).max() <= 1.0:
        return 1.0 / fast, ""
    # The fastest of all that hold, not the first from standstill on: looked for from above.
    grid = np.linspace(fast, 0.0, 400)
    good = next(k for k, s in enumerate(grid) if used(s).max() <= 1.0)
    low, high = grid[good], grid[good - 1]
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if used(middle).max() <= 1.0 else (low, middle)
    if not low:
        raise MotionError(
            f"{seen.robot.name}: retime: no speed keeps the limits of torque. Give higher ones."
        )
    return 1.0 / float(low), names[int(used(float(low)).argmax())]


def _largest(shares: Mapping[str, Mapping[str, float]]) -> str:
    every = {f"{q} of {name}": x for q, by_motor in shares.items() for name, x in by_motor.items()}
    return max(every, key=lambda words: every[words])


def _slopes(t: Array, a: Array) -> Array:
    """Largest slope of each column (n,) of a smooth piece, up to its ends."""
    slope = np.diff(a, axis=0) / np.diff(t)[:, None]
    found = np.abs(slope).max(axis=0)
    if len(slope) < 2:
        return np.asarray(found)
    middle = 0.5 * (t[1:] + t[:-1])
    for k, other, end in ((0, 1, t[0]), (-1, -2, t[-1])):
        bend = (slope[k] - slope[other]) / (middle[k] - middle[other])
        found = np.maximum(found, np.abs(slope[k] + bend * (end - middle[k])))
    return np.asarray(found)


def _peaks(values: Array, t: Array) -> Array:
    """Largest size of each column (n,), by a parabola through the largest of equal steps."""
    sizes, columns = np.abs(values), np.arange(values.shape[1])
    k = np.clip(sizes.argmax(axis=0), 1, len(t) - 2)
    before, at, after = sizes[k - 1, columns], sizes[k, columns], sizes[k + 1, columns]
    bent = 2.0 * at - before - after
    steps = np.diff(t)
    even = np.abs(steps[k] - steps[k - 1]) < 1e-6 * steps[k]
    more = np.where(even & (bent > 0.0), (before - after) ** 2 / np.maximum(8.0 * bent, 1e-300), 0)
    return np.asarray(np.maximum(sizes.max(axis=0), at + more))


def _distance(path: _Seen, other: _Seen) -> float:
    """Largest distance of a motion from another's path, motor by motor at the nearest instant."""
    nearest_by = partial(_nearest, path.position)
    return float(max(map(nearest_by, other.position), default=0.0))


def _nearest(path: Array, point: Array) -> float:
    """Distance [rad | m] of the worst motor from the nearest point of a polyline (n, nm)."""
    a, b = path[:-1], np.diff(path, axis=0)
    length = np.maximum((b**2).sum(axis=1), 1e-300)
    share = np.clip(((point - a) * b).sum(axis=1) / length, 0.0, 1.0)[:, None]
    return float(np.abs(a + share * b - point).max(axis=1).min())
