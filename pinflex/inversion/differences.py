"""Rates of poses on a uniform grid by central differences on the configuration manifold.

With d_j the move from pose k to pose k + j, in exponential coordinates at pose k, the first
derivative of those coordinates is v and the second is the rate of v, exactly: their bracket
vanishes at the origin. The differences of order 4 and 8 are the usual ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import Manifold


@dataclass(frozen=True)
class Stencil:
    """Weights of the poses at -n ... n: `first` / h gives v, `second` / h^2 gives a."""

    first: Array
    second: Array

    @property
    def reach(self) -> int:
        """Number of poses on either side."""
        return len(self.first) // 2


FOURTH = Stencil(
    np.array([1, -8, 0, 8, -1]) / 12.0,
    np.array([-1, 16, -30, 16, -1]) / 12.0,
)
EIGHTH = Stencil(
    np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]),
    np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]),
)


def rates(dynamics: Equations, y: Array, h: float, stencil: Stencil) -> tuple[Array, Array]:
    """v and a, each (nt, nv), of poses y (nt + 2 reach, nq), a time h (s) apart."""
    n = stencil.reach
    manifold, middle = Manifold(dynamics), y[n : len(y) - n]
    v, a = (np.zeros((len(middle), dynamics.system.nv)) for _ in range(2))
    for j in range(-n, n + 1):
        if j:
            move = manifold.log(middle, y[n + j : len(y) - n + j])
            v += stencil.first[j + n] / h * move
            a += stencil.second[j + n] / h**2 * move
    return v, a


def padded(y: Array, n: int) -> Array:
    """Poses with n equal ones before the first and after the last: rest."""
    return np.concatenate([np.repeat(y[:1], n, 0), y, np.repeat(y[-1:], n, 0)])


def spline(t: Array, position: Array) -> Callable[..., Array]:
    """Quintic through positions (nt, n), from rest; the end is as the data have it."""
    from scipy.interpolate import make_interp_spline

    still = np.zeros(position.shape[1])
    begin, end = ([(order, still) for order in orders] for orders in ((1, 2), (3, 4)))
    return make_interp_spline(t, position, k=5, bc_type=(begin, end))  # type: ignore[no-any-return]
