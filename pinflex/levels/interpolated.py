"""The linear system at a step, and off polynomials at every step of a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.integrators.chebyshev import Interpolation
from pinflex.integrators.linear import Instant
from pinflex.levels.varying import Varying

_BATCH = 32  # steps that are interpolated at a time


@dataclass(frozen=True)
class LinearStep:
    """The linear system at one time.

    Attributes:
        parts: M, C, K, r and J in the rows and columns that were asked for, one for each choice of
            rows (rows of a motor have J' as the others).
        base: Multipliers of the rigid motion, shape (rows,).
    """

    parts: tuple[Instant, ...]
    base: Array

    @property
    def free(self) -> Instant:
        """Rows of the free coordinates, by the free ones."""
        return self.parts[0]

    @property
    def motors(self) -> Instant:
        """Rows of the motors, by the free coordinates."""
        return self.parts[1]

    def packed(self) -> list[Array]:
        """Every array, in one order."""
        return [x for s in self.parts for x in (s.M, s.C, s.K, s.r, s.J)] + [self.base]


class InterpolatedPath:
    """The system off polynomials, at any step.

    Steps of a piece in which nothing changes are one object: a march keeps its factors there.

    Attributes:
        grid: Where the values are, and how they serve the steps.
        parts: Every array of the systems, in the order of `LinearStep.packed`.
        missed: Estimate of what interpolation misses, of the largest entry of each matrix.
    """

    def __init__(self, grid: Interpolation, parts: Sequence[Varying], missed: float = 0.0) -> None:
        """Polynomials of the entries that change.

        Args:
            grid: Times of the values.
            parts: M, C, K, r and J in some rows, perhaps of some more; then base.
            missed: Estimate of what interpolation misses.
        """
        self.grid, self.parts, self.missed = grid, list(parts), missed
        self._shapes = [x.shape for x in parts]
        ends = np.cumsum([x.still.size for x in parts])
        self._cuts, self._starts = ends[:-1].tolist(), [0, *ends[:-1].tolist()]
        self._piece, self._corners = grid.piece.tolist(), set(grid.corners.tolist())
        self._chunks: dict[int, Array] = {}
        self._last: tuple[int, LinearStep] | None = None

    @cached_property
    def _still(self) -> Array:
        return np.concatenate([x.still.ravel() for x in self.parts])

    @cached_property
    def _columns(self) -> IntArray:
        """Numbers that change."""
        pairs = zip(self._starts, self.parts, strict=True)
        return np.concatenate([start + x.entries for start, x in pairs])

    @cached_property
    def _moving(self) -> Array:
        return np.hstack([x.values for x in self.parts])

    @cached_property
    def _resting(self) -> dict[int, LinearStep]:
        """The system of each piece in which nothing changes."""
        grid = self.grid
        small = np.concatenate([np.full(len(x.entries), x.small) for x in self.parts])
        nodes = self._moving[: grid.nodes].reshape(len(grid.pieces), grid.n + 1, -1)
        resting = np.all(np.ptp(nodes, axis=1) <= small, axis=1)
        first = {int(p): int(p) * (grid.n + 1) for p in np.flatnonzero(resting)}
        return {p: self._step(self._rows(self._moving[k : k + 1])[0]) for p, k in first.items()}

    def _rows(self, moving: Array) -> Array:
        """Systems, a row each, from the numbers that change."""
        rows = np.tile(self._still, (len(moving), 1))
        rows[:, self._columns] = moving
        return rows

    def at(self, k: int) -> LinearStep:
        """The step k; a march asks for one, and then who reads its forces for the same."""
        if self._last is None or self._last[0] != k:
            self._last = k, self._at(k)
        return self._last[1]

    @property
    def count(self) -> int:
        """Number of steps."""
        return len(self.grid.t)

    def _at(self, k: int) -> LinearStep:
        if k not in self._corners and self._piece[k] in self._resting:
            return self._resting[self._piece[k]]
        number = k // _BATCH
        if number not in self._chunks:
            if len(self._chunks) > 1:
                self._chunks.pop(min(self._chunks, key=lambda j: -abs(j - number)))
            at = slice(number * _BATCH, min((number + 1) * _BATCH, len(self.grid.t)))
            self._chunks[number] = self._rows(self.grid.between(self._moving, at))
        return self._step(self._chunks[number][k % _BATCH])

    def _step(self, row: Array) -> LinearStep:
        split = np.split(row, self._cuts)
        x = [part.reshape(shape) for part, shape in zip(split, self._shapes, strict=True)]
        parts = [Instant(*x[k : k + 5]) for k in range(0, len(x) - 1, 5)]
        return LinearStep(tuple(parts), x[-1])


def pack(step: LinearStep) -> Array:
    """Every number of a system, in one row."""
    return np.concatenate([x.ravel() for x in step.packed()])
