"""The rigid level: nominal motion, inverse dynamics, multipliers. Pinocchio and nothing else."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.dynamics import Dynamics, System
from pinflex.errors import DescriptionError
from pinflex.mechanism import Mechanism
from pinflex.motion import Motion
from pinflex.nominal import nominal
from pinflex.run import Run


def inverse_dynamics(mechanism: Mechanism, q: Array, v: Array, a: Array) -> Array:
    """Rigid torques of a loop-free robot along a motion: one Pinocchio call an instant.

    Args:
        mechanism: Robot without loops.
        q: Rigid configurations, shape (nt, nq). v, a: Shape (nt, nv).
    Returns:
        Generalised forces of every joint (N m | N), shape (nt, nv).
    Raises:
        DescriptionError: The robot has loops (use `solve(level="rigid")`).
    """
    system = mechanism.rigid
    if system.closed.n:
        raise DescriptionError(
            f"{mechanism.name}: inverse_dynamics is for loop-free robots, this one has "
            f'{len(system.closed.names)} loops. Use solve(level="rigid").'
        )
    model, data, rnea = system.rigid, system.rigid.createData(), pin.rnea
    tau = np.empty((len(q), system.nv))
    if system.expansion.q_at.size and not np.array_equal(
        system.expansion.q_at, np.arange(model.nq)
    ):
        raise AssertionError("the rigid tree keeps its own order")
    for k in range(len(q)):
        tau[k] = rnea(model, data, q[k], v[k], a[k])
    if np.any(system.D):
        tau += v @ system.D.T
    if len(system.springs.v_at):
        dynamics = Dynamics(system)
        zero, none = np.zeros(system.nv), np.zeros(0)
        for k in range(len(q)):
            tau[k] = dynamics.residual(q[k], v[k], a[k], none)
        del zero
    return tau


def multipliers(system: System, J: Array, r: Array) -> tuple[Array, Array]:
    """Multipliers and motor torques that balance r - J' lam = S' tau.

    Args:
        system: Rigid system. J: Closure Jacobian, shape (rows, nv).
        r: Residual without closure forces, shape (nv,).
    Returns:
        lam (rows,), tau (nm,).
    """
    passive, motors = system.free, system.motors
    lam = np.zeros(len(J))
    if len(J):
        A = J[:, passive].T
        lam = (
            np.linalg.solve(A, r[passive])
            if A.shape[0] == A.shape[1]
            else np.linalg.lstsq(A, r[passive], rcond=None)[0]
        )
    return lam, r[motors] - J[:, motors].T @ lam


def solve_rigid(mechanism: Mechanism, motion: Motion, t: Array) -> Run:
    """Inverse dynamics of the rigid mechanism along a motion.

    Args:
        mechanism: Mechanism. motion: Motion. t: Sample times, shape (nt,).
    Returns:
        The run, with motor torques and closure multipliers.
    """
    path = nominal(mechanism, motion, t)
    system = mechanism.rigid
    dynamics = Dynamics(system)
    n = len(path.t)
    lam, torque = np.zeros((n, system.closed.n)), np.empty((n, len(system.motors)))
    zero = np.zeros(system.closed.n)
    for k in range(n):
        r = dynamics.residual(path.q[k], path.v[k], path.a[k], zero)
        J = dynamics.closed.J if system.closed.n else np.zeros((0, system.nv))
        lam[k], torque[k] = multipliers(system, J, r)
    return Run(system, path.t, path.q, path.v, path.a, lam, torque, {"steps": n})
