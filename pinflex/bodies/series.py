"""Functions along a beam as polynomials, piece by piece, as numpy and the kernel read them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.polynomial import chebyshev

from pinflex.arrays import Array
from pinflex.text import brief

ORDERS = 4  # the value and three derivatives: the bias of a slope takes its second
# Pieces are halved until this many Chebyshev points leave no more than round-off.
_POINTS, _LEFT, _HALVINGS = 16, 1e-13, 12
_NOTHING = 1e-15  # of the largest coefficient: degrees that hold less are left out


@dataclass(frozen=True, eq=False)
class Series:
    """Some functions on [0, length].

    Attributes:
        breaks: Ends of the pieces (m), shape (k + 1,).
        powers: Coefficients of z^d, z from -1 to 1 on each piece, shape (k, degree + 1, functions).
    """

    __repr__ = brief

    breaks: Array
    powers: Array

    def at(self, x: float) -> Array:
        """Values and derivatives by x of order 1 to 3 at x (m), shape (4, functions).

        Beyond an end the Taylor series of third order goes on: high polynomials run away there,
        where an iteration may look but no beam is.
        """
        inside = min(max(x, float(self.breaks[0])), float(self.breaks[-1]))
        k = int(np.searchsorted(self.breaks, inside, side="right")) - 1
        k = min(max(k, 0), len(self.powers) - 1)
        start, half = self.breaks[k], 0.5 * (self.breaks[k + 1] - self.breaks[k])
        found = _weights((inside - start) / half - 1.0, half, self.powers.shape[1]) @ self.powers[k]
        return found if inside == x else _shifted(found, x - inside)


def series(function: Callable[[Array], Array], breaks: Array, size: Array) -> Series:
    """The series of functions that are smooth between breaks."""
    nodes = -np.cos(np.pi * (np.arange(_POINTS) + 0.5) / _POINTS)
    to_series = np.linalg.inv(chebyshev.chebvander(nodes, _POINTS - 1))
    for _ in range(_HALVINGS):
        half = 0.5 * np.diff(breaks)[:, None]
        values = function((breaks[:-1, None] + half * (nodes + 1.0)).ravel())
        found = to_series @ values.reshape(len(half), _POINTS, -1)
        rough = np.any(np.abs(found[:, -2:]) > _LEFT * size, axis=(1, 2))
        if not np.any(rough):
            break
        breaks = np.sort(np.append(breaks, breaks[:-1][rough] + half[rough, 0]))
    there = np.flatnonzero(np.any(np.abs(found) > _NOTHING * size, axis=(0, 2)))
    count = int(there[-1]) + 1 if len(there) else 1
    to_powers = np.zeros((count, count))
    for d in range(count):
        to_powers[: d + 1, d] = chebyshev.cheb2poly(np.eye(count)[d, : d + 1])
    return Series(breaks, np.ascontiguousarray(to_powers @ found[:, :count]))


def _weights(z: float, half: float, count: int) -> Array:
    """What coefficients count for in derivatives of order 0 to 3, shape (4, count)."""
    out = np.zeros((ORDERS, count))
    for d in range(count):
        factor = 1.0
        for order in range(min(ORDERS, d + 1)):
            out[order, d] = factor * z ** (d - order)
            factor *= (d - order) / half
    return out


def _shifted(rows: Array, gap: float) -> Array:
    """Derivatives of order 0 to 3 (first axis) a step on, of a cubic."""
    shift = np.array([gap**k / factorial(k) for k in range(ORDERS)])
    out = np.empty_like(rows)
    for d in range(ORDERS):
        out[d] = np.tensordot(shift[: ORDERS - d], rows[d:], 1)
    return out
