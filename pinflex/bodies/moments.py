"""The inertia of a deforming solid as a few mass points, and its motion at sections.

The kinetic energy of a deforming body depends on its shapes only through

    Z = int z z' dm,     z = (1, p, Phi_x, Phi_y, Phi_z),     p the place of the mass dm,

so as many points as Z has rank carry it exactly. Z = F' F; a reflection gives the first column of F
equal entries, and its rows are then points of equal positive mass. (Points picked in the mesh with
non-negative weights would have to match every entry of Z: some ten times as many.)
Source: Shabana (2013), inertia shape integrals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.bodies.solid import Solid

_SMALL = 1e-4  # share of a modal mass a dropped field may carry: 5e-5 of a frequency
CROSS = np.zeros((3, 3, 3))  # CROSS[a] p = e_a x p
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    CROSS[_a, _c, _b], CROSS[_a, _b, _c] = 1.0, -1.0


def mass_points(Z: Array, n: int) -> tuple[Array, Array, float]:
    """Equal masses (ns,), rows z of the points (ns, d), and the largest error they leave.

    Mass, centre, second moments and the couplings of rigid with elastic motion are exact; of the
    elastic part, fields with less than `_SMALL` of the energy of a coordinate are left out.
    """
    L = np.linalg.cholesky(Z[:4, :4])
    couple = np.linalg.solve(L, Z[:4, 4:])
    rest = Z[4:, 4:] - couple.T @ couple
    # Each coordinate by its modal mass: a direction in which it hardly moves hardly counts.
    scale = np.tile(np.sqrt(np.diag(Z)[4:].reshape(3, n).sum(axis=0)), 3)
    values, V = np.linalg.eigh(rest / np.outer(scale, scale))
    keep = values > _SMALL
    F = np.zeros((4 + int(keep.sum()), len(Z)))
    F[:4, :4], F[:4, 4:] = L.T, couple
    F[4:, 4:] = np.sqrt(values[keep])[:, None] * V[:, keep].T * scale
    # The reflection that takes the first column of F to equal entries.
    r, first = len(F), F[:, 0]
    axis = first - np.linalg.norm(first) / np.sqrt(r)
    F = F - np.outer(2.0 * axis / (axis @ axis), axis @ F)
    weights = np.full(r, Z[0, 0] / r)
    points = F / np.sqrt(weights[0])
    points[:, 0] = 1.0
    whole = np.concatenate([np.sqrt(np.diag(Z)[:4]), scale])
    error = np.abs((points * weights[:, None]).T @ points - Z) / np.outer(whole, whole)
    return weights, points, float(error.max())


def section_fits(nodes: Array, x: Array) -> Array:
    """Rows (u, v, w, rz, ry, rx) of sections from nodal displacements, shape (nx, 6, nn, 3).

    Weighted least squares of a rigid section whose motion is quadratic in x, near each section.
    """
    length = float(x[-1] - x[0])
    out = np.zeros((len(x), 6, len(nodes), 3))
    reach = max(0.05 * length, 1.5 * float(np.max(np.diff(np.unique(np.round(nodes[:, 0], 9))))))
    for k, at in enumerate(x):
        s = (nodes[:, 0] - at) / reach
        near = np.flatnonzero(np.abs(s) < 3.0)
        weight = np.exp(-0.5 * s[near] ** 2)
        arm = np.column_stack([np.zeros(len(near)), nodes[near, 1:]])
        rigid = np.zeros((len(near), 3, 6))
        rigid[:, :, :3] = np.eye(3)
        rigid[:, :, 3:] = np.einsum("acb,ib->ica", CROSS, arm)
        full = np.concatenate([rigid * (s[near] ** p)[:, None, None] for p in range(3)], axis=2)
        full = full * weight[:, None, None]
        inverse = np.linalg.pinv(full.reshape(-1, 18), rcond=1e-9)[[0, 1, 2, 5, 4, 3]]
        out[k][:, near] = inverse.reshape(6, len(near), 3) * weight[:, None]
    return out


def outer_mass(nodes: Array, z: Array, lumps: Array, x: Array, back: Array) -> tuple[Array, Array]:
    """Operators from point forces to force and moment arms of the mass beyond each section.

    The acceleration is linear in z, so point forces f_k give it everywhere, and the mass beyond x
    (row sums of the mass matrix) then needs sum_k f_k z_k' Z^-1 int_{>x} z dm.
    """
    beyond = np.array([nodes[:, 0] > at for at in x], dtype=float)
    edge = np.array([np.abs(nodes[:, 0] - at) < 1e-9 * x[-1] for at in x], dtype=float)
    share = (beyond + 0.5 * edge) * lumps
    share[0] = lumps  # the first section carries all of the body, what lies behind it included
    force = share @ z @ back.T
    moments = np.einsum("xi,id,ia->xad", share, z, nodes, optimize=True) @ back.T
    return force, moments.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class MassPoints:
    """Weighted points with the inertia of a body in f = 4 + 3 n fields: 1, x, y, z, the shapes.

    Attributes:
        z: The fields at the nodes, shape (nodes, f). fields: At the points, shape (ns, f).
        weights: Mass of each point (kg), shape (ns,).
        onto: Products z' M u of any field u -> its values at the points, shape (ns, f): the
            projection that keeps these products.
        error: Largest error of the points in the products, as a share of the largest entries.
    """

    __repr__ = brief

    z: Array
    fields: Array
    weights: Array
    onto: Array
    error: float

    @classmethod
    def of(cls, solid: Solid, shapes: Array) -> MassPoints:
        """The points of a solid."""
        z = np.column_stack([np.ones(len(solid.nodes)), solid.nodes, *shapes.transpose(1, 0, 2)])
        weights, points, error = mass_points(z.T @ (solid.mass @ z), shapes.shape[2])
        onto = np.linalg.pinv((points * weights[:, None]).T, rcond=1e-9)
        return cls(z, points, weights, np.asarray(onto, dtype=float), error)

    def project(self, solid: Solid, field: Array) -> Array:
        """Values of a field at the points, shape (ns, the rest)."""
        products = self.z.T @ (solid.mass @ field.reshape(len(self.z), -1))
        return np.asarray(self.onto @ products)
