"""The rigid level: nominal motion, inverse dynamics, multipliers. Pinocchio and nothing else."""

from __future__ import annotations

import numpy as np

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motion import Motion
from pinflex.errors import DescriptionError
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.geometry import spans
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.system import System

_RANK = 1e-14  # more closure rows than passive coordinates: any split of the forces balances


@public
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
    if len(system.closed.coupled.rows) < system.closed.n:
        raise DescriptionError(
            f"{mechanism.name}: inverse_dynamics is for loop-free robots, this one has "
            f'{len(system.closed.names)} loops. Use solve(level="rigid").'
        )
    dynamics = Equations(system)
    if np.any(system.D) or len(system.springs.v_at) or system.friction.present:
        apart = np.zeros((len(q), system.closed.n))  # couplings: of each joint alone
        return dynamics.residual(q, v, a, apart, 0.0).r
    return dynamics.rnea(q, v, a)


def multipliers(system: System, J: Array, r: Array) -> tuple[Array, Array]:
    """Multipliers and motor torques that balance r - J' lam = S' tau, at n instants.

    Args:
        system: Rigid system. J: Closure Jacobians, shape (n, rows, nv).
        r: Residuals without closure forces, shape (n, nv).
    Returns:
        lam (n, rows), tau (n, nm).
    """
    passive, motors = system.free, system.motors
    if not J.shape[1]:
        return np.zeros((len(r), 0)), r[:, motors]
    A, b = J[:, :, passive].swapaxes(1, 2), r[:, passive, None]
    square = A.shape[1] == A.shape[2]
    lam = np.asarray(np.linalg.solve(A, b) if square else np.linalg.pinv(A, rcond=_RANK) @ b)
    return lam[:, :, 0], r[:, motors] - (J[:, :, motors].swapaxes(1, 2) @ lam)[:, :, 0]


def solve_rigid(mechanism: Mechanism, motion: Motion, t: Array) -> Run:
    """Inverse dynamics of the rigid mechanism along a motion.

    Args:
        mechanism: Mechanism. motion: Motion. t: Sample times, shape (nt,).
    Returns:
        The run, with motor torques and closure multipliers.
    """
    path, system = nominal(mechanism, motion, t), mechanism.rigid
    dynamics, n = Equations(system), len(t)
    lam, torque = np.zeros((n, system.closed.n)), np.empty((n, len(system.motors)))
    for at in spans(n):
        q, v, a = path.q[at], path.v[at], path.a[at]
        r, _ = dynamics.residual(q, v, a, lam[at], path.t[at])
        lam[at], torque[at] = multipliers(system, dynamics.close(q).J, r)
    return Run(system, path.t, path.q, path.v, path.a, lam, torque, {"steps": n})
