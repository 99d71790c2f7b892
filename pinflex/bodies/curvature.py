"""What the curvature of a bent beam adds to its energy in fourth order.

A beam that does not stretch, with v(x) and w(x) across its axis, has the squared curvature

    v''^2 + w''^2 + (v' v'' + w' w'')^2 + O(6)

of which the stiffness matrix holds the first two terms. Without the third the frequency of a large
vibration moves the wrong way: of a cantilever in its first mode by -0.287 (a/L)^2 at the tip
amplitude a, where it is +0.0194 (a/L)^2; the term brings 3/4 V4/V2 = 0.307 (a/L)^2.

Source: Crespo da Silva and Glynn (1978), for the energy of an inextensible beam.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.beam import union
from pinflex.bodies.family import BENDING, Family, quadrature


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
