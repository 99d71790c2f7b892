"""A run of the coupled level with steps as long as the motion allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError, MotionError
from pinflex.integrators.run import Run
from pinflex.integrators.steps import StepFailed, Steps
from pinflex.mechanics.equations import Equations

# First steps, of the run. A long one damps what begins to ring there, and nothing shows that it
# did: two runs would agree without it. Only a run that knows no scale begins so.
_LONG, _FIRST = 0.02, 1e-3
_HELD = 0.7  # part of the last step's coarseness that this one is taken to have at least
_GROWTH = 1.5  # of steps, each, after one that Newton did not solve
_RUNS_AWAY = 1e6  # m/s or rad/s: no mechanism in SI units gets there by itself
_SHORTEST = 1e-9  # of the run: a step that has to be shorter has met something singular


# A diverging iteration overflows before it is caught.
@np.errstate(over="ignore", invalid="ignore")
def integrate(
    name: str,
    stages: Steps,
    start: tuple[Array, Array],
    t: Array,
    breaks: Sequence[float],
    resolution: float,
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
        resolution: What a step's coarseness may be, relative to the largest displacement so far.
        scale: Largest displacement of the run, known from a coarser one (its `settings`): then it
            begins with short steps. Without it what rings faintly would hold the run up.
        pilot: A first look whose first step is not judged, so that no faint ringing holds it up.
        progress: Called with (samples done, samples).
    Returns:
        States, multipliers and torques at the samples.
    Raises:
        ConvergenceError, MotionError: With `.result` (a Run) up to the last good step.
    """
    stages.scale, dynamics = scale, stages.dynamics
    record = _Record(dynamics, t)
    span = float(t[-1] - t[0])
    stops = [b for b in sorted(set(breaks)) if t[0] < b < t[-1] - _SHORTEST * span] + [float(t[-1])]
    first = (_FIRST if scale > 0.0 else _LONG) * span
    now, h, last = stages.first(float(t[0]), *start), first, None
    record.start(now)
    counts = {"steps": 0, "rejected": 0, "unresolved": 0}
    refused, ceiling, before = np.inf, np.inf, 0.0

    def run(stopped: str = "") -> Run:
        settings: dict[str, object] = {
            **stages.settings,
            "scale": stages.scale,
            "dt": (now.t - float(t[0])) / max(counts["steps"], 1),
        }
        cost = {k: float(n) for k, n in {**counts, **stages.counts}.items()}
        return record.run(cost, settings, stopped)

    while stops:
        ahead = stops[0] - now.t
        pieces = np.ceil(ahead / h - 1e-9)
        # Nearly there: equal pieces, for a last small one would cost as much as a whole step.
        size = ahead / pieces if pieces < 4 else h
        try:
            step = stages.step(now, size, last)
        except (StepFailed, np.linalg.LinAlgError):
            counts["rejected"] += 1
            # Once more without a prediction and with a new tangent, then shorter.
            if last is None:
                h = ceiling = 0.4 * size
            else:
                h = size
            stages.expire()
            last = None
            if h < _SHORTEST * span:
                raise _stuck(name, now, run) from None
            continue
        # The coarseness may cross zero in a vibration: a step grows only as far as those before it
        # allow too, or it would be refused.
        factor, grown = (
            0.9 * (resolution / max(one, 1e-300)) ** (1.0 / stages.order)
            for one in (step.coarseness, _HELD * before)
        )
        factor = min(factor, max(grown, 1.0))
        if step.coarseness > resolution and not (pilot and counts["steps"] == 0):
            # What a shorter step does not show less of is round-off, or rings far too fast.
            if step.coarseness < 0.5 * refused:
                refused = step.coarseness
                counts["rejected"] += 1
                h = size * min(max(factor, 0.3), 0.7)
                continue
            counts["unresolved"] += 1
            factor = 1.0  # nor would the steps after it show less
        refused = np.inf
        now, last = stages.end(step), step
        counts["steps"] += 1
        record.take(stages, step)
        try:
            dynamics.require_on_beams(now.y, name, now.t)
        except MotionError as error:
            error.result = run(str(error))
            raise
        if not stages.idle[0] < factor < stages.idle[1]:
            h = size * min(max(factor, 0.5), 3.0)
        ceiling *= _GROWTH
        h, before = min(h, ceiling), max(step.coarseness, stages.memory * before)
        if h < _SHORTEST * span:
            raise _stuck(name, now, run)
        if now.t >= stops[0] - _SHORTEST * span:
            now.t = stops.pop(0)
            if stops:
                now, last = stages.first(now.t, now.y, now.v), None
                h = min(h, first)
        if progress is not None:
            progress(record.count, len(t))
    return run()


def _stuck(name: str, now: Any, run: Callable[[str], Run]) -> ConvergenceError:
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
    error = ConvergenceError(
        f"{name}: t = {now.t:.6g} s: {why} error.result holds the run so far.", time=now.t
    )
    error.result = run("steps get shorter without end")
    return error


class _Record:
    """States at the samples, filled as the run goes."""

    def __init__(self, dynamics: Equations, t: Array) -> None:
        system, n = dynamics.system, len(t)
        self.system, self.t, self.count = system, t, 0
        self.y, self.v = np.empty((n, system.nq)), np.empty((n, system.nv))
        self.a, self.lam = np.empty((n, system.nv)), np.empty((n, system.closed.n))
        self.torque, self.work = np.empty((n, len(system.motors))), np.zeros((n, 2))
        self._total = np.zeros(2)

    def start(self, now: Any) -> None:
        self.y[0], self.v[0], self.a[0] = now.y, now.v, now.a
        self.lam[0], self.torque[0], self.count = now.lam, now.torque, 1

    def take(self, stages: Steps, step: Any) -> None:
        """The samples that lie in a step."""
        end = step.start.t + step.h
        upto = int(np.searchsorted(self.t, end + 1e-9 * step.h, side="right"))
        if upto > self.count:
            k = slice(self.count, upto)
            y, v, a, lam, torque, work = stages.dense(step, self.t[k])
            self.y[k], self.v[k], self.a[k], self.lam[k] = y, v, a, lam
            self.torque[k], self.work[k] = torque, self._total + work
            self.count = upto
        self._total = self._total + stages.work(step)

    def run(self, cost: dict[str, float], settings: dict[str, object], stopped: str) -> Run:
        k = slice(0, self.count)
        return Run(
            self.system, self.t[k], self.y[k], self.v[k], self.a[k], self.lam[k], self.torque[k],
            cost, settings, self.work[k], (), stopped,
        )  # fmt: skip
