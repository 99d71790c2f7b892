"""Kineto-elastodynamics: linear, time-varying deviation from the nominal rigid motion.

    M(t) dd + C(t) d + K(t) d - J(t)' dlam = -r(t),     J(t) d = 0

r(t) is what the nominal motion leaves unbalanced. M, C and K are the exact derivatives of the full
equations along the nominal motion, so `coupled` tends to this level for small deflections.
`structural` keeps M, the beams' K and the damping only, as the classical method does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import SolveSpec
from pinflex.errors import ConvergenceError, Ending
from pinflex.integrators.chebyshev import Interpolation, Varying
from pinflex.integrators.collocation import AlphaScheme, scheme
from pinflex.integrators.linear import Alpha, Method
from pinflex.integrators.run import Run, Settings
from pinflex.kernel.linear import entries_of, linear_systems
from pinflex.levels.linear_march import LinearMarch, Response, forces_along
from pinflex.levels.linearised import EveryStep, InterpolatedPath, LinearPath, along
from pinflex.levels.quasistatic import unstable_directions
from pinflex.levels.start import linear_start
from pinflex.linalg import resists, saddle
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.system import System

_STABILITY_SAMPLES = 21  # instants of a run at which the sign of the stiffness is looked at
# What interpolated matrices may miss: default steps leave 1e-3 of a vibration, round-off 1e-12. A
# method from outside may take differences of them, as mode superposition does, over h^2.
_CLOSE, _CLOSER = 1e-8, 1e-12


def method_of(spec: SolveSpec) -> Method:
    """The method that a scene names or gives: one of the alpha family, or any function of steps."""
    given = spec.method
    if isinstance(given, AlphaScheme):
        return Alpha(given)
    if callable(given):
        return partial(given, **spec.method_options)
    rho_inf = 0.8 if spec.rho_inf is None else spec.rho_inf
    return Alpha(scheme(spec.by_steps, rho_inf, spec.newmark))


def solve_ked(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    method: Method,
    start: str = "straight",
    structural: bool = False,
    progress: Callable[[int, int], None] | None = None,
    close: float | None = None,
    every: int = 1,
) -> Run:
    """March the linear deviation; one linear system a step.

    Returns:
        The run: nominal motion plus deviation, torques included.
    """
    path, system = nominal(mechanism, motion, t[::every]), mechanism.flexible
    h = float(t[-1] - t[0]) / (len(t) - 1)
    line = LinearPath(mechanism, path)
    if close is None:
        close = _CLOSE if isinstance(method, Alpha) else _CLOSER
    systems = along(mechanism, motion, path, structural, close, line.dynamics, t)
    begin = linear_start(mechanism, path, structural, start, line.dynamics)
    if isinstance(method, Alpha) and isinstance(systems, InterpolatedPath):
        deviation, torque = _alpha(systems, method.scheme, h, begin.y, every)
    else:
        deviation, torque = _stepped(systems, method, h, begin.y, every, progress)
    done = deviation.sound
    if done < len(path.t) and every > 1:
        return solve_ked(mechanism, motion, t, method, start, structural, progress, close)
    d, v, a = np.zeros((len(path.t), system.nv)), line.v.copy(), line.a.copy()
    d[:done, system.free] = deviation.d[:done]
    v[:done, system.free] += deviation.v[:done]
    a[:done, system.free] += deviation.a[:done]
    y = Manifold(line.dynamics).retract(path.straight(system.n_eta), d)
    if done < len(path.t):
        raise _blown_up(system, path.t, y, v, a, deviation.lam, torque, done, h)
    if progress is not None:
        progress(len(t) - 1, len(t))
    settings: Settings = {"dt": h, "terms": "structural" if structural else "full"}
    cost: dict[str, float] = {"steps": len(t), "newton": len(t)}
    run = Run(system, path.t, y, v, a, deviation.lam, torque, cost, settings, path=path)
    run = begin.told(run)
    if structural:
        return run
    return replace(run, warnings=(*run.warnings, *_diverging(line, run)))


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
    square = (x.picked(motors, free) for x in (M, C, K))
    of_motors = *square, J.picked(_every(J), motors), r.picked(motors)
    torque = forces_along(grid, of_motors, sampled, every)
    sampled.lam[:] += base.along(grid, slice(None, None, every))
    return sampled, torque


def _every(J: Varying) -> IntArray:
    return np.arange(J.shape[0])


def _means(grid: Interpolation, r: Varying, load: Array, h: float) -> tuple[IntArray, Array]:
    """Steps beside a jump of the load, and what its mean over the step around each has more.

    A method of second order feels a jump half a step before the first step that knows of it: up to
    half a step early or late. The mean moves it to where it is.
    """
    pieces = grid.by_piece(r.whole())
    shape = len(pieces) - 1, load.shape[1]
    before = np.array([x[-1] for x in pieces[:-1]]).reshape(shape)
    after = np.array([x[0] for x in pieces[1:]]).reshape(shape)
    corners = grid.pieces.corners
    near = np.searchsorted(0.5 * (grid.t[1:] + grid.t[:-1]), corners)
    share = 0.5 + (grid.t[near] - corners) / h
    known = grid.t[near] > corners
    on = grid.pieces.at_corner(grid.t[near])  # known by either side, however that is rounded
    to = [np.linalg.norm(load[near] - x, axis=1) for x in (before, after)]
    known = np.where(on, to[1] < to[0], known)
    return near, (share - known)[:, None] * (after - before)


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
    states = run.y[at], line.v[at], line.a[at], run.lam[at], compiled.scale(run.t[at])
    linear_systems(compiled.evaluator, states, entries, result, rates=False)
    K, J = np.split(result, [len(free) ** 2], axis=1)
    n = len(free)
    return resists(K.reshape(count, n, n), J.reshape(count, closures, n))


def _blown_up(
    system: System,
    t: Array,
    y: Array,
    v: Array,
    a: Array,
    lam: Array,
    torque: Array,
    k: int,
    h: float,
) -> ConvergenceError:
    error = ConvergenceError(
        f"t = {t[k]:.6g} s, step {k}, dt = {h:.3g} s: the linear deviation grows without "
        f"bound. {Ending.LINEAR_GROWS.value} error.result holds the run so far.",
        time=float(t[k]),
        ending=Ending.LINEAR_GROWS,
    )
    upto = slice(0, k)
    error.result = Run(
        system, t[upto], y[upto], v[upto], a[upto], lam[upto], torque[upto], {"steps": k}
    )
    return error
