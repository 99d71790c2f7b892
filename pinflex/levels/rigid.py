"""The rigid level: nominal motion, inverse dynamics, multipliers. Pinocchio and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pinflex.actuation.drive import Nominal, breaks, nominal
from pinflex.arrays import Array, spans
from pinflex.boundary import public
from pinflex.description.blocks.joints import Tension
from pinflex.description.motions.motion import Motion
from pinflex.errors import DescriptionError, MotionError
from pinflex.integrators.compiled import read, tabulated
from pinflex.integrators.problem import Run
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.kinks import made
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.tree import sliding

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
    """Multipliers (n, rows) and motor torques (n, nm) that balance r - J' lam = S' tau.

    More motors than freedoms share as stiff drives do: of all torques that balance, those with the
    least sum of tau^2 / stiffness.
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
        elastic = f" {untensioned(mechanism)}" * mechanism.compliant
        return (
            f"{count}balance. Level rigid takes those that pull by {share.force:g} N or more at "
            f"every strut, and of them those with the least sum of torque^2 / stiffness.{elastic}"
        )
    return (
        f"{count}balance. Level rigid takes those with the least sum of torque^2 / stiffness, as "
        "stiff drives share them (alike where no drive has a stiffness; share: least)."
    )


def untensioned(mechanism: Mechanism) -> str:
    """What levels other than rigid leave out of `share: tension`; "" where nothing is asked."""
    share = mechanism.description.share
    if not isinstance(share, Tension):
        return ""
    return (
        f"Level rigid alone keeps the tension of {share.force:g} N (share.tension): at all others "
        "motors stand where the motion has them, struts may push or give way, and forces and "
        "frequencies are those without it. Cables that are tight there are `springs` with "
        "`tension_only` and a `length` shorter than their frames are apart."
    )


def solve_rigid(mechanism: Mechanism, motion: Motion, t: Array) -> Run:
    """Inverse dynamics of the rigid mechanism along a motion: r(q, v, a) - J' lam = S' tau."""
    path, dynamics = prescribe(mechanism, motion, t), Equations(mechanism.rigid)
    parts, sides = list[tuple[Array, Array, Array | None]](), list[Array]()
    for at in spans(len(t)):  # a long motion shall not fill the memory
        J, r = residual(dynamics, path.at(at))
        parts.append(correct(mechanism, J, r))
        if motion.target == "platform":  # one of the motors is refused where it passes such a pose
            sides.append(side(mechanism, J))
    run = accept(mechanism, path, parts)
    return replace(run, warnings=(*run.warnings, *_let_go(t, sides))) if sides else run


def side(mechanism: Mechanism, J: Array) -> Array:
    """Sign of the determinant of the passive joints' closures, of J (n, rows, nv), shape (n,).

    Where it changes a singular pose was passed, in which motors do not hold the mechanism; nan
    where closures are not as many as passive joints.
    """
    square = J[:, :, mechanism.rigid.free]
    if not 0 < square.shape[1] == square.shape[2]:
        return np.full(len(J), np.nan)
    return np.asarray(np.linalg.slogdet(square)[0])


def _let_go(t: Array, sides: Sequence[Array]) -> list[str]:
    """Where a motion of the platform passes poses in which the motors do not hold it."""
    signs = np.concatenate(sides)
    passed = np.flatnonzero(signs[1:] * signs[:-1] < 0.0)
    if not len(passed):
        return []
    when = ", ".join(f"{t[k]:.4g} to {t[k + 1]:.4g} s" for k in passed[:_SOME])
    return [
        f"t = {when}{', ...' * (len(passed) > _SOME)}: passes a singular pose, in which the motors "
        "do not hold the platform: torques grow without bound there, whatever the samples show. "
        "Keep the path on one side of it."
    ]


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
        lam, price = pulled(mechanism, share, J, r, lam, _compliance(mechanism))
    torque = r[:, motors] - (J[:, :, motors].swapaxes(1, 2) @ lam)[:, :, 0]
    return lam[:, :, 0], torque, price


def accept(
    mechanism: Mechanism, path: Nominal, parts: Sequence[tuple[Array, Array, Array | None]]
) -> Run:
    """The run: the motion with what balances it."""
    lam, torque = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    system = mechanism.rigid
    said = tuple(filter(None, [sharing(mechanism), *system.kinks.passed(path.t, path.q)]))
    states = path.t, path.q, path.v, path.a, lam, torque
    run = Run(system, *states, {"steps": len(path.t)}, warnings=said)
    if not isinstance(mechanism.description.share, Tension):
        return run
    prices = np.concatenate([np.zeros_like(tau) if p is None else p for _, tau, p in parts])
    told = {name: prices[:, k].tolist() for k, name in enumerate(mechanism.motors)}
    return replace(run, settings={"share": {"multipliers [N]": told}})


_SOME = 3  # singular poses that are named
_INSTANTS = 401  # between which torques of a motion that is not smooth are interpolated


