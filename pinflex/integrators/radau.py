"""The coupled level by Radau IIA collocation, with steps that follow the motion.

The same index-3 equations as `equal_steps`, at every stage i of a step, the loops
closed there:

    r(y_i, v_i, a_i, lam_i) = 0,  c(y_i) = 0,  v_i = v_0 + h A_ij a_j,  y_i = y_0 (+) h A_ij u_j

Of high order where the motion is smooth, so steps are long; the stages of a step are evaluated
together. Samples are read off the polynomials of the stages: they cost no steps. On a manifold,
u is v seen in the exponential coordinates of the step (Munthe-Kaas 1999), else u = v.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive
from pinflex.actuation.motors import motor_axes
from pinflex.actuation.sampler import Sampler
from pinflex.arrays import Array
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.consistent import consistent_acceleration
from pinflex.integrators.stage_newton import StageNewton
from pinflex.integrators.steps import Path, StepFailed, largest
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.manifold import Manifold
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


class Stages:
    """Solves single steps of one run."""

    idle, memory = (1.0, 1.2), 0.0  # a change of the step costs new factors

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
        system = dynamics.system
        self.by_energy = forces and dynamics.flexible
        self.dynamics, self.path, self.drive = dynamics, path, drive
        self.sampler = sampler
        self.axes, self.motors = motor_axes(mechanism), system.motors
        self.method, self.resolution = method, resolution
        self.free = system.free if drive is None else system.unheld
        self.newton = StageNewton(dynamics, method, self.free, drive)
        self.measured = slice(dynamics.n_rigid, None) if dynamics.flexible else self.free
        self.manifold = Manifold(dynamics, () if drive is not None else self.motors)
        self.scale, self.iterations = 0.0, 0
        self._open = min(_OPEN, max(_OPEN_PART * resolution, _CLOSED))

    def first(self, t: float, y: Array, v: Array) -> Start:
        """Consistent accelerations, multipliers and torques at (y, v)."""
        d, path, u = self.dynamics, self.path(np.array([t])), None
        if self.sampler is not None:
            self.sampler.reach(t, y, v)
            u = self.sampler.force
        if self.drive is None:
            a, lam = consistent_acceleration(d, y, v, self.motors, path.acceleration[0], None, t, u)
            return Start(t, y, v, a, lam, d.residual(y, v, a, lam, t, u).r[self.motors])
        torque = self.drive.pull(path, self.axes, y[None], v[None])[0]
        a, lam = consistent_acceleration(d, y, v, self.motors[:0], np.zeros(0), torque, t, u)
        return Start(t, y, v, a, lam, torque)

    def step(self, start: Start, h: float, last: Step | None) -> Step:
        """The step of length h from a state.

        Args:
            start: State. h: Length in s.
            last: The step before, whose polynomials predict; None: they start constant.
        Raises:
            StepFailed: Newton does not converge. LinAlgError: its matrix is singular.
        """
        m, free, newton, y, v = self.method, self.free, self.newton, start.y, start.v
        held = None if self.sampler is None else self.sampler.force
        a, lam = self._predict(start, h, last)
        t = start.t + h * m.c
        path = self.path(t)
        if self.drive is None:
            a[:, self.motors] = path.acceleration
        turn, change = np.zeros((m.s, len(v))), np.zeros((m.s, len(v)))
        previous, drift, fresh = 0.0, (h * m.c)[:, None] * v, -1
        for iteration in range(_MAX_ITERATIONS):
            v_s = v + h * (m.A @ a)
            if self.drive is None:
                v_s[:, self.motors] = path.velocity
            move = drift + (h * h) * (m.A2 @ a)
            if self.manifold.turning:
                turn = self.manifold.turn(y, move + h * (m.A @ turn), v_s)
                move += h * (m.A @ turn)
            y_s = self.places(y, move, path)
            if newton.stale:
                k = m.s // 2
                newton.refresh(y_s[k], v_s[k], a[k], lam[k], float(t[k]))
                fresh = iteration
            if newton.h != h:
                newton.factor(h)
            r, c = self.dynamics.residual(y_s, v_s, a, lam, t, held)
            torque = r[:, self.motors]
            if self.drive is not None:
                torque = self.drive.pull(path, self.axes, y_s, v_s)
                r[:, self.motors] -= torque
            self.iterations += 1
            dz, dlam = newton.step(r[:, free], c)
            da = m.A2_inverse @ dz
            a[:, free] += da
            lam += dlam
            # Displacements count: the accelerations of fast modes are noise.
            change[:, free] = (h * h) * dz
            if not iteration:
                reach = self._reach(move + change + self._elastic(y))
            size = self._size(change)
            if not math.isfinite(size):
                raise StepFailed
            rate = size / max(previous, 1e-300) if iteration else 1.0
            left = size * rate / (1.0 - rate) if rate < 0.9 else np.inf
            goal = max(_NEWTON * min(self.resolution, _COARSE) * reach, self._floor(_ROUND_OFF))
            small = left <= goal or (iteration > 0 and size < 0.1 * goal)  # round-off has no rate
            if small and np.abs(c).max(initial=0.0) < self._open:
                break
            if (iteration >= fresh + 2 and rate > 0.5) or size > 1e3 * max(reach, goal):
                if fresh >= 0 or size > max(reach, goal):
                    raise StepFailed
                newton.stale = True  # perhaps the tangent has only aged
            previous = size
        else:
            raise StepFailed
        newton.stale = iteration > 0 and rate > 0.1
        dv = h * (m.A @ da)
        if self.drive is None:
            torque = torque + newton.motor_forces(da, dv, change[:, free], dlam)
        v_s[:, free] += dv
        self.scale = self._reach(move + self._elastic(y))
        seen = max(self.scale, self._floor(_SEEN) / self.resolution)
        coarse = self._size((m.last @ move)[None]) / seen
        power = self._power(v_s, torque)
        return Step(start, h, move + change, turn, a, lam, torque, power, coarse, path)

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
        return W @ last.a, W @ last.lam

    def places(self, y: Array, move: Array, path: MotorPath) -> Array:
        """Poses y (+) move, shape (k, nq), prescribed motors where they are told to be."""
        y_s = self.manifold.retract(y, move)
        if self.drive is None:
            self.axes.write(y_s, path.position)
        return y_s

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
            return self.dynamics.stiffness
        k = len(self.free) - self.dynamics.system.n_eta if self.dynamics.flexible else 0
        return self.newton.M[k:, k:]

    def _power(self, v: Array, torque: Array) -> Array:
        """Power of the motors and of the damping at states, shape (s, 2)."""
        lost = self.dynamics.system.dissipation(v)
        put_in = np.sum(torque * v[:, self.motors], axis=1)
        if self.sampler is not None:
            put_in = put_in + v @ self.sampler.force
        return np.column_stack([put_in, lost])

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

    def work(self, step: Step) -> Array:
        """Work of the motors and of the damping in a step, J, shape (2,)."""
        return np.asarray(step.h * (self.method.A[-1] @ step.power))

    def end(self, step: Step) -> Start:
        """The state after a step."""
        t = step.start.t + step.h
        v = step.start.v + step.h * (self.method.A[-1] @ step.a)
        if self.drive is None:
            v[self.motors] = step.path.velocity[-1]
        y = self.places(step.start.y, step.move, step.path)[-1]
        return Start(t, y, v, step.a[-1], step.lam[-1], step.torque[-1])

    def dense(self, step: Step, t: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        """y, v, a, lam, torque and work since the start of the step, at times within it."""
        m, h, start = self.method, step.h, step.start
        x = (t - start.t) / h
        B1, B2, W = m.at(x, 1), m.at(x, 2), m.through(x)

        def between(first: Array, stages: Array) -> Array:
            # Through the value at the start too: below the first node a polynomial runs wild.
            return np.asarray(W @ np.concatenate([first[None], stages]))

        v = start.v + h * (B1 @ step.a)
        move = np.outer(h * x, start.v) + (h * h) * (B2 @ step.a) + h * (B1 @ step.turn)
        path, a = self.path(t), between(start.a, step.a)
        if self.drive is None:
            v[:, self.motors], a[:, self.motors] = path.velocity, path.acceleration
        y = self.places(start.y, move, path)
        lam, torque = between(start.lam, step.lam), between(start.torque, step.torque)
        return y, v, a, lam, torque, h * (B1 @ step.power)
