"""The march of level coupled: Radau IIA collocation on the compiled kernel, whose steps follow the
motion or are given.

Of high order where the motion is smooth, so steps are long. The kernel takes a batch of steps
(source/march.c); a record reads them off, sets the resolution of those to come, and may send the
run back. Python is asked where the kernel cannot know: motions and loads without a table, and a
controller's outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import ConvergenceError, Ending, MotionError, RunInterrupted
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.compiled import STATE, Batch, Stages, States
from pinflex.integrators.events import Events
from pinflex.integrators.problem import Problem, Run, Settings, State
from pinflex.kernel.library import constant
from pinflex.mechanics.model.system import System

FULL, INPUTS, START, STUCK, SAMPLE, EVENT, RESTARTS, HOLDS, ON = (
    constant(name)  # of source/march.c
    for name in ("FULL", "INPUTS", "START", "STUCK", "SAMPLE", "EVENT", "RESTARTS", "HOLDS", "ON")
)
STAGES = 6
# First step, of the run. A long one damps what begins to ring there, and nothing shows that it
# did: two runs would agree without it. Only a run that knows no scale begins so.
LONG, SHORT = 0.02, 1e-3
# Steps that are judged at once: at first, after a batch that was sent back, and at the most. What
# Python does with a batch takes as long as some steps of a small system; of a large one (of more
# coordinates) it counts for little, and tangents of many steps would take hundreds of MB.
TOGETHER, BACK, MOST, LARGE = 16, 8, 32, 128
_RECORDED = 64  # steps of a batch that nobody judges
_PATIENCE = 0.2  # s: so long the kernel marches on before signals are looked at
_RUNS_AWAY = 1e6  # m/s or rad/s: no mechanism in SI units gets there by itself
_RESTING = 1e-7  # resolution that Newton's tolerance is of where rigid stops are met
# Where a run is, in a step of the kernel: it can go on from there once more.
_POINT = ("t", "ceiling", "before", "refused", "scale", "number", "stop", "follows")


class NewtonTolerance(NamedTuple):
    """What Newton's iteration may leave of a step.

    Attributes:
        relative: Correction over the largest displacement so far.
        absolute: The same in every coordinate, m or rad: round-off.
        closure: What loops are open by before the last correction, m or rad.
        slack: Times these, where round-off ends the iteration.
    """

    relative: float
    absolute: float
    closure: float
    slack: float = 1.0


# For differences of runs: as far as arithmetic goes, and what every step reaches. 1600 steps of
# 3rrr carry noise of 1e-9 and of 2e-7.
SHARP, FIRM = NewtonTolerance(1e-12, 1e-16, 1e-14, 100.0), NewtonTolerance(1e-10, 1e-14, 1e-12)


def newton_tolerance(resolution: float, loose: bool = False) -> NewtonTolerance:
    """What Newton may leave at a resolution: too little to show in the estimate of coarseness.

    A resolution coarser than 1e-3 does not loosen it further: predictions would run wild. Loops
    may be open by a part of the resolution: the next prediction magnifies what is left, and where
    that matters beside what is resolved, the steps get shorter without end.
    """
    relative = (10.0 if loose else 1.0) * 1e-2 * min(resolution, 1e-3)
    return NewtonTolerance(relative, 1e-14, min(1e-6, max(3e-5 * resolution, 1e-12)))


# How the length of steps follows their coarseness, the error that the resolution bounds: the last
# Legendre coefficient of the displacement over the largest one so far. In a vibration the error
# that a step adds is about half its square for each radian.

_MEMORY = 0.7  # part of the last step's coarseness that this one is taken to have at least
_RECOVERY = 1.5  # growth of steps, each, after one that Newton did not solve
_SHORTEST = 1e-9  # of the run: a step that has to be shorter has met something singular
_SEEN = 1e-13  # m or rad in every coordinate that no step shows less than
# Of a step: pieces of a way differ by round-off (of the time: 1e-12 of 1 ms after 10 s), and share
# factors.
_SAME_STEP = 1e-9


# Newton's iterations in steps that are given: to round-off, and where no step predicts, it needs
# more (ur5 under a digital controller: 12 in the first millisecond); steps in pieces would not be
# those of the run that they are compared with.
_PATIENT = 20
ANEW = -1  # of all steps none stays: the run begins again


class Radau(Stages):
    """Radau IIA on a problem, as a run within a resolution uses it.

    Attributes:
        resolution: Coarseness allowed; None: the record's.
        idle: Factors on the length of steps between which a change does not pay: it costs factors.
        grain: Lengths of an octave that steps may have, 0: any. A length that follows an estimate
            of error to all its digits hands round-off from step to step: 1e-14 of a payload is
            1e-6 of torque at the end of a run.
        tolerance: What Newton may leave; None: as the resolution allows. loose: Whether a
            correction of the steps takes more of that away. iterations: In a step, at the most.
        finest: Resolution that Newton's tolerance is of at most.
        slow: Contraction of Newton's iteration above which the next step has a new tangent.
        measured: Velocity rows whose displacements count. by_energy: Whether in the norm of elastic
            energy: stiff coordinates that hardly move may carry forces. Else in that of the mass
            matrix: then such coordinates must not dictate the step.
    """

    def __init__(self, problem: Problem, method: Collocation, forces: bool = True) -> None:
        """`forces`: whether these are asked for."""
        super().__init__(problem, method)
        d = problem.dynamics
        self.resolution: float | None = None
        self.idle, self.grain = (1.0, 1.2), 0
        self.tolerance: NewtonTolerance | None = None
        self.loose, self.iterations, self.slow = False, 10, 0.1
        # What rests on a rigid stop sinks in by next to nothing: steps must not be off by as much.
        self.finest = _RESTING if d.system.kinks.rigid else np.inf
        self.by_energy = forces and d.flexible
        # The elastic ones, or all if nothing bends.
        self.measured = np.arange(d.n_rigid, d.system.nv) if d.flexible else problem.free


class March:
    """The steps of one run.

    Attributes:
        steps: Those that are pending. resolution: Of the steps to come. kernel: Arrays of all.
        at: Where the run is, in the C structure.
    """

    def __init__(
        self, name: str, radau: Radau, start: tuple[Array, Array], ends: tuple[float, float],
        stops: Mapping[int, Sequence[float]], first: float, together: tuple[int, int],
        scale: float = 0.0, unjudged: bool = False,
    ) -> None:  # fmt: skip
        """Nothing is taken yet.

        `scale`: largest displacement of the run, as far as it is known. `unjudged`: whether its
        first step is taken whatever its coarseness.
        """
        self._name, self._radau, self.resolution = name, radau, 0.0
        span, self._repeated = ends[1] - ends[0], 0
        times, kind = _stops(ends, stops)
        problem, m = radau.problem, radau.method
        given = vars(m) | {"measured_at": radau.measured, "stop_at": times, "kind": kind}
        if radau.by_energy:
            given["weight"] = problem.dynamics.strain.stiffness
        table = radau.table(ends, times[kind == RESTARTS].tolist())
        self.kernel = radau.kernel.march(given, table, together)
        self.at = at = self.kernel.at
        at.shortest, at.held, at.growth = _SHORTEST * span, _MEMORY, _RECOVERY
        at.idle_from, at.idle_to = radau.idle
        at.most, at.seen, at.same_step = radau.iterations, _SEEN, _SAME_STEP
        at.order, at.patience, at.grain = m.s, _PATIENCE, radau.grain
        at.t, at.h, at.first, at.scale, at.unjudged = ends[0], first, first, scale, unjudged
        at.ceiling = at.refused = np.inf
        self.kernel.y[...], self.kernel.v[...] = start
        self.events: Events | None = None
        if problem.dynamics.system.kinks.rows:
            self.events = Events(name, problem, radau.kernel.evaluator)
            self.events.begin(self.kernel)
        self._start()
        self._begun = self.now, {name: getattr(at, name) for name in _POINT}, first
        self.steps = self._batch(0)

    def together(self, steps: int) -> None:
        """Let batches hold no more steps than these, and than there is room for."""
        self.at.capacity = min(steps, len(self.kernel.steps["t"]) - 1)

    @property
    def done(self) -> bool:
        """Whether the run is at its end."""
        return bool(self.at.stop >= self.at.stops)

    @property
    def now(self) -> State:
        """The state that the run has come to."""
        return State(float(self.at.t), *(getattr(self.kernel, name).copy() for name in STATE))

    def cost(self) -> dict[str, float]:
        """What the run has cost so far."""
        at = self.at
        counts = {
            "steps": at.number, "rejected": at.rejected, "unresolved": at.unresolved,
            "repeated": self._repeated, "newton": at.iterations, "tangents": at.refreshed,
            "factorisations": at.factored,
        }  # fmt: skip
        return {key: float(count) for key, count in counts.items()}

    def advance(self, resolution: float) -> None:
        """Some steps more, which are `steps` then; raises ConvergenceError where none is short."""
        at, radau, self.resolution = self.at, self._radau, resolution
        if last := int(at.count):  # the next batch begins behind it
            for name in ("a", "lam", "h"):
                self.kernel.steps[name][0] = self.kernel.steps[name][last]
        at.count = 0
        self.require(resolution)
        try:
            while (end := self.kernel.advance()) not in (FULL, STUCK):
                if end == INPUTS:
                    times = at.t + at.size * radau.method.c
                    self.kernel.input[...], at.given = radau.inside(times), 1
                elif end == START:
                    self._start()
                elif end == SAMPLE:
                    self._hold()
                elif end == EVENT and self.events is not None:
                    self.events.met(self.kernel)
                    at.follows = 0
                    self._start()
                elif at.tangents == 1:  # nobody judges: patience is for signals and progress
                    break
        finally:
            self.steps = self._batch(int(at.count))
        self._require_on_beams()
        if end == STUCK:
            raise _stuck(self._name, self.now)

    def require(self, resolution: float) -> None:
        """Let the next steps be as close as a resolution asks for."""
        at, radau = self.at, self._radau
        at.resolution, at.slow = radau.resolution or resolution, radau.slow
        close = radau.tolerance or newton_tolerance(min(resolution, radau.finest), radau.loose)
        at.least, at.round_off, at.open, at.slack = close

    def settle(self, good: int, resolution: float) -> None:
        """Let only the first of the steps stay, or none of all (ANEW).

        Those that replace the others are shorter by what their resolution asks for.
        """
        at = self.at
        if good < len(self.steps):
            before = int(at.number)
            finer = min(resolution / self.resolution, 1.0) ** (1.0 / self._radau.method.s)
            self._go_back(good)
            at.h *= finer
            at.stale = 1
            self._repeated += before - int(at.number)
            if good == ANEW:
                self._begun = (*self._begun[:2], at.h)
        self.steps = self._batch(0)

    def _batch(self, size: int) -> Batch:
        return Batch(self._radau, self.kernel, size)

    def _require_on_beams(self) -> None:
        """Raise where a step has led off a beam; it is the last one then."""
        dynamics = self._radau.problem.dynamics
        if not dynamics.system.closed.contacts or not len(self.steps):
            return
        Y = self.steps.states().y
        if (k := dynamics.first_off(Y)) is not None:
            t = [*self.steps.t[1:], self.at.t]
            self.steps = self.steps.upto(k + 1)
            dynamics.require_on_beams(Y[k], self._name, float(t[k]))

    def _start(self) -> None:
        """Consistent accelerations; where the kernel has none, those of numpy."""
        k, problem = self.kernel, self._radau.problem
        if problem.sampler is None and k.table and k.begin():
            return
        found = problem.first(float(self.at.t), k.y.copy(), k.v.copy())
        if problem.sampler is not None:
            self._radau.kernel.arrays["held"][...], self.at.jumped = problem.sampler.held, 0
        k.a[...], k.lam[...], k.torque[...] = found.a, found.lam, found.torque

    def _hold(self) -> None:
        """Let the controller act: accelerations jump by what its forces do."""
        k, at = self.kernel, self.at
        sampler = self._radau.problem.sampler
        assert sampler is not None
        if self._radau.resolution is not None:
            at.h = min(at.first, at.ceiling)  # the next step is as long as it is given
        if not sampler.reach(at.t, k.y, k.v):
            return
        self._radau.kernel.arrays["held"][...], at.jumped = sampler.held, 1

    def _go_back(self, good: int) -> None:
        """To where a step of the batch began, or to the start of the run."""
        k, at, steps, step = self.kernel, self.at, self.kernel.steps, good + 1
        if good == ANEW:
            now, point, at.h = self._begun
            for name in STATE:
                getattr(k, name)[...] = getattr(now, name)
            at.count = 0
        else:
            for name in STATE:
                getattr(k, name)[...] = steps[f"{name}0"][step]
            point = {name: steps[name][step].item() for name in _POINT}
            at.h, at.count = float(steps["next"][step]), good
        for name, value in point.items():
            setattr(at, name, value)


def _stops(
    ends: tuple[float, float], stops: Mapping[int, Sequence[float]]
) -> tuple[Array, IntArray]:
    """Times in s at which steps end, the last one of them that of the run, and their kinds."""
    begin, until = ends
    near = _SHORTEST * (until - begin)
    every = {x for at in stops.values() for x in at if begin < x < until - near}
    times = np.array([*sorted(every), until])
    kind = np.full(len(times), ON)
    for what in (HOLDS, RESTARTS):
        at = np.concatenate([[-np.inf], np.sort(np.array(stops.get(what, ()))), [np.inf]])
        after = np.searchsorted(at, times)
        kind[np.minimum(at[after] - times, times - at[after - 1]) <= near] = what
    kind[-1] = RESTARTS
    return times, kind


# A diverging iteration overflows before it is caught.
@np.errstate(over="ignore", invalid="ignore")
def integrate(
    name: str,
    radau: Radau,
    start: tuple[Array, Array],
    t: Array,
    stops: Mapping[int, Sequence[float]],
    record: Record,
    first: float = SHORT,
    scale: float = 0.0,
    pilot: bool = False,
    progress: Callable[[int, int], None] | None = None,
    judged: bool = False,
) -> Run:
    """March from t[0] to t[-1] and answer at the times that the record has.

    Returns:
        States, multipliers and torques at the samples.
    Raises:
        ConvergenceError, MotionError: With `.result` (a Run) up to the last good step.
    """
    ends, size, most = (float(t[0]), float(t[-1])), _RECORDED, _RECORDED
    if judged:
        small = radau.problem.dynamics.system.nv <= LARGE
        size, most = (TOGETHER, MOST) if small else (BACK, BACK)
    first = first * (ends[1] - ends[0])
    room = most, most + 1 if judged else 1
    march = March(name, radau, start, ends, stops, first, room, scale, pilot)
    record.start(march.now)

    def run() -> Run:
        cost = march.cost()
        dt = (march.now.t - float(t[0])) / max(cost["steps"], 1.0)
        settings: Settings = {
            "integrator": "radau", "stages": radau.method.s, "scale": march.at.scale, "dt": dt,
        }  # fmt: skip
        found = record.run(cost, settings)
        return found if march.events is None else _with_events(found, march.events)

    waiting = True  # whether the steps that are pending have yet to be recorded
    try:
        while not march.done:
            march.together(size)
            march.advance(record.resolution)
            waiting = False
            good = record.take(march.steps)
            size = min(2 * size, most) if good == len(march.steps) else BACK
            march.settle(good, record.resolution)
            waiting = True
            if progress is not None:
                progress(record.count, len(t))
    except (ConvergenceError, MotionError) as error:
        record.finish(march.steps)
        error.result = run()
        raise
    except KeyboardInterrupt:
        if waiting:
            record.finish(march.steps)
        if record.count < 2:
            raise  # nothing but the start
        raise RunInterrupted(run()) from None
    return run()


def along(
    name: str,
    radau: Radau,
    start: tuple[Array, Array],
    ends: Array,
    stops: Mapping[int, Sequence[float]],
    record: Record,
) -> Run:
    """A run in given steps: those of another run, so that the two can be subtracted.

    Steps that a run chooses for itself change with every number of its scene, and their errors with
    them: a difference of two such runs is mostly that. In the same steps, each solved to round-off,
    the states are a smooth function of the scene's numbers. A step that Newton does not solve is
    taken in pieces: one that another design does not need differs by no more than what it leaves.
    """
    radau.resolution, radau.idle, radau.iterations = 1e6, (0.0, np.inf), _PATIENT  # any coarseness
    radau.tolerance, steps = SHARP, len(ends) - 1
    run = integrate(name, radau, start, ends, {**stops, ON: ends[1:].tolist()}, record, 1.0)
    dt = float(ends[-1] - ends[0]) / steps
    settings: Settings = {**run.settings, "dt": dt, "steps": "given"}
    return replace(run, cost={**run.cost, "steps": float(steps)}, settings=settings)


def _with_events(run: Run, events: Events) -> Run:
    """A run with its contacts, and the energy that bounces took."""
    said = [event._asdict() for event in events.found]
    settings: Settings = {**run.settings, "events": said}
    if gaps := {row.name: row.gap for row in run.system.kinks.rows if row.gap is not None}:
        settings["clearances"] = gaps
    work = None if run.work is None else run.work.copy()
    if work is not None:
        work += events.works(run.t)
    return replace(run, settings=settings, work=work)


def _stuck(name: str, now: State) -> ConvergenceError:
    """Steps have become too short to go on: because the motion runs away, or for another reason."""
    fastest = float(np.max(np.abs(now.v), initial=0.0))
    if not np.isfinite(fastest) or fastest > _RUNS_AWAY:
        why, ending = "the motion runs away.", Ending.RUNS_AWAY
    else:
        why, ending = "steps get shorter without end.", Ending.STEPS_VANISH
    return ConvergenceError(
        f"{name}: t = {now.t:.6g} s: {why} {ending.value} error.result holds the run so far.",
        time=now.t, ending=ending,
    )  # fmt: skip


# States at the samples of a run, read off many steps at once.


class Record:
    """States at the samples, filled as the run goes.

    Attributes:
        t: Samples in s. count: Number of those that are there.
        resolution: Of the steps to come. ends: Times at which steps ended [s].
    """

    def __init__(self, system: System, t: Array, resolution: float) -> None:
        n = len(t)
        self.system, self.t, self.count, self.resolution = system, t, 0, resolution
        widths = system.nq, system.nv, system.nv, system.closed.n, len(system.motors), 2
        self._columns = States(*(np.zeros((n, width)) for width in widths))
        self._total, self.ends = np.zeros(2), list[float]()

    def start(self, now: State) -> None:
        """Take the first state, or begin anew."""
        for name in STATE:
            getattr(self._columns, name)[0] = getattr(now, name)
        self.count, self._total, self.ends = 1, np.zeros(2), []

    def read(self, steps: Batch) -> States:
        """States at the samples in steps that follow those taken, where `take` leaves them."""
        upto = int(np.searchsorted(self.t, steps.ends[-1], side="right"))
        t = self.t[self.count : upto]
        room = States(*(column[self.count : upto] for column in self._columns))
        if len(t):
            of, work = np.searchsorted(steps.ends, t), steps.works
            steps.samples(t, of, room)
            np.add(room.work, (self._total + np.cumsum(work, axis=0) - work)[of], out=room.work)
        return room

    def take(self, steps: Batch) -> int:
        """Record steps; the number of them that stay (here all), or ANEW: not even earlier ones."""
        if len(steps):
            self.keep(steps, len(self.read(steps).y))
        return len(steps)

    def keep(self, steps: Batch, samples: int) -> None:
        """Let steps stay, with so many samples that have been read."""
        self.count += samples
        self._total = self._total + steps.works.sum(axis=0)
        self.ends += (steps.t + steps.h).tolist()

    def finish(self, steps: Batch) -> None:
        """Record the last steps of a run that has broken off."""
        self.take(steps)

    def run(self, cost: dict[str, float], settings: Settings) -> Run:
        """The samples so far as a run."""
        y, v, a, lam, torque, work = (column[: self.count] for column in self._columns)
        return Run(self.system, self.t[: self.count], y, v, a, lam, torque, cost, settings, work)
