"""What the curvature of a bent beam adds to its energy in fourth order.

A beam that does not stretch, with v(x) and w(x) across its axis, has the squared curvature

    v''^2 + w''^2 + (v' v'' + w' w'')^2 + O(6)

of which the stiffness matrix holds the first two terms. Without the third the frequency of a large
vibration moves the wrong way: of a cantilever in its first mode by -0.287 (a/L)^2 at the tip
amplitude a, where it is +0.0194 (a/L)^2; the term brings 3/4 V4/V2 = 0.307 (a/L)^2.

Source: Crespo da Silva and Glynn (1978), for the energy of an inextensible beam.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from pinflex.arrays import Array
from pinflex.bodies import beam
from pinflex.bodies.beam import union
from pinflex.bodies.family import BENDING, Family, quadrature
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody


@dataclass(frozen=True, eq=False)
class Curvature:
    """The energy V4 = EI/2 int (v' v'' + w' w'')^2 dx of a body in its n coordinates.

    Attributes:
        slope: Rows of v' and w' at the points of a quadrature, shape (directions, points, n).
        bend: Rows of v'' and w'' there, likewise.
        weight: EI times the weights of the quadrature (N m^3), shape (points,).
    """

    slope: Array
    bend: Array
    weight: Array

    def energy(self, eta: Array) -> Array:
        """V4 (J) of states eta (..., n), shape (...)."""
        return np.asarray(0.5 * (self._mixed(eta)[0] ** 2 @ self.weight))

    def force(self, eta: Array) -> Array:
        """dV4/deta of states eta (..., n), shape (..., n)."""
        mixed, slope, bend = self._mixed(eta)
        push = self.weight * mixed
        out = np.zeros_like(eta)
        for d in range(len(self.slope)):
            out += (push * bend[d]) @ self.slope[d] + (push * slope[d]) @ self.bend[d]
        return out

    def stiffness(self, eta: Array) -> Array:
        """d2V4/deta2 of one state eta (n,), shape (n, n)."""
        mixed, slope, bend = self._mixed(eta)
        rows = np.zeros_like(self.slope[0])
        total = np.zeros((len(eta), len(eta)))
        push = (self.weight * mixed)[:, None]
        for d in range(len(self.slope)):
            rows += bend[d][:, None] * self.slope[d] + slope[d][:, None] * self.bend[d]
            both = self.slope[d].T @ (push * self.bend[d])
            total += both + both.T
        return np.asarray(total + rows.T @ (self.weight[:, None] * rows))

    def _mixed(self, eta: Array) -> tuple[Array, list[Array], list[Array]]:
        """v' v'' + w' w'' at the points, (..., points), and v', w' and v'', w'' there."""
        slope = [eta @ rows.T for rows in self.slope]
        bend = [eta @ rows.T for rows in self.bend]
        return np.asarray(sum(a * b for a, b in zip(slope, bend, strict=True))), slope, bend


def curvature(
    families: Mapping[str, Family], slices: Mapping[str, slice], n: int, stiffness: float
) -> Curvature:
    """V4 of a body."""
    bending = [d for d in BENDING if d in families]
    breaks = union([families[d].breaks for d in bending])
    # A product of four functions.
    points, weights = quadrature(breaks, 2 * max(families[d].gauss for d in bending))
    x = points.ravel()
    slope, bend = (np.zeros((len(bending), len(x), n)) for _ in range(2))
    for k, d in enumerate(bending):
        F = families[d].evaluate(x)
        slope[k][:, slices[d]], bend[k][:, slices[d]] = F.df, F.curv
    return Curvature(slope, bend, stiffness * weights.ravel())


# Sections along a flexible body: how they move, and what hangs on them.

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