def rigid_torques(
    mechanism: Mechanism, motion: Motion, start: float, end: float
) -> Callable[[Array], Array]:
    """Motor torques of the rigid mechanism at times in [start, end] s, (k,) to (k, nm).

    Polynomials of pieces, exact to round-off; of sampled motions and the like, which have none, an
    interpolant. Zero where its motors do not determine its motion. Without rigid stops: what feeds
    torques forward knows nothing of these.
    """
    system = mechanism.rigid
    if system.kinks.rigid:
        open_ended = made([row for row in system.kinks.rows if row.restitution < 0.0])
        mechanism = replace(mechanism, rigid=replace(system, kinks=open_ended))

    def exact(t: Array) -> Array:
        times, at = np.unique(t, return_inverse=True)
        return solve_rigid(mechanism, motion, times).torque[at]

    motors = len(mechanism.rigid.motors)
    try:
        corners = breaks(motion, mechanism.rigid.loads)
        table = tabulated(exact, [slice(0, motors)], start, end, corners)
    except MotionError:
        return lambda t: np.zeros((len(t), motors))
    if table is not None:
        return partial(read, table)
    from scipy.interpolate import PchipInterpolator

    # On a grid of its own: how often a run is sampled must not change what drives it.
    t = np.linspace(start, end, _INSTANTS)
    return PchipInterpolator(t, exact(t))  # type: ignore[no-any-return]


# Torques of more motors than freedoms that keep every strut pulled, the least of them.
#
# Of all that balance, tau = tau_0 + N z about the least, z in which sum c tau^2 = c_0 + z' z:
#
#     min z' z / 2,   A z >= b     A = -s N, b = t_min + s tau_0,   s = 1 where motors push when > 0
#
# whose multipliers u >= 0 say what half the sum gains by each newton of t_min. The quadratic
# programme is a least distance: one of least squares with u >= 0.
# Source: Lawson and Hanson, Solving Least Squares Problems (1974), ch. 23.4.

_FEASIBLE = 1e-9  # of the least distance's residual, 0 to 1: below it no torques pull


def pulled(
    mechanism: Mechanism, least: Tension, J: Array, r: Array, lam: Array, compliance: Array
) -> tuple[Array, Array]:
    """Multipliers lam (n, rows, 1) that balance with every strut pulled, about the least ones.

    Returns:
        lam (n, rows, 1), and what half the sum gains by a newton of `least`, shape (n, nm).
    Raises:
        MotionError: No torques that balance pull at all struts.
    """
    passive, motors = mechanism.rigid.free, mechanism.rigid.motors
    sense = senses(mechanism)
    struts, lam, price = np.flatnonzero(sense), lam.copy(), np.zeros((len(r), len(motors)))
    if not len(struts):
        raise DescriptionError(
            f"{mechanism.name}: share.tension: no motor slides, so that none can pull as a strut. "
            "Write share: least."
        )
    for k in range(len(r)):
        J_m = J[k][:, motors]
        tau = r[k, motors] - J_m.T @ lam[k, :, 0]
        short = least.force + (sense * tau)[struts]
        if np.all(short <= 0.0):
            continue
        B = null_space(J[k][:, passive].T)
        moved = J_m.T @ B  # tau falls by it
        _, R = np.linalg.qr(np.sqrt(compliance)[:, None] * moved)
        A = np.linalg.solve(R.T, (sense[:, None] * moved)[struts].T).T
        z, u = _least_distance(A, short)
        if z is None:
            raise MotionError(
                f"{mechanism.name}: share.tension: at instant {k + 1} of {len(r)} no torques that "
                f"balance pull by {least.force:g} N at every strut: by the least ones "
                f"{mechanism.motors[struts[np.argmax(short)]]} pushes. Lower the tension, add "
                "struts, or leave the region where they surround the platform."
            )
        lam[k, :, 0] += B @ np.linalg.solve(R, z)
        price[k, struts] = u
    return lam, price


def _least_distance(A: Array, b: Array) -> tuple[Array | None, Array]:
    """Shortest z with A z >= b and its multipliers u; None: there is none."""
    from scipy.optimize import nnls  # late: half of the scenes' time to load

    size = float(np.max(np.abs(b)))
    E = np.vstack([A.T, b / size])
    u, left = nnls(E, np.eye(len(E))[-1])
    if left < _FEASIBLE:
        return None, u
    held = u > 0.0
    z = np.linalg.lstsq(A[held], b[held], rcond=None)[0]  # again, without the squares' round-off
    return z, u * size / (1.0 - b @ u / size)


def senses(mechanism: Mechanism) -> Array:
    """1 where a positive force of a motor pushes its strut longer, -1 where it pulls; 0: it turns.

    A strut is the line from the joint that carries the motor's to what hangs on it, at home.
    """
    model, closed = mechanism.rigid.expansion.model, mechanism.rigid.closed
    slides, found = sliding(model), np.zeros(len(mechanism.motors))
    at = Equations(mechanism.rigid).kinematics(mechanism.home)
    places, held = at.poses[0, :, :, 3], closed.frames(at.poses)[0, :, :, 3]
    for k, name in enumerate(mechanism.motors):
        if name not in slides:
            continue
        joint = model.getJointId(name)
        column, parent = at.J[0, :3, int(model.idx_vs[joint])], int(model.parents[joint])
        place = places[joint]
        begin = places[parent] if parent else place
        ends = [places[j] for j in model.children[joint]]
        ends += [p for p, body in zip(held, closed.bodies, strict=True) if int(body) == joint]
        ahead = [float(column @ (end - begin)) for end in (*ends, place)]
        found[k] = -1.0 if max(ahead, key=abs) < 0.0 else 1.0
    return found
