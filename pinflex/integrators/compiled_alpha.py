"""Equal steps of the alpha family on the compiled kernel: the loop of `equal_steps` in C.

Starts, and steps that Newton does not get through on a kept tangent, are left to `March`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.alpha import MAX_ITERATIONS, March
from pinflex.integrators.collocation import implicit_euler
from pinflex.integrators.compiled_stages import Stages
from pinflex.integrators.newton import Step
from pinflex.kernel.alpha import AlphaKernel, Iteration
from pinflex.kernel.law import LawKernel


class CompiledAlpha:
    """The steps of one march."""

    def __init__(self, march: March, stages: Stages, found: Sequence[Array]) -> None:
        """`found`: y, v, a, s, lam, torque and power at all instants, which are written."""
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

    def advance(self, k: int, now: Step, last: Step, upto: int) -> tuple[int, Step, Step]:
        """Steps from k on, as far as they go: the last one, and the states there and before.

        Args:
            k: Number of the last step. now, last: States there and before, which predict.
            upto: Step to stop at.
        """
        march, kernel, at = self._march, self._kernel, self._kernel.at
        feedback, law, t = march.feedback, kernel.law, march.path.t
        if now is not self._at:
            kernel.begin(*((x.y, x.v, x.a, x.s, x.lam) for x in (now, last)))
            if feedback is not None and law is not None:
                law.x[...], law.e[...] = feedback.state_at(float(t[k]), law.target)
        at.reference, at.peak = march.reference, march.peak
        before = at.iterations, at.refreshed
        taken = kernel.march(k + 1, upto - k)
        march.iterations += at.iterations - before[0]
        march.newton.count += at.refreshed - before[1]
        if not taken:
            return k, now, last
        march.reference, march.peak, march.slow = at.reference, at.peak, True
        if feedback is not None and law is not None:
            feedback.go_on(float(t[k + taken]), law.target, law.x, law.e)
            self._found[-1][k + 1 : k + taken + 1] += law.target
        last = now if taken == 1 else self._state(k + taken - 1)
        self._at = self._state(k + taken)
        return k + taken, self._at, last

    def _state(self, k: int) -> Step:
        return Step(*(x[k].copy() for x in self._found[:6]))


def compiled_alpha(march: March, found: Sequence[Array]) -> CompiledAlpha | None:
    """The steps of a march, compiled; None where a law is any function, or numpy serves.

    Args:
        march: March that they are of.
        found: As `CompiledAlpha` has them.
    """
    if march.feedback is not None and march.feedback.feedback.linear is None:
        return None
    if not march.dynamics.on_kernel:
        return None
    return CompiledAlpha(march, Stages(march.problem, implicit_euler()), found)


def _law(march: March) -> LawKernel:
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
