"""Functions of time and matrices that are smooth between corners, by Chebyshev points."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray

_CORNER_GAP = 1e-9  # of the whole: a piece ends just before its corner, where the motion may jump
_TRUSTED = 16  # intervals: coefficients of fewer may be small by chance
_MOST_FINER = 4  # times: what few nodes say of many is rough


class PiecewiseChebyshev:
    """Time from start to end (s), cut at the corners in between."""

    def __init__(self, start: float, end: float, corners: Sequence[float]) -> None:
        self.gap = _CORNER_GAP * (end - start)
        inside = [c for c in sorted(set(corners)) if start + self.gap < c < end - self.gap]
        self._ends = np.array([start, *inside, end])

    def __len__(self) -> int:
        return len(self._ends) - 1

    @property
    def corners(self) -> Array:
        """Times at which a piece ends and the next begins [s]."""
        return np.asarray(self._ends[1:-1])

    def of(self, t: Array) -> IntArray:
        """Numbers of the pieces that times lie in."""
        return np.asarray(np.searchsorted(self._ends[1:-1], t))

    def nodes(self, n: int) -> Array:
        """The n + 1 points of each piece, shape (pieces, n + 1); those of 2 n have them too."""
        x = 0.5 - 0.5 * np.cos(np.pi * np.arange(n + 1) / n)
        a, b = self._ends[:-1, None] + self.gap, self._ends[1:, None] - self.gap
        return np.asarray(a + (b - a) * x)

    def times(self, n: Sequence[int]) -> Array:
        """The n + 1 points of each piece, with an n of its own, one piece after the other."""
        return np.concatenate([self.nodes(m)[k] for k, m in enumerate(n)])

    def last_two(self, values: Array) -> Array:
        """What the last two Chebyshev polynomials of values (..., n + 1, width) are there."""
        n = values.shape[-2] - 1
        T = np.cos(np.pi * np.outer(np.arange(n + 1), np.arange(n + 1)) / n)  # T[k, j]: T_k there
        weight = np.where(np.arange(n + 1) % n, 1.0, 0.5)
        last = T[-2:] * np.array([[1.0], [0.5]])
        return np.asarray(last.T @ ((2.0 / n * weight * T[-2:]) @ values))

    def at_corner(self, t: Array) -> Array:
        """Which times are corners, ends included: there a piece may not have its value."""
        near = np.min(np.abs(t - self._ends[:, None]), axis=0) < 2.0 * self.gap
        return np.asarray(near)

    def between(self, values: Sequence[Array] | Array, t: Array, out: Array | None = None) -> Array:
        """Values at the nodes interpolated to times t, shape (len(t), width).

        Source: Berrut and Trefethen (2004), eq. 5.4: barycentric weights of Chebyshev points.
        """
        result = np.empty((len(t), values[0].shape[1])) if out is None else out
        piece = self.of(t)
        for k, at_nodes in enumerate(values):
            here = np.flatnonzero(piece == k)
            if not len(here):
                continue
            n = len(at_nodes) - 1
            sign = np.where(np.arange(n + 1) % 2, -1.0, 1.0)
            sign[[0, -1]] *= 0.5
            away = t[here, None] - self.nodes(n)[k]
            away[away == 0.0] = 1e-100  # at a node: its weight outweighs all others
            W = sign / away
            W /= W.sum(axis=1, keepdims=True)
            if here[-1] - here[0] + 1 == len(here):  # as times in order are
                np.matmul(W, at_nodes, out=result[here[0] : here[-1] + 1])
            else:
                result[here] = W @ at_nodes
        return result

    def refined(
        self,
        first: Sequence[Array],
        function: Callable[[Array], Array],
        missed: Callable[[Array], float],
        close: float,
        most: float,
        resting: Collection[int] = (),
    ) -> tuple[list[Array], float]:
        """A function of time at as many nodes of each piece as interpolate it closely.

        Between corners Chebyshev coefficients fall geometrically: the last two say how many are
        needed, and hold ten to a hundred times what is missed (measured).

        Returns:
            Values at the nodes of each piece, (n + 1, width) each, and an estimate of what they
            miss at most.
        """
        values = [*first]
        trusted = {k for k, x in enumerate(first) if k in resting or len(x) > _TRUSTED}
        while True:
            tail = [missed(self.last_two(x)) for x in values]
            coarse = [k for k, e in enumerate(tail) if e >= close or k not in trusted]
            fixed = sum(len(x) for k, x in enumerate(values) if k not in coarse)
            finer = {k: _multiple(tail[k], close) for k in coarse}
            for times in (finer, dict.fromkeys(coarse, 2)):
                count = fixed + sum(m * (len(values[k]) - 1) + 1 for k, m in times.items())
                if count <= most:
                    break
            else:
                return values, max(tail)
            if not coarse:
                return values, max(tail)
            self._refine(function, values, times)
            trusted.update(coarse)

    def _refine(
        self, function: Callable[[Array], Array], values: list[Array], finer: Mapping[int, int]
    ) -> None:
        """Values of some pieces at so many times their nodes; known ones are used again."""
        known = {k: np.arange(m * (len(values[k]) - 1) + 1) % m == 0 for k, m in finer.items()}
        times = [self.nodes(len(at) - 1)[k, ~at] for k, at in known.items()]
        new = np.split(function(np.concatenate(times)), np.cumsum([len(t) for t in times])[:-1])
        for (k, at), between in zip(known.items(), new, strict=True):
            both = np.empty((len(at), between.shape[1]))
            both[at], both[~at] = values[k], between
            values[k] = both


def _multiple(tail: float, close: float) -> int:
    """Times as many intervals whose last coefficients are `close`, if they go on to fall alike."""
    needed = np.log(close) / np.log(min(max(tail, 1e-300), 0.9))
    return int(np.clip(np.ceil(needed), 2, _MOST_FINER))


class Interpolation:
    """Values at every step from those at the nodes of each piece, and at steps on corners.

    Attributes:
        n: Intervals between the nodes of each piece.
        first: Number of the first node of each piece; `nodes`: of all of them.
        times: Where values are needed (s): all nodes, then the steps on corners, shape (size,).
    """

    def __init__(self, pieces: PiecewiseChebyshev, n: int | Sequence[int], t: Array) -> None:
        """Nodes and corners."""
        self.pieces, self.t = pieces, t
        self.n = np.broadcast_to(np.asarray(n), len(pieces))
        self.first = np.concatenate([[0], np.cumsum(self.n + 1)[:-1]])
        self.nodes = int(np.sum(self.n + 1))
        self.corners = np.flatnonzero(pieces.at_corner(t))
        self.piece = pieces.of(t)
        self.times = np.concatenate([pieces.times(self.n.tolist()), t[self.corners]])

    def between(
        self, values: Array, at: slice | IntArray = slice(None), out: Array | None = None
    ) -> Array:
        """Values at steps."""
        flat = values.reshape(len(values), -1)
        steps = np.arange(len(self.t))[at]
        result = self.pieces.between(self.by_piece(flat), self.t[steps], out)
        for row, k in zip(flat[self.nodes :], self.corners, strict=True):
            result[steps == k] = row
        return result.reshape(len(result), *values.shape[1:])

    def by_piece(self, values: Array) -> list[Array]:
        """Values at the nodes of each piece, (n + 1, ...) each, of values at `times`."""
        return np.split(values[: self.nodes], self.first[1:].tolist())


# A matrix along a path: its constant entries once, and the varying ones at every node.
#
# Some six sevenths of the linear system of a mechanism are constant; stored in full at every node
# it would take hundreds of megabytes for some ten coordinates a link, and touching them takes
# longer than the marches that use them.

NOISE = 1e-12  # of the largest entry of a matrix: round-off of what is constant


@dataclass(frozen=True)
class Varying:
    """A matrix, or a vector, at the nodes of an interpolation.

    Attributes:
        constant: At the first node, any shape.
        entries: Flat numbers of those that vary, ascending, shape (m,).
        values: Of them at the nodes, shape (size, m).
    """

    constant: Array
    entries: IntArray
    values: Array

    def __len__(self) -> int:
        return len(self.values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the matrix."""
        return self.constant.shape

    @cached_property
    def noise(self) -> float:
        """Changes up to which an entry counts as constant."""
        sizes = (float(np.max(np.abs(x), initial=0.0)) for x in (self.constant, self.values))
        return NOISE * max(sizes)

    @cached_property
    def varies(self) -> BoolArray:
        """Which entries vary, in the shape of the matrix."""
        return self._numbers >= 0

    @cached_property
    def _numbers(self) -> IntArray:
        """Column of `values` of each entry, in the shape of the matrix; -1: it is constant."""
        column = np.full(self.constant.size, -1, dtype=np.intp)
        column[self.entries] = np.arange(len(self.entries))
        return column.reshape(self.shape)

    def whole(self) -> Array:
        """The matrix at every node, shape (size, ...)."""
        return self.filled(self.values)

    def along(self, grid: Interpolation, at: slice | IntArray = slice(None)) -> Array:
        """The matrix at steps, shape (steps, ...)."""
        return self.filled(grid.between(self.values, at))

    def filled(self, values: Array) -> Array:
        """The matrix from its varying entries, shape (k, m), as (k, ...)."""
        matrix = np.tile(self.constant.ravel(), (len(values), 1))
        matrix[:, self.entries] = values
        return matrix.reshape(len(values), *self.shape)

    def picked(self, *axes: IntArray) -> Varying:
        """Some rows, and columns where there are any, in their order."""
        block = np.ix_(*axes)
        numbers = self._numbers[block].ravel()
        entries = np.flatnonzero(numbers >= 0)
        return Varying(self.constant[block], entries, self.values[:, numbers[entries]])

    def entries_at(self, at: tuple[IntArray, ...]) -> Array:
        """Some entries at every node, shape (size, k)."""
        numbers = self._numbers[at]
        values = np.tile(self.constant[at], (len(self.values), 1))
        values[:, numbers >= 0] = self.values[:, numbers[numbers >= 0]]
        return values


def varying(x: Array) -> Varying:
    """A matrix that is known in full at every node, shape (size, ...)."""
    flat = x.reshape(len(x), -1)
    size = max(float(np.max(x, initial=0.0)), -float(np.min(x, initial=0.0)))
    entries = np.flatnonzero(np.ptp(flat, axis=0) > NOISE * size)
    return Varying(x[0].copy(), entries, flat[:, entries])
