"""The coupled level in equal steps: the full index-3 equations by the alpha family."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive, kinks
from pinflex.actuation.feedback import Feedback
from pinflex.arrays import Array
from pinflex.errors import ConvergenceError, MotionError, RunInterrupted
from pinflex.integrators.alpha import MAX_ITERATIONS, NEWTON, March, NoConvergence
from pinflex.integrators.newton import Step
from pinflex.integrators.run import Run
from pinflex.integrators.schemes import AlphaScheme
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism


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

    Args:
        mechanism: Mechanism. dynamics: Workspace of its flexible (or rigid) system.
        start: y (nq,) and v (nv,) on the closures.
        path: Motor motion at every step (equal steps).
        scheme: Member of the alpha family.
        drive: None prescribes the motors and answers with their torque; else motors get a torque.
        tolerance: Newton's, relative to the largest acceleration so far.
        progress: Called with (step, steps).
        feedback: A control that acts all along.
        resume: Step to start at, and the state there to go on from (None: `start`, consistently).
    Returns:
        States, multipliers and torques at every step (from that one on).
    Raises:
        ConvergenceError: With `.result` (a Run) up to the last good step.
        MotionError: A sleeve leaves its beam; likewise.
    """
    system, t, steps = dynamics.system, path.t, len(path.t) - 1
    march = March(mechanism, dynamics, path, scheme, drive, tolerance, feedback)
    acting = march.feedback
    signals = None if acting is None else acting.signals(steps + 1)
    Y, V = np.empty((steps + 1, system.nq)), np.empty((steps + 1, system.nv))
    A, L = np.empty_like(V), np.empty((steps + 1, system.closed.n))
    S = np.empty_like(V)
    T, power = np.empty((steps + 1, len(system.motors))), np.zeros((steps + 1, 2))
    begin, now = resume[0], resume[1] or march.first(*start, resume[0])

    def run(upto: int, stopped: str = "") -> Run:
        counts: dict[str, float] = {
            "steps": upto - begin,
            "newton": march.iterations,
            "tangents": march.newton.count,
        }
        k = slice(begin, upto + 1)
        work = np.zeros((upto + 1 - begin, 2))
        np.cumsum(0.5 * march.h * (power[k][1:] + power[k][:-1]), axis=0, out=work[1:])
        return Run(
            system, t[k], Y[k], V[k], A[k], L[k], T[k], counts,
            {"integrator": scheme.name, "dt": march.h, "gamma": scheme.gamma}, work, (), stopped,
            None if signals is None else signals.at(k), s=S[k],
        )  # fmt: skip

    def keep(k: int, now: Step) -> None:
        Y[k], V[k], A[k], S[k], L[k], T[k] = now.y, now.v, now.a, now.s, now.lam, now.torque
        power[k] = now.torque @ now.v[system.motors], dynamics.losses(now.y, now.v)
        if acting is not None and signals is not None:
            march.control(k, now.y, now.v)
            assert march.control_force is not None
            acting.keep()
            signals.u[k], signals.measured[k] = acting.u, acting.m
            power[k, 0] += float(march.control_force @ now.v)

    keep(begin, now)
    march.set_scale(now, begin)
    k, last, fresh = begin, now, kinks(path) | (set() if resume[1] else {begin})
    try:
        for k in range(begin + 1, steps + 1):
            if k - 1 in fresh:
                if k > 1:
                    now = march.first(now.y, now.v, k - 1)
                now = last = march.quiet_start(now, k - 1)
            # Both go on as they did: a multiplier left behind would cost one more correction.
            guess = 2.0 * now.a - last.a, 2.0 * now.lam - last.lam
            last, now = now, march.step(now, guess, k)
            dynamics.require_on_beams(now.y, mechanism.name, float(t[k]))
            keep(k, now)
            if progress is not None and k % 64 == 0:
                progress(k, steps)
    except MotionError as error:
        error.result = run(k - 1, str(error))
        raise
    except KeyboardInterrupt:
        raise RunInterrupted(run(max(k - 1, begin), "interrupted")) from None
    except (NoConvergence, np.linalg.LinAlgError) as error:
        r = getattr(error, "residual", np.array([np.nan]))
        good = max(k - 1, begin)
        raise _diverged(
            mechanism, march, t[max(k, 1)], max(k, 1), r, run(good, "diverged")
        ) from None
    return run(steps)


def _diverged(
    mechanism: Mechanism, march: March, time: float, k: int, r: Array, run: Run
) -> ConvergenceError:
    slots = march.dynamics.system.expansion.slots
    names = list(mechanism.coordinates)
    names += [f"{slot.link} {label}" for slot in slots for label in slot.body.labels]
    known = len(r) == len(march.newton.free) and bool(np.all(np.isfinite(r)))
    how = "its numbers grew past all bounds"
    if known:
        where = names[march.newton.free[int(np.argmax(np.abs(r)))]]
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
        "Halve dt, start from rest (start=static), or use level=ked if deflections are small. "
        "error.result holds the run so far.",
        time=time,
        step=k,
    )
    error.result = run
    return error
