"""Damping of a body from its stiffness and mass: Rayleigh's two terms and a ratio of every mode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray

if TYPE_CHECKING:
    from pinflex.description.blocks.flexible import FlexibleLink


def damping(
    link: FlexibleLink, places: Mapping[str, slice | IntArray], K: Array, M: Array
) -> Array:
    """Damping matrix of a body, direction by direction, from its stiffness and mass, (n, n)."""
    alpha, beta = link.rayleigh
    D, every = np.zeros_like(K), np.arange(len(K))
    for place in places.values():
        at = np.ix_(every[place], every[place])
        D[at] = alpha * M[at] + beta * K[at]
        if link.modal_damping:
            D[at] += modal_damping(K[at], M[at], link.modal_damping)
    return D


def modal_damping(K: Array, M: Array, ratio: float) -> Array:
    """D = M V diag(2 zeta omega) V' M of the modes V held at the root, V' M V = 1."""
    L = np.linalg.cholesky(M)
    half = np.linalg.solve(L, K)
    squares, U = np.linalg.eigh(np.linalg.solve(L, half.T))
    MV = L @ U
    return np.asarray(MV * (2.0 * ratio * np.sqrt(np.maximum(squares, 0.0))) @ MV.T)
