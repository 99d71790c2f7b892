"""Sections along a flexible body: how they move, and what hangs on them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from pinflex.arrays import Array
from pinflex.bodies import beam
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody

# Per body: a smooth curve on the screen and every maximum within 0.1 % of a parabola.
SECTIONS = 21


@dataclass(frozen=True)
class Cut:
    """Sections of one body: deflection rows and the balance operator.

    Attributes:
        x: Sections (m), shape (nx,).
        Phi: Rows (u, v, w, rz, ry, rx), shape (nx, 6, n). G: second order, or None.
        outer: Integrates station forces over the part beyond x: shape (nx, ns).
        outer_twist: The same for twist stations, shape (nx, nt).
    """

    __repr__ = brief

    x: Array
    Phi: Array
    G: Array | None
    outer: Array
    outer_twist: Array


def cut(body: FlexibleBody, count: int = SECTIONS) -> Cut:
    """Sections at equal distances along a body."""
    if body.solid is not None:
        solid = body.solid
        return Cut(solid.x, solid.Phi, solid.G, solid.outer, np.zeros((len(solid.x), 0)))
    x = np.linspace(0.0, body.length, count)
    families, slices = body.families, body.slices
    Phi = beam.first_order(families, slices, x)
    G = beam.second_order(families, slices, x, range(6)) if body.second_order else None
    breaks = _breaks(body)
    return Cut(x, Phi, G, _outer(x, body.x, breaks), _outer(x, body.xt, breaks))


def _breaks(body: FlexibleBody) -> Array:
    edges = np.concatenate([family.breaks for family in body.families.values()])
    return np.unique(np.round(edges / body.length, 12)) * body.length


def _outer(x: Array, stations: Array, breaks: Array) -> Array:
    """Operator from station forces to their integral over [x, L].

    Between breaks the force per length is the polynomial through the Gauss stations, so the section
    forces are smooth curves, not stairs.
    """
    operator = np.zeros((len(x), len(stations)))
    for start, end in itertools.pairwise(breaks):
        inside = np.flatnonzero((stations > start) & (stations < end))
        n = len(inside)
        if not n:
            continue
        xi = 2.0 * (stations[inside] - start) / (end - start) - 1.0
        V = legendre.legvander(xi, n - 1)
        # Discrete orthogonality at Gauss points: coefficients of force density from lumped forces.
        k = np.arange(n)
        coefficients = (2 * k + 1)[:, None] / 2.0 * V.T
        at = np.clip(2.0 * (x - start) / (end - start) - 1.0, -1.0, 1.0)
        primitive = legendre.legint(np.eye(n))
        integrals = legendre.legval(1.0, primitive) - legendre.legval(at, primitive).T
        operator[:, inside] = integrals @ coefficients
    return operator
