"""The stages of collocation steps on the compiled kernel, where it covers all that they need."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.actuation.drive import TorqueDrive
from pinflex.actuation.motors import MotorAxes
from pinflex.arrays import Array, IntArray
from pinflex.integrators.collocation import Collocation
from pinflex.kernel.march import Marched, MarchKernel, Table
from pinflex.kernel.stages import Rows, Scheme, StageKernel
from pinflex.mechanics.compiled import Compiled
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.system import System

_BALL, _FREE, _PLANAR = (f"JointModel{kind}" for kind in ("Spherical", "FreeFlyer", "Planar"))


class CompiledStages:
    """Poses, residuals and corrections of the stages of one step at a time.

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
        self.kind, self._free = _kind(method, rows.prescribed), rows.free_at

    def begin(
        self, start: Any, t: Array, path: Any, a: Array, lam: Array, turn: Array, feed: Array | None
    ) -> None:
        """Take over a step: its start, the motors at the stages t (s), and a guess.

        Args:
            start: State at the beginning of the step.
            t: Times of the stages [s], shape (s,).
            path: Motion of the motors there.
            a: Guess of the accelerations, shape (s, nv).
            lam: Guess of the multipliers, shape (s, rows).
            turn: Guess of the turns, shape (s, nv).
            feed: Torques fed forward to driven motors, shape (s, nm); None: they follow the path.
        """
        k = self.kernel
        k.y0[...], k.v0[...] = start.y, start.v
        k.position[...], k.velocity[...] = path.position, path.velocity
        if feed is not None:
            k.feed[...] = feed
        if k.scale.size:
            k.scale[...] = self.compiled.scale(t)
        k.a[...], k.lam[...], k.turn[...], k.change[...] = a, lam, turn, 0.0

    def march(self, marched: Marched, table: Table, room: tuple[int, int]) -> MarchKernel:
        """The arrays of a run by these stages: those of the last one, where they fit.

        Args:
            marched: What the kernel has to know. table: What is prescribed.
            room: Steps of a batch, and tangents.
        """
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

    def solve(self, r: Array, c: Array) -> tuple[Array, Array]:
        """dz (s, n) and dlam (s, rows) from residuals r (s, n) and closures c (s, rows).

        Args:
            r: Residual forces [N | N m], shape (s, n).
            c: Closures [m | rad], shape (s, rows).
        """
        k = self.kernel
        k.r[:, self._free], k.open[...] = r, c
        k.solve()
        return k.change[:, self._free], k.dlam.copy()


def compiled_stages(
    equations: Equations,
    method: Collocation,
    free: IntArray,
    axes: MotorAxes,
    drive: TorqueDrive | None,
    sampled: bool = False,
) -> CompiledStages | None:
    """The stages of a system on the kernel, spare ones or new; None: those of numpy serve.

    Args:
        equations: Of what moves. method: The scheme. free: Velocity rows that are solved for.
        axes: Motors. drive: Their torques; None: they are prescribed.
        sampled: Whether a digital controller holds forces.
    """
    if not equations.on_kernel:
        return None
    found = _stages(equations, method, free, axes, drive is None)
    if found is None:
        return None
    found.kernel.take_hold(sampled)
    if drive is not None:
        found.kernel.kp[...], found.kernel.kd[...] = drive.kp, drive.kd
    return found


def _stages(
    equations: Equations, method: Collocation, free: IntArray, axes: MotorAxes, prescribed: bool
) -> CompiledStages | None:
    system = equations.system
    spare = system.spares.acquire(_kind(method, prescribed))
    if spare is not None and spare.method is method:
        return spare  # type: ignore[no-any-return]
    compiled = equations.compiled
    sorts = _sorts(system)
    if compiled is None or sorts is None:
        return None
    motors = system.motors
    paired = np.isin(np.arange(len(motors)), axes.paired)
    q_at = np.asarray(axes.q_at, dtype=np.intp)
    rows = Rows(prescribed, free, motors, q_at, paired.astype(np.intp), *sorts)
    return CompiledStages(compiled, method, rows)


def _kind(method: Collocation, prescribed: bool) -> object:
    """Of workspaces that fit each other."""
    return method.s, prescribed


def _sorts(system: System) -> tuple[IntArray, ...] | None:
    """Coordinates and rows of plain joints, circles, balls and bodies; None: there are others."""
    plain, circles, balls, bodies = [], [], [], []
    for joint in system.rigid.joints[1:]:
        first = joint.idx_q, joint.idx_v
        if joint.nq == joint.nv:
            plain += [(first[0] + k, first[1] + k) for k in range(joint.nv)]
        elif joint.nv == 1:
            circles.append(first)
        elif joint.shortname() == _BALL:
            balls.append(first)
        elif joint.shortname() in (_FREE, _PLANAR):
            bodies.append((*first, int(joint.shortname() == _PLANAR)))
        else:
            return None
    found = (np.array(x, dtype=np.intp).reshape(-1, 2).T for x in (plain, circles, balls))
    columns = [column for both in found for column in both]
    return *columns, *np.array(bodies, dtype=np.intp).reshape(-1, 3).T
