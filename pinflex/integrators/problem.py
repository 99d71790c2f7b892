"""What a march solves: the equations of a system, and what moves its motors.

    r(y, v, a, lam, t) = B tau,     c(y) = 0

Motors follow a path exactly, and their torque tau is what is left; or a drive gives their torque. A
digital controller adds forces that it holds from instant to instant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from pinflex.actuation.path import MotorPath, motor_axes
from pinflex.arrays import Array, BoolArray, IntArray, distinct, others
from pinflex.doors import door
from pinflex.kernel.evaluate import Residual, Tangent
from pinflex.linalg import saddle_matrix
from pinflex.mechanics.evaluation.compiled import Compiled
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.actuation.drive import Nominal, TorqueDrive
    from pinflex.actuation.feedback import Sampler, Signals
    from pinflex.description.solve import SolveSpec
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.mechanics.model.system import System
    from pinflex.results.result import Result


# Accelerations and multipliers that satisfy the equations in a state: where steps begin.


def consistent_acceleration(
    dynamics: Equations,
    y: Array,
    v: Array,
    held: IntArray,
    a_held: Array,
    tau: Array | None,
    t: float,
    control_force: Array | None = None,
) -> tuple[Array, Array]:
    """Accelerations and multipliers that satisfy the equations at (y, v).

    Returns:
        a (nv,), lam (rows,), from the saddle system of M and J (least squares where coordinates
        have no mass).
    """
    system = dynamics.system
    free, a = others(system.nv, distinct(system.held, held)), np.zeros(system.nv)
    a[held] = a_held
    r, _ = dynamics.residual(y, v, a, np.zeros(system.closed.n), t, control_force)
    if tau is not None:
        r[system.motors] -= tau
    J, n = dynamics.close(y).J, len(free)
    S = saddle_matrix(dynamics.mass(y, t)[np.ix_(free, free)], J[:, free])
    b = np.concatenate([-r[free], -dynamics.closure_bias(y, v) - J[:, held] @ a_held])
    solution = _solved(S, b, n, dynamics.compiled)
    a[free] = solution[:n]
    return a, solution[n:]


def _solved(S: Array, b: Array, n: int, compiled: Compiled | None) -> Array:
    """Solution of S x = b, its first n rows and columns scaled by the diagonal in place.

    Massless coordinates (torsion without inertia) make S singular: their balance is algebraic and
    the least-norm answer only seeds the first step.
    """
    size = np.abs(np.diag(S))
    scale = 1.0 / np.sqrt(np.maximum(size, max(1e-12 * float(np.max(size, initial=0.0)), 1e-300)))
    scale[n:] = 1.0
    S *= scale[:, None] * scale
    b *= scale
    if not len(b):
        return b
    if compiled is not None:  # in linear time, where loops lie in a row
        return np.asarray(scale * compiled.saddle(S, b))
    if np.linalg.cond(S, 1) < 1e14:  # by the inverse: half the time of an SVD
        return np.asarray(scale * np.linalg.solve(S, b))
    return np.asarray(scale * np.linalg.lstsq(S, b, rcond=1e-13)[0])


Path = Callable[[Array], MotorPath]
_BESIDE = 1e-10  # of the time: beyond what laws of motion snap to, less than any step to a node
_AT_BREAK = 1e-9  # of a run: nearer to a break a sample lies on it
_JUMP = 1e-6  # of the largest acceleration: less is what path_inside extrapolates by


class StepFailed(Exception):
    """Newton did not converge in a step: a shorter one may.

    Attributes:
        residual: Where it stopped, by free row (N | N m); nan: that is not known.
    """

    def __init__(self, residual: Array | float = np.nan) -> None:
        super().__init__()
        self.residual = np.atleast_1d(residual)


@dataclass
class State:
    """The state at an instant: t in s, y (nq,), v and a (nv,), lam (rows,), torque (nm,)."""

    t: float
    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array


def build_step(
    mechanism: Mechanism, y: Array, v: Array, h: float, t: float = 0.0
) -> tuple[State, Residual, Tangent]:
    """What Newton's first iteration of a step with motors held solves, to be looked at.

        M da + C dv + K dy - J' dlam = -r,     J dy = -c

    Args:
        mechanism: With its motors. y, v: State, shapes (nq,) and (nv,) of the flexible mechanism.
        h: Step [s]. t: Its start [s], for loads.
    Returns:
        The prediction at the end, of constant acceleration; r and c there; M, C, K and J.
    """
    system = mechanism.loose
    dynamics, held = Equations(system), system.motors
    a, lam = consistent_acceleration(dynamics, y, v, held, np.zeros(len(held)), None, t)
    at, speed, end = dynamics.integrate(y, h * v + 0.5 * h**2 * a), v + h * a, t + h
    left = dynamics.residual(at, speed, a, lam, end)
    now = State(end, at, speed, a, lam, left.r[held])
    return now, left, dynamics.tangent(at, speed, a, lam, end)


class Problem:
    """The equations of one run.

    Attributes:
        dynamics: Residual, tangent and poses. path: Motion of the motors; it may be asked for any
            times of the run. motion: The same, as it was given.
        drive: What gives the motors' torque; None: they follow the path.
        sampler: A digital controller, or None.
        axes, motors: Coordinates and velocity rows of the motors.
        free: Velocity rows that are solved for.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        dynamics: Equations,
        path: Path,
        drive: TorqueDrive | None = None,
        sampler: Sampler | None = None,
    ) -> None:
        system = dynamics.system
        self.dynamics, self.path, self.motion = dynamics, path, path
        self._sides = mechanism.followed.sides
        self.drive, self.sampler = drive, sampler
        self.axes, self.motors = motor_axes(mechanism), system.motors
        self.free = system.free if drive is None else system.unheld

    @property
    def prescribed(self) -> bool:
        """Whether the motors follow their path exactly."""
        return self.drive is None

    def first(self, t: float, y: Array, v: Array) -> State:
        """Consistent accelerations, multipliers and torques at (y, v); a controller may act."""
        if self.sampler is not None:
            self.sampler.reach(t, y, v)
        return self._balanced(t, y, v)

    def _balanced(self, t: float, y: Array, v: Array) -> State:
        path, u = self.path(np.array([t])), self.control_force
        torque = None if self.prescribed else self.pull(path, y[None], v[None])[0]
        a, lam = self.accelerated(t, y, v, path.acceleration[0], torque, u)
        if torque is None:
            torque = self.dynamics.residual(y, v, a, lam, t, u).r[self.motors]
        return State(t, y, v, a, lam, torque)

    def accelerated(
        self, t: float, y: Array, v: Array, a_motors: Array, torque: Array | None, u: Array | None
    ) -> tuple[Array, Array]:
        """Accelerations and multipliers at (y, v) under forces u (nv,) of a control.

        The motors have those that are given, or are driven by a torque (nm,).
        """
        held = self.motors if torque is None else self.motors[:0]
        a_held = a_motors[: len(held)]
        return consistent_acceleration(self.dynamics, y, v, held, a_held, torque, t, u)

    def jumps(self, t: Array, moved: Array) -> IntArray:
        """Which of times t (k,) accelerations of the motion jump at; `moved`: those of the run."""

        def sides() -> tuple[Array, Array]:
            return self.path_inside(t).acceleration, self.path(t).acceleration

        before, after = self._sides.get(self.motion, t.tobytes(), sides)
        jump = np.abs(after - before).max(axis=1, initial=0.0)
        largest = max(np.abs(x).max(initial=1e-300) for x in (moved, after))  # many end in none
        return np.flatnonzero(jump > _JUMP * largest)

    def pull(self, path: MotorPath, y: Array, v: Array, inside: bool = False) -> Array:
        """Torques of driven motors in states, shape (k, nm); what a controller holds is in them.

        `inside`: the states are the stages of a step.
        """
        assert self.drive is not None
        torque = self.drive.pull(path, self.axes, y, v, inside)
        return torque if self.sampler is None else torque + self.sampler.torque

    @property
    def push(self) -> Callable[[Run], Array]:
        """What driven motors and a digital controller push with at samples, (nt, nv), of a run.

        The function knows no workspace: others may have it while a run is kept.
        """
        drive, path, axes, motors = self.drive, self.path, self.axes, self.motors
        B = None if self.sampler is None else self.sampler.feedback.B

        def at_samples(run: Run) -> Array:
            push = np.zeros(run.v.shape)
            if B is not None and run.signals is not None:
                push += run.signals.u @ B.T
            if drive is not None:
                push[:, motors] += drive.pull(path(run.t), axes, run.y, run.v)
            return push

        return at_samples

    def told(self, run: Run, mechanism: Mechanism, spec: SolveSpec) -> Run:
        """The run with what a digital controller did, and with what is to be said of that."""
        if self.sampler is None:
            return run
        signals, control = self.sampler.signals(run.t, run.y), self.sampler.feedback.control
        some, n = np.linspace(0, len(run.t) - 1, 3).astype(int), int(run.system.rigid.nq)
        poses = run.t[some], run.y[some, :n]

        @cache
        def loop() -> tuple[str, ...]:
            check = door("studies.margins", "unstable")
            return tuple(check(mechanism, control, spec, *poses))

        words = (*run.warnings, *signals.said)
        return replace(run, signals=signals, warnings=words, loop=tuple if signals.said else loop)

    @property
    def control_force(self) -> Array | None:
        """Generalised forces (nv,) that a digital controller holds now; None: none."""
        return None if self.sampler is None else self.sampler.force

    def inside(self, t: Array, c: Array) -> tuple[MotorPath, Array]:
        """Motion of the motors at the stages of a step, and their times as loads see them, (s,).

        `c`: their nodes. Where a load switches at an end, it is as it is inside, however rounded.
        """
        return self.path_inside(t), t + max(1.0, float(t[-1])) * 1e-12 * (1.0 - 2.0 * c)

    def path_inside(self, t: Array) -> MotorPath:
        """Motion of the motors at times of stages (k,) s, the last of which may end a step.

        Where accelerations jump there, they are those inside: a stage with others would leave an
        error of the order of h in every speed.
        """
        rest, n = _BESIDE * np.maximum(1.0, t), len(t)
        path, ahead = self.path(np.concatenate([t - rest, t - 2.0 * rest])), rest[:, None]
        x, v, a = (part[:n] for part in (path.position, path.velocity, path.acceleration))
        a = 2.0 * a - path.acceleration[n:]  # straight on from the two
        return MotorPath(t, x + ahead * (v + 0.5 * ahead * a), v + ahead * a, a)


