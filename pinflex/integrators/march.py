"""A run of the coupled level with steps as long as the motion allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError, MotionError, RunInterrupted
from pinflex.integrators.compiled_march import CompiledMarch
from pinflex.integrators.radau import Stages
from pinflex.integrators.record import Record
from pinflex.integrators.run import Run
from pinflex.integrators.step_control import March
from pinflex.integrators.steps import Steps

# First step, of the run. A long one damps what begins to ring there, and nothing shows that it
# did: two runs would agree without it. Only a run that knows no scale begins so.
LONG, SHORT = 0.02, 1e-3
_ENDLESS = "steps get shorter without end"


class Keeper(Protocol):
    """Takes the steps of a run, and may send it back.

    Attributes:
        resolution: That of the steps to come.
    """

    resolution: float

    @property
    def count(self) -> int:
        """Samples recorded so far."""

    def start(self, now: Any) -> None:
        """Take the first state."""

    def take(self, steps: Sequence[Any]) -> int:
        """Record steps; the number of them that stay, or -1: not even earlier ones."""

    def finish(self, steps: Sequence[Any]) -> None:
        """Record the last steps of a run that has broken off."""

    def run(self, cost: dict[str, float], settings: dict[str, object], stopped: str) -> Run:
        """The samples so far as a run.

        Args:
            cost: Counts by name.
            settings: What the method used.
            stopped: Why it ended early; "": it did not.
        """


# A diverging iteration overflows before it is caught.
@np.errstate(over="ignore", invalid="ignore")
def integrate(
    name: str,
    stages: Steps,
    start: tuple[Array, Array],
    t: Array,
    breaks: Sequence[float],
    keeper: Keeper,
    first: float = SHORT,
    scale: float = 0.0,
    pilot: bool = False,
    progress: Callable[[int, int], None] | None = None,
    instants: Sequence[float] = (),
) -> Run:
    """March from t[0] to t[-1] and answer at the times t.

    Args:
        name: Of the mechanism, for errors.
        stages: The method, on a mechanism and its motion.
        start: y (nq,) and v (nv,) on the closures.
        t: Samples in s, increasing.
        breaks: Times in s at which motion or loads are not smooth; steps end there.
        keeper: Takes the steps, and tells the resolution: what a step's coarseness may be, relative
            to the largest displacement so far.
        first: First step, of the run.
        scale: Largest displacement of the run, where it is known beforehand: without it what rings
            faintly holds up a run that begins with short steps.
        pilot: A first look whose first step is not judged, so that no faint ringing holds it up.
        progress: Called with (samples done, samples).
        instants: Times in s at which a digital controller acts; steps end there too.
    Returns:
        States, multipliers and torques at the samples.
    Raises:
        ConvergenceError, MotionError: With `.result` (a Run) up to the last good step.
    """
    stages.scale = scale
    first, recorded = first * float(t[-1] - t[0]), type(keeper) is Record
    march: March | CompiledMarch
    if isinstance(stages, Stages) and stages.compiled is not None:
        march = CompiledMarch(name, stages, start, t, breaks, first, pilot, recorded, instants)
    else:
        march = March(name, stages, start, t, (*breaks, *instants), first, pilot)
    keeper.start(march.now)

    def run(stopped: str = "") -> Run:
        cost = {key: float(count) for key, count in march.cost().items()}
        dt = (march.now.t - float(t[0])) / max(cost["steps"], 1.0)
        return keeper.run(cost, {**stages.settings, "scale": stages.scale, "dt": dt}, stopped)

    waiting = True  # whether the steps that are pending have yet to be recorded
    try:
        while not march.done:
            march.resolution = keeper.resolution
            march.advance()
            waiting = False
            good = keeper.take(march.steps)
            march.settle(good, keeper.resolution)
            waiting = True
            if progress is not None:
                progress(keeper.count, len(t))
    except (ConvergenceError, MotionError) as error:
        keeper.finish(march.steps)
        error.result = run(str(error) if isinstance(error, MotionError) else _ENDLESS)
        raise
    except KeyboardInterrupt:
        if waiting:
            keeper.finish(march.steps)
        if keeper.count < 2:
            raise  # nothing but the start
        raise RunInterrupted(run("interrupted")) from None
    return run()
