"""Coordinates of the platform on a system, rigid or flexible: values and Jacobian at a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.closed_poses import COORDINATES, euler_rates, zyx_angles
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.expanded import Attachment


class PlatformCoordinates:
    """World position x y z [m] and intrinsic Z-Y-X angles rz ry rx [rad] of a frame.

    Attributes:
        names: Coordinates that are read, in order.
        turning: Which of them are angles, shape (k,).
    """

    def __init__(self, dynamics: Dynamics, frame: Attachment, names: Sequence[str]) -> None:
        for name in names:
            if name not in COORDINATES:
                raise DescriptionError(
                    f"coordinates: {name}: no platform coordinate.{nearest(name, COORDINATES)}"
                )
        self.names = tuple(names)
        self.turning = np.array([name.startswith("r") for name in names], dtype=bool)
        self._dynamics, self._frame = dynamics, frame
        self._columns = [COORDINATES.index(name) for name in names]

    def values(self, y: Array) -> Array:
        """Values at y (nq,), shape (k,)."""
        self._dynamics.place(y)
        pin.forwardKinematics(self._dynamics.model, self._dynamics.data, self._dynamics.Q)
        return self._pose()[self._columns]

    def at(self, y: Array) -> tuple[Array, Array]:
        """Values, shape (k,), and Jacobian by velocity rows, shape (k, nv), at y (nq,)."""
        d, frame = self._dynamics, self._frame
        d.place(y)
        pin.computeJointJacobians(d.model, d.data, d.Q)
        values = self._pose()
        J = pin.getFrameJacobian(
            d.model, d.data, frame.joint, frame.placement, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        J = d.times_map(np.asarray(J).reshape(6, -1))
        J[3:] = np.linalg.solve(euler_rates(values[None])[0], J[3:])
        return values[self._columns], J[self._columns]

    def _pose(self) -> Array:
        """All six coordinates where the joints are now."""
        world = self._dynamics.data.oMi[self._frame.joint] * self._frame.placement
        return np.concatenate([world.translation, zyx_angles(world.rotation[None])[0]])

    def error(self, values: Array, wanted: Array) -> Array:
        """values - wanted, angles within half a turn, shape (..., k)."""
        error = values - wanted
        turned = (error[..., self.turning] + np.pi) % (2.0 * np.pi) - np.pi
        error[..., self.turning] = turned
        return np.asarray(error)
