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
from pinflex.description.motion import Motion
from pinflex.description.solve import SolveSpec
from pinflex.errors import ConvergenceError
from pinflex.integrators.chebyshev import Interpolation
from pinflex.integrators.linear import Alpha, Method
from pinflex.integrators.run import Run
from pinflex.integrators.schemes import AlphaScheme, scheme
from pinflex.levels.interpolated import InterpolatedPath
from pinflex.levels.linear_march import LinearMarch, Marched, forces_along
from pinflex.levels.linearised import Kept, LinearPath, along
from pinflex.levels.quasistatic import unstable_directions
from pinflex.levels.start import linear_start
from pinflex.levels.varying import Varying
from pinflex.linalg import saddle
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.system import System

_STABILITY_SAMPLES = 21  # instants of a run at which the sign of the stiffness is looked at
_CLOSE = 1e-9  # interpolated matrices: below what a step leaves, above round-off


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
    march: Method,
    start: str = "straight",
    structural: bool = False,
    progress: Callable[[int, int], None] | None = None,
    close: float = _CLOSE,
    every: int = 1,
) -> Run:
    """March the linear deviation; one linear system a step.

    Args:
        mechanism: Mechanism. motion: Motion. t: Equal steps, shape (nt,).
        march: A method of `linear_march`.
        start: straight, static or auto, as in `pinflex.levels.start`.
        structural: Leave out what the motion and the loads add to C and K.
        progress: Called with (step, steps).
        close: What interpolated matrices may miss (see `linearised.along`).
        every: Steps from one sample to the next: only samples are kept. Of a march that blows up,
            every step is.
    Returns:
        The run: nominal motion plus deviation, torques included.
    """
    path, system = nominal(mechanism, motion, t[::every]), mechanism.flexible
    nt, free = len(t), system.free
    h = float(t[-1] - t[0]) / (nt - 1)
    line = LinearPath(mechanism, path)
    systems = along(mechanism, motion, path, structural, close, line.dynamics, t)
    d, v, a = np.zeros((len(path.t), system.nv)), line.v, line.a
    flat = path.straight(system.n_eta)
    begin = linear_start(mechanism, path, structural, start, line.dynamics)
    if isinstance(march, Alpha) and isinstance(systems, InterpolatedPath):
        found, torque, done = _together(systems, march.scheme, h, begin.y, every)
    else:
        found, torque, done = _each(systems, march, h, begin.y, every, progress)
    if done < nt and every > 1:
        return solve_ked(mechanism, motion, t, march, start, structural, progress, close)
    d[:done, free] = found.d[:done]
    v[:done, free] += found.v[:done]
    a[:done, free] += found.a[:done]
    lam = found.lam
    if done < nt:
        y = Manifold(line.dynamics).retract(flat, d)
        raise _blown_up(system, path.t, y, v, a, lam, torque, done, h)
    if progress is not None:
        progress(nt - 1, nt)
    y = Manifold(line.dynamics).retract(flat, d)
    settings: dict[str, object] = {
        "dt": h,
        "terms": "structural" if structural else "full",
    }
    cost: dict[str, float] = {"steps": nt, "newton": nt}
    run = Run(system, path.t, y, v, a, lam, torque, cost, settings, path=path)
    run = begin.told(run)
    if structural:
        return run
    return replace(run, warnings=(*run.warnings, *_diverging(line, run)))


def _together(
    systems: InterpolatedPath, scheme: AlphaScheme, h: float, start: Array, every: int
) -> tuple[Marched, Array, int]:
    """At samples, deviation with all multipliers and torques; the number of sound steps."""
    grid, (M, C, K, r, J, *of_motors) = systems.grid, systems.parts
    load = r.along(grid)
    at, more = _means(grid, r, load, h)
    np.add.at(load, at, more)
    found = LinearMarch(scheme, grid, (M, C, K, J), h)(load, start)
    for k, change, m, j in zip(at, more, M.along(grid, at), J.along(grid, at), strict=True):
        a, lam = saddle(m, j, j, change, np.zeros(len(j)))  # of the load as it is
        found.a[k] += a
        found.lam[k] += lam
    sound = np.all(np.isfinite(found.d), axis=1) & np.all(np.isfinite(found.a), axis=1)
    found = found.sampled(every)
    *own, base = of_motors
    torque = forces_along(grid, own, found, every)
    found.lam[:] += base.along(grid, slice(None, None, every))
    return found, torque, len(sound) if np.all(sound) else int(np.argmin(sound))


