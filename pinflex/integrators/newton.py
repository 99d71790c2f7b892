"""The iteration matrix of the coupled level: factored once, kept while it contracts."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from pinflex.actuation.drive import TorqueDrive
from pinflex.actuation.feedback import FeedbackState
from pinflex.arrays import Array
from pinflex.integrators.schemes import AlphaScheme
from pinflex.linalg import lapack
from pinflex.mechanics.equations import Equations


@dataclass
class Step:
    """The state that moves through the run."""

    y: Array
    v: Array
    a: Array
    s: Array
    lam: Array
    torque: Array


class Newton:
    """Iteration matrix of one run: factored once, kept while it contracts."""

    def __init__(
        self,
        dynamics: Equations,
        scheme: AlphaScheme,
        h: float,
        drive: TorqueDrive | None,
        feedback: FeedbackState | None,
    ):
        self._factor, self._solve = lapack().dgetrf, lapack().dgetrs
        system = dynamics.system
        self.dynamics, self.scheme, self.h, self.drive = dynamics, scheme, h, drive
        self.feedback = feedback
        self.free = system.free if drive is None else system.unheld
        self.motors = system.motors
        self.n, self.rows = len(self.free), system.closed.n
        self.S = np.zeros((self.n + self.rows, self.n + self.rows), order="F")
        self.count = 0
        self.rate, self._previous, self._second, self._usual = 1.0, 0.0, 0.0, np.inf
        self.stuck = False

    def refresh(self, step: Step, t: float, exact: bool = False) -> None:
        """New tangent at a state at time t (s); raises numpy's LinAlgError when it is singular.

        Args:
            step: Last state that is known.
            t: Time [s].
            exact: Whether the rates of second-order rows count, as where links accelerate wildly.
        """
        n, weights = self.n, self.scheme.weights(self.h)
        state = step.y, step.v, step.a, step.lam
        full, J = self.dynamics.iteration_matrix(*state, t, weights, exact)
        if self.drive is not None:
            push = weights[2] * self.drive.kp + weights[1] * self.drive.kd
            full[self.motors, self.motors] += push
        if self.feedback is not None:
            by_y, by_v = self.feedback.gains(step.y, step.v)
            full -= weights[2] * by_y + weights[1] * by_v
        S = self.S
        S[:n, :n] = full[np.ix_(self.free, self.free)]
        self.weight = np.abs(np.diag(S)[:n]).copy()
        # Positions are known to 1e-15 (m, rad); as accelerations that is this much noise.
        self.noise = 1e-15 / weights[2] * float(np.sqrt(self.weight.sum()))
        if self.rows:
            S[:n, n:] = J[:, self.free].T
            S[n:, :n] = J[:, self.free]
            self.J_motors = J[:, self.motors]
        self.motor_rows = full[np.ix_(self.motors, self.free)]
        self.count += 1
        self.rate, self._usual = 0.1, np.inf
        if not len(S):  # every coordinate is a motor: nothing to iterate on
            return
        self.lu, self.pivots, info = self._factor(S)
        if info > 0 or not np.all(np.isfinite(self.lu)):
            raise np.linalg.LinAlgError("singular iteration matrix")

    def size(self, a: Array) -> float:
        """Norm of an acceleration (nv,) in the weights of the matrix."""
        free = a[self.free]
        return sqrt((self.weight * free) @ free)

    def closed(self, c: Array) -> bool:
        """Whether the loops, open by c before the last correction, are closed after it.

        A correction leaves a hundredth of c at most: 1e-11 m.
        """
        return not self.rows or float(np.abs(c).max()) < 1e-9

    def left(self, iteration: int, size: float) -> float:
        """Error that the corrections of a step leave, from their sizes so far.

        The first correction is the predictor's error, the second what it bent the equations by;
        only from then on do ratios show how the iteration contracts. Where a step ends before
        that, the rate of an earlier one holds as long as its second correction was like this one.

        Args:
            iteration: Number of the correction, from 0.
            size: Its norm, as by `size`.
        """
        rate = 0.5
        if iteration >= 1:
            ratio = size / max(self._previous, 1e-300)
            if iteration == 1:
                self._second = ratio
                if self._usual == np.inf:
                    self._usual = max(ratio, 1e-6)  # below that it is round-off
                rate = self.rate * max(1.0, ratio / self._usual)
            else:
                self.rate = rate = max(ratio, 1e-3)
                self._usual = self._second
        self.stuck = iteration >= 3 and size > 0.5 * self._previous
        self._previous = size
        return size * rate / (1.0 - rate) if rate < 0.9 else np.inf

    def spent(self, r: Array, c: Array, goal: float) -> bool:
        """Whether forces balance to a goal (or round-off) and loops are shut to round-off.

        Next to a singular pose round-off alone moves the weak direction by more than the goal.

        Args:
            r: Residual forces of the free rows [N | N m], shape (n,).
            c: Closures [m | rad], shape (rows,).
            goal: Norm of r that is small enough.
        """
        force = float(np.sqrt(r @ (r / np.maximum(self.weight, 1e-300))))
        return force <= max(goal, self.noise) and float(np.abs(c).max(initial=0.0)) < 1e-13

    def step(self, r: Array, c: Array) -> tuple[Array, Array]:
        """ds (n,) and dlam (rows,) from the residual.

        Args:
            r: Residual forces of the free rows [N | N m], shape (n,).
            c: Closures [m | rad], shape (rows,).
        """
        b = np.empty(self.n + self.rows)
        np.negative(r, out=b[: self.n])
        if self.rows:
            np.multiply(c, -1.0 / (self.scheme.beta * self.h * self.h), out=b[self.n :])
        if not len(b):
            return b, b
        x, _ = self._solve(self.lu, self.pivots, b)
        return x[: self.n], -x[self.n :]
