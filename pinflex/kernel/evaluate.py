"""The compiled functions on numpy arrays."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.errors import PinflexError
from pinflex.kernel.library import constant, kernel, names, shapes, structure

# Flat tables of one system, as the C code reads them: sizes and types checked here, once.
#
# The fields and their shapes are those of `Tables` in source/kernel.h, which says what they hold.

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
    "added_node": "nodes", "added_force": "forces", "bent_first": "n_eta", "bent_directions": 3,
    "force_node": "nodes", "spring_a": "nodes", "spring_b": "nodes",
    "joint_spring_v": "nv", "joint_spring_q": "nq", "rub_v": "nv", "k_j": "n_eta", "d_j": "nv",
    "block_of": "blocks", "block_order": "blocks", "block_above": "blocks", "node_block": "blocks",
    "row_a": 3, "row_b": 3, "kind": 7, "row_kind": 3,
    "sleeve_node": "nodes", "stretch_node": "nodes", "stretch_track": "tracks",
    "sleeve_loop": "loops", "sleeve_row": "closures", "sleeve_sort": 7, "sleeve_axis": 3,
    "entry_row": 8, "kink_v": "nv", "kink_q": "nq", "spring_kink": "kinks",
}  # fmt: skip
_SLEEVE_ROWS = constant("MOST_SLEEVE_ROWS")
_BASE = {"parent", "point_node", "twist_node", "node_a", "node_b", "force_node", "added_node",
         "added_force", "spring_a", "spring_b", "sleeve_node", "stretch_node",
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
                wanted = math.prod(self._size(part, sizes) for part in shape)
                # What a system has none of is not given: no entries, or where none begin.
                starts = wanted == 1 and str(shape[0]).endswith("+1")
                given = arrays[name] if wanted > starts else arrays.get(name, np.zeros(wanted))
                self.arrays[name] = array = np.ascontiguousarray(given, dtype=dtype)
                if array.size != wanted:
                    raise PinflexError(f"kernel: {name}: {array.size} entries, not {wanted}.")
        self._check_indices(sizes)
        pointers = {name: array.ctypes.data for name, array in self.arrays.items()}
        self._structure = _Tables(**self.counts, **pointers)
        self.address = ctypes.addressof(self._structure)

    def __reduce__(self) -> tuple[type[Tables], tuple[Any, ...]]:
        """Addresses do not travel to another process: it makes its own."""
        return Tables, (self.counts, self.arrays)

    def replaced(self, numbers: Mapping[str, npt.ArrayLike]) -> Tables:
        """The same tables with other numbers; indices were checked."""
        found = Tables.__new__(Tables)
        found.counts, found.arrays = self.counts, dict(self.arrays)
        found._structure = _Tables.from_buffer_copy(self._structure)
        for name, given in numbers.items():
            found.arrays[name] = array = np.ascontiguousarray(given, dtype=np.float64)
            if name not in NUMBERS or array.size != self.arrays[name].size:
                raise PinflexError(f"kernel: {name}: {array.size} entries of other numbers.")
            setattr(found._structure, name, array.ctypes.data)
        found.address = ctypes.addressof(found._structure)
        return found

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
        if self.counts["sleeves"]:
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


_ALIGNED = 64  # bytes
_SIZES = 64  # numbers of states whose buffers are kept


class _Buffers:
    """Arrays that the C code reads and writes, for n states: their addresses are found once.

    Attributes:
        given: Y, V, A, lam and the scales of the loads. found: R and C.
        arguments: What the C function is called with.
    """

    def __init__(self, n: int, widths: tuple[int, ...], tables: int, work: int) -> None:
        self.given = tuple(np.empty((n, width)) for width in widths)
        self.found = tuple(np.empty((n, width)) for width in (widths[1], widths[3]))
        pointers = (x.ctypes.data for x in (*self.given, *self.found))
        self.arguments = (tables, work, n, *pointers)


class Evaluator:
    """One system on the kernel, with a workspace of its own (one for each thread).

    Attributes:
        tables: The system. functions: The C code. work: Address of the workspace.
    """

    def __init__(self, tables: Tables) -> None:
        """Raises a PinflexError where there is no kernel."""
        library = kernel()
        if library.functions is None:
            raise PinflexError(f"kernel: {library.said}.")
        self.functions, self.tables = library.functions, tables
        n = tables.counts
        self._widths = (n["nq"], n["nv"], n["nv"], n["closures"], n["forces"])
        self._work = aligned(self.functions.pinflex_work_size(tables.address))
        self.work: int = self._work.ctypes.data
        self._buffers: dict[int, _Buffers] = {}

    def residuals(
        self, Y: Array, V: Array, A: Array, lam: Array, scale: Array
    ) -> tuple[Array, Array]:
        """Residuals and what the loops are open by, of several states.

        Returns:
            Generalised forces (n, nv), N | N m; closures c (n, rows), m.
        """
        here = self._buffers.get(len(Y)) or self._new(len(Y))
        for buffer, array in zip(here.given, (Y, V, A, lam, scale), strict=True):
            if array.shape != buffer.shape:
                raise PinflexError(f"kernel: a state of {array.shape}, not {buffer.shape}.")
            buffer[...] = array
        self.functions.pinflex_residuals(*here.arguments)
        R, C = here.found
        return R.copy(), C.copy()

    def closure_motion(self, Y: Array, V: Array, A: Array) -> Array:
        """Closures of several states, and their first and second time derivatives, (3, n, rows)."""
        given = []
        for array, width in zip((Y, V, A), self._widths[:3], strict=True):
            if array.shape != (len(Y), width):
                raise PinflexError(f"kernel: a state of {array.shape}, not {(len(Y), width)}.")
            given.append(np.ascontiguousarray(array, dtype=np.float64))
        found = np.empty((3, len(Y), self._widths[3]))
        pointers = [x.ctypes.data for x in (*given, *found)]
        self.functions.pinflex_closure_motion(self.tables.address, self.work, len(Y), *pointers)
        return found

    def losses(self, Y: Array, V: Array) -> Array:
        """Power that damping, friction and dampers take, shape (n,), W."""
        given = [np.ascontiguousarray(array, dtype=np.float64) for array in (Y, V)]
        if any(x.shape != (len(Y), n) for x, n in zip(given, self._widths[:2], strict=True)):
            raise PinflexError(f"kernel: states of {Y.shape}, not {(len(Y), self._widths[0])}.")
        power = np.empty(len(Y))
        pointers = [x.ctypes.data for x in (*given, power)]
        self.functions.pinflex_losses(self.tables.address, self.work, len(Y), *pointers)
        return power

    def closures(self, Y: Array) -> tuple[Array, Array]:
        """Closures (n, rows) and their Jacobians (n, rows, nv) at poses Y (n, nq)."""
        Y, (nq, nv, _, rows, _) = np.ascontiguousarray(Y, dtype=np.float64), self._widths
        if Y.ndim != 2 or Y.shape[1] != nq:
            raise PinflexError(f"kernel: closures of {Y.shape}, not (n, {nq}).")
        c, J = np.empty((len(Y), rows)), np.empty((len(Y), rows, nv))
        given = self.tables.address, self.work, len(Y), Y.ctypes.data
        self.functions.pinflex_closures(*given, c.ctypes.data, J.ctypes.data)
        return c, J

    def sleeves(self, Y: Array) -> Array:
        """Where the sleeves are on their links at poses Y (n, nq), shape (n, sleeves), m."""
        Y = np.ascontiguousarray(Y, dtype=np.float64)
        if Y.ndim != 2 or Y.shape[1] != self._widths[0]:
            raise PinflexError(f"kernel: sleeves at {Y.shape}, not (n, {self._widths[0]}).")
        out = np.empty((len(Y), self.tables.counts["sleeves"]))
        given = self.tables.address, self.work, len(Y), Y.ctypes.data
        self.functions.pinflex_sleeves(*given, out.ctypes.data)
        return out

    def elongations(self, Y: Array) -> Array:
        """What laws of pieces are over, coordinates and springs, at Y (n, nq), shape (n, kinks)."""
        (Y,) = self._given((Y,))
        out = np.empty((len(Y), self.tables.counts["kinks"]))
        given = self.tables.address, self.work, len(Y), Y.ctypes.data
        self.functions.pinflex_elongations(*given, out.ctypes.data)
        return out

    def poses(self, Y: Array, nodes: npt.ArrayLike) -> Array:
        """Poses [R | p] of nodes in the world, m, shape (k, n, 3, 4)."""
        given, wanted = self._given((Y,)), self._nodes(nodes, -1)
        poses = np.empty((len(wanted), len(Y), 3, 4))
        self._call("poses", given, len(wanted), (wanted, poses))
        return poses

    def motions(self, Y: Array, V: Array, A: Array, nodes: npt.ArrayLike) -> tuple[Array, Array]:
        """Poses (k, n, 3, 4) of nodes, and spatial velocity and acceleration (k, n, 2, 6).

        Returns:
            Poses in the world; motions of the nodes' origins in their own axes.
        """
        given, wanted = self._given((Y, V, A)), self._nodes(nodes, -1)
        poses, rates = np.empty((len(wanted), len(Y), 3, 4)), np.empty((len(wanted), len(Y), 2, 6))
        self._call("motions", given, len(wanted), (wanted, poses, rates))
        return poses, rates

    def energies(self, Y: Array, V: Array, scale: Array) -> Array:
        """Kinetic, gravity, elastic and spring energy, J, shape (4, n)."""
        given, found = self._given((Y, V, scale), (0, 1, 4)), np.empty((4, len(Y)))
        self._call("energies", given, None, (found,))
        return found

    def forces(
        self, Y: Array, V: Array, A: Array, lam: Array, scale: Array, nodes: npt.ArrayLike
    ) -> tuple[Array, ...]:
        """Residuals and closures as `residuals`, and what joints, loops and sleeves carry.

        Returns:
            r (n, nv), c (n, rows), expanded forces (n, nV), wrenches of nodes in their own axes
            (n, k, 6), of loops on their B in the world (n, loops, 6), and (x, F, M, segment) of
            sleeves at three places (n, sleeves, 3, 8).
        """
        given, wanted, n = self._given((Y, V, A, lam, scale)), self._nodes(nodes, 0), len(Y)
        count = self.tables.counts
        shapes = ((count["nv"],), (count["closures"],), (count["nV"],), (len(wanted), 6),
                  (count["loops"], 6), (count["sleeves"], 3, 8))  # fmt: skip
        found = tuple(np.empty((n, *shape)) for shape in shapes)
        self._call("forces", given, len(wanted), (wanted, *found))
        return found

    def tangent(
        self, y: Array, v: Array, a: Array, lam: Array, scale: Array, rates: bool = True
    ) -> tuple[Array, Array, Array, Array]:
        """M, C, K, the derivatives of the residual by a, v and y, (nv, nv), and J (rows, nv)."""
        nv, rows, given = self._widths[1], self._widths[3], []
        for array, width in zip((y, v, a, lam, scale), self._widths, strict=True):
            if array.shape != (width,):
                raise PinflexError(f"kernel: a state of {array.shape}, not {(width,)}.")
            given.append(np.ascontiguousarray(array, dtype=np.float64))
        found = np.empty((3, nv, nv)), np.empty((rows, nv))
        parts = (*found[0], found[1])
        pointers = [x.ctypes.data for x in (*given, *parts)]
        self.functions.pinflex_tangent(self.tables.address, self.work, int(rates), *pointers)
        return parts

    def saddle(self, S: Array, b: Array) -> Array:
        """The solution x (n,) of S x = b, of least norm where S (n, n) is singular."""
        n = len(b)
        if S.shape != (n, n):
            raise PinflexError(f"kernel: a matrix of {S.shape} for {n} unknowns.")
        rooms = np.array(S, dtype=np.float64, order="F"), np.array(b, dtype=np.float64)
        order, x = np.empty(3 * n, dtype=np.int64), np.empty(n)
        arrays = (*rooms, np.empty((n, n + 1)), order, x)
        self.functions.pinflex_saddle(n, *(array.ctypes.data for array in arrays))
        return x

    def _given(self, arrays: Sequence[Array], which: Sequence[int] = range(5)) -> list[Array]:
        """States as the C code reads them; `which` of y, v, a, lam and scales they are."""
        given = [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]
        for array, k in zip(given, which, strict=False):
            if array.shape != (len(given[0]), self._widths[k]):
                raise PinflexError(f"kernel: a state of {array.shape}, not (n, {self._widths[k]}).")
        return given

    def _nodes(self, nodes: npt.ArrayLike, first: int) -> IntArray:
        wanted = np.ascontiguousarray(nodes, dtype=np.int64)
        if np.any(wanted < first) or np.any(wanted >= self.tables.counts["nodes"]):
            raise PinflexError(f"kernel: {wanted}: a node that is none.")
        return wanted

    def _call(
        self,
        name: str,
        given: Sequence[Array],
        wanted: int | None,
        rest: Sequence[npt.NDArray[Any]],
    ) -> None:
        """The C function of a name on states, with a number of nodes where it takes some."""
        count = () if wanted is None else (wanted,)
        pointers = [[x.ctypes.data for x in arrays] for arrays in (given, rest)]
        function = getattr(self.functions, f"pinflex_{name}")
        function(self.tables.address, self.work, len(given[0]), *pointers[0], *count, *pointers[1])

    def _new(self, n: int) -> _Buffers:
        if len(self._buffers) >= _SIZES:
            self._buffers.clear()
        found = _Buffers(n, self._widths, self.tables.address, self.work)
        self._buffers[n] = found
        return found


def aligned(size: int) -> Array:
    """Zeros of `size` bytes that start at a multiple of 64."""
    raw = np.zeros(size // 8 + _ALIGNED // 8 + 1)
    first = (-raw.ctypes.data % _ALIGNED) // 8
    return raw[first : first + size // 8 + 1]


# Linear systems on closures, evaluated along a motion and marched by compiled code.
#
# The fields are those of `Linear` in source/linear_march.c, which says what they hold.

_Linear = structure("Linear")
_OF_METHOD = ("mass_factor", "beta", "gamma", "alpha_m", "alpha_f")


@dataclass(frozen=True)
class ConstantPart:
    """Constant entries of S, C, K and J, and masks of the varying ones.

    Attributes:
        S, C, K: Shape (n, n), zero where entries vary.
        J: Likewise, shape (rows, n).
        varies: Entries of S, C and K that vary, shape (n, n).
        J_varies: Those of J, shape (rows, n).
    """

    S: Array
    C: Array
    K: Array
    J: Array
    varies: BoolArray
    J_varies: BoolArray

    @property
    def width(self) -> int:
        """Number of values of one system."""
        return int(3 * np.sum(self.varies) + np.sum(self.J_varies))


def entries_of(
    matrices: str, nv: int, closures: int, rows: IntArray, columns: IntArray
) -> IntArray:
    """Where some rows and columns are in M, C, K and J, as `linear_systems` counts entries."""
    square = (rows[:, None] * nv + columns).ravel()
    J = 3 * nv**2 + (np.arange(closures)[:, None] * nv + rows).ravel()
    where = {"M": square, "C": square + nv**2, "K": square + 2 * nv**2, "J": J}
    return np.concatenate([where[matrix] for matrix in matrices])


def linear_systems(
    evaluator: Evaluator, states: Sequence[Array], at: IntArray, out: Array, rates: bool = True
) -> None:
    """Entries of M, C, K (nv, nv) and J (closures, nv) at several states."""
    n = evaluator.tables.counts
    widths = n["nq"], n["nv"], n["nv"], n["closures"], n["forces"]
    arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in states]
    size = n["nv"] * (3 * n["nv"] + n["closures"])
    if [x.shape for x in arrays] != [(len(out), width) for width in widths]:
        raise PinflexError(f"kernel: states of {[x.shape for x in arrays]}.")
    if not out.flags.c_contiguous or out.dtype != np.float64 or out.shape[1] < len(at):
        raise PinflexError("kernel: no room for the linear systems.")
    if len(at) and not 0 <= np.min(at) <= np.max(at) < size:
        raise PinflexError(f"kernel: an entry of a tangent of {size}.")
    numbers, room = np.ascontiguousarray(at, dtype=np.int64), np.empty(size)
    evaluator.functions.pinflex_linear_systems(
        evaluator.tables.address, evaluator.work, int(rates), len(out),
        *(x.ctypes.data for x in arrays), len(at), numbers.ctypes.data, room.ctypes.data,
        out.shape[1], out.ctypes.data,
    )  # fmt: skip


class LinearKernel:
    """March of systems that share their constant part; factors are kept once they are known.

    Attributes:
        state: d, v, a and the algorithmic acceleration that the next step starts from, (4, n).
    """

    def __init__(
        self,
        constant: ConstantPart,
        h: float,
        coefficients: tuple[float, ...],
        systems: int,
        kept: bool,
    ) -> None:
        """Nothing is factored yet."""
        library = kernel().functions
        if library is None:
            raise PinflexError(f"kernel: {kernel().said}.")
        self._functions, self._systems, self._width = library, systems, constant.width
        self.n, self.rows = constant.S.shape[0], constant.J.shape[0]
        size, rooms = self.n + self.rows, systems if kept else 1
        # Column by column, as the C code goes through them.
        col_at, row = _columns(constant.varies)
        J_col_at, J_row = _columns(constant.J_varies)
        self.state = np.zeros((4, self.n))
        self._arrays: dict[str, Array | IntArray] = {
            "col_at": col_at, "row": row, "J_col_at": J_col_at, "J_row": J_row,
            **{name: np.ascontiguousarray(getattr(constant, name).T) for name in "SJ"},
            **_sparse("C", constant.C), **_sparse("K", constant.K),
            "lu": np.empty(0 if kept else size * size),
            "pivot": np.zeros((rooms, size), np.int64),
            "holds": np.zeros(rooms, np.int64), "state": self.state,
            "work": np.zeros(size),
        }  # fmt: skip
        self._structure = _Linear(
            n=self.n, rows=self.rows, kept=int(kept), h=h,
            **dict(zip(_OF_METHOD, coefficients, strict=True)),
            **{name: array.ctypes.data for name, array in self._arrays.items()},
        )  # fmt: skip

    def forget(self) -> None:
        """Factors are those of other systems from here on."""
        self._arrays["holds"][:] = 0

    def use(self, room: Array) -> None:
        """Keep factors in `room`, (systems * (n + rows)^2,); none are there yet."""
        if room.size != self._systems * (self.n + self.rows) ** 2 or not room.flags.c_contiguous:
            raise PinflexError(f"kernel: {room.size} numbers for the factors.")
        self._arrays["lu"], self._structure.lu = room, room.ctypes.data
        self.forget()

    def march(
        self,
        system: IntArray,
        value: Array,
        load: Array,
        response: tuple[Array, Array, Array, Array],
    ) -> int:
        """Steps from `state` on; the number of those that were taken before a singular system."""
        count, n, rows = len(system), self.n, self.rows
        at = np.ascontiguousarray(system, dtype=np.int64)
        arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in (value, load)]
        if count and (np.min(at) < 0 or np.max(at) >= min(len(value), self._systems)):
            raise PinflexError("kernel: a step of a system that is not given.")
        if self._structure.kept and not self._arrays["lu"].size:
            raise PinflexError("kernel: no room for the factors.")
        shapes = (arrays[0].shape[1:], arrays[1].shape, *(x.shape for x in response))
        if shapes != ((self._width,), *((count, n),) * 4, (count, rows)):
            raise PinflexError(f"kernel: a march of {shapes}.")
        if not all(x.flags.c_contiguous and x.dtype == np.float64 for x in response):
            raise PinflexError("kernel: arrays that are not in one piece.")
        here = self._structure
        here.count, here.system = count, at.ctypes.data
        here.value, here.load = (x.ctypes.data for x in arrays)
        here.d, here.v, here.a, here.lam = (x.ctypes.data for x in response)
        return int(self._functions.pinflex_linear_march(ctypes.addressof(here)))


def _sparse(name: str, x: Array) -> dict[str, Array | IntArray]:
    """Entries of a matrix that are not zero, column by column."""
    at, row = _columns(x != 0.0)
    return {f"{name}_at": at, f"{name}_row": row, name: np.ascontiguousarray(x.T[x.T != 0.0])}


def _columns(varies: BoolArray) -> tuple[IntArray, IntArray]:
    """Where the entries of each column start, and their rows."""
    col, row = np.nonzero(varies.T)
    at = np.searchsorted(col, np.arange(varies.shape[1] + 1))
    return at.astype(np.int64), row.astype(np.int64)
