"""Designs of one scene run at instants of one's own, in the steps of the first of them.

What a run of other steps changes is then no part of the difference of two designs: states are a
smooth function of the numbers of the scene, and each step can be halved to see what it leaves.

    coupled (and rigid, with drive: torque)   steps of Radau IIA that the first design chose
    ked                                       equal steps
    quasistatic, rigid                        every instant by itself: no steps
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from pinflex.actuation.drive import breaks
from pinflex.arrays import Array, distinct
from pinflex.errors import ConvergenceError, Ending
from pinflex.integrators.problem import Run
from pinflex.levels.modes import default_step
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result
from pinflex.solver.levels import LEVELS
from pinflex.solver.scene import Scene
from pinflex.solver.solve import SAMPLES, result_from, scene_of
from pinflex.threads import one_blas_thread

# Of the steps. A vibration of that share may be lost in them, and a derivative by a parameter that
# shifts its phase loses that many times the radians it has turned by: 1e-3 after 160 periods.
RESOLUTION = 1e-6
_INSIDE = 8  # instants in a step at which a first look is taken
_AFTER = 1e-7  # of the run: just after a break


class SameSteps:
    """The steps of a first design.

    Attributes:
        level: Of the runs.
        marks: Start, breaks and end of the first design [s], shape (n,): smooth between them.
        ends: Of its steps [s], shape (steps,); none where instants do not depend on each other.
    """

    def __init__(self, mechanism: Mechanism, level: str | None, resolution: float = RESOLUTION):
        """Find the steps."""
        scene = scene_of(mechanism, level)
        self.level, self._first = scene.spec.level, mechanism
        self.linear = scene.linear
        self.marched = self.level == "coupled" or (
            self.level == "rigid" and scene.spec.drive != "prescribed"
        )
        self.marks = _marks(scene)
        self.grid = np.linspace(0.0, self.marks[-1], scene.spec.samples or SAMPLES)
        self.ends = np.zeros(0)
        if self.marched:
            with one_blas_thread():
                steps = replace(scene, spec=replace(scene.spec, dt=None))
                self.ends = steps.paced(self.grid, resolution)
        elif self.linear:
            dt = scene.spec.dt or default_step(mechanism, float(self.marks[-1]))
            count = max(len(self.grid) - 1, int(np.ceil(self.marks[-1] / dt - 1e-9)))
            self.ends = np.linspace(0.0, self.marks[-1], count + 1)[1:]

    @property
    def stepped(self) -> bool:
        """Whether runs have steps, which can be halved."""
        return len(self.ends) > 0

    @property
    def look(self) -> Array:
        """Instants at which the first design is looked at [s], shape (nt,), from 0 on."""
        if self.linear:
            return np.concatenate([[0.0], self.ends])
        found = [self.grid, self.marks[:-1] + _AFTER * self.marks[-1]]
        if self.marched:
            begins = np.concatenate([[0.0], self.ends[:-1]])
            part = np.arange(1, _INSIDE + 1) / _INSIDE
            found.append((begins[:, None] + (self.ends - begins)[:, None] * part).ravel())
        return distinct(*found)

    def inside(self, t: float) -> tuple[float, float]:
        """The smooth piece that an instant lies in [s]; a break belongs to the one before it."""
        k = min(max(int(np.searchsorted(self.marks, t, side="left")), 1), len(self.marks) - 1)
        low = self.marks[k - 1] + (_AFTER * self.marks[-1] if k > 1 else 0.0)
        return float(low), float(self.marks[k])

    def run(self, design: Mechanism, t: Array, halved: bool = True) -> Result:
        """A design at instants of the first one.

        Where its motion or loads switch at other times, the instants and the steps are stretched
        between them.

        Raises:
            SceneError: It cannot be solved in these steps.
        """
        began, scene = time.perf_counter(), scene_of(design, self.level)
        marks = _marks(scene)
        if len(marks) != len(self.marks):
            raise ConvergenceError(
                f"{design.name}: its motion or loads have other breaks.",
                ending=Ending.OTHER_BREAKS,
            )
        # from instant to instant, closed loops are followed: not too far at once
        every = distinct(t, self.marks[[0, -1]] if self.stepped else self.grid)
        with one_blas_thread():
            found = self._run(scene, np.interp(every, self.marks, marks), marks, halved)
            found = found.at(np.searchsorted(every, t))
            return result_from(design, scene.motion, found, scene.spec, began)

    def _run(self, scene: Scene, t: Array, marks: Array, halved: bool) -> Run:
        if not self.stepped:
            spec = replace(scene.spec, tol=None)
            return LEVELS[self.level](replace(scene, spec=spec), t, None)
        ends = self.ends
        if halved:
            begins = np.concatenate([[0.0], ends[:-1]])
            ends = np.column_stack([0.5 * (begins + ends), ends]).ravel()
        ends = np.interp(ends, self.marks, marks)
        if self.linear:
            spec = replace(scene.spec, tol=None, dt=float(marks[-1]))
            grid = np.linspace(0.0, ends[-1], len(ends) + 1)
            run = replace(scene, spec=spec).stepped(grid, float(marks[-1]))
            return run.at(np.argmin(np.abs(grid[:, None] - t), axis=0))
        return replace(scene, spec=replace(scene.spec, dt=None)).along(t, ends)


def _marks(scene: Scene) -> Array:
    """Start, breaks and end of a scene [s], shape (n,)."""
    spec, motion = scene.spec, scene.motion
    end = float(spec.until if spec.until is not None else motion.duration)
    system = scene.mechanism.flexible if scene.spec.level != "rigid" else scene.mechanism.rigid
    inner = [x for x in breaks(motion, system.loads) if x < end * (1.0 - _AFTER)]
    return np.array([0.0, *inner, end])
