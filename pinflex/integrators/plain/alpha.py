"""Equal steps of the alpha family in plain Python: the reference of the compiled ones, and their
stand-in; and where both begin.

Unknown in a step is the increment ds of the algorithmic acceleration, with the closure rows scaled
by 1/(beta h^2), so that the conditioning of the iteration matrix does not depend on the step:

    [ da/ds M + gamma h C + beta h^2 K    J' ] [  ds  ]     [ r            ]
    [ J                                   0  ] [ -dlam] = - [ c/(beta h^2) ]

Positions satisfy c = 0 at every step: they never drift off the closures.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinflex.actuation.feedback import Feedback, FeedbackState
from pinflex.arrays import Array, IntArray
from pinflex.integrators.collocation import AlphaScheme
from pinflex.integrators.problem import Problem, Run, Settings, StepFailed
from pinflex.linalg import saddle_matrix
from pinflex.mechanics.evaluation.equations import Equations

if TYPE_CHECKING:
    from pinflex.actuation.drive import TorqueDrive
    from pinflex.actuation.path import MotorPath
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.mechanics.model.system import System

MAX_ITERATIONS = 12
# Contraction above which the next iteration has a new tangent, and above which it is none; then
# corrections may be this many times what positions known to 1e-15 (m, rad) make of accelerations.
_SLOW, _STALLED, _NOISE = 0.1, 0.7, 1e3


class Step(NamedTuple):
    """The state that moves through the run: y (nq,), v, a, s (nv,), lam (rows,), torque (nm,)."""

    y: Array
    v: Array
    a: Array
    s: Array
    lam: Array
    torque: Array


class PlainAlpha:
    """The steps of one run, and where they begin.

    Attributes:
        problem: What is solved. h: Step [s]. predictor: From a, and the a, s and v before it, to
            s, v and the move, shape (3, 4). weights: Of M, C and K.
        tolerance: Newton's, of what the acceleration is at the time.
        columns: y, v, a, s, lam, torque and power at all instants, each (steps, n), where they are
            known; signals: of the feedback there, or None.
        control_force: Of the feedback at the state evaluated last, shape (nv,); None: none acts.
        farthest: m or rad that an elastic coordinate may go. iterations, tangents: Counts.
    """

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
        h = self.h = float(path.t[-1] - path.t[0]) / (len(path.t) - 1)
        self.dynamics, self.path, self.scheme, self.drive = dynamics, path, scheme, drive
        self.problem = Problem(mechanism, dynamics, lambda _: path, drive)
        self.feedback = None if feedback is None else FeedbackState(feedback, dynamics, h)
        self.control_force: Array | None = None
        self.signals = None if self.feedback is None else self.feedback.signals(len(path.t))
        self.weights, self.predictor = scheme.weights(h), _predictor(scheme, h)
        self.tolerance, self.iterations, self.tangents = tolerance, 0, 0
        system, n = dynamics.system, len(path.t)
        widths = (system.nq, *(system.nv,) * 3, system.closed.n, len(system.motors), 2)
        self.columns = tuple(np.zeros((n, width)) for width in widths)
        self._S: Array | None = None  # Newton's matrix
        self._weight, self._noise = np.zeros(0), 0.0  # of free accelerations
        # Far from the motion the equations have other roots; ten lengths off is one of them.
        self.farthest = 10.0 * max([1.0, *(s.body.length for s in dynamics.system.expansion.slots)])

    def control(self, k: int, y: Array, v: Array) -> None:
        """Let the feedback act at a state of step k: y (nq,), v (nv,)."""
        if self.feedback is not None:
            self.control_force = self.feedback.force(float(self.path.t[k]), y, v)

    def advance(self, k: int, now: Step, last: Step, upto: int) -> tuple[int, Step, Step]:
        """Steps from k on, here one: the number of the last one, and the states there and before.

        Raises:
            StepFailed: The first step fails. LinAlgError: Its matrix is singular.
        """
        after = self.step(k + 1, now, last)
        self.keep(k + 1, after)
        return k + 1, after, now

    def keep(self, k: int, now: Step) -> None:
        """Record step k; a feedback goes on from there."""
        losses = self.dynamics.losses(now.y[None], now.v[None])[0]
        power = np.array([now.torque @ now.v[self.problem.motors], losses])
        for column, values in zip(self.columns, (*now, power), strict=True):
            column[k] = values
        if self.feedback is not None and self.signals is not None:
            self.control(k, now.y, now.v)
            assert self.control_force is not None
            self.feedback.keep()
            self.signals.u[k], self.signals.measured[k] = self.feedback.u, self.feedback.m
            self.columns[-1][k, 0] += float(self.control_force @ now.v)

    def settle(self, at: IntArray) -> None:
        """Accelerations and forces at some steps, of the motion as it is there."""
        y, v, a, _, lam, torque, _ = self.columns
        for k in at:
            a[k], lam[k] = self.accelerated(k, y[k], v[k], self.path.acceleration[k])
            torque[k] = self.residual(k, y[k], v[k], a[k], lam[k])[2]

    def run(self, system: System, begin: int, upto: int) -> Run:
        """The steps from one to another as a run of a system; work by the trapezoidal rule."""
        k, steps, h = slice(begin, upto + 1), upto - begin, self.h
        counts = {"steps": steps, "newton": self.iterations, "tangents": self.tangents}
        settings: Settings = {"integrator": self.scheme.name, "dt": h, "gamma": self.scheme.gamma}
        if self.feedback is not None and self.feedback.feedback.linear is None:
            settings["march"] = "in Python: control.law is a function (one of pf.pid runs compiled)"
        y, v, a, s, lam, torque, power = (column[k] for column in self.columns)
        work = np.zeros((steps + 1, 2))
        np.cumsum(0.5 * h * (power[1:] + power[:-1]), axis=0, out=work[1:])
        signals = None if self.signals is None else self.signals.at(k)
        return Run(
            system, self.path.t[k], y, v, a, lam, torque, dict(counts), settings, work,
            signals=signals, s=s,
        )  # fmt: skip

    def step(self, k: int, now: Step, last: Step) -> Step:
        """The state at step k: prescribe and predict, then residual and correct until it is near.

        Raises:
            StepFailed: With the residual it stopped at. LinAlgError: The matrix is singular.
        """
        free, (mass, by_v, by_y) = self.problem.free, self.weights
        a, s, v, move, lam = self.predict(k, now, last)
        ds, size, before, rate, close = np.zeros_like(a), np.inf, np.inf, 0.0, False
        for _ in range(MAX_ITERATIONS + 1):
            y = self.dynamics.integrate(now.y, move)
            self.prescribe(k, y)
            r, c, torque = self.residual(k, y, v, a, lam)
            near = np.max(np.abs(y[self.dynamics.nq_rigid :]), initial=0.0) < self.farthest
            if close and near:
                return Step(y, v, a, s, lam, torque)
            if self._S is None or rate > _SLOW:
                self._S = self._squared(*self.matrix(k, y, v, a, lam))
            ds[free], dlam = self.correct(r, c)
            s, v, a, move = s + ds, v + by_v * ds, a + mass * ds, move + by_y * ds
            lam, earlier, before, size = lam + dlam, before, size, self._size(ds)
            self.iterations += 1
            if not isfinite(size):
                break
            rate = size / before
            close = size <= max(self.tolerance * self._size(a), self._noise)
            # Displacements answer forces, and these those: corrections may shrink every other time.
            stalled = size > _STALLED * max(before, earlier)
            close |= stalled and size <= _NOISE * self._noise
        raise StepFailed(r[free] if near else np.nan)

    def prescribe(self, k: int, y: Array) -> None:
        """Write the motors' positions at step k into a pose y (nq,), where they follow a path."""
        if self.problem.prescribed:
            self.problem.axes.write(y, self.path.position[k])

    def predict(self, k: int, now: Step, last: Step) -> tuple[Array, Array, Array, Array, Array]:
        """a, s, v, the move and lam: straight on from two states, motors as step k prescribes."""
        p, path, a, lam = self.problem, self.path, 2.0 * now.a - last.a, 2.0 * now.lam - last.lam
        if p.prescribed:
            a[p.motors] = path.acceleration[k]
        s, v, move = self.predictor @ np.array([a, now.a, now.s, now.v])
        if p.prescribed:
            s[p.motors], v[p.motors] = path.acceleration[k], path.velocity[k]
        return a, s, v, move, lam

    def matrix(
        self, k: int, y: Array, v: Array, a: Array, lam: Array, rates: bool = True
    ) -> tuple[Array, Array]:
        """Newton's matrix of all rows (nv, nv), and J (rows, nv), at a state of step k.

        `rates`: whether those of second-order rows count, as where links accelerate wildly.
        """
        p, t, (_, by_v, by_y) = self.problem, float(self.path.t[k]), self.weights
        full, J = self.dynamics.iteration_matrix(y, v, a, lam, t, self.weights, rates)
        if self.drive is not None:
            full[p.motors, p.motors] += by_y * self.drive.kp + by_v * self.drive.kd
        if self.feedback is not None:
            of_y, of_v = self.feedback.gains(y, v)
            full -= by_y * of_y + by_v * of_v
        self.tangents += 1
        return full, J

    def _squared(self, full: Array, J: Array) -> Array:
        """The matrix of free rows and closures, whose diagonal weighs accelerations from now on."""
        free = self.problem.free
        S = saddle_matrix(full[np.ix_(free, free)], J[:, free])
        self._weight = np.abs(np.diag(S)[: len(free)])
        self._noise = 1e-15 / self.weights[2] * float(np.sqrt(self._weight.sum()))
        if not np.isfinite(S).all():
            raise np.linalg.LinAlgError("an iteration matrix that is no number")
        return S

    def _size(self, a: Array) -> float:
        """Norm of an acceleration (nv,) in the weights of the matrix."""
        free = a[self.problem.free]
        return sqrt((self._weight * free) @ free)

    def correct(self, r: Array, c: Array) -> tuple[Array, Array]:
        """ds (n,) and dlam (rows,) from free residuals and closures."""
        n = len(self.problem.free)
        assert self._S is not None
        x = np.linalg.solve(self._S, -np.concatenate([r[self.problem.free], c / self.weights[2]]))
        return x[:n], x[n:]

    def residual(
        self, k: int, y: Array, v: Array, a: Array, lam: Array
    ) -> tuple[Array, Array, Array]:
        """Residual (nv,), closures (rows,) and torques of the motors (nm,) at a state of step k."""
        p = self.problem
        self.control(k, y, v)
        r, c = self.dynamics.residual(y, v, a, lam, float(self.path.t[k]), self.control_force)
        if self.drive is None:
            return r, c, r[p.motors]
        torque = self.drive.torque(k, self.path, p.axes, y, v)
        r[p.motors] -= torque
        return r, c, torque

    def accelerated(self, k: int, y: Array, v: Array, a_motors: Array) -> tuple[Array, Array]:
        """Consistent accelerations and multipliers; those of the motors hold where they are led."""
        p, drive, t = self.problem, self.drive, float(self.path.t[k])
        self.control(k, y, v)
        torque = None if drive is None else drive.torque(k, self.path, p.axes, y, v)
        return p.accelerated(t, y, v, a_motors, torque, self.control_force)

    def first(self, y: Array, v: Array, k: int) -> Step:
        """Consistent accelerations and multipliers, s = a(t + (alpha_m - alpha_f) h), at step k.

        The slope of a comes from a second consistent state a fraction of a step away. One that
        changes accelerations within a step by more than they and the motors' are is of vibrations
        that no step resolves: it would throw the first step off, and s = a there.
        """
        scheme, part, motor_a = self.scheme, 0.01, self.path.acceleration
        a, lam = self.accelerated(k, y, v, motor_a[k])
        dt = part * self.h
        ahead = self.dynamics.integrate(y, dt * v + 0.5 * dt * dt * a)
        between = motor_a[k] * (1 - part) + motor_a[min(k + 1, len(motor_a) - 1)] * part
        a_ahead, _ = self.accelerated(k, ahead, v + dt * a, between)
        s = a + (a_ahead - a) * ((scheme.alpha_m - scheme.alpha_f) / part)
        known = max(np.max(np.abs(x), initial=0.0) for x in (a, motor_a))
        if np.max(np.abs(s - a), initial=0.0) > known:
            s = a.copy()
        return Step(y.copy(), v.copy(), a, s, lam, self.residual(k, y, v, a, lam)[2])

    def bent(self, now: Step, k: int) -> Step:
        """The state at step k, where motor accelerations bend: s goes on along the new slope.

        a is that of the equations already. Made anew from y and v, as at a start, the slope of s
        would take the vibrations that no step resolves, and raise them from bend to bend; only
        what the motors change is added.
        """
        if self.drive is not None or not 0 < k < len(self.path.t) - 1:
            return self.first(now.y, now.v, k)
        before, here, after = self.path.acceleration[k - 1 : k + 2]
        straight, bent = (
            self.accelerated(k, now.y, now.v, a)[0]
            for a in (here, here + (after - 2 * here + before))
        )
        s = now.s + (self.scheme.alpha_m - self.scheme.alpha_f) * (bent - straight)
        return Step(now.y, now.v, now.a, s, now.lam, now.torque)

    def quiet(self, first: Step, after: Step, k: int) -> Step:
        """A state at step k whose velocity lets the multipliers start without an O(h) transient.

        The scheme's own solution meets J v = 0 only to O(h^2); an exact v0 is off that solution and
        rings in lam. The normal part of v0 is set so that the first step ends with the multipliers
        that belong to its pose and velocity (cf. Arnold, Bruels and Cardona 2015, section 5).
        """
        dynamics, free, scheme = self.dynamics, self.problem.free, self.scheme
        _, lam = self.accelerated(k + 1, after.y, after.v, self.path.acceleration[k + 1])
        M = dynamics.mass(first.y, float(self.path.t[k]))[np.ix_(free, free)]
        J = dynamics.close(first.y).J[:, free]
        mu = (scheme.beta * self.h / scheme.mass_factor) * (after.lam - lam)
        v = first.v.copy()
        v[free] += np.linalg.lstsq(M, J.T @ mu, rcond=1e-14)[0]
        return Step(first.y, v, first.a, first.s, first.lam, first.torque)


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
