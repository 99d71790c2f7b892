"""The coupled level: the full index-3 equations by the alpha family, Newton on frozen tangents.

Unknown in a step is the increment ds of the algorithmic acceleration, with the closure rows scaled
by 1/(beta h^2), so that the conditioning of the iteration matrix does not depend on the step:

    [ da/ds M + gamma h C + beta h^2 K    J' ] [  ds  ]     [ r            ]
    [ J                                   0  ] [ -dlam] = - [ c/(beta h^2) ]

Positions satisfy c = 0 at every step: they never drift off the closures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.drive import MotorPath, TorqueDrive
from pinflex.dynamics import Dynamics
from pinflex.errors import ConvergenceError
from pinflex.integrators import AlphaScheme
from pinflex.mechanism import Mechanism
from pinflex.nominal import motor_axes
from pinflex.run import Run
from pinflex.start import consistent_acceleration

# Newton stops when the estimated error of the acceleration, weighted by the iteration matrix, is this
# fraction of the largest so far: torques then carry 1e-7 from Newton, below any step error in use.
NEWTON = 1e-7
_MAX_ITERATIONS = 12


@dataclass
class _Step:
    """The state that moves through the run."""

    y: Array
    v: Array
    a: Array
    s: Array
    lam: Array


class _Newton:
    """Iteration matrix of one run: factored once, kept while it contracts."""

    def __init__(self, dynamics: Dynamics, scheme: AlphaScheme, h: float, drive: TorqueDrive | None):
        from scipy.linalg.lapack import dgetrf, dgetrs

        self._factor, self._solve = dgetrf, dgetrs
        system = dynamics.system
        self.dynamics, self.scheme, self.h, self.drive = dynamics, scheme, h, drive
        self.free = system.free if drive is None else np.arange(system.nv)
        self.motors = system.motors
        self.n, self.rows = len(self.free), system.closed.n
        self.S = np.zeros((self.n + self.rows, self.n + self.rows), order="F")
        self.count = 0
        self.rate = 1.0

    def refresh(self, step: _Step) -> None:
        """New tangent at a state; raises numpy's LinAlgError when it is singular."""
        scheme, h, n = self.scheme, self.h, self.n
        weights = (scheme.mass_factor, scheme.gamma * h, scheme.beta * h * h)
        full = self.dynamics.iteration_matrix(step.y, step.v, step.a, step.lam, weights, False)
        if self.drive is not None:
            push = weights[2] * self.drive.kp + weights[1] * self.drive.kd
            full[self.motors, self.motors] += push
        S = self.S
        S[:n, :n] = full[np.ix_(self.free, self.free)]
        self.weight = np.abs(np.diag(S)[:n]).copy()
        if self.rows:
            J = self.dynamics.jacobian()
            S[:n, n:] = J[:, self.free].T
            S[n:, :n] = J[:, self.free]
            self.J_motors = J[:, self.motors]
        self.motor_rows = full[np.ix_(self.motors, self.free)]
        self.lu, self.pivots, info = self._factor(S)
        if info > 0 or not np.all(np.isfinite(self.lu)):
            raise np.linalg.LinAlgError("singular iteration matrix")
        self.count += 1
        self.rate = 1e-2

    def step(self, r: Array, c: Array) -> tuple[Array, Array]:
        """ds (n,) and dlam (rows,) from the residual."""
        b = np.empty(self.n + self.rows)
        np.negative(r, out=b[: self.n])
        if self.rows:
            np.multiply(c, -1.0 / (self.scheme.beta * self.h * self.h), out=b[self.n :])
        x, _ = self._solve(self.lu, self.pivots, b)
        return x[: self.n], -x[self.n :]


