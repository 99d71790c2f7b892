"""The levels that march in time, ked and coupled, with a step or a resolution of one's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np

from pinflex.actuation.drive import TorqueDrive, breaks, motor_path, path_between
from pinflex.actuation.feedback import (
    MORE,
    Sampler,
    drives_motors,
    place,
    require_instants,
    require_masses,
)
from pinflex.actuation.path import MotorPath, motor_axes
from pinflex.arrays import Array
from pinflex.description.blocks.control import Control
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import SolveSpec
from pinflex.errors import DescriptionError, RunInterrupted, SceneError
from pinflex.integrators import equal_steps as coupled
from pinflex.integrators import march as collocation
from pinflex.integrators.collocation import AlphaScheme, Collocation, radau, scheme
from pinflex.integrators.corrector import after_jumps
from pinflex.integrators.march import FIRM, HOLDS, RESTARTS, STAGES, Radau, Record
from pinflex.integrators.plain import radau as plain_radau
from pinflex.integrators.problem import Problem, Run
from pinflex.levels.ked import method_of, solve_ked
from pinflex.levels.modes import default_step, modes, rings_below
from pinflex.levels.rigid import rigid_torques
from pinflex.levels.start import Start, start_from, start_of, with_speeds
from pinflex.mechanics.evaluation.compiled import require_steps, serves
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Loads
from pinflex.solver.following import following
from pinflex.solver.resume import state

Progress = Callable[[int, int], None]
# Under a digital controller its holds keep steps short, and four states go side by side. What
# Newton leaves of a step adds up over many that are shorter than errors ask for: of a ur5 at 1 kHz
# 1e-7 of the displacements made 1e-3 of the platform's deviation. Of the resolution:
_FEW_STAGES, _HELD_NEWTON, _HELD_SLOW = 4, 2e-6, 0.01
_AT_END = 1e-7  # of the run: a break so near its end is none
_SAME_INSTANT = 1e-9  # of a step: times so near are one
_SAME = 1e-9  # of the run: times nearer than this are one
_FEW = 400  # steps below which a run may be too coarse for its first mode
_PER_PERIOD = 10.0  # steps that a vibration needs at the least
_SHORT = 1e-6  # of the run: shorter steps are looked at for round-off
_NO_SPEEDS = "start speeds are those of level coupled; level ked starts with those of the motion."


@dataclass(frozen=True)
class Scene:
    """What is solved: a mechanism, its motion and its control.

    Attributes:
        mechanism, motion: As given to `solve`.
        spec: What to compute.
        control: Feedback, or None.
        tolerance: Newton's, of the alpha family; None: its own.
        before: A run to go on with, or None.
        nudge: What speeds are more at the start, by chance and always alike [rad/s | m/s].
    """

    mechanism: Mechanism
    motion: Motion
    spec: SolveSpec
    control: Control | None = None
    tolerance: float | None = None
    before: Run | None = None
    nudge: float = 0.0

    def stepped(self, t: Array, dt: float, progress: Progress | None = None) -> Run:
        """The run at equal samples t, with steps of dt (s) or the next shorter that fits.

        Steps of a dt that was asked for may be longer than the samples are apart, which then lie
        between them (`equal_steps.between`); others end at samples, and so do those of level ked.
        """
        spec = self.spec
        steps, every = self._count(t, dt)
        require_steps(self.mechanism, steps, float(t[-1]), "dt" if spec.dt else "until")
        fine = np.linspace(t[0], t[-1], steps + 1)
        if self.linear:
            if not isinstance(spec.start, str):
                raise DescriptionError(
                    f"{self.mechanism.name}: solve.start: a given state is one of level coupled. "
                    "Give a word: auto, static or straight."
                )
            close = {} if spec.tol is None else {"close": 1e-2 * spec.tol}
            fine[::every] = t  # to the last digit: there the nominal motion may be known
            run = solve_ked(
                self.mechanism, self.motion, fine, method_of(spec), spec.start,
                spec.ked == "structural", progress, every=every, **close,
            )  # fmt: skip
            run.settings["integrator"] = spec.by_steps
            if spec.start_speeds:
                run = replace(run, warnings=(*run.warnings, _NO_SPEEDS))
            return self._judged(run, fine, every)
        drive, path = self._drive(fine), motor_path(self.mechanism, self.motion, fine)
        keys: dict[str, Any] = {} if self.tolerance is None else {"tolerance": self.tolerance}
        if self.control is not None:
            keys["feedback"] = place(self.mechanism, self.control, prescribed=drive is None)
        if self.before is None:
            start = self.start
        else:
            begun = self.before.settings.get("start", "straight")
            start = Start(self.before.y[-1], self.before.v[-1], begun)
            at = every * (len(self.before.t) - 1)
            at = at or round(steps * float(self.before.t[-1] / t[-1]))
            keys["resume"] = at, state(self.before, (t[-1] - t[0]) / (len(fine) - 1))
        dynamics = Equations(self._system, marched=True)
        if self._system.added.instants:
            if self.control is not None:
                raise DescriptionError(
                    f"{self.mechanism.name}: payload: from, until: not under a continuous control. "
                    "Give the control a period."
                )
            keys["exact"] = Problem(self.mechanism, dynamics, self._path(fine), drive)
        thin = self._thin(t, every, drive is None)
        try:
            run = coupled.integrate(
                self.mechanism, dynamics, (start.y, start.v), path, self.alpha_scheme, drive,
                progress=progress, breaks=breaks(self.motion, self._loads), **keys,
            )  # fmt: skip
        except (SceneError, RunInterrupted) as stop:
            _tell(stop, start)
            if isinstance(stop, RunInterrupted):
                stop.result = _thin(stop.result, max(every, 1))
            raise
        return thin(start.told(self._judged(run, fine, every)))

    def _count(self, t: Array, dt: float) -> tuple[int, int]:
        """Number of steps up to the last of equal samples, and from one sample to the next.

        0: samples lie between steps.
        """
        end, parts = float(t[-1] - t[0]), len(t) - 1
        every = max(1, int(min(np.ceil(end / dt / parts - 1e-9), 1e12)))
        steps = max(1, int(np.ceil(min(end / dt, 1e12) - 1e-9)))
        if self.spec.dt is None or self.linear or every > 1 or steps >= parts:
            return every * parts, every
        done = 0.0 if self.before is None else steps * float(self.before.t[-1]) / end
        return (steps, 0) if abs(done - round(done)) < _SAME_INSTANT * steps else (parts, 1)

    def _thin(self, t: Array, every: int, prescribed: bool) -> Callable[[Run], Run]:
        """A run at its samples."""
        if every:
            return lambda run: _thin(run, every)

        def between(run: Run) -> Run:
            asked = t if self.before is None else t[len(self.before.t) - 1 :]
            path = motor_path(self.mechanism, self.motion, asked) if prescribed else None
            led = None if path is None else (motor_axes(self.mechanism), path)
            found = coupled.between(run, asked, led)
            h, off = float(run.t[1] - run.t[0]), found.settings["interpolated"]
            text = (
                f"samples lie between steps of {h:.3g} s, where torques are interpolated to about "
                f"{off:.2g}, against a largest of {np.abs(run.torque).max(initial=0.0):.2g} in all."
            )
            return replace(found, warnings=(*found.warnings, text))

        return between

    def _judged(self, run: Run, steps: Array, every: int) -> Run:
        """The run with what its step alone tells: samples that cut it, too long, round-off."""
        dt, h, words = self.spec.dt, float(steps[1] - steps[0]), []
        if dt is not None and every == 1 and h < 0.99 * dt:
            words.append(
                f"dt = {dt:g} s was cut to {h:.3g} s, as every sample takes a step. Ask for fewer "
                "samples."
            )
        followed = 1.0 / (_PER_PERIOD * h)  # the highest frequency, Hz
        if len(steps) < _FEW and run.system.n_eta and not rings_below(self.mechanism, followed):
            first = modes(self.mechanism, count=9, preload="none").frequencies
            period = 1.0 / float(np.min(first[first > 0], initial=np.inf))
            if h > period / _PER_PERIOD:
                words.append(
                    f"steps of {h:.3g} s are long for the first natural period of {period:.3g} s: "
                    f"vibration is lost or shifted. Take dt = {period / 40:.2g}, or a tol."
                )
        noise = self._round_off(run, h)
        largest = float(np.max(np.abs(run.torque), initial=0.0))
        if noise > 1e-2 * largest and noise > 1e-12:
            words.append(
                f"steps of {h:.3g} s are so short that torques carry round-off of about "
                f"{noise:.2g} (positions over dt^2), against a largest of {largest:.2g} in all. "
                f"Take dt above {h * (noise / (1e-3 * largest)) ** 0.5:.1g} s."
            )
        return replace(run, warnings=(*run.warnings, *words)) if words else run

    def _round_off(self, run: Run, h: float) -> float:
        """What rounding of positions makes of motor torques [N m | N]: inertia eps |y| / h^2."""
        rows = run.system.motors
        if not len(rows) or (h > _SHORT * float(run.t[-1]) and h > 1e-6):
            return 0.0
        M = np.abs(Equations(run.system).mass(run.y[-1])[rows])
        size = float(np.max(np.abs(run.y)))
        return float(np.finfo(float).eps * size / h**2 * np.max(M.sum(axis=1)))

    def resolved(
        self,
        t: Array,
        resolution: float,
        progress: Progress | None = None,
        coarser: Run | None = None,
        pilot: bool = False,
    ) -> Run:
        """The run at samples t in steps that follow the motion, on the kernel.

        A coarser run tells how far the mechanism moves in all, and how many steps a hold of a
        digital controller took: now it takes more. A pilot is the first of them.
        """
        scale, taken = 0.0, 0.0
        if coarser is not None:
            scale, taken = coarser.settings["scale"], coarser.cost["steps"]
        first = collocation.SHORT if scale > 0.0 else collocation.LONG
        record = Record(self._system, t, resolution)
        return self.kept(t, resolution, lambda _: record, first, scale, progress, pilot, taken)

    def kept(
        self,
        t: Array,
        resolution: float,
        keeper: Callable[[Radau], Record],
        first: float,
        scale: float,
        progress: Progress | None = None,
        pilot: bool = False,
        taken: float = 0.0,
        judge: Equations | None = None,
    ) -> Run:
        """The run at samples t as a keeper of its steps has it, on the kernel."""

        def march(problem: Problem) -> Run:
            steps, instants = self._radau(problem, resolution), _instants(problem, t[-1], taken)
            stops = {RESTARTS: breaks(self.motion, self._loads), HOLDS: instants}
            return collocation.integrate(
                self.mechanism.name, steps, self._begun, t, stops, keeper(steps), first, scale,
                pilot, progress, judge is not None,
            )  # fmt: skip

        return self._marched(t, march, judge)

    def along(self, t: Array, ends: Array) -> Run:
        """The run at samples t in given steps."""

        def march(problem: Problem) -> Run:
            name, begun = self.mechanism.name, self._begun
            jumps, instants = breaks(self.motion, self._loads), _instants(problem, ends[-1])
            if self.on_kernel:
                grid, stops = np.append(t[0], ends), {RESTARTS: jumps, HOLDS: instants}
                record = Record(self._system, t, 0.0)
                steps = self._radau(problem, 1.0)
                return collocation.along(name, steps, begun, grid, stops, record)
            inside = np.array([x for x in (*jumps, *instants) if t[0] < x < ends[-1]])
            every, anew = _with(ends, inside), np.array(jumps)
            run = plain_radau.integrate(name, problem, self._few, begun, t, every, anew)
            return replace(run, settings={**run.settings, "steps": "given"})

        return self._marched(t, march)

    def plainly(self, t: Array, dt: float, progress: Progress | None = None) -> Run:
        """The run at samples t in steps of dt (s) at the most, without the kernel."""

        def march(problem: Problem) -> Run:
            begin, end = float(t[0]), float(t[-1])
            jumps = breaks(self.motion, self._loads)
            every = {*jumps, *_instants(problem, end)}
            inside = sorted(x for x in every if begin < x < end * (1.0 - _AT_END))
            steps = _cut(np.array([begin, *inside, end]), dt)
            return plain_radau.integrate(
                self.mechanism.name, problem, self._few, self._begun, t, steps, np.array(jumps),
                progress,
            )  # fmt: skip

        return self._marched(t, march)

    def paced(self, t: Array, resolution: float) -> Array:
        """Ends of the steps that a run at samples t chooses, firmly solved [s]."""
        if not self.on_kernel:
            marks = [x for x in breaks(self.motion, self._loads) if x < t[-1] * (1.0 - _AT_END)]
            return _cut(np.array([t[0], *marks, t[-1]]), default_step(self.mechanism, float(t[-1])))
        record = Record(self._system, t, resolution)

        def keeper(steps: Radau) -> Record:
            steps.tolerance = FIRM
            return record

        self.kept(t, resolution, keeper, collocation.SHORT, 0.0)
        return np.array(record.ends)

    @property
    def on_kernel(self) -> bool:
        """Whether the kernel takes the steps; else they are plain ones, in Python."""
        return serves(self._system, marched=True)

    def equations(self) -> Equations:
        """The equations of what moves."""
        return Equations(self._system, marched=True)

    def _marched(
        self, t: Array, march: Callable[[Problem], Run], dynamics: Equations | None = None
    ) -> Run:
        """The run of a problem up to the last sample, with what its start and control tell."""
        start, problem = self.start, self._problem(t, dynamics or self.equations())
        try:
            run = march(problem)
        except (SceneError, RunInterrupted) as stop:
            _tell(stop, start)
            raise
        run = problem.told(run, self.mechanism, self.spec)
        return start.told(after_jumps(problem, run, breaks(self.motion, self._loads)))

    def _problem(self, t: Array, dynamics: Equations) -> Problem:
        """What a run solves, with the digital controller that acts in it."""
        drive, sampler = self._drive(t), None
        if self.sampled:
            sampler, drive = self._sampler(dynamics, drive, float(t[-1]))
        return Problem(self.mechanism, dynamics, self._path(t), drive, sampler)

    def _radau(self, problem: Problem, resolution: float) -> Radau:
        method = self._few if self.sampled else self._method(STAGES)
        steps = Radau(problem, method, self.by_forces)
        if self.sampled:
            part = max(_HELD_NEWTON * resolution, FIRM.relative)
            steps.tolerance, steps.slow = FIRM._replace(relative=part), _HELD_SLOW
        return steps

    @property
    def _few(self) -> Collocation:
        return self._method(_FEW_STAGES)

    def _method(self, stages: int) -> Collocation:
        given = self.spec.method
        return given if isinstance(given, Collocation) else radau(stages)

    @property
    def _begun(self) -> tuple[Array, Array]:
        return self.start.y, self.start.v

    @property
    def _loads(self) -> Loads:
        loads: Loads = self._system.loads
        return loads

    @property
    def by_forces(self) -> bool:
        """Whether forces are asked for."""
        return not self.spec.asked or "torque" in self.spec.asked

    @property
    def sticks(self) -> bool:
        """Whether dry friction may bring joints to rest."""
        return self.mechanism.flexible.sticks(self.spec.drive == "prescribed")

    @property
    def bends(self) -> bool:
        """Whether laws of pieces act: steps end where they bend."""
        return not self.linear and bool(self._system.kinks.rows)

    @property
    def sampled(self) -> bool:
        """Whether a digital controller acts: its steps end at its instants."""
        return self.control is not None and self.control.period is not None

    @property
    def linear(self) -> bool:
        """Whether the deviation from the rigid motion is linear: level ked, in equal steps."""
        return self.spec.level == "ked"

    @property
    def alpha_scheme(self) -> AlphaScheme:
        """The integrator of equal steps."""
        if isinstance(self.spec.method, AlphaScheme):
            return replace(self.spec.method, name=self.spec.by_steps)
        rho = 0.8 if self.spec.rho_inf is None else self.spec.rho_inf
        return scheme(self.spec.by_steps, rho, self.spec.newmark)

    @property
    def _system(self) -> Any:
        return self.mechanism.rigid if self.spec.level == "rigid" else self.mechanism.loose

    def _path(self, t: Array) -> Callable[[Array], MotorPath]:
        return path_between(self.mechanism, self.motion, float(t[0]), float(t[-1]))

    @cached_property
    def start(self) -> Start:
        """Found once, however often the scene is run, and kept with its mechanism."""
        if self.nudge:
            return self._nudged(replace(self, nudge=0.0).start)
        if not isinstance(self.spec.start, str):
            return self._found_start()
        spec, starts = self.spec, self.mechanism.followed.starts
        asked = spec.level == "rigid", spec.start, spec.drive, spec.start_speeds
        return starts.get(self.motion, asked, self._found_start)

    def _nudged(self, start: Start) -> Start:
        """A start with other speeds, as loops and motors let them."""
        system = self._system
        J = Equations(system).close(start.y).J[:, system.free]
        push = self.nudge * np.random.default_rng(0).standard_normal(len(system.free))
        v = start.v.copy()
        v[system.free] += push - np.linalg.pinv(J) @ (J @ push) if len(J) else push
        return replace(start, v=v)

    def _found_start(self) -> Start:
        dynamics = Equations(self._system, marched=self.spec.level == "coupled")
        path = motor_path(self.mechanism, self.motion, np.zeros(1))
        driven = self.spec.drive == "torque"
        if isinstance(self.spec.start, str):
            start = start_of(self.mechanism, self.motion, path, dynamics, self.spec.start)
        else:
            start = start_from(self.mechanism, dynamics, path, self.spec.start, driven)
        v = with_speeds(self.mechanism, dynamics, start.y, start.v, self.spec.start_speeds, driven)
        return replace(start, v=v)

    @cached_property
    def _torques(self) -> Callable[[float, float], Callable[[Array], Array]]:
        """Rigid torques of the motors between two times (s), found once."""
        return cache(partial(rigid_torques, self.mechanism, self.motion))

    @cached_property
    def _silenced(self) -> Callable[..., Callable[[Array], Array]]:
        """Torques without those of some motors, the same function every time."""
        return cache(lambda torques, own: lambda t: np.where(own, 0.0, torques(t)))

    @cached_property
    def _following(self) -> Callable[[float], Control]:
        """The digital controller of a run up to an end (s), found once."""
        assert self.control is not None
        given = self.mechanism, self.motion, self.control
        return cache(partial(following, *given, torques=self._torques))

    def _sampler(
        self, dynamics: Equations, drive: TorqueDrive | None, end: float
    ) -> tuple[Sampler, TorqueDrive | None]:
        """The digital controller of a run up to `end` (s), and the drive that it commands."""
        control = self.control
        assert control is not None
        require_instants(self.mechanism, control, end)
        control = self._following(end)
        feedback = place(self.mechanism, control, prescribed=drive is None)
        rows = self._system.free if drive is None else self._system.unheld
        require_masses(self.mechanism, feedback, dynamics, self.start.y, rows)
        sampler = Sampler(self.mechanism, feedback, dynamics, drive is not None)
        if drive is not None and drives_motors(self.mechanism, control):
            # motors that it does not drive keep the drive they have
            own, kp, kd, rest = sampler.driven, drive.kp, drive.kd, drive.forward
            silent = self._silenced(rest, tuple(own.tolist()))
            feed = drive.feed_forward
            drive = TorqueDrive(np.where(own, 0.0, kp), np.where(own, 0.0, kd), feed, silent)
        return sampler, drive

    def _drive(self, t: Array) -> TorqueDrive | None:
        if self.spec.drive != "torque":
            return None
        count = len(self.mechanism.rigid.motors)
        forward = self._torques(float(t[0]), float(t[-1]))
        kp, kd = np.full(count, self.spec.kp), np.full(count, self.spec.kd)
        return TorqueDrive(kp, kd, forward(t), forward)


def _tell(stop: SceneError | RunInterrupted, start: Start) -> None:
    if isinstance(stop.result, Run):
        stop.result = start.told(stop.result)


def _instants(problem: Problem, end: float, taken: float = 0.0) -> tuple[float, ...]:
    """Times before `end` at which a digital controller acts, and cuts of the times between [s].

    `taken`: steps of a coarser run.
    """
    if problem.sampler is None:
        return ()
    found = problem.sampler.instants(float(end))
    parts = round(MORE * taken / len(found))
    return found if parts < 2 else problem.sampler.instants(float(end), parts)


def _with(ends: Array, corners: Array) -> Array:
    """Ends of steps, and corners [s]; one of each where these are as good as equal."""
    near = _SAME * float(ends[-1])
    apart = np.abs(ends[:, None] - corners).min(axis=1, initial=np.inf) > near
    return np.sort(np.concatenate([ends[apart], corners]))


def _cut(marks: Array, dt: float) -> Array:
    """Ends of equal steps of dt at the most between marks [s]."""
    pairs = pairwise(marks.tolist())
    pieces = [np.linspace(a, b, 1 + int(np.ceil((b - a) / dt - 1e-9)))[1:] for a, b in pairs]
    return np.concatenate(pieces)


def _thin(run: Run, every: int) -> Run:
    """Every k-th step of a run."""
    return run if every == 1 else run.at(slice(None, None, every))
