"""A motion: named coordinates and their rates as functions of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions import laws
from pinflex.description.motions.laws import Kinematics
from pinflex.description.reading import schema
from pinflex.description.reading.schema import shown
from pinflex.doors import door
from pinflex.errors import DescriptionError, nearest
from pinflex.report import card, grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Input shapers: a motion convolved with a few impulses so that chosen vibrations cancel.
#
# Source: Singer, Seering (1990), ZV and ZVD; Singhose, Seering, Singer (1994), EI with its fit for
# damped systems; Singhose (2009) for all three.

KINDS = ("zv", "zvd", "ei")
MODES = 3  # excited by the motion that are cancelled at most, by default
MOST = 2200  # impulses: 3^7, seven frequencies of the kinds of three
TOLERATED = 0.05  # residual vibration that EI leaves at the frequency it is made for


@dataclass(frozen=True)
class Shaper:
    """Impulses: times [s], shape (n,), the first 0; and their shares, shape (n,), of sum 1."""

    times: Array
    shares: Array

    @property
    def duration(self) -> float:
        """By how much a motion gets longer [s]."""
        return float(self.times[-1])

    def residual(self, frequency: Array | float, damping: float = 0.0) -> Array:
        """Vibration after the last impulse over that after one impulse, by frequency [Hz]."""
        omega = 2.0 * np.pi * np.atleast_1d(np.asarray(frequency, float))[:, None]
        damped = omega * np.sqrt(1.0 - damping**2)
        size = self.shares * np.exp(-damping * omega * (self.duration - self.times))
        phase = damped * self.times
        return np.asarray(np.hypot((size * np.cos(phase)).sum(1), (size * np.sin(phase)).sum(1)))


def _each(default: Any, **bounds: Any) -> Any:
    """A number, or a list of numbers."""

    def read(value: object, where: str) -> tuple[float, ...]:
        many = value if isinstance(value, list | tuple) else [value]
        return tuple(schema.number(x, where, **bounds) for x in many)

    return schema.key(default, read, form={})


@dataclass(frozen=True)
class ShaperSpec:
    """The block `shaper` of a motion.

    Attributes:
        kind: One of `KINDS`.
        frequencies: To cancel [Hz]; empty: those that the motion excites.
        damping: Damping ratio of them [-], one or one each; of modes that are looked up, theirs.
        modes: Number of modes to look up; default: up to `MODES` that shake the platform.
    """

    kind: str = schema.word(schema.REQUIRED, KINDS)
    frequencies: tuple[float, ...] = _each((), above=0.0, of="rate")
    damping: tuple[float, ...] = _each((0.0,), low=0.0, high=0.9)
    modes: int | None = schema.bare({"type": "integer", "minimum": 1, "maximum": 9}, None)


_SHAPER = schema.keys(ShaperSpec)


def shaper_form() -> schema.Form:
    """JSON Schema of the block `shaper`."""
    return {"anyOf": [{"enum": [*KINDS]}, schema.block_form(_SHAPER)]}


def read(value: object, where: str) -> ShaperSpec | None:
    """The block `shaper`: {kind, frequencies, damping} or {kind, modes}, or the kind alone."""
    if value is None:
        return None
    written = {"kind": value} if isinstance(value, str) else value
    block = schema.Block(written, where, _SHAPER)
    spec = ShaperSpec(**block.read(), modes=block.get("modes", None))
    found = len(spec.frequencies)
    _require_few(spec.kind, found)
    if found and "modes" in block:
        raise DescriptionError(f"{where}.modes: frequencies are given. Remove one of them.")
    if "damping" in block and not found:
        raise DescriptionError(
            f"{where}.damping: that of the modes is known. Remove it, or give frequencies [Hz]."
        )
    if found and len(spec.damping) not in (1, found):
        raise DescriptionError(
            f"{where}.damping: {len(spec.damping)} ratios for {found} frequencies. Give one each."
        )
    modes: object = spec.modes
    if "modes" in block and (type(modes) is not int or not 1 <= modes <= 9):
        raise DescriptionError(f"{where}.modes: {schema.shown(modes)}. Give 1 to 9.")
    if not found:
        _require_few(spec.kind, spec.modes or 0)
    return spec


def shaper(
    kind: str, frequencies: Sequence[float] | float, damping: Sequence[float] | float = 0.0
) -> Shaper:
    """The shaper that cancels vibrations at the frequencies [Hz] with a damping ratio [-]."""
    if kind not in KINDS:
        raise DescriptionError(f"shaper: {kind}.{nearest(kind, KINDS)}")
    every = np.atleast_1d(np.asarray(frequencies, float))
    if not len(every) or not np.all((every > 0.0) & np.isfinite(every)):
        raise DescriptionError(f"shaper: frequencies {every.tolist()}. Give numbers above 0 Hz.")
    ratios = np.atleast_1d(np.asarray(damping, float))
    if len(ratios) not in (1, len(every)) or not np.all((ratios >= 0.0) & (ratios < 1.0)):
        raise DescriptionError(
            f"shaper: damping {damping}. Give a ratio from 0 to below 1, or one for each frequency."
        )
    _require_few(kind, len(every))
    times, shares = np.zeros(1), np.ones(1)
    for frequency, ratio in zip(every, np.broadcast_to(ratios, every.shape), strict=True):
        t, part = _impulses(kind, float(frequency), float(ratio))
        times = np.add.outer(times, t).ravel()
        shares = np.multiply.outer(shares, part).ravel()
    order = np.argsort(times, kind="stable")
    return Shaper(times[order], shares[order])


def most_modes(kind: str) -> int:
    """Frequencies that a kind cancels at the most: impulses are two or three to their power."""
    return int(math.log(MOST, 2 if kind == "zv" else 3))


def _require_few(kind: str, frequencies: int) -> None:
    """Refuse a shaper whose impulses take over."""
    each, most = 2 if kind == "zv" else 3, most_modes(kind)
    if frequencies > most:
        raise DescriptionError(
            f"shaper: {frequencies} frequencies make {each}^{frequencies} impulses of kind {kind}. "
            f"Give at most {most}, those that shake most."
        )


def _impulses(kind: str, frequency: float, zeta: float) -> tuple[Array, Array]:
    period = 1.0 / (frequency * np.sqrt(1.0 - zeta**2))
    K = np.exp(-zeta * np.pi / np.sqrt(1.0 - zeta**2))
    if kind == "zv":
        return period * np.array([0.0, 0.5]), np.array([1.0, K]) / (1.0 + K)
    if kind == "zvd":
        return period * np.array([0.0, 0.5, 1.0]), np.array([1.0, 2.0 * K, K**2]) / (1.0 + K) ** 2
    V, z = TOLERATED, zeta
    if z == 0.0:
        return period * np.array([0.0, 0.5, 1.0]), np.array([1 + V, 2 - 2 * V, 1 + V]) / 4.0
    first = 0.24968 + 0.24961 * V + 0.80008 * z + 1.23328 * V * z
    first += 0.49599 * z**2 + 3.17316 * V * z**2
    last = 0.25149 + 0.21474 * V - 0.83249 * z + 1.41498 * V * z
    last += 0.85181 * z**2 - 4.90094 * V * z**2
    middle = 0.49990 + 0.46159 * V * z + 4.26169 * V * z**2 + 1.75601 * V * z**3
    middle += V**2 * (8.57843 * z - 108.644 * z**2 + 336.989 * z**3)
    return period * np.array([0.0, middle, 1.0]), np.array([first, 1.0 - first - last, last])


def _convolved(motion: Motion, made: Shaper, t: Array) -> Kinematics:
    total = np.zeros((3, len(t), len(motion.names)))
    for late, share in zip(made.times, made.shares, strict=True):
        total += share * np.array(motion.evaluate(t - late))
    return total[0], total[1], total[2]


@dataclass(frozen=True)
class Motion:
    """A motion of named coordinates; `Motion("own", "joints", ("crank",), 2.0, law)` takes any law.

    Args:
        kind: One of `KINDS`, or any word for a law of your own.
        target: "joints" or "platform".
        names: Joints or platform coordinates, the columns of `evaluate`; empty: all motors rest.
        duration: Time the motion is meant for [s].
        law: t >= 0, shape (nt,), to position, velocity and acceleration, each (nt, n).
        absolute: Positions are values of the coordinates; else displacements from home.
        spec: The plain mapping from which `from_spec` rebuilds the motion.
        corners: Times [s] before the end at which some rate jumps: steps end there.
    """

    kind: str
    target: str
    names: tuple[str, ...]
    duration: float
    law: Callable[[Array], Kinematics] = field(repr=False, compare=False)
    absolute: bool = False
    spec: dict[str, Any] = field(default_factory=dict, repr=False, hash=False)
    corners: tuple[float, ...] = field(default=(), repr=False)

    @property
    def switches(self) -> tuple[float, ...]:
        """Times above 0 s at which a piece of the motion ends."""
        return tuple(sorted(time for time in {*self.corners, self.duration} if time > 0.0))

    def evaluate(self, t: Array) -> Kinematics:
        """Position, velocity, acceleration at times t [s], shape (nt,); at rest before t = 0.

        Returns: (rad | m), (rad/s | m/s), (rad/s^2 | m/s^2), each of shape (nt, len(names)).
        """
        t = np.atleast_1d(np.asarray(t, dtype=np.float64))
        moving = t >= 0.0
        if moving.all():
            return self.law(t)
        p, v, a = self.law(np.maximum(t, 0.0))
        moving = moving[:, None]
        return p, np.where(moving, v, 0.0), np.where(moving, a, 0.0)

    def __call__(self, t: Array | float) -> Array:
        """Positions [rad | m] at times t [s], (nt, n) for the n `names`; (n,) for a single time."""
        p = self.evaluate(np.asarray(t, dtype=np.float64).reshape(-1))[0]
        return p if np.ndim(t) else p[0]

    def plot(
        self, until: float | None = None, panel: str | None = None, ax: Axes | None = None
    ) -> Any:
        """Draw position, velocity and acceleration over time; returns the matplotlib axes.

        Args:
            until: End [s]; default: the duration.
            panel: One alone: "position", "velocity" or "acceleration".
            ax: Where to draw that; default: axes of a new figure.
        """
        return door("viewer.plots.motions", "plot_motion")(self, until, panel, ax)

    def at_rate(self, rate: float = 1000.0, robot: Any = None) -> Any:
        """Rows for a controller and what its interpolation misses: `t`, `position`, `missed`, ...

        Args:
            rate: Rows in a second [Hz].
            robot: A mechanism, for the rows of all its motors: home is added to displacements, and
                a motion of the platform becomes that of the motors (inverse kinematics).
        """
        return door("actuation.setpoints", "setpoints")(self, rate, robot)

    def to_csv(self, path: str | Path, rate: float = 1000.0, robot: Any = None) -> Path:
        """Write t, position, velocity and acceleration at a rate [Hz], units in the header.

        Args:
            path: The file.
            rate, robot: As of `at_rate`. Without a robot displacements stay displacements.
        """
        found: Path = self.at_rate(rate, robot).to_csv(path)
        return found

    def to_joint_trajectory(
        self, path: str | Path | None = None, rate: float | None = None, robot: Any = None
    ) -> dict[str, Any]:
        """The motion as a ROS 2 JointTrajectory, plain data; also written where a path is given.

        Args:
            path: .yaml or .json.
            rate: Points in a second [Hz]; default: 1000, and the waypoints themselves of a motion
                that came in so.
            robot: As of `at_rate`; needed for displacements from home and motions of the platform.
        """
        own = self.kind == "trajectory" and rate is None and robot is None
        if own:
            points, names = self.spec["points"], self.names
            rows = {key: np.array([x[key] for x in points]) for key in points[0]}
            times = rows.pop("time_from_start")
            data = door("actuation.setpoints", "message")(names, times, rows)
        else:
            data = self.at_rate(rate or 1000.0, robot).message()
        if path is not None:
            door("actuation.setpoints", "write_message")(path, data)
        return dict(data)

    def _repr_html_(self) -> str:
        p, v, a = self.evaluate(np.linspace(0.0, self.duration, 401))
        rows = [
            [name, *(f"{np.abs(x[:, k]).max():.4g}" for x in (p, v, a))]
            for k, name in enumerate(self.names)
        ]
        heads = (self.target, "position", "velocity", "acceleration")
        return card(
            f"{self.kind} motion, {self.duration:g} s; largest, SI units", grid(heads, rows)
        )

    def shaped(
        self,
        kind: str,
        modes: Sequence[float] | float,
        damping: Sequence[float] | float = 0.0,
    ) -> Motion:
        """The motion convolved with an input shaper, so that vibrations cancel; it ends later.

        Args:
            kind: "zv", "zvd" or "ei".
            modes: Frequencies [Hz] to cancel, such as those of `pinflex.ringing`.
            damping: Damping ratios [-], one for each or one for all.
        Source: see `pinflex.description.motions.trajectory`.
        """
        made = shaper(kind, modes, damping)
        spec = dict(self.spec) | {
            "shaper": {"kind": kind, "frequencies": np.atleast_1d(modes).tolist(),
                       "damping": np.asarray(damping).tolist()}
        }  # fmt: skip
        corners = np.unique(np.add.outer([0.0, *self.switches], made.times))
        return replace(
            self, kind=f"shaped {self.kind}", duration=self.duration + made.duration,
            law=partial(_convolved, self, made), spec=spec, corners=tuple(corners.tolist()),
        )  # fmt: skip


def of_moves(
    kind: str, moves: Any, law: Any, n: dict[str, float], corners: tuple[float, ...] = ()
) -> Motion:
    """A motion of target, displacements by name and as an array, along a law with numbers n."""
    target, by_name, _ = moves
    spec = {"kind": kind} | ({target: by_name} if by_name else {}) | n
    return Motion(kind, target, tuple(by_name), n["duration"], law, False, spec, corners)


# Motions of several moves, each with a start of its own: a path with rounded corners.
#
# Every move is a polynomial of ninth degree (`nonic`), and moves add up: while two overlap the path
# turns the corner. Four rates are continuous throughout: smooth enough for `command`.

_KEYS = ("joints", "platform", "start", "duration")
_ACROSS, _LIFT = 0.2, 0.4  # of the time of one way: when the move across begins; a move up or down


@public
def moves(*, moves: Sequence[Mapping[str, Any]], duration: float | None = None) -> Motion:
    """Moves that add up, each {platform | joints: {name: displacement}, start [s], duration [s]}.

    Args:
        moves: Relative displacements [rad | m], with start (default 0) and duration.
        duration: Of all, with rest at the end [s]; None: the end of the last move.
    """
    if isinstance(moves, str | Mapping) or not isinstance(moves, Sequence) or not moves:
        raise laws.bad(
            "moves.moves",
            f"{shown(moves)} is no list of moves. Write [{{platform: {{x: 0.1}}, duration: 1}}].",
        )
    read = [_move(one, f"moves.moves[{k}]") for k, one in enumerate(moves)]
    target = read[0][0]
    for k, (other, *_) in enumerate(read):
        if other != target:
            raise laws.bad(f"moves.moves[{k}]", f"moves {other}, the first {target}. Take one.")
    names = tuple(dict.fromkeys(name for _, by_name, _, _ in read for name in by_name))
    delta = np.array([[by_name.get(name, 0.0) for name in names] for _, by_name, _, _ in read])
    start, each = (np.array([row[k] for row in read]) for k in (2, 3))
    last = float(np.max(start + each))
    n = laws.options("moves", "duration", duration=duration)
    if n.setdefault("duration", last) < last:
        raise laws.bad(
            "moves.duration", f"{n['duration']:g} s. Give {last:g} s or more: the last move's end."
        )
    spec = {"kind": "moves", **n, "moves": [
        {target: by_name, "start": s, "duration": d} for _, by_name, s, d in read
    ]}  # fmt: skip
    law = partial(_added_up, delta, start, each)
    corners = tuple(np.unique([*start, *(start + each)]).tolist())
    return Motion("moves", target, names, n["duration"], law, False, spec, corners)


@public
def adept(
    *,
    duration: float,
    width: float = 0.305,
    height: float = 0.025,
    across: str = "x",
    up: str = "z",
    held: Sequence[str] | None = None,
    back: bool = False,
) -> Motion:
    """The Adept cycle: 25 mm up, 305 mm across, 25 mm down, with rounded corners; the platform's.

    Up and down take 0.4 of the time each, across the 0.6 in the middle.

    Args:
        duration: Of one way [s].
        width, height: [m]; negative ones go the other way.
        across, up: Coordinates of the platform: x, y or z.
        held: Coordinates that stay; None: the third of x, y, z.
        back: Whether the same way back follows.
    """
    n = laws.options("adept", duration=duration)
    sizes = {"width": width, "height": height}
    size = {key: laws.number(x, f"adept.{key}", "m", "length") for key, x in sizes.items()}
    for key, name in (("across", across), ("up", up)):
        if name not in "xyz" or len(name) != 1:
            raise laws.bad(f"adept.{key}", f"{shown(name)} is no direction.{nearest(name, 'xyz')}")
    if across == up:
        raise laws.bad("adept.across", f"{across} is up too. Take two of x, y, z.")
    if not isinstance(back, bool):
        raise laws.bad("adept.back", f"{shown(back)} is not allowed. Allowed: true, false.")
    still = [c for c in "xyz" if c not in (across, up)] if held is None else held
    rest = laws.names(still, "platform", "adept.held") if len(still) else ()
    T = n["duration"]
    rows = [
        {"platform": {across: 0.0, up: size["height"]} | dict.fromkeys(rest, 0.0),
         "start": 0.0, "duration": _LIFT * T},
        {"platform": {across: size["width"]}, "start": _ACROSS * T,
         "duration": (1.0 - 2.0 * _ACROSS) * T},
        {"platform": {up: -size["height"]}, "start": (1.0 - _LIFT) * T, "duration": _LIFT * T},
    ]  # fmt: skip
    if back:
        rows += [_reversed(row, 2.0 * T) for row in reversed(rows)]
    spec = {"kind": "adept", **n, **size, "across": across, "up": up, "held": list(rest)}
    return replace(moves(moves=rows), kind="adept", spec=spec | {"back": back})


def _reversed(row: Mapping[str, Any], end: float) -> dict[str, Any]:
    """A move taken back, mirrored in time about half of `end` (s)."""
    taken = {name: -x for name, x in row["platform"].items()}
    return {"platform": taken, "start": end - row["start"] - row["duration"],
            "duration": row["duration"]}  # fmt: skip


def _move(one: Any, where: str) -> tuple[str, dict[str, float], float, float]:
    """Target, displacements, start and duration of a move."""
    if not isinstance(one, Mapping):
        raise laws.bad(where, f"{shown(one)} is no move. Write {{platform: {{x: 0.1}}, ...}}.")
    for key in one:
        if key not in _KEYS:
            raise laws.bad(f"{where}.{key}", f"no such key of a move.{nearest(str(key), _KEYS)}")
    if "duration" not in one:
        raise laws.bad(f"{where}.duration", "missing. Give the time of the move in s.")
    target, by_name, _ = laws.moves_of(one.get("joints"), one.get("platform"), where)
    n = laws.options(where, start=one.get("start", 0.0), duration=one["duration"])
    return target, by_name, n["start"], n["duration"]


def _added_up(delta: Array, start: Array, duration: Array, t: Array) -> Kinematics:
    total = np.zeros((3, len(t), delta.shape[1]))
    for one, begin, time in zip(delta, start, duration, strict=True):
        total += laws.move(laws.nonic, one, float(time), np.maximum(t - begin, 0.0))
    return total[0], total[1], total[2]
