"""Radau IIA collocation in plain Python: the reference of the compiled march, and its stand-in.

A step of length h from (y_0, v_0) has s stages, at each of which the equations hold:

    r(y_i, v_i, a_i, lam_i) = 0,  c(y_i) = 0,  v_i = v_0 + h A_ij a_j,  y_i = y_0 (+) h A_ij u_j

On a manifold, u is v seen in the exponential coordinates of the step (Munthe-Kaas 1999), else
u = v. Newton solves for the corrections of all stages at once, on the tangent of one state:

    M da_i + h C A_ij da_j + h^2 K A2_ij da_j - J' dlam_i = -r_i,  J da_i = -(h^2 A2)^-1_ij c_j

Steps have the lengths that they are given; one that Newton does not solve is taken in halves. It is
to be right, not fast: no error is estimated (see `pinflex.solver.tolerance`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pinflex.actuation.path import MotorPath
from pinflex.arrays import Array
from pinflex.errors import ConvergenceError, Ending, MotionError, RunInterrupted
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.problem import Problem, Run, Settings, State, StepFailed
from pinflex.linalg import saddle_matrix
from pinflex.mechanics.manifold import Manifold

_ITERATIONS, _HALVINGS = 20, 10  # of a step, at the most
# Newton goes on until a correction is round-off beside the largest displacement, or m or rad; or
# shrinks no more, at a thousand times that.
_RELATIVE, _ABSOLUTE, _NOISE = 1e-13, 1e-15, 1e3
# Contraction above which the next iteration has a new tangent, and above which it is none.
_SLOW, _STALLED = 0.3, 0.7
_SAME = 1e-9  # of the run: times nearer than this are one


@dataclass(frozen=True)
class Step:
    """A step from a state: its length in s, and its stages, shape (s, .) each.

    Attributes:
        start, end: States before and after it. h: Length [s]. turn: u - v. power: Of motors and
            damping [W].
    """

    start: State
    end: State
    h: float
    turn: Array
    a: Array
    lam: Array
    torque: Array
    power: Array


class PlainRadau:
    """The steps of one run.

    Attributes:
        iterations, tangents: Counts.
    """

    def __init__(self, problem: Problem, method: Collocation) -> None:
        self.problem, self.method = problem, method
        self._d = problem.dynamics
        self._manifold = Manifold(self._d)
        self._S, self._h = np.zeros((0, 0)), 0.0  # Newton's matrix, and its step; 0: none
        self.iterations = self.tangents = 0
        self._largest = 0.0  # displacement so far

    def steps(self, start: State, end: float, halvings: int) -> Iterator[Step]:
        """The step from a state to a time (s), or those of its halves."""
        h = end - start.t
        for _ in range(2):
            try:
                step = self.step(start, h)
            except (StepFailed, np.linalg.LinAlgError):
                self._h = 0.0  # the tangent may have aged
            else:
                yield step
                return
        if not halvings:
            raise ConvergenceError(
                f"a step of {h:.3g} s cannot be solved. {Ending.STEP_UNSOLVED.value}",
                time=start.t,
                ending=Ending.STEP_UNSOLVED,
            )
        for half in (start.t + 0.5 * h, end):
            for step in self.steps(start, half, halvings - 1):
                yield step
                start = step.end
            start.t = half

    def step(self, start: State, h: float) -> Step:
        """The step of length h (s): prescribe, predict, then residual and correct, and accept.

        Raises:
            StepFailed: Newton does not converge. LinAlgError: its matrix is singular.
        """
        path, seen = self.prescribe(start, h)
        a, lam = self.predict(start, path)
        turn, size, rate = np.zeros_like(a), np.inf, 0.0
        for _ in range(_ITERATIONS):
            y, v, move, turn = self.place(start, h, path, a, turn)
            if abs(h - self._h) > _SAME * h or rate > _SLOW:
                self._S, self._h = self.matrix(h, y, v, a, lam, seen), h
            da, dlam = self.correct(*self.residual(y, v, a, lam, path, seen))
            a, lam, change = a + da, lam + dlam, h * h * self.method.A2 @ da
            self.iterations += 1
            before, size = size, float(np.abs(change).max(initial=0.0))
            rate = size / before
            reach = max(self._largest, float(np.abs(move + change).max(initial=0.0)))
            goal = _RELATIVE * reach + _ABSOLUTE
            if size <= goal or (rate > _STALLED and size <= _NOISE * goal):
                self._largest = reach
                return self.accept(start, h, path, seen, a, lam, turn)
            if not size <= 1e3 * max(reach, 1.0):
                break
        raise StepFailed

    def prescribe(self, start: State, h: float) -> tuple[MotorPath, Array]:
        """Motion of the motors at the stages, and the times at which loads see them."""
        return self.problem.inside(start.t + h * self.method.c, self.method.c)

    def predict(self, start: State, path: MotorPath) -> tuple[Array, Array]:
        """Accelerations and multipliers of the stages: those of the start."""
        a, lam = (np.tile(x, (self.method.s, 1)) for x in (start.a, start.lam))
        if self.problem.prescribed:
            a[:, self.problem.motors] = path.acceleration
        return a, lam

    def accept(
        self, start: State, h: float, path: MotorPath, seen: Array, a: Array, lam: Array,
        turn: Array,
    ) -> Step:  # fmt: skip
        """The step of stages that Newton has solved."""
        y, v, _, turn = self.place(start, h, path, a, turn)
        p = self.problem
        if p.prescribed:
            torque = self.residual(y, v, a, lam, path, seen)[0][:, p.motors]
        else:
            torque = p.pull(path, y, v, inside=True)
        work = np.sum(torque * v[:, p.motors], axis=1)
        if p.control_force is not None:
            work = work + v @ p.control_force
        power = np.column_stack([work, self._d.losses(y, v)])
        end = State(start.t + h, y[-1], v[-1], a[-1], lam[-1], torque[-1])
        return Step(start, end, h, turn, a, lam, torque, power)

    def begin_at_stages(self, step: Step) -> None:
        """Let what jumps where a step starts be what the polynomials of its stages are there."""
        W = self.method.at(np.zeros(1))[0]
        for name in ("a", "lam", "torque"):
            setattr(step.start, name, W @ getattr(step, name))

    def dense(self, step: Step, t: Array) -> tuple[Array, ...]:
        """y, v, a, lam, torque and work since the start of a step at times t (k,) s inside it."""
        start, h, p, path = step.start, step.h, self.problem, self.problem.path(t)
        x = (t - start.t) / h
        B1, B2, W = self.method.between(x)
        v = start.v + h * B1 @ step.a
        move = h * np.outer(x, start.v) + h * h * B2 @ step.a + h * B1 @ step.turn
        y = self._manifold.retract(start.y, move)
        # Through the value at the start too: below the first node a polynomial runs wild.
        a, lam, torque = (
            W @ np.vstack([getattr(start, name), getattr(step, name)])
            for name in ("a", "lam", "torque")
        )
        if p.prescribed:
            p.axes.write(y, path.position)
            v[:, p.motors], a[:, p.motors] = path.velocity, path.acceleration
        return y, v, a, lam, torque, h * B1 @ step.power

    def place(
        self, start: State, h: float, path: MotorPath, a: Array, turn: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Poses, velocities, moves and turns of the stages from their accelerations."""
        m, p = self.method, self.problem
        v = start.v + h * m.A @ a
        if p.prescribed:
            v[:, p.motors] = path.velocity
        move = h * np.outer(m.c, start.v) + h * h * m.A2 @ a + h * m.A @ turn
        if self._manifold.turning:
            turn = self._manifold.turn(start.y, move, v)
            move = h * np.outer(m.c, start.v) + h * h * m.A2 @ a + h * m.A @ turn
        y = self._manifold.retract(start.y, move)
        if p.prescribed:
            p.axes.write(y, path.position)
        return y, v, move, turn

    def residual(
        self, y: Array, v: Array, a: Array, lam: Array, path: MotorPath, seen: Array
    ) -> tuple[Array, Array]:
        """Forces (s, nv) and closures (s, rows) that the stages leave."""
        r, c = self._d.residual(y, v, a, lam, seen, self.problem.control_force)
        if not self.problem.prescribed:
            r[:, self.problem.motors] -= self.problem.pull(path, y, v, inside=True)
        return r, c

    def matrix(self, h: float, y: Array, v: Array, a: Array, lam: Array, seen: Array) -> Array:
        """Newton's matrix from the tangent at the stage in the middle."""
        m, p, k = self.method, self.problem, self.method.s // 2
        M, C, K, J = self._d.tangent(y[k], v[k], a[k], lam[k], float(seen[k]))
        if p.drive is not None:
            C[p.motors, p.motors] += p.drive.kd
            K[p.motors, p.motors] += p.drive.kp
        at, eye = np.ix_(p.free, p.free), np.eye(m.s)
        A = np.kron(eye, M[at]) + np.kron(h * m.A, C[at]) + np.kron(h * h * m.A2, K[at])
        S = saddle_matrix(A, np.asarray(np.kron(eye, J[:, p.free]), dtype=np.float64))
        if not np.isfinite(S).all():
            raise StepFailed
        self.tangents += 1
        return S

    def correct(self, r: Array, c: Array) -> tuple[Array, Array]:
        """da (s, nv) and dlam (s, rows)."""
        free, da = self.problem.free, np.zeros_like(r)
        gap = self.method.A2_inverse @ c / self._h**2
        x = np.linalg.solve(self._S, -np.concatenate([r[:, free].ravel(), gap.ravel()]))
        da[:, free] = x[: self.method.s * len(free)].reshape(-1, len(free))
        return da, x[self.method.s * len(free) :].reshape(c.shape)


