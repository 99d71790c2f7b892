"""Vibration modes of a uniform Euler-Bernoulli beam, in closed form and stable to any number.

The textbook cosh - sinh form cancels from about the tenth mode on and overflows later. Here
every mode is written in split exponentials, each bounded by one on the beam,

    f(x) = A cos(b x) + B sin(b x) + C exp(-b x) + D exp(-b (L - x)),

with (A, B, C, D) the null vector of the four boundary conditions, each divided by its power of b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.description.flexible import BOUNDARIES
from pinflex.errors import DescriptionError, nearest

# Derivatives that vanish at an end.
_ENDS = {"clamped": (0, 1), "pinned": (0, 2), "free": (2, 3)}
# Shift of the asymptotic roots b L = (k + shift) pi, k = 1, 2, ...
_SHIFTS = {
    "clamped_free": -0.5,
    "pinned_free": 0.25,
    "pinned_pinned": 0.0,
    "clamped_pinned": 0.25,
    "clamped_clamped": 0.5,
    "free_free": 0.5,
}
assert tuple(_SHIFTS) == BOUNDARIES


@dataclass(frozen=True, eq=False)
class Modes:
    """Mode shapes A cos + B sin + C exp(-b x) + D exp(-b (L - x)), scaled to int f^2 dx = L.

    Attributes:
        length: Length of the beam L (m).
        wavenumber: b of each mode (1/m), shape (n,); 0 for a rigid mode.
        coefficients: A, B, C, D of each mode (-), shape (n, 4).
        rigid: Number of leading rigid modes: none, or translation 1 and rotation sqrt(3)(2x/L - 1).
    """

    length: float
    wavenumber: Array
    coefficients: Array
    rigid: int = 0

    def evaluate(self, x: Array, derivative: int = 0) -> Array:
        """Derivative of the modes along the beam.

        Args:
            x: Positions (m), shape (nx,).
            derivative: Order d of the derivative.
        Returns:
            d-th derivative of each mode (m^-d), shape (nx, n).
        """
        x = np.asarray(x, dtype=np.float64)
        b = self.wavenumber
        A, B, C, D = self.coefficients.T
        phase = np.outer(x, b)
        quarter = derivative % 4
        # d/d(bx) turns (cos, sin) by a quarter: (A, B) -> (B, -A).
        A, B = ((A, B), (B, -A), (-A, -B), (-B, A))[quarter]
        out: Array = A * np.cos(phase) + B * np.sin(phase)
        out += (-1) ** quarter * C * np.exp(-phase)
        out += D * np.exp(-np.outer(self.length - x, b))
        out *= b**derivative
        if self.rigid:
            slope = 2.0 * np.sqrt(3.0) / self.length
            columns = (
                (np.ones_like(x), np.sqrt(3.0) * (2.0 * x / self.length - 1.0)),
                (np.zeros_like(x), np.full_like(x, slope)),
            )
            zero = (np.zeros_like(x), np.zeros_like(x))
            out[:, :2] = np.column_stack(columns[derivative] if derivative < 2 else zero)
        return out


def roots(boundary: str, n: int) -> Array:
    """Roots b L of the characteristic equation of the elastic modes.

    The equations are divided by cosh(b L), so their values stay of order one:
    clamped_free cos + 1/cosh = 0; clamped_clamped and free_free cos - 1/cosh = 0;
    clamped_pinned and pinned_free sin - cos tanh = 0; pinned_pinned sin = 0.

    Returns:
        First n positive roots b L (-), ascending, shape (n,).
    Source: Blevins (1979), Formulas for Natural Frequency and Mode Shape, table 8-1.
    """
    if boundary not in _SHIFTS:
        raise DescriptionError(
            f'boundary: unknown boundary "{boundary}".{nearest(boundary, BOUNDARIES)}',
            boundary=boundary,
        )
    b = np.asarray((np.arange(1, n + 1) + _SHIFTS[boundary]) * np.pi, dtype=np.float64)
    if boundary == "pinned_pinned":
        return b
    # Newton from the asymptotic root: the slope is close to one there, and the first root of
    # all (1.5708 -> 1.8751) is the farthest it has to go.
    for _ in range(8):
        sech, tanh = 1.0 / np.cosh(np.minimum(b, 700.0)), np.tanh(b)
        sine, cosine = np.sin(b), np.cos(b)
        if boundary in ("clamped_pinned", "pinned_free"):
            value, slope = sine - cosine * tanh, cosine + sine * tanh - cosine * sech**2
        else:
            sign = 1.0 if boundary == "clamped_free" else -1.0
            value, slope = cosine + sign * sech, -sine - sign * sech * tanh
        b -= value / slope
    return b


def mode_functions(boundary: str, n: int, length: float, rigid: bool = False) -> Modes:
    """Bending modes of a uniform beam under homogeneous boundary conditions.

    The sign makes the first derivative that does not vanish at the root positive.

    Returns:
        Modes with int f^2 dx = L.
    """
    if rigid and boundary != "free_free":
        raise DescriptionError(
            f'boundary: rigid modes are asked of "{boundary}". Only "free_free" has them here.',
            boundary=boundary,
        )
    held = min(n, 2) if rigid else 0
    bl = roots(boundary, n - held)
    root, _, tip = boundary.partition("_")
    conditions = [_row(bl, k, 0.0) for k in _ENDS[root]] + [_row(bl, k, 1.0) for k in _ENDS[tip]]
    coefficients: Array = np.linalg.svd(np.stack(conditions, axis=1))[2][:, -1, :]
    # With end conditions in which f f''' = 0 and f' f'' = 0, f'''' = b^4 f integrates by parts to
    # int f^2 dx = L/4 (f^2 - 2 f' f'''/b^4 + f''^2/b^4) at x = L.
    d = [np.einsum("kj,kj->k", _row(bl, k, 1.0), coefficients) for k in range(4)]
    norm = 0.25 * (d[0] ** 2 - 2.0 * d[1] * d[3] + d[2] ** 2)
    lead = min(k for k in range(3) if k not in _ENDS[root])
    start = np.einsum("kj,kj->k", _row(bl, lead, 0.0), coefficients)
    coefficients *= (np.sign(start) / np.sqrt(norm))[:, None]
    wavenumber = np.concatenate([np.zeros(held), bl / length])
    table: Array = np.vstack([np.zeros((held, 4)), coefficients])
    return Modes(length, wavenumber, table, held)


def sine_modes(n: int, length: float) -> Modes:
    """Axial or torsional modes sqrt(2) sin((2k - 1) pi x / 2L) of a bar held at its root."""
    wavenumber = np.asarray((np.arange(1, n + 1) - 0.5) * np.pi / length, dtype=np.float64)
    return Modes(length, wavenumber, np.tile([0.0, np.sqrt(2.0), 0.0, 0.0], (n, 1)))


def _row(bl: Array, derivative: int, xi: float) -> Array:
    """Derivative of the four split functions at x = xi L, divided by b^d: shape (n, 4)."""
    angle = bl * xi + derivative * (np.pi / 2.0)
    if derivative and xi == 0.0:  # exact quarter turns: no 6e-17 in place of zero
        angle = np.full_like(bl, derivative % 4)
        cosine = np.choose(angle.astype(int), [1.0, 0.0, -1.0, 0.0])
        sine = np.choose(angle.astype(int), [0.0, 1.0, 0.0, -1.0])
    else:
        cosine, sine = np.cos(angle), np.sin(angle)
    decay, rise = (-1.0) ** derivative * np.exp(-bl * xi), np.exp(-bl * (1.0 - xi))
    return np.stack([cosine, sine, decay, rise], axis=1)
