"""The keys of a motion, checked: numbers in range, names once, columns of a file."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.files import MOST_TABLE, require_regular
from pinflex.description.reading.schema import measured, shown, within
from pinflex.errors import DescriptionError, nearest

PLATFORM_COORDINATES = ("x", "y", "z", "rz", "ry", "rx")
OPTIONS = {  # unit, range and quantity of the numbers a motion may have
    "duration": ("s", "above 0", "time"),
    "ramp": ("s", "0 or more", "time"),
    "start": ("s", "0 or more", "time"),
    "smooth": ("s", "0 or more", "time"),
    "speed": ("rad/s or m/s", "above 0", "rate"),
    "frequency": ("Hz", "above 0", "rate"),
    "omega": ("rad/s", "above 0", "rate"),
    "radius": ("m", "above 0", "length"),
    "phase": ("rad", "", "angle"),
}
Moves = Mapping[str, float] | None


def bad(where: str, text: str) -> DescriptionError:
    """An error at a key path."""
    return DescriptionError(f"{where}: {text}", where=where)


def number(value: Any, where: str, unit: str = "rad or m", of: str = "position") -> float:
    """A finite number in the range of its quantity."""
    try:  # YAML 1.1 reads 1e-3 as text, so text that is a number is one
        x = float("nan" if isinstance(value, bool) else measured(value, of))
    except (TypeError, ValueError, OverflowError):
        x = float("nan")
    if not np.isfinite(x):
        raise bad(where, f"{shown(value)} is not a finite number. Give a number in {unit}.")
    return within(x, where, of)


def options(kind: str, optional: str = "", **given: float | None) -> dict[str, float]:
    """The given numbers, each finite and in range; `optional` ones may be None and are left out."""
    out = {}
    for key, value in given.items():
        if value is not None or key not in optional.split():
            unit, least, quantity = OPTIONS[key]
            out[key] = x = number(value, f"{kind}.{key}", unit, quantity)
            if (x < 0.0 and least) or (x == 0.0 and least == "above 0"):
                raise bad(f"{kind}.{key}", f"{x:g} {unit} is out of range. It must be {least}.")
    return out


def numbers(value: Any, where: str) -> dict[str, float]:
    """A mapping of names to finite numbers."""
    if not isinstance(value, Mapping):
        raise bad(where, f"{shown(value)} is no mapping. Write {{name: number in rad or m}}.")
    return {str(name): number(x, f"{where}.{name}") for name, x in value.items()}


def names(value: Any, target: str, where: str) -> tuple[str, ...]:
    """The names; platform coordinates must exist, joints are checked against the model."""
    if isinstance(value, str) or not isinstance(value, (Sequence, Mapping)) or not value:
        raise bad(where, f"{shown(value)} is no list of names. Write [name, ...].")
    names = tuple(map(str, value))
    if len({*names}) < len(names):
        raise bad(where, f"{shown(value)} has a name twice. Name each once.")
    for name in names:
        if target == "platform" and name not in PLATFORM_COORDINATES:
            hint = nearest(name, PLATFORM_COORDINATES)
            raise bad(f"{where}.{name}", f"no such platform coordinate.{hint}")
    return names


def target_of(joints: Any, platform: Any, where: str) -> tuple[str, Any]:
    """Whichever of the two is given: its word and its value."""
    if (joints is None) == (platform is None):
        given = "nothing moves" if joints is None else "both joints and platform are given"
        raise bad(where, f"{given}. Give one of joints: {{name: ...}}, platform: {{name: ...}}.")
    return ("joints", joints) if platform is None else ("platform", platform)


def moves_of(joints: Moves, platform: Moves, kind: str) -> tuple[str, dict[str, float], Array]:
    """What moves, by how much each, and the same as an array."""
    target, value = target_of(joints, platform, kind)
    moves = numbers(value, f"{kind}.{target}")
    names(moves, target, f"{kind}.{target}")
    return target, moves, np.array(list(moves.values()))


def table(file: Any) -> dict[str, Any]:
    """Columns of a CSV file by the names in its first line; lines that start with # are skipped."""
    if not isinstance(file, (str, Path)):
        raise bad("sampled.file", f"{shown(file)} is no name of a file. Give a CSV file.")
    require_regular(Path(file), MOST_TABLE, f"sampled.file: {file}")
    try:
        lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
        rows = list(csv.reader(x for x in lines if x.strip() and not x.startswith("#")))
        if len({len(row) for row in rows}) != 1:
            raise ValueError("its rows differ in length" if rows else "it is empty")
        head = [cell.strip() for cell in rows[0]]
        if len(set(head)) != len(head):
            raise ValueError(f"two columns have one name in {', '.join(head)}")
    except (OSError, TypeError, ValueError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise bad("sampled.file", f"cannot read {file}: {why}. Give a CSV file.") from error
    return {name: [row[j] for row in rows[1:]] for j, name in enumerate(head)}


def samples(table: dict[str, Any], name: str, where: str, times: Any = None) -> list[float]:
    """A column of numbers, one to each of the times if these are given."""
    if name not in table:
        raise bad(where, f"no such column.{nearest(name, table)}")
    column = table[name]
    if not isinstance(column, (list, tuple, np.ndarray)):
        raise bad(where, f"{shown(column)} is no list of samples. Write [number, ...].")
    unit, of = ("s", "time") if times is None else ("rad or m", "position")
    y = [number(x, f"{where}[{i}]", unit, of) for i, x in enumerate(column)]
    if times is not None and len(y) != len(times):
        raise bad(where, f"{len(y)} samples for {len(times)} times. Give one to each time.")
    return y


def sampled_data(
    file: Any, t: Any, joints: Any, platform: Any, absolute: Any, periodic: Any
) -> tuple[str, tuple[str, ...], list[float], Array]:
    """Target, names, times [s] and samples, shape (nt, names), of the arguments of `sampled`."""
    for key, flag in (("absolute", absolute), ("periodic", periodic)):
        if not isinstance(flag, bool):
            raise bad(f"sampled.{key}", f"{shown(flag)} is not allowed. Allowed: true, false.")
    if (file is None) == (t is None):
        raise bad("sampled", "give either file: name.csv or t: [...] with the samples.")
    target, pick, columns = _columns(file, t, joints, platform)
    moving = names(pick, target, f"sampled.{target}")
    times = samples(columns, "t", "sampled.t")
    y = np.array([samples(columns, name, f"sampled.{target}.{name}", times) for name in moving]).T
    if len(times) < 4 or times[0] != 0.0:
        first = f" from {times[0]:g} s" if times else ""
        raise bad("sampled.t", f"{len(times)} samples{first}. Give 4 or more, from t = 0 on.")
    for i in np.flatnonzero(np.diff(times) <= 0.0)[:1]:
        text = f"sample {i + 2} at {times[i + 1]:g} s follows {times[i]:g} s. Times must increase."
        raise bad("sampled.t", text)
    if periodic:
        for i in np.flatnonzero(np.abs(y[-1] - y[0]) > 1e-9 * np.maximum(1.0, np.ptp(y, axis=0))):
            text = f"starts at {y[0, i]:g}, ends at {y[-1, i]:g}. A periodic motion must close."
            raise bad(f"sampled.{target}.{moving[i]}", text)
        y[-1] = y[0]  # exactly, as scipy asks
    return target, moving, times, y


def _columns(file: Any, t: Any, joints: Any, platform: Any) -> tuple[str, Any, dict[str, Any]]:
    """Target, names and columns, of a file or as given."""
    if file is None or (joints is not None and platform is not None):
        target, pick = target_of(joints, platform, "sampled")
        if not isinstance(pick, Mapping):
            raise bad(f"sampled.{target}", f"{shown(pick)} has no samples. Write {{name: [...]}}.")
        return target, pick, {str(name): column for name, column in pick.items()} | {"t": t}
    columns = table(file)
    every = [name for name in columns if name != "t"]
    guess = "platform" if {*every} <= {*PLATFORM_COORDINATES} else "joints"
    guess = "platform" if platform is not None else guess if joints is None else "joints"
    return guess, platform or joints or every, columns
