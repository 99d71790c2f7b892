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

from pinflex.arrays import Array
from pinflex.integrators.collocation import with_one_more
from pinflex.integrators.stages import StageEquations, Start, Step, Trial

# Above this contraction of the step's own iteration one correction leaves too much: it takes two.
_SLOW = 0.2


class Corrector(StageEquations):
    """Corrects the steps of a run.

    Attributes:
        iterations: Newton corrections so far.
    """

    def __init__(self, run: StageEquations) -> None:
        """`run`: the equations that the steps of the run solve."""
        stages = run.method
        super().__init__(run.mechanism, run.dynamics, run.path, with_one_more(stages), run.drive)
        self._guess, self.iterations = stages.at(self.method.c), 0

    def correct_all(self, steps: Sequence[Step], before: tuple[Step, Step] | None) -> list[Step]:
        """Steps corrected one after the other; before: the last one so far, and its correction."""
        done: list[Step] = []
        for step in steps:
            done.append(self.corrected(step, before))
            before = step, done[-1]
        return done

    def corrected(self, step: Step, before: tuple[Step, Step] | None) -> Step:
        """A step taken once more, from the end of the corrected step before it."""
        x = self.begin(self._start(step, before), step.h, *self._polynomials(step))
        newton = self.newton
        if newton.stale or newton.tangent is not step.tangent:
            newton.adopt(step.tangent)
        if newton.h != step.h:
            newton.factor(step.h)
        if before is not None:
            self._follow(x, step.start)
        for _ in range(2 if step.rate > _SLOW else 1):
            self.place(x)
            self.correct(x)
            self.iterations += 1
        return self.solved(x, step.coarseness, step.rate)

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

    def _polynomials(self, step: Step) -> tuple[Array, Array, Array]:
        W = self._guess
        return W @ step.a, W @ step.lam, W @ step.turn

    def _start(self, step: Step, before: tuple[Step, Step] | None) -> Start:
        """Where the corrected step starts."""
        start = step.start
        if before is None:
            return start
        coarse, fine = before
        end = self.end(fine)
        if np.array_equal(start.a, coarse.a[-1]):
            return replace(end, t=start.t)
        # After a switch of motion or loads accelerations begin anew.
        return replace(end, t=start.t, a=start.a, lam=start.lam, torque=start.torque)
