"""A tolerance kept by one run that judges itself while it goes.

Steps are taken once more with one stage more, and their samples are answered; what a second such
correction changes in them is their error, twice which is told (`pinflex.solver.judge`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinflex.actuation.drive import breaks
from pinflex.arrays import Array
from pinflex.description.solve import ASKED
from pinflex.errors import ConvergenceError
from pinflex.integrators.march import SHORT, Radau
from pinflex.integrators.run import Run
from pinflex.levels.outputs import ROUND_OFF, Outputs
from pinflex.mechanics.equations import Equations
from pinflex.solver.estimates import floor
from pinflex.solver.expected import Expected, expected, few
from pinflex.solver.force_errors import elastic_apart, force_errors
from pinflex.solver.judge import CONTROL, PART, Judge
from pinflex.solver.ringing import ringing
from pinflex.solver.scene import Progress, Scene

_FIRST = 0.5  # resolution of the first steps, of the tolerance
_INSTANTS = 51  # at which errors are looked at, at the least
# Runs whose error at the end may be too large after all; resolution of the next one, at the most.
_TRIES, _NEXT = 8, 0.1
# An error that is still so much of what it was, at a resolution so much finer, shows round-off.
_NO_BETTER, _IN_VAIN = 0.7, 3e-3
# Runs more for forces and stresses, the resolution of the next one at the most, and the parts of
# the tolerance that strain and what elastic forces accelerate may differ by where these are not
# looked at (what is told is 0.6 to 5.6 times the latter on most scenes).
_FORCE_TRIES, _FINER_FORCES, _CLEAR, _CLEAR_FORCE = 3, 0.5, 0.1, 0.2
_FINER = 16.0  # where steps that are too long break off, shorter ones may pass


def in_one_run(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """The run at samples t (s) within a relative error tol, by Radau IIA collocation."""
    return _OneRun(scene, t, tol, progress, scene.equations()).run()


class _OneRun:
    def __init__(
        self,
        scene: Scene,
        t: Array,
        tol: float,
        progress: Progress | None,
        dynamics: Equations,
    ) -> None:
        self.scene, self.asked_for, self.tol, self.progress = scene, t, tol, progress
        few = len(t) < _INSTANTS
        self.t = np.union1d(t, np.linspace(t[0], t[-1], _INSTANTS)) if few else t
        self.dynamics = dynamics
        asked = scene.spec.asked or ASKED
        self.outputs = Outputs(scene.mechanism, scene.motion, self.t, asked, self.dynamics)
        self.foreseen = self._foreseen()
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
        once, twice = judge.runs({}, {})
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
        told = {"tol": self.tol, "error": error, "judged": "a correction of every step"}
        settings = {**run.settings, **told}
        settle = judge.inside(breaks(self.scene.motion, self.dynamics.system.loads), run)
        once, twice = (replace(x, settle=settle) for x in judge.runs({}, {}))
        judged = force_errors(self.scene.mechanism, once, twice, PART) if error else None
        warnings = (*run.warnings, *ringing(self.scene, run))
        return replace(run, settings=settings, warnings=warnings, settle=settle, judged=judged)

    def _at_samples(self, run: Run) -> Run:
        """At those that were asked for."""
        same = self.t is self.asked_for
        return run if same else run.at(np.searchsorted(self.t, self.asked_for))
