"""The stages of collocation steps on the compiled kernel."""

from __future__ import annotations

import numpy as np

from pinflex.actuation.drive import MotorPath
from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.problem import Problem, seen_inside
from pinflex.kernel.march import Marched, MarchKernel, Table
from pinflex.kernel.stages import Rows, Scheme, StageKernel
from pinflex.mechanics.compiled import Compiled
from pinflex.mechanics.system import System

_BALL, _FREE, _PLANAR = (f"JointModel{kind}" for kind in ("Spherical", "FreeFlyer", "Planar"))


class CompiledStages:
    """Arrays of the stages of one step at a time, and of the march that takes them.

    Attributes:
        kernel: The arrays of the step. compiled: Residual and tangent of the system.
        method: The scheme. table: What the last run prescribed, and of what its table was made.
        kind: Of spare ones, which other runs of the system may take over.
    """

    def __init__(self, compiled: Compiled, method: Collocation, rows: Rows) -> None:
        m = self.method = method
        self.table: tuple[tuple[object, ...], Table | None] = ((), None)
        self._march: tuple[tuple[int, ...], MarchKernel] | None = None
        scheme = Scheme(m.c, m.A, m.A2, m.A2_inverse, m.values, m.forward, m.back)
        self.compiled, self.kernel = compiled, StageKernel(compiled.evaluator, scheme, rows)
        self.kind = _kind(method, rows.prescribed)

    def march(self, marched: Marched, table: Table, room: tuple[int, int]) -> MarchKernel:
        """The arrays of a run by these stages: those of the last one, where they fit."""
        fits = (*room, len(marched.measured), int(marched.weight is None), len(marched.stops))
        if self._march is not None and self._march[0] == fits:
            self._march[1].begin_anew(marched, table)
        else:
            self._march = fits, MarchKernel(self.kernel, marched, table, *room)
        return self._march[1]

    @property
    def size(self) -> int:
        """Bytes of its arrays."""
        return self.kernel.size + (0 if self._march is None else self._march[1].size)


class Stages:
    """The stages of one problem by one method, lent from the spare ones of the system.

    Attributes:
        problem: What is solved. method: The scheme. compiled: Their arrays.
    """

    def __init__(self, problem: Problem, method: Collocation) -> None:
        self.problem, self.method = problem, method
        self.compiled = _lent(problem, method)

    def __del__(self) -> None:
        if (compiled := self.__dict__.get("compiled")) is not None:
            system = self.problem.dynamics.system
            system.spares.release(compiled.kind, compiled, compiled.size)

    def at(self, t: Array) -> Array:
        """Motors' position, velocity, acceleration (or torque) and shares of loads, (k, n)."""
        return self._columns(self.problem.path(t), t)

    def inside(self, t: Array) -> Array:
        """The same at the stages of a step, shape (s, n), as they are inside it."""
        return self._columns(self.problem.path_inside(t), seen_inside(t, self.method.c))

    def _columns(self, path: MotorPath, seen: Array) -> Array:
        drive = self.problem.drive
        feed = path.acceleration if drive is None else drive.forward(path.t)
        scale = self.compiled.compiled.scale(seen)
        return np.concatenate([path.position, path.velocity, feed, scale], axis=1)


def _lent(problem: Problem, method: Collocation) -> CompiledStages:
    """The stages of a system on the kernel, spare ones or new."""
    dynamics, drive = problem.dynamics, problem.drive
    system = dynamics.system
    if not dynamics.on_kernel or dynamics.compiled is None:
        raise PinflexError("kernel: it does not serve; plain steps do.")
    found = system.spares.acquire(_kind(method, drive is None))
    if found is None or found.method is not method:
        found = CompiledStages(dynamics.compiled, method, _rows(problem))
    found.kernel.take_hold(problem.sampler is not None)
    if drive is not None:
        found.kernel.kp[...], found.kernel.kd[...] = drive.kp, drive.kd
    return found  # type: ignore[no-any-return]


def _kind(method: Collocation, prescribed: bool) -> object:
    """Of workspaces that fit each other."""
    return method.s, prescribed


def _rows(problem: Problem) -> Rows:
    motors, axes = problem.motors, problem.axes
    paired = np.isin(np.arange(len(motors)), axes.paired).astype(np.intp)
    q_at = np.asarray(axes.q_at, dtype=np.intp)
    sorts = sorts_of(problem.dynamics.system)
    return Rows(problem.prescribed, problem.free, motors, q_at, paired, *sorts)


def sorts_of(system: System) -> tuple[IntArray, ...]:
    """Coordinates and rows of plain joints, circles, balls and bodies (see `Rows`)."""
    plain, circles, balls, bodies = [], [], [], []
    for joint in system.rigid.joints[1:]:
        first = joint.idx_q, joint.idx_v
        if joint.nq == joint.nv:
            plain += [(first[0] + k, first[1] + k) for k in range(joint.nv)]
        elif joint.nv == 1:
            circles.append(first)
        elif joint.shortname() == _BALL:
            balls.append(first)
        else:  # the kernel covers no others
            assert joint.shortname() in (_FREE, _PLANAR)
            bodies.append((*first, int(joint.shortname() == _PLANAR)))
    found = (np.array(x, dtype=np.intp).reshape(-1, 2).T for x in (plain, circles, balls))
    columns = [column for both in found for column in both]
    return *columns, *np.array(bodies, dtype=np.intp).reshape(-1, 3).T
