"""Aligned plain text for people: numbers of four digits, tables of at most 100 columns, ASCII."""

from __future__ import annotations

import dataclasses
import reprlib
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_: object) -> Callable[[Any], Any]:
        """What Python 3.10 does not have yet: it tells type checkers alone something."""
        return lambda function: function


C = TypeVar("C")

COLUMNS = 100  # width that every block of text fits
_BRIEF = 180  # characters of a record in one line


def number(x: float | None) -> str:
    """Four significant digits in at most eight characters (nine if negative); "-" for None."""
    if x is None:
        return "-"
    return "0" if x == 0 else f"{x:#.4g}".rstrip(".") if 1e-3 <= abs(x) < 1e4 else f"{x:.2e}"


def length(x: float, digits: int = 4) -> str:
    """A length or deviation [m] in the unit a person would say; fewer digits of an estimate."""
    if x == 0:
        return "0"
    factor, unit = (1.0, "m") if abs(x) >= 1 else (1e3, "mm") if abs(x) >= 1e-5 else (1e6, "um")
    return f"{number(factor * x) if digits == 4 else f'{factor * x:.{digits}g}'} {unit}"


def angle(x: float) -> str:
    """A small rotation [rad] in mrad or urad."""
    if x == 0:
        return "0"
    return f"{number(1e3 * x)} mrad" if abs(x) >= 1e-5 else f"{number(1e6 * x)} urad"


def percent(share: float | None, digits: int = 2, sign: str = "") -> str:
    """A share as per cent, "-" for None."""
    if share is None or not np.isfinite(share):
        return "-" if share is None else "not measured"
    x = 100 * share
    if abs(x) < 1e-10:  # round-off
        return "0 %"
    below = 100 - 0.5 * 10.0 ** (2 - digits)  # of what is rounded to 100 .2g makes 1e+02
    form = f".{digits}g" if abs(x) < below else ".0f" if abs(x) < 1e4 else ".1e"
    return f"{x:{sign}{form}} %"


def plural(count: int, noun: str) -> str:
    """Count with its noun: 1 link, 2 links."""
    ending = "es" if noun.endswith("s") else "s"
    return f"{count} {noun}{'' if count == 1 else ending}"


def brief(record: object) -> str:
    """One line for a dataclass of large parts: its small fields, and the shapes of its arrays."""
    words = []
    for item in dataclasses.fields(record):  # type: ignore[arg-type]
        value = getattr(record, item.name, None)
        if isinstance(value, float):
            shown = f"{value:.6g}"
        elif isinstance(value, str | int | None):
            shown = reprlib.repr(value)
        elif isinstance(value, np.ndarray):
            shown = f"array{value.shape}"
        elif isinstance(value, tuple | list | dict):
            shown = f"{len(value)} of {type(value).__name__}" if len(value) else "()"
        else:
            continue
        words.append(f"{item.name}={shown}")
    text = f"{type(record).__name__}({', '.join(words)})"
    return text if len(text) < _BRIEF else f"{text[: _BRIEF - 5]}...)"


@overload
def frozen(cls: type[C], /) -> type[C]: ...
@overload
def frozen(*, eq: bool) -> Callable[[type[C]], type[C]]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def frozen(cls: Any = None, /, *, eq: bool = True) -> Any:
    """A frozen dataclass whose repr is one line (`brief`); `eq`: whether equal by its fields."""
    if cls is None:
        return partial(frozen, eq=eq)
    cls.__repr__ = brief
    return dataclasses.dataclass(frozen=True, eq=eq, repr=False)(cls)


def short(name: str, width: int) -> str:
    """A long name keeps both ends, which carry the side and the number."""
    if len(name) <= width:
        return name
    tail = (width - 2) // 2
    return f"{name[: width - 2 - tail]}..{name[-tail:]}"


def _distinct(names: list[str], width: int) -> list[str]:
    """Shortened names, or whole ones where different names would look the same."""
    brief = [short(name, width) for name in names]
    return brief if len(set(brief)) == len(set(names)) else names


def paragraph(text: str, indent: str = "", first: str | None = None) -> str:
    """Text broken into lines that fit, each indented."""
    start = indent if first is None else first
    return textwrap.fill(
        text, COLUMNS, initial_indent=start, subsequent_indent=indent, break_long_words=False
    )


def report(*blocks: str) -> str:
    """Blocks of text with an empty line between them; empty ones are left out."""
    return "\n\n".join(filter(None, blocks)) + "\n"


def table(
    title: str,
    header: str,
    rows: Sequence[Sequence[str]],
    widths: Sequence[int] = (18, 18),
    last_is_text: bool = False,
) -> str:
    """A title and aligned columns between rules; empty without rows."""
    if not rows:
        return ""
    names = len(widths)
    columns = [_distinct([r[k] for r in rows], width) for k, width in enumerate(widths)]
    named = [[*cells, *r[names:]] for *cells, r in zip(*columns, rows, strict=True)]
    cells = [header.split("|"), *named]
    sizes = [max(map(len, column)) for column in zip(*cells, strict=True)]
    gap = "  " if sum(sizes) + 2 * len(sizes) <= COLUMNS else " "
    text = {*range(names)} | ({len(sizes) - 1} if last_is_text else set())
    lines = [
        gap.join(
            cell.ljust(size) if i in text else cell.rjust(size)
            for i, (cell, size) in enumerate(zip(row, sizes, strict=True))
        ).rstrip()
        for row in cells
    ]
    rule = "-" * max(map(len, lines))
    return "\n".join([title, rule, lines[0], rule, *lines[1:], rule])
