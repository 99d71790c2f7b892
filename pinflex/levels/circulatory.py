"""Loads without a potential: followers, and moments that keep their direction in space.

Their stiffness is not symmetric, so that modes may couple into flutter, s = a + i b, before or
instead of buckling. In the modes x of the symmetric part, of unit mass and omega^2, it is

    (diag(omega^2) + x' K_skew x) z = - s^2 z

Source: Bolotin, Nonconservative Problems of the Theory of Elastic Stability (1963).
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.system import System

_REAL = 1e-7  # of |s|: round-off of a growth or a turn; at a double root it is its square root


def acts_without_potential(system: System, t: float = 0.0) -> bool:
    """Whether a load at a time t [s] follows its frame, or is a moment."""
    loads = (force for force, _ in system.loads.forces if force.scale(t))
    return any(force.follower or any(force.moment) for force in loads)


def coupled(skew: Array, x: Array, omega2: Array) -> tuple[Array, Array]:
    """Eigenvalues s [1/s], Im s >= 0, the growing one of a divergence, slowest first, and shapes.

    Returns:
        s (k,); real shapes (n, k) of unit mass: two that flutter are the real and the imaginary
        part of one.
    """
    values, z = np.linalg.eig(np.diag(omega2) + x.T @ skew @ x)
    s = 1j * np.sqrt(values.astype(complex))
    s = np.where(s.imag < 0, -s, s)
    s = np.where(np.abs(s.imag) <= _REAL * np.abs(s), np.abs(s.real), s)
    s = np.where(np.abs(s.real) <= _REAL * np.abs(s), 1j * s.imag, s)
    order = np.argsort(np.where(s.imag > 0, 1.0, -1.0) * np.abs(s), kind="stable")
    s, z = s[order], z[:, order]
    largest = z[np.argmax(np.abs(z), axis=0), np.arange(len(s))]
    z = z * (np.abs(largest) / largest)
    parts = np.where((s.imag > 0) & (s.real < 0), z.imag, z.real)
    return s, x @ (parts / np.linalg.norm(parts, axis=0))
