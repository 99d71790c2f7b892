"""The closure rows of one state or of many, ready to be evaluated: where each of them reads.

The states are copies of the loops whose joint poses lie one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.closure_state import ClosureState
from pinflex.mechanics.contact import ContactRows
from pinflex.mechanics.passing import PassingRows
from pinflex.mechanics.slider import Contact

if TYPE_CHECKING:
    from pinflex.mechanics.closure import Closures

_ON, _BACK = [1, 2, 0], [2, 0, 1]  # the axes after x, y, z, and before them


class ClosureRows:
    """Index tables of the rows of n states.

    Attributes:
        closed: The loops of one state. size: Number of states. loops: Of all states together.
        loop_of: Loop of each row. bodies: Joints of A then B. local: Frames in them.
        point_rows, dot_rows, distance_rows: Rows of each sort; point_loop, dot_loop and
            distance_loop: their loops. lengths: Of the distances in m.
        plain: Whether every row is of point type, and no sleeve has lost its own.
        coupled: Rows of couplings, or None. contacts: Constants of the sleeves' rows, by state.
        support_a, support_b, row_mask: As in `Closures`, of one state or of each.
        sides: Joints of A and B, shape (n or 1, 2, loops).
    """

    def __init__(
        self, closed: Closures, size: int, joints: int, on: Sequence[tuple[int, ...]] = ()
    ) -> None:
        """`joints`: Number of joint poses of a state. `on`: Segments of the sleeves, by state."""
        self.closed, self.size = closed, size
        each_on = [closed.on(numbers) for numbers in on]
        loops, rows = len(closed.names), closed.n
        self.loops = loops * size
        copies = np.arange(size)[:, None]

        def each(at: IntArray, step: int) -> IntArray:
            return np.asarray((at + step * copies).reshape(-1), dtype=np.intp)

        variants = each_on or [closed]
        self.sides = np.array([one.bodies.reshape(2, loops) for one in variants])
        bodies = self.sides.swapaxes(0, 1) + joints * copies
        self.bodies = np.broadcast_to(bodies, (2, size, loops)).reshape(-1)
        local = np.array([one.local.reshape(2, loops, 3, 4) for one in variants]).swapaxes(0, 1)
        self.local = np.tile(local, (1, size // len(variants), 1, 1, 1)).reshape(-1, 3, 4)
        self.loop_of = each(closed.loop_of, loops)
        self.point_rows = each(closed.point_rows, rows)
        self.dot_rows = each(closed.dot_rows, rows)
        self.distance_rows = each(closed.distance_rows, rows)
        self.point_loop, self.dot_loop, self.distance_loop = (
            self.loop_of[at] for at in (self.point_rows, self.dot_rows, self.distance_rows)
        )
        self.point_axes = np.tile(closed.point_axes, size)
        self.dot_a, self.dot_b = np.tile(closed.dot_a, size), np.tile(closed.dot_b, size)
        self.lengths = np.tile(closed.lengths, size)
        self.plain = rows == len(closed.point_rows) and not closed.contacts
        self.points = PointRows(closed, size, joints) if self.plain else None
        # Flat positions of u = a[loop, :, axis] among the frames: one `take` instead of indexing.
        self.u_at = self.point_loop[:, None] * 12 + 4 * np.arange(3) + self.point_axes[:, None]
        self.support_b, self.support_a, self.row_mask = (
            closed.support_b, closed.support_a, closed.row_mask,
        )  # fmt: skip
        if each_on:
            self.support_a = np.array([one.support_a for one in each_on])
            self.row_mask = np.array([one.row_mask for one in each_on])
        self.mask = self.support_b - self.support_a
        self.of_loop = (np.arange(loops)[:, None] == closed.loop_of).astype(float)
        self.coupled = closed.coupled if len(closed.coupled.rows) else None
        rows_of = [[_of_sleeve(contact) for contact in one.contacts] for one in variants]
        self.contacts = rows_of * (size // len(variants))
        self._of_joints: tuple[Sequence[int], Array] = [], np.zeros((1, 0, loops))

    def of_joints(self, joints: Sequence[int]) -> Array:
        """Part of the wrench on each B that acts on joints, (n or 1, joints, loops): +1 B, -1 A."""
        if self._of_joints[0] != joints:
            at = np.array(joints, dtype=np.intp)[:, None]
            on_b, on_a = (at == self.sides[:, None, side] for side in (1, 0))
            self._of_joints = list(joints), on_b.astype(float) - on_a
        return self._of_joints[1]

    def at(self, poses: Array, eta: Array, Q: Array) -> ClosureState:
        """The closures at joint poses (n, joints, 12), see `JointPoses`, eta and Q, (n, ...).

        Args:
            poses: Joint poses, shape (n, joints, 12), see `JointPoses`.
            eta: Elastic coordinates, shape (n, n_eta).
            Q: Expanded configurations, shape (n, nQ).
        """
        return ClosureState(self, poses.reshape(-1, 12), eta, Q)


class PointRows:
    """Rows u . (p_b - p_a) and p_b x u as products of numbers that are linear in two joint poses.

    Attributes:
        at: Where the poses of A and B lie among the flat ones, shape (rows, n, 24).
        linear: These to [u, p_b on, p_b back | p_b - p_a, u back, u on], shape (rows, 24, 18): "on"
            and "back" by the cycle of the axes.
    """

    def __init__(self, closed: Closures, size: int, joints: int) -> None:
        loops, rows = len(closed.names), closed.n
        loop = closed.loop_of
        sides = closed.bodies.reshape(2, loops)[:, loop].T
        first = 12 * (sides[:, None] + joints * np.arange(size)[:, None])
        self.at = (first[..., None] + np.arange(12)).reshape(rows, size, 24)
        # A pose is read column by column: R e + p of a point e has weights (e, 1) of its columns.
        local = closed.local.reshape(2, loops, 3, 4)[:, loop]
        each, none = np.arange(rows), np.zeros((rows, 12, 3))
        direction, points = np.zeros((rows, 4)), np.ones((2, rows, 4))
        direction[:, :3] = local[0, each, :, closed.point_axes]
        points[:, :, :3] = local[:, :, :, 3]
        on_a, a, b = (
            np.einsum("rk,ij->rkij", weights, np.eye(3)).reshape(rows, 12, 3)
            for weights in (direction, *points)
        )
        u, p_b, d = (np.hstack(both) for both in ((on_a, none), (none, b), (-a, b)))
        parts = (u, p_b[..., _ON], p_b[..., _BACK], d, u[..., _BACK], u[..., _ON])
        self.linear = np.concatenate(parts, axis=2)

    def of(self, poses: Array) -> tuple[Array, Array]:
        """Residuals (n, rows) and weights W of the relative world twists (n, rows, 6).

        Args:
            poses: Flat joint poses, see `JointPoses`.
        """
        both = np.matmul(poses.take(self.at), self.linear)
        products = both[..., :9] * both[..., 9:]
        W = np.empty((self.at.shape[1], len(self.at), 6))
        each = W.swapaxes(0, 1)
        each[..., :3] = both[..., :3]
        np.subtract(products[..., 3:6], products[..., 6:], out=each[..., 3:])
        return np.add.reduce(products[..., :3], axis=-1).T, W


def _of_sleeve(contact: Contact) -> ContactRows | PassingRows:
    return PassingRows(contact) if contact.sleeve.segments else ContactRows(contact)


# How far beyond the root of a segment, over its length, a sleeve is on it. The curvature jumps
# there, as between elements; a sleeve that comes to rest at a border, as round numbers have it,
# would be on either side by turns. So far the curve goes on: 1e-12 of a length off the next one.
_PAST = 1e-6


class Passing:
    """Sleeves that pass from one segment of a link to the next."""

    def __init__(self, closed: Closures) -> None:
        self._roots, self._b = [], []
        loops = len(closed.names)
        for contact in closed.contacts:
            segments = contact.sleeve.segments[1:]
            at = np.array([segment.root.joint for segment in segments], dtype=np.intp)
            local = [segment.root.placement.homogeneous[:3] for segment in segments]
            past = np.array([_PAST * segment.length for segment in segments])
            self._roots.append((at, np.array(local).reshape(-1, 3, 4), past))
            self._b.append((int(closed.bodies[loops + contact.loop]),
                            closed.local[loops + contact.loop]))  # fmt: skip

    def at(self, poses: Array) -> tuple[tuple[int, ...], ...]:
        """Segment of each sleeve at joint poses (n, joints, 12), by state.

        A sleeve has passed the root of a segment when it stands before the section there.
        """
        found = []
        for (joints, local, past), (b, own) in zip(self._roots, self._b, strict=True):
            R = poses[:, joints, :9].reshape(len(poses), -1, 3, 3).swapaxes(2, 3)
            p = poses[:, joints, 9:] + (R @ local[:, :, 3:])[..., 0]
            R_b = poses[:, b, :9].reshape(-1, 3, 3).swapaxes(1, 2)
            ahead = (poses[:, None, b, 9:] + (R_b @ own[:, 3])[:, None]) - p
            x = (R @ local[:, :, :1])[..., 0]
            found.append(np.sum((ahead * x).sum(axis=2) >= past, axis=1))
        return tuple(tuple(int(k) for k in row) for row in np.array(found).T)
