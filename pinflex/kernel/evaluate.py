"""The compiled functions on numpy arrays."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
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

        Args:
            Y: Shape (n, nq). V, A: Shape (n, nv). lam: Shape (n, rows), N | N m.
            scale: Shares of the loads that act, shape (n, forces).
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
        """Closures of several states, and their first and second time derivatives, (3, n, rows).

        Args:
            Y: Shape (n, nq). V, A: Shape (n, nv).
        """
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
        """Power that damping, friction and dampers take, shape (n,), W.

        Args:
            Y: Shape (n, nq). V: Shape (n, nv).
        """
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

    def poses(self, Y: Array, node: int) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and origins (n, 3), m, of a node in the world.

        Args:
            Y: Coordinates, shape (n, nq).
            node: Number in the tree of the kernel.
        """
        Y, out = np.ascontiguousarray(Y, dtype=np.float64), np.empty((len(Y), 12))
        if Y.ndim != 2 or Y.shape[1] != self._widths[0]:
            raise PinflexError(f"kernel: poses of {Y.shape}, not (n, {self._widths[0]}).")
        if not 0 <= node < self.tables.counts["nodes"]:
            raise PinflexError(f"kernel: {node}: a node that is none.")
        given = self.tables.address, self.work, len(Y), Y.ctypes.data
        self.functions.pinflex_poses(*given, node, out.ctypes.data)
        return out[:, :9].reshape(-1, 3, 3), out[:, 9:]

    def tangent(
        self, y: Array, v: Array, a: Array, lam: Array, scale: Array, rates: bool = True
    ) -> tuple[Array, Array, Array, Array]:
        """M, C, K, the derivatives of the residual by a, v and y, (nv, nv), and J (rows, nv).

        Args:
            y: Shape (nq,). v, a: Shape (nv,). lam: Shape (rows,), N | N m.
            scale: Shares of the loads that act, shape (forces,).
            rates: With what the rates of the second-order rows bring.
        """
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
        """The solution x (n,) of S x = b, of least norm where S (n, n) is singular.

        Args:
            S: Symmetric, shape (n, n). b: Shape (n,).
        """
        n = len(b)
        if S.shape != (n, n):
            raise PinflexError(f"kernel: a matrix of {S.shape} for {n} unknowns.")
        rooms = np.array(S, dtype=np.float64, order="F"), np.array(b, dtype=np.float64)
        order, x = np.empty(3 * n, dtype=np.int64), np.empty(n)
        arrays = (*rooms, np.empty((n, n + 1)), order, x)
        self.functions.pinflex_saddle(n, *(array.ctypes.data for array in arrays))
        return x

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
