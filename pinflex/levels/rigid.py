"""The rigid level: nominal motion, inverse dynamics, multipliers. Pinocchio and nothing else."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import DescriptionError
from pinflex.levels.run import Run
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.system import System


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
    tau = np.empty((len(q), system.nv))
    if np.any(system.D) or len(system.springs.v_at):
        dynamics, none = Dynamics(system), np.zeros(0)
        for k in range(len(q)):
            tau[k] = dynamics.residual(q[k], v[k], a[k], none)
        return tau
    model, data, rnea = system.rigid, system.rigid.createData(), pin.rnea
    for k in range(len(q)):
        tau[k] = rnea(model, data, q[k], v[k], a[k])
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
    if not len(J):
        return np.zeros(0), r[motors]
    A = J[:, passive].T
    if A.shape[0] == A.shape[1]:
        lam = np.asarray(np.linalg.solve(A, r[passive]), dtype=float)
    else:
        lam = np.asarray(np.linalg.lstsq(A, r[passive], rcond=None)[0], dtype=float)
    return lam, r[motors] - J[:, motors].T @ lam


def solve_rigid(mechanism: Mechanism, motion: Motion, t: Array) -> Run:
    """Inverse dynamics of the rigid mechanism along a motion.

    Args:
        mechanism: Mechanism. motion: Motion. t: Sample times, shape (nt,).
    Returns:
        The run, with motor torques and closure multipliers.
    """
    path, system = nominal(mechanism, motion, t), mechanism.rigid
    dynamics, n = Dynamics(system), len(t)
    lam, torque = np.zeros((n, system.closed.n)), np.empty((n, len(system.motors)))
    zero = np.zeros(system.closed.n)
    for k in range(n):
        r = dynamics.residual(path.q[k], path.v[k], path.a[k], zero)
        lam[k], torque[k] = multipliers(system, dynamics.closed.J, r)
    return Run(system, path.t, path.q, path.v, path.a, lam, torque, {"steps": n})
