"""Section forces of a reduced solid, and von Mises stress on the surface of its mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.superelement import Superelement


def resultants(
    solid: Superelement,
    d: Array,
    station: Array,
    loads: Sequence[tuple[Array, Array]],
    eta: Array,
) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz, shape (nt, nx, 6), as those of a beam.

    The mass beyond a section needs a force that is linear in the forces of the mass points; its
    moment arms are the undeformed ones.
    """
    force = np.einsum("xs,tsd->txd", solid.outer, station, optimize=True)
    arm, pull = solid.outer_moment, station
    moment = np.empty_like(force)
    for a, (b, c) in enumerate(((1, 2), (2, 0), (0, 1))):
        moment[:, :, a] = pull[:, :, c] @ arm[:, :, b].T - pull[:, :, b] @ arm[:, :, c].T
    for node, (push, turn) in zip(solid.nodes, loads, strict=True):
        beyond = solid.x <= max(node.place[0], 0.0) * (1.0 + 1e-9)
        at = node.place + eta @ node.Phi[:3].T
        force[:, beyond] += push[:, None]
        moment[:, beyond] += (turn + np.cross(at, push))[:, None]
    place = d[:, :, :3].copy()
    place[:, :, 0] += solid.x
    moment -= np.cross(place, force)
    return -np.concatenate([force, moment], axis=2)


def surface(
    solid: Superelement, station: Array, loads: Sequence[tuple[Array, Array]]
) -> dict[str, Array]:
    """Arrays on the surface of the mesh, by name: nodes, triangles and von_mises.

    The stress is that of the solid under the forces that its mass and what hangs on it need, so it
    is in balance with them however few modes there are (mode acceleration). Rigid interfaces hold
    their faces flat: within a diameter of them the stress is that of this support.

    Returns:
        nodes (nc, 3) in the beam frame of the undeformed link (m), triangles (ntri, 3), von_mises
        (nt, nc) in Pa; nothing for a body without mesh.
    """
    if solid.stress is None:
        return {}
    need = [station.reshape(len(station), -1), *(part for load in loads for part in load)]
    s = np.einsum("cak,tk->tac", solid.stress, np.concatenate(need, axis=1), optimize=True)
    mises = np.sqrt(
        0.5 * ((s[:, 0] - s[:, 1]) ** 2 + (s[:, 1] - s[:, 2]) ** 2 + (s[:, 2] - s[:, 0]) ** 2)
        + 3.0 * (s[:, 3] ** 2 + s[:, 4] ** 2 + s[:, 5] ** 2)
    )
    nodes, triangles = solid.corners, solid.triangles.astype(float)
    return {"nodes": nodes, "triangles": triangles, "von_mises": mises}
