"""Functions of time that are smooth between corners, by Chebyshev points."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pinflex.arrays import Array, IntArray

_CORNER_GAP = 1e-9  # of the whole: a piece ends just before its corner, where the motion may jump


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

    def coarser(self, values: Array) -> Array:
        """Values at the nodes, (pieces, n + 1, width), without the last two Chebyshev polynomials.

        What a smooth function loses so is more than what its polynomial of degree n misses.
        """
        return values - self.last_two(values)

    def last_two(self, values: Array) -> Array:
        """What the last two Chebyshev polynomials of values (pieces, n + 1, width) are there."""
        n = values.shape[1] - 1
        T = np.cos(np.pi * np.outer(np.arange(n + 1), np.arange(n + 1)) / n)  # T[k, j]: T_k there
        weight = np.where(np.arange(n + 1) % n, 1.0, 0.5)
        last = T[-2:] * np.array([[1.0], [0.5]])
        return np.asarray(last.T @ ((2.0 / n * weight * T[-2:]) @ values))

    def at_corner(self, t: Array) -> Array:
        """Which times are corners, ends included: there a piece may not have its value."""
        near = np.min(np.abs(t - self._ends[:, None]), axis=0) < 2.0 * self.gap
        return np.asarray(near)

    def between(self, values: Array, t: Array, out: Array | None = None) -> Array:
        """Values at the nodes, (pieces, n + 1, width), interpolated to times t, (len(t), width).

        Args:
            values: At the nodes, shape (pieces, n + 1, width).
            t: Times [s], shape (nt,).
            out: Where they are put; None: somewhere new.
        Source: Berrut and Trefethen (2004), eq. 5.4: barycentric weights of Chebyshev points.
        """
        n = values.shape[1] - 1
        sign = np.where(np.arange(n + 1) % 2, -1.0, 1.0)
        sign[[0, -1]] *= 0.5
        found = np.empty((len(t), values.shape[2])) if out is None else out
        piece = self.of(t)
        for k, at in enumerate(self.nodes(n)):
            here = np.flatnonzero(piece == k)
            if not len(here):
                continue
            away = t[here, None] - at
            away[away == 0.0] = 1e-100  # at a node: its weight outweighs all others
            W = sign / away
            W /= W.sum(axis=1, keepdims=True)
            if here[-1] - here[0] + 1 == len(here):  # as times in order are
                np.matmul(W, values[k], out=found[here[0] : here[-1] + 1])
            else:
                found[here] = W @ values[k]
        return found

    def refined(
        self,
        function: Callable[[Array], Array],
        relative: Callable[[Array, Array], float],
        n: int,
        close: float,
        most: float,
        largest: float,
    ) -> tuple[Array, float]:
        """A function of time at as many nodes as interpolate it closely.

        Between corners the error falls like r^n: what half of the nodes miss is about the square
        root of what all miss. That alone is an estimate, so the last two polynomials have to be
        small too: what they hold is ten to a hundred times what is missed (measured).

        Args:
            function: Of times (k,): values (k, width).
            relative: A miss as one number, from misses and values, (..., width) each.
            n: Intervals between the nodes of a piece to begin with; doubled.
            close: What may be missed.
            most: Nodes, beyond which the last are taken as they are.
            largest: Most numbers to hold.
        Returns:
            Values at the nodes, (pieces, n + 1, width), and an estimate of what they miss.
        """
        values = function(self.nodes(n).ravel()).reshape(len(self), n + 1, -1)
        missed = relative(self.last_two(values), values)
        while len(self) * (2 * n + 1) < most and 2 * values.size <= largest:
            n *= 2
            times, known = self.nodes(n)[:, 1::2].ravel(), values
            new = function(times)
            values = np.empty((len(self), n + 1, known.shape[2]))
            values[:, ::2], values[:, 1::2] = known, new.reshape(len(self), -1, new.shape[1])
            missed = relative(self.between(known, times) - new, values)
            if close <= missed <= 0.1 * close**0.5:
                missed = relative(self.last_two(values), values)
            if missed < close:
                break
        return values, missed


class Interpolation:
    """Values at every step from those at the nodes of each piece, and at steps on corners.

    Attributes:
        times: Where values are needed (s): all nodes, then the steps on corners, shape (size,).
    """

    def __init__(self, pieces: PiecewiseChebyshev, n: int, t: Array) -> None:
        """Nodes and corners.

        Args:
            pieces: Time between corners.
            n: Intervals between the nodes of a piece.
            t: Steps (s), shape (nt,).
        """
        self.pieces, self.n, self.t = pieces, n, t
        self.corners = np.flatnonzero(pieces.at_corner(t))
        self.piece = pieces.of(t)
        self.nodes = len(pieces) * (n + 1)
        self.times = np.concatenate([pieces.nodes(n).ravel(), t[self.corners]])

    def between(
        self, values: Array, at: slice | IntArray = slice(None), out: Array | None = None
    ) -> Array:
        """Values at steps.

        Args:
            values: At `times`, shape (size, ...).
            at: Steps that are wanted.
            out: Where they are put, shape (len(at), width); None: somewhere new.
        """
        flat = values.reshape(len(values), -1)
        steps = np.arange(len(self.t))[at]
        nodes = flat[: self.nodes].reshape(len(self.pieces), self.n + 1, -1)
        found = self.pieces.between(nodes, self.t[steps], out)
        for row, k in zip(flat[self.nodes :], self.corners, strict=True):
            found[steps == k] = row
        return found.reshape(len(found), *values.shape[1:])
