"""States at the samples of a run, read off many steps at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.compiled_march import Batch
from pinflex.integrators.run import Run
from pinflex.integrators.steps import Recorded, States


class Record:
    """States at the samples, filled as the run goes.

    Attributes:
        t: Samples in s. count: Number of those that are there.
        resolution: Of the steps.
    """

    def __init__(self, stages: Recorded, t: Array, resolution: float) -> None:
        system, n = stages.dynamics.system, len(t)
        self._stages, self.system, self.t, self.count = stages, system, t, 0
        self.resolution = resolution
        self.y, self.v = np.empty((n, system.nq)), np.empty((n, system.nv))
        self.a, self.lam = np.empty((n, system.nv)), np.empty((n, system.closed.n))
        self.torque, self.work = np.empty((n, len(system.motors))), np.zeros((n, 2))
        self._total, self._ahead = np.zeros(2), np.zeros((0, 2))

    def start(self, now: Any) -> None:
        """Take the first state."""
        self.y[0], self.v[0], self.a[0] = now.y, now.v, now.a
        self.lam[0], self.torque[0], self.count = now.lam, now.torque, 1

    def ahead(self, steps: Sequence[Any]) -> States:
        """States at the samples that lie in the steps after those taken."""
        ends = ends_of(steps)
        upto = int(np.searchsorted(self.t, ends[-1], side="right"))
        t = self.t[self.count : upto]
        of = np.searchsorted(ends, t)
        work = self._ahead = self._works(steps)
        if not len(t):
            return States(*(part[:0] for part in self._columns()))
        if isinstance(steps, Batch):
            found = steps.made.samples(t, of)
        else:
            found = self._stages.dense(steps, t, of)
        return found._replace(work=found.work + (self._total + np.cumsum(work, axis=0) - work)[of])

    def take(self, steps: Sequence[Any], found: States | None = None) -> int:
        """Record steps, and the states at their samples where they are known already.

        Args:
            steps: Accepted steps, in order.
            found: States at the samples in them, of those that are `ahead`; None: all of these.
        """
        if not steps:
            return 0
        found = self.ahead(steps) if found is None else found
        upto = self.count + len(found.y)
        for column, values in zip(self._columns(), found, strict=True):
            column[self.count : upto] = values
        self._total = self._total + self._ahead[: len(steps)].sum(axis=0)
        self.count = upto
        return len(steps)

    def finish(self, steps: Sequence[Any]) -> None:
        """Record the last steps of a run that has broken off."""
        self.take(steps)

    def run(self, cost: dict[str, float], settings: dict[str, object], stopped: str) -> Run:
        """The samples so far as a run.

        Args:
            cost: Counts by name.
            settings: What the method used.
            stopped: Why it ended early; "": it did not.
        """
        y, v, a, lam, torque, work = (column[: self.count] for column in self._columns())
        return Run(
            self.system, self.t[: self.count], y, v, a, lam, torque, cost, settings, work, (),
            stopped,
        )  # fmt: skip

    def _works(self, steps: Sequence[Any]) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""
        if isinstance(steps, Batch):
            return steps.made.works(len(steps))
        return self._stages.works(steps)

    def _columns(self) -> States:
        return States(self.y, self.v, self.a, self.lam, self.torque, self.work)


def spans_of(steps: Sequence[Any]) -> tuple[Array, Array]:
    """Starts and lengths of steps, s, shape (k,) each."""
    if isinstance(steps, Batch):
        return steps.spans
    t, h = np.array([(step.start.t, step.h) for step in steps]).reshape(-1, 2).T
    return t, h


def ends_of(steps: Sequence[Any]) -> Array:
    """Ends of steps, s, a little later than they are: a sample that rounds to one is in it."""
    t, h = spans_of(steps)
    return np.asarray(t + (1.0 + 1e-9) * h)
