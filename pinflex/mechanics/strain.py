"""Elastic potential of deformed links: energy, force, and the stiffness of bent bodies.

Once in numpy, and once as tables for the compiled kernel (kernel/source/strain.c).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.curvature import Curvature
from pinflex.mechanics.system import System

# What bodies consist of: stations and K are in the model, its map and System.K, the rest is here.
# A field beyond these may be a term that the kernel lacks (see `kernel_tables.uncovered`).
BODIES: tuple[tuple[type, str], ...] = (
    (FlexibleBody, "n length families slices labels second_order x mass Phi G xt It Phi_t G_t "
     "rotary inertia Phi_r G_r K M D root_moves solid curvature"),
    (Curvature, "bend slope weight"),
)  # fmt: skip


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


def strain_tables(system: System) -> dict[str, Any]:
    """Rows of slope and bend of links that bend far, point by point."""
    links = [(slot.eta.start, slot.body.curvature) for slot in system.expansion.slots]
    bent = [(first, one) for first, one in links if one is not None]
    shapes = np.array([one.slope.shape for _, one in bent], dtype=np.intp).reshape(-1, 3)

    def flat(rows: list[Array]) -> Array:
        return np.concatenate([np.zeros(0), *(x.transpose(1, 0, 2).ravel() for x in rows)])

    return {
        "bent_first": [first for first, _ in bent], "bent_n": shapes[:, 2],
        "bent_directions": shapes[:, 0],
        "bent_at": np.concatenate([[0], np.cumsum(shapes.prod(axis=1))]),
        "bent_point": np.concatenate([[0], np.cumsum(shapes[:, 1])]),
        "bent_slope": flat([one.slope for _, one in bent]),
        "bent_bend": flat([one.bend for _, one in bent]),
        "bent_weight": np.concatenate([np.zeros(0), *(one.weight for _, one in bent)]),
    }  # fmt: skip
