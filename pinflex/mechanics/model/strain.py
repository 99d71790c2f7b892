"""Elastic potential of deformed links: energy, force, and the stiffness of bent bodies.

Once in numpy, and once as tables for the compiled kernel (kernel/source/strain.c).
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.family import quadrature
from pinflex.mechanics.model.loads import Expansion

if TYPE_CHECKING:
    from pinflex.mechanics.model.system import System


class Strain:
    """Links' potential e' K e / 2 of e = eta - rest, and what bodies of third order add to it.

    Attributes:
        stiffness: K of the links by eta, shape (n_eta, n_eta).
        rest: Coordinates at which they are free of stress, shape (n_eta,).
    """

    def __init__(self, system: System) -> None:
        """Copy the links' block of the system's stiffness."""
        n = int(system.rigid.nv)
        self.stiffness = np.ascontiguousarray(system.K[n:, n:])
        self.rest = at_rest(system)
        links = [(slot.eta, slot.body.curvature) for slot in system.expansion.slots]
        self._curved = [(at, bent) for at, bent in links if bent is not None]

    def force(self, eta: Array) -> Array:
        """Resistance of the links to elastic coordinates (..., n_eta), the same shape."""
        force = np.asarray((eta - self.rest).dot(self.stiffness))
        for at, bent in self._curved:
            force[..., at] += bent.force(eta[..., at])
        return force

    def energy(self, eta: Array) -> Array:
        """Strain energy (J) at elastic coordinates (..., n_eta), shape (...)."""
        off = eta - self.rest
        energy = 0.5 * np.sum(off @ self.stiffness * off, axis=-1)
        for at, bent in self._curved:
            energy = energy + bent.energy(eta[..., at])
        return np.asarray(energy)

    def bent(self, eta: Array) -> list[tuple[slice, Array]]:
        """Stiffness beside K of bodies of third order at eta (n_eta,), by their coordinates."""
        return [(at, bent.stiffness(eta[at])) for at, bent in self._curved]


def at_rest(system: System) -> Array:
    """Elastic coordinates at which links are free of stress, shape (n_eta,)."""
    rest = np.zeros(system.n_eta)
    for slot in system.expansion.slots:
        if slot.body.rest is not None:
            rest[slot.eta] = slot.body.rest
    return rest


def strain_tables(system: System) -> dict[str, Any]:
    """Where links are free of stress; rows of slope and bend of those that bend far, by points."""
    links = [(slot.eta.start, slot.body.curvature) for slot in system.expansion.slots]
    bent = [(first, one) for first, one in links if one is not None]
    if not bent:
        return {"rest": at_rest(system)}
    shapes = np.array([one.slope.shape for _, one in bent], dtype=np.intp)

    def flat(rows: list[Array]) -> Array:
        return np.concatenate([x.transpose(1, 0, 2).ravel() for x in rows])

    return {
        "rest": at_rest(system),
        "bent_first": [first for first, _ in bent], "bent_n": shapes[:, 2],
        "bent_directions": shapes[:, 0],
        "bent_at": np.concatenate([[0], np.cumsum(shapes.prod(axis=1))]),
        "bent_point": np.concatenate([[0], np.cumsum(shapes[:, 1])]),
        "bent_slope": flat([one.slope for _, one in bent]),
        "bent_bend": flat([one.bend for _, one in bent]),
        "bent_weight": np.concatenate([one.weight for _, one in bent]),
    }  # fmt: skip


# Second-order rows of the map as sums of squares, where that is less work than all products.
#
# A beam gets shorter by the integral of the square of its slope: with n functions n^2/2 products in
# each row. The slopes at q points, psi . eta, are q n products for all rows together, and their
# squares, weighted, q in each row:
#
#     1/2 eta' G eta = sum_q weight_q (psi_q . eta)^2
#
# The weights are fitted to G and kept where nothing but round-off is left.

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
    known: dict[int, tuple[Array, Squares | None]] = {}  # of bodies that several links share
    psi: list[Array] = []
    weight: list[Array] = []
    eta: list[int] = []
    width: list[int] = []
    for block in expansion.blocks:
        body = bodies.get(block.eta.start)
        same = known.get(id(body))
        if same is None or not np.array_equal(same[0], block.G):
            same = known[id(body)] = block.G, _squares(block.G, body)
        found = same[1]
        if found is not None:
            rows, (count, n) = above + found.rows, found.psi.shape
            rest[rows], counts[rows], first[rows] = g_at[rows], count, len(eta)
            weight.append(found.weight.ravel())
            psi.append(found.psi.ravel())
            eta += [block.eta.start] * count
            width += [n] * count
        above += len(block.rows)
    rows_of: dict[str, Any] = {
        "g_rest": rest,
        "sum_at": np.concatenate([[0], np.cumsum(counts)]),
        "sum_from": first,
    }
    if not eta:
        return rows_of
    return rows_of | {
        "sum": np.concatenate(weight),
        "square_at": np.concatenate([[0], np.cumsum(width, dtype=np.intp)]),
        "square_eta": eta,
        "square": np.concatenate(psi),
    }


def _squares(G: Array, body: FlexibleBody | None) -> Squares | None:
    """The rows of a body that are worth it; None: none."""
    if body is None or not body.families or not len(G):
        return None
    n = G.shape[-1]
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
