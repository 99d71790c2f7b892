"""The equations of one collocation step: its stages, their correction, and what is read off them.

At every stage i of a step, the loops closed there:

    r(y_i, v_i, a_i, lam_i) = 0,  c(y_i) = 0,  v_i = v_0 + h A_ij a_j,  y_i = y_0 (+) h A_ij u_j

On a manifold, u is v seen in the exponential coordinates of the step (Munthe-Kaas 1999), else
u = v. Samples are read off the polynomials of the stages: they cost no steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive
from pinflex.actuation.motors import motor_axes
from pinflex.actuation.sampler import Sampler
from pinflex.arrays import Array, IntArray
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.compiled_stages import compiled_stages
from pinflex.integrators.consistent import consistent_acceleration
from pinflex.integrators.stage_newton import StageNewton, Tangent
from pinflex.integrators.steps import Path, States
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism

_INSIDE = 1e-12  # of the time: more than its rounding, less than any step to a node
_BESIDE = 1e-10  # of the time, likewise: beyond what laws of motion snap to


@dataclass
class Start:
    """The state a step starts from."""

    t: float
    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array


@dataclass(frozen=True)
class Step:
    """A step: where it started, its length, and its stages.

    Attributes:
        start: State before it. h: Length in s.
        move: Exponential coordinates from the start, shape (s, nv). turn: u - v, likewise.
        a: Shape (s, nv). lam: Shape (s, rows). torque: Shape (s, nm).
        power: Of the motors and of the damping, shape (s, 2), W.
        coarseness: Last Legendre coefficient of the displacement over the largest one so far. In a
            vibration the error that a step adds is about half its square for each radian.
        path: Motion of the motors at the stages.
        tangent: Linearised equations it was solved with. rate: Their last contraction.
    """

    start: Start
    h: float
    move: Array
    turn: Array
    a: Array
    lam: Array
    torque: Array
    power: Array
    coarseness: float
    path: MotorPath
    tangent: Tangent
    rate: float


class _Lengths:
    """What the length h of a step makes of the scheme.

    Attributes:
        h: Length in s. integrals: h A above h^2 A^2, shape (2 s, s). drift: Of the speed at the
            start, in the speeds and in the displacements of the stages, shape (2 s, 1).
        to_a: Displacements to accelerations, shape (s, s).
    """

    def __init__(self, method: Collocation, h: float) -> None:
        self.h, s = h, method.s
        self.integrals, self.drift = np.empty((2 * s, s)), np.ones((2 * s, 1))
        np.multiply(h, method.A, out=self.integrals[:s])
        np.multiply(h * h, method.A2, out=self.integrals[s:])
        self.drift[s:, 0] = h * method.c
        self.to_a = method.A2_inverse / (h * h)


class Trial:
    """Stages of a step on their way to the solution.

    Attributes:
        start, h, t, path: As in a step, with the times of the stages.
        drift: Speeds and displacements at a constant speed, shape (2 s, nv).
        a, lam, turn: Unknowns. v, move, y: What follows from them.
        da, dlam, change: The last correction: of a, of lam, and of the displacement.
        torque, c: Of the motors, and of the closures, before that correction.
    """

    y: Array
    v: Array
    move: Array
    torque: Array
    c: Array
    da: Array
    dlam: Array
    drift: Array

    def __init__(
        self, start: Start, h: float, t: Array, path: MotorPath, a: Array, lam: Array, turn: Array
    ) -> None:
        self.start, self.h, self.t, self.path = start, h, t, path
        self.a, self.lam, self.turn = a, lam, turn
        self.change = np.zeros(a.shape)


class StageEquations:
    """The stages of single steps of one run: residuals, corrections, states between."""

    def __init__(
        self,
        mechanism: Mechanism,
        dynamics: Equations,
        path: Path,
        method: Collocation,
        drive: TorqueDrive | None = None,
        sampler: Sampler | None = None,
    ) -> None:
        system = dynamics.system
        self.mechanism, self.dynamics, self.path, self.drive = mechanism, dynamics, path, drive
        self.axes, self.motors = motor_axes(mechanism), system.motors
        self.motion, self.method, self.sampler = path, method, sampler
        self.free = system.free if drive is None else system.unheld
        self._inside = _INSIDE * (1.0 - 2.0 * method.c)
        self._of_h = _Lengths(method, 1.0)
        given = method, self.free, self.axes, drive, sampler is not None
        self.compiled = compiled_stages(dynamics, *given)
        self.newton = StageNewton(dynamics, method, self.free, drive, self.compiled)

    def __del__(self) -> None:
        if (compiled := self.__dict__.get("compiled")) is not None:
            self.dynamics.system.spares.release(compiled.kind, compiled, compiled.size)

    @cached_property
    def manifold(self) -> Manifold:
        """Poses moved and told apart; the compiled march has its own."""
        return Manifold(self.dynamics, () if self.drive is not None else self.motors)

    def first(self, t: float, y: Array, v: Array) -> Start:
        """Consistent accelerations, multipliers and torques at (y, v)."""
        d, path = self.dynamics, self.path(np.array([t]))
        self.reach(t, y, v)
        if self.compiled is not None and self.sampler is not None:
            self.compiled.kernel.held[...] = self.sampler.held
        u = self._control_force
        if self.drive is None:
            a, lam = consistent_acceleration(d, y, v, self.motors, path.acceleration[0], None, t, u)
            return Start(t, y, v, a, lam, d.residual(y, v, a, lam, t, u).r[self.motors])
        torque = self._pull(path, y[None], v[None])[0]
        a, lam = consistent_acceleration(d, y, v, self.motors[:0], np.zeros(0), torque, t, u)
        return Start(t, y, v, a, lam, torque)

    def begin(
        self,
        start: Start,
        h: float,
        a: Array,
        lam: Array,
        turn: Array | None = None,
        path: MotorPath | None = None,
    ) -> Trial:
        """Stages of a step of h (s) with a guess of a (s, nv), lam (s, rows) and turn (s, nv).

        `path`: the motion of the motors there, where it is known.
        """
        t = start.t + h * self.method.c
        path = self.prescribed(t) if path is None else path
        if self.drive is None:
            a[:, self.motors] = path.acceleration
        seen = self.seen(t)
        x = Trial(start, h, seen, path, a, lam, np.zeros(a.shape) if turn is None else turn)
        if self.compiled is not None:
            feed = None if self.drive is None else self.drive.forward(seen)
            self.compiled.begin(start, seen, path, a, lam, x.turn, feed)
            k = self.compiled.kernel  # its arrays from now on
            x.a, x.lam, x.turn, x.change, x.dlam = k.a, k.lam, k.turn, k.change, k.dlam
            x.y, x.v, x.move, x.da = k.y, k.v, k.move, k.da
            return x
        if self._of_h.h != h:
            self._of_h = _Lengths(self.method, h)
        x.drift = self._of_h.drift * start.v
        x.y = np.empty((len(a), len(start.y)))
        if self.drive is None:
            self.axes.write(x.y, path.position)  # for all iterations
        return x

    def seen(self, t: Array) -> Array:
        """Times of the stages as loads see them, shape (s,).

        Where one switches at an end of the step, it is as it is inside, however that is rounded.
        """
        return t + max(1.0, float(t[-1])) * self._inside

    def prescribed(self, t: Array) -> MotorPath:
        """Motion of the motors at times of stages (k,) s, the last of which may end a step.

        Where accelerations jump there, they are those inside: a stage with others would leave an
        error of the order of h in every speed.
        """
        rest, n = _BESIDE * np.maximum(1.0, t), len(t)
        path, ahead = self.path(np.concatenate([t - rest, t - 2.0 * rest])), rest[:, None]
        x, v, a = (part[:n] for part in (path.position, path.velocity, path.acceleration))
        a = 2.0 * a - path.acceleration[n:]  # straight on from the two
        return MotorPath(t, x + ahead * (v + 0.5 * ahead * a), v + ahead * a, a)

    def place(self, x: Trial) -> None:
        """Poses and velocities of the stages from their accelerations."""
        if self.compiled is not None:
            self.compiled.kernel.place(x.h)
            return
        s, start = len(x.a), x.start
        both = self._of_h.integrals.dot(x.a)
        both += x.drift
        x.v, x.move = both[:s], both[s:]
        if self.drive is None:
            x.v[:, self.motors] = x.path.velocity
        manifold = self.manifold
        if manifold.turning:
            through = self._of_h.integrals[:s]
            x.turn = manifold.turn(start.y, x.move + through.dot(x.turn), x.v)
            x.move += through.dot(x.turn)
        x.y = manifold.retract(start.y, x.move, x.y)
        if self.drive is None and not manifold.sparing:
            self.axes.write(x.y, x.path.position)

    def correct(self, x: Trial) -> None:
        """One Newton correction of the stages, by the factors at hand."""
        if self.compiled is not None:
            kernel = self.compiled.kernel
            kernel.residual()
            x.torque = kernel.r[:, self.motors] if self.drive is None else kernel.torque
            x.c = kernel.open
            kernel.correct()
            return
        r, x.c = self.dynamics.residual(x.y, x.v, x.a, x.lam, x.t, self._control_force)
        x.torque = r.take(self.motors, axis=1)
        if self.drive is not None:
            x.torque = self._pull(x.path, x.y, x.v, x.t)
            r[:, self.motors] -= x.torque
        dz, x.dlam = self.newton.step(r.take(self.free, axis=1), x.c)
        # Displacements count: the accelerations of fast modes are noise.
        x.change[:, self.free] = (x.h * x.h) * dz
        x.a += self._of_h.to_a.dot(x.change)
        x.lam += x.dlam

    def solved(self, x: Trial, coarseness: float, rate: float) -> Step:
        """The step with its last correction in everything that follows from it."""
        tangent, torque = self.newton.tangent, x.torque
        if self.compiled is None:
            da = self._of_h.to_a.dot(x.change)
        else:
            da = np.zeros_like(x.change)
            da[:, self.free] = x.da
        dv = x.h * self.method.A.dot(da)
        x.v += dv
        if self.drive is None:
            torque = torque + tangent.motor_forces(da, dv, x.change, x.dlam)
        else:
            y = self.places(x.start.y, x.move + x.change, x.path)
            torque = self._pull(x.path, y, x.v, x.t)
        return Step(
            x.start, x.h, x.move + x.change, x.turn.copy(), x.a.copy(), x.lam.copy(), torque,
            self._power(x, torque), coarseness, x.path, tangent, rate,
        )  # fmt: skip

    def places(self, y: Array, move: Array, path: MotorPath) -> Array:
        """Poses y (+) move, shape (k, nq), prescribed motors where they are told to be.

        Args:
            y: One pose (nq,), or each of (k, nq). move: Shape (k, nv).
            path: Motion of the motors at the k instants.
        """
        y_s = self.manifold.retract(y, move)
        if self.drive is None:
            self.axes.write(y_s, path.position)
        return y_s

    def _power(self, x: Trial, torque: Array) -> Array:
        """Power of the motors and of the damping at the stages, shape (s, 2)."""
        d, v, power = self.dynamics, x.v, np.zeros((len(x.v), 2))
        np.add.reduce(torque * v.take(self.motors, axis=1), axis=1, out=power[:, 0])
        if d.damped or d.rubbed or d.loaded:
            y = self.places(x.start.y, x.move + x.change, x.path) if d.loaded else x.y
            power[:, 1] = d.losses(y, v)
        if (force := self._control_force) is not None:
            power[:, 0] += v @ force
        return power

    def reach(self, t: float, y: Array, v: Array) -> bool:
        """Let a digital controller act at an instant; whether what it holds is another then.

        Args:
            t: Time [s].
            y: Coordinates, shape (nq,).
            v: Velocity, shape (nv,).
        """
        return self.sampler is not None and self.sampler.reach(t, y, v)

    def _pull(self, path: MotorPath, y: Array, v: Array, seen: Array | None = None) -> Array:
        """Torques of driven motors in states, shape (k, nm); what a controller holds is in them."""
        assert self.drive is not None
        torque = self.drive.pull(path, self.axes, y, v, seen)
        return torque if self.sampler is None else torque + self.sampler.torque

    @property
    def _control_force(self) -> Array | None:
        """Generalised forces (nv,) that a digital controller holds now; None: none."""
        return None if self.sampler is None else self.sampler.force

    def works(self, steps: Sequence[Step]) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""
        h = np.array([step.h for step in steps])
        return np.asarray(h[:, None] * (self.method.A[-1] @ _stacked(steps, "power")))

    def end(self, step: Step) -> Start:
        """The state after a step."""
        start, path, h = step.start, step.path, step.h
        v = start.v + h * self.method.A[-1].dot(step.a)
        y = self.manifold.retract(start.y, step.move[-1:])[0]
        if self.drive is None:
            v[self.motors] = path.velocity[-1]
            self.axes.write(y, path.position[-1])
        return Start(start.t + h, y, v, step.a[-1], step.lam[-1], step.torque[-1])

    def dense(self, steps: Sequence[Step], t: Array, of: IntArray) -> States:
        """States within steps.

        Numpy is paid once for all of them.

        Args:
            steps: Steps. t: Times in s, shape (k,). of: The step that each lies in, shape (k,).
        """
        m, motors = self.method, self.motors
        h = np.array([step.h for step in steps])[of]
        x = (t - np.array([step.start.t for step in steps])[of]) / h
        by_h, path = h[:, None], self.path(t)
        B1, B2, W = m.between(x)

        def on(weights: Array, values: Array) -> Array:
            return np.asarray(np.matmul(weights[:, None], values[of])[:, 0])

        def first(name: str) -> Array:
            return np.array([getattr(step.start, name) for step in steps])[of]

        def through(name: str) -> Array:
            # Through the value at the start too: below the first node a polynomial runs wild.
            return W[:, :1] * first(name) + on(W[:, 1:], _stacked(steps, name))

        a, start_v = _stacked(steps, "a"), first("v")
        v, acceleration = start_v + by_h * on(B1, a), through("a")
        move = (by_h * x[:, None]) * start_v + by_h**2 * on(B2, a)
        if self.manifold.turning:
            move += by_h * on(B1, _stacked(steps, "turn"))
        if self.drive is None:
            v[:, motors], acceleration[:, motors] = path.velocity, path.acceleration
        y = self.places(first("y"), move, path)
        work = by_h * on(B1, _stacked(steps, "power"))
        return States(y, v, acceleration, through("lam"), through("torque"), work)


def _stacked(steps: Sequence[Step], name: str) -> Array:
    return np.array([getattr(step, name) for step in steps])
