"""Pinocchio workspaces kept for the next run, because a new one is expensive to create.

A `pin.Data` has four tensors of nV^3 numbers for second derivatives that nobody here reads: 0.14 GB
and 60 ms at nV = 165, 2 GB at nV = 400. Some are kept, up to a sum; a larger one while a run goes
on. What a workspace is made for is the tree of joints alone: masses, gravity and placements are
read from the model at each call, so that the next load of a mechanism, or the next case of a sweep,
finds it ready.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

import numpy as np
import pinocchio as pin

_BUDGET = 1.4e9  # bytes in all: up to nV = 350, or delta's two, with fewer planes and with more
_spare: dict[int, tuple[pin.Model, pin.Data]] = {}  # oldest first
_number = count()
_runs: list[None] = []  # one for each run that is going on


def size(model: pin.Model) -> float:
    """Bytes that the tensors of a workspace take."""
    return 4.0 * 8.0 * float(model.nv) ** 3


def acquire(model: pin.Model) -> pin.Data:
    """A spare workspace for the same joint tree, else a new one."""
    for number, (owner, _) in tuple(_spare.items()):
        if same_tree(owner, model):
            found = _spare.pop(number, None)  # None: taken meanwhile, by another thread
            if found is not None:
                return found[1]
    _make_room(size(model))
    # Freeing one block of nearly 32 MB tells glibc to keep such blocks: else it maps and faults in
    # every matrix above 128 kB anew, and a tangent of nV = 270 takes four times as long.
    np.empty(4_000_000)
    return pin.Data(model)  # model.createData() makes two and copies one into the other


def release(model: pin.Model, data: pin.Data) -> None:
    """Keep a workspace that is not needed now, in place of the oldest spare ones.

    Args:
        model: Model that the workspace belongs to.
        data: The workspace, which its owner no longer uses.
    """
    if _runs or size(model) <= _BUDGET:
        _spare[next(_number)] = model, data
        _make_room()


def forget(model: pin.Model) -> None:
    """Free the spare workspaces of a joint tree that nothing will be solved on."""
    for number, (owner, _) in tuple(_spare.items()):
        if same_tree(owner, model):
            _spare.pop(number, None)


@contextmanager
def keep_alive() -> Iterator[None]:
    """While a run goes on its workspaces stay, however large: its parts take them in turn."""
    _runs.append(None)
    try:
        yield
    finally:
        _runs.pop()
        _make_room()


def _make_room(wanted: float = 0.0) -> None:
    """Let the oldest go until the others and one of `wanted` bytes are within the budget."""
    while _spare and not _runs:
        if wanted + sum(size(owner) for owner, _ in tuple(_spare.values())) <= _BUDGET:
            return
        _spare.pop(next(iter(tuple(_spare)), -1), None)


def same_tree(one: pin.Model, other: pin.Model) -> bool:
    """Equal kinds and axes of joints (with their indices) on equal parents, as many frames.

    Args:
        one, other: Models.
    """
    return one is other or (
        one.nv == other.nv
        and one.nframes == other.nframes
        and list(one.parents) == list(other.parents)
        and all(a == b for a, b in zip(one.joints, other.joints, strict=True))
    )
