"""A motion as a controller takes it: rows at its rate, and what its interpolation misses."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.drive import motors_along
from pinflex.actuation.path import joint_curve
from pinflex.arrays import Array
from pinflex.description.motions.laws import PLATFORM_COORDINATES
from pinflex.description.motions.motion import Motion
from pinflex.description.trajectories.profiles import hermite
from pinflex.description.trajectories.waypoints import points_of
from pinflex.errors import DescriptionError
from pinflex.mechanics.model.tree import sliding
from pinflex.report import card, grid
from pinflex.text import frozen
from pinflex.writing import write_csv, write_text

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism

MOST = 1_000_000  # rows of a table
Curve = Callable[[Array], tuple[Array, Array, Array]]  # positions and rates at times
INTERPOLATIONS = ("hold", "linear", "cubic", "quintic")
_BETWEEN = np.arange(1, 17) / 16  # of an interval: where it is looked at; its end is that of a hold
_NO_TICK = 1e-9  # of an interval: round-off of its end


@frozen
class Setpoints:
    """Rows of a motion at equal times, and how far what a controller makes of them is off.

    Attributes:
        names: Joints, or platform coordinates.
        units: Of their positions: rad, m, or "rad | m" where no robot tells.
        t: Times [s], shape (n,), from 0 on, the last at the end of the motion or just behind it.
        position, velocity, acceleration: Each (n, names) [rad | m, per s, per s^2].
        absolute: Positions; else displacements from home.
        missed: Largest distance [rad | m] from the motion between rows, shape (names,) each, by
            what the controller does there: `hold` the last row, `linear`, `cubic` by positions and
            velocities, `quintic` by accelerations too. Looked up at 16 places of every interval.
        torque: Of motors [N m | N], shape (n, names), where it is known.
        more: Further columns by heading, shape (n,) each.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    position: Array
    velocity: Array
    acceleration: Array
    absolute: bool
    missed: Mapping[str, Array] = field(default_factory=dict)
    torque: Array | None = None
    more: Mapping[str, Array] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """Rows in a second [Hz]."""
        return 1.0 / float(self.t[1] - self.t[0])

    def to_csv(self, path: str | Path) -> Path:
        """Write t, then position, velocity, acceleration and torque of each name, with units."""
        what = "position" if self.absolute else "displacement"
        columns: dict[str, Array] = {"t [s]": self.t}
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            columns[f"{name}.{what} [{unit}]"] = self.position[:, k]
            columns[f"{name}.velocity [{_per(unit, 's')}]"] = self.velocity[:, k]
            columns[f"{name}.acceleration [{_per(unit, 's^2')}]"] = self.acceleration[:, k]
            if self.torque is not None:
                columns[f"{name}.torque [{'N' if unit == 'm' else 'N m'}]"] = self.torque[:, k]
        columns |= self.more
        table = np.column_stack([*columns.values()])
        return write_csv(path, columns, ([f"{x:.12g}" for x in row] for row in table))

    def message(self) -> dict[str, Any]:
        """The rows as a ROS 2 JointTrajectory, plain data; torques as effort."""
        if set(self.names) <= {*PLATFORM_COORDINATES} or not self.absolute:
            text = "displacements from home" if not self.absolute else "the platform, not joints"
            raise DescriptionError(
                f"to_joint_trajectory: these are {text}. Give robot=pf.load(...), which tells the "
                "positions of its motors."
            )
        rows = {
            "positions": self.position,
            "velocities": self.velocity,
            "accelerations": self.acceleration,
        }
        if self.torque is not None:
            rows["effort"] = self.torque
        return message(self.names, self.t, rows)

    def text(self) -> str:
        """What each interpolation misses, a line for the console."""
        parts = []
        for word, missed in self.missed.items():
            by_unit: dict[str, float] = {}
            for unit, x in zip(self.units, missed.tolist(), strict=True):
                by_unit[unit] = max(by_unit.get(unit, 0.0), x)
            parts.append(f"{word} " + ", ".join(f"{x:.2g} {u}" for u, x in by_unit.items()))
        return (
            f"At {self.rate:g} Hz a controller is off the motion between rows by at most: "
            f"{'; '.join(parts)} (cubic: by positions and velocities; quintic: by accelerations "
            "too)."
        )

    def _repr_html_(self) -> str:
        heads = ("name", "unit", *self.missed)
        rows = [
            [name, unit, *(f"{missed[k]:.2g}" for missed in self.missed.values())]
            for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True))
        ]
        title = f"{len(self.t)} rows at {self.rate:g} Hz; off the motion between rows"
        return card(title, grid(heads, rows))


