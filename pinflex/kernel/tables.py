"""Flat tables of one system, as the C code reads them: sizes and types checked here, once.

The fields and their shapes are those of `Tables` in source/kernel.h, which says what they hold.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.errors import PinflexError
from pinflex.kernel.header import constant, names, shapes, structure

_Tables = structure("Tables")
COUNTS = names("Tables", ctypes.c_int64)
# Each array with its shape; "name+1" starts of rows, whose last entry counts what "*name" holds.
INTEGERS, NUMBERS = shapes("Tables", "Int"), shapes("Tables", "double")
# Arrays of indices, and what they point into.
_INTO: dict[str, str | int] = {
    "q_at": "nQ", "v_at": "nV", "parent": "nodes", "node_q": "nQ", "node_v": "nV",
    "point_node": "nodes", "point_q": "nQ", "point_v": "nV", "twist_node": "nodes",
    "twist_q": "nQ", "twist_v": "nV", "row_q": "nQ", "row_v": "nV", "phi_i": "n_eta",
    "g_i": "n_eta", "g_j": "n_eta", "node_a": "nodes", "node_b": "nodes",
    "row_number": "closures", "couple_row": "closures", "couple_q": "nQ", "couple_v": "nV",
    "added_node": "nodes", "bent_first": "n_eta", "bent_directions": 3,
    "force_node": "nodes", "spring_a": "nodes", "spring_b": "nodes",
    "joint_spring_v": "nv", "joint_spring_q": "nq", "rub_v": "nv", "k_j": "n_eta", "d_j": "nv",
    "block_of": "blocks", "block_above": "blocks", "node_block": "blocks",
    "row_a": 3, "row_b": 3, "kind": 7, "row_kind": 3,
    "sleeve_node": "nodes", "stretch_node": "nodes", "stretch_track": "tracks",
    "sleeve_loop": "loops", "sleeve_row": "closures", "sleeve_sort": 7, "sleeve_axis": 3,
    "entry_row": 8, "kink_v": "nv", "kink_q": "nq", "spring_kink": "kinks",
}  # fmt: skip
_SLEEVE_ROWS = constant("MOST_SLEEVE_ROWS")
_BASE = {"parent", "point_node", "twist_node", "node_a", "node_b", "force_node", "added_node",
         "spring_a", "spring_b", "sleeve_node", "stretch_node",
         "block_above", "kink_v", "spring_kink"}  # fmt: skip  # may be -1: the base
_AHEAD = {  # coordinates that a node has by its kind: of Q and of V
    "node_q": (1, 2, 1, 3, 4, 7, 4), "node_v": (1, 1, 1, 3, 3, 6, 3)
}  # fmt: skip


class Tables:
    """Checked tables of one system; the C code may read every entry that they point to.

    Attributes:
        counts: Sizes by name. arrays: By name. address: Of the C structure.
    """

    def __init__(self, counts: Mapping[str, int], arrays: Mapping[str, npt.ArrayLike]) -> None:
        self.counts = {name: int(counts[name]) for name in COUNTS}
        sizes = self.counts | {"n_eta": counts["nv"] - counts["nv_rigid"]}
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        for group, dtype in ((INTEGERS, np.int64), (NUMBERS, np.float64)):
            for name, shape in group.items():
                array = np.ascontiguousarray(arrays[name], dtype=dtype)
                self.arrays[name] = array
                wanted = math.prod(self._size(part, sizes) for part in shape)
                if array.size != wanted:
                    raise PinflexError(f"kernel: {name}: {array.size} entries, not {wanted}.")
        self._check_indices(sizes)
        pointers = {name: array.ctypes.data for name, array in self.arrays.items()}
        self._structure = _Tables(**self.counts, **pointers)
        self.address = ctypes.addressof(self._structure)

    def __reduce__(self) -> tuple[type[Tables], tuple[Any, ...]]:
        """Addresses do not travel to another process: it makes its own."""
        return Tables, (self.counts, self.arrays)

    def _size(self, part: str | int, sizes: Mapping[str, int]) -> int:
        if isinstance(part, int):
            return part
        if part.startswith("*"):
            return int(self.arrays[part[1:]][-1])
        return sizes[part[:-2]] + 1 if part.endswith("+1") else sizes[part]

    def _check_indices(self, sizes: Mapping[str, int]) -> None:
        """Every index within what it points into; parents before children."""
        for name, into in _INTO.items():
            array = self.arrays[name]
            limit = sizes[into] if isinstance(into, str) else into
            top = array
            if name == "bent_first":
                top = array + self.arrays["bent_n"] - 1
            elif name in _AHEAD:
                top = array + np.array(_AHEAD[name])[self.arrays["kind"]] - 1
            elif name in ("point_q", "point_v"):
                top = array + 2
            if np.any(array < (-1 if name in _BASE else 0)) or np.any(top >= limit):
                raise PinflexError(f"kernel: {name}: an index outside 0 ... {limit - 1}.")
        if np.any(self.arrays["parent"] >= np.arange(sizes["nodes"])):
            raise PinflexError("kernel: parent: a node before its parent.")
        self._check_blocks()
        bent = (self.arrays[f"bent_{part}"] for part in ("n", "directions", "point", "at"))
        n, directions, points, at = bent
        if np.any(n * directions * np.diff(points) != np.diff(at)):
            raise PinflexError("kernel: bent_at: rows that do not fit their points.")
        self._check_sleeves(sizes)
        self._check_squares(sizes)
        for name in (*INTEGERS, *NUMBERS):
            if name.endswith("_at") and name not in ("q_at", "v_at"):
                array = self.arrays[name]
                if array[0] != 0 or np.any(np.diff(array) < 0):
                    raise PinflexError(f"kernel: {name}: rows that overlap.")

    def _check_blocks(self) -> None:
        """Each joint depends on one block, and finds those of the joints before it on its path."""
        a, sizes = self.arrays, np.diff(self.arrays["block_at"])
        of, above, depth = (a[f"block_{name}"] for name in ("of", "above", "depth"))
        top = np.append(depth + sizes, 0)  # where a path that ends in a block ends; -1: at the base
        node, elastic = a["node_block"], self.counts["nv_rigid"]
        sound = [a["block_at"][-1] == self.counts["nv"], sizes > 0, depth == top[above]]
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
        if not all(map(np.all, sound)):
            raise PinflexError("kernel: block_of: joints that do not fit their paths.")

    def _check_sleeves(self, sizes: Mapping[str, int]) -> None:
        """Each on a stretch at least, within its coordinates, and with no more rows than fit."""
        a = self.arrays
        ends = a["stretch_eta"] + a["track_n"][a["stretch_track"]]
        pieces, entries = np.diff(a["piece_at"]), np.diff(a["entry_at"])
        number = np.repeat(a["track_n"], entries)
        sound = (
            np.all(np.diff(a["stretch_at"]) > 0) and np.all(a["stretch_eta"] >= 0)
            and np.all(ends <= sizes["n_eta"]) and np.all(pieces > 0)
            and np.array_equal(np.diff(a["power_at"]), pieces * entries * a["track_degrees"])
            and np.all((a["entry_i"] >= 0) & (a["entry_i"] < number))
            and np.all((a["entry_j"] >= -1) & (a["entry_j"] < number))
            and np.all(np.diff(a["sleeve_at"]) <= _SLEEVE_ROWS)
            and np.all(a["sleeve_passes"] | (np.diff(a["stretch_at"]) == 1))
        )  # fmt: skip
        if not sound:
            raise PinflexError("kernel: sleeves: tables that do not fit each other.")

    def _check_squares(self, sizes: Mapping[str, int]) -> None:
        """Each within the coordinates, and sums of squares that there are."""
        a, count = self.arrays, self.counts["squares"]
        summed = np.diff(a["sum_at"])
        sound = (
            np.all(a["square_eta"] >= 0)
            and np.all(a["square_eta"] + np.diff(a["square_at"]) <= sizes["n_eta"])
            and np.all(a["sum_from"] >= 0) and np.all(a["sum_from"] + summed <= count)
            and np.all((a["g_rest"] >= a["g_at"][:-1]) & (a["g_rest"] <= a["g_at"][1:]))
        )  # fmt: skip
        if not sound:
            raise PinflexError("kernel: squares: sums of squares that are none.")


# Workspaces that no run uses now: most of what a short run costs is to make new ones.

_KEPT = 4  # of one kind: runs at the same time are few
_LARGEST = 1.6e7  # bytes: beside a run that fills a larger one, to make it costs nothing


class Spares:
    """Spare workspaces of one system, by kind; they travel to no other process."""

    def __init__(self) -> None:
        self._by_kind: dict[object, list[Any]] = {}

    def __reduce__(self) -> tuple[type[Spares], tuple[()]]:
        return Spares, ()

    def acquire(self, kind: object) -> Any:
        """A spare workspace, its caller's own from now on; None: there is none."""
        try:
            return self._by_kind[kind].pop()
        except (KeyError, IndexError):
            return None

    def release(self, kind: object, workspace: Any, size: float) -> None:
        """Keep a workspace that its owner no longer uses."""
        spare = self._by_kind.setdefault(kind, [])
        if size <= _LARGEST and len(spare) < _KEPT:
            spare.append(workspace)