# A diverging iteration overflows before it is caught.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def integrate(
    name: str,
    problem: Problem,
    method: Collocation,
    start: tuple[Array, Array],
    t: Array,
    ends: Array,
    corners: Array,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """March from t[0] to the last of the ends and answer at the times t.

    It begins anew at corners; where a controller acts its steps go on under other forces.

    Raises:
        ConvergenceError, MotionError: With `.result` (a Run) up to the last good step.
    """
    march, now = PlainRadau(problem, method), problem.first(float(t[0]), *start)
    close, work, done, jumped = _SAME * float(ends[-1] - t[0]), np.zeros(2), 0, False
    begun = now.y, now.v, now.a, now.lam, now.torque, work
    found, count = [[x[None]] for x in begun], 1

    def run() -> Run:
        y, v, a, lam, torque, worked = (np.concatenate(column) for column in found)
        cost = {"steps": done, "newton": march.iterations, "tangents": march.tangents}
        dt = (now.t - float(t[0])) / max(done, 1)
        settings: Settings = {"integrator": "radau", "stages": method.s, "dt": dt}
        given = problem.dynamics.system, t[:count], y, v, a, lam, torque
        return Run(*given, {k: float(x) for k, x in cost.items()}, settings, worked)

    try:
        for end in ends.tolist():
            for step in march.steps(now, end, _HALVINGS):
                if jumped:
                    march.begin_at_stages(step)
                now, done, jumped = step.end, done + 1, False
                upto = int(np.searchsorted(t, now.t + close, side="right"))
                *states, worked = march.dense(step, t[count:upto])
                for column, values in zip(found, (*states, work + worked), strict=True):
                    column.append(values)
                count, work = upto, work + step.h * method.A[-1] @ step.power
                problem.dynamics.require_on_beams(now.y, name, now.t)
            now.t = end
            if progress is not None:
                progress(count, len(t))
            if end == ends[-1]:
                break
            if np.abs(corners - end).min(initial=np.inf) <= close:
                now = problem.first(end, now.y, now.v)
            elif problem.sampler is not None:
                jumped = problem.sampler.reach(end, now.y, now.v)
    except (ConvergenceError, MotionError) as error:
        if isinstance(error, ConvergenceError):
            error = ConvergenceError(
                f"{name}: t = {now.t:.6g} s: {error}", time=now.t, ending=error.ending
            )
        error.result = run()
        raise error from None
    except KeyboardInterrupt:
        if count < 2:
            raise  # nothing but the start
        raise RunInterrupted(run()) from None
    return run()
