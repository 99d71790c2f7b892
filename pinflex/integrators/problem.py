"""What a march solves: the equations of a system, and what moves its motors.

    r(y, v, a, lam, t) = B tau,     c(y) = 0

Motors follow a path exactly, and their torque tau is what is left; or a drive gives their torque. A
digital controller adds forces that it holds from instant to instant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive
from pinflex.actuation.motors import motor_axes
from pinflex.actuation.sampler import Sampler
from pinflex.arrays import Array, IntArray
from pinflex.mechanics.evaluation.compiled import Compiled
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism

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
    nv, rows = system.nv, system.closed.n
    free = np.setdiff1d(np.setdiff1d(np.arange(nv), held), system.held)
    a = np.zeros(nv)
    a[held] = a_held
    r, _ = dynamics.residual(y, v, a, np.zeros(rows), t, control_force)
    if tau is not None:
        r[system.motors] -= tau
    M = dynamics.mass(y)
    n = len(free)
    S = np.zeros((n + rows, n + rows))
    S[:n, :n] = M[np.ix_(free, free)]
    b = np.concatenate([-r[free], np.zeros(rows)])
    if rows:
        _, J = dynamics.close(y)
        S[:n, n:], S[n:, :n] = J[:, free].T, J[:, free]
        b[n:] = -dynamics.closure_bias(y, v) - J[:, held] @ a_held
    solution = _solved(S, b, n, dynamics.compiled)
    a[free] = solution[:n]
    return a, -solution[n:]


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
        return np.asarray(scale * compiled.evaluator.saddle(S, b))
    if np.linalg.cond(S, 1) < 1e14:  # by the inverse: half the time of an SVD
        return np.asarray(scale * np.linalg.solve(S, b))
    return np.asarray(scale * np.linalg.lstsq(S, b, rcond=1e-13)[0])


@dataclass(frozen=True)
class StepSystem:
    """What Newton's first iteration of a step of length h solves, of every velocity row.

        M da + C dv + K dy - J' dlam = -r,     J dy = -c

    Attributes:
        M, C, K: Derivatives of r by a, v and y, shape (nv, nv). J: dc/dy, shape (rows, nv).
        r: Forces left at the prediction, shape (nv,) [N m | N]; of motors, their torque.
        c: Closures left there, shape (rows,) [m | -].
        y, v, a, lam: The prediction, at the end of the step.
        h: Step [s]. free: Rows that are solved for.
    """

    M: Array
    C: Array
    K: Array
    J: Array
    r: Array
    c: Array
    y: Array
    v: Array
    a: Array
    lam: Array
    h: float
    free: IntArray

    def saddle(self, gamma: float = 0.5, beta: float = 0.25) -> tuple[Array, Array]:
        """Matrix and right side for (da, dlam) of the free rows, with Newmark's gamma and beta.

            dv = gamma h da,     dy = beta h^2 da

        The closures are divided by beta h^2, so that both blocks of J are alike.
        Source: Newmark (1959), A method of computation for structural dynamics, J. Eng. Mech. 85.
        """
        n, at, h = len(self.free), np.ix_(self.free, self.free), self.h
        J = self.J[:, self.free]
        S = np.zeros((n + len(J), n + len(J)))
        S[:n, :n] = self.M[at] + gamma * h * self.C[at] + beta * h**2 * self.K[at]
        S[:n, n:], S[n:, :n] = -J.T, J
        return S, -np.concatenate([self.r[self.free], self.c / (beta * h**2)])


def build_step(mechanism: Mechanism, y: Array, v: Array, h: float, t: float = 0.0) -> StepSystem:
    """The system of equations of one step of level coupled with motors held, to be looked at.

    Predicted is a motion of constant acceleration, that which the equations have at (y, v).

    Args:
        mechanism: With its motors. y, v: State, shapes (nq,) and (nv,) of the flexible mechanism.
        h: Step [s]. t: Its start [s], for loads.
    """
    system = mechanism.loose
    dynamics, held = Equations(system), system.motors
    a, lam = consistent_acceleration(dynamics, y, v, held, np.zeros(len(held)), None, t)
    at, speed = dynamics.integrate(y, h * v + 0.5 * h**2 * a), v + h * a
    r, c = dynamics.residual(at, speed, a, lam, t + h)
    M, C, K, J = dynamics.tangent(at, speed, a, lam, t + h)
    return StepSystem(M, C, K, J, r, c, at, speed, a, lam, h, system.free)


Path = Callable[[Array], MotorPath]
_BESIDE = 1e-10  # of the time: beyond what laws of motion snap to, less than any step to a node


class StepFailed(Exception):
    """Newton did not converge in a step: a shorter one may."""


@dataclass
class State:
    """The state at an instant: t in s, y (nq,), v and a (nv,), lam (rows,), torque (nm,)."""

    t: float
    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array


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
        self.drive, self.sampler = drive, sampler
        self.axes, self.motors = motor_axes(mechanism), system.motors
        self.free = system.free if drive is None else system.unheld

    @property
    def prescribed(self) -> bool:
        """Whether the motors follow their path exactly."""
        return self.drive is None

    def first(self, t: float, y: Array, v: Array) -> State:
        """Consistent accelerations, multipliers and torques at (y, v)."""
        d, path = self.dynamics, self.path(np.array([t]))
        if self.sampler is not None:
            self.sampler.reach(t, y, v)
        u, held, a_held = self.control_force, self.motors, path.acceleration[0]
        if self.drive is None:
            a, lam = consistent_acceleration(d, y, v, held, a_held, None, t, u)
            return State(t, y, v, a, lam, d.residual(y, v, a, lam, t, u).r[self.motors])
        torque = self.pull(path, y[None], v[None])[0]
        a, lam = consistent_acceleration(d, y, v, held[:0], np.zeros(0), torque, t, u)
        return State(t, y, v, a, lam, torque)

    def pull(self, path: MotorPath, y: Array, v: Array, inside: bool = False) -> Array:
        """Torques of driven motors in states, shape (k, nm); what a controller holds is in them.

        `inside`: the states are the stages of a step.
        """
        assert self.drive is not None
        torque = self.drive.pull(path, self.axes, y, v, inside)
        return torque if self.sampler is None else torque + self.sampler.torque

    @property
    def control_force(self) -> Array | None:
        """Generalised forces (nv,) that a digital controller holds now; None: none."""
        return None if self.sampler is None else self.sampler.force

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


def seen_inside(t: Array, c: Array) -> Array:
    """Times of the stages at nodes c of a step as loads see them, (s,).

    Where one switches at an end of the step, it is as it is inside, however that is rounded.
    """
    return t + max(1.0, float(t[-1])) * 1e-12 * (1.0 - 2.0 * c)
