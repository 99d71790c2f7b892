"""The closure rows of one state or of many, ready to be evaluated: where each of them reads.

The states are copies of the loops whose joint poses lie one after the other.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.closure import Closures
from pinflex.mechanics.closure_state import ClosureState
from pinflex.mechanics.contact import ContactRows


class ClosureRows:
    """Index tables of the rows of n states.

    Attributes:
        closed: The loops of one state. size: Number of states. loops: Of all states together.
        loop_of: Loop of each row. bodies: Joints of A then B. local: Frames in them.
        point_rows, dot_rows, distance_rows: Rows of each sort; point_loop, dot_loop and
            distance_loop: their loops. lengths: Of the distances in m.
        plain: Whether every row is of point type.
        coupled: Rows of couplings, or None. contacts: Constants of the sleeves' rows of one state.
    """

    def __init__(self, closed: Closures, size: int, joints: int) -> None:
        """`joints`: Number of joint poses of a state."""
        self.closed, self.size = closed, size
        loops, rows = len(closed.names), closed.n
        self.loops = loops * size
        copies = np.arange(size)[:, None]

        def each(at: IntArray, step: int) -> IntArray:
            return np.asarray((at + step * copies).reshape(-1), dtype=np.intp)

        self.bodies = (closed.bodies.reshape(2, 1, loops) + joints * copies).reshape(-1)
        local = np.tile(closed.local.reshape(2, 1, loops, 3, 4), (1, size, 1, 1, 1))
        self.local = local.reshape(-1, 3, 4)
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
        self.plain = rows == len(closed.point_rows)
        # Flat positions of u = a[loop, :, axis] among the frames: one `take` instead of indexing.
        self.u_at = self.point_loop[:, None] * 12 + 4 * np.arange(3) + self.point_axes[:, None]
        self.mask = closed.support_b - closed.support_a
        self.of_loop = (np.arange(loops)[:, None] == closed.loop_of).astype(float)
        self.coupled = closed.coupled if len(closed.coupled.rows) else None
        self.contacts = [ContactRows(contact) for contact in closed.contacts]

    def at(self, poses: Array, eta: Array, Q: Array) -> ClosureState:
        """The closures at joint poses (n, joints, 12), see `JointPoses`, eta and Q, (n, ...).

        Args:
            poses: Joint poses, shape (n, joints, 12), see `JointPoses`.
            eta: Elastic coordinates, shape (n, n_eta).
            Q: Expanded configurations, shape (n, nQ).
        """
        return ClosureState(self, poses.reshape(-1, 12), eta, Q)
