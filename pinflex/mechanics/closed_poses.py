"""Closures, and the platform coordinates that a motion imposes, at several rigid poses at once.

Pinocchio takes the poses one after the other; everything around it runs on stacked arrays.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.closure_state import ClosureState
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.poses import columns, skew
from pinflex.mechanics.stacked import stack

COORDINATES = ("x", "y", "z", "rz", "ry", "rx")


class ClosedPoses:
    """Rows of one rigid system: its closures, then the imposed coordinates of a platform."""

    def __init__(
        self, dynamics: Dynamics, platform: Attachment | None = None, imposed: tuple[int, ...] = ()
    ) -> None:
        self._dynamics, self._platform = dynamics, platform
        self._imposed: IntArray = np.array(imposed, dtype=np.intp)
        self.turns = self._imposed >= 3
        # Sleeves are evaluated pose by pose.
        self._by_one = bool(dynamics.system.closed.contacts)
        self._stacks: dict[int, ClosureState] = {}
        if platform is not None:
            self._support = np.zeros(int(dynamics.model.nv))
            for joint in list(dynamics.model.supports[platform.joint])[1:]:
                above = dynamics.model.joints[joint]
                self._support[above.idx_v : above.idx_v + above.nv] = 1.0

    def at(self, Y: Array) -> tuple[Array, Array, Array]:
        """Closures and coordinates at poses Y (n, nq).

        Returns:
            c (n, rows); the imposed coordinates x, y, z (m), rz, ry, rx (rad), shape (n, k); the
            Jacobian of both, shape (n, rows + k, nv).
        """
        poses, J, _ = self._visit(Y, None)
        c, J_c = self._closures(Y, poses, J)
        if self._platform is None:
            return c, np.empty((len(Y), 0)), J_c
        place, p = self._place(poses)
        own = J * self._support
        linear = own[:, :3] - skew(p) @ own[:, 3:]
        turning = np.linalg.solve(euler_rates(place), own[:, 3:])
        both = np.concatenate([linear, turning], axis=1)[:, self._imposed]
        return c, place[:, self._imposed], np.concatenate([J_c, both], axis=1)

    def bias(self, Y: Array, V: Array) -> Array:
        """What velocities V (n, nv) alone make of the rows' accelerations, shape (n, rows + k)."""
        poses, J, dJ = self._visit(Y, V)
        gamma = self._closure_bias(Y, V, poses, J, dJ)
        if self._platform is None:
            return gamma
        place, p = self._place(poses)
        moved = (V * self._support)[:, :, None]
        (v, w), (a, spin) = ((x @ moved).reshape(-1, 2, 3).swapaxes(0, 1) for x in (J, dJ))
        linear = a + np.cross(spin, p) + np.cross(w, v + np.cross(w, p))
        B = euler_rates(place)
        rates = np.linalg.solve(B, w[:, :, None])[:, :, 0]
        z, y, x = (B[:, :, k] for k in range(3))
        turned = rates[:, :1] * rates[:, 1:2] * np.cross(z, y)
        turned += rates[:, 2:] * np.cross(rates[:, :1] * z + rates[:, 1:2] * y, x)
        angular = np.linalg.solve(B, (spin - turned)[:, :, None])[:, :, 0]
        both = np.concatenate([linear, angular], axis=1)[:, self._imposed]
        return np.concatenate([gamma, both], axis=1)

    def _visit(self, Y: Array, V: Array | None) -> tuple[Array, Array, Array]:
        """Joint poses (n, joints, 12), world Jacobians and their rates (with V), (n, 6, nv)."""
        d, n = self._dynamics, len(Y)
        model, data, here = d.model, d.data, d.closed.poses
        poses = np.empty((n, int(model.njoints), 12))
        J = np.empty((n, 6, int(model.nv)))
        dJ = np.empty_like(J if V is not None else J[:0])
        now, rate = columns(data.J), columns(data.dJ)
        for k in range(n):
            if V is None:
                pin.computeJointJacobians(model, data, Y[k])
            else:
                pin.computeJointJacobiansTimeVariation(model, data, Y[k], V[k])
                dJ[k] = rate
            J[k] = now
            here.refresh()
            poses[k] = here.block
        return poses, J, dJ

    def _stacked(self, Y: Array, poses: Array) -> ClosureState:
        """The closures of all poses, evaluated."""
        d, n = self._dynamics, len(poses)
        if n not in self._stacks:
            closed = stack(d.system.closed, n, int(d.model.njoints), int(d.model.nq))
            self._stacks[n] = ClosureState(closed, d.model, d.data, d.closed.poses)
        self._stacks[n].Q = Y
        self._stacks[n].rows_from(poses.reshape(-1, 12))
        return self._stacks[n]

    def _closures(self, Y: Array, poses: Array, J: Array) -> tuple[Array, Array]:
        d, n, closed = self._dynamics, len(Y), self._dynamics.system.closed
        if self._by_one:
            found = [tuple(x.copy() for x in d.close(y)) for y in Y]
            return np.array([c for c, _ in found]), np.array([J_c for _, J_c in found])
        if not d.looped:
            return np.empty((n, 0)), np.empty((n, 0, d.system.nv))
        state = self._stacked(Y, poses)
        rows = state.W.reshape(n, -1, 6) @ J * closed.row_mask
        if len(closed.coupled.rows):
            rows[:, closed.coupled.rows] = closed.coupled.J
        return state.c.reshape(n, -1).copy(), rows

    def _closure_bias(self, Y: Array, V: Array, poses: Array, J: Array, dJ: Array) -> Array:
        d, n, closed = self._dynamics, len(Y), self._dynamics.system.closed
        if self._by_one:
            return np.array([d.closure_bias(y, v) for y, v in zip(Y, V, strict=True)])
        if not d.looped:
            return np.empty((n, 0))
        twist_a, twist_b = (
            ((mask * V[:, None]) @ J.swapaxes(1, 2)).reshape(-1, 6)
            for mask in (closed.support_a, closed.support_b)
        )
        swept = (closed.support_b - closed.support_a) * V[:, None] @ dJ.swapaxes(1, 2)
        return self._stacked(Y, poses).drift(twist_a, twist_b, swept.reshape(-1, 6)).reshape(n, -1)

    def _place(self, poses: Array) -> tuple[Array, Array]:
        """Coordinates x, y, z, rz, ry, rx (n, 6) and position (n, 3) of the platform."""
        assert self._platform is not None
        joint, local = poses[:, self._platform.joint], self._platform.placement
        turn = joint[:, :9].reshape(-1, 3, 3).swapaxes(1, 2)
        R, p = turn @ local.rotation, turn @ local.translation + joint[:, 9:]
        return np.column_stack([p, zyx_angles(R)]), p


def zyx_angles(R: Array) -> Array:
    """Intrinsic angles (rz, ry, rx) of R = Rz Ry Rx, shape (n, 3), of rotations (n, 3, 3)."""
    rz = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    ry = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0]))
    return np.column_stack([rz, ry, np.arctan2(R[:, 2, 1], R[:, 2, 2])])


def euler_rates(place: Array) -> Array:
    """B (n, 3, 3) in omega = B (rz, ry, rx)', columns the current axes of the three turns."""
    cz, sz, cy, sy = (
        np.cos(place[:, 3]),
        np.sin(place[:, 3]),
        np.cos(place[:, 4]),
        np.sin(place[:, 4]),
    )
    none, one = np.zeros_like(cz), np.ones_like(cz)
    rows = [[none, -sz, cz * cy], [none, cz, sz * cy], [one, none, -sy]]
    return np.array(rows).transpose(2, 0, 1)
