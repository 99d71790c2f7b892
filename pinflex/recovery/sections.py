"""Deflections of the sections of flexible links, from elastic coordinates alone."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.expanded import Slot
from pinflex.mechanics.frames import poses_of_frames
from pinflex.recovery import stress
from pinflex.recovery.links import centre_line, off_straight


def deflections(dynamics: Equations, y: Array) -> dict[str, tuple[Array, Array]]:
    """By link: sections x (nx,), m, and how far they move in the link's root frame, (n, nx, 3).

    The sections and values are those of the first three columns of a Result's `deflection`.
    """
    slots = dynamics.system.expansion.slots
    by_link: dict[str, list[Slot]] = {}
    for slot in slots:
        by_link.setdefault(slot.link, []).append(slot)
    eta, found = y[:, int(dynamics.system.rigid.nq) :], {}
    for link, own in by_link.items():
        at, moved = [], []
        # Bodies beyond the first ride on the one before: where to, their roots say.
        roots = poses_of_frames(dynamics, y, [s.root for s in own]) if own[1:] else []
        for k, slot in enumerate(own):
            cut = slot.body.cut
            d = stress.deflections(cut, eta[:, slot.eta])[:, :, :3]
            if k:
                line = centre_line(d, cut.x, *roots[k])
                d = off_straight(line, slot.offset + cut.x, *roots[0])
            at.append(slot.offset + cut.x[min(k, 1) :])
            moved.append(d[:, min(k, 1) :])
        found[link] = np.concatenate(at), np.concatenate(moved, axis=1)
    return found
