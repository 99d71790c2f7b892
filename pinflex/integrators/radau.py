"""The coupled level by Radau IIA collocation: steps whose Newton iteration decides for itself.

Of high order where the motion is smooth, so steps are long; the stages of a step are evaluated
together. The equations of a step are in `pinflex.integrators.stages`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinflex.actuation.drive import TorqueDrive
from pinflex.actuation.sampler import Sampler
from pinflex.arrays import Array
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.stages import StageEquations, Start, Step, Trial
from pinflex.integrators.steps import Path, StepFailed, largest
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism

STAGES = 6
_MAX_ITERATIONS = 10
# Newton stops at this part of the resolution: its error then does not show in the estimate. A
# resolution coarser than _COARSE does not loosen it further: predictions would run wild.
_NEWTON, _COARSE = 1e-2, 1e-3
# m or rad that loops may be open by before the last correction, which leaves little of it; and that
# part of the resolution: the next prediction magnifies what is left, and where it matters beside
# what is resolved, the steps get shorter without end.
_OPEN, _OPEN_PART = 1e-6, 3e-5
_CLOSED = 1e-12  # m or rad: what round-off leaves
# m or rad in every coordinate that Newton need not go below, and that no step shows less than.
_ROUND_OFF, _SEEN = 1e-14, 1e-13
# Of a step: equal pieces of a way differ by round-off (of the time: 1e-12 of 1 ms after 10 s), and
# share factors.
SAME_STEP = 1e-9


class Closeness(NamedTuple):
    """What Newton may leave of a step.

    Attributes:
        part: Correction, relative to the largest displacement so far.
        still: The same in every coordinate, m or rad: round-off.
        open: What loops are open by, m or rad.
    """

    part: float
    still: float
    open: float


# For differences of runs: as far as arithmetic goes, and what every step reaches. 1600 steps of
# 3rrr carry noise of 1e-9 and of 2e-7.
SHARP, FIRM = Closeness(1e-12, 1e-16, 1e-14), Closeness(1e-10, 1e-14, 1e-12)


@dataclass
class _Contraction:
    """Newton's iteration in a step so far.

    Attributes:
        reach: Largest displacement, of this step or before. goal: Correction to stop at.
        size: Norm of the last correction. rate: By which it fell. fresh: Iteration that began
            with a new tangent, or -1.
    """

    reach: float = 0.0
    goal: float = 0.0
    size: float = 0.0
    rate: float = 1.0
    fresh: int = -1

    def follow(self, size: float, iteration: int) -> None:
        """Take the norm of the next correction."""
        if not math.isfinite(size):
            raise StepFailed
        self.rate = size / max(self.size, 1e-300) if iteration else 1.0
        self.size = size

    def small(self, iteration: int) -> bool:
        """Whether what is left is below the goal."""
        rate = self.rate
        left = self.size * rate / (1.0 - rate) if rate < 0.9 else np.inf
        # Round-off has no rate.
        return left <= self.goal or (iteration > 0 and self.size < 0.1 * self.goal)

    def aged(self, iteration: int) -> bool:
        """Whether a new tangent is needed; raises StepFailed where it would not help."""
        wild = self.size > 1e3 * max(self.reach, self.goal)
        if not (wild or (iteration >= self.fresh + 2 and self.rate > 0.5)):
            return False
        if self.fresh >= 0 or self.size > max(self.reach, self.goal):
            raise StepFailed
        return True  # perhaps the tangent has only aged


class Stages(StageEquations):
    """Solves single steps of one run.

    Attributes:
        slow: Contraction of Newton's iteration above which the next step has a new tangent.
        closeness: What Newton may leave; None: as the resolution allows. slack: Times that, where
            round-off ends its iteration.
    """

    idle = (1.0, 1.2)  # a change of the step costs new factors
    slow, loose = 0.1, False
    slack = 1.0
    closeness: Closeness | None = None

    def __init__(
        self,
        mechanism: Mechanism,
        dynamics: Equations,
        path: Path,
        resolution: float,
        method: Collocation,
        drive: TorqueDrive | None = None,
        forces: bool = True,
        sampler: Sampler | None = None,
    ) -> None:
        super().__init__(mechanism, dynamics, path, method, drive, sampler)
        self.by_energy = forces and dynamics.flexible
        self.measured = slice(dynamics.n_rigid, None) if dynamics.flexible else self.free
        self.measured_rows = np.arange(dynamics.system.nv)[self.measured]
        self.scale, self.iterations = 0.0, 0
        self.resolve(resolution)

    def resolve(self, resolution: float) -> None:
        """Let steps be solved for a resolution from now on."""
        self.resolution = resolution

    def step(self, start: Start, h: float, last: Step | None) -> Step:
        """The step of length h from a state.

        Args:
            start: State. h: Length in s.
            last: The step before, whose polynomials predict; None: they start constant.
        Raises:
            StepFailed: Newton does not converge. LinAlgError: its matrix is singular.
        """
        x = self.begin(start, h, *self._predict(start, h, last))
        so_far = self._iteration(x)
        self.scale = self._reach(x.move + self._elastic(start.y))
        seen = max(self.scale, self._floor(_SEEN) / self.resolution)
        coarseness = self._size((self.method.last @ x.move)[None]) / seen
        return self.solved(x, coarseness, so_far.rate)

    def _iteration(self, x: Trial) -> _Contraction:
        """Newton's iteration of a step."""
        newton, so_far = self.newton, _Contraction()
        for iteration in range(_MAX_ITERATIONS):
            self.place(x)
            self._factors(x, so_far, iteration)
            self.correct(x)
            self.iterations += 1
            if not iteration:
                self._set_goal(x, so_far)
            so_far.follow(self._size(x.change), iteration)
            if so_far.small(iteration) and self._shut(x):
                break
            newton.stale = so_far.aged(iteration)
        else:
            raise StepFailed
        newton.stale = iteration > 0 and so_far.rate > self.slow
        return so_far

    def _factors(self, x: Trial, so_far: _Contraction, iteration: int) -> None:
        """A new tangent where the last one has aged, new factors where h has changed."""
        newton, k = self.newton, self.method.s // 2
        if newton.stale:
            newton.refresh(x.y[k], x.v[k], x.a[k], x.lam[k], float(x.t[k]))
            so_far.fresh = iteration
        if abs(newton.h - x.h) > SAME_STEP * x.h:
            newton.factor(x.h)

    def _set_goal(self, x: Trial, so_far: _Contraction) -> None:
        so_far.reach = self._reach(x.move + x.change + self._elastic(x.start.y))
        part, still, _ = self._closeness
        so_far.goal = max(part * so_far.reach, self._floor(still))

    @property
    def _closeness(self) -> Closeness:
        """What Newton may leave of a step; a loose iteration is corrected later."""
        if self.closeness is not None:
            return self.closeness
        part = (10.0 if self.loose else 1.0) * _NEWTON * min(self.resolution, _COARSE)
        return Closeness(part, _ROUND_OFF, min(_OPEN, max(_OPEN_PART * self.resolution, _CLOSED)))

    @property
    def goals(self) -> dict[str, float]:
        """What the compiled iteration stops at, by the names of the kernel."""
        least, still, open_by = self._closeness
        return {
            "resolution": self.resolution, "slow": self.slow, "least": least,
            "round_off": still, "seen": _SEEN, "open": open_by, "slack": self.slack,
            "most": _MAX_ITERATIONS, "same_step": SAME_STEP,
        }  # fmt: skip

    def _shut(self, x: Trial) -> bool:
        return bool(np.abs(x.c).max(initial=0.0) < self._closeness.open)

    def _reach(self, moves: Array) -> float:
        """Largest displacement so far, moves (k, nv) included: what errors are relative to."""
        return max(self.scale, self._size(moves), 1e-300)

    def _floor(self, least: float) -> float:
        """Norm of a displacement of `least` (m or rad) in every coordinate."""
        return least * math.sqrt(self._weight.trace())

    def _predict(self, start: Start, h: float, last: Step | None) -> tuple[Array, Array]:
        m = self.method
        if last is None:
            return np.tile(start.a, (m.s, 1)), np.tile(start.lam, (m.s, 1))
        W = m.at(1.0 + (h / last.h) * m.c)
        return W.dot(last.a), W.dot(last.lam)

    def _elastic(self, y: Array) -> Array:
        """Elastic coordinates of a pose among the velocity rows, shape (nv,)."""
        x = np.zeros(self.dynamics.system.nv)
        x[self.dynamics.n_rigid :] = y[self.dynamics.nq_rigid :]
        return x

    def _size(self, moves: Array) -> float:
        """Largest norm of displacements (k, nv): of the elastic ones, or of all if none bends.

        By their elastic energy where forces are asked for: stiff coordinates that hardly move may
        carry them. Else by the mass matrix: then such coordinates must not dictate the step.
        """
        return largest(moves[:, self.measured], self._weight)

    @property
    def _weight(self) -> Array:
        if self.by_energy:
            return self.dynamics.strain.stiffness
        k = len(self.free) - self.dynamics.system.n_eta if self.dynamics.flexible else 0
        return self.newton.tangent.M[k:, k:]

    @property
    def order(self) -> int:
        """Power of the step that its coarseness falls with."""
        return self.method.s

    @property
    def counts(self) -> dict[str, float]:
        """What the run has cost so far."""
        work, newton = {"newton": float(self.iterations)}, self.newton
        return work | {"tangents": newton.tangents, "factorisations": newton.factors}

    @property
    def settings(self) -> dict[str, object]:
        """The method, for reports."""
        return {"integrator": "radau", "stages": self.method.s}

    def expire(self) -> None:
        """Let the next step begin with a new tangent."""
        self.newton.stale = True
