"""Blocks of the coordinate map: neighbouring bodies of equal shape side by side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.expanded import Block

Row = tuple[int, Array, Array | None]  # velocity row of the expanded model, Phi (n,), G (n, n)


def stack(
    model: pin.Model, slices: Sequence[slice], maps: Sequence[Sequence[Row]]
) -> tuple[Block, ...]:
    """Group neighbouring bodies of equal shape.

    Returns:
        Blocks in the order of the bodies; curved rows come first in each.
    """
    sorted_maps = [sorted(rows, key=_straight) for rows in maps]
    shapes = [
        (len(rows), sum(not _straight(row) for row in rows), eta.stop - eta.start)
        for rows, eta in zip(sorted_maps, slices, strict=True)
    ]
    q_of = _positions(model)
    blocks = []
    for (_, curved, n), numbers in groupby(range(len(slices)), key=lambda k: shapes[k]):
        group = list(numbers)
        rows = np.array([[m[0] for m in sorted_maps[k]] for k in group], dtype=np.intp)
        Phi = np.array([[m[1] for m in sorted_maps[k]] for k in group], dtype=float)
        G = np.array([[m[2] for m in sorted_maps[k][:curved]] for k in group], dtype=float)
        eta = slice(slices[group[0]].start, slices[group[-1]].stop)
        G = G.reshape(len(group), curved, n, n)
        G = 0.5 * (G + G.swapaxes(2, 3))  # eta' G eta has no other part
        blocks.append(Block(rows, q_of[rows.ravel()], Phi, G, eta))
    return tuple(blocks)


def _straight(row: Row) -> bool:
    """Whether a row is linear in eta."""
    return row[2] is None


def _positions(model: pin.Model) -> IntArray:
    """Position in Q of each velocity row of a joint with as many of one as of the other."""
    q_of = np.empty(model.nv, dtype=np.intp)
    for joint in model.joints[1:]:
        if joint.nq == joint.nv:
            q_of[joint.idx_v : joint.idx_v + joint.nv] = joint.idx_q + np.arange(joint.nv)
    return q_of
