"""One step of the alpha family on the full index-3 equations: Newton on frozen tangents.

Unknown in a step is the increment ds of the algorithmic acceleration, with the closure rows scaled
by 1/(beta h^2), so that the conditioning of the iteration matrix does not depend on the step:

    [ da/ds M + gamma h C + beta h^2 K    J' ] [  ds  ]     [ r            ]
    [ J                                   0  ] [ -dlam] = - [ c/(beta h^2) ]

Positions satisfy c = 0 at every step: they never drift off the closures.
"""

from __future__ import annotations

import contextlib
from math import isfinite, sqrt

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive
from pinflex.actuation.feedback import Feedback, FeedbackState
from pinflex.actuation.motors import motor_axes
from pinflex.arrays import Array
from pinflex.integrators.consistent import consistent_acceleration
from pinflex.integrators.newton import Newton, Step
from pinflex.integrators.problem import Problem
from pinflex.integrators.schemes import AlphaScheme
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism

# Newton stops when the estimated error of the acceleration, weighted by the iteration matrix, is
# this fraction of what the acceleration is at the time: measured on the race scenes, torques and
# platform deviations then differ by 1e-6 at most from those of a tolerance of 1e-10.
NEWTON = 1e-7
MAX_ITERATIONS = 12
_STUCK = 1e-8


class NoConvergence(Exception):
    """Newton did not converge in a step.

    Attributes:
        residual: Where it stopped, by free row (N | N m).
    """

    def __init__(self, residual: Array) -> None:
        super().__init__()
        self.residual = residual


