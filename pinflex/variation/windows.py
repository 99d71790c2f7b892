"""Largest values of curves between their samples, by polynomials in short windows of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from pinflex.arrays import Array, BoolArray, IntArray

NODES = 9  # instants in a window: a polynomial of degree 8, and of 4 by every other one
_FINE = 161  # places in a window where its polynomial is looked at first
_REFINED = 4  # Newton iterations from the best of them


@dataclass(frozen=True)
class Windows:
    """Short spans of time, each with the instants at which curves are read there.

    Attributes:
        nodes: Instants [s], shape (windows, NODES).
        closed: Whether the first and the last of them end a smooth piece, shape (windows, 2).
    """

    nodes: Array
    closed: BoolArray

    def tops(self, windows: IntArray, values: Array) -> tuple[Array, Array, Array]:
        """Largest values in windows, shape (n,); the same by fewer points; whether it is inside."""
        x = _unit(self.nodes[windows])
        top, place = _largest(x, values)
        fewer, _ = _largest(x[:, ::2], values[:, ::2])
        low, high = self.closed[windows].T
        return top, fewer, (low | (place > -1.0)) & (high | (place < 1.0))


def around(centre: float, half: float, piece: tuple[float, float]) -> tuple[Array, BoolArray]:
    """Nodes of a window about an instant inside a smooth piece, and which sides end that."""
    half = min(half, 0.5 * (piece[1] - piece[0]))
    middle = min(max(centre, piece[0] + half), piece[1] - half)
    turns = np.linspace(np.pi, 0.0, NODES)
    nodes = np.clip(middle + half * np.cos(turns), *piece)
    return nodes, np.abs(nodes[[0, -1]] - np.array(piece)) < 1e-3 * half


def steps_around(k: int, t: Array) -> tuple[Array, BoolArray]:
    """The same at steps t (n,) about the k-th of them."""
    first = min(max(k - NODES // 2, 0), len(t) - NODES)
    last = first + NODES
    return t[first:last], np.array([first == 0, last == len(t)])


def highest(curve: Array, part: float, most: int) -> IntArray:
    """Places of the local maxima of a curve that come within a part of its largest value.

    An end that nothing beside exceeds is one.
    """
    beside = np.concatenate([[-np.inf], curve, [-np.inf]])
    tops = np.flatnonzero((curve >= beside[:-2]) & (curve > beside[2:]))
    tops = tops[curve[tops] >= (1.0 - part) * np.max(curve)]
    return np.asarray(tops[np.argsort(-curve[tops], kind="stable")][:most])


def _unit(nodes: Array) -> Array:
    """Nodes of windows mapped to -1 ... 1."""
    low, high = nodes[:, :1], nodes[:, -1:]
    return np.asarray((2.0 * nodes - low - high) / (high - low))


def _largest(x: Array, values: Array) -> tuple[Array, Array]:
    """Largest values on -1 ... 1 of the polynomials through values at x (n, k), and where."""
    k = values.shape[1]
    c = np.linalg.solve(chebyshev.chebvander(x, k - 1), values[:, :, None])[:, :, 0].T
    fine = np.linspace(-1.0, 1.0, _FINE)
    place = fine[np.argmax(chebyshev.chebval(fine, c), axis=1)]
    first, second = chebyshev.chebder(c), chebyshev.chebder(c, 2)
    best, height = place, chebyshev.chebval(place, c, tensor=False)
    for _ in range(_REFINED):
        slope = chebyshev.chebval(place, first, tensor=False)
        bend = chebyshev.chebval(place, second, tensor=False)
        step = np.where(bend < 0.0, -slope / np.where(bend < 0.0, bend, 1.0), 0.0)
        place = np.clip(place + np.clip(step, -2.0 / _FINE, 2.0 / _FINE), -1.0, 1.0)
        now = chebyshev.chebval(place, c, tensor=False)
        best, height = np.where(now > height, place, best), np.maximum(now, height)
    return height, best
