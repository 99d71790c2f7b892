"""Checked reading of parsed YAML: a wrong value is named by file, key path, value and allowed ones.

Every reader takes the value and `where` it stands, as in "3rrr.yaml: flexible.distal_1.section".
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Collection, Iterable
from typing import Any

from pinflex.description import ranges
from pinflex.errors import DescriptionError, nearest

Vec3 = tuple[float, float, float]
_LETTERS: dict[str, Vec3] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_MOST = 10**9  # of whole numbers


def at(where: str, key: object) -> str:
    """Where a key of the block at `where` stands: "x.yaml" + "urdf" -> "x.yaml: urdf"."""
    return f"{where}.{key}" if ": " in where else f"{where}: {key}"


def shown(value: object) -> str:
    """The value as text for a message, cut short: aliases can make a small file endless."""
    short = reprlib.Repr()
    short.maxlevel = 2
    text = short.repr(value)
    return text if len(text) <= 120 else text[:117] + "..."


def mapping(
    value: object, where: str, keys: Collection[str] | None = None, required: Iterable[str] = ()
) -> dict[str, Any]:
    """A block `key: value`; empty values count as not written."""
    if not isinstance(value, dict):
        hint = f" Its keys: {', '.join(keys)}." if keys else ""
        raise DescriptionError(f"{where}: {shown(value)} is not a block of `key: value`.{hint}")
    for key in value:
        if not isinstance(key, str):
            raise DescriptionError(f"{where}: the key {shown(key)} is not text. Put it in quotes.")
        if keys is not None and key not in keys:
            name, colon, rest = key.partition(":")
            if colon and name in keys and value[key] is None:  # {kind:zvd} is one key of no value
                raise DescriptionError(
                    f"{at(where, name)}: {key} has no blank after its colon. "
                    f"Write `{name}: {rest}`."
                )
            raise DescriptionError(f"{at(where, key)}: no such key.{nearest(key, keys)}")
    written = {key: item for key, item in value.items() if item is not None}
    for key in required:
        if key not in written:
            raise DescriptionError(
                f"{at(where, key)}: missing. Required here: {', '.join(required)}. Write it."
            )
    return written


def number(
    value: object,
    where: str,
    low: float = -math.inf,
    high: float = math.inf,
    above: float = -math.inf,
    of: str | None = None,
) -> float:
    """A finite number with low <= value <= high and value > above."""
    edges = ((">", above), (">=", low), ("<=", high))
    bounds = " and ".join(f"{sign} {edge:g}" for sign, edge in edges if math.isfinite(edge))
    allowed = f"Allowed: a finite number {bounds}".rstrip() + "."
    value = ranges.measured(value, of)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = ranges.units_of(of) if isinstance(value, str) else ""
        raise DescriptionError(f"{where}: {shown(value)} is not a number. {allowed}{hint}")
    result = ranges.finite(value)
    if not (math.isfinite(result) and low <= result <= high and result > above):
        raise DescriptionError(f"{where}: {shown(value)} is out of range. {allowed}", value=value)
    return result if of is None else ranges.within(result, where, of)


def quantity(kind: str) -> str:
    """What a position of a joint of one freedom is, of `ranges.RANGES`."""
    return "place" if kind == "prismatic" else "angle"


def integer(value: object, where: str, low: int, high: int | None = None) -> int:
    """A whole number, low <= value <= high (None: a thousand million)."""
    most = _MOST if high is None else high
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= most:
        large = isinstance(value, int) and value > most
        bounds = f">= {low}" + (f" and <= {most}" if large or high is not None else "")
        raise DescriptionError(
            f"{where}: {shown(value)} is not valid. Allowed: a whole number {bounds}.", value=value
        )
    return value


def boolean(value: object, where: str) -> bool:
    """true or false."""
    if not isinstance(value, bool):
        raise DescriptionError(f"{where}: {shown(value)} is not valid. Allowed: true, false.")
    return value


def text(value: object, where: str) -> str:
    """A non-empty text."""
    if not isinstance(value, str) or not value.strip():
        raise DescriptionError(f"{where}: {shown(value)} is not a text. Write a name.")
    return value.strip()


def choice(value: object, where: str, names: Collection[str]) -> str:
    """One of the given words."""
    if not isinstance(value, str) or value not in names:
        raise DescriptionError(
            f"{where}: {shown(value)} is not known.{nearest(str(value)[:80], names)}", value=value
        )
    return value


def known(value: object, where: str, names: Collection[str], what: str) -> str:
    """A name that exists in the URDF, or another list."""
    name = text(value, where)
    if name not in names:
        raise DescriptionError(
            f'{where}: no such {what}: "{name[:80]}".{nearest(name[:80], names)}', name=name
        )
    return name


def items(value: object, where: str, size: int | None = None) -> list[Any]:
    """A list, of `size` entries if given."""
    if not isinstance(value, (list, tuple)) or (size is not None and len(value) != size):
        what = "a list" if size is None else f"a list of {size}"
        raise DescriptionError(f"{where}: {shown(value)} is not {what}. Write [a, b, ...].")
    return list(value)


def numbers(
    value: object, where: str, size: int, low: float = -math.inf, of: str | None = None
) -> tuple[float, ...]:
    """A list of `size` finite numbers >= low, each as in `number`."""
    entries = enumerate(items(value, where, size))
    return tuple(number(v, f"{where}[{i}]", low, of=of) for i, v in entries)


def vector(value: object, where: str, low: float = -math.inf, of: str | None = None) -> Vec3:
    """Three finite numbers >= low, each as in `number`."""
    x, y, z = numbers(value, where, 3, low, of)
    return x, y, z


def direction(value: object, where: str) -> Vec3:
    """A unit vector, from x, y, z, -x, -y, -z or three numbers that are not all zero."""
    if isinstance(value, str):
        letter = choice(value, where, ("x", "y", "z", "-x", "-y", "-z"))
        x, y, z = _LETTERS[letter[-1]]
        return (x, y, z) if len(letter) == 1 else (-x, -y, -z)
    x, y, z = vector(value, where)
    size = math.hypot(x, y, z)
    if not 1e-150 < size < 1e150:
        raise DescriptionError(
            f"{where}: {shown(value)} has no direction. Write x, y, z or [x, y, z]."
        )
    return x / size, y / size, z / size


def names(value: object, where: str, allowed: Collection[str], what: str) -> tuple[str, ...]:
    """A list of different names, each one of those allowed."""
    found: list[str] = []
    for i, item in enumerate(items(value, where)):
        name = known(item, f"{where}[{i}]", allowed, what)
        if name in found:
            raise DescriptionError(f'{where}[{i}]: "{name}" is listed twice. Keep one.', name=name)
        found.append(name)
    return tuple(found)
