"""Joints and closures of one system, at one state or at many.

Every call is a value: states go in, arrays that nothing overwrites come out. States are time-first,
y (n, nq); Pinocchio takes them one after the other, everything around it runs on stacked arrays.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.mechanics import workspace
from pinflex.mechanics.closure_rows import ClosureRows, Passing
from pinflex.mechanics.closure_state import ClosureState
from pinflex.mechanics.compiled import Compiled
from pinflex.mechanics.contact import left_beam, off_beam
from pinflex.mechanics.coordinate_map import Configuration, CoordinateMap
from pinflex.mechanics.evaluated import Closure
from pinflex.mechanics.one_by_one import OneByOne
from pinflex.mechanics.subtrees import Subtrees
from pinflex.mechanics.system import System
from pinflex.mechanics.whole import Whole

_DEAR = 1e6  # bytes of a workspace that a look does without
_SIZES = 8  # numbers of states whose index tables are kept
TOGETHER = 32  # states at a time: numpy's price for a call is spread, what is used stays in cache


class Kinematics(NamedTuple):
    """Joints and closures at n states.

    Attributes:
        here: Expanded configuration and map.
        poses: Of joints, shape (n, joints, 12), see `JointPoses`.
        J, dJ: World Jacobians of the joints and their rates, shape (n, 6, nV); dJ (0, 6, nV)
            without rates.
        closed: Loops, where there are any.
    """

    here: Configuration
    poses: Array
    J: Array
    dJ: Array
    closed: ClosureState | None


class Geometry:
    """Configurations, joints and closures of a system, on workspaces of its own.

    Attributes:
        system: What is evaluated. model: Its expanded model.
        n_rigid, nq_rigid: Rigid velocities and coordinates. flexible: Whether any link bends.
        vector_space: Whether y moves by plain addition. looped: Whether there are closures.
    """

    def __init__(self, system: System, often: bool = True) -> None:
        """`often`: worth a workspace, or the tables for the kernel."""
        self.system, self._often = system, often
        self.model: pin.Model = system.expansion.model
        self.map = CoordinateMap(system.rigid, system.expansion)
        self.n_rigid, self.nq_rigid = self.map.n_rigid, self.map.nq_rigid
        self.flexible = self.map.flexible
        self.vector_space = self.nq_rigid == self.n_rigid
        self.looped = system.closed.n > 0
        self._joints, self._nV = int(self.model.njoints), int(self.model.nv)
        self.slides = self.flexible and len(system.closed.contacts) > 0
        passes = self.slides and any(one.sleeve.segments for one in system.closed.contacts)
        self._passing = Passing(system.closed) if passes else None
        self._closures: dict[object, ClosureRows] = {}

    def __del__(self) -> None:
        if "data" in self.__dict__:
            workspace.release(self.model, self.data)

    # Made when first used: a run on the compiled kernel needs little of them.
    @cached_property
    def data(self) -> pin.Data:
        """Pinocchio's workspace of the whole model."""
        return workspace.acquire(self.model)

    @property
    def compiled(self) -> Compiled | None:
        """The system on the kernel; None: there are no more than poses here."""
        return None

    @cached_property
    def pinocchio(self) -> Whole | Subtrees:
        """Pinocchio on the model, in one piece or in parts."""
        parts = self.system.parts
        return Subtrees(self.model, parts) if parts else self._whole

    @cached_property
    def placing(self) -> OneByOne | Whole | Subtrees:
        """What places joints: for a look at a model of size it needs no workspace."""
        dear = workspace.size(self.model) > _DEAR
        return self.pinocchio if self._often or not dear else OneByOne(self.model)

    @cached_property
    def _whole(self) -> Whole:
        return Whole(self.model, self.data)

    def integrate(self, y: Array, dy: Array) -> Array:
        """y moved by dy on the configuration manifold (right-trivialised), shape (nq,).

        Args:
            y: Coordinates, shape (nq,).
            dy: Velocity rows times time, shape (nv,).
        """
        if self.vector_space:
            return y + dy
        moved = np.empty_like(y)
        n, m = self.nq_rigid, self.n_rigid
        moved[:n] = pin.integrate(self.system.rigid, y[:n], dy[:m])
        moved[n:] = y[n:] + dy[m:]
        return moved

    def difference(self, y0: Array, y1: Array) -> Array:
        """dy that takes y0 to y1, shape (nv,).

        Args:
            y0, y1: Coordinates, shape (nq,).
        """
        if self.vector_space:
            return y1 - y0
        n, m = self.nq_rigid, self.n_rigid
        dy = np.empty(self.system.nv)
        dy[:m] = pin.difference(self.system.rigid, y0[:n], y1[:n])
        dy[m:] = y1[n:] - y0[n:]
        return dy

    def at(self, y: Array, v: Array | None = None, a: Array | None = None) -> Configuration:
        """Expanded configuration and map, always with a first axis for the states.

        Args:
            y: Shape (nq,) or (n, nq). v, a: Shape (nv,) or (n, nv), both or neither.
        """
        return self.map.at(*(None if x is None else np.atleast_2d(x) for x in (y, v, a)))  # type: ignore[arg-type]

    def joint_poses(self, y: Array) -> Array:
        """Poses of the joints, see `JointPoses`, at y (nq,) or (n, nq), shape (n, joints, 12)."""
        Y = np.atleast_2d(y)
        out = np.empty((len(Y), self._joints, 12))
        for s in spans(len(Y)):
            out[s] = self.placing.poses(self.map.at(Y[s], passing=True).Q)
        return out

    def kinematics(self, y: Array, v: Array | None = None) -> Kinematics:
        """Joints and closures at y (nq,) or (n, nq); with v, the rates of the Jacobians too.

        Args:
            y: Coordinates, shape (nq,) or (n, nq).
            v: Velocities, shape (nv,) or (n, nv); None: no rates.
        """
        return self._kinematics(y, v, False)

    def _kinematics(self, y: Array, v: Array | None, passing: bool) -> Kinematics:
        Y, V = np.atleast_2d(y), None if v is None else np.atleast_2d(v)
        here = self.map.at(Y, V, None if V is None else np.zeros_like(V), passing)
        poses, J, dJ = self._placed(here, v is not None)
        loops = len(self.system.closed.names)
        closed = self._closed(poses, here, Y) if loops else None
        return Kinematics(here, poses, J, dJ, closed)

    def _placed(self, here: Configuration, rates: bool = False) -> tuple[Array, Array, Array]:
        """Joint poses (n, joints, 12), world Jacobians (n, 6, nV) and, if asked, their rates."""
        if rates:
            return self.pinocchio.jacobians(here.Q, here.V)
        return self.placing.jacobians(here.Q)

    def _closed(self, poses: Array, here: Configuration, Y: Array) -> ClosureState:
        n = len(poses)
        on = () if self._passing is None else self._passing.at(poses)
        rows = self._closures.get(on or n)
        if rows is None:
            if len(self._closures) > _SIZES:
                self._closures.clear()
            rows = ClosureRows(self.system.closed, n, self._joints, on)
            self._closures[on or n] = rows
        return rows.at(poses, Y[:, self.nq_rigid :], here.Q)

    def close(self, y: Array) -> Closure:
        """Closure residuals and their Jacobian at y (nq,) or (n, nq)."""
        if (compiled := self.compiled) is not None:
            c, J = compiled.evaluator.closures(np.atleast_2d(y))
            return Closure(c, J) if y.ndim > 1 else Closure(c[0], J[0])
        if y.ndim == 1:
            c, J = self.closure_of(self._kinematics(y, None, True))
            return Closure(c[0], J[0])
        rows, nv = self.system.closed.n, self.system.nv
        c, J = np.empty((len(y), rows)), np.empty((len(y), rows, nv))
        for s in spans(len(y)) if rows else ():
            c[s], J[s] = self.closure_of(self._kinematics(y[s], None, True))
        return Closure(c, J)

    def closure_of(self, at: Kinematics) -> Closure:
        """Closure residuals and their Jacobian where the joints are."""
        if at.closed is None:
            return Closure(np.zeros((len(at.J), 0)), np.zeros((len(at.J), 0, self.system.nv)))
        return Closure(at.closed.c, self._jacobian(at.here, at.closed, at.J))

    def _jacobian(self, here: Configuration, closed: ClosureState, J: Array) -> Array:
        """dc/dy = J_Q X, shape (n, rows, nv)."""
        found = here.times_map(closed.jacobian(J))
        if self.slides:
            found[..., self.n_rigid :] += closed.by_eta(self.system.n_eta)
        return found

    def sleeve_places(self, Y: Array) -> Array:
        """Where the sleeves are on their links (m) at poses Y (n, nq), shape (n, sleeves)."""
        contacts = self.system.closed.contacts
        if contacts and (compiled := self.compiled) is not None:
            return compiled.evaluator.sleeves(Y)
        out = np.empty((len(Y), len(contacts)))
        for k, y in enumerate(Y if contacts else ()):
            closed = self.kinematics(y).closed
            assert closed is not None
            out[k] = [one.place for one in closed.contacts]
        return out

    def first_off(self, Y: Array) -> int | None:
        """The first of poses Y (n, nq) at which a sleeve has left its beam; None: at none."""
        contacts, off = self.system.closed.contacts, np.zeros(len(Y), dtype=bool)
        for one, x in zip(contacts, self.sleeve_places(Y).T, strict=True):
            off |= off_beam(one.sleeve, x)
        return int(np.argmax(off)) if np.any(off) else None

    def require_on_beams(self, y: Array, where: str, t: float | None = None) -> None:
        """Raise a MotionError where a sleeve has left its beam at y (nq,), at a time t (s).

        Args:
            y: Coordinates, shape (nq,).
            where: Begins the message.
            t: Time [s] for the message.
        """
        closed = self.system.closed
        for one, place in zip(closed.contacts, self.sleeve_places(y[None])[0], strict=True):
            if off_beam(one.sleeve, place):
                raise left_beam(one.sleeve, float(place), closed.names[one.loop], where, t)

    def closure_bias(self, y: Array, v: Array) -> Array:
        """gamma in cdd = J a + gamma, (..., rows), at y (..., nq) and v (..., nv).

        Args:
            y: Coordinates, shape (nq,) or (n, nq).
            v: Velocities, shape (nv,) or (n, nv).
        """
        V = np.atleast_2d(v)
        if (compiled := self.compiled) is not None:
            gamma = compiled.evaluator.closure_motion(np.atleast_2d(y), V, np.zeros_like(V))[2]
        else:
            gamma = self.bias_of(self._kinematics(y, v, True), V)
        return np.asarray(gamma[0] if y.ndim == 1 else gamma)

    def bias_of(self, at: Kinematics, V: Array) -> Array:
        """gamma (n, rows) where joints move with V (n, nv).

        Args:
            at: Kinematics with rates, n states.
            V: Their velocities in minimal coordinates, shape (n, nv).
        """
        if at.closed is None:
            return np.zeros((len(V), 0))
        here = at.here
        gamma = at.closed.bias(here.V, at.J, at.dJ, V[:, self.n_rigid :])
        if self.flexible:
            gamma += (at.closed.jacobian(at.J) @ here.A[:, :, None])[:, :, 0]
        return gamma


def spans(count: int, most: int = TOGETHER) -> Iterator[slice]:
    """Slices that cover all states.

    Args:
        count: Number of states. most: In one slice.
    """
    for first in range(0, count, most):
        yield slice(first, min(first + most, count))
