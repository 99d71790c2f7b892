"""States at the samples of a run, read off many steps at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.compiled_march import STATE, Batch
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
        widths = system.nq, system.nv, system.nv, system.closed.n, len(system.motors), 2
        self._columns = States(*(np.zeros((n, width)) for width in widths))
        self._total, self._ahead = np.zeros(2), np.zeros((0, 2))

    def start(self, now: Any) -> None:
        """Take the first state."""
        for name in STATE:
            getattr(self._columns, name)[0] = getattr(now, name)
        self.count = 1

    def ahead(self, steps: Sequence[Any]) -> States:
        """States at the samples that lie in the steps after those taken, where `take` leaves them.

        Args:
            steps: Accepted steps, in order.
        """
        ends = ends_of(steps)
        upto = int(np.searchsorted(self.t, ends[-1], side="right"))
        t = self.t[self.count : upto]
        room = States(*(column[self.count : upto] for column in self._columns))
        work = self._ahead = self._works(steps)
        if not len(t):
            return room
        of = np.searchsorted(ends, t)
        if isinstance(steps, Batch):
            steps.made.samples(t, of, room)
        else:
            for column, values in zip(room, self._stages.dense(steps, t, of), strict=True):
                column[...] = values
        np.add(room.work, (self._total + np.cumsum(work, axis=0) - work)[of], out=room.work)
        return room

    def take(self, steps: Sequence[Any], count: int | None = None) -> int:
        """Record steps.

        Args:
            steps: Accepted steps, in order.
            count: Samples in them, where the last call was `ahead` of them or more; None: it was
                not.
        """
        if not steps:
            return 0
        self.count += len(self.ahead(steps).y) if count is None else count
        self._total = self._total + self._ahead[: len(steps)].sum(axis=0)
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
        y, v, a, lam, torque, work = (column[: self.count] for column in self._columns)
        return Run(
            self.system, self.t[: self.count], y, v, a, lam, torque, cost, settings, work, (),
            stopped,
        )  # fmt: skip

    def _works(self, steps: Sequence[Any]) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""
        if isinstance(steps, Batch):
            return steps.made.works(len(steps))
        return self._stages.works(steps)


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
