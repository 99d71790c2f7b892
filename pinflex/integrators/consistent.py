"""Accelerations and multipliers that satisfy the equations in a state: where steps begin."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.compiled import Compiled
from pinflex.mechanics.equations import Equations


def consistent_acceleration(
    dynamics: Equations,
    y: Array,
    v: Array,
    held: IntArray,
    a_held: Array,
    tau: Array | None,
    t: float,
    control_force: Array | None = None,
) -> tuple[Array, Array]:
    """Accelerations and multipliers that satisfy the equations at (y, v).

    Returns:
        a (nv,), lam (rows,), from the saddle system of M and J (least squares where coordinates
        have no mass).
    """
    system = dynamics.system
    nv, rows = system.nv, system.closed.n
    free = np.setdiff1d(np.setdiff1d(np.arange(nv), held), system.held)
    a = np.zeros(nv)
    a[held] = a_held
    r, _ = dynamics.residual(y, v, a, np.zeros(rows), t, control_force)
    if tau is not None:
        r[system.motors] -= tau
    M = dynamics.mass(y)
    n = len(free)
    S = np.zeros((n + rows, n + rows))
    S[:n, :n] = M[np.ix_(free, free)]
    b = np.concatenate([-r[free], np.zeros(rows)])
    if rows:
        _, J = dynamics.close(y)
        S[:n, n:], S[n:, :n] = J[:, free].T, J[:, free]
        b[n:] = -dynamics.closure_bias(y, v) - J[:, held] @ a_held
    solution = _solved(S, b, n, dynamics.compiled)
    a[free] = solution[:n]
    return a, -solution[n:]


def _solved(S: Array, b: Array, n: int, compiled: Compiled | None) -> Array:
    """Solution of S x = b, its first n rows and columns scaled by the diagonal in place.

    Massless coordinates (torsion without inertia) make S singular: their balance is algebraic and
    the least-norm answer only seeds the first step.
    """
    size = np.abs(np.diag(S))
    scale = 1.0 / np.sqrt(np.maximum(size, max(1e-12 * float(np.max(size, initial=0.0)), 1e-300)))
    scale[n:] = 1.0
    S *= scale[:, None] * scale
    b *= scale
    if not len(b):
        return b
    if compiled is not None:  # in linear time, where loops lie in a row
        return np.asarray(scale * compiled.evaluator.saddle(S, b))
    if np.linalg.cond(S, 1) < 1e14:  # by the inverse: half the time of an SVD
        return np.asarray(scale * np.linalg.solve(S, b))
    return np.asarray(scale * np.linalg.lstsq(S, b, rcond=1e-13)[0])
