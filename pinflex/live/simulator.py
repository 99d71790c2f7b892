"""A robot in the loop: one step at a time, at a cost that is known before it is taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.actuation.drive import averaged, motor_path
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion, formula, hold
from pinflex.description.reading.schema import shown
from pinflex.errors import ConvergenceError, DescriptionError, MotionError, SceneError, nearest
from pinflex.integrators.collocation import AlphaScheme
from pinflex.integrators.plain.alpha import MAX_ITERATIONS
from pinflex.integrators.problem import Run, Settings, StepFailed
from pinflex.live.engine import Bounds, Engine
from pinflex.live.sensors import FrameNow, LinkNow, Log, Motors, Sensor, Snapshot, number, placed
from pinflex.mechanics.closing import limits_of
from pinflex.mechanics.evaluation.compiled import evaluated_by
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import motion_of
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.loads import require_staying
from pinflex.mechanics.model.tree import model_of
from pinflex.recovery.recover import result_of
from pinflex.results.result import Result
from pinflex.solver.scene import Scene
from pinflex.solver.solve import rigid_reference

Numbers = npt.ArrayLike
_TWO = (
    "Make one simulator with it and one without, and go on in the other with reset(start=(y, v))."
)
_MOST = 1_000_000  # iterations, tangents, steps between two: more than any run has


class Simulator:
    """The full equations of level coupled in equal steps, one at each call of `step`.

        arm = pf.Simulator("ur5", dt=1e-3)
        arm.reset()
        while arm.time < 1.0:
            arm.step(torque=controller(arm.motors.position))

    Steps are those of `pf.solve(dt=)`. Each is one call of compiled code that allocates nothing,
    of `iterations` Newton iterations and `tangents` tangents at the most: one that would need more
    raises, and the simulator stays where it was. A control or a drive of the YAML does not act:
    what moves the motors comes from outside.

    Source: Arnold and Bruels (2007), the generalized alpha method of Lie groups and constraints.

    Args:
        robot: A mechanism, or what `pf.load` takes.
        dt: Step [s].
        integrator: Such as pf.newmark(); default: pf.generalized_alpha() with the YAML's rho_inf.
        iterations: Of Newton's method in a step, at the most.
        tangents: New ones in a step, at the most; most are then made ahead of need, evaluated
            behind two steps and factored behind the next. None: as many as it takes, as `pf.solve`.
        every: Steps between two tangents, at the most; None: one as soon as iterations are slow.
        stops: Whether a motor that would pass a position limit of the URDF ends the step.
        sensors: By name, see `pf.Encoder`, `pf.StrainGauge` and `pf.Imu`.
    Raises:
        DescriptionError: An argument that is none, or a model that the compiled kernel does not
            cover.
    """

    @public
    def __init__(
        self,
        robot: Mechanism,
        dt: float = 1e-3,
        *,
        integrator: AlphaScheme | None = None,
        iterations: int = MAX_ITERATIONS,
        tangents: int | None = 1,
        every: int | None = None,
        stops: bool = True,
        sensors: Mapping[str, Sensor] | None = None,
    ) -> None:
        """At home, as after `reset()`."""
        mechanism = self.mechanism = takes_model(lambda robot: robot)(robot)
        where = f"{mechanism.name}: Simulator"
        _require(where, dt, integrator, iterations=iterations, tangents=tangents, every=every)
        require_staying(mechanism.description, "Simulator", _TWO)
        self.dt, self._system = float(dt), mechanism.loose
        self._dynamics = Equations(self._system.in_steps(dt), marched=True)
        if not self._dynamics.on_kernel or self._dynamics.compiled is None:
            by = evaluated_by(self._system, True)
            raise DescriptionError(
                f"{where}: its steps are compiled; this model has {by}. Use pf.solve."
            )
        self._compiled = self._dynamics.compiled
        self._axes, self._motors = motor_axes(mechanism), self._system.motors
        spec = mechanism.description.solve
        own: Any = spec.integrator if spec.integrator in ("newmark", "hht") else None
        self._spec = replace(
            spec, level="coupled", dt=self.dt, tol=None, until=None, drive="prescribed",
            integrator=integrator or own,
        )  # fmt: skip
        limits = _stops(mechanism) if stops else None
        self._bounds = Bounds(iterations, tangents or 0, every or 0, limits)
        self._engines: dict[bool, Engine] = {}
        self._timed = self._system.loads.timed
        self._sensors = {
            name: placed(mechanism, name, each) for name, each in (sensors or {}).items()
        }
        self._log: Log | None = None
        self.reset()

    @public
    def reset(
        self,
        pose: Mapping[str, float] | None = None,
        start: object = None,
        motion: Motion | None = None,
    ) -> Simulator:
        """Go to a pose at rest, or to where a motion begins, at time 0; a record ends.

        Args:
            pose: Position by motor [rad | m]; motors that are left out stand at home.
            start: As of `pf.solve`: auto, static or straight, a run of level coupled, or (y, v);
                default: that of the YAML.
            motion: Instead of a pose: begin as `pf.solve` begins with this motion.
        Raises:
            DescriptionError, SceneError: No such pose, no equilibrium there, or no step from there;
                the simulator stays where it was.
        """
        scene = self._scene(pose, start, motion)
        found, before = scene.start, self.snapshot() if self._engines else None
        path = motor_path(self.mechanism, scene.motion, np.array([0.0, self.dt]))
        engine = self._made(True)
        for name in ("position", "velocity", "acceleration"):
            getattr(engine.path, name)[...] = getattr(path, name)
        try:
            engine.begin(0.0, engine.march.first(found.y, found.v, 0), True)
        except (StepFailed, np.linalg.LinAlgError):
            error = self._stuck(engine, self.dt)
            self._stay(before)
            raise error from None
        self._steps, self._at, self._log = 0, engine, None
        self.start = found.kind
        return self

    def __repr__(self) -> str:
        kind = "led" if self._at is self._engines.get(True) else "pushed"
        name = self.mechanism.name[:60]
        return f"Simulator({name}, t = {self.time:.6g} s, dt = {self.dt:g} s, motors {kind})"

    def _scene(
        self, pose: Mapping[str, float] | None, start: object, motion: Motion | None
    ) -> Scene:
        where, names = f"{self.mechanism.name}: reset", self.mechanism.motors
        if motion is not None and pose is not None:
            raise DescriptionError(f"{where}: pose and motion: give one.")
        if not isinstance(motion, Motion | None) or not isinstance(pose, Mapping | None):
            raise DescriptionError(
                f"{where}: give a pose, positions by motor, or a motion, such as pf.quintic(...)."
            )
        given = dict(pose or {})
        for name, value in given.items():
            if name not in names:
                raise DescriptionError(
                    f"{self.mechanism.name}: pose: {name}: not a motor.{nearest(name, names)}"
                )
            if not np.isfinite(number(value)):
                raise DescriptionError(
                    f"{self.mechanism.name}: pose: {name}: {shown(value)}. Give a finite position "
                    "in rad or m."
                )
        if given:
            home = dict(zip(names, self._axes.read(self.mechanism.home), strict=True))
            text = {
                name: np.format_float_positional(number(x), unique=True)
                for name, x in (home | given).items()
            }
            motion = formula(joints=text, duration=1.0, absolute=True)
        begun = hold(duration=1.0) if motion is None else motion
        spec = self._spec if start is None else replace(self._spec, start=start)
        return Scene(self.mechanism, begun, spec)

    def _made(self, led: bool) -> Engine:
        if led not in self._engines:
            scheme = Scene(self.mechanism, hold(duration=1.0), self._spec).alpha_scheme
            given = self.mechanism, self._dynamics, scheme, self.dt, led, self._bounds
            self._engines[led] = Engine(*given)
        return self._engines[led]

    # Steps -----------------------------------------------------------------------------------

    def step(
        self,
        torque: Numbers | None = None,
        motion: Motion | tuple[Numbers, Numbers, Numbers] | None = None,
    ) -> Simulator:
        """One step of dt, with motors that push or that follow a motion.

        Args:
            torque: Of the motors at the end of the step [N m | N], shape (nm,).
            motion: Instead: their position, velocity and acceleration at its end, shape (nm,)
                each; or a Motion, which is asked for the time at its end. In the step around a
                jump of its acceleration the torque found is a mean of those beside it.
        Raises:
            DescriptionError: Numbers that are none, or not as many as motors.
            MotionError: A motor would pass a stop of its joint.
            ConvergenceError: The step is not solved within the bounds on its cost. In all these
                cases the simulator stays where it was.
        """
        t = (self._steps + 1) * self.dt
        if (torque is None) == (motion is None) and len(self._motors):
            raise DescriptionError(
                f"{self.mechanism.name}: step: give torque= or motion=, one of them."
            )
        told = self._numbers("torque", torque) if torque is not None else self._led(motion, t)
        before = self._before(torque is None)
        engine = self._engine(torque is None, told)
        if torque is not None:
            engine.torque[1] = told
        else:
            engine.path.position[1], engine.path.velocity[1], engine.path.acceleration[1] = told
        if self._timed:
            engine.shares(t)
        try:
            if not engine.take():
                raise self._stuck(engine, t)
            if self._system.closed.contacts:
                self._dynamics.require_on_beams(engine.found[0][1], self.mechanism.name, t)
        except SceneError:
            self._stay(before)
            raise
        self._steps += 1
        if self._log is not None:
            self._log.keep(self._steps, self.time, engine.found)
        return self

    def _before(self, led: bool) -> Snapshot | None:
        """What to go back to where the compiled step alone does not stay where it was."""
        switches = self._at is not self._engines.get(led)
        return self.snapshot() if switches or self._system.closed.contacts else None

    def _stay(self, before: Snapshot | None) -> None:
        """Be where it was; a record goes on."""
        if before is not None:
            log = self._log
            self.restore(before)
            self._log = log

    def _numbers(self, what: str, given: Numbers) -> Array:
        """As many finite numbers as there are motors."""
        try:
            found = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            found = np.full((), np.nan)
        n = len(self._motors)
        if found.shape != (n,):
            raise DescriptionError(
                f"{self.mechanism.name}: step: {what}: shape {found.shape}. Give {n} numbers, of "
                f"{', '.join(self.mechanism.motors) or 'no motor'}."
            )
        if not np.isfinite(found).all():
            name = self.mechanism.motors[int(np.argmin(np.isfinite(found)))]
            raise DescriptionError(
                f"{self.mechanism.name}: step: {what}: not a finite number for {name}."
            )
        return found

    def _led(self, motion: object, t: float) -> Sequence[Array]:
        if motion is None:
            return [np.zeros(0)] * 3
        if isinstance(motion, Motion):
            path = motor_path(self.mechanism, motion, np.array([t]))
            felt = self._felt(motion, t, path.acceleration[0])
            return path.position[0], path.velocity[0], felt
        if not isinstance(motion, tuple | list) or len(motion) != 3:
            raise DescriptionError(
                f"{self.mechanism.name}: step: motion: give (position, velocity, acceleration) of "
                "the motors, or a Motion."
            )
        names = ("position", "velocity", "acceleration")
        return [self._numbers(f"motion: {n}", x) for n, x in zip(names, motion, strict=True)]

    def _felt(self, motion: Motion, t: float, a: Array) -> Array:
        """Accelerations of the motors at t (s), `a` but beside a jump: as `pf.solve` has them."""
        jumps = [switch for switch in motion.switches if abs(switch - t) <= 0.5 * self.dt]
        if not jumps or t < 3.0 * self.dt:
            return a
        around = t + self.dt * np.arange(-3.0, 4.0)
        values = motor_path(self.mechanism, motion, around).acceleration
        return np.asarray(averaged(around, values, jumps)[0][3])

    def _engine(self, led: bool, torque: Array | Sequence[Array]) -> Engine:
        """Its steps with motors led or pushed, going on from where the simulator is.

        What begins to push acts at once: accelerations and multipliers jump there.
        """
        engine = self._made(led)
        if engine is self._at:
            return engine
        now = self._at.kept()
        at = self._axes.read(now.y), now.v[self._motors], now.a[self._motors]
        engine.path.position[:], engine.path.velocity[:], engine.path.acceleration[:] = at
        try:
            if not led:
                engine.torque[:] = torque
                now = engine.march.first(now.y, now.v, 0)
            engine.begin(self.time, now, not led)
        except (StepFailed, np.linalg.LinAlgError):
            raise self._stuck(engine, self.time + self.dt) from None
        self._at = engine
        return engine

    def _stuck(self, engine: Engine, t: float) -> SceneError:
        """Why a step was not taken, in a sentence."""
        where, stopped = f"{self.mechanism.name}: t = {t:.6g} s", engine.stopped
        if stopped >= 0 and self._bounds.stops is not None:
            name = self.mechanism.motors[stopped]
            low, high = (float(x[stopped]) for x in self._bounds.stops)
            return MotionError(
                f"{where}: {name} would pass its stop at {low:g} or {high:g} (rad or m).", time=t
            )
        return ConvergenceError(
            f"{where}: no step of {self.dt:g} s within {self._bounds.iterations} iterations and "
            f"{self._bounds.tangents or 'any number of'} tangents: the input jumps too far, or the "
            "step is too large.",
            time=t,
        )

    # What is there -----------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time [s]."""
        return self._steps * self.dt

    @property
    def y(self) -> Array:
        """Coordinates of joints and links, shape (nq,)."""
        return np.array(self._at.found[0][1])

    @property
    def v(self) -> Array:
        """Their rates, shape (nv,)."""
        return np.array(self._at.found[1][1])

    @property
    def motors(self) -> Motors:
        """Position, velocity, acceleration and torque of the motors."""
        y, v, a, _, _, torque, _ = (column[1] for column in self._at.found)
        rows = self._motors
        return Motors(self._axes.read(y), v[rows], a[rows], torque.copy())

    @property
    def energy(self) -> Mapping[str, float]:
        """Kinetic energy, and that of weight, links and springs, by name [J]."""
        y, v = self._at.found[0][1:], self._at.found[1][1:]
        found = self._compiled.energies(y, v, np.array([self.time]))
        return {name: float(x[0]) for name, x in found._asdict().items()}

    @property
    def cost(self) -> Mapping[str, int]:
        """Steps, Newton iterations and tangents since the motors were last led or pushed anew."""
        at = self._at.march.at
        return {"steps": self._steps, "newton": at.iterations, "tangents": at.refreshed}

    @public
    def frame(self, name: str) -> FrameNow:
        """A frame of the robot: pose, velocity and acceleration.

        Args:
            name: Of a link frame, as in `robot.frames`.
        Raises:
            DescriptionError: No such frame.
        """
        place = self.mechanism.frame(name)
        y, v, a = (column[1:] for column in self._at.found[:3])
        poses, rates = self._compiled.motions(y, v, a, [place.joint])
        position, rotation, v, a = motion_of(poses[0], rates[0], place.placement)
        return FrameNow(position[0], rotation[0], v[0], a[0])

    @public
    def link(self, name: str) -> LinkNow:
        """A flexible link: deflection, strain and stress, recovered as those of a result.

        Args:
            name: Of a flexible link.
        Raises:
            DescriptionError: No such link.
        """
        part = self.mechanism.parts.get(name)
        if part is None:
            raise DescriptionError(
                f"{self.mechanism.name}: {name}: no such flexible link."
                f"{nearest(name, self.mechanism.parts)}"
            )
        link = self.now().links[name]
        strain = link.stress("normal")[0] / part.spec.material.E
        return LinkNow(link.x, link.deflection[0], strain, link.von_mises[0])

    @public
    def sensor(self, name: str) -> Array:
        """What a sensor reads now; its unit and shape are those of its kind.

        Args:
            name: Of a sensor that the simulator was made with.
        Raises:
            DescriptionError: No such sensor.
        """
        if name not in self._sensors:
            raise DescriptionError(
                f"{self.mechanism.name}: sensor: {name}: no such sensor."
                f"{nearest(name, self._sensors)}"
            )
        return self._sensors[name](self._compiled, [x[1:] for x in self._at.found[:3]])

    # Going back, and records -------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """The state, with all that the steps go on with."""
        led = self._at is self._engines.get(True)
        return Snapshot(id(self), led, self._steps, self._at.march.kept())

    @public
    def restore(self, snapshot: Snapshot) -> Simulator:
        """Go back: the steps that follow are the same to the last bit; a record ends.

        Args:
            snapshot: Of this simulator.
        Raises:
            DescriptionError: It is another simulator's.
        """
        if not isinstance(snapshot, Snapshot) or snapshot.of != id(self):
            raise DescriptionError(
                f"{self.mechanism.name}: restore: not a snapshot of this simulator."
            )
        engine = self._at = self._made(snapshot.led)
        engine.march.go_back(snapshot.state)
        self._steps, self._log = snapshot.steps, None
        return self

    @public
    def record(self, every: int = 1) -> Simulator:
        """Keep the states from now on, for `result`.

        Args:
            every: Steps between two that are kept.
        """
        if not isinstance(every, int) or every < 1:
            raise DescriptionError(
                f"record: every: {shown(every)}. Give a whole number, 1 or more."
            )
        self._log = Log(every, self._steps)
        self._log.keep(self._steps, self.time, self._at.found)
        return self

    def result(self) -> Result:
        """What was recorded, as a result like that of `pf.solve`.

        Raises:
            DescriptionError: Nothing was recorded.
        """
        if self._log is None:
            raise DescriptionError(
                f"{self.mechanism.name}: result: call record() before the steps."
            )
        return self._result(self._log)

    def now(self) -> Result:
        """This instant as a result, with everything that a result has."""
        log = Log(1, self._steps)
        log.keep(self._steps, self.time, self._at.found)
        return self._result(log)

    def _result(self, log: Log) -> Result:
        t, (y, v, a, s, lam, torque, _) = np.array(log.t), log.columns()
        settings: Settings = {
            "integrator": self._at.march.scheme.name, "dt": self.dt, "start": self.start,
            "drive": "torque",  # rigid poses are those of the motors where they are
        }  # fmt: skip
        cost = {name: float(n) for name, n in self.cost.items()}
        run = Run(self._system, t, y, v, a, lam, torque, cost, settings, log.work(), s=s)
        rigid = partial(rigid_reference, self.mechanism, hold(duration=1.0), run)
        return result_of(self.mechanism, run, rigid, "coupled", cost, "")


def _stops(mechanism: Mechanism) -> tuple[Array, Array] | None:
    """Position limits of the motors in the URDF; None: there are none."""
    model = mechanism.rigid.rigid
    limits = limits_of(model_of(mechanism.description), model)
    at = motor_axes(mechanism).q_at
    low, high = limits.lower[at], limits.upper[at]
    return (low, high) if np.isfinite(low).any() or np.isfinite(high).any() else None


def _require(where: str, dt: object, integrator: object, **counts: object) -> None:
    """Raise where an argument is not what it should be."""
    if isinstance(dt, bool) or not 0.0 < number(dt) < np.inf:
        raise DescriptionError(f"{where}: dt: {shown(dt)}. Give a step above 0 s.")
    if not isinstance(integrator, AlphaScheme | None):
        raise DescriptionError(
            f"{where}: integrator: {shown(integrator)}. Give one of the alpha family, such as "
            "pf.newmark()."
        )
    for name, value in counts.items():
        if value is None and name != "iterations":
            continue
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= _MOST:
            raise DescriptionError(
                f"{where}: {name}: {shown(value)}. Give a whole number from 1 to {_MOST}."
            )
