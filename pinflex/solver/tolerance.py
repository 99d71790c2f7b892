"""A run within a tolerance: by collocation in one run, else refined until two runs agree.

Of time integration: what the model leaves out is another error (`pinflex.advice`). Collocation
corrects every step (`one_run`). Of other methods the finer of two runs is answered; what its
outputs differ from the coarser one's by (pinflex.levels.outputs), divided by what refining gains,
is its estimated error. Two runs alike bit by bit tell nothing: both are at the floor that
round-off sets, and the last run that differed tells how high that is.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pinflex.actuation.drive import breaks
from pinflex.actuation.feedback import MORE
from pinflex.arrays import Array, distinct
from pinflex.description.solve import ASKED, SolveSpec
from pinflex.doors import door
from pinflex.errors import ConvergenceError, Ending
from pinflex.integrators.collocation import AlphaScheme, Collocation
from pinflex.integrators.march import SHORT, Radau
from pinflex.integrators.problem import Run, Settings
from pinflex.levels.ked import method_of
from pinflex.levels.modes import default_step, modes
from pinflex.levels.outputs import ROUND_OFF, Outputs
from pinflex.levels.quasistatic import UnstableWarning
from pinflex.results.views import statistics
from pinflex.solver.force_errors import elastic_apart, force_errors
from pinflex.solver.judge import CONTROL, PART, Expected, Judge, expected, few

if TYPE_CHECKING:
    from pinflex.solver.scene import Progress, Scene

# A tolerance kept by one run that judges itself while it goes.
#
# Steps are taken once more with one stage more, and their samples are answered; what a second such
# correction changes in them is their error, twice which is told (`pinflex.solver.judge`).


def floor(scene: Scene, tol: float, last: Run, worst: float | None = None) -> ConvergenceError:
    """The error of a tolerance below what round-off lets a run tell."""
    told = 2.0 * (_worst(last) if worst is None else worst)
    least = f"{10.0 ** (np.ceil(10.0 * np.log10(max(told, 1e-300))) / 10.0):.2g}"
    failed = ConvergenceError(
        f"{scene.mechanism.name}: tol = {tol:g} is below what can be told here: shorter steps show "
        f"only round-off. The floor of this scene is about tol = {least}: "
        f"{Ending.ROUND_OFF.value} error.result holds the best run.",
        ending=Ending.ROUND_OFF,
    )
    failed.result = last
    return failed


# What holds a run by tolerance up: vibration far above the first modes that nothing damps.

_MANY = 500  # steps of a run that nobody wonders at
_ABOVE = 5.0  # times the third mode: what users mean by the vibration of their robot lies below
_RESOLVED = 2.5  # steps in the period of a vibration that collocation of six stages follows
_MODES = 200


def ringing(scene: Scene, run: Run) -> tuple[str, ...]:
    """A sentence where a run has taken many steps to follow undamped vibration, or nothing."""
    steps, span = run.cost.get("steps", 0.0), float(run.t[-1] - run.t[0])
    if steps < _MANY or not run.system.n_eta or np.any(run.system.D):
        return ()
    found = modes(scene.mechanism, count=_MODES, preload="none").frequencies
    alive = np.sort(found[found > 1.0 / span])
    followed = alive[alive < steps / (_RESOLVED * span)]
    if len(alive) < 3 or not len(followed) or followed[-1] < _ABOVE * alive[2]:
        return ()
    spared = "" if "torque" not in (scene.spec.asked or ("torque",)) else (
        " `solve.asked: [deflection, platform]` spares those steps that only torques need;"
    )  # fmt: skip
    woken = "" if run.settings.get("start") == "static" else " `solve.start: static` or"
    return (
        f"{steps:.0f} steps of {span / steps:.2g} s follow vibration up to about "
        f"{followed[-1]:.4g} Hz, which nothing damps (third mode: {alive[2]:.4g} Hz). If you do "
        "not need it, write `damping: {modal: 0.01}`, which lets it die (for one run: --set "
        f"'damping={{modal: 0.01}}');{spared}{woken} a smoother motion does not wake it.",
    )


_FIRST = 0.5  # resolution of the first steps, of the tolerance
_INSTANTS = 51  # at which errors are looked at, at the least
# Runs whose error at the end may be too large after all; resolution of the next one, at the most.
_TRIES, _NEXT = 8, 0.1
# An error that is still so much of what it was, at a resolution so much finer, shows round-off.
_NO_BETTER, _IN_VAIN = 0.7, 3e-3
# Corrections this large are no round-off: errors have grown from one to the next (undamped robots
# that torques push without feedback), and several runs tell what one cannot.
_GROWN = 1e-3
# Runs more for forces and stresses, the resolution of the next one at the most, and the parts of
# the tolerance that strain and what elastic forces accelerate may differ by where these are not
# looked at (what is told is 0.6 to 5.6 times the latter on most scenes).
_FORCE_TRIES, _FINER_FORCES, _CLEAR, _CLEAR_FORCE = 3, 0.5, 0.1, 0.2
_FINER = 16.0  # where steps that are too long break off, shorter ones may pass


def in_one_run(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """The run at samples t (s) within a relative error tol, by Radau IIA collocation."""
    return _OneRun(scene, t, tol, progress).run()


class _OneRun:
    def __init__(self, scene: Scene, t: Array, tol: float, progress: Progress | None) -> None:
        self.scene, self.asked_for, self.tol, self.progress = scene, t, tol, progress
        few = len(t) < _INSTANTS
        self.t = distinct(t, np.linspace(t[0], t[-1], _INSTANTS)) if few else t
        self.dynamics = scene.equations()
        asked = scene.spec.asked or ASKED
        self.outputs = Outputs(scene.mechanism, scene.motion, self.t, asked, self.dynamics)
        spec, scales = scene.spec, scene.mechanism.followed.scales
        alike = self.t.tobytes(), spec.level, spec.drive, scene.by_forces, tuple(asked)
        self.foreseen = scales.get(scene.motion, alike, self._foreseen)
        self._judge: Judge | None = None

    def _foreseen(self) -> Expected:
        """Scales of the run, from the rigid motion that its platform is compared with, if it is."""
        end, reference = float(self.t[-1]), None
        if self.outputs.about_platform(self.dynamics.system):
            reference = self.outputs.reference
            if reference is None:
                return Expected(0.0, {})
            reference = few(reference)
        return expected(self.scene, end, self.dynamics, reference)

    def run(self) -> Run:
        """The first run whose second correction changes less than half of the tolerance."""
        resolution, best, at = _FIRST * self.tol, np.inf, np.inf
        enough = PART * self.tol
        for _ in range(_TRIES):
            run, judge = self._passed(resolution)
            worst = max(judge.differences.values(), default=0.0)
            if worst <= enough:
                return self._forces_too(run, judge, resolution)
            if worst < _NO_BETTER * best:
                best, at = worst, resolution
            elif judge.stuck or resolution < _IN_VAIN * at:
                break
            resolution *= min(max(CONTROL.target * PART * self.tol / worst, CONTROL.least), _NEXT)
        if not worst <= _GROWN:
            return by_refinement(self.scene, self.asked_for, self.tol, self.progress)
        raise floor(self.scene, self.tol, self._at_samples(run), worst)

    def _forces_too(self, run: Run, judge: Judge, resolution: float) -> Run:
        """A run that keeps the tolerance in forces and stresses too, or the best of some."""
        off, least = self._off(run, judge), np.inf
        for _ in range(_FORCE_TRIES):
            if off <= self.tol:
                break
            resolution = judge.lowest * min(
                max(CONTROL.target * self.tol / off, CONTROL.least), _FINER_FORCES
            )
            try:
                finer, judge = self._passed(resolution)
            except ConvergenceError:
                break
            least, off = min(least, off), self._off(finer, judge)
            if off < least and max(judge.differences.values()) <= PART * self.tol:
                run = finer
        return self._at_samples(run)

    def _off(self, run: Run, judge: Judge) -> float:
        """Estimated error of forces and stresses; 0 where they are well within the tolerance."""
        if run.judged is None or {*(self.scene.spec.asked or ASKED)} != {*ASKED}:
            return 0.0  # a tolerance that is about some outputs by name is about nothing else
        once, twice = judge.runs()
        strain, force = elastic_apart(once, twice, self.dynamics.mass(twice.y[0]))
        if strain <= _CLEAR * self.tol and force <= _CLEAR_FORCE * self.tol:
            return 0.0
        return max(run.judged().values(), default=0.0)

    def _passed(self, resolution: float) -> tuple[Run, Judge]:
        """A run that comes to its end, and its judge."""
        try:
            judge, run = self._attempt(resolution, False)
        except ConvergenceError:
            if self._judge is not None and self._judge.lowest < resolution:
                # Sent back to ever shorter steps: without that it passes, or breaks off for good.
                judge, run = self._attempt(resolution, True)
            else:
                judge, run = self._attempt(resolution / _FINER, False)
        return self._judged(judge, run), judge

    def _attempt(self, resolution: float, stuck: bool) -> tuple[Judge, Run]:
        scene, t, scale = self.scene, self.t, self.foreseen.scale

        def keeper(steps: Radau) -> Judge:
            given = (self.foreseen, self.tol, resolution, stuck, resolution < _FIRST * self.tol)
            self._judge = Judge(steps, t, self.outputs, *given)
            return self._judge

        first = 0.02 * self.tol**0.25 if scale > 0.0 else SHORT
        run = scene.kept(t, resolution, keeper, first, scale, self.progress, judge=self.dynamics)
        assert self._judge is not None
        return self._judge, run

    def _judged(self, judge: Judge, run: Run) -> Run:
        error = {key: max(e / PART, ROUND_OFF) for key, e in judge.differences.items()}
        settings: Settings = {
            **run.settings, "tol": self.tol, "error": error,
            "judged": "a correction of every step",
        }  # fmt: skip
        settle = judge.inside(breaks(self.scene.motion, self.dynamics.system.loads), run)
        once, twice = (replace(x, settle=settle) for x in judge.runs())
        judged = force_errors(self.scene.mechanism, once, twice, PART) if error else None
        words = (*run.warnings, *ringing(self.scene, run))
        return replace(run, settings=settings, warnings=words, settle=settle, judged=judged)

    def _at_samples(self, run: Run) -> Run:
        """At those that were asked for."""
        same = self.t is self.asked_for
        return run if same else run.at(np.searchsorted(self.t, self.asked_for))


_STICKING = 1e-3  # resolution over tol where dry friction acts: a Newton loose beside the
# smoothing speed makes a joint that comes to rest bounce, which costs ten times the steps
# The same under a digital controller (six motors of a ur5 at 1e-3: the first run errs by 0.05 tol,
# at 8.0 by 1.4), and what the next one's is less by: four stages take half as many steps again.
_HELD, _HELD_FINER = 2.0, 6.0
_COARSEST = 8e-3  # resolution under a digital controller: a coarser run is no measure of the next
_CONTACTS = 0.3  # the same where parts meet
_ROUNDS = 8
_ABRUPT = 3  # the same with contacts, which multiply what runs differ by: the last is answered then
_LASTS = 0.5  # s: a run that nobody need be told of
_GOES_ON = "The run goes on; Ctrl-C ends it with what there is by then."
_WINDOWS = (1 / 64, 1 / 16, 1 / 4, 1.0)  # of a run: whether another one has parted from it by then
_NUDGE = 1e-9  # rad/s or m/s: by which the speeds of a third start are others
_PLAIN = 4.0  # first step of a plain run, of the default one: a tenth of the third mode's period
_LONGEST = 10.0  # resolution of a run that follows nothing
_HALF = 0.5  # of the tolerance, that an estimate may have which trusts that finer runs are better
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
    every resolution: each run cuts these times in half as many steps again as the last one took.
    What its jumps wake is followed late, and Newton's rests add up: errors that fall in proportion
    to the steps, no faster, are twice what the two runs differ by. That is told, and need not be
    half of the tolerance. Where a joint comes to rest, or two bodies touch, finer steps may bring
    nothing: there the run may be off by all that the two differ by, and what the first step of a
    pilot misses would show as that.
    """

    def attempt(resolution: float, coarser: Run | None, t: Array = t) -> Run:
        pilot = coarser is None and not abrupt
        return scene.resolved(t, resolution, progress, coarser, pilot)

    abrupt = scene.sticks or scene.bends
    if scene.sampled:
        progress = _watched(scene, float(t[-1]), progress)
    if scene.sampled and not abrupt:
        first = min(_HELD * tol, _COARSEST)
        return _Refinement(scene, t, tol, attempt, first, _HELD_FINER, MORE - 1.0, 1.0).run()
    first = _STICKING * tol if abrupt else min(8.0 * tol, _COARSEST)
    gain = 1.0 if abrupt else 3.0
    if scene.bends and not scene.sticks:
        first = _CONTACTS * tol
    return _Refinement(scene, t, tol, attempt, first, _FINER, gain).run()


