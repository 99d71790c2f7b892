"""The coupled level in equal steps: the full index-3 equations by the alpha family."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import sqrt

import numpy as np

from pinflex.actuation.drive import TorqueDrive, averaged, kinks
from pinflex.actuation.feedback import Feedback, FeedbackState
from pinflex.actuation.path import MotorAxes, MotorPath
from pinflex.arrays import Array, IntArray, distinct
from pinflex.errors import ConvergenceError, Ending, MotionError, PinflexError, RunInterrupted
from pinflex.integrators.collocation import AlphaScheme, implicit_euler, radau
from pinflex.integrators.compiled import Stages
from pinflex.integrators.plain import radau as plain_radau
from pinflex.integrators.plain.alpha import MAX_ITERATIONS, PlainAlpha, Step
from pinflex.integrators.problem import Problem, Run, StepFailed
from pinflex.kernel.library import Record, names, place, structure
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
    compiled = felt.on_kernel and (feedback is None or feedback.linear is not None)
    kind = CompiledAlpha if compiled else PlainAlpha  # a law that is any function takes plain steps
    march = kind(mechanism, felt, path, scheme, drive, tolerance, feedback)
    now = resume[1] or march.first(*start, begin)
    march.keep(begin, now)
    beside = (at[:, None] + np.arange(-2, 3)).ravel().tolist()  # a jump is no bend
    k, last, fresh = begin, now, kinks(path) - {*beside} | (set() if resume[1] else {begin})
    try:
        while k < steps:
            if k in fresh:
                if k > 0 and k not in crossed:
                    now = march.bent(now, k)
                if dynamics.looped:
                    now = march.quiet(now, march.step(k + 1, now, now), k)
                last = now
            begun = k
            if exact is not None and k + 1 in crossed:
                last = now = _across(mechanism.name, march, exact, now, k, crossed[k + 1])
                k, fresh = k + 1, fresh | {k + 1}
                march.keep(k, now)
            else:
                stops = (j for j in (*fresh, *(j - 1 for j in crossed)) if j > k)
                upto = min([steps, k - k % _TOGETHER + _TOGETHER, *stops])
                k, now, last = march.advance(k, now, last, upto)
            done = march.columns[0][begun + 1 : k + 1]
            if (off := dynamics.first_off(done)) is not None:
                k = begun + off
                dynamics.require_on_beams(done[off], mechanism.name, float(t[k + 1]))
            if progress is not None and k % _TOGETHER == 0:
                progress(k, steps)
    except (MotionError, ConvergenceError) as error:
        error.result = march.run(system, begin, k)
        raise
    except KeyboardInterrupt:
        raise RunInterrupted(march.run(system, begin, k)) from None
    except (StepFailed, np.linalg.LinAlgError) as error:
        r = getattr(error, "residual", np.array([np.nan]))
        so_far = march.run(system, begin, k)
        raise _diverged(mechanism, march, t[k + 1], k + 1, r, so_far) from None
    if feedback is None:  # its states were those of their time
        march.dynamics = march.problem.dynamics = dynamics
        march.path, march.drive = pointwise
        march.settle(distinct(at[at > begin], switched[switched > begin]))
    return march.run(system, begin, steps)


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


_Rows, _STATES = structure("Rows"), ("now", "last", "next")
_OF_STATE = names("State", ctypes.c_void_p)


class CompiledAlpha(PlainAlpha):
    """The same steps by the kernel, and where it is: `Alpha` and `Rows` in source/alpha.h.

    Attributes:
        at: The C structure: settings, scales and counts. law: `Law` in source/law.h, or None.
        rows: What is prescribed at the instants, and the columns, each (steps, n). stages: Their
            kernel.
    """

    def __init__(
        self, mechanism: Mechanism, dynamics: Equations, path: MotorPath, scheme: AlphaScheme,
        drive: TorqueDrive | None, tolerance: float, feedback: Feedback | None,
    ) -> None:  # fmt: skip
        super().__init__(mechanism, dynamics, path, scheme, drive, tolerance, feedback)
        self._lent = Stages(self.problem, implicit_euler())
        self.stages, columns = self._lent.kernel, self.columns
        feed = path.acceleration if drive is None else drive.feed_forward
        self.law = None if self.feedback is None else _law(self.feedback, self.h, dynamics.system)
        n, steps = self.stages.counts, len(path.t)
        nv, rows, motors = n["nv"], n["closures"], n["motors"]
        widths = [*(motors,) * 3, n["forces"], n["nq"], nv, nv, nv, rows, motors, 2]
        if self.law is not None and self.signals is not None:
            columns += self.signals.u, self.signals.measured
            widths += self.law.sizes["drives"], self.law.sizes["measures"]
        given = path.position, path.velocity, feed, self.stages.evaluator.scale(path.t)
        self.rows = (*(np.ascontiguousarray(x, dtype=np.float64) for x in given), *columns)
        pairs = zip(self.rows, widths, strict=True)
        self._places = [(place(x, steps, width), 8 * width) for x, width in pairs]
        size, (mass, by_v, by_y) = n["free"] + rows, self.weights
        sizes = n | {"size": size, "order": 3 * size + 1, "wide": nv * (3 * nv + rows)}
        self._states = {which: Record("State", n, {}) for which in _STATES}
        self._room = Record(
            "Alpha", sizes, {"predict": self.predictor}, stale=1, joints=self.stages.address,
            rate=1.0, usual=np.inf, stopped=-1, law=None if self.law is None else self.law.address,
            mass=mass, by_v=by_v, by_y=by_y, tolerance=tolerance, most=MAX_ITERATIONS,
            farthest=self.farthest,
        )  # fmt: skip
        self.at = self._room.at
        self._end: Step | None = None  # where its own last step ended
        self._blocks = (self._room.raw, *(state.raw for state in self._states.values()))
        self._fresh = bytes(self.at)

    def keep(self, k: int, now: Step) -> None:
        """Record step k; the first one tells how large accelerations are."""
        super().keep(k, now)
        if self.at.reference == 0.0:
            self.at.reference = self.scale(k)

    def scale(self, k: int) -> float:
        """Norm of the acceleration at step k; that of what static forces could do, if more."""
        d, now, free = self.dynamics, self._state(k), self.problem.free
        full, _ = self.matrix(k, now.y, now.v, now.a, now.lam, rates=False)
        weight, a = np.abs(np.diag(full))[free], now.a[free]
        still, straight, none = np.zeros_like(now.v), now.y.copy(), np.zeros_like(now.lam)
        straight[d.nq_rigid :] = 0.0
        t, u = float(self.path.t[k]), self.control_force
        force = d.residual(straight, still, still, none, t, u).r[free]
        static = force @ (force / np.maximum(weight, 1e-300))
        return max(sqrt(static), sqrt((weight * a) @ a), 1e-12)

    def step(self, k: int, now: Step, last: Step) -> Step:
        """The state at step k, where the march does not go yet."""
        self._take(k - 1, now, last, k)
        self._end = None
        return self._state(k)

    def advance(self, k: int, now: Step, last: Step, upto: int) -> tuple[int, Step, Step]:
        """Steps from k on, as far as they go."""
        taken = self._take(k, now, last, upto)
        if self.feedback is not None and self.law is not None and self.signals is not None:
            x, e, target = (self.law.arrays[name] for name in _OF_LAW)
            self.feedback.go_on(float(self.path.t[k + taken]), target, x, e)
            self.signals.measured[k + 1 : k + taken + 1] += target
        last = now if taken == 1 else self._state(k + taken - 1)
        self._end = now = self._state(k + taken)
        return k + taken, now, last

    def _take(self, k: int, now: Step, last: Step, upto: int) -> int:
        at = self.at
        if now is not self._end:
            self.begin(now, last)
            if self.feedback is not None and self.law is not None:
                x, e, target = (self.law.arrays[name] for name in _OF_LAW)
                x[...], e[...] = self.feedback.state_at(float(self.path.t[k]), target)
        before = at.iterations, at.refreshed
        taken = self.march(k + 1, upto - k)
        self.iterations += at.iterations - before[0]
        self.tangents += at.refreshed - before[1]
        if not taken:
            raise StepFailed(self._room.arrays["r"][self.problem.free])
        return taken

    def _state(self, k: int) -> Step:
        return Step(*(x[k].copy() for x in self.columns[:6]))

    def begin(self, now: Step, last: Step) -> None:
        """Go on from a state, with a new tangent."""
        for which, state in self._states.items():  # they have changed places
            setattr(self.at, which, state.at)
        for which, given in (("now", now), ("last", last)):
            for name in _OF_STATE:
                self._states[which].arrays[name][...] = getattr(given, name)
        self.at.stale, self.at.curved = 1, -1

    def march(self, first: int, count: int) -> int:
        """Up to so many steps, the first to instant `first`; the number of steps taken."""
        return self.marcher(first, count)()

    def marcher(self, first: int, count: int) -> Callable[[], int]:
        """`march`, ready to be called again and again with nothing to be made for a call."""
        if not (first > 0 and count >= 0 and first + count <= len(self.path.t)):
            raise PinflexError(f"kernel: {count} steps from {first}, of {len(self.path.t)}.")
        rows, stages = _Rows(*(at + first * width for at, width in self._places)), self.stages
        given = stages.tables, stages.work, ctypes.addressof(self.at), count, ctypes.addressof(rows)
        function = stages.functions.pinflex_alpha

        def march(_: object = rows) -> int:  # which lives as long as the function
            return int(function(*given))

        return march

    def forget(self) -> None:
        """Scales and counts as of a run that has not begun."""
        ctypes.memmove(ctypes.addressof(self.at), self._fresh, len(self._fresh))

    def kept(self) -> tuple[bytes, ...]:
        """All that the steps go on with: state, factors, scales and counts."""
        return (bytes(self.at), *(x.tobytes() for x in (*self._blocks, *self.rows)))

    def go_back(self, kept: tuple[bytes, ...]) -> None:
        """Be as at the time of `kept`, to the last bit."""
        for array, was in zip((*self._blocks, *self.rows), kept[1:], strict=True):
            array[...] = np.frombuffer(was, array.dtype).reshape(array.shape)
        ctypes.memmove(ctypes.addressof(self.at), kept[0], ctypes.sizeof(self.at))

    def limit(self, tangents: int, every: int, most: int, stops: Sequence[Array] | None) -> None:
        """Bound what a step costs, and where the motors go.

        `tangents`: new ones in a step, `every`: steps between two (0: as it takes, both);
        `most`: iterations; `stops`: lowest and highest positions of the motors.
        """
        self.at.allowed, self.at.every, self.at.most = tangents, every, most
        if stops is not None:
            self._stops = tuple(np.array(x, dtype=np.float64) for x in stops)
            self.at.low, self.at.high = (x.ctypes.data for x in self._stops)
        self._fresh = bytes(self.at)


_OF_LAW = ("x_before", "e_before", "target")  # states and errors, and what these are counted from


def _law(state: FeedbackState, h: float, system: System) -> Record:
    """The feedback of a march in steps of h (s), its states by the trapezoidal rule."""
    one, half = state.feedback, 0.5 * h
    law = one.linear
    assert law is not None
    eye = np.eye(len(law.A))
    x_of_x, x_of_e = (
        np.linalg.solve(eye - half * law.A, of) for of in (eye + half * law.A, half * law.B)
    )
    tables = {
        "S": one.S, "B": one.B, "home": one.home, "target": law.target, "x_of_x": x_of_x,
        "x_of_e": x_of_e, "C": law.C, "D": law.D, "E": law.E,
    }  # fmt: skip
    sizes = {"measures": len(one.S), "states": len(eye), "drives": one.B.shape[1]}
    return Record("Law", sizes | {"nq": system.nq, "nv": system.nv}, tables)


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
