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
from pinflex.linalg import lapack
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
    """Quintic spline through positions (nt, n) at even times, from rest; it ends as the data do.

    A function of times and of an order of derivative. Unknown are velocities and accelerations at
    the nodes, by h and h^2: third and fourth derivatives go on from piece to piece, and vanish at
    the end. By numpy: scipy's splines take longer to import than a small run.

    Source: de Boor (2001), A Practical Guide to Splines, ch. 4 (piecewise Hermite interpolation).
    """
    h, n = float(t[-1] - t[0]) / (len(t) - 1), len(t)
    # by x, v, a at either end of a piece: its third and fourth derivative where it begins, and ends
    begins = np.array([[-60, -36, -9, 60, -24, 3], [360, 192, 36, -360, 168, -24]], float)
    ends = np.array([[-60, -24, -3, 60, -36, 9], [-360, -168, -24, 360, -192, 36]], float)
    rows, right = np.zeros((2 * n, 7)), np.zeros((2 * n, position.shape[1]))
    rows[:2, 3] = 1.0  # at rest; below: unknowns of the node before, its own, and of the next
    inner = rows[2:-2].reshape(n - 2, 2, 7)
    for k in range(2):  # row k of a node begins k unknowns further on in its band
        inner[:, k, 1 - k : 3 - k] = ends[k, 1:3]
        inner[:, k, 3 - k : 5 - k] = ends[k, 4:] - begins[k, 1:3]
        inner[:, k, 5 - k : 7 - k] = -begins[k, 4:]
        rows[2 * n - 2 + k, 1 - k : 3 - k], rows[2 * n - 2 + k, 3 - k : 5 - k] = (
            ends[k, 1:3], ends[k, 4:],
        )  # fmt: skip
    rise = np.diff(position, axis=0)
    for k in range(2):
        right[2 + k : -2 : 2] = begins[k, 3] * rise[1:] - ends[k, 3] * rise[:-1]
        right[2 * n - 2 + k] = -ends[k, 3] * rise[-1]
    # LAPACK's band: entry (i, j) at (6 + i - j, j), with three rows of room above
    band = np.zeros((10, 2 * n), order="F")
    for k in range(7):
        column = np.arange(2 * n) + k - 3
        inside = (column >= 0) & (column < 2 * n)
        band[9 - k, column[inside]] = rows[inside, k]
    _, _, found, info = lapack().dgbsv(3, 3, band, right, overwrite_ab=1, overwrite_b=1)
    if info:
        raise np.linalg.LinAlgError(f"dgbsv: info {info}")
    known = position, found[0::2], found[1::2]
    # coefficients of powers of the time in a piece, over h
    pieces = np.stack([x for part in known for x in (part[:-1], part[1:])])
    powers = np.einsum("cp,pkm->ckm", _POWERS, pieces)

    def at(times: Array, order: int = 0) -> Array:
        left = np.clip(((times - t[0]) / h).astype(np.intp), 0, n - 2)
        part = ((times - t[left]) / h)[:, None]
        value = np.zeros((len(times), position.shape[1]))
        for c in range(5, order - 1, -1):
            value = value * part + np.prod(np.arange(c, c - order, -1.0)) * powers[c, left]
        return np.asarray(value / h**order)

    return at


# A quintic of u in [0, 1] by its ends (x0, x1, v0, v1, a0, a1), coefficient by coefficient.
_POWERS = np.array([
    [1, 0, 0, 0, 0, 0],
    [0, 0, 1, 0, 0, 0],
    [0, 0, 0, 0, 0.5, 0],
    [-10, 10, -6, -4, -1.5, 0.5],
    [15, -15, 8, 7, 1.5, -1],
    [-6, 6, -3, -3, -0.5, 0.5],
])  # fmt: skip
