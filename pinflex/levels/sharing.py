"""Torques of more motors than freedoms that keep every strut pulled, the least of them.

Of all that balance, tau = tau_0 + N z about the least, z in which sum c tau^2 = c_0 + z' z:

    min z' z / 2,   A z >= b     A = -s N, b = t_min + s tau_0,   s = 1 where motors push when > 0

whose multipliers u >= 0 say what half the sum gains by each newton of t_min. The quadratic
programme is a least distance: one of least squares with u >= 0.
Source: Lawson and Hanson, Solving Least Squares Problems (1974), ch. 23.4.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.blocks.joints import Tension
from pinflex.errors import DescriptionError, MotionError
from pinflex.linalg import null_space
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.tree import sliding

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
    data = model.createData()
    pin.computeJointJacobians(model, data, mechanism.home)
    poses = np.array([[*each.rotation.T.ravel(), *each.translation] for each in data.oMi])
    held = closed.frames(poses[None])[0, :, :, 3]
    for k, name in enumerate(mechanism.motors):
        if name not in slides:
            continue
        joint = model.getJointId(name)
        row, parent = int(model.idx_vs[joint]), int(model.parents[joint])
        column = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[:3, row]
        place = data.oMi[joint].translation
        begin = data.oMi[parent].translation if parent else place
        ends = [data.oMi[j].translation for j in model.children[joint]]
        ends += [p for p, body in zip(held, closed.bodies, strict=True) if int(body) == joint]
        ahead = [float(column @ (end - begin)) for end in (*ends, place)]
        found[k] = -1.0 if max(ahead, key=abs) < 0.0 else 1.0
    return found
