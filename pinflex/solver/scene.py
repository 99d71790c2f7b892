"""The levels that march in time, ked and coupled, with a step or a resolution of one's own."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive, breaks, motor_path, path_between
from pinflex.actuation.feedback import place
from pinflex.actuation.sampler import Sampler, drives_motors, require_instants
from pinflex.arrays import Array
from pinflex.description.control import Control
from pinflex.description.motion import Motion
from pinflex.description.solve import SolveSpec
from pinflex.errors import DescriptionError, RunInterrupted, SceneError
from pinflex.integrators import equal_steps as coupled
from pinflex.integrators import march as adaptive
from pinflex.integrators.collocation import Collocation, radau
from pinflex.integrators.given_steps import along
from pinflex.integrators.radau import FIRM, STAGES, Stages
from pinflex.integrators.record import Record
from pinflex.integrators.run import Run
from pinflex.integrators.schemes import AlphaScheme, scheme
from pinflex.levels.given_start import start_from
from pinflex.levels.ked import method_of, solve_ked
from pinflex.levels.modes import modes
from pinflex.levels.speeds import with_speeds
from pinflex.levels.start import Start, start_of
from pinflex.mechanics.cost import require_steps
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.lending import lent
from pinflex.mechanics.mechanism import Mechanism
from pinflex.solver.following import following, rigid_torques
from pinflex.solver.resume import state

Progress = Callable[[int, int], None]
# Under a digital controller its holds keep steps short, and four states go side by side. What
# Newton leaves of a step adds up over many that are shorter than errors ask for: of a ur5 at 1 kHz
# 1e-7 of the displacements made 1e-3 of the platform's deviation. Of the resolution:
_HELD_STAGES, _HELD_NEWTON = 4, 2e-6
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
    """

    mechanism: Mechanism
    motion: Motion
    spec: SolveSpec
    control: Control | None = None
    tolerance: float | None = None
    before: Run | None = None

    def stepped(self, t: Array, dt: float, progress: Progress | None = None) -> Run:
        """The run at equal samples t, with steps of dt (s) or the next shorter that fits.

        Args:
            t: Samples [s], shape (nt,), at equal distances.
            dt: Largest step [s].
            progress: Called with (step, steps).
        """
        spec, samples = self.spec, len(t)
        every = max(1, int(min(np.ceil((t[-1] - t[0]) / dt / (samples - 1) - 1e-9), 1e12)))
        steps = every * (samples - 1)
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
            start = self._start
        else:
            begun = str(self.before.settings.get("start", "straight"))
            start = Start(self.before.y[-1], self.before.v[-1], begun)
            at = every * (len(self.before.t) - 1)
            keys["resume"] = at, state(self.before, (t[-1] - t[0]) / (len(fine) - 1))
        # takes the workspace that the start has given back
        dynamics = Equations(self._system, marched=True)
        try:
            run = coupled.integrate(
                self.mechanism, dynamics, (start.y, start.v), path, self._scheme, drive,
                progress=progress, **keys,
            )  # fmt: skip
        except (SceneError, RunInterrupted) as stop:
            _tell(stop, start)
            if isinstance(stop, RunInterrupted):
                stop.result = _thin(stop.result, every)
            raise
        return _thin(start.told(self._judged(run, fine, every)), every)

    def _judged(self, run: Run, steps: Array, every: int) -> Run:
        """The run with what its step alone tells: samples that cut it, too long, round-off."""
        dt, h, words = self.spec.dt, float(steps[1] - steps[0]), []
        if dt is not None and every == 1 and h < 0.99 * dt:
            words.append(
                f"dt = {dt:g} s was cut to {h:.3g} s, as every sample takes a step. Ask for fewer "
                "samples."
            )
        if len(steps) < _FEW and run.system.n_eta:
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
        finer: int = 0,
    ) -> Run:
        """The run at samples t in steps that follow the motion; see `adaptive.integrate`.

        A coarser run tells how far the mechanism moves in all; a pilot is the first of them.

        Args:
            t: Samples [s], shape (nt,).
            resolution: Local error of a step, relative.
            progress: Called with (step, steps).
            coarser: A run at a coarser resolution.
            pilot: Whether a short run finds the scale first.
            finer: How often a run under a digital controller was refined before.
        """
        scale = 0.0 if coarser is None else float(str(coarser.settings["scale"]))
        first = adaptive.SHORT if scale > 0.0 else adaptive.LONG
        return self.kept(
            t, resolution, lambda steps: Record(steps, t, resolution), first, scale, progress,
            pilot, finer=finer,
        )  # fmt: skip

    def kept(
        self,
        t: Array,
        resolution: float,
        keeper: Callable[[Any], adaptive.Keeper],
        first: float,
        scale: float,
        progress: Progress | None = None,
        pilot: bool = False,
        dynamics: Equations | None = None,
        ends: Array | None = None,
        finer: int = 0,
    ) -> Run:
        """The run at samples t as a keeper of its steps has it; see `adaptive.integrate`.

        Args:
            t: Samples in s.
            resolution: Of the first steps.
            keeper: From the steps, what they are kept by.
            first, scale, progress, pilot: As `adaptive.integrate` has them.
            dynamics: A workspace of what moves; None: one of its own.
            ends: Of the steps in s, where these are given; then they are not judged.
            finer: As `resolved` has it.
        """
        if dynamics is None:
            given = (t, resolution, keeper, first, scale, progress, pilot)
            with self.equations() as own:
                return self.kept(*given, own, ends, finer)
        start = self._start
        stops = breaks(self.motion, dynamics.system.loads)
        steps, sampler = self._stages(t, dynamics, resolution)
        instants = () if sampler is None else sampler.instants(float(t[-1]), 2**finer)
        name, begun = self.mechanism.name, (start.y, start.v)
        try:
            if ends is not None:
                run = along(name, steps, begun, t, (*stops, *instants), ends, keeper(steps))
            else:
                run = adaptive.integrate(
                    name, steps, begun, t, stops, keeper(steps), first, scale, pilot, progress,
                    instants,
                )  # fmt: skip
        except (SceneError, RunInterrupted) as stop:
            _tell(stop, start)
            raise
        if sampler is not None:
            run = replace(run, signals=sampler.signals(run.t, run.y))
        return start.told(run)

    def equations(self) -> AbstractContextManager[Equations]:
        """A workspace of what moves, lent: the one that finding the start has given back."""
        assert self._start is not None
        return lent(self._system, marched=True)

    def _stages(
        self, t: Array, dynamics: Equations, resolution: float
    ) -> tuple[Stages, Sampler | None]:
        """The stages of a run, and the digital controller that acts in it."""
        drive, sampler = self._drive(t), None
        if self.sampled:
            sampler, drive = self._sampler(dynamics, drive, float(t[-1]))
        given = self.spec.method
        few = _HELD_STAGES if self.sampled else STAGES
        tableau = given if isinstance(given, Collocation) else radau(few)
        stages = Stages(
            self.mechanism, dynamics, self._path(t), resolution, tableau, drive, self.by_forces,
            sampler,
        )  # fmt: skip
        if self.sampled:
            part = max(_HELD_NEWTON * resolution, FIRM.part)
            stages.closeness = FIRM._replace(part=part)
        return stages, sampler

    @property
    def by_forces(self) -> bool:
        """Whether forces are asked for."""
        return not self.spec.asked or "torque" in self.spec.asked

    @property
    def sticks(self) -> bool:
        """Whether dry friction may bring joints to rest."""
        return self.mechanism.flexible.sticks(self.spec.drive == "prescribed")

    @property
    def sampled(self) -> bool:
        """Whether a digital controller acts: its steps end at its instants."""
        return self.control is not None and self.control.period is not None

    @property
    def linear(self) -> bool:
        """Whether the deviation from the rigid motion is linear: level ked, in equal steps."""
        return self.spec.level == "ked"

    @property
    def _scheme(self) -> AlphaScheme:
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
    def _start(self) -> Start:
        """Found once, however often the scene is run."""
        dynamics = Equations(self._system)
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


def _thin(run: Run, every: int) -> Run:
    """Every k-th step of a run."""
    return run if every == 1 else run.at(slice(None, None, every))
