"""What the page computes from the states of a run as `pinflex.recovery` does: poses, stresses.

Everything here is read off the mechanism: which nodes of the kernel's tree carry what, and the
sections of the links. Arrays are named, so that a slider that changes them finds them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.expanded import Attachment, Slot
from pinflex.mechanics.model.system import System

Keep = Callable[[str, Any], int]  # an array by name: its number


def outputs(mechanism: Mechanism, system: System, keep: Keep) -> dict[str, Any]:
    """Links, bodies, platform and joints of a system; `keep` takes the arrays."""
    frames = system.expansion.frames
    node_of = system.node_of_joints

    def place(name: str, at: Attachment) -> list[int]:
        here = np.column_stack([at.placement.rotation, at.placement.translation])
        return [int(node_of[at.joint]), keep(name, here)]

    links = []
    for name, part in mechanism.parts.items():
        slots = [slot for slot in system.expansion.slots if slot.link == name]
        section = part.spec.section
        links.append({
            "name": name,
            "pieces": [
                _piece(f"link/{name}/{k}", slot, system, keep, place)
                for k, slot in enumerate(slots)
            ],
            "section": keep(
                f"link/{name}/section", [section.A, section.Iy, section.Iz, section.Wt]
            ),
            "fibres": keep(f"link/{name}/fibres", np.array(section.fibres)),
        })  # fmt: skip
    bodies = {
        link.name: place(f"body/{link.name}", frames[link.name])
        for link in mechanism.links
        if link.name not in mechanism.parts and link.name in frames
    }
    platform = mechanism.description.platform
    joints = {
        name: int(node_of[int(system.expansion.model.getJointId(name))])
        for name in mechanism.rigid.rigid.names[1:]
    }
    return {
        "links": links,
        "bodies": bodies,
        "platform": place("platform", frames[platform]) if platform else None,
        "joints": joints,
        "loops": list(system.closed.names),
    }


def _piece(
    key: str, slot: Slot, system: System, keep: Keep, place: Callable[[str, Attachment], list[int]]
) -> dict[str, Any]:
    """One body of a link."""
    body, cut = slot.body, slot.body.cut
    model = system.expansion.model
    arrays: dict[str, Array | None] = {
        "x": cut.x, "way": _way(cut.Phi, cut.G), "outer": cut.outer, "outer_twist": cut.outer_twist,
        "body_Phi": body.Phi, "body_x": body.x, "loads": np.array([i.x for i in slot.interfaces]),
        "stations": np.asarray(slot.stations), "twists": np.asarray(slot.twists),
        "offset": np.array([slot.offset]),
    }  # fmt: skip
    kept = {
        name: keep(f"{key}/{name}", x) for name, x in arrays.items() if x is not None and x.size
    }
    nodes = [int(system.node_of_joints[i.bottom(model)]) for i in slot.interfaces]
    root = place(f"{key}/root", slot.root)
    return kept | {"root": root, "eta": [slot.eta.start, slot.eta.stop], "nodes": nodes}


def _way(Phi: Array, G: Array | None) -> Array:
    """Displacements of sections by eta and its products: shape (nx, 6, n + n (n + 1) / 2).

    d = Phi eta + eta' G eta / 2, as one table of [eta; eta_i eta_j, i <= j]; without G: Phi.
    """
    if G is None:
        return Phi
    i, j = np.triu_indices(Phi.shape[-1])
    share = np.where(i == j, 0.25, 0.5)  # a square stands in G twice
    return np.concatenate([Phi, share * (G[..., i, j] + G[..., j, i])], axis=-1)