def integrate(
    mechanism: Mechanism,
    dynamics: Dynamics,
    start: tuple[Array, Array],
    path: MotorPath,
    scheme: AlphaScheme,
    drive: TorqueDrive | None = None,
    tolerance: float = NEWTON,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """March the full equations over the steps of a motor path.

    Args:
        mechanism: Mechanism. dynamics: Workspace of its flexible (or rigid) system.
        start: y (nq,) and v (nv,) on the closures.
        path: Motor motion at every step (equal steps).
        scheme: Member of the alpha family.
        drive: None prescribes the motors and answers with their torque; else motors get a torque.
        tolerance: Newton's, relative to the largest acceleration so far.
        progress: Called with (step, steps).
    Returns:
        States, multipliers and torques at every step.
    Raises:
        ConvergenceError: With `.result` (a Run) up to the last good step.
    """
    system = dynamics.system
    t, steps = path.t, len(path.t) - 1
    h = float(t[-1] - t[0]) / steps
    axes, motors = motor_axes(mechanism), system.motors
    newton = _Newton(dynamics, scheme, h, drive)
    prescribed = drive is None
    y, v = start[0].copy(), start[1].copy()
    nm = len(motors)
    Y, V = np.empty((steps + 1, system.nq)), np.empty((steps + 1, system.nv))
    A, L = np.empty_like(V), np.empty((steps + 1, system.closed.n))
    T, work = np.empty((steps + 1, nm)), np.zeros((steps + 1, 2))
    step, T[0] = _first_state(dynamics, y, v, path, h, scheme, drive, axes)
    Y[0], V[0], A[0], L[0] = step.y, step.v, step.a, step.lam
    reference = _force_scale(dynamics, step, newton)
    counts = {"steps": 0, "newton": 0, "tangents": 0}

    def run(upto: int, stopped: str = "") -> Run:
        counts["tangents"] = newton.count
        k = slice(0, upto + 1)
        return Run(
            system, t[k], Y[k], V[k], A[k], L[k], T[k], dict(counts),
            {"integrator": scheme.name, "dt": h}, work[k], (), stopped,
        )  # fmt: skip

    af, am, beta, gamma = scheme.alpha_f, scheme.alpha_m, scheme.beta, scheme.gamma
    mf, free = scheme.mass_factor, newton.free
    damped = dynamics.damped
    power0 = _power(T[0], step.v, motors, system.D, damped)
    slow = True
    a_last, change = step.a, np.zeros(system.nv)
    for k in range(1, steps + 1):
        extrapolated = step.a if k < 3 else 2.0 * step.a - a_last
        s = ((1.0 - af) * extrapolated + af * step.a - am * step.s) / (1.0 - am)
        move = h * step.v + (h * h * (0.5 - beta)) * step.s
        swift = step.v + (h * (1.0 - gamma)) * step.s
        now = _Step(step.y, step.v, extrapolated.copy(), s, step.lam.copy())
        if prescribed:
            now.a[motors] = path.acceleration[k]
            now.s[motors] = path.acceleration[k]

        move += (h * h * beta) * now.s
        now.y = dynamics.integrate(step.y, move)
        now.v = swift + (h * gamma) * now.s
        if prescribed:
            axes.write(now.y, path.position[k])
            now.v[motors] = path.velocity[k]
        if slow:
            newton.refresh(now)
        previous = 0.0
        converged, fresh = False, slow
        for iteration in range(_MAX_ITERATIONS):
            r = dynamics.residual(now.y, now.v, now.a, now.lam)
            if drive is not None:
                tau = _torque(drive, k, path, axes, now)
                r[motors] -= tau
            ds, dlam = newton.step(r[free], dynamics.closed.c)
            counts["newton"] += 1
            size = float(np.sqrt((newton.weight * ds) @ ds))
            if not np.isfinite(size):
                break
            change[free] = ds
            now.s += change
            now.a += mf * change
            now.v += (h * gamma) * change
            now.lam += dlam
            if dynamics.vector_space:
                now.y += (h * h * beta) * change
            else:
                move += (h * h * beta) * change
                now.y = dynamics.integrate(step.y, move)
                if prescribed:
                    axes.write(now.y, path.position[k])
            if iteration:
                newton.rate = max(size / previous, 1e-3) if previous > 0 else newton.rate
            rate = newton.rate
            left = size * rate / (1 - rate) if rate < 0.9 else np.inf
            if left > tolerance * reference:
                a_free = now.a[free]
                reference = max(reference, float(np.sqrt((newton.weight * a_free) @ a_free)))
            if left <= tolerance * reference:
                converged = True
                break
            if iteration and newton.rate > 0.3 and not fresh:
                newton.refresh(now)
                fresh = True
            elif iteration > 4 and newton.rate > 0.5:
                newton.refresh(now)
            previous = size
        if not converged:
            raise _diverged(mechanism, dynamics, now, t[k], k, h, r[free], run(k - 1, "diverged"))
        slow = iteration >= 3 or newton.rate > 0.2
        torque = tau if drive is not None else r[motors] + newton.motor_rows @ ds
        if prescribed and newton.rows:
            torque -= newton.J_motors.T @ dlam
        a_last, step = step.a, now
        Y[k], V[k], A[k], L[k], T[k] = now.y, now.v, now.a, now.lam, torque
        power = _power(torque, now.v, motors, system.D, damped)
        work[k] = work[k - 1] + (0.5 * h) * (power0 + power)
        power0 = power
        counts["steps"] = k
        if progress is not None and k % 64 == 0:
            progress(k, steps)
    return run(steps)


def _first_state(
    dynamics: Dynamics,
    y: Array,
    v: Array,
    path: MotorPath,
    h: float,
    scheme: AlphaScheme,
    drive: TorqueDrive | None,
    axes: object,
) -> tuple[_Step, Array]:
    """Consistent accelerations, and s one averaging interval on, which keeps lam at second order.

    s approximates a(t0 + (alpha_m - alpha_f) h); its slope comes from a second consistent state a
    fraction of a step away (Arnold, Bruels and Cardona 2015, section 5).
    """
    system = dynamics.system
    motors = system.motors

    def accelerate(y: Array, v: Array, part: float) -> tuple[Array, Array]:
        if drive is None:
            a_motor = path.acceleration[0] * (1 - part) + path.acceleration[1] * part
            return consistent_acceleration(dynamics, y, v, motors, a_motor, None)
        return consistent_acceleration(
            dynamics, y, v, motors[:0], np.zeros(0), drive.feed_forward[0]
        )

    a, lam = accelerate(y, v, 0.0)
    part = 0.01
    dt = part * h
    ahead = dynamics.integrate(y, dt * v + 0.5 * dt * dt * a)
    a_ahead, _ = accelerate(ahead, v + dt * a, part)
    s = a + (a_ahead - a) * ((scheme.alpha_m - scheme.alpha_f) / part)
    r = dynamics.residual(y, v, a, lam)
    torque = r[motors] if drive is None else drive.feed_forward[0]
    return _Step(y, v, a, s, lam), np.array(torque)


def _force_scale(dynamics: Dynamics, step: _Step, newton: _Newton) -> float:
    """Acceleration scale of the run before it has moved: what its static forces could do."""
    newton.refresh(step)
    still = np.zeros(dynamics.system.nv)
    straight = step.y.copy()
    straight[dynamics.nq_rigid :] = 0.0
    weight = dynamics.residual(straight, still, still, np.zeros(dynamics.system.closed.n))
    force = weight[newton.free]
    moving = (newton.weight * step.a[newton.free]) @ step.a[newton.free]
    static = float(force @ (force / np.maximum(newton.weight, 1e-300)))
    return float(np.sqrt(max(static, moving, 1e-24)))


def _torque(
    drive: TorqueDrive, k: int, path: MotorPath, axes: object, now: _Step
) -> Array:
    read = axes.read  # type: ignore[attr-defined]
    position_error = path.position[k] - read(now.y)
    velocity_error = path.velocity[k] - now.v[axes.v_at]  # type: ignore[attr-defined]
    torque: Array = drive.feed_forward[k] + drive.kp * position_error + drive.kd * velocity_error
    return torque


def _power(torque: Array, v: Array, motors: Array, D: Array, damped: bool) -> Array:
    return np.array([float(torque @ v[motors]), float(v @ D @ v) if damped else 0.0])


def _diverged(
    mechanism: Mechanism,
    dynamics: Dynamics,
    now: _Step,
    time: float,
    k: int,
    h: float,
    r: Array,
    run: Run,
) -> ConvergenceError:
    del now
    names = list(mechanism.coordinates) + [
        f"{slot.link} {label}" for slot in dynamics.system.expansion.slots for label in slot.body.labels
    ]
    free = dynamics.system.free
    worst = int(np.nanargmax(np.abs(r))) if np.any(np.isfinite(r)) else 0
    where = names[free[worst]] if worst < len(free) else "?"
    error = ConvergenceError(
        f"t = {time:.6g} s, step {k}, dt = {h:.3g} s: Newton stopped at |r| = "
        f"{float(np.max(np.abs(r))):.2g} after {_MAX_ITERATIONS} iterations, largest in {where}. "
        "Halve dt, or use level=ked if deflections are small. error.result holds the run so far.",
        time=time,
        step=k,
    )
    error.result = run
    return error
