"""Consistent starts: poses on the closures, velocities that keep them, balanced forces."""

from __future__ import annotations

import numpy as np

from pinflex.actuation.drive import MotorPath
from pinflex.actuation.motors import motor_axes
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, IntArray
from pinflex.description.motion import Motion
from pinflex.errors import AssemblyError
from pinflex.mechanics.assembly import close_loops
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.mechanism import Mechanism


def straight_start(
    mechanism: Mechanism, motion: Motion, path: MotorPath, dynamics: Dynamics
) -> tuple[Array, Array]:
    """Undeformed pose and compatible velocities at the first time.

    Joints that neither motors nor loops determine start at home and at rest.
    """
    system = dynamics.system
    n, m = int(system.rigid.nq), int(system.rigid.nv)
    v = np.zeros(system.nv)
    if mechanism.report.mobility == len(system.motors):
        first = nominal(mechanism, motion, path.t[:1])
        v[:m] = first.v[0]
        y = np.concatenate([first.q[0], np.zeros(system.n_eta)])
        return y, v
    y = mechanism.undeformed() if system.n_eta else mechanism.home.copy()
    motor_axes(mechanism).write(y, path.position[0])
    v[system.motors] = path.velocity[0]
    if dynamics.looped:
        passive = np.setdiff1d(np.arange(m), system.motors).astype(np.intp)
        y, size = close_loops(dynamics, y, passive)
        if size > 1e-9:
            raise AssemblyError(
                f"{mechanism.name}: t = {path.t[0]:g} s: the loops do not close at the start of "
                f"the motion (open by {size:.2g}). Start the motion at home."
            )
        _, J = dynamics.close(y)
        v[passive] = -np.linalg.lstsq(J[:, passive], J @ v, rcond=1e-10)[0]
    del n
    return y, v


def consistent_acceleration(
    dynamics: Dynamics, y: Array, v: Array, held: IntArray, a_held: Array, tau: Array | None
) -> tuple[Array, Array]:
    """Accelerations and multipliers that satisfy the equations at (y, v).

    Args:
        dynamics: Workspace. y: Shape (nq,). v: Shape (nv,).
        held: Velocity rows with prescribed acceleration a_held.
        tau: Motor torques when no row is held.
    Returns:
        a (nv,), lam (rows,), from the saddle system of M and J (least squares where coordinates
        have no mass).
    """
    system = dynamics.system
    nv, rows = system.nv, system.closed.n
    free = np.setdiff1d(np.arange(nv), held)
    a = np.zeros(nv)
    a[held] = a_held
    r = dynamics.residual(y, v, a, np.zeros(rows))
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
    size = np.abs(np.diag(S))
    scale = 1.0 / np.sqrt(np.maximum(size, max(1e-12 * float(np.max(size, initial=0.0)), 1e-300)))
    scale[n:] = 1.0
    S *= scale[:, None] * scale
    b *= scale
    # Massless coordinates (torsion without inertia) make S singular: their balance is algebraic and
    # the least-norm answer only seeds the first step.
    if n + rows == 0:
        solution = np.zeros(0)
    elif np.linalg.cond(S) < 1e14:
        solution = np.linalg.solve(S, b)
    else:
        solution = np.linalg.lstsq(S, b, rcond=1e-13)[0]
    solution = scale * solution
    a[free] = solution[:n]
    return a, -solution[n:]
