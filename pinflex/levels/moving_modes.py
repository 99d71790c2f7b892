"""Vibration about a motion: a steady one, an instant of the nominal motion or of a run.

The residual linearised there, with all that speed and acceleration add (stiffening, gyroscopic and
Coriolis terms), taken as constant, on the closures J z = 0, Z their null space:

    (s^2 Z' M Z + s Z' C Z + Z' K Z) x = 0

Of a steady rotation this is exact; of an instant it tells how the machine would vibrate if it
stayed as it is then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pinflex.actuation.motors import motor_axes
from pinflex.actuation.nominal import nominal
from pinflex.actuation.path import Path
from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion, hold
from pinflex.description.reading.schema import number
from pinflex.errors import DescriptionError, nearest
from pinflex.levels.quasistatic import balance
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.closure_motion import FrozenLinks
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result
from pinflex.text import brief

# Steady speeds of motors, an instant [s] of the nominal motion, or a run and an instant of it.
At = Mapping[str, float] | float | tuple[Result, float]
_INFINITE = 1e-9  # of the highest frequency^-1: an eigenvalue without inertia
_REAL = 1e-7  # of the highest frequency: round-off of an imaginary part


@dataclass(frozen=True)
class Moving:
    """A state to linearise about: y, v, a, multipliers lam, time t [s], and its name in words."""

    __repr__ = brief

    y: Array
    v: Array
    a: Array
    lam: Array
    t: float
    about: str


def state_at(
    mechanism: Mechanism, dynamics: Equations, at: At, motion: Callable[[], Motion]
) -> Moving:
    """The state that `at` names; links balance the inertia forces of the nominal motion."""
    if isinstance(at, tuple):
        return state_of_run(mechanism, *at)
    if isinstance(at, Mapping):
        path = Path(mechanism, hold(duration=1.0))
        q, (v, a) = (
            mechanism.home,
            path.rates(
                mechanism.home, _speeds(mechanism, at), np.zeros(len(mechanism.motors)), 0.0
            ),
        )
        t, words = 0.0, ", ".join(f"{name} = {speed:g}" for name, speed in at.items())
        about = f"the steady motion {words} (rad/s, m/s)"
    else:
        t = number(at, f"{mechanism.name}: modes: at", low=0.0, of="time")
        one = nominal(mechanism, motion(), np.array([t]))
        q, v, a, about = one.q[0], one.v[0], one.a[0], f"the motion at t = {t:g} s"
    none = np.zeros(mechanism.flexible.n_eta)
    v, a = np.concatenate([v, none]), np.concatenate([a, none])
    where = f"{mechanism.name}: modes about {about}"
    free = mechanism.flexible.free
    links = FrozenLinks(dynamics, mechanism.rigid.free, free)
    found = balance(dynamics, mechanism.undeformed(q), v, a, free, t, None, where, links=links)
    return Moving(found.y, found.v, found.a, found.lam, t, about)


def _speeds(mechanism: Mechanism, given: Mapping[str, float]) -> Array:
    names = list(mechanism.description.actuated)
    speeds = np.zeros(len(motor_axes(mechanism).v_at))
    for name, speed in given.items():
        if name not in names:
            raise DescriptionError(
                f"{mechanism.name}: modes: {name}: not a motor.{nearest(name, names)}"
            )
        speeds[names.index(name)] = speed
    return speeds


def state_of_run(mechanism: Mechanism, result: Result, time: float) -> Moving:
    """The sample of a run of this mechanism that is nearest to a time [s]."""
    k = int(np.argmin(np.abs(result.t - time)))
    system, arrays = mechanism.flexible, result.arrays
    if "eta" not in arrays and system.n_eta:
        raise DescriptionError(
            f"{mechanism.name}: a run of level {result.level}, in which no link "
            "deforms. Give one of level quasistatic, ked or coupled, or a time of the motion."
        )
    parts = [("joint/q", "eta"), ("joint/v", "eta_v"), ("joint/a", "eta_a")]
    y, v, a = (
        np.concatenate([arrays[joint][k], arrays[own][k]]) if system.n_eta else arrays[joint][k]
        for joint, own in parts
    )
    lam = arrays["multiplier"][k]
    if (len(y), len(v), len(lam)) != (system.nq, system.nv, system.closed.n):
        raise DescriptionError(
            f"{mechanism.name}: the run has {len(v)} coordinates and {len(lam)} closure "
            f"rows, the mechanism {system.nv} and {system.closed.n}. Give the one that was solved."
        )
    about = f"the run at t = {result.t[k]:g} s"
    return Moving(y, v, a, lam, float(result.t[k]), about)


def whirl(dynamics: Equations, state: Moving, free: IntArray) -> tuple[Array, Array]:
    """Eigenvalues s [1/s] and shapes of the vibration about a state, slowest first.

    Of a pair the one that turns forward is kept; of a divergence s and -s the growing one.

    Returns:
        s (k,), complex; shapes (nv, k), complex, of unit mass.
    """
    system = dynamics.system
    M, C, K = (
        A[np.ix_(free, free)]
        for A in dynamics.tangent(state.y, state.v, state.a, state.lam, state.t)[:3]
    )
    Z = np.eye(len(free))
    if system.closed.n:
        Z = null_space(dynamics.close(state.y)[1][:, free])
    M, C, K = (Z.T @ A @ Z for A in (M, C, K))
    s, x = _quadratic(M, C, K)
    mass = np.sqrt(np.abs(np.einsum("ik,ij,jk->k", x.conj(), M, x)))
    shapes = np.zeros((system.nv, len(s)), dtype=complex)
    shapes[free] = Z @ (x / np.where(mass > 0, mass, 1.0))
    return s, shapes


def _quadratic(M: Array, C: Array, K: Array) -> tuple[Array, Array]:
    """Solutions of (s^2 M + s C + K) x = 0 with Im s >= 0, by increasing |s|."""
    from scipy.linalg import eig

    n = len(M)
    if not n:
        return np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex)
    mass = np.diag(M)
    unit = 1.0 / np.sqrt(np.where(mass > 1e-14 * np.max(mass), mass, np.max(mass)))
    M, C, K = (A * unit * unit[:, None] for A in (M, C, K))
    # Rates over the fastest frequency, so that both halves of the pencil are of one size.
    w = max(float(np.sqrt(np.max(np.abs(K)))), 1e-300)
    none, one = np.zeros((n, n)), np.eye(n)
    A = np.block([[none, one], [-K / w**2, -C / w]])
    B = np.block([[one, none], [none, M]])
    (alpha, beta), V = eig(A, B, homogeneous_eigvals=True)
    finite = np.abs(beta) > _INFINITE * np.abs(alpha)
    s, x = w * alpha[finite] / beta[finite], unit[:, None] * V[:n, finite]
    small = _REAL * float(np.max(np.abs(s), initial=0.0))
    real = np.abs(s.imag) <= small
    kept = np.where(real, _growing(s, real), s.imag > 0)
    order = np.flatnonzero(kept)[np.argsort(np.abs(s[kept]), kind="stable")]
    s = np.where(real, s.real, s)
    return s[order], x[:, order]


def _growing(s: Array, real: Array) -> Array:
    """Of real eigenvalues: those that are not the decaying twin of a growing one."""
    up = s[real].real
    twin = np.array([np.any(np.abs(up + x) < 1e-6 * abs(x)) for x in s.real])
    return np.asarray((s.real >= 0) | ~twin)
