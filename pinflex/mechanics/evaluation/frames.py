"""Frames on a system: their poses, Jacobians and coordinates, at n states."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.description.motions.motion_keys import PLATFORM_COORDINATES
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.poses import skew, support
from pinflex.rotations import euler_rates, zyx_angles

if TYPE_CHECKING:
    from pinflex.arrays import Array
    from pinflex.mechanics.evaluation.compiled import Kinematics
    from pinflex.mechanics.evaluation.equations import Equations
    from pinflex.mechanics.model.expanded import Attachment


class Frame:
    """A frame of one model: where it is, and how it moves with the coordinates."""

    def __init__(self, model: pin.Model, place: Attachment) -> None:
        self._model, self._joint, self._placement = model, place.joint, place.placement

    @cached_property
    def _support(self) -> Array:
        return support(self._model, self._joint)

    def pose(self, poses: Array) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and origins (n, 3) in the world, from joint poses (n, joints, 12)."""
        joint, local = poses[:, self._joint], self._placement
        turn = joint[:, :9].reshape(-1, 3, 3).swapaxes(1, 2)
        return turn @ local.rotation, turn @ local.translation + joint[:, 9:]

    def jacobian(self, at: Kinematics) -> Array:
        """Velocity of the origin and angular velocity, world axes, by v: shape (n, 6, nv)."""
        own, (_, p) = at.J * self._support, self.pose(at.poses)
        own[:, :3] -= skew(p) @ own[:, 3:]
        return at.here.times_map(own)

    def rates(self, at: Kinematics) -> tuple[Array, Array, Array]:
        """Speed of the origin, angular velocity, and what both change by with a = 0, (n, 6).

        Returns:
            v (n, 3), w (n, 3), and accelerations (n, 6), world axes.
        """
        _, p = self.pose(at.poses)
        V, A = ((x * self._support)[:, :, None] for x in (at.here.V, at.here.A))
        (v, w), (a, spin) = (
            x.reshape(-1, 2, 3).swapaxes(0, 1) for x in (at.J @ V, at.dJ @ V + at.J @ A)
        )
        speed = v + np.cross(w, p)
        linear = a + np.cross(spin, p) + np.cross(w, speed)
        return speed, w, np.concatenate([linear, spin], axis=1)


def frame_poses(system: Equations, y: Array, place: Attachment) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and origins (n, 3) of a frame in the world at poses y (n, nq)."""
    return poses_of_frames(system, y, (place,))[0]


def poses_of_frames(
    system: Equations, y: Array, places: Sequence[Attachment]
) -> list[tuple[Array, Array]]:
    """Rotations (n, 3, 3) and origins (n, 3) of some frames in the world at poses y (n, nq)."""
    if (compiled := system.compiled) is None:
        poses = system.joint_poses(y)
        return [Frame(system.model, place).pose(poses) for place in places]
    found = compiled.poses(y, [place.joint for place in places])
    return [
        (at[:, :, :3] @ place.placement.rotation, at @ [*place.placement.translation, 1.0])
        for at, place in zip(found, places, strict=True)
    ]


def frame_pose(system: Equations, y: Array, place: Attachment) -> pin.SE3:
    """Pose of a frame in the world at y (nq,)."""
    R, p = Frame(system.model, place).pose(system.joint_poses(y))
    return pin.SE3(R[0], p[0])


def frame_jacobian(system: Equations, y: Array, place: Attachment) -> Array:
    """Velocity and angular velocity of a frame by velocity rows, world axes, shape (6, nv)."""
    found: Array = Frame(system.model, place).jacobian(system.kinematics(y))[0]
    return found


class PlatformCoordinates:
    """World position x y z [m] and intrinsic Z-Y-X angles rz ry rx [rad] of a frame.

    Attributes:
        names: Coordinates that are read, in order.
        turning: Which of them are angles, shape (k,). joint: That carries the frame.
    """

    def __init__(self, system: Equations, place: Attachment, names: Sequence[str]) -> None:
        for name in names:
            if name not in PLATFORM_COORDINATES:
                raise DescriptionError(
                    f"coordinates: {name}: no platform coordinate."
                    f"{nearest(name, PLATFORM_COORDINATES)}"
                )
        self.names, self.joint, self._place = tuple(names), place.joint, place
        self.turning = np.array([name.startswith("r") for name in names], dtype=bool)
        self._frame = Frame(system.model, place)
        self._columns = [PLATFORM_COORDINATES.index(name) for name in names]

    def values(self, poses: Array) -> Array:
        """Values from joint poses (n, joints, 12), shape (n, k)."""
        return self._every(poses)[:, self._columns]

    def of(self, system: Equations, y: Array) -> Array:
        """Values at y (n, nq), shape (n, k): of the compiled equations where they serve."""
        ((R, p),) = poses_of_frames(system, y, [self._place])
        return np.column_stack([p, zyx_angles(R)])[:, self._columns]

    def _every(self, poses: Array) -> Array:
        R, p = self._frame.pose(poses)
        return np.column_stack([p, zyx_angles(R)])

    def at(self, at: Kinematics) -> tuple[Array, Array]:
        """Values, shape (n, k), and Jacobian by velocity rows, shape (n, k, nv)."""
        every, J = self._every(at.poses), self._frame.jacobian(at)
        J[:, 3:] = np.linalg.solve(euler_rates(every[:, 3:]), J[:, 3:])
        return every[:, self._columns], J[:, self._columns]

    def bias(self, at: Kinematics) -> Array:
        """Second rates of the coordinates where accelerations are zero, shape (n, k)."""
        B = euler_rates(self._every(at.poses)[:, 3:])
        _, w, swept = self._frame.rates(at)
        rates = np.linalg.solve(B, w[:, :, None])[:, :, 0]
        z, y, x = (B[:, :, k] for k in range(3))
        turned = rates[:, :1] * rates[:, 1:2] * np.cross(z, y)
        turned += rates[:, 2:] * np.cross(rates[:, :1] * z + rates[:, 1:2] * y, x)
        swept[:, 3:] = np.linalg.solve(B, (swept[:, 3:] - turned)[:, :, None])[:, :, 0]
        return swept[:, self._columns]

    def error(self, values: Array, wanted: Array) -> Array:
        """values - wanted, angles within half a turn, shape (..., k)."""
        error = values - wanted
        turned = (error[..., self.turning] + np.pi) % (2.0 * np.pi) - np.pi
        error[..., self.turning] = turned
        return np.asarray(error)
