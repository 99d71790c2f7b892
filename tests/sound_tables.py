"""Whether every index of the kernel's tables is within what it points into.

The C code trusts them. Every test that makes tables has them checked (`conftest.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pinflex.kernel.evaluate import Tables
from pinflex.kernel.library import constant, shapes

# Arrays of indices, and what they point into.
_INTO: dict[str, str | int] = {
    "q_at": "nQ", "v_at": "nV", "parent": "nodes", "node_q": "nQ", "node_v": "nV",
    "point_node": "nodes", "point_q": "nQ", "point_v": "nV", "twist_node": "nodes",
    "twist_q": "nQ", "twist_v": "nV", "row_q": "nQ", "row_v": "nV", "phi_i": "n_eta",
    "g_i": "n_eta", "g_j": "n_eta", "g_pair": "pairs", "g_first": "n_eta",
    "g_second": "n_eta", "node_a": "nodes", "node_b": "nodes",
    "row_number": "closures", "couple_row": "closures", "couple_q": "nQ", "couple_v": "nV",
    "added_node": "nodes", "added_force": "forces", "bent_first": "n_eta", "bent_directions": 3,
    "force_node": "nodes", "spring_a": "nodes", "spring_b": "nodes",
    "joint_spring_v": "nv", "joint_spring_q": "nq", "rub_v": "nv", "k_j": "n_eta", "d_j": "nv",
    "block_of": "blocks", "block_order": "blocks", "block_above": "blocks", "node_block": "blocks",
    "row_a": 3, "row_b": 3, "about": 3, "kind": 7, "row_kind": 3,
    "sleeve_node": "nodes", "stretch_node": "nodes", "stretch_track": "tracks",
    "sleeve_loop": "loops", "sleeve_row": "closures", "sleeve_sort": 7, "sleeve_axis": 3,
    "entry_row": 8, "kink_v": "nv", "kink_q": "nq", "spring_kink": "kinks",
}  # fmt: skip
_MADE = {"g_pair", "g_first", "g_second"}  # by `Tables` itself
_BASE = {"parent", "point_node", "twist_node", "node_a", "node_b", "force_node", "added_node",
         "added_force", "spring_a", "spring_b", "sleeve_node", "stretch_node",
         "block_above", "kink_v", "spring_kink", "about"}  # fmt: skip  # may be -1: the base
_AHEAD = {  # coordinates that a node has by its kind: of Q and of V
    "node_q": (1, 2, 1, 3, 4, 7, 4), "node_v": (1, 1, 1, 3, 3, 6, 3)
}  # fmt: skip


class UnsoundTables(AssertionError):
    """An index points where nothing is."""


def require_sound(tables: Tables, given: Mapping[str, Any]) -> None:
    """Raise where the C code would read what is not there; `given`: arrays that were handed in."""
    a, sizes = tables.arrays, tables.sizes
    for name, array in a.items():
        # What a system has none of is not given: no entries, or where none begin.
        none = array.size == (1 if shapes("Tables")[name][1][0].endswith("+1") else 0)
        _require(name in given or name in _MADE or none, f"{name}: not given")
        if name.endswith("_at") and name not in ("q_at", "v_at"):
            _require(array[0] == 0 and np.all(np.diff(array) >= 0), f"{name}: rows overlap")
    for name, into in _INTO.items():
        limit = sizes[into] if isinstance(into, str) else into
        top = a[name]
        if name == "bent_first":
            top = top + a["bent_n"] - 1
        elif name in _AHEAD:
            top = top + np.array(_AHEAD[name])[a["kind"]] - 1
        elif name in ("point_q", "point_v"):
            top = top + 2
        within = np.all(a[name] >= (-1 if name in _BASE else 0)) and np.all(top < limit)
        _require(within, f"{name}: an index outside 0 ... {limit - 1}")
    _require(np.all(a["parent"] < np.arange(sizes["nodes"])), "parent: a node before its parent")
    rows = a["bent_n"] * a["bent_directions"] * np.diff(a["bent_point"])
    _require(np.array_equal(rows, np.diff(a["bent_at"])), "bent_at: rows do not fit their points")
    _require_paths(tables)
    if tables.counts["sleeves"]:
        _require_sleeves(tables)
    _require_squares(tables)


def _require(sound: Any, said: str) -> None:
    if not sound:
        raise UnsoundTables(said)


def _require_paths(tables: Tables) -> None:
    """Each joint depends on one block, and finds those of the joints before it on its path."""
    a, sizes = tables.arrays, np.diff(tables.arrays["block_at"])
    of, above, depth = (a[f"block_{name}"] for name in ("of", "above", "depth"))
    top = np.append(depth + sizes, 0)  # where a path that ends in a block ends; -1: at the base
    node, elastic = a["node_block"], tables.counts["nv_rigid"]
    sound = [a["block_at"][-1] == tables.counts["nv"], sizes > 0, depth == top[above]]
    sound += [np.diff(a["x_at"]) >= sizes[of], a["x_at"] % constant("LANES") == 0]
    for row, column in (
        (a["v_at"], np.arange(elastic)),
        *((np.repeat(a["row_v"], np.diff(a[f"{i[:-2]}_at"])), elastic + a[i])
          for i in ("phi_i", "g_i", "g_j")),
    ):  # fmt: skip
        block = of[row]
        sound += [(a["block_at"][block] <= column) & (column < a["block_at"][block + 1])]
    for name, number, width in (
        ("node", a["parent"], np.array(_AHEAD["node_v"])[a["kind"]]),
        ("point", a["point_node"], 3), ("twist", a["twist_node"], 1),
    ):  # fmt: skip
        row = a[f"{name}_v"]
        before = np.append(node, -1)[number]
        sound += [(before == of[row]) | (before == above[of[row]])]
        sound += [of[row] == of[row + width - 1]]
        sound += [node == of[row]] if name == "node" else []
    _require(all(map(np.all, sound)), "block_of: joints do not fit their paths")


def _require_sleeves(tables: Tables) -> None:
    """Each on a stretch at least, within its coordinates, and with no more rows than fit."""
    a = tables.arrays
    ends = a["stretch_eta"] + a["track_n"][a["stretch_track"]]
    pieces, entries = np.diff(a["piece_at"]), np.diff(a["entry_at"])
    number = np.repeat(a["track_n"], entries)
    sound = (
        np.all(np.diff(a["stretch_at"]) > 0) and np.all(a["stretch_eta"] >= 0)
        and np.all(ends <= tables.sizes["n_eta"]) and np.all(pieces > 0)
        and np.array_equal(np.diff(a["power_at"]), pieces * entries * a["track_degrees"])
        and np.all((a["entry_i"] >= 0) & (a["entry_i"] < number))
        and np.all((a["entry_j"] >= -1) & (a["entry_j"] < number))
        and np.all(np.diff(a["sleeve_at"]) <= constant("MOST_SLEEVE_ROWS"))
        and np.all(a["sleeve_passes"] | (np.diff(a["stretch_at"]) == 1))
    )  # fmt: skip
    _require(sound, "sleeves: tables do not fit each other")


def _require_squares(tables: Tables) -> None:
    """Each within the coordinates, and sums of squares that there are."""
    a, count = tables.arrays, tables.counts["squares"]
    summed = np.diff(a["sum_at"])
    sound = (
        np.all(a["square_eta"] >= 0)
        and np.all(a["square_eta"] + np.diff(a["square_at"]) <= tables.sizes["n_eta"])
        and np.all(a["sum_from"] >= 0) and np.all(a["sum_from"] + summed <= count)
        and np.all((a["g_rest"] >= a["g_at"][:-1]) & (a["g_rest"] <= a["g_at"][1:]))
    )  # fmt: skip
    _require(sound, "squares: sums of squares that are none")
