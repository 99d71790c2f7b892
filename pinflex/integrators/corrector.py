"""The error of a Radau run from that run alone: every step taken once more with one stage more.

One Newton correction of s + 1 stages, from the polynomials of the step, by the step's own tangent,
from the start that the corrections so far have led to. What the corrected run differs from the run
by is an estimate of the run's error, carried along from step to step (defect correction: Zadunaisky
1976; Skeel 1982).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinflex.actuation.drive import MotorPath
from pinflex.arrays import Array, IntArray
from pinflex.integrators.collocation import legendre, with_one_more
from pinflex.integrators.compiled_stages import CompiledStages
from pinflex.integrators.stage_newton import Tangent
from pinflex.integrators.stages import StageEquations, Start, Step, Trial
from pinflex.kernel.corrections import Corrected, correct_steps

# Above this contraction of the step's own iteration one correction leaves too much: it takes two.
_SLOW = 0.2


class Corrector(StageEquations):
    """Corrects the steps of a run.

    Attributes:
        iterations: Newton corrections so far.
        sizes: Of the steps corrected last: norms of the last Legendre coefficient but one of the
            displacement, of the last one, and of the correction, shape (n, 3).
    """

    def __init__(self, run: StageEquations) -> None:
        """`run`: the equations that the steps of the run solve."""
        stages = run.method
        super().__init__(run.mechanism, run.dynamics, run.path, with_one_more(stages), run.drive)
        self._guess, self.iterations = stages.at(self.method.c), 0
        self.sizes, self._last_two = np.zeros((0, 3)), legendre(self.method)[-2:]
        # What the factors in the kernel are of: a tangent, which is kept that it stays, and h.
        self._known: tuple[Tangent, float] | None = None

    def correct_all(self, steps: Sequence[Step], before: tuple[Step, Step] | None) -> list[Step]:
        """Steps corrected one after the other; before: the last one so far, and its correction."""
        paths, done = self._paths(steps), list[Step]()
        if self.compiled is not None:
            done, changes = self._compiled(self.compiled, steps, before, paths)
        else:
            changes = np.zeros((len(steps), self.method.s, self.dynamics.system.nv))
            for number, step in enumerate(steps):
                path = _part(paths, number, self.method.s)
                done.append(self._corrected(step, before, path, changes[number]))
                before = step, done[-1]
        coefficients = self._last_two @ np.array([step.move for step in done])
        parts = np.concatenate([coefficients, changes], axis=1)
        norms = self._norms(parts, done[-1].tangent)
        self.sizes = np.column_stack([norms[:, :2], norms[:, 2:].max(axis=1)])
        return done

    def _norms(self, moves: Array, tangent: Tangent) -> Array:
        """Of displacements (..., nv): by elastic energy, or by mass if nothing bends."""
        dynamics = self.dynamics
        weight = dynamics.strain.stiffness if dynamics.flexible else tangent.M
        x = moves[..., dynamics.n_rigid :] if dynamics.flexible else moves[..., self.free]
        return np.asarray(np.sqrt(np.abs(np.sum((x @ weight) * x, axis=-1))))

    def _paths(self, steps: Sequence[Step]) -> MotorPath:
        """Motion of the motors at the stages of all steps."""
        start, h = np.array([(step.start.t, step.h) for step in steps]).T
        return self.path((start[:, None] + np.outer(h, self.method.c)).ravel())

    def _corrected(
        self, step: Step, before: tuple[Step, Step] | None, path: MotorPath, change: Array
    ) -> Step:
        """A step taken once more, from the end of the corrected step before it.

        `change` becomes the last correction of the displacement, shape (s, nv).
        """
        a, lam, turn = (part[0] for part in self._polynomials([step]))
        x = self.begin(self._start(step, before), step.h, a, lam, turn, path)
        newton = self.newton
        if newton.stale or newton.tangent is not step.tangent:
            newton.adopt(step.tangent)
        if newton.h != step.h:
            newton.factor(step.h)
        if before is not None:
            self._follow(x, step.start)
        for _ in range(_times(step)):
            self.place(x)
            self.correct(x)
            self.iterations += 1
        done = self.solved(x, step.coarseness, step.rate)
        change[...] = x.change
        if not self.manifold.turning:
            return done
        self.place(x)  # what turns in space depends on what was corrected
        return replace(done, move=x.move, turn=x.turn)

    def _follow(self, x: Trial, run: Start) -> None:
        """Answer of the stages to the error so far, by the tangent alone.

        Without it every correction would leave its part of the whole error, not of what the step
        adds: over many steps that grows without bound.
        """
        free, of = self.free, self.newton.tangent
        dv = (x.start.v - run.v)[free]
        dy = self.manifold.log(run.y[None], x.start.y[None])[0, free]
        moved = dy + np.outer(x.h * self.method.c, dv)
        dz, dlam = self.newton.step(moved @ of.K.T + of.C @ dv, moved @ of.J.T)
        x.a[:, free] += self.method.A2_inverse @ dz
        x.lam += dlam

    def _polynomials(self, steps: Sequence[Step]) -> tuple[Array, Array, Array]:
        """a, lam and turn of steps at the stages of this scheme, each (n, s, .)."""
        a, lam, turn = (
            np.matmul(self._guess, np.array([getattr(step, name) for step in steps]))
            for name in ("a", "lam", "turn")
        )
        return a, lam, turn

    def _start(self, step: Step, before: tuple[Step, Step] | None) -> Start:
        """Where the corrected step starts."""
        if before is None:
            return step.start
        end = self.end(before[1])
        return _begun(step, before[0], end.y, end.v, before[1])

    def _compiled(
        self,
        compiled: CompiledStages,
        steps: Sequence[Step],
        before: tuple[Step, Step] | None,
        paths: MotorPath,
    ) -> tuple[list[Step], Array]:
        """All steps by one call of the kernel, and their last corrections, shape (n, s, nv)."""
        n, s, h = len(steps), self.method.s, np.array([step.h for step in steps])
        a, lam, turn = self._polynomials(steps)
        a[:, :, self.motors] = paths.acceleration.reshape(n, s, -1)
        tangents, which = _distinct([step.tangent for step in steps])
        times = np.array([_times(step) for step in steps])
        first = self._start(steps[0], before)
        last, self._known = self._known, None
        known = last is not None and last[0] is tangents[0] and last[1] == steps[0].h
        found = correct_steps(
            compiled.kernel, h, which, times,
            {name: np.array([getattr(of, name) for of in tangents]) for name in "MCKJ"},
            (np.array([x.start.y for x in steps]), np.array([x.start.v for x in steps])),
            (first.y, first.v),
            (paths.position, paths.velocity, compiled.compiled.scale(paths.t)),
            (a, lam, turn), known,
        )  # fmt: skip
        self._known = steps[-1].tangent, steps[-1].h
        self.iterations += int(times.sum())
        torques = self._torques(found, tangents, which, h)
        return self._steps(steps, before, paths, found, torques), found.change

    def _torques(
        self, found: Corrected, tangents: Sequence[Tangent], which: IntArray, h: Array
    ) -> Array:
        """Torques of the motors with the last correction in them, shape (n, s, nm)."""
        torque, free = found.r[:, :, self.motors], self.free
        for number, of in enumerate(tangents):
            at = np.flatnonzero(which == number)
            da = found.da[at]
            dv = h[at, None, None] * np.matmul(self.method.A, da)
            torque[at] += of.motor_forces(da, dv, found.change[at][:, :, free], found.dlam[at])
        return torque

    def _steps(
        self,
        steps: Sequence[Step],
        before: tuple[Step, Step] | None,
        paths: MotorPath,
        found: Corrected,
        torque: Array,
    ) -> list[Step]:
        """Corrected steps as values."""
        n, s, done = len(steps), self.method.s, []
        v = found.velocity.reshape(n * s, -1)
        power = self._power(v, torque.reshape(n * s, -1)).reshape(n, s, 2)
        for k, step in enumerate(steps):
            start = step.start
            if before is not None:
                start = _begun(step, before[0], found.y[k], found.v[k], before[1])
            done.append(
                Step(
                    start, step.h, found.move[k], found.turn[k], found.a[k], found.lam[k],
                    torque[k], power[k], step.coarseness, _part(paths, k, s), step.tangent,
                    step.rate,
                )
            )  # fmt: skip
            before = step, done[-1]
        return done


def _times(step: Step) -> int:
    """Corrections that a step takes."""
    return 2 if step.rate > _SLOW else 1


def _begun(step: Step, coarse: Step, y: Array, v: Array, fine: Step) -> Start:
    """Where a step starts that follows a corrected one, which ends at (y, v)."""
    start = step.start
    if np.array_equal(start.a, coarse.a[-1]):
        return Start(start.t, y, v, fine.a[-1], fine.lam[-1], fine.torque[-1])
    # After a switch of motion or loads accelerations begin anew.
    return replace(start, y=y, v=v)


def _distinct(tangents: Sequence[Tangent]) -> tuple[list[Tangent], IntArray]:
    """Tangents without those that come again, and the number of each."""
    found: list[Tangent] = []
    which = np.empty(len(tangents), dtype=np.intp)
    for k, of in enumerate(tangents):
        if not found or found[-1] is not of:
            found.append(of)
        which[k] = len(found) - 1
    return found, which


def _part(path: MotorPath, number: int, s: int) -> MotorPath:
    """The motion of the motors in one of steps that have s stages each."""
    at = slice(number * s, (number + 1) * s)
    return MotorPath(path.t[at], path.position[at], path.velocity[at], path.acceleration[at])
