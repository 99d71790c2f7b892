"""The motion of every section of a body as series in x, with its derivatives along the beam.

The rows of `FlexibleBody.rows`, (u, v, w, rz, ry, rx) to second order in eta, are smooth between
the breaks of the families.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from pinflex.arrays import Array, IntArray
from pinflex.bodies import beam
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody


# Functions along a beam as polynomials, piece by piece, as numpy and the kernel read them.

ORDERS = 4  # the value and three derivatives: the bias of a slope takes its second
# Pieces are halved until this many Chebyshev points leave no more than round-off.
_POINTS, _LEFT, _HALVINGS = 16, 1e-13, 12
_FACTORIALS = np.array([[1.0], [1.0], [2.0], [6.0]])  # of the orders of a Taylor series
_NO_DEGREE = 1e-15  # of the largest coefficient: degrees that hold less are left out


@frozen(eq=False)
class Series:
    """Some functions on [0, length].

    Attributes:
        breaks: Ends of the pieces (m), shape (k + 1,).
        powers: Coefficients of z^d, z from -1 to 1 on each piece, shape (k, degree + 1, functions).
    """

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
        found = _derivatives(self.powers[k], (inside - start) / half - 1.0, 1.0 / half)
        return found if inside == x else _derivatives(found / _FACTORIALS, x - inside)


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
    there = np.flatnonzero(np.any(np.abs(found) > _NO_DEGREE * size, axis=(0, 2)))
    count = int(there[-1]) + 1 if len(there) else 1
    to_powers = np.zeros((count, count))
    for d in range(count):
        to_powers[: d + 1, d] = chebyshev.cheb2poly(np.eye(count)[d, : d + 1])
    return Series(breaks, np.ascontiguousarray(to_powers @ found[:, :count]))


def _derivatives(powers: Array, z: float, slope: float = 1.0) -> Array:
    """Polynomials (degree + 1, n) at z, and their derivatives by x, dz/dx = slope, (4, n)."""
    return np.array([
        polynomial.polyval(z, polynomial.polyder(powers, order, scl=slope))
        for order in range(ORDERS)
    ])  # fmt: skip


_NOTHING = 1e-15  # of the largest entry of a row: others are round-off


class Sections(NamedTuple):
    """Rows of one section and their derivatives by x of order 0 to 3.

    Attributes:
        Phi: Shape (4, 6, n). G: Shape (4, 6, n, n); zero where there is no second order.
    """

    Phi: Array
    G: Array


@frozen(eq=False)
class Track:
    """Series of the rows of a body.

    Attributes:
        n: Coordinates of the body. length: Of the body (m).
        series: Of the entries of Phi and of the upper triangle of G that are not zero.
        row, i, j: Which they are, shape (entries,) each; j is -1 in Phi.
        shear: First-order shear strains (v, w) at the far end, shape (2, n).
    """

    n: int
    length: float
    series: Series
    row: IntArray
    i: IntArray
    j: IntArray
    shear: Array

    def at(self, x: float) -> Sections:
        """The section at x (m); beyond an end its Taylor series of third order goes on."""
        values, linear = self.series.at(x), self.j < 0
        Phi, G = np.zeros((ORDERS, 6, self.n)), np.zeros((ORDERS, 6, self.n, self.n))
        Phi[:, self.row[linear], self.i[linear]] = values[:, linear]
        row, i, j = (index[~linear] for index in (self.row, self.i, self.j))
        G[:, row, i, j] = G[:, row, j, i] = values[:, ~linear]
        return Sections(Phi, G)


def track(body: FlexibleBody, rows: Sequence[int] = range(6), second_order: bool = True) -> Track:
    """The series of a beam (a solid has none)."""
    breaks = beam.union([np.array([0.0, body.length]), *(f.breaks for f in body.families.values())])

    def entries(x: Array) -> list[Array]:
        parts = [beam.first_order(body.families, body.slices, x)[:, list(rows)]]
        if second_order and body.second_order:
            parts.append(beam.second_order(body.families, body.slices, x, list(rows)))
        return parts

    # Which entries are not zero, looked at within each piece.
    inside = (breaks[:-1, None] + np.outer(np.diff(breaks), [0.17, 0.41, 0.73, 0.94])).ravel()
    index: list[IntArray] = []
    sizes: list[Array] = []
    for values in entries(inside):
        size = np.abs(values).max(axis=0)
        of_row = size.reshape(len(rows), -1).max(axis=1, initial=0.0)
        there = size > _NOTHING * of_row.reshape(-1, *[1] * (size.ndim - 1))
        if size.ndim == 3:
            there &= np.triu(np.ones(there.shape[1:], dtype=bool))
        index.append(np.argwhere(there))
        sizes.append(of_row[index[-1][:, 0]])

    def function(x: Array) -> Array:
        found = zip(entries(x), index, strict=True)
        return np.concatenate([values[(slice(None), *at.T)] for values, at in found], axis=1)

    columns = np.concatenate([np.pad(at, ((0, 0), (0, 3 - at.shape[1])), constant_values=-1)
                              for at in index])  # fmt: skip
    row = np.array(rows, dtype=np.intp)[columns[:, 0]]
    made = series(function, breaks, np.concatenate(sizes))
    return Track(body.n, body.length, made, row, columns[:, 1], columns[:, 2], _shear(body))


def _shear(body: FlexibleBody) -> Array:
    """First-order shear strains (v, w) at the far end, shape (2, n)."""
    out = np.zeros((2, body.n))
    for row, direction in enumerate(("v", "w")):
        family = body.families.get(direction)
        if family is not None and family.shear:
            F = family.evaluate(np.array([body.length]))
            out[row, body.slices[direction]] = (F.df - F.rot)[0]
    return out
