"""Elastic potential of deformed links: energy, force, and the stiffness of bent bodies.

Once in numpy, and once as tables for the compiled kernel (kernel/source/strain.c).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.section_at import Curvature

if TYPE_CHECKING:
    from pinflex.mechanics.model.system import System

# What bodies consist of: stations and K are in the model, its map and System.K, the rest is here.
# A field beyond these may be a term that the kernel lacks (see `kernel_tables.uncovered`).
BODIES: tuple[tuple[type, str], ...] = (
    (FlexibleBody, "n length families slices labels second_order x mass Phi G xt It Phi_t G_t "
     "rotary inertia Phi_r G_r K M D root_moves solid curvature rest"),
    (Curvature, "bend slope weight"),
)  # fmt: skip


class Strain:
    """Links' potential e' K e / 2 of e = eta - rest, and what bodies of third order add to it.

    Attributes:
        stiffness: K of the links by eta, shape (n_eta, n_eta).
        rest: Coordinates at which they are free of stress, shape (n_eta,).
    """

    def __init__(self, system: System) -> None:
        """Copy the links' block of the system's stiffness."""
        n = int(system.rigid.nv)
        self.stiffness = np.ascontiguousarray(system.K[n:, n:])
        self.rest = at_rest(system)
        links = [(slot.eta, slot.body.curvature) for slot in system.expansion.slots]
        self._curved = [(at, bent) for at, bent in links if bent is not None]

    def force(self, eta: Array) -> Array:
        """Resistance of the links to elastic coordinates (..., n_eta), the same shape."""
        force = np.asarray((eta - self.rest).dot(self.stiffness))
        for at, bent in self._curved:
            force[..., at] += bent.force(eta[..., at])
        return force

    def energy(self, eta: Array) -> Array:
        """Strain energy (J) at elastic coordinates (..., n_eta), shape (...)."""
        off = eta - self.rest
        energy = 0.5 * np.sum(off @ self.stiffness * off, axis=-1)
        for at, bent in self._curved:
            energy = energy + bent.energy(eta[..., at])
        return np.asarray(energy)

    def bent(self, eta: Array) -> list[tuple[slice, Array]]:
        """Stiffness beside K of bodies of third order at eta (n_eta,), by their coordinates."""
        return [(at, bent.stiffness(eta[at])) for at, bent in self._curved]


def at_rest(system: System) -> Array:
    """Elastic coordinates at which links are free of stress, shape (n_eta,)."""
    rest = np.zeros(system.n_eta)
    for slot in system.expansion.slots:
        if slot.body.rest is not None:
            rest[slot.eta] = slot.body.rest
    return rest


def strain_tables(system: System) -> dict[str, Any]:
    """Where links are free of stress; rows of slope and bend of those that bend far, by points."""
    links = [(slot.eta.start, slot.body.curvature) for slot in system.expansion.slots]
    bent = [(first, one) for first, one in links if one is not None]
    shapes = np.array([one.slope.shape for _, one in bent], dtype=np.intp).reshape(-1, 3)

    def flat(rows: list[Array]) -> Array:
        return np.concatenate([np.zeros(0), *(x.transpose(1, 0, 2).ravel() for x in rows)])

    return {
        "rest": at_rest(system),
        "bent_first": [first for first, _ in bent], "bent_n": shapes[:, 2],
        "bent_directions": shapes[:, 0],
        "bent_at": np.concatenate([[0], np.cumsum(shapes.prod(axis=1))]),
        "bent_point": np.concatenate([[0], np.cumsum(shapes[:, 1])]),
        "bent_slope": flat([one.slope for _, one in bent]),
        "bent_bend": flat([one.bend for _, one in bent]),
        "bent_weight": np.concatenate([np.zeros(0), *(one.weight for _, one in bent)]),
    }  # fmt: skip
