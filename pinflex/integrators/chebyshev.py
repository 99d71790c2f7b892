"""Functions of time that are smooth between corners, by Chebyshev points."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from pinflex.arrays import Array, IntArray

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

    def coarser(self, values: Array) -> Array:
        """Values at the nodes, (pieces, n + 1, width), without the last two Chebyshev polynomials.

        What a smooth function loses so is more than what its polynomial of degree n misses.
        """
        return values - self.last_two(values)

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
