"""A matrix along a path: its constant entries once, and the varying ones at every node.

Some six sevenths of the linear system of a mechanism are constant; stored in full at every node it
would take hundreds of megabytes for some ten coordinates a link, and touching them takes longer
than the marches that use them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.integrators.chebyshev import Interpolation

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


def together(parts: Sequence[Varying], grid: Interpolation, at: slice | IntArray) -> list[Array]:
    """Several matrices at steps, shape (steps, ...) each: one interpolation for all of them."""
    ends = np.cumsum([len(x.entries) for x in parts])
    values = np.split(grid.between(np.hstack([x.values for x in parts]), at), ends[:-1], axis=1)
    return [x.filled(each) for x, each in zip(parts, values, strict=True)]


def varying(x: Array) -> Varying:
    """A matrix that is known in full at every node, shape (size, ...)."""
    flat = x.reshape(len(x), -1)
    size = max(float(np.max(x, initial=0.0)), -float(np.min(x, initial=0.0)))
    entries = np.flatnonzero(np.ptp(flat, axis=0) > NOISE * size)
    return Varying(x[0].copy(), entries, flat[:, entries])
