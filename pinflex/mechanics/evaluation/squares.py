"""Second-order rows of the map as sums of squares, where that is less work than all products.

A beam gets shorter by the integral of the square of its slope: with n functions n^2/2 products in
each row. The slopes at q points, psi . eta, are q n products for all rows together, and their
squares, weighted, q in each row:

    1/2 eta' G eta = sum_q weight_q (psi_q . eta)^2

The weights are fitted to G and kept where nothing but round-off is left.
"""

from __future__ import annotations

from math import ceil
from typing import Any, NamedTuple

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.family import quadrature
from pinflex.mechanics.model.expanded import Block, Expansion

# Points between two breaks over those that integrate a product of two functions: a product of two
# slopes is resolved to 3e-15 by 1.5 times as many (50 modes; 2e-12 by 1.3 times).
_POINTS = 1.6
_LEFT = 1e-13  # of the largest entry of a row
_RANK = 1e-13  # of the largest singular value
_WORTH = 2.0  # times as many products before


class Squares(NamedTuple):
    """Rows of one body as sums of squares.

    Attributes:
        psi: Shape (q, n). weight: Shape (rows, q). rows: Which rows of the body they are.
    """

    psi: Array
    weight: Array
    rows: IntArray


def square_tables(expansion: Expansion, g_at: IntArray) -> dict[str, Any]:
    """Tables of the squares, and up to where products serve in each row."""
    rest, counts = g_at[1:].copy(), np.zeros(len(g_at) - 1, dtype=np.intp)
    first, above = counts.copy(), 0
    bodies = {slot.eta.start: slot.body for slot in expansion.slots}
    psi: list[Array] = []
    weight: list[Array] = []
    eta: list[int] = []
    width: list[int] = []
    for block in expansion.blocks:
        size, count, n = block.Phi.shape
        for k in range(size):
            start = block.eta.start + n * k
            found = _squares(block, k, bodies.get(start))
            if found is not None:
                rows = above + found.rows
                rest[rows], counts[rows], first[rows] = g_at[rows], len(found.psi), len(eta)
                weight.append(found.weight.ravel())
                psi.append(found.psi.ravel())
                eta += [start] * len(found.psi)
                width += [n] * len(found.psi)
            above += count
    none = np.zeros(0)
    return {
        "g_rest": rest,
        "sum_at": np.concatenate([[0], np.cumsum(counts)]),
        "sum_from": first,
        "sum": np.concatenate([none, *weight]),
        "square_at": np.concatenate([[0], np.cumsum(width, dtype=np.intp)]),
        "square_eta": eta,
        "square": np.concatenate([none, *psi]),
    }


def _squares(block: Block, k: int, body: FlexibleBody | None) -> Squares | None:
    """The rows of a body that are worth it; None: none."""
    if body is None or not body.families:
        return None
    G, n = block.G[k], block.G.shape[-1]
    psi = _slopes(body, n)
    same = np.abs(psi).T @ np.abs(psi) > 0.0  # pairs that a square can have
    entries = np.count_nonzero(np.triu(G), axis=(1, 2))
    rows = np.flatnonzero((entries > 0) & ~np.any(G * ~same, axis=(1, 2)))
    if not len(rows) or entries[rows].sum() < _WORTH * len(psi) * (n + len(rows)):
        return None
    i, j = np.triu_indices(n)
    products, wanted = psi[:, i] * psi[:, j], 0.5 * G[rows][:, i, j]
    weight = np.linalg.lstsq(products.T, wanted.T, rcond=_RANK)[0].T
    left = np.abs(weight @ products - wanted).max(axis=1)
    good = left <= _LEFT * np.abs(wanted).max(axis=1)
    return Squares(psi, weight[good], rows[good]) if np.any(good) else None


def _slopes(body: FlexibleBody, n: int) -> Array:
    """Slopes, and shear strains where they are, of all bending functions, shape (q, n)."""
    found = []
    for direction in ("v", "w"):
        family = body.families.get(direction)
        if family is None:
            continue
        F = family.evaluate(quadrature(family.breaks, ceil(_POINTS * family.gauss))[0].ravel())
        for values in (F.df, F.df - F.rot) if family.shear else (F.df,):
            psi = np.zeros((len(values), n))
            psi[:, body.slices[direction]] = values
            found.append(psi)
    return np.concatenate(found) if found else np.zeros((0, n))
