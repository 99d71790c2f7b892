"""The motion of every section of a body as series in x, with its derivatives along the beam.

The rows of `FlexibleBody.rows`, (u, v, w, rz, ry, rx) to second order in eta, are smooth between
the breaks of the families.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.bodies import beam
from pinflex.bodies.series import ORDERS, Series, series
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody

_NOTHING = 1e-15  # of the largest entry of a row: others are round-off


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
        series: Of the entries of Phi and of the upper triangle of G that are not zero.
        row, i, j: Which they are, shape (entries,) each; j is -1 in Phi.
        shear: First-order shear strains (v, w) at the far end, shape (2, n).
    """

    __repr__ = brief

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

    def moved(self, x: float, eta: Array) -> Array:
        """(u, v, w) of the section at x (m), and their derivatives by x, shape (2, 3)."""
        Phi, G = self.at(x)
        return np.asarray((Phi[:2, :3] + 0.5 * G[:2, :3] @ eta) @ eta)


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