def _means(grid: Interpolation, r: Varying, load: Array, h: float) -> tuple[IntArray, Array]:
    """Steps beside a jump of the load, and what its mean over the step around each has more.

    A method of second order feels a jump half a step before the first step that knows of it: up to
    half a step early or late. The mean moves it to where it is.

    Args:
        grid: Times. r: Load by pieces. load: At all steps, shape (nt, n). h: Step [s].
    """
    ends = r.whole()[: grid.nodes].reshape(len(grid.pieces), grid.n + 1, -1)
    before, after, corners = ends[:-1, -1], ends[1:, 0], grid.pieces.corners
    near = np.searchsorted(0.5 * (grid.t[1:] + grid.t[:-1]), corners)
    share = 0.5 + (grid.t[near] - corners) / h
    known = grid.t[near] > corners
    on = grid.pieces.at_corner(grid.t[near])  # known by either side, however that is rounded
    to = [np.linalg.norm(load[near] - x, axis=1) for x in (before, after)]
    known = np.where(on, to[1] < to[0], known)
    return near, (share - known)[:, None] * (after - before)


def _each(
    systems: InterpolatedPath | Kept,
    march: Method,
    h: float,
    start: Array,
    every: int,
    progress: Callable[[int, int], None] | None,
) -> tuple[Marched, Array, int]:
    """The same, step by step."""
    nt, n, rows = systems.count, len(start), len(systems.at(0).base)
    found = Marched(*(np.empty((nt, width)) for width in (n, n, n, rows)))
    torque = np.empty((nt, len(systems.at(0).motors.r)))
    for k, state in enumerate(march(lambda k: systems.at(k).free, nt, h, start)):
        if not np.all(np.isfinite(state.d)) or not np.all(np.isfinite(state.a)):
            return found, torque, k
        here = systems.at(k)
        now = here.motors
        left = now.r + now.M @ state.a + now.C @ state.v + now.K @ state.d
        torque[k], found.lam[k] = left - now.J.T @ state.lam, here.base + state.lam
        found.d[k], found.v[k], found.a[k] = state.d, state.v, state.a
        if progress is not None and k % 64 == 0:
            progress(k, nt)
    return found.sampled(every), torque[::every], nt


def _diverging(line: LinearPath, run: Run) -> tuple[str, ...]:
    """Where the stiffness of the deflected mechanism has lost its sign, as a warning.

    The march is about the rigid motion, whose stiffness may be positive where that of the pose it
    finds is not: there the links buckle (static divergence), and the linear answer is none.
    """
    dynamics, path = line.dynamics, line.path
    for k in np.linspace(0, len(run.t) - 1, min(_STABILITY_SAMPLES, len(run.t))).astype(int):
        rest = np.zeros(run.system.n_eta)  # as level quasistatic looks: without the vibration
        v, a = np.concatenate([path.v[k], rest]), np.concatenate([path.a[k], rest])
        t = float(run.t[k])
        if unstable_directions(dynamics, run.y[k], v, a, run.lam[k], t, run.system.free):
            return (
                f"t = {run.t[k]:.4g} s: the stiffness of the deflected links is negative in some "
                "direction (static divergence: they buckle), of which the linear deviation knows "
                "nothing. From there on trust coupled; or reduce the loads, or stiffen the links.",
            )
    return ()


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
        "bound. Use level=coupled, or a smaller dt. error.result holds the run so far.",
        time=float(t[k]),
    )
    upto = slice(0, k)
    error.result = Run(
        system, t[upto], y[upto], v[upto], a[upto], lam[upto], torque[upto], {"steps": k},
        stopped="diverged",
    )  # fmt: skip
    return error