def on_marks(t: Array, marks: Sequence[float]) -> BoolArray:
    """Which samples t (k,) of a run lie on one of some marks [s], however that is rounded."""
    every = np.array([-np.inf, *sorted(marks), np.inf])
    k = np.searchsorted(every, t)
    apart = np.minimum(t - every[k - 1], every[k] - t)
    return np.asarray(apart <= (_AT_BREAK * np.ptp(t) if len(t) else 0.0))


# What a level hands over: the states of a system over time, before anything is recovered.


class Settings(TypedDict, total=False):
    """What a level used for a run; the file of a result has the same keys.

    integrator: "radau", or the name of a scheme or a stepper; stages: of collocation.
    dt: Step [s]; of steps that follow the motion their mean. steps: "given" where these are.
    scale: Largest displacement, in the norm of the steps. gamma: Of the alpha family.
    march: Who takes the steps, where that costs time. terms: "structural" or "full", of level ked.
    start: Where it started: straight, static, ... drive: "prescribed" or "torque".
    tol: Tolerance. error: Estimated error by output. judged: By what.
    events: Contacts. clearances: Of pins, by name [m].
    parts: When two runs alike part at contacts [s]. share: Multipliers of shared torques.
    interpolated: Error of torques between steps [N m | N].
    """

    integrator: str
    stages: int
    dt: float
    steps: str
    scale: float
    gamma: float
    march: str
    terms: str
    start: str
    drive: str
    tol: float
    error: dict[str, float]
    judged: str
    events: list[dict[str, Any]]
    clearances: dict[str, float]
    parts: float
    share: dict[str, Any]
    interpolated: float


