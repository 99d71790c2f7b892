"""The motion of waypoints: a planner's trajectory, interpolated as its controller does."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.files import MOST_TABLE, require_regular
from pinflex.description.motions import laws as keys
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.trajectory import Motion
from pinflex.description.reading import yaml_text
from pinflex.description.reading.schema import shown
from pinflex.description.trajectories.profiles import Pieces, hermite
from pinflex.errors import DescriptionError, nearest

# Waypoints as ROS writes them (JointTrajectory in YAML or JSON) and as CSV; refused by line.

FIELDS = ("positions", "velocities", "accelerations", "effort")
_POINT = (*FIELDS, "time_from_start")
_WRAPPERS = ("trajectory", "joint_trajectory", "goal", "msg")  # of FollowJointTrajectory, MoveIt
_SECONDS = (("sec", "nanosec"), ("secs", "nsecs"))  # ROS 2, ROS 1
_COLUMNS = {  # of a CSV, behind the name of a joint
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "torque": "effort",
    "effort": "effort",
}
_ASIDE = ("motor_position", "motor_speed", "motor_torque")  # of drives, in the file of a command
_TIMES = ("t", "time", "time_from_start")
_FACTORS = {"": 1.0, "s": 1.0, "ms": 1e-3, "rad": 1.0, "m": 1.0, "deg": math.pi / 180, "mm": 1e-3}
_PER = {"positions": "", "velocities": "/s", "accelerations": "/s^2"}

Place = Callable[..., str]  # the steps of a path, to where it stands for a message


@dataclass(frozen=True)
class Waypoints:
    """Points in time of named joints.

    Attributes:
        names: Joints.
        t: Times [s], shape (n,), rising.
        values: By field of `FIELDS` that all points have, shape (n, joints) [rad | m, per s, ...].
    """

    names: tuple[str, ...]
    t: Array
    values: Mapping[str, Array]


def read(file: str | Path) -> Waypoints:
    """The waypoints of a file: .csv, or .yaml, .yml and .json of a JointTrajectory."""
    path = Path(file)
    where = f"trajectory.file: {path}"
    require_regular(path, MOST_TABLE, where)
    if path.suffix.lower() not in (".csv", ".yaml", ".yml", ".json"):
        raise keys.bad(where, "no such kind of trajectory. Allowed: .csv, .yaml, .yml, .json.")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise keys.bad("trajectory.file", f"cannot read {file}: {why}. Give a file.") from error
    return of_csv(text, where) if path.suffix.lower() == ".csv" else _of_text(text, where)


def _of_text(text: str, where: str) -> Waypoints:
    """A message in YAML or JSON."""
    text = re.sub(r"\n---\s*$", "\n", text.replace("\t", " "))  # `ros2 topic echo` ends so

    def place(*path: str | int) -> str:
        return f"{where}, line {_line(text, path)}: {dotted(path)}"

    return of_message(yaml_text.load(text, where), place)


def _line(text: str, path: tuple[str | int, ...]) -> int:
    """Line on which a value of a YAML begins, or the last block on the way to it."""
    import yaml

    node = yaml.compose(text, yaml.SafeLoader)
    for step in path:
        below = None
        if isinstance(node, yaml.SequenceNode) and isinstance(step, int):
            below = node.value[step] if step < len(node.value) else None
        elif isinstance(node, yaml.MappingNode):
            below = next((value for key, value in node.value if key.value == step), None)
        if below is None:
            break
        node = below
    return 1 if node is None else int(node.start_mark.line) + 1


def dotted(path: tuple[str | int, ...]) -> str:
    """points, 2, velocities, 1 -> points[2].velocities[1]."""
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return "".join(steps).lstrip(".")


def of_message(message: Any, place: Place) -> Waypoints:
    """The waypoints of a JointTrajectory as plain data."""
    above: tuple[str | int, ...] = ()
    while isinstance(message, Mapping) and "points" not in message:
        inner = next((key for key in _WRAPPERS if key in message), None)
        if inner is None:
            break
        message, above = message[inner], (*above, inner)
        if isinstance(message, list) and len(message) == 1:
            message, above = message[0], (*above, 0)
    if not isinstance(message, Mapping):
        raise keys.bad(place(*above, "points"), f"{shown(message)} is no JointTrajectory.")
    for key in ("joint_names", "points"):
        if not isinstance(message.get(key), list | tuple) or not message[key]:
            found = shown(message.get(key)) if key in message else "missing"
            raise keys.bad(place(*above, key), f"{found}. A JointTrajectory lists {key} here.")
    names = tuple(str(name) for name in message["joint_names"])
    for k, name in enumerate(names):
        if name in names[:k]:
            raise keys.bad(
                place(*above, "joint_names", k), f'"{name}" is there twice. Name each once.'
            )
    times, rows = [], []
    for k, point in enumerate(message["points"]):
        at = (*above, "points", k)
        times.append(_time(point, at, place))
        rows.append(_row(point, at, names, place))
        _require_same(rows, at, place)
        if len(times) > 1 and times[-1] <= times[-2]:
            text = f"{times[-1]:g} s follows {times[-2]:g} s. Times must rise."
            raise keys.bad(place(*at, "time_from_start"), text)
    values = {field: np.array([row[field] for row in rows]) for field in rows[0]}
    return _stopping(Waypoints(names, np.array(times), values), above, place)


def _time(point: Any, at: tuple[str | int, ...], place: Place) -> float:
    """time_from_start of a point [s]: a number, or seconds and nanoseconds."""
    if not isinstance(point, Mapping):
        raise keys.bad(place(*at), f"{shown(point)} is no point. Its keys: {', '.join(_POINT)}.")
    for key in point:
        if key not in _POINT:
            raise keys.bad(place(*at, key), f"no such key of a point.{nearest(str(key), _POINT)}")
    if point.get("time_from_start") is None:
        raise keys.bad(place(*at), "time_from_start is missing. Give seconds, or {sec, nanosec}.")
    given = point["time_from_start"]
    if isinstance(given, Mapping):
        pair = next((two for two in _SECONDS if set(given) <= set(two) and given), None)
        if pair is None:
            text = f"{shown(given)} is no time. Give seconds, or {{sec: 1, nanosec: 500000000}}."
            raise keys.bad(place(*at, "time_from_start"), text)
        parts = []
        for key, most in zip(pair, (2**31, 10**9), strict=True):
            x = given.get(key, 0)
            if isinstance(x, bool) or not isinstance(x, int) or not 0 <= x < most:
                text = f"{shown(x)} is out of range. Allowed: whole numbers, 0 to {most - 1}."
                raise keys.bad(place(*at, "time_from_start", key), text)
            parts.append(x)
        return parts[0] + 1e-9 * parts[1]
    time = _number(given, lambda: place(*at, "time_from_start"), "s", "time")
    if time < 0.0:
        raise keys.bad(place(*at, "time_from_start"), f"{time:g} s. It must be 0 or more.")
    return time


def _row(
    point: Mapping[str, Any], at: tuple[str | int, ...], names: tuple[str, ...], place: Place
) -> dict[str, list[float]]:
    """The fields that a point has, a number for each joint."""
    row = {}
    for field in FIELDS:
        given = point.get(field)
        if given is None or (isinstance(given, list | tuple) and not given):
            continue  # as ROS writes a field that is not used
        if not isinstance(given, list | tuple) or len(given) != len(names):
            count = f"{len(given)} numbers" if isinstance(given, list | tuple) else shown(given)
            text = f"{count} for {len(names)} joints ({', '.join(names[:6])}). Give one for each."
            raise keys.bad(place(*at, field), text)
        row[field] = [
            _number(x, lambda j=j, f=field: place(*at, f, j), "rad or m (per s)")  # type: ignore[misc]
            for j, x in enumerate(given)
        ]
    if "positions" not in row:
        raise keys.bad(
            place(*at, "positions"), "missing. Every point gives the position of each joint."
        )
    if "accelerations" in row and "velocities" not in row:
        raise keys.bad(
            place(*at, "velocities"), "missing, though accelerations are given. Give both."
        )
    return row


def _require_same(
    rows: list[dict[str, list[float]]], at: tuple[str | int, ...], place: Place
) -> None:
    """Every point has the fields of the first."""
    for field in FIELDS:
        if (field in rows[-1]) != (field in rows[0]):
            word = "missing, but the first point has" if field in rows[0] else "the first has no"
            raise keys.bad(
                place(*at, field), f"{word} {field}. Give them at every point or at none."
            )


def _stopping(found: Waypoints, above: tuple[str | int, ...], place: Place) -> Waypoints:
    """The waypoints, if they end at rest and move at all."""
    last = len(found.t) - 1
    if last == 0 and found.t[0] == 0.0:
        raise keys.bad(place(*above, "points"), "one point at 0 s moves nothing. Give two or more.")
    speeds = found.values.get("velocities")
    if speeds is not None:
        fast = np.abs(speeds[-1]) > _AT_REST * np.maximum(np.abs(speeds).max(axis=0), 1.0)
        for j in np.flatnonzero(fast)[:1]:
            raise keys.bad(
                place(*above, "points", last, "velocities", int(j)),
                f"{found.names[j]} ends at {speeds[-1, j]:g} rad/s or m/s; a joint_trajectory_"
                "controller refuses that too. End at rest, with a point more.",
            )
    return found


_AT_REST = 1e-6  # of the top speed, or rad/s, m/s: files of few digits end so


def _number(value: Any, where: Callable[[], str], unit: str, of: str = "position") -> float:
    """A finite number; where it stands is looked up for a message only."""
    try:
        return keys.number(value, "", unit, of)
    except DescriptionError as error:
        raise keys.bad(where(), str(error).removeprefix(": ")) from None


# CSV ---------------------------------------------------------------------------------------------


def of_csv(text: str, where: str) -> Waypoints:
    """The waypoints of a table: t, then NAME or NAME.position, .velocity, .acceleration."""
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    if len(lines) < 2:
        raise keys.bad(
            where, "no rows. A trajectory has a header t, NAME, ... and a row per instant."
        )
    cells = keys.cells(line for _, line in lines)
    header = f"{where}, line {lines[0][0]}"
    columns = [_column(cell.strip(), header) for cell in cells[0]]
    names = tuple(dict.fromkeys(name for name, field, _ in columns if field and field != "t"))
    at = _places(columns, names, header)
    numbers = _numbers(cells[1:], columns, [f"{where}, line {number}" for number, _ in lines[1:]])
    t = numbers[:, at["t"][0]]
    for k in np.flatnonzero(np.diff(t, prepend=-1e-300 if t[0] == 0 else 0.0) <= 0)[:1]:
        before = "0" if k == 0 else f"{t[k - 1]:g}"
        raise keys.bad(
            f"{where}, line {lines[k + 1][0]}: t",
            f"{t[k]:g} s follows {before} s. Times must rise.",
        )
    values = {field: numbers[:, at[field]] for field in FIELDS if field in at}

    def place(*path: str | int) -> str:
        rows = [step for step in path if isinstance(step, int)]
        number = lines[rows[0] + 1][0] if rows else lines[0][0]
        return f"{where}, line {number}: {path[-2] if len(rows) > 1 else path[-1]}"

    return _stopping(Waypoints(names, t, values), (), place)


def _numbers(
    rows: list[list[str]], columns: list[tuple[str, str, float]], places: list[str]
) -> Array:
    """Numbers of the used columns in SI, shape (rows, columns); a cell without one is an error."""
    factors = np.array([factor for _, _, factor in columns])
    used = [j for j, (_, field, _) in enumerate(columns) if field]
    numbers = np.zeros((len(rows), len(columns)))
    for k, (here, row) in enumerate(zip(places, rows, strict=True)):
        if len(row) != len(columns):
            text = f"{len(row)} cells, the header has {len(columns)}. Give one for each."
            raise keys.bad(here, text)
        for j in used:
            name, field, _ = columns[j]
            try:
                numbers[k, j] = row[j]
            except ValueError:
                numbers[k, j] = np.nan
            if not np.isfinite(numbers[k, j]):
                what = "t" if field == "t" else f"{name}.{field}"
                text = f"{shown(row[j])} is not a finite number. Correct it."
                raise keys.bad(f"{here}: {what}", text)
    return np.asarray(numbers * factors)


def _column(head: str, where: str) -> tuple[str, str, float]:
    """Joint, field ("" for one that is left aside) and factor to SI of a column."""
    label, unit = keys.headed(head)
    if label.lower() in _TIMES:
        if unit not in ("", "s", "ms"):
            raise keys.bad(f"{where}: {label}", f"no unit of time: [{unit}]. Allowed: [s], [ms].")
        return "", "t", _FACTORS[unit]
    name, dot, word = label.rpartition(".")
    if dot and word in _ASIDE:
        return name, "", 1.0
    if dot and word == "displacement":
        text = "a displacement from home. Write the file with robot=..., which gives positions."
        raise keys.bad(f"{where}: {label}", text)
    name, field = (name, _COLUMNS[word]) if dot and word in _COLUMNS else (label, "positions")
    if field == "effort" or unit in ("", "rad | m", "rad/s | m/s", "rad/s^2 | m/s^2"):
        return name, field, 1.0
    plain = unit.removesuffix(_PER[field])
    if plain not in ("rad", "deg", "m", "mm") or (field != "positions" and plain == unit):
        allowed = ", ".join(f"[{u}{_PER[field]}]" for u in ("rad", "deg", "m", "mm"))
        raise keys.bad(f"{where}: {label}", f"no unit of {field}: [{unit}]. Allowed: {allowed}.")
    return name, field, _FACTORS[plain]


def _places(
    columns: list[tuple[str, str, float]], names: tuple[str, ...], where: str
) -> dict[str, list[int]]:
    """Columns of the time, and of each field in the order of the names."""
    known: dict[tuple[str, str], int] = {}
    for k, (name, field, _) in enumerate(columns):
        if field and (name, field) in known:
            raise keys.bad(where, f"two columns of {field} of {name or 'time'}. Keep one.")
        known[name, field] = k
    if ("", "t") not in known:
        raise keys.bad(where, f"no column of time. Allowed: {', '.join(_TIMES)}.")
    if not names:
        raise keys.bad(where, "no joint. Columns are t, then NAME.position, NAME.velocity, ...")
    found = {"t": [known["", "t"]]}
    for field in FIELDS:
        have = [name for name in names if (name, field) in known]
        lost = [name for name in names if name not in have]
        if lost and (have or field == "positions"):
            raise keys.bad(where, f"no column of {field} of {lost[0]}. Give it for each joint.")
        if have:
            found[field] = [known[name, field] for name in names]
    if "accelerations" in found and "velocities" not in found:
        raise keys.bad(where, "accelerations without velocities. Give both.")
    return found


_RATES = ("positions", "velocities", "accelerations")
_FEW = 64  # waypoints at which steps end; of more those alone at which an acceleration jumps
_JUMP = 1e-3  # of the largest acceleration: less is round-off of samples


@public
def trajectory(
    file: str | Path | Mapping[str, Any] | None = None,
    *,
    joint_names: Sequence[str] | None = None,
    points: Sequence[Mapping[str, Any]] | None = None,
    header: Mapping[str, Any] | None = None,
    start: Mapping[str, float] | None = None,
) -> Motion:
    """The motion of a ROS JointTrajectory or of a CSV, interpolated as its controller does.

    Between points a quintic polynomial where they have accelerations, a cubic where velocities, as
    ros2_control's joint_trajectory_controller takes. Of positions alone that controller goes
    straight, with a jump of the speed at each point; here it is then a cubic spline from rest to
    rest. Before a first point later than 0 s it goes there from `start`, at rest.

    Args:
        file: .yaml, .yml or .json of the message, .csv with a header `t, NAME.position, ...` (units
            in brackets), or the message as plain data.
        joint_names: Names, without a file. points: Its points: positions, velocities,
            accelerations, time_from_start (seconds, or {sec, nanosec}).
        header: Of the message; not used.
        start: Positions at 0 s [rad | m] by joint; default: those of the first point.
    Raises:
        DescriptionError: A malformed message or table, with line and field.
    """
    if (file is None) == (points is None):
        raise keys.bad("trajectory", "give either file, or joint_names and points.")
    if isinstance(file, str | Path):
        found = read(file)
    elif file is not None or points is not None:
        message: Any = file if file is not None else {"joint_names": joint_names, "points": points}
        found = of_message(message, _inline)
    keys.names(found.names, "joints", "trajectory.joint_names")
    begin = _begin(found, start)
    law = _law(found, begin)
    inner = law.knots[1:-1].tolist() if len(law.knots) <= _FEW + 2 else law.corners(_JUMP)
    spec: dict[str, Any] = {
        "kind": "trajectory",
        "joint_names": [*found.names],
        "points": points_of(found.t.tolist(), found.values),
    }
    if start is not None:
        spec["start"] = dict(zip(found.names, begin.tolist(), strict=True))
    end = float(found.t[-1])
    return Motion("trajectory", "joints", found.names, end, law, True, spec, tuple(inner))


def points_of(times: Sequence[Any], rows: Mapping[str, Array]) -> list[dict[str, Any]]:
    """The points of a message."""
    lists = {field: values.tolist() for field, values in rows.items()}
    return [
        {field: values[k] for field, values in lists.items()} | {"time_from_start": time}
        for k, time in enumerate(times)
    ]


def _inline(*path: str | int) -> str:
    return f"trajectory.{dotted(path)}"


def _begin(found: Waypoints, start: Any) -> Array:
    """Positions at 0 s, shape (joints,)."""
    first: Array = found.values["positions"][0]
    if start is None:
        return first
    if not isinstance(start, Mapping):
        raise keys.bad("trajectory.start", f"{shown(start)} is no mapping. Write {{name: number}}.")
    given = keys.numbers(start, "trajectory.start")
    for name in given:
        if name not in found.names:
            raise keys.bad(f"trajectory.start.{name}", "no joint of the trajectory. Remove it.")
    if found.t[0] == 0.0:
        raise keys.bad("trajectory.start", "the first point is at 0 s. Remove start.")
    return np.array([given.get(name, x) for name, x in zip(found.names, first, strict=True)])


def _law(found: Waypoints, begin: Array) -> Pieces:
    """Pieces through the waypoints, from rest where the first is later than 0 s."""
    t, rows = found.t, [found.values[field] for field in _RATES if field in found.values]
    if t[0] > 0.0:
        t = np.concatenate([[0.0], t])
        rest = np.zeros((1, len(begin)))
        rows = [np.vstack([begin if k == 0 else rest, row]) for k, row in enumerate(rows)]
    if len(rows) > 1:
        return Pieces(t, hermite(t, *rows), rows[0][-1])
    from scipy.interpolate import CubicSpline

    powers = CubicSpline(t, rows[0], bc_type="clamped").c[::-1].swapaxes(0, 1)
    return Pieces(t, np.ascontiguousarray(powers), rows[0][-1])


def slowed(motion: Motion, factor: float) -> Motion:
    """The same path, `factor` times as long."""
    corners = tuple(factor * t for t in motion.switches)
    return replace(
        motion, kind=f"retimed {motion.kind}", law=partial(_stretched, motion.law, factor),
        duration=factor * motion.duration, spec={}, corners=corners,
    )  # fmt: skip


def _stretched(law: Callable[[Array], Kinematics], factor: float, t: Array) -> Kinematics:
    p, v, a = law(t / factor)
    return p, v / factor, a / factor**2