def message(names: tuple[str, ...], t: Array, rows: Mapping[str, Array]) -> dict[str, Any]:
    """A ROS 2 JointTrajectory as plain data."""
    nanoseconds = np.round(np.asarray(t) * 1e9).astype(np.int64).tolist()
    times = [{"sec": time // 10**9, "nanosec": time % 10**9} for time in nanoseconds]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": [*names], "points": points_of(times, rows)}


def write_message(path: str | Path, data: Mapping[str, Any]) -> Path:
    """Write a message as .yaml or .json."""
    path = Path(path)
    if path.suffix.lower() == ".json":
        return write_text(path, json.dumps(data) + "\n")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise DescriptionError(f"{path}: no such kind of message. Allowed: .yaml, .yml, .json.")
    import yaml

    quick = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(data, Dumper=quick, sort_keys=False, default_flow_style=None, width=10**6)
    return write_text(path, str(text))


def ticks(duration: float, rate: float) -> Array:
    """Equal times [s] from 0 to the end of a motion, or the first behind it."""
    if not (np.isfinite(rate) and rate > 0.0):
        raise DescriptionError(f"rate: {rate!r} Hz is out of range. It must be above 0.")
    last = max(int(np.ceil(duration * rate - _NO_TICK)), 1)
    if last >= MOST:
        raise DescriptionError(
            f"rate: {last + 1} rows for {duration:g} s at {rate:g} Hz. Allowed: at most {MOST}."
        )
    return np.arange(last + 1) / rate


def setpoints(motion: Motion, rate: float, robot: Mechanism | None = None) -> Setpoints:
    """Rows of a motion at a rate [Hz]; with a robot those of all its motors."""
    t = ticks(motion.duration, rate)
    names, units, absolute = motion.names, _units(motion, robot), motion.absolute
    curve: Curve = motion.evaluate
    if robot is not None:
        names, absolute = robot.description.actuated, True
        along = partial(motors_along, robot, motion)
        curve = joint_curve(robot, motion) if motion.target == "joints" else along
    return Setpoints(names, units, t, *curve(t), absolute, missed(curve, t))


def missed(curve: Curve, t: Array) -> dict[str, Array]:
    """Largest distance of each interpolation from a curve between times t, by its name."""
    rows = curve(t)
    worst = {word: np.zeros(rows[0].shape[1]) for word in INTERPOLATIONS}
    for some in np.array_split(np.arange(len(t) - 1), max(1, len(t) // 4000)):
        both = np.append(some, some[-1] + 1)
        own = tuple(row[both] for row in rows)
        inner = t[some, None] + np.diff(t[both])[:, None] * _BETWEEN
        truth = curve(inner.ravel())[0].reshape(*inner.shape, -1)
        worst["hold"] = np.maximum(worst["hold"], _off(truth, own[0][:-1, None]))
        for word, kept in (("linear", 1), ("cubic", 2), ("quintic", 3)):
            powers = hermite(t[both], *own[:kept])
            u = (inner - t[some, None])[:, :, None] ** np.arange(2 * kept)
            worst[word] = np.maximum(worst[word], _off(truth, u @ powers))
    return worst


def _off(truth: Array, made: Array) -> Array:
    return np.asarray(np.abs(truth - made).max(axis=(0, 1)))


def _units(motion: Motion, robot: Mechanism | None) -> tuple[str, ...]:
    if robot is not None:
        slides = sliding(robot.rigid.rigid)
        return tuple("m" if name in slides else "rad" for name in robot.description.actuated)
    if motion.target == "platform":
        return tuple("m" if len(name) == 1 else "rad" for name in motion.names)
    return ("rad | m",) * len(motion.names)


def _per(unit: str, time: str) -> str:
    return " | ".join(f"{one}/{time}" for one in unit.split(" | "))
