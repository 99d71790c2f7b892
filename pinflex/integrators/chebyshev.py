"""Functions of time that are smooth between corners, by Chebyshev points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array, IntArray

_BESIDE = 1e-9  # of the whole: a piece ends just before its corner, where the motion may jump


class Pieces:
    """Time from start to end (s), cut at the corners in between."""

    def __init__(self, start: float, end: float, corners: Sequence[float]) -> None:
        self.beside = _BESIDE * (end - start)
        inside = [c for c in sorted(set(corners)) if start + self.beside < c < end - self.beside]
        self._ends = np.array([start, *inside, end])

    def __len__(self) -> int:
        return len(self._ends) - 1

    def of(self, t: Array) -> IntArray:
        """Numbers of the pieces that times lie in."""
        return np.asarray(np.searchsorted(self._ends[1:-1], t))

    def nodes(self, n: int) -> Array:
        """The n + 1 points of each piece, shape (pieces, n + 1); those of 2 n have them too."""
        x = 0.5 - 0.5 * np.cos(np.pi * np.arange(n + 1) / n)
        a, b = self._ends[:-1, None] + self.beside, self._ends[1:, None] - self.beside
        return np.asarray(a + (b - a) * x)

    def coarser(self, values: Array) -> Array:
        """Values at the nodes, (pieces, n + 1, width), without the last two Chebyshev polynomials.

        What a smooth function loses so is more than what its polynomial of degree n misses.
        """
        n = values.shape[1] - 1
        T = np.cos(np.pi * np.outer(np.arange(n + 1), np.arange(n + 1)) / n)  # T[k, j]: T_k there
        weight = np.where(np.arange(n + 1) % n, 1.0, 0.5)
        last = T[-2:] * np.array([[1.0], [0.5]])
        return np.asarray(values - last.T @ ((2.0 / n * weight * T[-2:]) @ values))

    def at_corner(self, t: Array) -> Array:
        """Which times are corners, ends included: there a piece may not have its value."""
        near = np.min(np.abs(t - self._ends[:, None]), axis=0) < 2.0 * self.beside
        return np.asarray(near)

    def between(self, values: Array, t: Array) -> Array:
        """Values at the nodes, (pieces, n + 1, width), interpolated to times t, (len(t), width).

        Source: Berrut and Trefethen (2004), eq. 5.4: barycentric weights of Chebyshev points.
        """
        n = values.shape[1] - 1
        sign = np.where(np.arange(n + 1) % 2, -1.0, 1.0)
        sign[[0, -1]] *= 0.5
        found = np.empty((len(t), values.shape[2]))
        piece = self.of(t)
        for k, at in enumerate(self.nodes(n)):
            here = piece == k
            away = t[here, None] - at
            away[away == 0.0] = 1e-100  # at a node: its weight outweighs all others
            W = sign / away
            found[here] = W @ values[k] / W.sum(axis=1, keepdims=True)
        return found
