"""The motion of every section of a body as series in x, with its derivatives along the beam.

The rows of `FlexibleBody.rows`, (u, v, w, rz, ry, rx) to second order in eta, are smooth between
the breaks of the families. On each such interval they are interpolated at Chebyshev points.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from pinflex.arrays import Array
from pinflex.bodies import beam
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody

_ORDERS = 4  # the value and three derivatives: the bias of a slope takes its second
# Polynomials of degree p have gauss = p + 1 points, and products of two, integrated twice, degree
# 2 p + 2; analytic modes are down to round-off with as many (`family._modal`).
_BEYOND = 3


class Sections(NamedTuple):
    """Rows of one section and their derivatives by x of order 0 to 3.

    Attributes:
        Phi: Shape (4, 6, n). G: Shape (4, 6, n, n); zero where there is no second order.
    """

    Phi: Array
    G: Array


@dataclass(frozen=True, eq=False)
class Track:
    """Series of the rows of a body.

    Attributes:
        n: Coordinates of the body. length: Of the body (m).
        breaks: Ends of the intervals (m), shape (k + 1,).
        series: Chebyshev coefficients of Phi and G, shape (k, degree + 1, 6 (n + n n)).
        climb: Of coefficients to those of the derivatives of order 0 to 3 on an interval of length
            2, shape (4, degree + 1, degree + 1).
        shear: First-order shear strains (v, w) at the far end, shape (2, n).
    """

    __repr__ = brief

    n: int
    length: float
    breaks: Array
    series: Array
    climb: Array
    shear: Array

    def at(self, x: float) -> Sections:
        """The section at x (m); beyond an end its Taylor series of third order goes on.

        High polynomials run away there, where an iteration may look but no beam is.
        """
        inside = min(max(x, 0.0), self.length)
        found = self._inside(inside)
        if inside == x:
            return found
        return Sections(*(_shifted(rows, _powers(x - inside)) for rows in found))

    def _inside(self, x: float) -> Sections:
        k, basis = self._basis(x, _ORDERS)
        found = (basis @ self.series[k]).reshape(_ORDERS, 6, -1)
        return Sections(
            found[:, :, : self.n], found[:, :, self.n :].reshape(_ORDERS, 6, self.n, self.n)
        )

    def moved(self, x: float, eta: Array) -> Array:
        """(u, v, w) of the section at x (m), and their derivatives by x, shape (2, 3).

        Args:
            x: Place on the beam [m].
            eta: Coordinates of the body, shape (n,).
        """
        inside = min(max(x, 0.0), self.length)
        k, basis = self._basis(inside, _ORDERS if inside != x else 2)
        # the first half of the six rows
        series = self.series[k].reshape(len(basis[0]), 6, -1)[:, :3]
        found = basis @ (series @ np.concatenate([eta, 0.5 * np.outer(eta, eta).ravel()]))
        return found if inside == x else _shifted(found, _powers(x - inside))[:2]

    def _basis(self, x: float, orders: int) -> tuple[int, Array]:
        """Interval of x, and what its coefficients count for, shape (orders, degree + 1)."""
        last = len(self.series) - 1
        k = min(max(int(np.searchsorted(self.breaks, x, side="right")) - 1, 0), last)
        start, half = self.breaks[k], 0.5 * (self.breaks[k + 1] - self.breaks[k])
        turn = np.arccos(min(max((x - start) / half - 1.0, -1.0), 1.0))
        T = np.cos(np.arange(self.climb.shape[1]) * turn)
        return k, (T @ self.climb[:orders]) / half ** np.arange(orders)[:, None]


def _powers(gap: float) -> Array:
    """gap^k / k!, k = 0 to 3."""
    return np.array([gap**k / factorial(k) for k in range(_ORDERS)])


def _shifted(rows: Array, shift: Array) -> Array:
    """Derivatives of order 0 to 3 (first axis) a step on, of a cubic."""
    out = np.empty_like(rows)
    for d in range(_ORDERS):
        out[d] = np.tensordot(shift[: _ORDERS - d], rows[d:], 1)
    return out


def track(body: FlexibleBody) -> Track:
    """The series of a beam (a solid has none)."""
    families = list(body.families.values())
    breaks = beam.union([family.breaks for family in families])
    count = 2 * max(family.gauss for family in families) + _BEYOND
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    half = 0.5 * np.diff(breaks)[:, None]
    x = (breaks[:-1, None] + half * (nodes + 1.0)).ravel()
    order = np.argsort(x)
    parts = [beam.first_order(body.families, body.slices, x)]
    if body.second_order:
        # in ascending order, as the integrals from the root are summed
        sorted_rows = beam.second_order(body.families, body.slices, x[order], range(6))
        G = np.empty_like(sorted_rows)
        G[order] = sorted_rows
        parts.append(G)
    else:
        parts.append(np.zeros((len(x), 6, body.n, body.n)))
    values = np.concatenate([part.reshape(len(x), 6, -1) for part in parts], axis=2)
    to_series = np.linalg.inv(chebyshev.chebvander(nodes, count - 1))
    series = to_series @ values.reshape(len(breaks) - 1, count, -1)
    step = np.zeros((count, count))
    for k in range(1, count):
        step[:k, k] = chebyshev.chebder(np.eye(count)[k, : k + 1])
    climb = np.array([np.linalg.matrix_power(step, d) for d in range(_ORDERS)])
    return Track(body.n, body.length, breaks, series, climb, _shear(body))


def _shear(body: FlexibleBody) -> Array:
    """First-order shear strains (v, w) at the far end, shape (2, n)."""
    out = np.zeros((2, body.n))
    for row, direction in enumerate(("v", "w")):
        family = body.families.get(direction)
        if family is not None and family.shear:
            F = family.evaluate(np.array([body.length]))
            out[row, body.slices[direction]] = (F.df - F.rot)[0]
    return out