class March:
    """One run: the step, its predictor and its Newton iteration."""

    def __init__(
        self,
        mechanism: Mechanism,
        dynamics: Equations,
        path: MotorPath,
        scheme: AlphaScheme,
        drive: TorqueDrive | None,
        tolerance: float,
        feedback: Feedback | None,
    ) -> None:
        h = float(path.t[-1] - path.t[0]) / (len(path.t) - 1)
        self.dynamics, self.path, self.scheme, self.drive = dynamics, path, scheme, drive
        self.problem = Problem(mechanism, dynamics, lambda _: path, drive)
        self.axes, self.motors = motor_axes(mechanism), dynamics.system.motors
        self.feedback = None if feedback is None else FeedbackState(feedback, dynamics, h)
        self.control_force: Array | None = None  # at the state evaluated last, shape (nv,)
        self.signals = None if self.feedback is None else self.feedback.signals(len(path.t))
        self.newton = Newton(dynamics, scheme, h, drive, self.feedback)
        self.tolerance, self.reference, self.peak = tolerance, 0.0, 0.0
        self.iterations = 0
        nv = dynamics.system.nv
        self._change, self._known = np.zeros(nv), np.empty((4, nv))
        self.h, self.slow, self.weights = h, True, scheme.weights(h)
        self.predictor = _predictor(scheme, h)
        by_a, by_v, _ = self.weights
        self._gains = np.array([[1.0], [by_v], [by_a]])
        # Far from the motion the equations have other roots; ten lengths off is one of them.
        self.farthest = 10.0 * max([1.0, *(s.body.length for s in dynamics.system.expansion.slots)])

    def control(self, k: int, y: Array, v: Array) -> None:
        """Let the feedback act at a state of step k.

        Args:
            k: Number of the step.
            y: Coordinates, shape (nq,).
            v: Velocity, shape (nv,).
        """
        if self.feedback is not None:
            self.control_force = self.feedback.force(float(self.path.t[k]), y, v)

    def step(self, before: Step, guess: tuple[Array, Array], k: int) -> Step:
        """The state at step k.

        Frozen tangents first; where they fail, once more from the last acceleration with the exact
        tangent in every iteration.

        Args:
            before: State at step k - 1.
            guess: Predicted acceleration (nv,) and multipliers (rows,), taken over.
            k: Step number.
        Raises:
            NoConvergence: With the residual it stopped at.
        """
        scale = self.reference, self.peak
        with contextlib.suppress(NoConvergence):
            now = self._attempt(before, guess, k, False)
            if np.max(np.abs(now.y[self.dynamics.nq_rigid :]), initial=0.0) < self.farthest:
                return now
        # What ran away must not loosen the tolerance of what is tried next.
        self.slow, (self.reference, self.peak) = True, scale
        now = self._attempt(before, (before.a.copy(), before.lam.copy()), k, True)
        if not np.max(np.abs(now.y[self.dynamics.nq_rigid :]), initial=0.0) < self.farthest:
            raise NoConvergence(np.full(len(self.newton.free), np.nan))
        return now

    def _attempt(self, before: Step, guess: tuple[Array, Array], k: int, exact: bool) -> Step:
        newton, t = self.newton, float(self.path.t[k])
        now, moving, move = self._predicted(before, guess, k)
        if self.slow or exact:
            newton.refresh(now, t, exact)
        fresh = self.slow
        for iteration in range(MAX_ITERATIONS):
            r, c = self._balance(now, k, t)
            ds, dlam = newton.step(r[newton.free], c)
            self.iterations += 1
            size = sqrt((newton.weight * ds) @ ds)
            if not isfinite(size):
                break
            self._correct(now, before, moving, move, ds, dlam, k)
            if self._converged(iteration, size, now, r, c):
                if self.drive is None:
                    now.torque = self._motor_forces(r, ds, dlam)
                else:
                    now.torque = self.drive.torque(k, self.path, self.axes, now.y, now.v)
                self.slow = newton.rate > 0.1
                self._follow(newton.size(now.a))
                return now
            aged = iteration >= 2 and newton.rate > 0.3 and (not fresh or iteration > 4)
            if aged or exact:
                newton.refresh(now, t, exact)
            fresh = fresh or aged
        raise NoConvergence(r[newton.free])

    def _predicted(
        self, before: Step, guess: tuple[Array, Array], k: int
    ) -> tuple[Step, Array, Array]:
        """The state at step k by a guess of a and lam, its rows s, v and a, and the move to it."""
        motors, path, known = self.motors, self.path, self._known
        prescribed, (a, lam) = self.drive is None, guess
        if prescribed:
            a[motors] = path.acceleration[k]
        known[0], known[1], known[2], known[3] = a, before.a, before.s, before.v
        # Rows s, v and a share one array, so that a correction is one product.
        moving = self.predictor @ known
        s, v, move = moving[0], moving[1], moving[2].copy()
        moving[2] = a
        y = self.dynamics.integrate(before.y, move)
        now = Step(y, v, moving[2], s, lam, before.torque)
        if prescribed:
            s[motors] = path.acceleration[k]
            self.axes.write(y, path.position[k])
            v[motors] = path.velocity[k]
        return now, moving, move

    def _balance(self, now: Step, k: int, t: float) -> tuple[Array, Array]:
        """Residual (nv,), that of motors without their torque, and closures (rows,)."""
        self.control(k, now.y, now.v)
        r, c = self.dynamics.residual(now.y, now.v, now.a, now.lam, t, self.control_force)
        if self.drive is not None:
            now.torque = self.drive.torque(k, self.path, self.axes, now.y, now.v)
            r[self.motors] -= now.torque
        return r, c

    def _correct(
        self, now: Step, before: Step, moving: Array, move: Array, ds: Array, dlam: Array, k: int
    ) -> None:
        """Move a state by a correction of s and lam."""
        change, to_y = self._change, self.weights[2]
        change[self.newton.free] = ds
        moving += self._gains * change
        now.lam += dlam
        if self.dynamics.vector_space:
            now.y += to_y * change
            return
        move += to_y * change
        now.y = self.dynamics.integrate(before.y, move)
        if self.drive is None:
            self.axes.write(now.y, self.path.position[k])

    def _converged(self, iteration: int, size: float, now: Step, r: Array, c: Array) -> bool:
        """Whether corrections, the last of a norm `size`, have brought the state close enough."""
        newton = self.newton
        left = newton.left(iteration, size)
        if iteration >= 2 and left > max(self.tolerance * self.reference, newton.noise):
            self.reference = max(self.reference, newton.size(now.a))
        goal = max(self.tolerance * self.reference, 0.01 * newton.noise)
        if left <= goal and newton.closed(c):
            return True
        # What cannot be moved any more has to balance to this part of the inertia forces.
        rough = max(goal, _STUCK * self.reference)
        return newton.stuck and newton.spent(r[newton.free], c, rough)

    def _motor_forces(self, r: Array, ds: Array, dlam: Array) -> Array:
        """Torques of prescribed motors, with what the last correction adds."""
        newton = self.newton
        torque = r[self.motors] + newton.motor_rows @ ds
        return np.asarray(torque - newton.J_motors.T @ dlam if newton.rows else torque)

    def _follow(self, size: float) -> None:
        """Let the scale of the tolerance follow the acceleration.

        A hard start must not loosen what comes after it; a thousandth of the peak stays, because
        below that lies its round-off.
        """
        self.peak = max(self.peak, size)
        self.reference = max(size, 0.9 * self.reference, 1e-3 * self.peak)

    def quiet_start(self, first: Step, k: int) -> Step:
        """A state at step k whose velocity lets the multipliers start without an O(h) transient.

        The scheme's own solution meets J v = 0 only to O(h^2); an exact v0 is off that solution and
        rings in lam. The normal part of v0 is set so that the first step ends with the multipliers
        that belong to its pose and velocity (cf. Arnold, Bruels and Cardona 2015, section 5).

        Args:
            first: State with consistent accelerations.
            k: Number of its step.
        """
        dynamics, newton = self.dynamics, self.newton
        if not newton.rows:
            return first
        after = self.step(first, (first.a.copy(), first.lam.copy()), k + 1)
        held = self.motors if self.drive is None else self.motors[:0]
        tau = None if self.drive is None else after.torque
        a_held = self.path.acceleration[k + 1][: len(held)]
        _, lam = consistent_acceleration(
            dynamics, after.y, after.v, held, a_held, tau, float(self.path.t[k + 1]),
            self.control_force,
        )  # fmt: skip
        free, scheme = newton.free, self.scheme
        M = dynamics.mass(first.y)[np.ix_(free, free)]
        J = dynamics.close(first.y).J[:, free]
        mu = (scheme.beta * self.h / scheme.mass_factor) * (after.lam - lam)
        v = first.v.copy()
        v[free] += np.linalg.lstsq(M, J.T @ mu, rcond=1e-14)[0]
        return Step(first.y, v, first.a, first.s, first.lam, first.torque)

    def first(self, y: Array, v: Array, k: int) -> Step:
        """Consistent accelerations and multipliers, s = a(t + (alpha_m - alpha_f) h), at step k.

        The slope of a comes from a second consistent state a fraction of a step away.

        Args:
            y: Coordinates on the closures, shape (nq,).
            v: Velocity, shape (nv,).
            k: Number of the step.
        """
        dynamics, path, drive, scheme = self.dynamics, self.path, self.drive, self.scheme
        motors, motor_a = self.motors, path.acceleration
        t = float(path.t[k])

        def accelerate(y: Array, v: Array, part: float) -> tuple[Array, Array]:
            self.control(k, y, v)
            held, a_held = motors, motor_a[k] * (1 - part) + motor_a[k + 1] * part
            tau: Array | None = None
            if drive is not None:
                held, a_held = motors[:0], np.zeros(0)
                tau = drive.torque(k, path, self.axes, y, v)
            return consistent_acceleration(dynamics, y, v, held, a_held, tau, t, self.control_force)

        a, lam = accelerate(y, v, 0.0)
        part = 0.01
        dt = part * self.h
        ahead = dynamics.integrate(y, dt * v + 0.5 * dt * dt * a)
        a_ahead, _ = accelerate(ahead, v + dt * a, part)
        s = a + (a_ahead - a) * ((scheme.alpha_m - scheme.alpha_f) / part)
        self.control(k, y, v)
        r, _ = dynamics.residual(y, v, a, lam, t, self.control_force)
        torque = r[motors] if drive is None else drive.torque(k, path, self.axes, y, v)
        return Step(y.copy(), v.copy(), a, s, lam, torque)

    def bent(self, now: Step, k: int) -> Step:
        """The state at step k, where motor accelerations bend: s goes on along the new slope.

        a is that of the equations already. Made anew from y and v, as at a start, the slope of s
        would take the vibrations that no step resolves, and raise them from bend to bend; only
        what the motors change is added.

        Args:
            now: State at the step, on its way.
            k: Its number.
        """
        if self.drive is not None or not 0 < k < len(self.path.t) - 1:
            return self.first(now.y, now.v, k)
        before, here, after = self.path.acceleration[k - 1 : k + 2]
        t, scheme = float(self.path.t[k]), self.scheme
        self.control(k, now.y, now.v)
        straight, bent = (
            consistent_acceleration(
                self.dynamics, now.y, now.v, self.motors, a, None, t, self.control_force
            )[0]
            for a in (here, here + (after - 2 * here + before))
        )
        s = now.s + (scheme.alpha_m - scheme.alpha_f) * (bent - straight)
        return Step(now.y, now.v, now.a, s, now.lam, now.torque)

    def set_scale(self, now: Step, k: int) -> None:
        """Acceleration scale of a run at step k, before it moves: what static forces could do.

        Args:
            now: State at the step.
            k: Its number.
        """
        dynamics, newton, t = self.dynamics, self.newton, float(self.path.t[k])
        newton.refresh(now, t)
        still, straight = np.zeros(dynamics.system.nv), now.y.copy()
        straight[dynamics.nq_rigid :] = 0.0
        none = np.zeros(dynamics.system.closed.n)
        left, _ = dynamics.residual(straight, still, still, none, t, self.control_force)
        force = left[newton.free]
        static = float(np.sqrt(force @ (force / np.maximum(newton.weight, 1e-300))))
        self.reference = max(static, newton.size(now.a), 1e-12)


def _predictor(scheme: AlphaScheme, h: float) -> Array:
    """From a, and the a, s and v before it, to s, v and the move of a step of h (s), (3, 4)."""
    am, af, beta, gamma = scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma
    _, to_v, to_y = scheme.weights(h)
    algorithmic = np.array([1.0 - af, af, -am, 0.0]) / (1.0 - am)
    return np.array([
        algorithmic,
        to_v * algorithmic + [0.0, 0.0, h * (1.0 - gamma), 1.0],
        to_y * algorithmic + [0.0, 0.0, h * h * (0.5 - beta), h],
    ])  # fmt: skip