def states_of(result: Result) -> tuple[Array, Array, Array]:
    """y (nt, nq), v and a (nt, nv) of a result: of its joints, then of its links if any deform."""
    y, v, a = (result.array(f"joint/{x}") for x in "qva")
    if "eta" not in result.arrays:
        return y, v, a
    elastic = zip((y, v, a), ("eta", "eta_v", "eta_a"), strict=True)
    y, v, a = (np.hstack([joints, result.array(own)]) for joints, own in elastic)
    return y, v, a


@frozen
class Run:
    """States of one system over time.

    Attributes:
        system: The system that was solved.
        t: Times, shape (nt,).
        y: Coordinates [q; eta], shape (nt, nq). v, a: Shape (nt, nv).
        lam: Multipliers of the independent closure rows, shape (nt, rows).
        torque: Motor torques (N m | N), shape (nt, nm).
        cost: Counts (steps, newton, tangents, ...).
        settings: What the level used.
        work: Energy put in by the motors and taken by damping, shape (nt, 2), or None.
        warnings: Plain sentences.
        signals: What a control measured and drove, or None.
        path: The nominal motion that a linear run deviates from, or None.
        settle: Solves the equations at the samples for accelerations and multipliers, which steps
            longer than the samples have less accurately; None: they are solved.
        judged: Finds estimated errors of forces and stresses, by output; None: not estimated.
        several: Finds statistics of more runs, by motor, where a single one means little; or None.
        loop: Finds what is to be said of a digital controller's loop; without one, nothing.
        s: Algorithmic accelerations of the alpha family, shape (nt, nv), to go on from; or None.
    """

    system: System
    t: Array
    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array
    cost: dict[str, float]
    settings: Settings = field(default_factory=Settings)
    work: Array | None = None
    warnings: tuple[str, ...] = ()
    signals: Signals | None = None
    path: Nominal | None = None
    s: Array | None = None
    settle: Callable[[Run], Run] | None = None
    judged: Callable[[], Mapping[str, float]] | None = None
    several: Callable[[], Mapping[str, Any]] | None = None
    loop: Callable[[], tuple[str, ...]] = tuple

    def at(self, k: slice | IntArray) -> Run:
        """Some of its instants."""
        return replace(
            self, t=self.t[k], y=self.y[k], v=self.v[k], a=self.a[k], lam=self.lam[k],
            torque=self.torque[k], work=None if self.work is None else self.work[k],
            path=None if self.path is None else self.path.at(k),
            signals=None if self.signals is None else self.signals.at(k),
            s=None if self.s is None else self.s[k],
        )  # fmt: skip

    @property
    def linear(self) -> bool:
        """Whether forces are linear in the deviation: those of the undeformed mechanism."""
        return self.path is not None and self.settings.get("terms") == "structural"

    def acting(self, k: int) -> tuple[Array, Array]:
        """Pose and velocity at which forces are evaluated: the nominal ones of a linear run."""
        if self.path is None or not self.linear:
            return self.y[k], self.v[k]
        elastic = np.zeros(self.system.n_eta)
        return np.concatenate([self.path.q[k], elastic]), np.concatenate([self.path.v[k], elastic])
