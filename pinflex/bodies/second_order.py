"""Second-order shapes of a solid: coordinates in which its strains stay linear.

    T' K T z_ij = -T' (int C (H_i' H_j)_sym : grad v + K s_ij),     G_ij = T z_ij + s_ij

H_i is the gradient of shape i: the Green-Lagrange strain that two shapes make together is taken
back as well as the body can, and no energy of third order is left. s_ij is what finite rotations of
the rigid interfaces, R = Rz Ry Rx, add to their motion. A bent rod gets shorter, as a beam does.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.moments import CROSS
from pinflex.bodies.solid import Solid

_TURNS = (2, 1, 0)  # rotations z, y, x of an interface, in this order


def second_order_shapes(
    solid: Solid, T: Any, moving: int, shapes: Array, solve: Any
) -> tuple[Array, Array]:
    """G of all nodes, (nn, 3, n, n), and of the interface coordinates, (moving, n, n)."""
    assert solid.field is not None
    regions = list(solid.regions.values())
    n, nn = shapes.shape[2], len(solid.nodes)
    gradients = [solid.field.strained(shapes[:, :, k]) for k in range(n)]
    pairs = [(i, j) for i in range(n) for j in range(i, n)]
    loads = np.empty((3 * nn, len(pairs)))
    lift = np.zeros((3 * nn, len(pairs)))  # second order of the rotations of rigid interfaces
    for column, (i, j) in enumerate(pairs):
        loads[:, column] = solid.field.quadratic(gradients[i], gradients[j]).ravel()
        for number, region in enumerate(regions[1:]):
            turn = np.zeros((2, 3))
            for row, k in enumerate((i, j)):
                if 6 * number + 3 <= k < 6 * number + 6:
                    turn[row, k - 6 * number - 3] = 1.0
            if np.any(turn[0]) and np.any(turn[1]):
                arm = solid.nodes[region] - solid.nodes[region].mean(axis=0)
                dofs = 3 * region[:, None] + np.arange(3)
                lift[dofs, column] = arm @ _second_rotation(turn[0], turn[1]).T
    z = -solve(T.T @ (loads + solid.K @ lift))
    u = T @ z + lift
    G, node = np.empty((3 * nn, n, n)), np.empty((moving, n, n))
    for column, (i, j) in enumerate(pairs):
        G[:, i, j] = G[:, j, i] = u[:, column]
        node[:, i, j] = node[:, j, i] = z[:moving, column]
    return G.reshape(nn, 3, n, n), node


def _second_rotation(one: Array, two: Array) -> Array:
    """Bilinear part of Rz(rz) Ry(ry) Rx(rx) in two sets of small angles (rx, ry, rz), (3, 3)."""
    S = np.zeros((3, 3))
    for place, a in enumerate(_TURNS):
        S += one[a] * two[a] * (CROSS[a] @ CROSS[a])
        for b in _TURNS[place + 1 :]:
            S += (one[a] * two[b] + two[a] * one[b]) * (CROSS[a] @ CROSS[b])
    return S
