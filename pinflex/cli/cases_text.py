"""A table of cases on one screen: parameters and main numbers, and what varies in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.results.columns import Columns
from pinflex.text import COLUMNS, number, table

_ROWS = 20  # of cases on one screen
_MAIN = ("deviation.position", "stress.peak", "frequency.1", "torque.peak", "stress.yield")
_SAID = 3  # of them in the sentence
_IN = {"Pa": ("MPa", 1e-6), "m": ("mm", 1e3)}  # outputs as a person says them
_ENDS = 2  # last words of a key path that name a parameter


def main_columns(cases: Columns, parameters: Sequence[str]) -> list[str]:
    """Parameters, then the numbers that matter most, as far as there are any and they fit."""
    found = [*parameters]
    for head in _MAIN:
        named = [n for n in cases if n == head or n.startswith(f"{head}.")]
        found += [n for n in named if n not in found and _known(cases, n)][:3]
    return found


def case_table(cases: Columns, names: Sequence[str]) -> str:
    """One row for each case, the first ones where there are many."""
    heads, rows = ["case"], [[str(k + 1)] for k in range(min(len(cases), _ROWS))]
    wide = 6
    for name in names:
        unit, factor = _IN.get(cases.units.get(name, ""), (cases.units.get(name, ""), 1.0))
        head = short_key(name) + (f" [{unit}]" if unit else "")
        cells = [_cell(x, factor) for x in cases[name][: len(rows)].tolist()]
        wide += 2 + max(len(head), *map(len, cells))
        if wide > COLUMNS:
            break
        heads.append(head)
        for row, cell in zip(rows, cells, strict=True):
            row.append(cell)
    more = len(cases) - len(rows)
    title = "Cases" + (f", the first {_ROWS} ({more} more in the table: --out)" if more else "")
    return table(title, "|".join(heads), rows, (6,))


def sentence(cases: Columns, names: Sequence[str]) -> str:
    """From where to where each number goes, with the rows of both ends."""
    said = []
    for name in [*names][:_SAID]:
        values = cases[name]
        some = np.isfinite(values) if values.dtype.kind == "f" else np.zeros(len(values), bool)
        if np.count_nonzero(some) < 2:
            continue
        low, high = (int(f(np.where(some, values, g))) for f, g in
                     ((np.argmin, np.inf), (np.argmax, -np.inf)))  # fmt: skip
        unit, factor = _IN.get(cases.units.get(name, ""), (cases.units.get(name, ""), 1.0))
        ends = [number(factor * float(values[k])) for k in (low, high)]
        if ends[0] == ends[1]:
            said.append(f"{short_key(name)} stays at {ends[0]} {unit}".rstrip())
        else:
            largest = f"{ends[1]} {unit}".rstrip()
            said.append(
                f"{short_key(name)} goes from {ends[0]} (case {low + 1}) to {largest} "
                f"(case {high + 1})"
            )
    return f"{'; '.join(said)}." if said else ""


def ranges(cases: Columns) -> str:
    """Least and largest value of every column that has any but zero, and their rows."""
    rows = []
    for name, values in cases.arrays.items():
        if values.dtype.kind != "f" or not np.any(values[~np.isnan(values)]):
            continue
        low, high = int(np.nanargmin(values)), int(np.nanargmax(values))
        ends = ["rigid" if np.isinf(x) else number(float(x)) for x in values[[low, high]]]
        unit = cases.units.get(name, "")
        rows.append([name, unit, ends[0], str(low + 1), ends[1], str(high + 1)])
    return table("Range of every number", "column|unit|least|in row|largest|in row", rows, (44, 8))


def short_key(name: str) -> str:
    """The last words of a key path; an output as it is."""
    parts = name.split(".")
    return ".".join(parts[-_ENDS:]) if len(parts) > 3 else name


def _known(cases: Columns, name: str) -> bool:
    values = cases[name]
    return values.dtype.kind == "f" and bool(np.isfinite(values).any())


def _cell(value: float | str, factor: float) -> str:
    if isinstance(value, str):
        return value or "-"
    if not np.isfinite(value):
        return "-" if np.isnan(value) else "rigid"
    return number(factor * value)
