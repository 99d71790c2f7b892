"""Linear systems on closures, evaluated along a motion and marched by compiled code.

The fields are those of `Linear` in source/linear_march.c, which says what they hold.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.errors import PinflexError
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.header import structure
from pinflex.kernel.library import kernel

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
