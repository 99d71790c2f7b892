"""Which entries of the sparse tables a slider may move: those of all places it was looked at.

Entries that are nothing but round-off come and go with a number of the scene. Tables with zeros in
their places are the same tables, and can be subtracted.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pinflex.arrays import Array, IntArray

Tables = dict[str, Array]
_SPARSE = ("phi", "g")  # rows of the map: entries, and where they are


def pattern_of(tables: Iterable[Tables]) -> dict[str, IntArray] | None:
    """Entries that any of some tables has; None: they are not of one structure."""
    every = list(tables)
    others = {name for name in every[0] if name.split("_")[0] not in _SPARSE}
    if any(x.keys() != every[0].keys() for x in every):
        return None
    if any(x[name].shape != every[0][name].shape for x in every for name in others):
        return None
    return {name: np.unique(np.concatenate([_keys(x, name) for x in every])) for name in _SPARSE}


def widened(tables: Tables, pattern: dict[str, IntArray]) -> Tables | None:
    """The tables with zeros where only others have entries; None: they have more than all."""
    out, n = dict(tables), _width(tables)
    for name in _SPARSE:
        wanted, own = pattern[name], _keys(tables, name)
        if not np.isin(own, wanted).all():
            return None
        values = np.zeros(len(wanted))
        values[np.searchsorted(wanted, own)] = tables[name]
        rows = len(tables[f"{name}_at"]) - 1
        at = np.searchsorted(wanted, np.arange(rows + 1) * n * n).astype(float)
        out[name], out[f"{name}_at"] = values, at
        out[f"{name}_i"] = (wanted // n % n).astype(float)
        if f"{name}_j" in tables:
            out[f"{name}_j"] = (wanted % n).astype(float)
        if name == "g":  # rows are of products, or of sums of squares
            products = tables["g_rest"] == tables["g_at"][1:]
            out["g_rest"] = np.where(products, at[1:], at[:-1])
    return out


def _width(tables: Tables) -> int:
    """More than there are elastic coordinates."""
    return len(tables["d_at"])


def _keys(tables: Tables, name: str) -> IntArray:
    """Row, i and j of each entry as one number, in their order."""
    n, at = _width(tables), tables[f"{name}_at"].astype(np.intp)
    row = np.repeat(np.arange(len(at) - 1), np.diff(at))
    j = tables.get(f"{name}_j", np.zeros(int(at[-1]))).astype(np.intp)
    return np.asarray((row * n + tables[f"{name}_i"].astype(np.intp)) * n + j)
