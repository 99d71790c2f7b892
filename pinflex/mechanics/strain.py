"""Elastic potential of deformed links: energy, force, and the stiffness of bent bodies."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.system import System


class Strain:
    """Links' potential eta' K eta / 2, and what bodies of third order add to it.

    Attributes:
        stiffness: K of the links by eta, shape (n_eta, n_eta).
    """

    def __init__(self, system: System) -> None:
        """Copy the links' block of the system's stiffness."""
        n = int(system.rigid.nv)
        self.stiffness = np.ascontiguousarray(system.K[n:, n:])
        links = [(slot.eta, slot.body.curvature) for slot in system.expansion.slots]
        self._curved = [(at, bent) for at, bent in links if bent is not None]

    def force(self, eta: Array) -> Array:
        """Resistance of the links to elastic coordinates (..., n_eta), the same shape."""
        force = np.asarray(eta.dot(self.stiffness))
        for at, bent in self._curved:
            force[..., at] += bent.force(eta[..., at])
        return force

    def energy(self, eta: Array) -> Array:
        """Strain energy (J) at elastic coordinates (..., n_eta), shape (...)."""
        energy = 0.5 * np.sum(eta @ self.stiffness * eta, axis=-1)
        for at, bent in self._curved:
            energy = energy + bent.energy(eta[..., at])
        return np.asarray(energy)

    def bent(self, eta: Array) -> list[tuple[slice, Array]]:
        """Stiffness beside K of bodies of third order at eta (n_eta,), by their coordinates."""
        return [(at, bent.stiffness(eta[at])) for at, bent in self._curved]
