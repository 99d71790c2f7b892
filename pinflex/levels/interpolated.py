"""The linear system at a step, and off polynomials at every step of a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.arrays import Array, BoolArray
from pinflex.integrators.chebyshev import Interpolation
from pinflex.integrators.linear import Instant

_BATCH = 32  # steps that are interpolated at a time
STILL = 1e-12  # of the largest entry of a matrix: round-off of what does not change


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
        values: The system at `grid.times`, packed, shape (size, width).
        missed: Estimate of what interpolation misses, of the largest entry of each matrix.
    """

    def __init__(
        self, grid: Interpolation, values: Array, like: LinearStep, missed: float = 0.0
    ) -> None:
        """Polynomials of the entries that change.

        Args:
            grid: Times of the values.
            values: Packed systems, shape (size, width).
            like: One of them, for its shapes.
            missed: Estimate of what interpolation misses.
        """
        self.grid, self.values, self.missed = grid, values, missed
        self._shapes, self._cuts = [x.shape for x in like.packed()], _cuts(like)
        self._piece, self._corners = grid.piece.tolist(), set(grid.corners.tolist())
        self._chunks: dict[int, Array] = {}
        self._last: tuple[int, LinearStep] | None = None

    @cached_property
    def _round_off(self) -> Array:
        return STILL * np.concatenate([
            np.full(x.shape[1], np.max(np.abs(x), initial=0.0))
            for x in np.split(self.values, self._cuts, 1)
        ])  # fmt: skip

    @cached_property
    def _moves(self) -> BoolArray:
        """Numbers that change, shape (width,)."""
        return np.asarray(np.ptp(self.values, axis=0) > self._round_off)

    @cached_property
    def _moving(self) -> Array:
        return np.ascontiguousarray(self.values[:, self._moves])

    @cached_property
    def _resting(self) -> dict[int, LinearStep]:
        """The system of each piece in which nothing changes."""
        grid = self.grid
        nodes = self._moving[: grid.nodes].reshape(len(grid.pieces), grid.n + 1, -1)
        resting = np.all(np.ptp(nodes, axis=1) <= self._round_off[self._moves], axis=1)
        first = {int(p): int(p) * (grid.n + 1) for p in np.flatnonzero(resting)}
        return {p: self._step(self.values[k]) for p, k in first.items()}

    def at(self, k: int) -> LinearStep:
        """The step k; a march asks for one, and then who reads its forces for the same."""
        if self._last is None or self._last[0] != k:
            self._last = k, self._at(k)
        return self._last[1]

    @property
    def count(self) -> int:
        """Number of steps."""
        return len(self.grid.t)

    def parts(self) -> list[Array]:
        """Every array of the stored systems, (size, ...) each, in the order of `packed`."""
        split = np.split(self.values, self._cuts, 1)
        return [x.reshape(len(x), *shape) for x, shape in zip(split, self._shapes, strict=True)]

    def _at(self, k: int) -> LinearStep:
        if k not in self._corners and self._piece[k] in self._resting:
            return self._resting[self._piece[k]]
        number = k // _BATCH
        if number not in self._chunks:
            if len(self._chunks) > 1:
                self._chunks.pop(min(self._chunks, key=lambda j: -abs(j - number)))
            at = slice(number * _BATCH, min((number + 1) * _BATCH, len(self.grid.t)))
            rows = np.tile(self.values[0], (at.stop - at.start, 1))
            rows[:, self._moves] = self.grid.between(self._moving, at)
            self._chunks[number] = rows
        return self._step(self._chunks[number][k % _BATCH])

    def _step(self, row: Array) -> LinearStep:
        split = np.split(row, self._cuts)
        x = [part.reshape(shape) for part, shape in zip(split, self._shapes, strict=True)]
        parts = [Instant(*x[k : k + 5]) for k in range(0, len(x) - 1, 5)]
        return LinearStep(tuple(parts), x[-1])


def stacked_path(grid: Interpolation, parts: Sequence[Array]) -> InterpolatedPath:
    """A path of systems in one choice of rows that are at hand.

    Args:
        grid: Their times.
        parts: M, C, K (size, n, n), r (size, n), J (size, rows, n), base (size, rows).
    """
    like = LinearStep((Instant(*(x[0] for x in parts[:5])),), parts[5][0])
    return InterpolatedPath(grid, np.hstack([x.reshape(len(x), -1) for x in parts]), like)


def pack(step: LinearStep) -> Array:
    """Every number of a system, in one row."""
    return np.concatenate([x.ravel() for x in step.packed()])


def _cuts(step: LinearStep) -> list[int]:
    return [int(c) for c in np.cumsum([x.size for x in step.packed()])[:-1]]
