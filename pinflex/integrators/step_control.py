"""The step control of a run: which length a step has, which steps stay, where they end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.integrators.steps import StepFailed, Steps

HELD = 0.7  # part of the last step's coarseness that this one is taken to have at least
GROWTH = 1.5  # of steps, each, after one that Newton did not solve
_RUNS_AWAY = 1e6  # m/s or rad/s: no mechanism in SI units gets there by itself
SHORTEST = 1e-9  # of the run: a step that has to be shorter has met something singular
TOGETHER = 8  # steps that are recorded, and judged, at once


@dataclass(frozen=True)
class Point:
    """Where a run stands: it can go on from here once more.

    Attributes:
        now: State. last: The step that led to it, which predicts, or None.
        h: Length of the next step in s. ceiling: What it may not exceed while Newton recovers.
        before: Coarseness of the last step: the next is taken to have part of it at least.
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


class March:
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
        now = stages.first(self._begin, *start)
        self.at = Point(now, None, first, np.inf, 0.0, np.inf, stops_of(t, breaks), stages.scale, 0)
        self._origin = self.at
        self.pending: list[tuple[Point, Any]] = []  # points and the steps from them
        self.counts = {"rejected": 0, "unresolved": 0, "repeated": 0}
        self.resolution, self._unjudged = 0.0, unjudged

    @property
    def done(self) -> bool:
        """Whether the run is at its end."""
        return not self.at.stops

    @property
    def now(self) -> Any:
        """The state that the run has come to."""
        return self.at.now

    @property
    def steps(self) -> list[Any]:
        """Those that are pending."""
        return [step for _, step in self.pending]

    def advance(self) -> None:
        """Some steps more, which are pending then."""
        self.stages.resolve(self.resolution)
        while not self.done and len(self.pending) < TOGETHER:
            point = self.at
            step = self._attempt()
            if step is not None:
                self.pending.append((point, step))
                self._require_sound()

    def settle(self, good: int, resolution: float) -> None:
        """Let only the first of the pending steps stay, or none of all (-1).

        Those that replace the others are shorter by what their resolution asks for.

        Args:
            good: Number of the last pending step that stays; -1: none.
            resolution: Local error that the next ones are asked for.
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

    def cost(self) -> dict[str, float]:
        """Counts of the run so far."""
        return {"steps": self.at.steps, **self.counts, **self.stages.counts}

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
            for one in (step.coarseness, HELD * self.at.before)
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
        ceiling = at.ceiling * GROWTH
        h = min(h, ceiling)
        if now.t >= stops[0] - SHORTEST * self._span:
            now.t = stops[0]  # two that differ by round-off are one: no step fits between them
            stops = tuple(stop for stop in stops if stop > now.t + SHORTEST * self._span)
            if stops:
                now, last = stages.first(now.t, now.y, now.v), None
                h = min(h, self._first_length)
        self.at = Point(
            now, last, h, ceiling, step.coarseness, np.inf, stops, stages.scale, at.steps + 1
        )

    def _require_sound(self) -> None:
        """Raise where a step has left a beam, or has to be followed by one without length."""
        now = self.at.now
        self.stages.dynamics.require_on_beams(now.y, self.name, now.t)
        self._require_length()

    def _require_length(self) -> None:
        if self.at.h < SHORTEST * self._span:
            raise stuck(self.name, self.at.now)


def stops_of(t: Array | Sequence[float], breaks: Sequence[float]) -> tuple[float, ...]:
    """Times in s at which steps end: breaks within the run, and its end.

    Args:
        t: Samples [s], shape (nt,).
        breaks: Times at which the motion or a load switches [s].
    """
    first, last = float(t[0]), float(t[-1])
    ends = last - SHORTEST * (last - first)
    return *(b for b in sorted(set(breaks)) if first < b < ends), last


def stuck(name: str, now: Any) -> ConvergenceError:
    """Steps have become too short to go on: because the motion runs away, or for another reason.

    Args:
        name: Of the mechanism.
        now: Last state.
    """
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
