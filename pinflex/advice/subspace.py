"""The linear system along a motion in fewer shapes: other bodies' shapes in those of a system."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, IntArray
from pinflex.integrators.chebyshev import Interpolation, Varying, varying
from pinflex.integrators.collocation import generalized_alpha
from pinflex.levels.linear_march import LinearMarch, Response, RunningMarch, Workspace
from pinflex.linalg import independent_rows, saddle
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.system import System

_DEPENDENT = 1e-6  # of the largest: singular values below it close nothing
_ROUND_OFF = 1e-11  # of combinations of functions; seen: 1e-13


class Subspace:
    """The system in the columns of B.

    Attributes:
        B: Shape (nv, k).
        rows: Closures that are independent there.
    """

    def __init__(
        self,
        grid: Interpolation,
        parts: Sequence[Varying],
        B: Array,
        h: float,
        workspace: Workspace,
    ) -> None:
        """Matrices in the columns of B."""
        self.B, self._grid = B, grid
        self._row, self._still = _picked(B), np.zeros(B.shape[1])
        J = _in_columns(parts[3], B, False)
        self.rows = np.sort(independent_rows(J.constant, 1e-9))
        M, C, K = (_in_columns(x, B, True) for x in parts[:3])
        self._M, self._K, self._J = M, K, J
        every = np.arange(len(M.constant))
        system = M, C, K, J.picked(self.rows, every)
        self._march = LinearMarch(generalized_alpha(0.8), grid, system, h, workspace)

    def begin(self) -> RunningMarch:
        """One of some marches that go on side by side."""
        return self._march.begin()

    def windows(self) -> Iterator[slice]:
        """Steps that are taken at a time."""
        return self._march.windows()

    def go(self, march: RunningMarch, s: slice, load: Array, rest: Array | None = None) -> Response:
        """What a march finds in a window, in all coordinates and rows of J."""
        start = self._still
        if rest is not None and s.start == 0:
            now = self._march.instant(0, self._still)
            start, _ = saddle(now.K, now.J, now.J, -self._narrow(rest), np.zeros(len(now.J)))
        march.go(s, self._narrow(load), start)
        d, v, a, lam = (x[s] for x in march.response)
        every = np.zeros((len(lam), self._J.shape[0]))
        every[:, self.rows] = lam
        return Response(self._wide(d), self._wide(v), self._wide(a), every)

    def _narrow(self, load: Array) -> Array:
        """In the columns of B, shape (..., k)."""
        return np.asarray(load @ self.B if self._row is None else load[..., self._row])

    def _wide(self, x: Array) -> Array:
        """In all coordinates, shape (..., nv)."""
        if self._row is None:
            return np.asarray(x @ self.B.T)
        found = np.zeros((*x.shape[:-1], len(self.B)))
        found[..., self._row] = x
        return found

    def closing(self, gaps: Array, s: slice, straight: Array | None) -> Array:
        """What closes loops, and its rates, shape (3, steps, nv)."""
        P = self._grid.between(self._closers, s) if straight is None else straight[s]
        moved = (P @ -gaps.transpose(1, 2, 0)).transpose(2, 0, 1)
        return np.asarray(moved @ self.B[:, : P.shape[1]].T)

    @cached_property
    def _closers(self) -> Array:
        """P with J P = 1, of least elastic (and some kinetic) energy, shape (size, k, rows)."""
        M, K, J = (x.whole() for x in (self._M, self._K, self._J))
        slow = (2 * np.pi / float(self._grid.t[-1])) ** 2
        A_J = np.linalg.solve(K + slow * M, J.transpose(0, 2, 1))
        return np.asarray(A_J @ np.linalg.pinv(J @ A_J, rcond=1e-10))


def pseudo_inverse(J: Array) -> tuple[Array, IntArray]:
    """Pseudo-inverses of Jacobians (size, rows, n), shape (size, n, rows), and their ranks."""
    U, sigma, V = np.linalg.svd(J, full_matrices=False)
    large = sigma > _DEPENDENT * np.max(sigma, axis=1, keepdims=True, initial=0.0)
    inverse = np.where(large, 1.0 / np.where(large, sigma, 1.0), 0.0)
    found = V.swapaxes(1, 2) @ (inverse[:, :, None] * U.swapaxes(1, 2))
    return found, np.count_nonzero(large, axis=1)


def _picked(B: Array) -> IntArray | None:
    """The coordinates that the columns of B are, as they mostly are; None: combinations."""
    row = np.argmax(B, axis=0)
    alone = np.count_nonzero(B) == B.shape[1] and np.all(B[row, np.arange(B.shape[1])] == 1.0)
    return row if alone else None


def _in_columns(x: Varying, B: Array, both: bool) -> Varying:
    """x B, or B' x B, of a matrix x with rows or columns of all coordinates."""
    row = _picked(B)
    if row is None:
        return varying(B.T @ x.whole() @ B if both else x.whole() @ B)
    return x.picked(row if both else np.arange(x.shape[0]), row)


def shapes_of(system: System, parts: Mapping[str, FlexiblePart]) -> Array:
    """Shapes of other bodies as columns in the coordinates of a system, shape (nv, k).

    Free rigid coordinates and elastic drives stay; a link that is not in `parts` is rigid. The
    functions of a smaller basis are combinations of those of a larger one: found by least squares
    at sections.
    """
    m = int(system.rigid.nv)
    kept = [*system.free[system.free < m], *(m + gear.eta for gear in system.expansion.drives)]
    columns = [np.eye(system.nv)[:, kept]]
    seen, known = dict[str, int](), dict[tuple[int, int], Array]()
    for slot in system.expansion.slots:
        place = seen.setdefault(slot.link, 0)
        seen[slot.link] += 1
        if slot.link not in parts:
            continue
        body = parts[slot.link].bodies[place]
        if body.solid is not None:
            T = np.eye(slot.body.n)
        else:
            pair = id(slot.body), id(body)  # links alike share theirs
            if pair not in known:
                x = np.linspace(0.0, body.length, 4 * slot.body.n + 2)[1:]
                large, small = (
                    b.fields(x)["deflection"].reshape(-1, b.n) for b in (slot.body, body)
                )
                known[pair] = _tidy(np.linalg.lstsq(large, small, rcond=None)[0])
            T = known[pair]
        part = np.zeros((system.nv, T.shape[1]))
        part[m:][slot.eta] = T
        columns.append(part)
    return np.hstack(columns)


def _tidy(T: npt.NDArray[np.floating]) -> Array:
    """Without the round-off of zeros and ones: most functions of a smaller basis are of both."""
    whole = np.rint(T)
    return np.asarray(np.where(np.abs(T - whole) < _ROUND_OFF, whole, T), dtype=float)
