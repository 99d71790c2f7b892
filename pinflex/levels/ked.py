"""Kineto-elastodynamics: linear, time-varying deviation from the nominal rigid motion.

    M(t) dd + C(t) d + K(t) d - J(t)' dlam = -r(t),     J(t) d = 0

r(t) is what the nominal motion leaves unbalanced. M, C and K are the exact derivatives of the full
equations along the nominal motion, so `coupled` tends to this level for small deflections.
`structural` keeps M, the beams' K and the damping only, as the classical method does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinflex.actuation.drive import Nominal, between, breaks, nominal
from pinflex.arrays import Array, BoolArray, IntArray, distinct
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import SolveSpec
from pinflex.errors import ConvergenceError, DescriptionError, Ending
from pinflex.integrators.chebyshev import Interpolation, Varying
from pinflex.integrators.collocation import (
    Across,
    AlphaScheme,
    Instant,
    Method,
    State,
    alpha,
    collocated,
    radau,
    scheme,
    start_anew,
    start_at_rest,
)
from pinflex.integrators.equal_steps import STAGES, crossing
from pinflex.integrators.problem import Run, Settings
from pinflex.kernel.evaluate import entries_of
from pinflex.kernel.library import Record, kernel, loaded, numbers, place
from pinflex.levels.linearised import EveryStep, InterpolatedPath, LinearPath, along
from pinflex.levels.quasistatic import unstable_directions
from pinflex.levels.start import Start, linear_start
from pinflex.linalg import resists, saddle
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism

# March of a linear system along a path, under any number of loads.
#
#     M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0
#
# Systems and their factors do not depend on the load: marches may go on side by side, each with
# loads that come of the responses before it. A window of steps is factored at a time.

_WINDOW = 64  # steps at a time, at the least
_VALUES = 100_000  # varying entries of the systems of a window (0.8 MB): caches are small
_FACTORS = 2_000_000  # numbers of factors that a window keeps (16 MB)
_FEWEST = 16  # systems whose factors are kept, however large
_OF_METHOD = ("mass_factor", "beta", "gamma", "alpha_m", "alpha_f")


class Response(NamedTuple):
    """Deviation d, its rates v and a, (nt, n) each, and multipliers lam (nt, closures)."""

    d: Array
    v: Array
    a: Array
    lam: Array

    @classmethod
    def empty(cls, steps: int, n: int, closures: int) -> Response:
        """Room for one."""
        return cls(*(np.empty((steps, width)) for width in (n, n, n, closures)))

    def put(self, at: int | slice, part: State | Response) -> None:
        """Write a step, or some."""
        self.d[at], self.v[at], self.a[at], self.lam[at] = part.d, part.v, part.a, part.lam

    def plus(self, d: Array, v: Array, a: Array, lam: Array | float = 0.0) -> Response:
        """With more of the motion."""
        return Response(self.d + d, self.v + v, self.a + a, self.lam + lam)

    def sampled(self, every: int) -> Response:
        """Every n-th step."""
        return Response(*(x[::every] for x in self))

    @property
    def sound(self) -> int:
        """Number of steps before the first that is not finite."""
        finite = np.all(np.isfinite(self.d), axis=1) & np.all(np.isfinite(self.a), axis=1)
        return len(finite) if np.all(finite) else int(np.argmin(finite))


def forces_along(
    grid: Interpolation, parts: Sequence[Varying], response: Response, every: int = 1
) -> Array:
    """Forces M a + C v + K d - J' lam at every step, shape (nt, k): what motors give beyond r."""
    force = np.empty((len(response.d), parts[0].shape[0]))
    each = max(_WINDOW, _VALUES // max(parts[0].constant.size, 1))
    for start in range(0, len(force), each):
        s = slice(start, min(start + each, len(force)))
        steps = slice(s.start * every, s.stop * every, every)
        M, C, K, J = (x.along(grid, steps) for x in parts)
        d, v, a, lam = (x[s, :, None] for x in response)
        force[s] = (M @ a + C @ v + K @ d - J.swapaxes(1, 2) @ lam)[:, :, 0]
    return force


class Workspace:
    """Buffer shared by successive marches; first touch of new memory is slow.

    Attributes:
        owner: Whose numbers are there.
    """

    def __init__(self) -> None:
        self._numbers = np.empty(0)
        self.owner: LinearMarch | None = None

    def take(self, owner: LinearMarch, size: int) -> Array:
        """The buffer, for another owner; what was there is lost."""
        self.owner = owner
        if len(self._numbers) < size:
            self._numbers = np.empty(size)
        return self._numbers[:size]


class LinearMarch:
    """The systems of marches at equal steps, by a method of the alpha family."""

    def __init__(
        self,
        scheme: AlphaScheme,
        grid: Interpolation,
        parts: Sequence[Varying],
        h: float,
        workspace: Workspace | None = None,
    ) -> None:
        """Nothing is factored yet."""
        self.scheme, self.grid, self.h, self.parts = scheme, grid, h, tuple(parts)
        self._workspace, self._shared = workspace or Workspace(), workspace is not None
        self._window: slice | None = None
        self._values: tuple[Array, IntArray] = np.empty(0), np.empty(0, dtype=np.intp)

    def instant(self, k: int, load: Array) -> Instant:
        """The system at a step, under a load (n,)."""
        M, C, K, J = (x.along(self.grid, slice(k, k + 1))[0] for x in self.parts)
        return Instant(M, C, K, load, J)

    def __call__(self, load: Array, start: Array) -> Response:
        """March from rest."""
        march = self.begin()
        for s in self.windows():
            march.go(s, load[s], start)
        return march.response

    def begin(self) -> RunningMarch:
        """One of some marches that go on side by side, window by window."""
        return RunningMarch(self)

    def windows(self) -> Iterator[slice]:
        """Steps that are taken at a time: the first, then as many as share the workspace."""
        count, each = len(self.grid.t), self._steps
        yield slice(0, 1)
        yield from (slice(k, min(k + each, count)) for k in range(1, count, each))

    @cached_property
    def _steps(self) -> int:
        """Steps in a window."""
        if self._shared:
            size = self.parts[0].shape[0] + self.parts[3].shape[0]
            steps = max(_FEWEST, _FACTORS // max(size * size, 1))
        else:
            steps = max(_WINDOW, _VALUES // max(self._nodes.shape[1], 1))
        return int(min(steps, max(len(self.grid.t) - 1, 1)))

    # On the kernel -------------------------------------------------------------------------

    @property
    def compiled(self) -> bool:
        """Whether the kernel marches."""
        n = self.parts[0].shape[0]
        return kernel().functions is not None and n > 0 and len(self.grid.t) > 1

    def advance(self, s: slice, load: Array, state: Array, response: Response) -> bool:
        """Steps of a window by the kernel; False where a system is singular.

        `state`: d, v, a and the algorithmic acceleration that the next step starts from, (4, n).
        """
        values, system = self._opened(s)
        at, (rows, n), count = self._record.at, self.parts[3].shape, len(system)
        self._record.arrays["state"][:] = state
        at.count, at.system, at.value = count, system.ctypes.data, values.ctypes.data
        given = numbers(load, count, n)
        at.load = given.ctypes.data
        widths = zip(response, (n, n, n, rows), strict=True)
        at.d, at.v, at.a, at.lam = (place(x[s], count, width) for x, width in widths)
        done = loaded().pinflex_linear_march(self._record.address)
        state[:] = self._record.arrays["state"]
        return bool(done == count)

    def _opened(self, s: slice) -> tuple[Array, IntArray]:
        """Varying entries of the systems of a window, and which of them is each step's."""
        if s != self._window or self._workspace.owner is not self:
            at, system = np.unique(self._at[s], return_inverse=True)
            width, size = self._nodes.shape[1], sum(self.parts[3].shape)
            factors = self._steps * size * size if self._shared else 0
            room = self._workspace.take(self, factors + len(at) * width)
            if self._shared:
                self._record.at.lu = room.ctypes.data
            self._record.arrays["holds"][:] = 0
            values = room[factors:].reshape(len(at), width)
            self.grid.between(self._nodes, at, values)
            self._window, self._values = s, (values, system)
        return self._values

    @cached_property
    def _at(self) -> IntArray:
        """A step at which the system is that of each step: pieces at rest have only one."""
        grid, steps = self.grid, np.arange(len(self.grid.t))
        rests = np.ones(len(grid.pieces), dtype=bool)
        for x, varying in zip(self.parts, self._varying, strict=True):
            for k, nodes in enumerate(grid.by_piece(varying)):
                rests[k] &= bool(np.all(np.ptp(nodes, axis=0) <= x.noise))
        for piece in np.flatnonzero(rests):
            here = grid.piece == piece
            here[grid.corners] = False
            steps[here] = np.argmax(here)
        return steps

    @cached_property
    def _entries(self) -> tuple[BoolArray, BoolArray]:
        """Entries of M, C or K, and of J, that vary, shapes (n, n) and (closures, n)."""
        M, C, K, J = (x.varies for x in self.parts)
        return M | C | K, J

    @cached_property
    def _varying(self) -> list[Array]:
        """Those entries of M, C, K and J at the nodes, column by column, (size, .) each."""
        square, J_at = (np.nonzero(x.T)[::-1] for x in self._entries)
        places = square, square, square, J_at
        return [x.entries_at(at) for x, at in zip(self.parts, places, strict=True)]

    @cached_property
    def _nodes(self) -> Array:
        """The same of S, C, K and J side by side, shape (size, width)."""
        M, C, K, J = self._varying
        return np.hstack([self._weighted(M, C, K), C, K, J])

    def _weighted(self, M: Array, C: Array, K: Array) -> Array:
        """S, which the acceleration of a step is solved with."""
        by_a, by_v, by_d = self.scheme.weights(self.h)
        return by_a * M + by_v * C + by_d * K

    @cached_property
    def _record(self) -> Record:
        """`Linear` in kernel/source/linear_march.c, of which nothing is factored yet.

        What is constant of the systems, zero where entries vary; column by column.
        """
        square, closures = self._entries
        M, C, K = (np.where(square, 0.0, x.constant) for x in self.parts[:3])
        J = np.where(closures, 0.0, self.parts[3].constant)
        given = {"S": self._weighted(M, C, K).T, "J": J.T}
        given["col_at"], given["row"] = _columns(square)
        given["J_col_at"], given["J_row"] = _columns(closures)
        for name, x in (("C", C), ("K", K)):
            given[f"{name}_at"], given[f"{name}_row"] = _columns(x != 0.0)
            given[name] = x.T[x.T != 0.0]
        (rows, n), kept = J.shape, self._shared
        self._lu = np.empty(0 if kept else (n + rows) ** 2)
        sizes = {"n": n, "rows": rows, "size": n + rows, "rooms": self._steps if kept else 1}
        method = {name: getattr(self.scheme, name) for name in _OF_METHOD}
        lu = self._lu.ctypes.data
        return Record("Linear", sizes, given, kept=int(kept), lu=lu, h=self.h, **method)


def _columns(varies: BoolArray) -> tuple[IntArray, IntArray]:
    """Where the entries of each column start, and their rows."""
    col, row = np.nonzero(varies.T)
    return np.searchsorted(col, np.arange(varies.shape[1] + 1)), row


class RunningMarch:
    """One march among some on the same systems.

    Attributes:
        response: All steps; those of the windows so far are written.
    """

    def __init__(self, march: LinearMarch) -> None:
        self._march, count = march, len(march.grid.t)
        closures, n = march.parts[3].shape
        self.response = Response.empty(count, n, closures)
        self._load, self._state = np.empty((count, n)), np.empty((4, n))
        self._start, self._compiled = np.zeros(n), march.compiled
        self._plain: Iterator[State] | None = None

    def go(self, s: slice, load: Array, start: Array) -> None:
        """Take the steps of a window."""
        self._load[s] = load
        if s.start == 0:
            self._start = start
        if self._compiled:
            if s.start == 0:
                first = start_at_rest(self._march.instant(0, load[0]), start)
                self.response.put(0, first)
                self._state[:] = first.d, first.v, first.a, first.a
                return
            if self._march.advance(s, self._load[s], self._state, self.response):
                return
            self._compiled = False
        if self._plain is None:  # from the first step on, also where the kernel gave up later
            march, s = self._march, slice(0, s.stop)
            count, load = len(self._load), self._load
            self._plain = alpha(
                march.scheme, lambda k: march.instant(k, load[k]), count, march.h, self._start
            )
        for k, state in zip(range(s.start, s.stop), self._plain, strict=False):
            self.response.put(k, state)


_STABILITY_SAMPLES = 21  # instants of a run at which the sign of the stiffness is looked at
# What interpolated matrices may miss: default steps leave 1e-3 of a vibration, round-off 1e-12. A
# method from outside may take differences of them, as mode superposition does, over h^2.
_CLOSE, _CLOSER = 1e-8, 1e-12
_GAUSS = 3  # points of a mean over a part of a step, exact up to h^5
_BESIDE = 1e-10  # of the time: beyond what motions and loads snap to


def method_of(spec: SolveSpec) -> AlphaScheme | Method:
    """The method that a scene names or gives: one of the alpha family, or any function of steps."""
    given = spec.method
    if isinstance(given, AlphaScheme):
        return given
    if callable(given):
        return partial(given, **spec.method_options)
    rho_inf = 0.8 if spec.rho_inf is None else spec.rho_inf
    return scheme(spec.by_steps, rho_inf, spec.newmark)


def solve_ked(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    method: AlphaScheme | Method,
    start: str = "straight",
    structural: bool = False,
    progress: Callable[[int, int], None] | None = None,
    close: float | None = None,
    every: int = 1,
) -> Run:
    """March the linear deviation, one linear system a step: the nominal motion and this."""
    level = _Ked(mechanism, motion, t, structural, every)
    begin = level.predict(start)
    systems = level.residual(close or (_CLOSE if isinstance(method, AlphaScheme) else _CLOSER))
    deviation, torque = level.correct(systems, method, begin.y, progress)
    if deviation.sound < len(level.path.t) and every > 1:
        return solve_ked(mechanism, motion, t, method, start, structural, progress, close)
    run = begin.told(level.accept(deviation, torque))
    if progress is not None:
        progress(len(t) - 1, len(t))
    if structural:
        return run
    return replace(run, warnings=(*run.warnings, *_diverging(level.line, run)))


class _Ked:
    """The level: M(t) a + C(t) v + K(t) d - J(t)' lam = -r(t), J(t) d = 0 about a motion.

    Prescribed is the nominal motion; it starts from equilibrium or straight links. The residual is
    what the rigid motion leaves unbalanced, with the systems that resist it; the march corrects.
    """

    def __init__(
        self, mechanism: Mechanism, motion: Motion, t: Array, structural: bool, every: int
    ) -> None:
        self._mechanism, self._motion, self._t, self._every = mechanism, motion, t, every
        self._structural, self.system = structural, mechanism.flexible
        self.h = float(t[-1] - t[0]) / (len(t) - 1)
        self.path = self.prescribe()
        self.line = LinearPath(mechanism, self.path)

    def prescribe(self) -> Nominal:
        """The nominal motion at the samples."""
        return nominal(self._mechanism, self._motion, self._t[:: self._every])

    def predict(self, start: str) -> Start:
        """The deviation to begin with."""
        dynamics = self.line.dynamics
        return linear_start(self._mechanism, self.path, self._structural, start, dynamics)

    def residual(self, close: float) -> InterpolatedPath | EveryStep:
        """M, C, K, J and r at every step, known as closely as that."""
        given = self._mechanism, self._motion, self.path, self._structural, close
        return along(*given, self.line.dynamics, self._t)

    def correct(
        self, systems: InterpolatedPath | EveryStep, method: AlphaScheme | Method, start: Array,
        progress: Callable[[int, int], None] | None,
    ) -> tuple[Response, Array]:  # fmt: skip
        """The deviation and the motors' torques at the samples.

        Raises:
            DescriptionError: A mass comes or goes, of which a method from outside knows nothing.
        """
        if self.system.added.instants:
            if not isinstance(method, AlphaScheme):
                raise DescriptionError(
                    f"{self._mechanism.name}: payload: from, until: level ked takes them with a "
                    "method of the alpha family. Leave out solve.integrator."
                )
            method = partial(alpha, method, across=self._across(systems))
        elif isinstance(method, AlphaScheme):
            if isinstance(systems, InterpolatedPath):
                return _alpha(systems, method, self.h, start, self._every)
            method = partial(alpha, method)
        return _stepped(systems, method, self.h, start, self._every, progress)

    def _across(self, systems: InterpolatedPath | EveryStep) -> Across:
        """Steps in which something jumps, taken up to there and from there."""
        t, c, dynamics = self._t, radau(STAGES).c, self.line.dynamics

        def step(k: int, inside: Array, state: State) -> State:
            for a, b in pairwise([t[k - 1], *inside, t[k]]):
                times = a + (b - a) * c
                times[-1] -= _BESIDE * max(1.0, b)  # just before a jump
                path = between(self._mechanism, self._motion, self.path, times)
                line = LinearPath(self._mechanism, path, self._structural, dynamics)
                at = [line.at(i).free for i in range(len(c))]
                state = collocated(radau(STAGES), at, b - a, state)
            return start_anew(systems.at(k).free, state)

        crossed = crossing(breaks(self._motion, self.system.loads), t)
        return {k: partial(step, k, inside) for k, inside in crossed.items()}

    def accept(self, deviation: Response, torque: Array) -> Run:
        """The nominal motion with its deviation.

        Raises:
            ConvergenceError: This grows without bound; with `.result` up to there.
        """
        system, path, line, done = self.system, self.path, self.line, deviation.sound
        d, v, a = np.zeros((len(path.t), system.nv)), line.v.copy(), line.a.copy()
        d[:done, system.free] = deviation.d[:done]
        v[:done, system.free] += deviation.v[:done]
        a[:done, system.free] += deviation.a[:done]
        y = Manifold(line.dynamics).retract(path.straight(system.n_eta), d)
        states = path.t, y, v, a, deviation.lam, torque
        if done < len(path.t):
            error = ConvergenceError(
                f"t = {path.t[done]:.6g} s, step {done}, dt = {self.h:.3g} s: the linear deviation "
                f"grows without bound. {Ending.LINEAR_GROWS.value} error.result holds the run so "
                "far.",
                time=float(path.t[done]),
                ending=Ending.LINEAR_GROWS,
            )
            error.result = Run(system, *states, {"steps": done}).at(slice(0, done))
            raise error
        settings: Settings = {"dt": self.h, "terms": "structural" if self._structural else "full"}
        cost: dict[str, float] = {"steps": len(self._t), "newton": len(self._t)}
        return Run(system, *states, cost, settings, path=path)


def _alpha(
    systems: InterpolatedPath, scheme: AlphaScheme, h: float, start: Array, every: int
) -> tuple[Response, Array]:
    """At samples, deviation with all multipliers and torques."""
    grid, (M, C, K, J, r, base) = systems.grid, systems.parts
    rows, n = M.shape
    free, motors = np.arange(n), np.arange(n, rows)
    M_f, C_f, K_f, J_f = *(x.picked(free, free) for x in (M, C, K)), J.picked(_every(J), free)
    load = r.picked(free).along(grid)
    at, change = _means(grid, r.picked(free), load, h)
    np.add.at(load, at, change)
    response = LinearMarch(scheme, grid, (M_f, C_f, K_f, J_f), h)(load, start)
    for k, more, m, j in zip(at, change, M_f.along(grid, at), J_f.along(grid, at), strict=True):
        a, lam = saddle(m, j, j, more, np.zeros(len(j)))  # of the load as it is
        response.a[k] += a
        response.lam[k] += lam
    sampled = response.sampled(every)
    at_samples = slice(None, None, every)
    of_motors = *(x.picked(motors, free) for x in (M, C, K)), J.picked(_every(J), motors)
    torque = r.picked(motors).along(grid, at_samples)
    torque += forces_along(grid, of_motors, sampled, every)
    sampled.lam[:] += base.along(grid, at_samples)
    return sampled, torque


def _every(J: Varying) -> IntArray:
    return np.arange(J.shape[0])


def _means(grid: Interpolation, r: Varying, load: Array, h: float) -> tuple[IntArray, Array]:
    """Steps beside corners of the load, and what its mean over the step around each has more.

    A method of second order feels a jump half a step before the first step that knows of it, up to
    half a step early or late, and of a ramp shorter than a step nothing but its ends. The mean,
    piece by piece, moves both to where they are.
    """
    pieces, corners, half = grid.by_piece(r.whole()), grid.pieces.corners, 0.5 * h
    near = distinct(np.searchsorted(grid.t[:-1] + half, corners))
    begins = np.maximum(grid.t[near] - half, grid.t[0])
    ends = np.minimum(grid.t[near] + half, grid.t[-1])
    mean = np.empty((len(near), load.shape[1]))
    x, weight = np.polynomial.legendre.leggauss(_GAUSS)
    for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        inside = corners[(corners > begin) & (corners < end)]
        marks = np.array([begin, *inside, end])
        parts = np.diff(marks)[:, None]
        t = marks[:-1, None] + 0.5 * parts * (1.0 + x)
        values = grid.pieces.between(pieces, t.ravel())
        mean[k] = (0.5 * parts * weight).ravel() @ values / (end - begin)
    return near, mean - load[near]


def _stepped(
    systems: InterpolatedPath | EveryStep,
    method: Method,
    h: float,
    start: Array,
    every: int,
    progress: Callable[[int, int], None] | None,
) -> tuple[Response, Array]:
    """The same, step by step; up to the first that is not finite, by NaN from there on."""
    first, count = systems.at(0), systems.count
    closures, rows = first.J.shape
    response = Response(*(np.full((count, k), np.nan) for k in (*(len(start),) * 3, closures)))
    torque = np.full((count, rows - len(start)), np.nan)
    for k, state in enumerate(method(lambda k: systems.at(k).free, count, h, start)):
        if not np.all(np.isfinite(state.d)) or not np.all(np.isfinite(state.a)):
            break
        now = systems.at(k)
        response.put(k, replace(state, lam=now.base + state.lam))
        torque[k] = now.motor_forces(state.d, state.v, state.a, state.lam)
        if progress is not None and k % 64 == 0:
            progress(k, count)
    return response.sampled(every), torque[::every]


def _diverging(line: LinearPath, run: Run) -> tuple[str, ...]:
    """Where the stiffness of the deflected mechanism has lost its sign, as a warning.

    The march is about the rigid motion, whose stiffness may be positive where that of the pose it
    finds is not: there the links buckle (static divergence), and the linear answer is none.
    """
    at = np.linspace(0, len(run.t) - 1, min(_STABILITY_SAMPLES, len(run.t))).astype(int)
    if _resists(line, run, at):
        return ()
    for k in at:  # as level quasistatic looks: without the vibration
        y, v, a, t = run.y[k], line.v[k], line.a[k], float(run.t[k])
        if unstable_directions(line.dynamics, y, v, a, run.lam[k], t, run.system.free):
            return (
                f"t = {run.t[k]:.4g} s: the stiffness of the deflected links is negative in some "
                "direction (static divergence: they buckle), of which the linear deviation knows "
                "nothing. From there on trust coupled; or reduce the loads, or stiffen the links.",
            )
    return ()


def _resists(line: LinearPath, run: Run, at: IntArray) -> bool:
    """Whether the stiffness is plainly positive at some instants, all looked at together."""
    system, compiled = run.system, line.dynamics.compiled
    if compiled is None:
        return False
    free, closures, count = system.free, system.closed.n, len(at)
    entries = entries_of("KJ", system.nv, closures, free, free)
    result = np.empty((count, len(entries)))
    states = run.y[at], line.v[at], line.a[at], run.lam[at], run.t[at]
    compiled.linear_systems(states, entries, result, rates=False)
    K, J = np.split(result, [len(free) ** 2], axis=1)
    n = len(free)
    return resists(K.reshape(count, n, n), J.reshape(count, closures, n))
