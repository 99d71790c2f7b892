"""States at the samples of a run, read off many steps at once."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.batch import STATE, Batch, States
from pinflex.integrators.problem import State
from pinflex.integrators.run import Run
from pinflex.mechanics.system import System


class Record:
    """States at the samples, filled as the run goes.

    Attributes:
        t: Samples in s. count: Number of those that are there.
        resolution: Of the steps. ends: Times at which steps ended [s].
    """

    def __init__(self, system: System, t: Array, resolution: float) -> None:
        n = len(t)
        self.system, self.t, self.count, self.resolution = system, t, 0, resolution
        widths = system.nq, system.nv, system.nv, system.closed.n, len(system.motors), 2
        self._columns = States(*(np.zeros((n, width)) for width in widths))
        self._total = np.zeros(2)
        self.ends: list[float] = []

    def start(self, now: State) -> None:
        """Take the first state."""
        for name in STATE:
            getattr(self._columns, name)[0] = getattr(now, name)
        self.count = 1

    def read(self, steps: Batch) -> States:
        """States at the samples in steps that follow those taken, where `take` leaves them."""
        upto = int(np.searchsorted(self.t, steps.ends[-1], side="right"))
        t = self.t[self.count : upto]
        room = States(*(column[self.count : upto] for column in self._columns))
        if len(t):
            of, work = np.searchsorted(steps.ends, t), steps.works()
            steps.samples(t, of, room)
            np.add(room.work, (self._total + np.cumsum(work, axis=0) - work)[of], out=room.work)
        return room

    def take(self, steps: Batch) -> int:
        """Record steps, all of which stay."""
        if len(steps):
            self.keep(steps, len(self.read(steps).y))
        return len(steps)

    def keep(self, steps: Batch, samples: int) -> None:
        """Let steps stay, with so many samples that have been read."""
        self.count += samples
        self._total = self._total + steps.works().sum(axis=0)
        self.ends += (steps.t + steps.h).tolist()

    def finish(self, steps: Batch) -> None:
        """Record the last steps of a run that has broken off."""
        self.take(steps)

    def run(self, cost: dict[str, float], settings: dict[str, object], stopped: str) -> Run:
        """The samples so far as a run."""
        y, v, a, lam, torque, work = (column[: self.count] for column in self._columns)
        return Run(
            self.system, self.t[: self.count], y, v, a, lam, torque, cost, settings, work, (),
            stopped,
        )  # fmt: skip