def _watched(scene: Scene, end: float, progress: Progress | None) -> Progress:
    """Progress of runs, which says once they last whether the loop of their controller is stable.

    Not before: eigenvalues take a twentieth of a short run, and load scipy.linalg.
    """
    began, asked = time.perf_counter(), False

    def watch(done: int, of: int) -> None:
        nonlocal asked
        if not asked and time.perf_counter() - began > _LASTS:
            asked = True
            n, check = int(scene.mechanism.rigid.nq), door("studies.margins", "unstable")
            times, pose = np.array([0.0, end]), scene.start.y[None, :n]
            for words in check(scene.mechanism, scene.control, scene.spec, times, pose):
                warnings.warn(f"{words} {_GOES_ON}", UnstableWarning, stacklevel=2)
        if progress is not None:
            progress(done, of)

    return watch


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
    if isinstance(march, AlphaScheme):
        return march.order
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
        attempt: Callable[..., Run],
        first: float,
        ratio: float,
        gain: float,
        part: float = _HALF,
    ) -> None:
        """`attempt`: a run of a size, with the coarser one or None, and perhaps other samples.

        `part`: of the tolerance, that an estimate may have.
        """
        self.enough = part * tol
        self.scene, self.tol, self.attempt = scene, tol, attempt
        self.size, self.ratio, self.gain = first, ratio, gain
        self.compare = Outputs(scene.mechanism, scene.motion, t, scene.spec.asked or ASKED)
        self.cost: dict[str, float] = {}
        self.failures = self.worse = self.runs = 0
        self.last: Run | None = None
        self.rounds = _ABRUPT if scene.bends else _ROUNDS
        loops = scene.mechanism.description.loops
        self.loose = scene.bends and any(loop.clearance is not None for loop in loops)

    def run(self) -> Run:
        """The first run whose estimate is within its part of the tolerance."""
        if self.loose:
            with suppress(ConvergenceError):  # finer ones may pass
                one, other = self._beside()
                within = len(one.t) == len(other.t) and _worst(other) <= self.enough
                return other if within else self._parted(one, other)
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
                if worst <= self.enough:
                    return self.last
                self.worse += worst > before
                if worst > _NO_BETTER * before and self._unstable(fine):
                    break  # a loop that is not stable parts runs as chance does
            self.size, before_last, coarse = self.size / self.ratio, coarse, fine
        if self.scene.bends and self.last is not None and before_last is not None:
            return self._parted(before_last, self.last)
        raise self._not_reached()

    def _unstable(self, run: Run) -> bool:
        """Whether a run has a digital controller whose loop is not stable."""
        said = () if run.signals is None else run.signals.said
        return bool(said or run.loop())

    def _beside(self) -> tuple[Run, Run]:
        """Two runs of sizes that follow each other: of the coarser one as much as shows where pins
        that are loose make the two part; the finer one with what they differ by until then.
        """
        sizes = self.size, self.size / self.ratio
        fine, self.size = self.attempt(sizes[1], None), sizes[1] / self.ratio
        for part in _WINDOWS:
            upto = slice(0, max(int(np.ceil(part * len(fine.t))), 2))
            coarse = self.attempt(sizes[0], None, fine.t[upto])
            self._add(coarse)
            if np.isfinite(_parting(coarse, fine.at(upto), self.tol)):
                break
        self.runs = 2
        self._add(fine)
        if len(coarse.t) < len(fine.t):
            spec, scene = self.scene.spec, self.scene
            self.compare = Outputs(scene.mechanism, scene.motion, coarse.t, spec.asked or ASKED)
            fine.settings["judged"] = f"two runs up to {coarse.t[-1]:.4g} s, where they part"
        last = self._judged(coarse, fine.at(upto))
        settings: Settings = {**fine.settings, "tol": self.tol, "error": last.settings["error"]}
        words = (*fine.warnings, *ringing(self.scene, fine))
        return coarse, replace(
            fine, settings=settings, cost=last.cost, judged=last.judged, warnings=words
        )

    def _parted(self, coarse: Run, fine: Run) -> Run:
        """The finer of two runs with contacts that part, with a word on what it may be used for."""
        tol, when = self.tol, _parting(coarse, fine.at(slice(0, len(coarse.t))), self.tol)
        words = (
            f"contacts multiply what two runs differ by: they part by more than tol = {tol:g} at "
            f"t = {when:.4g} s, and from there on a single history means little. Peaks, means and "
            "spectra do, with their spread: run.statistics makes more runs and has them; a shorter "
            "`until` is within tol."
        )
        if not np.isfinite(when):
            words = (
                f"contacts: two runs, one in shorter steps, differ by {_worst(fine):.2g}, which is "
                f"not well within tol = {tol:g}."
            )
        settings: Settings = {**fine.settings}
        if np.isfinite(when):
            settings["parts"] = when
        several = partial(self._several, fine, self.size)
        return replace(fine, settings=settings, warnings=(*fine.warnings, words), several=several)

    def _several(self, fine: Run, size: float) -> dict[str, dict[str, object]]:
        """Statistics of three runs: one, a coarser one, and that with other speeds at the start."""
        size, runs, moved = size * self.ratio**2, [fine], replace(self.scene, nudge=_NUDGE)
        for scene in (self.scene, moved):
            with suppress(ConvergenceError):
                runs.append(scene.resolved(fine.t, size))
        if len(runs) == 1:
            return {}
        parts = _parting(runs[1], runs[2], self.tol) if len(runs) == 3 else np.inf
        told = statistics(fine.t, self.scene.mechanism.motors, [run.torque for run in runs])
        known = float(parts) if np.isfinite(parts) else None
        return {name: {**one, "parted": known} for name, one in told.items()}

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
        self._add(fine)
        return fine

    def _add(self, run: Run) -> None:
        for key, count in run.cost.items():
            self.cost[key] = self.cost.get(key, 0.0) + count

    def _at_round_off(self, coarse: Run, fine: Run) -> Run:
        """The finer of two runs alike, if a longer step shows that the tolerance is met."""
        if self.last is not None:
            raise floor(self.scene, self.tol, self.last)
        longer = self.size * self.ratio
        while _alike(coarse, fine) and longer < _LONGEST:
            longer *= self.ratio
            coarse, self.runs = self.attempt(longer, None), self.runs + 1
        last = self._judged(coarse, fine)
        if _worst(last) <= self.enough:
            return last
        raise floor(self.scene, self.tol, last)

    def _judged(self, coarse: Run, fine: Run) -> Run:
        """The finer run with its estimated error, all its cost and what it warns of."""
        differ = self.compare.differences(coarse, fine)
        error = {key: max(e / self.gain, ROUND_OFF) for key, e in differ.items()}
        settings: Settings = {**fine.settings, "tol": self.tol, "error": error}
        each = {**self.cost, "last_steps": fine.cost["steps"], "runs": float(self.runs)}
        words = (*fine.warnings, *ringing(self.scene, fine))
        # Of forces the vibration that steps under a controller lose is told beside that.
        judged = force_errors(self.scene.mechanism, coarse, fine, max(self.gain, 1.0))
        return replace(fine, settings=settings, cost=each, warnings=words, judged=judged)

    def _not_reached(self) -> ConvergenceError:
        assert self.last is not None
        key, change = max(self.last.settings["error"].items(), key=lambda item: item[1])
        words = " ".join((*self.last.warnings, *self.last.loop()))
        failed = ConvergenceError(
            f"{self.scene.mechanism.name}: tol = {self.tol:g} not reached: {key} still changes by "
            f"{change:.2g} after {self.runs} runs. {Ending.TOL_NOT_REACHED.value} "
            f"error.result holds the last run. {words}",
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
    """Largest estimated error of a run within a tolerance."""
    return max(run.settings["error"].values(), default=0.0)


def _alike(a: Run, b: Run) -> bool:
    """Whether two runs are the same bit for bit, which tells nothing of their error."""
    return all(np.array_equal(x, y) for x, y in ((a.y, b.y), (a.v, b.v), (a.torque, b.torque)))
