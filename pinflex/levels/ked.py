"""Kineto-elastodynamics: linear, time-varying deviation from the nominal rigid motion.

    M(t) dd + C(t) d + K(t) d - J(t)' dlam = -r(t),     J(t) d = 0

r(t) is what the nominal motion leaves unbalanced. M, C and K are the exact derivatives of the full
equations along the nominal motion, so `coupled` tends to this level for small deflections.
`structural` keeps M, the beams' K and the damping only, as the classical method does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from pinflex.actuation.nominal import Nominal, nominal
from pinflex.arrays import Array, IntArray
from pinflex.description.motion import Motion
from pinflex.description.supplement import SolveSpec
from pinflex.errors import ConvergenceError
from pinflex.levels.integrators import scheme
from pinflex.levels.linear_march import (
    Instant,
    March,
    alpha,
    central_difference,
    houbolt,
    wilson_theta,
)
from pinflex.levels.mode_superposition import mode_superposition
from pinflex.levels.quasistatic import structural_stiffness
from pinflex.levels.run import Run
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.system import System


def march_of(spec: SolveSpec) -> March:
    """The method that a scene names: one of the alpha family, or one for linear systems."""
    if spec.integrator == "central_difference":
        return central_difference
    if spec.integrator == "houbolt":
        return houbolt
    if spec.integrator == "wilson_theta":
        return partial(wilson_theta, theta=1.4 if spec.theta is None else spec.theta)
    if spec.integrator == "mode_superposition":
        return partial(mode_superposition, modes=12 if spec.modes is None else spec.modes)
    rho_inf = 0.8 if spec.rho_inf is None else spec.rho_inf
    return partial(alpha, scheme(spec.integrator, rho_inf, spec.newmark))


def solve_ked(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    march: March,
    static: bool = False,
    structural: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """March the linear deviation; one linear system a step.

    Args:
        mechanism: Mechanism. motion: Motion. t: Equal steps, shape (nt,).
        march: A method of `linear_march`.
        static: Start from the balance of the first instant instead of the undeformed pose.
        structural: Leave out what the motion and the loads add to C and K.
        progress: Called with (step, steps).
    Returns:
        The run: nominal motion plus deviation, torques included.
    """
    path, system = nominal(mechanism, motion, t), mechanism.flexible
    dynamics = Dynamics(system)
    nt, m, nv = len(path.t), int(system.rigid.nv), system.nv
    free, motors, rows = system.free, system.motors, system.closed.n
    h = float(t[-1] - t[0]) / (nt - 1)
    y, lam = np.empty((nt, system.nq)), np.empty((nt, rows))
    v, a = np.zeros((nt, nv)), np.zeros((nt, nv))
    v[:, :m], a[:, :m] = path.v, path.a
    torque = np.empty((nt, len(motors)))
    line = Line(mechanism, path, v.copy(), a.copy(), structural)
    start = np.zeros(nv)
    if static:
        start[free] = _static_deviation(line.free(0))
    for k, state in enumerate(march(line.free, nt, h, start[free])):
        if not np.all(np.isfinite(state.d)) or not np.all(np.isfinite(state.a)):
            raise _blown_up(system, path.t, y, v, a, lam, torque, k, h)
        here = line.full(k)
        d, dv, da = (_spread(x, free, nv) for x in (state.d, state.v, state.a))
        now = here.instant
        left = now.r + now.M @ da + now.C @ dv + now.K @ d - now.J.T @ state.lam
        torque[k], lam[k] = left[motors], here.base + state.lam
        y[k] = dynamics.integrate(line.flat(k), d)
        v[k] += dv
        a[k] += da
        if progress is not None and k % 64 == 0:
            progress(k, nt)
    settings: dict[str, object] = {
        "dt": h,
        "terms": "structural" if structural else "full",
    }
    cost: dict[str, float] = {"steps": nt, "newton": nt}
    return Run(system, path.t, y, v, a, lam, torque, cost, settings, path=path)


def _static_deviation(now: Instant) -> Array:
    """The linear balance K d - J' dlam = -r, J d = 0 of an instant: what the march starts from.

    The nonlinear balance would leave J d of second order, which the march divides by h^2.
    """
    n, rows = len(now.r), len(now.J)
    S = np.zeros((n + rows, n + rows))
    S[:n, :n], S[:n, n:], S[n:, :n] = now.K, -now.J.T, now.J
    solution = np.linalg.solve(S, np.concatenate([-now.r, np.zeros(rows)]))
    return np.asarray(solution[:n])


def _spread(x: Array, rows: IntArray, nv: int) -> Array:
    full = np.zeros(nv)
    full[rows] = x
    return full


@dataclass(frozen=True)
class Here:
    """All rows of the system at one step, and the multipliers of the rigid motion."""

    instant: Instant
    base: Array


class Line:
    """The linear system along the nominal motion, step by step; the last few are kept."""

    def __init__(
        self, mechanism: Mechanism, path: Nominal, v: Array, a: Array, structural: bool
    ) -> None:
        self.dynamics = Dynamics(mechanism.flexible)
        self.path, self.v, self.a = path, v, a
        self.damping = mechanism.description.system_damping
        self.structure = structural_stiffness(self.dynamics)
        self.structural = structural
        self.straight = np.zeros(mechanism.flexible.n_eta)
        self.kept: dict[int, tuple[Here, Instant]] = {}

    def flat(self, k: int) -> Array:
        """The undeformed pose of step k."""
        return np.concatenate([self.path.q[k], self.straight])

    def full(self, k: int) -> Here:
        """The system in all coordinates."""
        return self._at(k)[0]

    def free(self, k: int) -> Instant:
        """The system in the free coordinates."""
        return self._at(k)[1]

    def _at(self, k: int) -> tuple[Here, Instant]:
        if k not in self.kept:
            while len(self.kept) > 5:  # mode superposition looks three steps around
                self.kept.pop(min(self.kept, key=lambda j: -abs(j - k)))
            here = self._evaluate(k)
            at, now = self.dynamics.system.free, here.instant
            square = np.ix_(at, at)
            part = Instant(now.M[square], now.C[square], now.K[square], now.r[at], now.J[:, at])
            self.kept[k] = here, part
        return self.kept[k]

    def _evaluate(self, k: int) -> Here:
        dynamics, system = self.dynamics, self.dynamics.system
        y, v, a = self.flat(k), self.v[k], self.a[k]
        dynamics.loads.time = float(self.path.t[k])
        base = _rigid_multipliers(dynamics, y, v, a)
        r = dynamics.residual(y, v, a, base)
        M, C, K = dynamics.tangent(y, v, a, base)
        if self.structural:
            C, K = system.D, self.structure
        alpha, beta = self.damping
        if alpha or beta:
            C = C + alpha * M + beta * self.structure
        J = dynamics.jacobian() if system.closed.n else np.zeros((0, system.nv))
        return Here(Instant(M, C, K, r, J), base)


def _rigid_multipliers(dynamics: Dynamics, y: Array, v: Array, a: Array) -> Array:
    """Closure forces of the rigid motion in the rows of the flexible mechanism.

    They bring the geometric stiffness of the joint forces; any split between them and the
    deviation's own multipliers satisfies the same equations.
    """
    system = dynamics.system
    if not system.closed.n:
        return np.zeros(0)
    r = dynamics.residual(y, v, a, np.zeros(system.closed.n))
    passive = np.setdiff1d(np.arange(dynamics.n_rigid), system.motors)
    J = dynamics.jacobian()[:, passive]
    return np.asarray(np.linalg.lstsq(J.T, r[passive], rcond=1e-10)[0], dtype=float)


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
