"""The coupled level in equal steps: the full index-3 equations by the alpha family."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive, kinks
from pinflex.actuation.feedback import Feedback
from pinflex.arrays import Array
from pinflex.errors import ConvergenceError, Ending, MotionError, RunInterrupted
from pinflex.integrators.collocation import AlphaScheme
from pinflex.integrators.compiled import compiled_alpha
from pinflex.integrators.plain.alpha import MAX_ITERATIONS, NoConvergence, PlainAlpha, Step
from pinflex.integrators.problem import Run, Settings
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import gear_name

# Newton stops when the estimated error of the acceleration, weighted by the iteration matrix, is
# this fraction of what the acceleration is at the time: measured on the race scenes, torques and
# platform deviations then differ by 1e-6 at most from those of a tolerance of 1e-10.
NEWTON = 1e-7
_TOGETHER = 64  # steps between calls of `progress`, and of the kernel


# A diverging iteration overflows before it is caught and named.
@np.errstate(over="ignore", invalid="ignore")
def integrate(
    mechanism: Mechanism,
    dynamics: Equations,
    start: tuple[Array, Array],
    path: MotorPath,
    scheme: AlphaScheme,
    drive: TorqueDrive | None = None,
    tolerance: float = NEWTON,
    progress: Callable[[int, int], None] | None = None,
    feedback: Feedback | None = None,
    resume: tuple[int, Step | None] = (0, None),
) -> Run:
    """March the full equations over the steps of a motor path.

    Returns:
        States, multipliers and torques at every step (from that one on).
    Raises:
        ConvergenceError: With `.result` (a Run) up to the last good step.
        MotionError: A sleeve leaves its beam; likewise.
    """
    t, steps, begin = path.t, len(path.t) - 1, resume[0]
    march = PlainAlpha(mechanism, dynamics, path, scheme, drive, tolerance, feedback)
    record = _Record(march, t, begin)
    now = resume[1] or march.first(*start, begin)
    record.keep(begin, now)
    compiled = compiled_alpha(march, record.columns, begin)
    k, last, fresh = begin, now, kinks(path) | (set() if resume[1] else {begin})
    try:
        while k < steps:
            if k in fresh:
                if k > 0:
                    now = march.bent(now, k)
                if dynamics.looped:
                    now = march.quiet(now, (compiled or march).step(k + 1, now, now), k)
                last = now
            if compiled is not None:
                begun = k
                stops = (j for j in fresh if j > k)
                upto = min([steps, k - k % _TOGETHER + _TOGETHER, *stops])
                k, now, last = compiled.advance(k, now, last, upto)
                done = record.columns[0][begun + 1 : k + 1]
                if (off := dynamics.first_off(done)) is not None:
                    k = begun + off
                    dynamics.require_on_beams(done[off], mechanism.name, float(t[k + 1]))
            else:
                after = march.step(k + 1, now, last)
                dynamics.require_on_beams(after.y, mechanism.name, float(t[k + 1]))
                last, now, k = now, after, k + 1
                record.keep(k, now)
            if progress is not None and k % _TOGETHER == 0:
                progress(k, steps)
    except MotionError as error:
        error.result = record.run(k)
        raise
    except KeyboardInterrupt:
        raise RunInterrupted(record.run(k)) from None
    except (NoConvergence, np.linalg.LinAlgError) as error:
        r = getattr(error, "residual", np.array([np.nan]))
        so_far = record.run(k)
        raise _diverged(mechanism, march, t[k + 1], k + 1, r, so_far) from None
    return record.run(steps)


class _Record:
    """States, multipliers, torques and powers at the steps of a march, from step `begin` on."""

    def __init__(self, march: PlainAlpha, t: Array, begin: int) -> None:
        self._march, self._t, self._begin = march, t, begin
        self._system = system = march.dynamics.system
        nv, rows, motors = system.nv, system.closed.n, len(system.motors)
        # y, v, a, s, lam, torque and power.
        self.columns = tuple(
            np.zeros((len(t), n)) for n in (system.nq, *(nv,) * 3, rows, motors, 2)
        )
        self._signals = march.signals

    def keep(self, k: int, now: Step) -> None:
        """Record step k; a feedback goes on from there."""
        march, signals = self._march, self._signals
        losses = march.dynamics.losses(now.y[None], now.v[None])[0]
        power = np.array([now.torque @ now.v[self._system.motors], losses])
        state = now.y, now.v, now.a, now.s, now.lam, now.torque, power
        for column, values in zip(self.columns, state, strict=True):
            column[k] = values
        if march.feedback is not None and signals is not None:
            march.control(k, now.y, now.v)
            assert march.control_force is not None
            march.feedback.keep()
            signals.u[k], signals.measured[k] = march.feedback.u, march.feedback.m
            self.columns[-1][k, 0] += float(march.control_force @ now.v)

    def run(self, upto: int) -> Run:
        """The steps up to one as a run; work by the trapezoidal rule."""
        march, k = self._march, slice(self._begin, upto + 1)
        steps = upto - self._begin
        counts = {"steps": steps, "newton": march.iterations, "tangents": march.tangents}
        settings: Settings = {
            "integrator": march.scheme.name,
            "dt": march.h,
            "gamma": march.scheme.gamma,
        }
        if march.feedback is not None and march.feedback.feedback.linear is None:
            settings["march"] = "in Python: control.law is a function (one of pf.pid runs compiled)"
        y, v, a, algorithmic, lam, torque, power = (column[k] for column in self.columns)
        work = np.zeros((steps + 1, 2))
        np.cumsum(0.5 * march.h * (power[1:] + power[:-1]), axis=0, out=work[1:])
        signals = None if self._signals is None else self._signals.at(k)
        return Run(
            self._system, self._t[k], y, v, a, lam, torque, dict(counts), settings, work,
            signals=signals, s=algorithmic,
        )  # fmt: skip


def _diverged(
    mechanism: Mechanism, march: PlainAlpha, time: float, k: int, r: Array, run: Run
) -> ConvergenceError:
    expansion = march.dynamics.system.expansion
    names = list(mechanism.coordinates)
    names += [f"{slot.link} {label}" for slot in expansion.slots for label in slot.body.labels]
    names += [gear_name(drive.joint) for drive in expansion.drives]
    known = len(r) == len(march.problem.free) and bool(np.all(np.isfinite(r)))
    how = "its numbers grew past all bounds"
    if known:
        where = names[march.problem.free[int(np.argmax(np.abs(r)))]]
        how = f"it stopped at |r| = {float(np.max(np.abs(r))):.2g}, largest in {where}"
    linear = [name for name, part in mechanism.parts.items() if not part.spec.second_order]
    if not known and linear:
        how += (
            f" ({', '.join(linear)} has no second-order terms, so that its stiffness falls with "
            "speed and compression until it runs away: set flexible.LINK.second_order: true)"
        )
    error = ConvergenceError(
        f"t = {time:.6g} s, step {k}, dt = {march.h:.3g} s: Newton stopped after at most "
        f"{MAX_ITERATIONS} iterations: {how}. The step of {march.h:.3g} s may be too large. "
        f"{Ending.NEWTON_STALLED.value} error.result holds the run so far.",
        time=time,
        step=k,
        ending=Ending.NEWTON_STALLED,
    )
    error.result = run
    return error
