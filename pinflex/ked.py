"""Kineto-elastodynamics: linear, time-varying deviation from the nominal rigid motion.

    M(t) dd + C(t) d + K(t) d - J(t)' dlam = -r(t),     J(t) d = 0

r(t) is what the nominal motion leaves unbalanced. M, C and K are the exact derivatives of the full
equations along the nominal motion, so `coupled` tends to this level for small deflections.
`structural` keeps M, the beams' K and the damping only, as the classical method does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinflex.arrays import Array
from pinflex.dynamics import Dynamics
from pinflex.errors import ConvergenceError
from pinflex.integrators import AlphaScheme
from pinflex.mechanism import Mechanism
from pinflex.motion import Motion
from pinflex.nominal import nominal
from pinflex.quasistatic import balance, structural_stiffness
from pinflex.run import Run
from pinflex.system import System


def solve_ked(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    scheme: AlphaScheme,
    static: bool = False,
    structural: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """March the linear deviation; one linear system a step.

    Args:
        mechanism: Mechanism. motion: Motion. t: Equal steps, shape (nt,).
        scheme: Newmark, or another member of the alpha family.
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
    n, h = len(free), float(t[-1] - t[0]) / (nt - 1)
    y, lam = np.empty((nt, system.nq)), np.empty((nt, rows))
    v, a = np.zeros((nt, nv)), np.zeros((nt, nv))
    torque = np.empty((nt, len(motors)))
    d, dv, da, s = (np.zeros(nv) for _ in range(4))
    S = np.zeros((n + rows, n + rows))
    structure = structural_stiffness(dynamics) if structural else None
    factor, beta, gamma = scheme.mass_factor, scheme.beta, scheme.gamma
    straight = np.zeros(system.n_eta)
    for k in range(nt):
        flat = np.concatenate([path.q[k], straight])
        dynamics.loads.time = float(path.t[k])
        v[k, :m], a[k, :m] = path.v[k], path.a[k]
        base = _rigid_multipliers(dynamics, flat, v[k], a[k])
        r = dynamics.residual(flat, v[k], a[k], base)
        M, C, K = dynamics.tangent(flat, v[k], a[k], base)
        if structure is not None:
            C, K = system.D, structure
        J = dynamics.jacobian() if rows else np.zeros((0, nv))
        if k == 0:
            if static:
                found = balance(dynamics, flat, v[0], a[0], free)
                d = dynamics.difference(flat, found.y)
            S[:n, :n] = M[np.ix_(free, free)]
        else:
            d = d + h * dv + h * h * (0.5 - beta) * s
            dv = dv + h * (1 - gamma) * s
            s_trial = (-scheme.alpha_m * s + scheme.alpha_f * da) / (1 - scheme.alpha_m)
            d += h * h * beta * s_trial
            dv += h * gamma * s_trial
            da, s = np.zeros(nv), s_trial
            full = factor * M + gamma * h * C + beta * h * h * K
            S[:n, :n] = full[np.ix_(free, free)]
        S[:n, n:], S[n:, :n] = J[:, free].T, J[:, free]
        load = r + C @ dv + K @ d
        gap = np.zeros(rows) if k == 0 else -(J @ d) / (beta * h * h)
        try:
            x = np.linalg.solve(S, np.concatenate([-load[free], gap]))
        except np.linalg.LinAlgError:
            # Massless coordinates have no initial acceleration of their own.
            x = np.linalg.lstsq(S, np.concatenate([-load[free], gap]), rcond=1e-13)[0]
        ds = np.zeros(nv)
        ds[free] = x[:n]
        if k == 0:
            da, s = ds, ds.copy()
        else:
            s = s + ds
            da = factor * ds
            d = d + h * h * beta * ds
            dv = dv + h * gamma * ds
        dlam = -x[n:]
        if not np.all(np.isfinite(d)):
            raise _blown_up(system, path.t, y, v, a, lam, torque, k, h)
        balance_now = r + M @ da + C @ dv + K @ d - J.T @ dlam
        torque[k], lam[k] = balance_now[motors], base + dlam
        y[k] = dynamics.integrate(flat, d)
        v[k] += dv
        a[k] += da
        if progress is not None and k % 64 == 0:
            progress(k, nt)
    settings: dict[str, object] = {
        "integrator": scheme.name,
        "dt": h,
        "terms": "structural" if structural else "full",
    }
    return Run(system, path.t, y, v, a, lam, torque, {"steps": nt, "newton": nt}, settings)


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
