"""The compiled functions on numpy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError
from pinflex.kernel.library import kernel
from pinflex.kernel.tables import Tables

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
