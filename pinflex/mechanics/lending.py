"""Equations lent to one run after the other, for what they hold takes longer than a short run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pinflex.mechanics import workspace
from pinflex.mechanics.compiled import serves
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.system import System

_KEPT = 2  # of all systems: one that is solved again and again, and what it is compared with
_LARGEST = 1e8  # bytes of a workspace: a larger one goes back to those that other systems share
_ready: list[tuple[bool, Equations]] = []  # newest first


@contextmanager
def lent(system: System, marched: bool) -> Iterator[Equations]:
    """Equations of a system that are their borrower's own until the block ends.

    Those of a run that broke off are not lent again.

    Args:
        system: That is evaluated. marched: See `Equations`.
    """
    compiled = serves(system, marched)
    found = _taken(system, compiled) or Equations(system, marched=marched)
    yield found
    if workspace.size(found.model) <= _LARGEST:
        _ready.insert(0, (compiled, found))
        del _ready[_KEPT:]


def _taken(system: System, compiled: bool) -> Equations | None:
    """Those that are ready for a system, with the kernel or without it as it is now."""
    for entry in tuple(_ready):
        if entry[1].system is system and entry[0] == compiled:
            try:
                _ready.remove(entry)
            except ValueError:  # taken meanwhile, by another thread
                continue
            return entry[1]
    return None
