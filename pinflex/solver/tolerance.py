"""A run within a tolerance: by collocation in one run, else refined until two runs agree.

Of time integration: what the model leaves out is another error (`pinflex.advice`). Collocation
corrects every step (`pinflex.solver.one_run`). Of other methods the finer of two runs is answered;
what its outputs differ from the coarser one's by (pinflex.levels.outputs), divided by what refining
gains, is its estimated error. Two runs alike bit by bit tell nothing: both are at the floor that
round-off sets, and the last run that differed tells how high that is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pinflex.arrays import Array
from pinflex.description.solve import ASKED, SolveSpec
from pinflex.errors import ConvergenceError, Ending
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.linear import Alpha
from pinflex.integrators.run import Run, Settings
from pinflex.levels.ked import method_of
from pinflex.levels.outputs import ROUND_OFF, Outputs
from pinflex.results.views import statistics
from pinflex.solver.one_run import errors, floor, force_errors, in_one_run, ringing
from pinflex.solver.scene import Progress, Scene
from pinflex.solver.step_length import default_step

_STICKING = 1e-3  # resolution over tol where dry friction acts: a Newton loose beside the
# smoothing speed makes a joint that comes to rest bounce, which costs ten times the steps
_CONTACTS = 0.3  # the same where parts meet
_ROUNDS = 8
# Blows multiply what runs differ by: runs beyond the first after which the last one is answered
# with a word, where pins have clearance, and of others with contacts.
_CHAOTIC, _ABRUPT = 1, 3
_NUDGE = 1e-9  # rad/s or m/s: by which the speeds of a third start are others
_FINER = 16.0  # resolution of a run of collocation over that of the next
_PLAIN = 4.0  # first step of a plain run, of the default one: a tenth of the third mode's period
_LONGEST = 10.0  # resolution of a run that follows nothing
_FAILURES = 2  # runs that may break off, or change more than the last, before it is given up


def solve_to_tolerance(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """The run at samples t (s) within a relative error tol.

    Level coupled goes by Radau IIA collocation (`in_one_run`; where joints stick or a digital
    controller acts, `by_refinement`; without the kernel, `by_plain_steps`); members of the alpha
    family that are asked for, level ked and a continuous control in equal steps
    (`by_step_halving`).
    """
    # Level ked is linear: equal steps keep its matrices; a continuous law is evaluated in them.
    # Of the alpha family too: steps of its own length take up to ten times the time (compiled).
    given = scene.spec.method
    collocates = given is None or given == "radau" or isinstance(given, Collocation)
    if scene.linear or not collocates or (scene.control is not None and not scene.sampled):
        return by_step_halving(scene, t, tol, progress)
    if not scene.on_kernel:
        return by_plain_steps(scene, t, tol, progress)
    if scene.sticks or scene.sampled or scene.bends:
        return by_refinement(scene, t, tol, progress)
    return in_one_run(scene, t, tol, progress)


def by_refinement(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """By collocation in several runs, each at a sixteenth of the resolution of the last.

    A digital controller does not go back to an earlier step, and a joint that comes to rest an
    instant later is no error of its torque: one run cannot judge itself then. The resolution falls
    with the power of the stages, 6, of the step: a sixteenth of it costs six tenths more steps, and
    two runs so far apart tell errors well. In a smooth motion it brings far more than threefold; a
    faint vibration that both leave unresolved makes them agree better than they should, so that
    less is trusted. Under a digital controller steps are often as long as it holds its outputs, at
    every resolution: each run cuts these times in twice as many steps at least. Where a joint comes
    to rest, or two bodies touch, finer steps may bring nothing: there the run may be off by all
    that the two differ by, and what the first step of a pilot misses would show as that.
    """

    def attempt(resolution: float, coarser: Run | None) -> Run:
        finer = max(round(np.log(first / resolution) / np.log(_FINER)), 0)
        pilot = coarser is None and not abrupt
        return scene.resolved(t, resolution, progress, coarser, pilot, finer)

    abrupt = scene.sticks or scene.bends
    first, gain = (_STICKING * tol, 1.0) if abrupt else (8.0 * tol, 3.0)
    if scene.bends and not scene.sticks:
        first = _CONTACTS * tol

    def again(resolution: float) -> Run:
        return replace(scene, nudge=_NUDGE).resolved(t, resolution, progress)

    return _Refinement(scene, t, tol, attempt, first, _FINER, gain, again).run()


def by_step_halving(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """By equal steps, half as long every time."""
    # Errors of a step of 1/40 of a period are near 1e-3.
    first = default_step(scene.mechanism, float(t[-1] - t[0])) * min(1.0, (tol / 1e-3) ** 0.5)
    gain = 2.0 ** _order(scene.spec) - 1.0
    return _Refinement(
        scene, t, tol, lambda dt, _: scene.stepped(t, dt, progress), first, 2.0, gain
    ).run()


def by_plain_steps(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """By collocation in equal steps, half as long every time: where the kernel does not serve.

    As much less is trusted as in `by_refinement`.
    """
    first = _PLAIN * default_step(scene.mechanism, float(t[-1] - t[0]))
    gain = 1.0 if scene.sticks else 3.0
    return _Refinement(
        scene, t, tol, lambda dt, _: scene.plainly(t, dt, progress), first, 2.0, gain
    ).run()


def _order(spec: SolveSpec) -> int:
    """Power of the step that the errors of equal steps fall with; 1 where nothing is known."""
    march = method_of(spec)
    if isinstance(march, Alpha):
        return march.scheme.order
    return 2 if spec.method is None else 1


class _Refinement:
    """Runs at first, first/ratio, ...; each judged by the one before.

    Attributes:
        size: Step or resolution of the next run. cost: Of all runs so far.
        last: The last run that has an estimate, or None.
        runs, failures, worse: How many there were, broke off, and changed more than the last.
    """

    def __init__(
        self,
        scene: Scene,
        t: Array,
        tol: float,
        attempt: Callable[[float, Run | None], Run],
        first: float,
        ratio: float,
        gain: float,
        again: Callable[[float], Run] | None = None,
    ) -> None:
        """`again`: the run from a start that differs by next to nothing."""
        self.scene, self.tol, self.attempt, self.again = scene, tol, attempt, again
        self.size, self.ratio, self.gain = first, ratio, gain
        self.compare = Outputs(scene.mechanism, scene.motion, t, scene.spec.asked or ASKED)
        self.cost: dict[str, float] = {}
        self.failures = self.worse = self.runs = 0
        self.last: Run | None = None
        loops = scene.mechanism.description.loops
        loose = any(loop.clearance is not None for loop in loops)
        self.rounds = _ROUNDS if not scene.bends else _CHAOTIC if loose else _ABRUPT

    def run(self) -> Run:
        """The first run whose estimate is half of the tolerance."""
        coarse: Run | None = None
        before_last: Run | None = None
        worst = np.inf
        while self.runs <= self.rounds and self.worse <= _FAILURES:
            self.runs += 1
            fine = self._next(coarse)
            if fine is not None and coarse is not None:
                if _alike(coarse, fine):
                    return self._at_round_off(coarse, fine)
                self.last = self._judged(coarse, fine)
                before, worst = worst, _worst(self.last)
                if worst <= 0.5 * self.tol:
                    return self.last
                self.worse += worst > before
            self.size, before_last, coarse = self.size / self.ratio, coarse, fine
        if self.scene.bends and self.last is not None and before_last is not None:
            return self._parted(before_last, self.last)
        raise self._not_reached()

    def _parted(self, coarse: Run, fine: Run) -> Run:
        """The finer of two runs with contacts that part, with a word on what it may be used for."""
        moved, words = None, ""
        try:
            moved = self.again(self.size * self.ratio**2) if self.again else None
        except ConvergenceError:
            words = "A third run, from a start with other last digits, broke off. "
        when, tol = _parting(coarse, fine, self.tol), self.tol
        if moved is not None:
            for key, count in moved.cost.items():
                fine.cost[key] = fine.cost.get(key, 0.0) + count
            fine.cost["runs"] = self.runs + 1.0
            apart = _parting(coarse, moved, tol)
            words = f"Two starts whose speeds differ by {_NUDGE:g} part at {apart:.4g} s. "
            if not np.isfinite(apart):
                words = f"Two starts {_NUDGE:g} apart do not: a smaller tol brings it. "
        peaks = ", ".join(f"{np.abs(_history(x)).max():.4g}" for x in (coarse, fine))
        words = (
            f"contacts multiply what two runs differ by: they part by more than tol = {tol:g} at "
            f"t = {when:.4g} s, and from there on a single history means little. {words}Peaks (the "
            f"two have {peaks}), means and spectra do, with their spread: run.statistics; a "
            "shorter `until` is within tol."
        )
        every = (coarse, fine) if moved is None else (coarse, fine, moved)
        found = statistics(fine.t, self.scene.mechanism.motors, [run.torque for run in every])
        settings: Settings = {**fine.settings, "statistics": found}
        return replace(fine, settings=settings, warnings=(*fine.warnings, words))

    def _next(self, coarse: Run | None) -> Run | None:
        """The next run; None where it broke off and a finer one may pass."""
        try:
            fine = self.attempt(self.size, coarse)
        except ConvergenceError:
            # Where steps that are too long break off, shorter ones may pass; after one that passed,
            # it is round-off that they meet.
            self.failures += 1
            self.runs -= 1
            if self.last is not None:
                raise floor(self.scene, self.tol, self.last) from None
            if self.failures > _FAILURES:
                raise
            return None
        for key, count in fine.cost.items():
            self.cost[key] = self.cost.get(key, 0.0) + count
        return fine

    def _at_round_off(self, coarse: Run, fine: Run) -> Run:
        """The finer of two runs alike, if a longer step shows that the tolerance is met."""
        if self.last is not None:
            raise floor(self.scene, self.tol, self.last)
        longer = self.size * self.ratio
        while _alike(coarse, fine) and longer < _LONGEST:
            longer *= self.ratio
            coarse, self.runs = self.attempt(longer, None), self.runs + 1
        last = self._judged(coarse, fine)
        if _worst(last) <= 0.5 * self.tol:
            return last
        raise floor(self.scene, self.tol, last)

    def _judged(self, coarse: Run, fine: Run) -> Run:
        """The finer run with its estimated error, all its cost and what it warns of."""
        differ = self.compare.differences(coarse, fine)
        error = {key: max(e / self.gain, ROUND_OFF) for key, e in differ.items()}
        settings: Settings = {**fine.settings, "tol": self.tol, "error": error}
        each = {**self.cost, "last_steps": fine.cost["steps"], "runs": float(self.runs)}
        warnings = (*fine.warnings, *ringing(self.scene, fine))
        judged = force_errors(self.scene.mechanism, coarse, fine, self.gain)
        return replace(fine, settings=settings, cost=each, warnings=warnings, judged=judged)

    def _not_reached(self) -> ConvergenceError:
        assert self.last is not None
        key, change = max(errors(self.last).items(), key=lambda item: item[1])
        failed = ConvergenceError(
            f"{self.scene.mechanism.name}: tol = {self.tol:g} not reached: {key} still changes by "
            f"{change:.2g} after {self.runs} runs. {Ending.TOL_NOT_REACHED.value} "
            f"error.result holds the last run. {' '.join(self.last.warnings)}",
            ending=Ending.TOL_NOT_REACHED,
        )
        failed.result = self.last
        return failed


def _history(run: Run) -> Array:
    return run.torque if run.torque.size else run.y


def _parting(one: Run, other: Run, tol: float) -> float:
    """When two runs differ by more than tol of the largest [s]; inf: they do not."""
    a, b = _history(one), _history(other)
    apart = np.abs(a - b).max(axis=1) > tol * max(np.abs(b).max(), 1e-300)
    return float(other.t[np.argmax(apart)]) if apart.any() else np.inf


def _worst(run: Run) -> float:
    return max(errors(run).values(), default=0.0)


def _alike(a: Run, b: Run) -> bool:
    """Whether two runs are the same bit for bit, which tells nothing of their error."""
    return all(np.array_equal(x, y) for x, y in ((a.y, b.y), (a.v, b.v), (a.torque, b.torque)))
