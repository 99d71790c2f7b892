"""The error of a Radau run from that run alone: every step taken once more with one stage more.

One Newton correction of s + 1 stages, from the polynomials of the step, by the step's own tangent,
from the start that the corrections so far have led to (source/correct.c). What the corrected run
differs from the run by is an estimate of the run's error, carried along from step to step (defect
correction: Zadunaisky 1976; Skeel 1982). A corrected run can be corrected in its turn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.batch import STATE, Batch, States
from pinflex.integrators.collocation import with_one_more
from pinflex.integrators.compiled_stages import Stages
from pinflex.integrators.march import CONTROL
from pinflex.kernel.march import Marched, MarchKernel, no_table

# Above this contraction of the step's own iteration one correction leaves too much: it takes two.
_SLOW = 0.1


class Before(NamedTuple):
    """What the steps before leave to those to be corrected.

    Attributes:
        a: Accelerations at the end of the run's last step, shape (nv,). end: Its corrected end, one
            row of each.
    """

    a: Array
    end: States


class Corrector:
    """Corrects the steps of a run.

    Attributes:
        stages: Of the corrected steps.
    """

    def __init__(self, run: Stages, slow: float = _SLOW) -> None:
        """`run`: the stages of the steps, or those of another corrector.

        `slow`: the contraction above which a step takes two corrections.
        """
        self.stages = Stages(run.problem, with_one_more(run.method))
        self._guess, self._slow = run.method.at(self.stages.method.c), slow
        self._kernel: MarchKernel | None = None

    @property
    def iterations(self) -> int:
        """Newton corrections so far."""
        return 0 if self._kernel is None else int(self._kernel.at.iterations)

    def correct(self, steps: Batch, before: Before | None) -> Batch:
        """Steps corrected one after the other; before: `last` of those so far.

        Raises:
            LinAlgError: Their equations are singular with one stage more.
        """
        if self._kernel is None:
            self._kernel = self._made(steps)
        kernel, end_a, given = self._kernel, None, None
        if before is not None:
            end_a = before.a
            for name in STATE:
                getattr(kernel, name)[...] = getattr(before.end, name)[0]
        if steps.table is None:
            c = self.stages.method.c
            given = np.array([
                self.stages.inside(t + h * c) for t, h in zip(steps.t, steps.h, strict=True)
            ])  # fmt: skip
        if not kernel.correct(steps.kernel, self._guess, end_a, given):
            raise np.linalg.LinAlgError("singular iteration matrix")
        return Batch(self.stages, kernel, steps.table, int(kernel.at.count))

    def last(self, steps: Batch, corrected: Batch) -> Before:
        """What the next steps are corrected from, before other steps are made."""
        a = steps.kernel.steps["a"][len(steps), -1].copy()
        return Before(a, States(*(x[-1:] for x in corrected.states())))

    def _made(self, steps: Batch) -> MarchKernel:
        """Room for the corrections of the steps of a run."""
        m, none = self.stages.method, np.zeros(0, dtype=np.intp)  # nothing is judged
        marched = Marched(*m.monomials, np.zeros(m.s), none, np.zeros((0, 0)), (), none)
        counts = self.stages.compiled.kernel.counts
        table = steps.table or no_table(3 * counts["motors"] + counts["forces"])
        room = int(steps.kernel.at.capacity), 0
        made = self.stages.compiled.march(marched, table, room)
        made.at.slow, made.at.same_step = self._slow, CONTROL.same_step
        return made
