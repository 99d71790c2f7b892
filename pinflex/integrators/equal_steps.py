"""The coupled level in equal steps: the full index-3 equations by the alpha family."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import sqrt

import numpy as np

from pinflex.actuation.drive import TorqueDrive, averaged, kinks
from pinflex.actuation.feedback import Feedback
from pinflex.actuation.path import MotorAxes, MotorPath
from pinflex.arrays import Array, IntArray, distinct
from pinflex.errors import ConvergenceError, Ending, MotionError, RunInterrupted
from pinflex.integrators.collocation import AlphaScheme, implicit_euler, radau
from pinflex.integrators.compiled import Stages
from pinflex.integrators.plain import radau as plain_radau
from pinflex.integrators.plain.alpha import MAX_ITERATIONS, NoConvergence, PlainAlpha, Step
from pinflex.integrators.problem import Problem, Run, Settings
from pinflex.kernel.march import AlphaKernel, LawKernel
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Loads, gear_name
from pinflex.mechanics.model.system import System

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
    breaks: Sequence[float] = (),
    exact: Problem | None = None,
) -> Run:
    """March the full equations over the steps of a motor path; accelerations may jump at `breaks`.

    `exact`: the same equations at any time, of which a step is taken in which a mass comes or goes.

    Returns:
        States, multipliers and torques at every step (from that one on).
    Raises:
        ConvergenceError: With `.result` (a Run) up to the last good step.
        MotionError: A sleeve leaves its beam; likewise.
    """
    t, steps, begin = path.t, len(path.t) - 1, resume[0]
    pointwise, at = (path, drive), np.zeros(0, dtype=np.intp)
    system = dynamics.system
    crossed = {} if exact is None else crossing(breaks, t, system.added.instants)
    near = _AT_END * (t[1] - t[0])
    taken = [x for x in breaks if int(np.searchsorted(t, x - near)) in crossed]
    breaks = [x for x in breaks if x not in taken]
    if drive is None:
        mean, at = averaged(t, path.acceleration, breaks)
        path = replace(path, acceleration=mean)
    else:
        mean, at = averaged(t, drive.feed_forward, breaks)
        drive = replace(drive, feed_forward=mean)
    switched = _switched(system.loads, t)
    spread = len(switched) > 0
    stepped = system.in_steps(t[1] - t[0], {*taken, *system.added.instants}) if spread else system
    felt = Equations(stepped, marched=True) if spread else dynamics
    march = PlainAlpha(mechanism, felt, path, scheme, drive, tolerance, feedback)
    record = _Record(march, system, t, begin)
    now = resume[1] or march.first(*start, begin)
    record.keep(begin, now)
    compiled = compiled_alpha(march, record.columns, begin)
    beside = (at[:, None] + np.arange(-2, 3)).ravel().tolist()  # a jump is no bend
    k, last, fresh = begin, now, kinks(path) - {*beside} | (set() if resume[1] else {begin})
    try:
        while k < steps:
            if k in fresh:
                if k > 0 and k not in crossed:
                    now = march.bent(now, k)
                if dynamics.looped:
                    now = march.quiet(now, (compiled or march).step(k + 1, now, now), k)
                last = now
            begun = k
            if exact is not None and k + 1 in crossed:
                last = now = _across(mechanism.name, march, exact, now, k, crossed[k + 1])
                k, fresh = k + 1, fresh | {k + 1}
                record.keep(k, now)
            elif compiled is not None:
                stops = (j for j in (*fresh, *(j - 1 for j in crossed)) if j > k)
                upto = min([steps, k - k % _TOGETHER + _TOGETHER, *stops])
                k, now, last = compiled.advance(k, now, last, upto)
            else:
                last, now, k = now, march.step(k + 1, now, last), k + 1
                record.keep(k, now)
            done = record.columns[0][begun + 1 : k + 1]
            if (off := dynamics.first_off(done)) is not None:
                k = begun + off
                dynamics.require_on_beams(done[off], mechanism.name, float(t[k + 1]))
            if progress is not None and k % _TOGETHER == 0:
                progress(k, steps)
    except (MotionError, ConvergenceError) as error:
        error.result = record.run(k)
        raise
    except KeyboardInterrupt:
        raise RunInterrupted(record.run(k)) from None
    except (NoConvergence, np.linalg.LinAlgError) as error:
        r = getattr(error, "residual", np.array([np.nan]))
        so_far = record.run(k)
        raise _diverged(mechanism, march, t[k + 1], k + 1, r, so_far) from None
    if feedback is None:  # its states were those of their time
        march.dynamics, (march.path, march.drive) = dynamics, pointwise
        record.settle(distinct(at[at > begin], switched[switched > begin]))
    return record.run(steps)


def _switched(loads: Loads, t: Array) -> IntArray:
    """Steps nearest to where loads switch."""
    h, times = t[1] - t[0], [x for f, _ in loads.forces if f.timed for x in f.corners]
    found = [int(np.searchsorted(t, x - 0.5 * h)) for x in times if 0.0 < x <= t[-1]]
    return distinct(np.array(found, dtype=np.intp))


# A step in which a mass comes or goes. No mean over it is right, as it is for loads: accelerations
# are not linear in the mass. So it is taken up to the instant and from there, by collocation, and
# the steps begin anew behind it.

STAGES = 3
_AT_END = 1e-6  # of the step: an instant so near its end is there


def crossing(
    breaks: Sequence[float], t: Array, instants: Sequence[float] | None = None
) -> dict[int, Array]:
    """Breaks (s) up to which such a step goes and from there on, by its number among those of t.

    `instants`: at which masses come or go; breaks count in these steps and beside them, whose mean
    would reach into them. None: every break counts.
    """
    near, found = _AT_END * (t[1] - t[0]), dict[int, list[float]]()
    for x in breaks:
        if t[0] + near < x <= t[-1] + near:
            inside = found.setdefault(k := int(np.searchsorted(t, x - near)), [])
            inside += [x] if x < t[k] - near else []
    wanted = {*(found if instants is None else crossing(instants, t))}
    while more := {k for k in found if {k - 1, k + 1} & wanted} - wanted:
        wanted |= more
    return {k: np.array(inside) for k, inside in found.items() if k in wanted}


def _across(name: str, march: PlainAlpha, exact: Problem, now: Step, k: int, inside: Array) -> Step:
    """The state a step behind step k, where masses come or go at its end or times inside (s)."""
    t, method = march.path.t[k : k + 2], radau(STAGES)
    ends = np.append(inside, t[1])
    run = plain_radau.integrate(name, exact, method, (now.y, now.v), t, ends, inside)
    return march.first(run.y[-1], run.v[-1], k + 1)


class _Record:
    """States, multipliers, torques and powers at the steps of a march, from step `begin` on."""

    def __init__(self, march: PlainAlpha, system: System, t: Array, begin: int) -> None:
        self._march, self._t, self._begin = march, t, begin
        self._system = system
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

    def settle(self, at: IntArray) -> None:
        """Accelerations and forces at some steps, of the motion as it is there."""
        (y, v, a, _, lam, torque, _), march = self.columns, self._march
        for k in at:
            a[k], lam[k] = march.accelerated(k, y[k], v[k], march.path.acceleration[k])
            torque[k] = march.residual(k, y[k], v[k], a[k], lam[k])[2]

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


# The same steps on the compiled kernel, from starts of `PlainAlpha`.


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
        drive, scale = march.drive, stages.kernel.evaluator.scale(path.t)
        feed = path.acceleration if drive is None else drive.feed_forward
        motors = path.position, path.velocity, feed, scale
        law, signals = None if march.feedback is None else _law(march), march.signals
        if signals is not None:
            found = *found, signals.u, signals.measured
            self._found = found
        self.kernel = AlphaKernel(
            stages.kernel, march.predictor, motors, found, law, mass=mass, by_v=by_v,
            by_y=by_y, tolerance=march.tolerance, most=MAX_ITERATIONS, farthest=march.farthest,
        )  # fmt: skip
        self._at: Step | None = None  # where its own last step ended
        self.kernel.at.reference = self.scale(begin)

    def scale(self, k: int) -> float:
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
        feedback, law, t = self._march.feedback, self.kernel.law, self._march.path.t
        taken = self._take(k, now, last, upto)
        if feedback is not None and law is not None:
            feedback.go_on(float(t[k + taken]), law.target, law.x, law.e)
            self._found[-1][k + 1 : k + taken + 1] += law.target
        last = now if taken == 1 else self._state(k + taken - 1)
        self._at = self._state(k + taken)
        return k + taken, self._at, last

    def _take(self, k: int, now: Step, last: Step, upto: int) -> int:
        march, kernel, at = self._march, self.kernel, self.kernel.at
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


# Samples that lie between the steps of a run.
#
# Positions and velocities are the cubics through the values and slopes at both ends of a step; they
# err with its fourth power. Accelerations, multipliers, torques and signals, whose error falls with
# the square of the step as the method's own, go straight from step to step.

_CURVED = 0.125  # of a second difference: what a straight line misses at most of a parabola


def between(run: Run, t: Array, led: tuple[MotorAxes, MotorPath] | None) -> Run:
    """The run at samples, each between two of its instants, and what straight lines may miss.

    `settings["interpolated"]`: by how much torques are off at most [N m | N].
    `t`: within its instants [s]. `led`: motors that follow their motion, and the motion then.
    """
    h = float(run.t[-1] - run.t[0]) / (len(run.t) - 1)
    at = np.clip(((t - run.t[0]) / h).astype(np.intp), 0, len(run.t) - 2)
    x = np.clip((t - run.t[at]) / h, 0.0, 1.0)[:, None]
    x[t >= run.t[-1]] = 1.0
    system, v = run.system, _cubic(run.v, h * run.a, at, x)
    pairs = zip(run.y[:-1], run.y[1:], strict=True)
    moves = np.array([system.difference(first, last) for first, last in pairs])[at]
    ways = x * x * (3 - 2 * x) * moves + h * x * (1 - x) * ((1 - x) * run.v[at] - x * run.v[at + 1])
    y = np.array([system.integrate(run.y[k], dy) for k, dy in zip(at, ways, strict=True)])
    a = _straight(run.a, at, x)
    if led is not None:
        axes, path = led
        axes.write(y, path.position)
        v[:, system.motors], a[:, system.motors] = path.velocity, path.acceleration
    signals = run.signals
    if signals is not None:
        u, measured = (_straight(z, at, x) for z in (signals.u, signals.measured))
        signals = replace(signals, u=u, measured=measured)
    missed = _CURVED * np.abs(np.diff(run.torque, 2, axis=0)).max(initial=0.0)
    work = None if run.work is None else _cubic(run.work, np.gradient(run.work, axis=0), at, x)
    return replace(
        run, t=t, y=y, v=v, a=a, lam=_straight(run.lam, at, x),
        torque=_straight(run.torque, at, x), signals=signals, work=work,
        s=None if run.s is None else _straight(run.s, at, x),
        settings={**run.settings, "interpolated": float(missed)},
    )  # fmt: skip


def _straight(values: Array, at: IntArray, x: Array) -> Array:
    return (1 - x) * values[at] + x * values[at + 1]


def _cubic(values: Array, slopes: Array, at: IntArray, x: Array) -> Array:
    """Through values (n, k), with slopes per step."""
    rise = values[at + 1] - values[at]
    bend = (1 - x) * (slopes[at] - rise) + x * (rise - slopes[at + 1])
    return np.asarray(values[at] + x * rise + x * (1 - x) * bend)
