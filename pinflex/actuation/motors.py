"""The motors: where they sit in the coordinates, and their motion when it is given by joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion, from_spec, hold
from pinflex.errors import DescriptionError, nearest
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism


@dataclass(frozen=True)
class MotorAxes:
    """Where single-axis motors sit in q and v; a continuous joint keeps (cos, sin) in q.

    Attributes:
        q_at, v_at: First coordinate and row of each. plain: Numbers of those with one coordinate.
        paired: Numbers of those that keep (cos, sin).
    """

    __repr__ = brief

    q_at: IntArray
    v_at: IntArray
    plain: IntArray
    paired: IntArray

    def write(self, y: Array, angle: Array) -> None:
        """Put motor positions (rad | m), shape (..., nm), into y, shape (..., nq)."""
        if not len(self.paired):
            y[..., self.q_at] = angle
            return
        plain, cos, sin = self._places
        if len(plain):
            y[..., plain] = angle.take(self.plain, axis=-1)
            angle = angle.take(self.paired, axis=-1)
        y[..., cos], y[..., sin] = np.cos(angle), np.sin(angle)

    @cached_property
    def _places(self) -> tuple[IntArray, IntArray, IntArray]:
        """Of plain coordinates, of cosines and of sines."""
        at = self.q_at[self.paired]
        return self.q_at[self.plain], at, at + 1

    def read(self, y: Array) -> Array:
        """Motor positions (rad | m), shape (..., nm), of y, shape (..., nq)."""
        angle = np.array(y[..., self.q_at], float)
        for k in self.paired:
            angle[..., k] = np.arctan2(y[..., self.q_at[k] + 1], y[..., self.q_at[k]])
        return angle

    def behind(self, position: Array, y: Array) -> Array:
        """How far y (..., nq) is behind motor positions [rad | m], shape (..., nm).

        Of a motor that turns without end, the shorter way round.
        """
        error = position - self.read(y)
        if len(self.paired):
            whole = 2.0 * np.pi
            error[..., self.paired] -= whole * np.round(error[..., self.paired] / whole)
        return np.asarray(error)


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
        np.flatnonzero(np.logical_not(paired)),
        np.flatnonzero(paired),
    )


def joint_curve(
    mechanism: Mechanism, motion: Motion
) -> Callable[[Array], tuple[Array, Array, Array]]:
    """Motion of the motors as a function of times (nt,): what `joint_path` answers."""
    axes = motor_axes(mechanism)
    names = list(mechanism.description.actuated)
    home = axes.read(mechanism.home)
    for name in motion.names:
        if name not in names:
            raise DescriptionError(
                f"{mechanism.name}: motion.joints.{name}: not a motor.{nearest(name, names)}"
            )
    columns = [names.index(name) for name in motion.names]
    rest = home.copy()
    if motion.absolute:
        rest[columns] = 0.0

    if columns == list(range(len(names))):  # all of them, in order

        def every(t: Array) -> tuple[Array, Array, Array]:
            position, velocity, acceleration = motion.evaluate(t)
            return position + rest, velocity, acceleration

        return every

    def curve(t: Array) -> tuple[Array, Array, Array]:
        moved = np.zeros((3, len(t), len(names)))
        moved[:, :, columns] = motion.evaluate(t)
        moved[0] += rest
        return moved[0], moved[1], moved[2]

    return curve


def joint_path(mechanism: Mechanism, motion: Motion, t: Array) -> tuple[Array, Array, Array]:
    """Motor positions, velocities, accelerations of a motion of joints, each (nt, nm)."""
    return joint_curve(mechanism, motion)(t)


def plain_motion(mechanism: Mechanism) -> Motion:
    """The motion of the YAML without its shaper."""
    path, block = mechanism.description.path, mechanism.description.motion
    if block is None:
        return hold(duration=1.0)
    spec = {key: x for key, x in block.items() if key != "shaper"}
    folder = None if path is None else path.parent
    return from_spec(spec, f"{mechanism.name}.yaml: motion", folder)
