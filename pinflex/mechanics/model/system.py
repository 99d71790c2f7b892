"""A mechanism as equations: the expanded model, its closures, stiffness, damping and motors."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray, distinct, others
from pinflex.kernel.evaluate import Spares
from pinflex.mechanics.evaluation import kernel_tables
from pinflex.mechanics.kinks import Kinks
from pinflex.mechanics.model.loads import AddedMasses, DryFriction, Expansion, Loads, Springs
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.description.loops import Loop
    from pinflex.mechanics.closure import Closures


def _none() -> IntArray:
    return np.zeros(0, dtype=np.intp)


# What a system knows once it was asked, and follows from its joints and rows alone.
_OF_JOINTS = ("free", "unheld", "uncovered", "looked_at", "sorted_joints", "node_of_joints")


@frozen
class System:
    """A rigid or flexible mechanism as equations: model, map, closures, stiffness, damping.

    Attributes:
        rigid: Pinocchio model whose coordinates q and v are kept.
        expansion: Expanded model and map.
        closed: Independent closure rows.
        K, D: Stiffness and damping, shape (nv, nv), N m/rad | N/m and N m s/rad | N s/m.
        springs: Joint springs (their stiffness is not in K).
        motors: Velocity rows of the actuated joints.
        loads: Forces and springs between frames.
        held: Velocity rows that stay where home has them: elastic joints of the rigid
            mechanism, what is idle, a free base but at level coupled.
        friction: Dry friction of joints.
        added: Inertia that differs with the direction.
        kinks: Laws of pieces: dead zones, stops, cables, tables.
    """

    rigid: pin.Model
    expansion: Expansion
    closed: Closures
    K: Array
    D: Array
    springs: Springs
    motors: IntArray
    loads: Loads
    held: IntArray = field(default_factory=_none)
    friction: DryFriction = field(default_factory=DryFriction)
    added: AddedMasses = field(default_factory=AddedMasses)
    kinks: Kinks = field(default_factory=Kinks)

    @property
    def nq(self) -> int:
        """Length of y: rigid configuration and eta."""
        return int(self.rigid.nq) + self.expansion.n_eta

    @property
    def nv(self) -> int:
        """Length of v: rigid velocities and deta/dt."""
        return int(self.rigid.nv) + self.expansion.n_eta

    @property
    def n_eta(self) -> int:
        """Number of elastic coordinates."""
        return self.expansion.n_eta

    def integrate(self, y: Array, dy: Array) -> Array:
        """y (nq,) moved by dy (nv,) on the configuration manifold (right-trivialised)."""
        q, v = int(self.rigid.nq), int(self.rigid.nv)
        if q == v:
            return y + dy
        return np.concatenate([pin.integrate(self.rigid, y[:q], dy[:v]), y[q:] + dy[v:]])

    def difference(self, y0: Array, y1: Array) -> Array:
        """dy (nv,) that takes y0 to y1, shape (nq,) each."""
        q = int(self.rigid.nq)
        if q == int(self.rigid.nv):
            return y1 - y0
        return np.concatenate([pin.difference(self.rigid, y0[:q], y1[:q]), y1[q:] - y0[q:]])

    def dissipation(self, v: Array) -> Array:
        """Power that damping and friction take at speeds v (..., nv), shape (...), W."""
        loss = np.sum(v @ self.D * v, axis=-1)
        return np.asarray(loss + self.friction.power(v) if self.friction.present else loss)

    def in_steps(self, h: float, apart: Collection[float] = ()) -> System:
        """The system as equal steps of h [s] feel it: loads that switch are spread over one.

        Not at times `apart`, such as those at which a mass comes or goes: there steps begin anew.
        """
        if not self.loads.timed:
            return self
        return replace(self, loads=self.loads.spread(h, apart))

    def weighed(self, rigid: pin.Model, expansion: Expansion, K: Array, D: Array) -> System:
        """The system with other masses, stiffness and damping on the same joints.

        What is known of its rows, and tables of the kernel, go along.
        """
        found, known = replace(self, rigid=rigid, expansion=expansion, K=K, D=D), vars(self)
        vars(found).update({name: known[name] for name in _OF_JOINTS if name in known})
        if "tables" in known:
            vars(found)["tables"] = kernel_tables.weighed(self.tables, found)
        return found

    @property
    def sliding(self) -> System:
        """The system without dry friction: at rest its slope would hold every joint."""
        return replace(self, friction=DryFriction()) if self.friction.present else self

    def sticks(self, prescribed: bool) -> bool:
        """Whether dry friction acts where motors do not prescribe the speed, so that it may stick.

        `prescribed`: whether motors do; else they push, and may stick too.
        """
        if not self.friction.present:
            return False
        moving = self.free if prescribed else self.unheld
        return bool(np.any(np.isin(self.friction.rows, moving)))

    @cached_property
    def free(self) -> IntArray:
        """Velocity rows that neither motors nor the rigid level hold."""
        return others(self.nv, distinct(self.held, self.motors))

    @cached_property
    def unheld(self) -> IntArray:
        """Velocity rows that move: those of motors among them."""
        return others(self.nv, self.held)

    @cached_property
    def looked_at(self) -> tuple[int, ...]:
        """Joints of the expanded model whose poses, motions or forces are outputs; 0: the base."""
        model, slots = self.expansion.model, self.expansion.slots
        joints = {int(model.getJointId(name)) for name in list(self.rigid.names)[1:]}
        joints |= {place.joint for place in self.expansion.frames.values()}
        joints |= {slot.root.joint for slot in slots}
        joints |= {each.bottom(model) for slot in slots for each in slot.interfaces}
        joints |= {joint for slot in slots for joint in slot.turning}
        return tuple(sorted(joints | {0}))

    uncovered = cached_property(kernel_tables.uncovered)
    sorted_joints = cached_property(kernel_tables.sorted_joints)
    node_of_joints = cached_property(kernel_tables.node_of_joints)
    tables = cached_property(kernel_tables.tables)

    @cached_property
    def spares(self) -> Spares:
        """Workspaces of the compiled kernel that the next run finds ready."""
        return Spares()


@dataclass(frozen=True)
class Idle:
    """What is idle, and how it is held.

    Attributes:
        spins: Closures of kind "spin", one for each rod between balls.
        rows: Velocity rows of other idle coordinates. loose: Those with inertia, which level
            coupled lets go. base: Rows of a free base.
        names: For reports.
    """

    spins: tuple[Loop, ...] = ()
    rows: IntArray = field(default_factory=_none)
    loose: IntArray = field(default_factory=_none)
    base: IntArray = field(default_factory=_none)
    names: tuple[str, ...] = ()

    @property
    def held(self) -> IntArray:
        """Rows that all levels but coupled hold."""
        return distinct(self.rows, self.base)
