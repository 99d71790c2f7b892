"""St-Venant torsion: fields of shear stress for a torque of one, and torsion moduli."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pinflex.description.section import Section


def plane(section: Section, y: float, z: float) -> tuple[float, float]:
    """tau_xy, tau_xz [1/m^3] at (y, z) where sections stay plane: round ones."""
    return -z / section.J, y / section.J


def rectangle(section: Section, y: float, z: float) -> tuple[float, float]:
    """tau_xy, tau_xz [1/m^3] at (y, z) of a solid rectangle, from Prandtl's stress function."""
    size = dict(section.dimensions)
    if size["thickness"] <= size["width"]:
        ds, dl = _prandtl(size["thickness"] / 2, size["width"] / 2, y, z)
        return dl / section.J, -ds / section.J
    ds, dl = _prandtl(size["width"] / 2, size["thickness"] / 2, z, y)
    return ds / section.J, -dl / section.J


def _prandtl(a: float, b: float, s: float, long: float) -> tuple[float, float]:
    """d phi/ds and d phi/dl of the stress function for G twist = 1, half sides a <= b."""
    n = np.arange(1.0, 400.0, 2.0)  # ends at 1e-5 of the largest stress, beside the corners
    k = n * np.pi / (2 * a)
    sign = np.where(n % 4 == 1, 1.0, -1.0)
    far, near = np.exp(-k * (b - abs(long))), np.exp(-k * (b + abs(long)))
    whole = 1 + np.exp(-2 * k * b)
    cosh, sinh = (far + near) / whole, np.sign(long) * (far - near) / whole
    gain = 32 * a**2 / np.pi**3 * sign / n**3 * k
    # The part without cosh is the parabola a^2 - s^2, summed in closed form.
    ds = -2 * s + float(np.sum(gain * cosh * np.sin(k * s)))
    return ds, -float(np.sum(gain * sinh * np.cos(k * s)))


def rectangle_modulus(a: float, b: float) -> float:
    """Torsion modulus T / tau_max [m^3] of a rectangle a >= b.

    The largest stress is at the middle of the long side.

    J = a b^3/3 (1 - 192 b/(pi^5 a) sum tanh(n pi a/(2b)) / n^5)
    tau_max = G twist b (1 - 8/pi^2 sum 1 / (n^2 cosh(n pi a/(2b)))),  n = 1, 3, 5, ...

    Source: Timoshenko, Goodier, Theory of Elasticity (3rd ed.), section 109.
    """
    n = np.arange(1.0, 40.0, 2.0)  # the first term left out of J is 41^-5 = 1e-8 of the first
    x = n * np.pi * a / (2 * b)
    sech = 2 * np.exp(-x) / (1 + np.exp(-2 * x))
    J = a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * float(np.sum(np.tanh(x) / n**5)))
    return float(J / (b * (1 - 8 / np.pi**2 * float(np.sum(sech / n**2)))))
