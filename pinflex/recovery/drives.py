"""What the motors behind their gears do: torque, speed and power on both sides of each drive.

With q the motor angle over the gear ratio n, eta the gear's deflection, tau the torque of the
equations in q, I the inertia of rotor and gear at the joint and F friction and damper:

    joint side   speed q' + eta',   torque  T = tau - I q'' - F(q')
    motor side   speed n q',        torque  (I q'' + F + T c(T q')) / n

T is what the gear gives out, -(K eta + D eta') of an elastic one. A gear of efficiency e takes
c = 1/e times as much where the motor drives and c = e times where it is driven; the change between
the two is smooth in the speed, as friction is, and c = 1 at rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.blocks.drives import SPEED, Drive
from pinflex.description.blocks.joints import JointExtra
from pinflex.integrators.run import Run
from pinflex.mechanics.mechanism import Mechanism


def drives(mechanism: Mechanism, run: Run) -> dict[str, Array]:
    """Arrays of a Result by flat key, drive/JOINT/...; empty where no joint has a drive."""
    out: dict[str, Array] = {}
    for name, extra in mechanism.description.joints.items():
        if extra.drive is not None:
            out |= {f"drive/{name}/{k}": x for k, x in _of(mechanism, run, name, extra).items()}
    return out


def _of(mechanism: Mechanism, run: Run, name: str, extra: JointExtra) -> dict[str, Array]:
    drive, n = extra.drive or Drive(), (extra.drive or Drive()).gear
    model, system = mechanism.rigid.rigid, run.system
    joint = model.joints[model.getJointId(name)]
    row, motor = int(joint.idx_v), mechanism.motors.index(name)
    q, v, a = _angle(run.y, int(joint.idx_q), int(joint.nq)), run.v[:, row], run.a[:, row]
    speeds = np.zeros_like(run.v)
    speeds[:, row] = v
    lost = np.zeros_like(run.v)
    lost[:, system.friction.rows] = system.friction.force(speeds)
    inner = extra.armature * a + lost[:, row] + system.D[row, row] * v
    given = run.torque[:, motor] - inner
    deflection, rate = np.zeros_like(v), np.zeros_like(v)
    for gear in system.expansion.drives:
        if gear.joint == name:
            deflection = run.y[:, int(system.rigid.nq) + gear.eta]
            rate = run.v[:, int(system.rigid.nv) + gear.eta]
    torque = (inner + given * _gain(drive, extra, given, v)) / n
    return {
        "motor_position": n * q, "motor_speed": n * v, "motor_torque": torque,
        "motor_power": torque * n * v, "position": q + deflection, "speed": v + rate,
        "torque": given, "power": given * (v + rate), "deflection": deflection,
    }  # fmt: skip


def _gain(drive: Drive, extra: JointExtra, given: Array, v: Array) -> Array:
    """Torque into the gear over torque out of it, times the ratio."""
    smooth = SPEED if extra.friction is None else extra.friction.speed
    way = np.tanh(v / smooth) * np.sign(given)
    e = drive.efficiency
    return np.asarray(1.0 + np.where(way > 0, way * (1.0 / e - 1.0), way * (1.0 - e)))


def _angle(y: Array, at: int, size: int) -> Array:
    """Position of a joint of one freedom [rad | m], continuous over turns."""
    return y[:, at] if size == 1 else np.unwrap(np.arctan2(y[:, at + 1], y[:, at]))


def describe(mechanism: Mechanism) -> dict[str, Any]:
    """The drives for the meta of a result."""
    found: dict[str, Any] = {}
    for name, extra in mechanism.description.joints.items():
        drive = extra.drive
        if drive is not None:
            found[name] = {
                "gear": drive.gear,
                "efficiency": drive.efficiency,
                "stiffness": drive.stiffness,
                "limit_curve": [list(point) for point in drive.limit_curve],
            }
    return found
