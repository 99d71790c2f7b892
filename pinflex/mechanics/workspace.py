"""Pinocchio workspaces kept for the next run, because a new one is dear.

A `pin.Data` has four tensors of nV^3 numbers for second derivatives that nobody here reads: 0.14 GB
and 60 ms at nV = 165, 2 GB at nV = 400. A few small ones are kept; large ones go at once.
"""

from __future__ import annotations

import pinocchio as pin

_KEPT = 3
_LARGEST = 0.3e9  # bytes: a few of these may stay around unnoticed
_spare: list[tuple[pin.Model, pin.Data]] = []


def size(model: pin.Model) -> float:
    """Bytes that the tensors of a workspace take."""
    return 4.0 * 8.0 * float(model.nv) ** 3


def take(model: pin.Model) -> pin.Data:
    """A workspace of a model: one that lies about, or a new one."""
    for number, (owner, _) in enumerate(_spare):
        if owner is model:
            return _spare.pop(number)[1]
    return model.createData()


def give_back(model: pin.Model, data: pin.Data) -> None:
    """Keep a workspace that a run has finished with."""
    if size(model) <= _LARGEST:
        _spare.append((model, data))
        del _spare[:-_KEPT]
