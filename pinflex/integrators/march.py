"""A run of the coupled level with steps as long as the motion allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError, MotionError
from pinflex.integrators.run import Run
from pinflex.integrators.steps import StepFailed, Steps

# First step, of the run. A long one damps what begins to ring there, and nothing shows that it
# did: two runs would agree without it. Only a run that knows no scale begins so.
LONG, SHORT = 0.02, 1e-3
_HELD = 0.7  # part of the last step's coarseness that this one is taken to have at least
_GROWTH = 1.5  # of steps, each, after one that Newton did not solve
_RUNS_AWAY = 1e6  # m/s or rad/s: no mechanism in SI units gets there by itself
_SHORTEST = 1e-9  # of the run: a step that has to be shorter has met something singular
_TOGETHER = 8  # steps that are recorded, and judged, at once


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
        """The samples so far as a run."""


@dataclass(frozen=True)
class _Point:
    """Where a run stands: it can go on from here once more.

    Attributes:
        now: State. last: The step that led to it, which predicts, or None.
        h: Length of the next step in s. ceiling: What it may not exceed while Newton recovers.
        before: Coarseness that the next step is taken to have at least.
        refused: Coarseness of the step that was too coarse here.
        stops: Times in s at which steps have yet to end. scale: Largest displacement so far.
        steps: Number of steps before.
    """

    now: Any
    last: Any
    h: float
    ceiling: float
    before: float
    refused: float
    stops: tuple[float, ...]
    scale: float
    steps: int


class _March:
    """The steps of one run."""

    def __init__(
        self,
        name: str,
        stages: Steps,
        start: tuple[Array, Array],
        t: Array,
        breaks: Sequence[float],
        first: float,
        unjudged: bool,
    ) -> None:
        self.name, self.stages, self._first_length = name, stages, first
        self._begin, self._span = float(t[0]), float(t[-1] - t[0])
        last = float(t[-1])
        inside = (b for b in sorted(set(breaks)) if t[0] < b < last - _SHORTEST * self._span)
        now = stages.first(self._begin, *start)
        self.at = _Point(now, None, first, np.inf, 0.0, np.inf, (*inside, last), stages.scale, 0)
        self._origin = self.at
        self.pending: list[tuple[_Point, Any]] = []  # points and the steps from them
        self.counts = {"rejected": 0, "unresolved": 0, "repeated": 0}
        self.resolution, self._unjudged = 0.0, unjudged

    @property
    def done(self) -> bool:
        return not self.at.stops

    def advance(self) -> None:
        """Some steps more, which are pending then."""
        while not self.done and len(self.pending) < _TOGETHER:
            point = self.at
            step = self._attempt()
            if step is not None:
                self.pending.append((point, step))
                self._require_sound()

    def settle(self, good: int, resolution: float) -> None:
        """Let only the first of the pending steps stay, or none of all (-1).

        Those that replace the others are shorter by what their resolution asks for.
        """
        if good < len(self.pending):
            back = self._origin if good < 0 else self.pending[good][0]
            self.counts["repeated"] += self.at.steps - back.steps
            finer = min(resolution / self.resolution, 1.0) ** (1.0 / self.stages.order)
            self.at = replace(back, h=finer * back.h)
            if good < 0:
                self._origin = self.at
            self.stages.scale = self.at.scale
            self.stages.expire()
        self.pending.clear()

    def settings(self) -> dict[str, object]:
        """For reports."""
        at = self.at
        dt = (at.now.t - self._begin) / max(at.steps, 1)
        return {**self.stages.settings, "scale": self.stages.scale, "dt": dt}

    def cost(self) -> dict[str, float]:
        counts = {"steps": self.at.steps, **self.counts, **self.stages.counts}
        return {key: float(count) for key, count in counts.items()}

    def _attempt(self) -> Any:
        """The next step, or None where it has to be shorter."""
        at = self.at
        size = self._length()
        try:
            step = self.stages.step(at.now, size, at.last)
        except (StepFailed, np.linalg.LinAlgError):
            self._shorter_after_failure(size)
            return None
        factor = self._factor(step)
        if step.coarseness > self.resolution and not (self._unjudged and at.steps == 0):
            # What a shorter step does not show less of is round-off, or rings far too fast.
            if step.coarseness < 0.5 * at.refused:
                self._refuse(step, size, factor)
                return None
            self.counts["unresolved"] += 1
            factor = 1.0  # nor would the steps after it show less
        self._accept(step, size, factor)
        return step

    def _length(self) -> float:
        """Length of the next step, s."""
        at = self.at
        ahead = at.stops[0] - at.now.t
        pieces = np.ceil(ahead / at.h - 1e-9)
        # Nearly there: equal pieces, for a last small one would cost as much as a whole step.
        return float(ahead / pieces) if pieces < 4 else at.h

    def _refuse(self, step: Any, size: float, factor: float) -> None:
        """Once more, shorter by what is too coarse."""
        self.counts["rejected"] += 1
        h = size * min(max(factor, 0.3), 0.7)
        self.at = replace(self.at, h=h, refused=step.coarseness)

    def _factor(self, step: Any) -> float:
        """What the next step may be longer by.

        The coarseness may cross zero in a vibration: a step grows only as far as those before it
        allow too, or it would be refused.
        """
        factor, grown = (
            0.9 * (self.resolution / max(one, 1e-300)) ** (1.0 / self.stages.order)
            for one in (step.coarseness, _HELD * self.at.before)
        )
        return float(min(factor, max(grown, 1.0)))

    def _shorter_after_failure(self, size: float) -> None:
        """Once more without a prediction and with a new tangent, then shorter."""
        self.counts["rejected"] += 1
        h = size
        if self.at.last is None:
            h = 0.4 * size
            self.at = replace(self.at, ceiling=h)
        self.at = replace(self.at, h=h, last=None)
        self.stages.expire()
        self._require_length()

    def _accept(self, step: Any, size: float, factor: float) -> None:
        at, stages = self.at, self.stages
        h, now, stops, last = at.h, stages.end(step), at.stops, step
        if not stages.idle[0] < factor < stages.idle[1]:
            h = size * min(max(factor, 0.5), 3.0)
        ceiling = at.ceiling * _GROWTH
        h = min(h, ceiling)
        if now.t >= stops[0] - _SHORTEST * self._span:
            now.t = stops[0]  # two that differ by round-off are one: no step fits between them
            stops = tuple(stop for stop in stops if stop > now.t + _SHORTEST * self._span)
            if stops:
                now, last = stages.first(now.t, now.y, now.v), None
                h = min(h, self._first_length)
        before = max(step.coarseness, stages.memory * at.before)
        self.at = _Point(now, last, h, ceiling, before, np.inf, stops, stages.scale, at.steps + 1)

    def _require_sound(self) -> None:
        """Raise where a step has left a beam, or has to be followed by one without length."""
        now = self.at.now
        self.stages.dynamics.require_on_beams(now.y, self.name, now.t)
        self._require_length()

    def _require_length(self) -> None:
        if self.at.h < _SHORTEST * self._span:
            raise _stuck(self.name, self.at.now)


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
    Returns:
        States, multipliers and torques at the samples.
    Raises:
        ConvergenceError, MotionError: With `.result` (a Run) up to the last good step.
    """
    stages.scale = scale
    march = _March(name, stages, start, t, breaks, first * float(t[-1] - t[0]), pilot)
    keeper.start(march.at.now)
    try:
        while not march.done:
            march.resolution = keeper.resolution
            stages.resolve(keeper.resolution)
            march.advance()
            good = keeper.take([step for _, step in march.pending])
            march.settle(good, keeper.resolution)
            if progress is not None:
                progress(keeper.count, len(t))
    except (ConvergenceError, MotionError) as error:
        keeper.finish([step for _, step in march.pending])
        stopped = str(error) if isinstance(error, MotionError) else _ENDLESS
        error.result = keeper.run(march.cost(), march.settings(), stopped)
        raise
    return keeper.run(march.cost(), march.settings(), "")


_ENDLESS = "steps get shorter without end"


def _stuck(name: str, now: Any) -> ConvergenceError:
    """Steps have become too short to go on: because the motion runs away, or for another reason."""
    fastest = float(np.max(np.abs(now.v), initial=0.0))
    if not np.isfinite(fastest) or fastest > _RUNS_AWAY:
        why = (
            "the motion runs away. A link without second_order softens as it turns or is "
            "compressed, up to that: set flexible.LINK.second_order: true; or the mechanism falls "
            "or buckles there."
        )
    else:
        why = (
            "steps get shorter without end. Equal steps (--set solve.dt=1e-5) tell what it is: if "
            "they pass, round-off, and a larger tol passes too; if not, the mechanism is singular "
            "there or the links far too soft: see level=quasistatic up to that time."
        )
    return ConvergenceError(
        f"{name}: t = {now.t:.6g} s: {why} error.result holds the run so far.", time=now.t
    )
