"""Equal steps of the alpha family on the compiled kernel, from starts of `PlainAlpha`."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.collocation import implicit_euler
from pinflex.integrators.compiled_stages import Stages
from pinflex.integrators.plain_alpha import MAX_ITERATIONS, NoConvergence, PlainAlpha, Step
from pinflex.kernel.alpha import AlphaKernel, Iteration
from pinflex.kernel.law import LawKernel


class CompiledAlpha:
    """The steps of one march."""

    def __init__(
        self, march: PlainAlpha, stages: Stages, found: Sequence[Array], begin: int
    ) -> None:
        """`found`: y, v, a, s, lam, torque and power at all instants, which are written.

        There they stand at step `begin`.
        """
        self._march, self._stages, self._found = march, stages, found
        path, (mass, by_v, by_y) = march.path, march.weights
        given = Iteration(
            march.predictor, mass, by_v, by_y, march.tolerance, MAX_ITERATIONS, march.farthest
        )
        drive, scale = march.drive, stages.compiled.compiled.scale(path.t)
        feed = path.acceleration if drive is None else drive.feed_forward
        motors = path.position, path.velocity, feed, scale
        law, signals = None if march.feedback is None else _law(march), march.signals
        if signals is not None:
            found = *found, signals.u, signals.measured
            self._found = found
        self._kernel = AlphaKernel(stages.compiled.kernel, given, motors, found, law)
        self._at: Step | None = None  # where its own last step ended
        self._kernel.at.reference = self._scale(begin)

    def _scale(self, k: int) -> float:
        """Norm of the acceleration at step k; that of what static forces could do, if more."""
        march, d, now = self._march, self._march.dynamics, self._state(k)
        free = march.problem.free
        full, _ = march.matrix(k, now.y, now.v, now.a, now.lam, rates=False)
        weight, a = np.abs(np.diag(full))[free], now.a[free]
        still, straight, none = np.zeros_like(now.v), now.y.copy(), np.zeros_like(now.lam)
        straight[d.nq_rigid :] = 0.0
        t, u = float(march.path.t[k]), march.control_force
        force = d.residual(straight, still, still, none, t, u).r[free]
        static = force @ (force / np.maximum(weight, 1e-300))
        return max(sqrt(static), sqrt((weight * a) @ a), 1e-12)

    def step(self, k: int, now: Step, last: Step) -> Step:
        """The state at step k, where the march does not go yet; as `PlainAlpha.step` has it."""
        self._take(k - 1, now, last, k)
        self._at = None
        return self._state(k)

    def advance(self, k: int, now: Step, last: Step, upto: int) -> tuple[int, Step, Step]:
        """Steps from k on, as far as they go: the last one, and the states there and before.

        Raises:
            NoConvergence: The first step fails.
        """
        feedback, law, t = self._march.feedback, self._kernel.law, self._march.path.t
        taken = self._take(k, now, last, upto)
        if feedback is not None and law is not None:
            feedback.go_on(float(t[k + taken]), law.target, law.x, law.e)
            self._found[-1][k + 1 : k + taken + 1] += law.target
        last = now if taken == 1 else self._state(k + taken - 1)
        self._at = self._state(k + taken)
        return k + taken, self._at, last

    def _take(self, k: int, now: Step, last: Step, upto: int) -> int:
        march, kernel, at = self._march, self._kernel, self._kernel.at
        feedback, law, t = march.feedback, kernel.law, march.path.t
        if now is not self._at:
            kernel.begin(*((x.y, x.v, x.a, x.s, x.lam) for x in (now, last)))
            if feedback is not None and law is not None:
                law.x[...], law.e[...] = feedback.state_at(float(t[k]), law.target)
        before = at.iterations, at.refreshed
        taken = kernel.march(k + 1, upto - k)
        march.iterations += at.iterations - before[0]
        march.tangents += at.refreshed - before[1]
        if not taken:
            raise NoConvergence(kernel.residual[march.problem.free])
        return taken

    def _state(self, k: int) -> Step:
        return Step(*(x[k].copy() for x in self._found[:6]))


def compiled_alpha(march: PlainAlpha, found: Sequence[Array], begin: int) -> CompiledAlpha | None:
    """The steps of a march, compiled; None where they are plain or a law is any function."""
    if march.feedback is not None and march.feedback.feedback.linear is None:
        return None
    if not march.dynamics.on_kernel:
        return None
    return CompiledAlpha(march, Stages(march.problem, implicit_euler()), found, begin)


def _law(march: PlainAlpha) -> LawKernel:
    """The feedback of a march, its states by the trapezoidal rule."""
    assert march.feedback is not None
    one = march.feedback.feedback
    law, system, half = one.linear, march.dynamics.system, 0.5 * march.h
    assert law is not None
    eye = np.eye(len(law.A))
    x_of_x, x_of_e = (
        np.asarray(np.linalg.solve(eye - half * law.A, of), dtype=np.float64)
        for of in (eye + half * law.A, half * law.B)
    )
    tables: dict[str, Array] = {
        "S": one.S, "B": one.B, "home": one.home, "target": law.target, "x_of_x": x_of_x,
        "x_of_e": x_of_e, "C": law.C, "D": law.D, "E": law.E,
    }  # fmt: skip
    return LawKernel(tables, system.nq, system.nv)
