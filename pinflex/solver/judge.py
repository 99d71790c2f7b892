"""The judge of a run within a tolerance: it corrects the steps twice, and sends the run back.

The samples of the first correction (`pinflex.integrators.corrector`) are answered. What the second
one, with one stage more again, changes in the outputs asked for is their error so far: what the
first leaves because its method is of finite order, and because it is one step of Newton. It sets
the resolution of the steps to come; where it exceeds what is allowed, the run goes back to the step
before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinflex.actuation.drive import Nominal, nominal
from pinflex.errors import ConvergenceError, Ending, SceneError
from pinflex.integrators.corrector import Corrector, Inside
from pinflex.integrators.march import ANEW, Radau, Record
from pinflex.integrators.problem import Run, Settings
from pinflex.levels.outputs import (
    LEAST_SIZES,
    REST,
    History,
    Outputs,
    bent,
    between,
    platform_poses,
    relative_size,
)
from pinflex.levels.rigid import multipliers
from pinflex.mechanics.evaluation.equations import Equations

if TYPE_CHECKING:
    from pinflex.actuation.path import MotorPath
    from pinflex.arrays import Array
    from pinflex.integrators.compiled import Batch, States
    from pinflex.integrators.problem import Path, State
    from pinflex.solver.scene import Scene

# How far a run is going to move, before it is made: from the rigid motion and the stiffness.
#
# At a few instants of the rigid motion, what the undeformed links do not balance is laid on their
# stiffness. A vibration may double it; it is for scales only.

_INSTANTS = 9


@dataclass(frozen=True)
class Expected:
    """Largest values over a run.

    Attributes:
        scale: Elastic displacement in the norm of the steps, 0: not known.
        sizes: By output, in its unit.
    """

    scale: float
    sizes: dict[str, float]


def few(motion: Nominal) -> Nominal:
    """As many instants of a rigid motion as scales take, its ends among them."""
    every = np.linspace(0, len(motion.t) - 1, min(_INSTANTS, len(motion.t)))
    return motion.at(np.round(every).astype(int))


def expected(
    scene: Scene, end: float, dynamics: Equations | None = None, reference: Nominal | None = None
) -> Expected:
    """Scales of a run."""
    mechanism, system = scene.mechanism, scene.mechanism.loose
    if scene.spec.level != "coupled" or not system.n_eta or scene.spec.drive == "torque":
        return Expected(0.0, {})
    if mechanism.rigid.closed.n != system.closed.n:
        return Expected(0.0, {})
    try:
        if reference is None:
            reference = nominal(mechanism, scene.motion, np.linspace(0.0, end, _INSTANTS))
    except SceneError:
        return Expected(0.0, {})
    dynamics = dynamics or Equations(system)
    n, t = dynamics.n_rigid, reference.t
    y, v, a = (
        np.concatenate([x, np.zeros((len(t), system.n_eta))], axis=1)
        for x in (reference.q, reference.v, reference.a)
    )
    r, J = dynamics.residual(y, v, a, np.zeros((len(t), system.closed.n)), t).r, dynamics.close(y).J
    lam, torque = multipliers(mechanism, J[:, :, :n], r[:, :n])
    force = r[:, n:] - (J[:, :, n:].swapaxes(1, 2) @ lam[:, :, None])[:, :, 0]
    eta = np.asarray(-np.linalg.solve(dynamics.strain.stiffness, force.T).T, dtype=float)
    weight = dynamics.strain.stiffness if scene.by_forces else _mass(dynamics, y[0])
    pose = y.copy()
    pose[:, dynamics.nq_rigid :] = eta
    sizes = {key: _largest(x) for key, x in {"torque": torque, **bent(system, pose)}.items()}
    # Loops that are left open would let the platform go much farther.
    if mechanism.description.platform and not system.closed.n:
        p, R = platform_poses(mechanism, dynamics, np.concatenate([y, pose]))
        sizes["platform position"] = _largest(p[len(t) :] - p[: len(t)])
        sizes["platform rotation"] = _largest(between(R[: len(t)], R[len(t) :]))
    return Expected(_largest(np.sum((eta @ weight) * eta, axis=1)) ** 0.5, sizes)


def _mass(dynamics: Equations, y: Array) -> Array:
    k = dynamics.n_rigid
    return np.asarray(dynamics.mass(y)[k:, k:])


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))


# Of the tolerance: what the second correction may change at the end. More than that is told: of a
# vibration that no order follows it sees a part only (told over true: tests/benchmarks/BARS.md).
PART = 0.45


@dataclass(frozen=True)
class ErrorControl:
    """How the resolution of the steps follows the error so far, as of a run of many steps.

    Attributes:
        safety: Part of what the error may be at the end that it may be on the way.
        growth, shrink: Of the resolution after a batch, at the most and at the least.
        least: The same after a step back.
        target, spent: Parts of what the error may be on the way that are aimed at, and that are too
            much to go on with.
        idle: Of the budget that is left: an error that grows by less lets the steps get longer.
        reserve: The least budget, of what the error may be: steps do not stay short where it does
            not grow.
        coarsest: Resolution, and in tolerances: beyond, steps fail, and cost more than they save.
        finest: Resolution below which round-off is all that there is.
        expected: Of the size that is expected of an output, the least that its error relates to.
        contraction: Of a step's Newton iteration, above which its second correction is made twice:
            what it leaves would count as error.
        stalled, finer: An error that is still so much of what it was, at a resolution so much
            finer, shows round-off. borne: So many such errors are allowed then.
        restarts: Times that a run may begin anew. hindsight: At a resolution so much finer than it
            was, in the first half: what errs is behind, and short steps do not mend it.
    """

    safety: float = 0.95
    growth: float = 2.0
    shrink: float = 0.3
    least: float = 0.02
    target: float = 0.7
    spent: float = 0.8
    idle: float = 0.3
    reserve: float = 0.05
    coarsest: tuple[float, float] = (1e-3, 2.0)
    finest: float = 1e-13
    expected: float = 0.5
    contraction: float = 0.02
    stalled: float = 0.7
    finer: float = 1e-2
    borne: float = 1.5
    restarts: int = 4
    hindsight: float = 3e-3


CONTROL = ErrorControl()


class Judge(Record):
    """Records the corrections of the steps of a run, and sends it back where they differ.

    Attributes:
        lowest: The least resolution so far.
        stuck: Whether it goes on whatever the error.
        begun: How often the run has begun.
    """

    def __init__(
        self,
        radau: Radau,
        t: Array,
        compare: Outputs,
        foreseen: Expected,
        tol: float,
        resolution: float,
        stuck: bool,
        again: bool,
    ) -> None:
        """`again`: the resolution is not to rise, for it did in a run whose error was too large."""
        problem, system = radau.problem, radau.problem.dynamics.system
        super().__init__(system, t, resolution)
        problem.path = _remembering(problem.path)  # both corrections are sampled at the same times
        self._radau, self._corrector = radau, Corrector(radau)
        self._second = Corrector(self._corrector, slow=CONTROL.contraction)
        self._better = Record(system, t, resolution)
        radau.loose = True
        self._compare, self._foreseen = compare, foreseen
        self._allowed, self._most = CONTROL.safety * PART * tol, PART * tol
        self.lowest, self.stuck, self.begun = resolution, stuck, 1
        coarsest, tolerances = CONTROL.coarsest
        self._coarsest = max(tolerances * tol, min(coarsest, 10.0 * tol))
        if again:
            self._coarsest = resolution
        # Time (s), resolution and error of a sample that the run was sent back for.
        self._seen: tuple[float, float, float] | None = None

    def start(self, now: State) -> None:
        """Take the first state, or begin anew."""
        super().start(now)
        self._now = now
        self._better.start(now)
        self._corrector.begin_anew()
        self._second.begin_anew()
        self._sizes: dict[str, float] = {}
        self._moved, self._borne = False, 0.0
        self._histories: list[dict[str, History]] = []
        self._error, self._highest = 0.0, self.resolution
        self._error_at = float(self.t[0])

    def take(self, steps: Batch) -> int:
        """Correct steps twice and record both; the number of them that may stay, or ANEW."""
        if not len(steps):
            return 0
        t, h = steps.t, steps.h
        self._radau.slow = self._slowest(float(h[-1]))
        try:
            corrected = self._corrector.correct(steps)
            twice = self._second.correct(corrected)
        except np.linalg.LinAlgError:
            return self._shorter()
        found, better = self.read(corrected), self._better.read(twice)
        histories = self._compared(found, better)
        errors = self._errors(corrected, twice, histories)
        bad = np.flatnonzero(~(errors <= max(self._allowed, self._borne)))
        good = len(steps)
        if len(bad) and not self.stuck:
            good = self._send_back(float(t[bad[0]] + h[bad[0]]), errors, int(bad[0]))
            if good == ANEW:
                return self._anew()
            if not good:
                return good
        self._borne = min(self._borne, CONTROL.borne * float(np.max(errors)))
        end = float(t[good - 1] + h[good - 1])
        if good == len(steps) and not len(bad) and not self.stuck:
            self._adapt(errors, end)
            if self._in_hindsight(end):
                return self._anew()
        self._highest = max(self._highest, self.resolution)
        self._error, self._error_at = max(self._error, float(np.max(errors[:good]))), end
        steps, corrected, twice = (x.upto(good) for x in (steps, corrected, twice))
        kept = self._samples(steps)
        self.keep(corrected, kept)
        self._better.keep(twice, kept)
        self._corrector.keep(steps)
        self._second.keep(corrected)
        self._histories.append({key: h.upto(kept) for key, h in histories.items()})
        return good

    def runs(self) -> tuple[Run, Run]:
        """The corrected run, and the one corrected twice."""
        return super().run({}, {}), self._better.run({}, {})

    def finish(self, steps: Batch) -> None:
        """Record the last steps of a run that has broken off."""
        self.stuck = True
        self.take(steps)

    def run(self, cost: dict[str, float], settings: Settings) -> Run:
        """The corrected run so far."""
        steps = cost["steps"]
        cost = {
            **cost,
            "corrections": float(self._corrector.iterations + self._second.iterations),
            "last_steps": steps,
            "steps": steps + cost["repeated"],
            "runs": float(self.begun),
        }
        return super().run(cost, settings)

    def inside(self, jumps: Sequence[float], run: Run) -> Inside:
        """What solves the equations at samples inside steps."""
        problem, jumps = self._radau.problem, (float(self.t[0]), *jumps)
        return Inside(problem.free, problem.push, jumps, run.settings["dt"])

    @cached_property
    def differences(self) -> dict[str, float]:
        """Relative difference of the two corrected runs, once they are at their end."""
        if not self._moved:
            return {}
        found = {
            key: relative_size(
                key,
                np.concatenate([h[key].apart for h in self._histories]),
                np.concatenate([h[key].size for h in self._histories]),
            )
            for key in (self._histories[0] if self._histories else {})
        }
        if not any(found.values()):
            return self._compare.differences(*self.runs())  # at rest, or joints alone move
        return {key: error for key, error in found.items() if error is not None}

    def _samples(self, steps: Batch) -> int:
        """Number of samples in steps to come."""
        end = float(steps.ends[-1])
        return int(np.searchsorted(self.t, end, side="right")) - self.count

    def _slowest(self, h: float) -> float:
        """Contraction that a correction may have, where so many steps of h (s) follow."""
        number = float(self.t[-1] - self.t[0]) / h
        return min(0.1, float(np.sqrt(0.3 / number)))

    def _compared(self, found: States, better: States) -> dict[str, History]:
        """Errors of the outputs at the samples of states, and how large they are."""
        n, first = self.count, self._now.y
        self._moved |= bool(np.abs(better.y - first).max(initial=0.0) > REST)
        histories = self._compare.histories(self._run(found), self._run(better), n, first)
        for key, history in histories.items():
            size = float(np.max(history.size, initial=0.0))
            self._sizes[key] = max(self._sizes.get(key, 0.0), size)
        return histories

    def _run(self, states: States) -> Run:
        y, v, a, lam, torque, _ = states
        return Run(self.system, np.zeros(len(y)), y, v, a, lam, torque, {})

    def _at_ends(self, corrected: Batch, twice: Batch) -> dict[str, History]:
        """Errors of the outputs at the ends of steps."""
        before, after = (self._run(steps.states()) for steps in (corrected, twice))
        return self._compare.histories(before, after, None, self._now.y)

    def _errors(self, corrected: Batch, twice: Batch, histories: dict[str, History]) -> Array:
        """Largest error of all outputs in each step, relative to the largest value so far."""
        worst = np.zeros(len(twice))
        if not self._moved:
            return worst  # at rest: round-off is all that differs
        ends = twice.ends
        looked_at = self.t[self.count :]
        for key, (at, apart, _) in histories.items():
            np.maximum.at(worst, np.searchsorted(ends, looked_at[at]), apart / self._scale(key))
        fewest = min((len(history.at) for history in histories.values()), default=0)
        if fewest < len(twice):  # between few samples an error would be found too late
            # What velocities leave open at the start shows in the forces of the first step.
            first = int(not self.ends)
            for key, (_, apart, _) in self._at_ends(corrected, twice).items():
                worst[first:] = np.maximum(worst, apart / self._scale(key))[first:]
        return worst

    def _scale(self, key: str) -> float:
        """Size of an output that its error is relative to: so far, or as it is expected to be.

        Infinite while that is round-off.
        """
        size = max(self._sizes.get(key, 0.0), CONTROL.expected * self._foreseen.sizes.get(key, 0.0))
        return size if size > LEAST_SIZES.get(key, 0.0) else np.inf

    def _send_back(self, end: float, errors: Array, bad: int) -> int:
        """The number of good steps before a bad one, which ends at `end` (s).

        And the resolution for those that replace it.
        """
        error = float(np.max(errors))
        error = error if np.isfinite(error) else 1.0
        if self._in_vain(end, error):
            return len(errors)
        before = max(self._error, float(np.max(errors[:bad], initial=0.0)))
        anew = before > CONTROL.spent * self._allowed  # what is carried along is too much already
        if anew and error < self._most:
            self._borne, self.resolution = self._most, CONTROL.shrink * self.resolution
            return len(errors)
        if self.resolution < CONTROL.finest or (anew and self.begun > CONTROL.restarts):
            self._borne = CONTROL.borne * error
            return len(errors)
        so_far = 0.0 if anew else before
        room = CONTROL.target * (self._allowed - so_far)
        self.resolution *= min(max(room / (error - so_far), CONTROL.least), CONTROL.shrink)
        self.lowest = min(self.lowest, self.resolution)
        return ANEW if anew else bad

    def _in_hindsight(self, end: float) -> bool:
        """Whether a run that has come to `end` (s) would better have begun with short steps."""
        half = 0.5 * float(self.t[0] + self.t[-1])
        far_finer = self.resolution < CONTROL.hindsight * self._highest
        return far_finer and end < half and self.begun <= CONTROL.restarts

    def _anew(self) -> int:
        """Let no step stay."""
        self._coarsest = self.resolution  # where it rose again the error did too
        self.begun += 1
        self.start(self._now)
        return ANEW

    def _in_vain(self, t: float, error: float) -> bool:
        """Whether shorter steps have brought nothing at a time where the run was sent back.

        Then the run goes on with what it has: its outputs may yet grow, and the end decides.
        """
        seen = self._seen
        if seen is None or t > seen[0] + 1e-9 * abs(t) or error < CONTROL.stalled * seen[2]:
            self._seen = t, self.resolution, error
        elif self.resolution < CONTROL.finer * seen[1]:
            self._borne, self.resolution = CONTROL.borne * error, seen[1]
            return True
        return False

    def _shorter(self) -> int:
        """Take no step of some that cannot be corrected."""
        self.resolution *= CONTROL.shrink
        if self.resolution < CONTROL.finest:
            raise ConvergenceError(
                "steps cannot be corrected: their equations are singular with one stage more. "
                f"{Ending.NOT_CORRECTED.value}",
                ending=Ending.NOT_CORRECTED,
            )
        return 0

    def _adapt(self, errors: Array, end: float) -> None:
        """Adapt the resolution: extrapolate the error to the end, and compare it with the budget.

        What has grown so far is taken to grow once more in the same time, at the most.
        """
        begin, until = float(self.t[0]), float(self.t[-1])
        now = max(self._error, float(np.max(errors)))
        slope = (now - self._error) / max(end - self._error_at, 1e-300)
        growth = slope * min(until - end, end - begin)
        # Some is always left: steps do not stay short where the error does not grow.
        room = max(CONTROL.target * self._allowed - now, CONTROL.reserve * self._allowed)
        if growth > room:
            self.resolution *= max(room / growth, CONTROL.shrink)
        elif growth < CONTROL.idle * room:
            self.resolution *= min(room / max(growth, 1e-300), CONTROL.growth)
        self.resolution = min(max(self.resolution, CONTROL.finest), self._coarsest)


def _remembering(path: Path) -> Path:
    """A motion of the motors that knows what it was last asked for."""
    last: MotorPath | None = None

    def at(t: Array) -> MotorPath:
        nonlocal last
        if last is None or not np.array_equal(last.t, t):
            last = path(t)
        return last

    return at
