"""The motors: where they sit in the coordinates, and their motion when it is given by joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanism import Mechanism
from pinflex.motion import Motion


@dataclass(frozen=True)
class MotorAxes:
    """Where single-axis motors sit in q and v; a continuous joint keeps (cos, sin) in q."""

    q_at: IntArray
    v_at: IntArray
    paired: IntArray
    simple: bool

    def write(self, y: Array, angle: Array) -> None:
        """Put motor positions (rad | m), shape (..., nm), into y, shape (..., nq)."""
        if self.simple:
            y[..., self.q_at] = angle
            return
        plain, turning = self.paired == 0, self.paired == 1
        at = self.q_at[turning]
        y[..., self.q_at[plain]] = angle[..., plain]
        y[..., at], y[..., at + 1] = np.cos(angle[..., turning]), np.sin(angle[..., turning])

    def read(self, y: Array) -> Array:
        """Motor positions (rad | m), shape (..., nm), of y, shape (..., nq)."""
        angle = np.array(y[..., self.q_at], float)
        for k in np.flatnonzero(self.paired):
            angle[..., k] = np.arctan2(y[..., self.q_at[k] + 1], y[..., self.q_at[k]])
        return angle


def motor_axes(mechanism: Mechanism) -> MotorAxes:
    """Locate the motors.

    Raises:
        DescriptionError: A motor with more than one axis.
    """
    model = mechanism.rigid.rigid
    q_at, v_at, paired = [], [], []
    for name in mechanism.description.actuated:
        joint = model.joints[model.getJointId(name)]
        if joint.nv != 1:
            raise DescriptionError(
                f"{mechanism.name}: actuated: {name} has {joint.nv} axes. A motor has one axis; "
                "split the joint in the URDF."
            )
        q_at.append(joint.idx_q)
        v_at.append(joint.idx_v)
        paired.append(int(joint.nq == 2))
    return MotorAxes(
        np.array(q_at, dtype=np.intp),
        np.array(v_at, dtype=np.intp),
        np.array(paired, dtype=np.intp),
        not any(paired),
    )


def joint_path(mechanism: Mechanism, motion: Motion, t: Array) -> tuple[Array, Array, Array]:
    """Motor positions, velocities, accelerations of a motion of joints, each (nt, nm)."""
    axes = motor_axes(mechanism)
    names = list(mechanism.description.actuated)
    home = axes.read(mechanism.home)
    position = np.tile(home, (len(t), 1))
    velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
    p, v, a = motion.evaluate(t)
    for k, name in enumerate(motion.names):
        if name not in names:
            raise DescriptionError(
                f"{mechanism.name}: motion.joints.{name}: not a motor.{nearest(name, names)}"
            )
        column = names.index(name)
        position[:, column] = p[:, k] if motion.absolute else home[column] + p[:, k]
        velocity[:, column], acceleration[:, column] = v[:, k], a[:, k]
    return position, velocity, acceleration
