"""What the rigid mechanism holds beside its motors: elastic joints, idle freedoms, a free base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.description.description import Description
from pinflex.linalg import independent_rows
from pinflex.mechanics import assembly
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.freedoms import INDEPENDENT, Freedoms, Idle, allowed
from pinflex.mechanics.system import Springs, System


def elastic_rows(J: Array, motors: IntArray, springs: Springs) -> IntArray:
    """Velocity rows of elastic joints: passive, with a spring, and held by nothing else.

    With the motors locked the closures leave the null space N of J's passive columns. Each row of
    a sprung joint in it takes one freedom away, the stiffest first; a sprung joint whose motion
    the loops determine anyway (a flexure hinge of a closed chain) is not among them.

    Returns:
        Rows, increasing.
    """
    sprung = ~np.isin(springs.v_at, motors)
    rows, stiffness = springs.v_at[sprung], springs.stiffness[sprung]
    if not len(rows):
        return rows
    N = allowed(J, motors)[rows]
    largest = float(np.sqrt(np.max(stiffness)))
    picked = independent_rows(np.sqrt(stiffness)[:, None] * N, INDEPENDENT, largest)
    return np.sort(rows[picked]).astype(np.intp)


def _base_rows(base: str) -> IntArray:
    """Velocity rows of a free base."""
    return np.arange(6 if base == "free_flyer" else 0, dtype=np.intp)


def idle_of(system: System, description: Description, home: Array) -> Idle:
    """The idle freedoms at home, a free base among them."""
    if description.idle == "free":
        return Idle()
    # A loop to the ground determines the base as it does any other body.
    stands = any(loop.grounded for loop in description.loops)
    base = _base_rows("fixed" if stands else description.base)
    locked = np.unique(np.concatenate([system.motors, system.held, base])).astype(np.intp)
    frames, found = system.expansion.frames, Idle()
    if len(locked) + system.closed.n < system.nv:
        J = Equations(system).close(home)[1].copy() if system.closed.n else np.zeros((0, system.nv))
        named = (*description.frames, *description.loaded)
        still = None if description.platform is None else frames[description.platform]
        every = Freedoms(Equations(system), home)
        found = every.idle(J, locked, [frames[name] for name in named], still)
    if not len(base):
        return found
    return replace(found, base=base, names=("free base", *found.names))


def at_rest(system: System, description: Description, home: Array, names: Sequence[str]) -> Array:
    """Home with the elastic joints where their springs are slack, unless `home` places them."""
    s = system.springs
    moved = home.copy()
    for k in np.flatnonzero(np.isin(s.v_at, system.held)):
        if names[s.v_at[k]] not in description.home:
            at, rest = s.q_at[k], s.rest[k]
            moved[at : at + 1 + s.paired[k]] = (np.cos(rest), np.sin(rest)) if s.paired[k] else rest
    if np.array_equal(moved, home) or not system.closed.n:
        return moved
    pose, size = assembly.close_loops(Equations(system), moved, system.free)
    return pose if size < 10 * assembly.CLOSED else home
