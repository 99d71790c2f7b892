"""The rigid level: nominal motion, inverse dynamics, multipliers. Pinocchio and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinflex.actuation.drive import Nominal, nominal
from pinflex.arrays import Array, spans
from pinflex.boundary import public
from pinflex.description.blocks.joints import Tension
from pinflex.description.motions.motion import Motion
from pinflex.errors import DescriptionError
from pinflex.integrators.problem import Run
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, takes_model

_RIGID = 1e-6  # of the least compliance of the others: of a motor without a stiffness beside them


@public
@takes_model
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
    return dynamics.open(q, v, a, np.zeros(len(q)))


def multipliers(mechanism: Mechanism, J: Array, r: Array) -> tuple[Array, Array]:
    """Multipliers and motor torques that balance r - J' lam = S' tau, at n instants.

    More motors than freedoms share as stiff drives do: of all torques that balance, those with the
    least sum of tau^2 / stiffness.

    Returns:
        lam (n, rows), tau (n, nm).
    """
    lam, torque, _ = correct(mechanism, J, r)
    return lam, torque


def _shared(mechanism: Mechanism, J: Array, r: Array) -> Array:
    """Multipliers of motors that give way, in proportion to their compliance, (n, rows, 1).

    Their moves are those that the loops allow: J_m C (r_m - J_m' lam) + J_p d = 0, J_p' lam = r_p.
    """
    passive, motors = mechanism.rigid.free, mechanism.rigid.motors
    J_p, C_m = J[:, :, passive], J[:, :, motors] * _compliance(mechanism)
    p, size = len(passive), len(passive) + J.shape[1]
    S, right = np.zeros((len(J), size, size)), np.empty((len(J), size, 1))
    S[:, :p, p:], S[:, p:, :p] = J_p.swapaxes(1, 2), J_p
    S[:, p:, p:] = -C_m @ J[:, :, motors].swapaxes(1, 2)
    right[:, :p], right[:, p:] = r[:, passive, None], -C_m @ r[:, motors, None]
    return np.asarray(np.linalg.solve(S, right)[:, p:])


def _compliance(mechanism: Mechanism) -> Array:
    """Of the motors' drives over the largest, shape (nm,); alike where none has a stiffness."""
    joints = mechanism.description.joints
    drives = [joints[name].drive if name in joints else None for name in mechanism.motors]
    soft = np.array([1 / drive.stiffness if drive and drive.stiffness else 0.0 for drive in drives])
    if not soft.any():
        return np.ones(len(soft))
    return np.asarray(np.where(soft, soft, _RIGID * np.min(soft[soft > 0.0])) / np.max(soft))


def sharing(mechanism: Mechanism) -> str:
    """What is said of the torques of more motors than freedoms; "" where there are not more."""
    motors, mobility = len(mechanism.motors), mechanism.report.mobility
    if motors <= mobility:
        return ""
    count = (
        f"{motors} motors for {mobility} degrees of freedom, redundantly actuated: many torques "
    )
    share = mechanism.description.share
    if isinstance(share, Tension):
        return (
            f"{count}balance. Level rigid takes those that pull by {share.force:g} N or more at "
            "every strut, and of them those with the least sum of torque^2 / stiffness."
        )
    return (
        f"{count}balance. Level rigid takes those with the least sum of torque^2 / stiffness, as "
        "stiff drives share them (alike where no drive has a stiffness; share: least)."
    )


def solve_rigid(mechanism: Mechanism, motion: Motion, t: Array) -> Run:
    """Inverse dynamics of the rigid mechanism along a motion: r(q, v, a) - J' lam = S' tau.

    Returns:
        The run, with motor torques and closure multipliers.
    """
    path, dynamics = prescribe(mechanism, motion, t), Equations(mechanism.rigid)
    some = (path.at(at) for at in spans(len(t)))  # a long motion shall not fill the memory
    return accept(mechanism, path, [correct(mechanism, *residual(dynamics, x)) for x in some])


def prescribe(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal:
    """The nominal motion: of the motors, and of what the loops make follow."""
    if isinstance(mechanism.description.share, Tension) and not sharing(mechanism):
        raise DescriptionError(
            f"{mechanism.name}: share.tension: {len(mechanism.motors)} motors for "
            f"{mechanism.report.mobility} degrees of freedom: one balance alone, nothing to "
            "choose. Remove it, or add struts."
        )
    return nominal(mechanism, motion, t)


def residual(dynamics: Equations, path: Nominal) -> tuple[Array, Array]:
    """dc/dq (n, rows, nv), and what the motion takes where loops are open, (n, nv)."""
    return dynamics.close(path.q).J, dynamics.open(path.q, path.v, path.a, path.t)


def correct(mechanism: Mechanism, J: Array, r: Array) -> tuple[Array, Array, Array | None]:
    """Multipliers and torques that balance it, and the multipliers of a least tension, (n, nm)."""
    passive, motors = mechanism.rigid.free, mechanism.rigid.motors
    share, price = mechanism.description.share, None
    if not J.shape[1]:
        return np.zeros((len(r), 0)), r[:, motors], None
    A, b = J[:, :, passive].swapaxes(1, 2), r[:, passive, None]
    square = A.shape[1] == A.shape[2]
    lam = np.asarray(np.linalg.solve(A, b) if square else _shared(mechanism, J, r), dtype=float)
    if isinstance(share, Tension) and not square:
        from pinflex.levels.sharing import pulled

        lam, price = pulled(mechanism, share, J, r, lam, _compliance(mechanism))
    torque = r[:, motors] - (J[:, :, motors].swapaxes(1, 2) @ lam)[:, :, 0]
    return lam[:, :, 0], torque, price


def accept(
    mechanism: Mechanism, path: Nominal, parts: Sequence[tuple[Array, Array, Array | None]]
) -> Run:
    """The run: the motion with what balances it."""
    lam, torque = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    said, system = tuple(filter(None, [sharing(mechanism)])), mechanism.rigid
    states = path.t, path.q, path.v, path.a, lam, torque
    run = Run(system, *states, {"steps": len(path.t)}, warnings=said)
    if not isinstance(mechanism.description.share, Tension):
        return run
    prices = np.concatenate([np.zeros_like(tau) if p is None else p for _, tau, p in parts])
    told = {name: prices[:, k].tolist() for k, name in enumerate(mechanism.motors)}
    return replace(run, settings={"share": {"multipliers [N]": told}})
