"""The error of a Radau run from that run alone: every step taken once more with one stage more.

One Newton correction of s + 1 stages, from the polynomials of the step, by the step's own tangent,
from the start that the corrections so far have led to. What the corrected run differs from the run
by is an estimate of the run's error, carried along from step to step (defect correction: Zadunaisky
1976; Skeel 1982). A corrected run can be corrected in its turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple
from weakref import proxy

import numpy as np

from pinflex.actuation.drive import MotorPath
from pinflex.arrays import Array
from pinflex.integrators.collocation import with_one_more
from pinflex.integrators.compiled_march import STATE, Batch, CompiledSteps
from pinflex.integrators.radau import SAME_STEP
from pinflex.integrators.stages import StageEquations, Start, Step, Trial
from pinflex.kernel.march import Marched

# Above this contraction of the step's own iteration one correction leaves too much: it takes two.
_SLOW = 0.1


class Before(NamedTuple):
    """What the steps before leave to those to be corrected.

    Attributes:
        a: Accelerations at the end of the run's last step, shape (nv,). end: Its corrected end.
    """

    a: Array
    end: Start


class Corrector(StageEquations):
    """Corrects the steps of a run.

    Attributes:
        iterations: Newton corrections so far.
    """

    def __init__(self, run: StageEquations, slow: float = _SLOW) -> None:
        """`run`: the equations that the steps of the run solve, or another corrector.

        `slow`: the contraction above which a step takes two corrections.
        """
        stages = run.method
        super().__init__(run.mechanism, run.dynamics, run.path, with_one_more(stages), run.drive)
        self._guess, self.iterations, self._slow = stages.at(self.method.c), 0, slow
        self._made: CompiledSteps | None = None

    def correct_all(self, steps: Sequence[Step], before: Before | None) -> Sequence[Step]:
        """Steps corrected one after the other; before: `last` of those so far."""
        if isinstance(steps, Batch) and self.compiled is not None:
            return self._compiled_steps(steps, before)
        paths, done = self._paths(steps), list[Step]()
        for number, step in enumerate(steps):
            done.append(self._corrected(step, before, _part(paths, number, self.method.s)))
            before = Before(step.a[-1], self.end(done[-1]))
        return done

    def last(self, steps: Sequence[Step], corrected: Sequence[Step]) -> Before:
        """What the next steps are corrected from, before other steps are made."""
        if isinstance(steps, Batch) and isinstance(corrected, Batch):
            kernel, count = corrected.made.kernel, len(corrected)
            if count == kernel.at.count:
                parts = (getattr(kernel, name).copy() for name in STATE)
                a = steps.made.kernel.steps["a"][count, -1].copy()
                return Before(a, Start(float(kernel.at.t), *parts))
        return Before(steps[-1].a[-1], self.end(corrected[-1]))

    def _paths(self, steps: Sequence[Step]) -> MotorPath:
        """Motion of the motors at the stages of all steps."""
        start, h = np.array([(step.start.t, step.h) for step in steps]).T
        return self.prescribed((start[:, None] + np.outer(h, self.method.c)).ravel())

    def _compiled_steps(self, steps: Batch, before: Before | None) -> Batch:
        """The same on the kernel, while it has the steps."""
        if self._made is None or self._made.tangents is not steps.made.tangents:
            self._made = self._like(steps.made)
        kernel, end_a, given = self._made.kernel, None, None
        if before is not None:
            end_a, end = before
            for name in STATE:
                getattr(kernel, name)[...] = getattr(end, name)
        if self._made.table is None:
            t = [step.start.t + step.h * self.method.c for step in steps]
            seen = np.ravel([self.seen(stages) for stages in t])
            given = self._made.inputs(np.ravel(t), seen).reshape(len(steps), self.method.s, -1)
        if not kernel.correct(steps.made.kernel, self._guess, end_a, given):
            raise np.linalg.LinAlgError("singular iteration matrix")
        self.iterations = int(kernel.at.iterations)
        return self._made.batch()

    def _like(self, run: CompiledSteps) -> CompiledSteps:
        """Room for the corrections of the steps of a run."""
        last, measured = np.zeros(self.method.s), np.zeros(0, dtype=np.intp)  # nothing is judged
        marched = Marched(*self.method.monomials, last, measured, np.zeros((0, 0)), (), measured)
        # Held weakly: in a circle the workspace would not be given back when the run is over.
        of, room = proxy(self), (int(run.kernel.at.capacity), 0)
        made = CompiledSteps(of, marched, run.table, room, run.tangents)
        made.kernel.at.slow, made.kernel.at.same_step = self._slow, SAME_STEP
        return made

    def _corrected(self, step: Step, before: Before | None, path: MotorPath) -> Step:
        """A step taken once more, from the end of the corrected step before it."""
        x = self.begin(self._start(step, before), step.h, *self._polynomials(step), path)
        newton = self.newton
        if newton.stale or newton.tangent is not step.tangent:
            newton.adopt(step.tangent)
        if abs(newton.h - step.h) > SAME_STEP * step.h:
            newton.factor(step.h)
        if before is not None:
            self._follow(x, step.start)
        for _ in range(2 if step.rate > self._slow else 1):
            self.place(x)
            self.correct(x)
            self.iterations += 1
        done = self.solved(x, step.coarseness, step.rate)
        if not self.manifold.turning:
            return done
        self.place(x)  # what turns in space depends on what was corrected
        return replace(done, move=x.move.copy(), turn=x.turn.copy())

    def _follow(self, x: Trial, run: Start) -> None:
        """Answer of the stages to the error so far, by the tangent alone.

        Without it every correction would leave its part of the whole error, not of what the step
        adds: over many steps that grows without bound.
        """
        free, of = self.free, self.newton.tangent
        dv = (x.start.v - run.v).take(free)
        dy = self.manifold.log(run.y[None], x.start.y[None])[0].take(free)
        moved = dy + (x.h * self.method.c)[:, None] * dv
        dz, dlam = self.newton.step(moved.dot(of.K.T) + of.C.dot(dv), moved.dot(of.J.T))
        x.a[:, free] += self.method.A2_inverse.dot(dz)
        x.lam += dlam

    def _polynomials(self, step: Step) -> tuple[Array, Array, Array]:
        W = self._guess
        return W.dot(step.a), W.dot(step.lam), W.dot(step.turn)

    def _start(self, step: Step, before: Before | None) -> Start:
        """Where the corrected step starts."""
        start = step.start
        if before is None:
            return start
        a, end = before
        if (start.a == a).all():
            return Start(start.t, end.y, end.v, end.a, end.lam, end.torque)
        # After a switch of motion or loads accelerations begin anew.
        return replace(end, t=start.t, a=start.a, lam=start.lam, torque=start.torque)


def _part(path: MotorPath, number: int, s: int) -> MotorPath:
    """The motion of the motors in one of steps that have s stages each."""
    at = slice(number * s, (number + 1) * s)
    return MotorPath(path.t[at], path.position[at], path.velocity[at], path.acceleration[at])
