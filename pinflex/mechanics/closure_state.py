"""Closures evaluated at a configuration: residual c, Jacobian J and their exact derivatives.

See `pinflex.mechanics.closure` for the rows.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.closure import Closures
from pinflex.mechanics.contact import ContactState
from pinflex.mechanics.poses import SKEW, JointPoses, columns, skew


class ClosureState:
    """Closures evaluated at one configuration: c, W and what their derivatives need."""

    def __init__(
        self, closed: Closures, model: pin.Model, data: pin.Data, poses: JointPoses | None = None
    ) -> None:
        """`poses`: those of the data, where they are known."""
        self.closed = closed
        self.poses = poses or JointPoses(model, data)
        self._model, self._data = model, data
        loops = len(closed.names)
        self._loops = loops
        self.c = np.zeros(closed.n)
        self.W = np.zeros((closed.n, 6))
        self.J = np.zeros((closed.n, model.nv))
        self._point_loop = closed.loop_of[closed.point_rows]
        self._dot_loop = closed.loop_of[closed.dot_rows]
        self._distance_loop = closed.loop_of[closed.distance_rows]
        self._frames = np.zeros((2 * loops, 3, 4))
        self.frames_a, self.frames_b = self._frames[:loops], self._frames[loops:]
        self.gap = np.zeros((loops, 3))
        self._arm = np.zeros((loops, 3, 3))
        # Flat positions of u = a[loop, :, axis] among the frames: one `take` instead of indexing.
        self._u_at = self._point_loop[:, None] * 12 + 4 * np.arange(3) + closed.point_axes[:, None]
        self._plain = closed.n == len(closed.point_rows)
        self.contacts = [ContactState(contact) for contact in closed.contacts]
        self.Q = np.zeros(0)  # configuration of the model, for couplings only
        self._coupled = closed.coupled if len(closed.coupled.rows) else None
        # Elastic coordinates and their rates, and dc/deta, for the rows of sleeves only.
        self.eta = self.eta_rate = np.zeros(0)
        self.J_eta = np.zeros((closed.n, 0))

    def evaluate(self) -> None:
        """c, W and J from the joint poses and Jacobians in the data (both must be current)."""
        self.poses.refresh()
        self.rows_from(self.poses.block)
        if self.contacts:
            self._evaluate_contacts()
        np.matmul(self.W, columns(self._data.J), out=self.J)
        self.J *= self.closed.row_mask
        if self._coupled is not None:
            self.J[self._coupled.rows] = self._coupled.J

    def rows_from(self, poses: Array) -> None:
        """c and W from joint poses, shape (joints, 12) (see `JointPoses`), and Q for couplings."""
        cl, loops = self.closed, self._loops
        joints = poses.take(cl.bodies, axis=0)
        rotations = joints[:, :9].reshape(-1, 3, 3).transpose(0, 2, 1)
        np.matmul(rotations, cl.local, out=self._frames)
        origin = self._frames[:, :, 3]
        origin += joints[:, 9:]
        np.subtract(origin[loops:], origin[:loops], out=self.gap)
        np.matmul(origin[loops:], SKEW, out=self._arm.reshape(loops, 9))
        if len(cl.point_rows):
            u, loop = self._frames.take(self._u_at), self._point_loop
            c = np.einsum("ij,ij->i", u, self.gap.take(loop, axis=0))
            turned = np.matmul(self._arm.take(loop, axis=0), u[:, :, None])[:, :, 0]
            if self._plain:
                self.c, self.W[:, :3], self.W[:, 3:] = c, u, turned
            else:
                rows = cl.point_rows
                self.c[rows], self.W[rows, :3], self.W[rows, 3:] = c, u, turned
        if len(cl.dot_rows):
            loop = self._dot_loop
            e_a = self.frames_a[loop, :, cl.dot_a]
            e_b = self.frames_b[loop, :, cl.dot_b]
            self.c[cl.dot_rows] = (e_a * e_b).sum(1)
            self.W[cl.dot_rows, 3:] = (skew(e_b) @ e_a[:, :, None])[:, :, 0]
        if len(cl.distance_rows):
            loop = self._distance_loop
            d = self.gap[loop]
            self.c[cl.distance_rows] = ((d * d).sum(1) - cl.lengths**2) / (2 * cl.lengths)
            u = d / cl.lengths[:, None]
            self.W[cl.distance_rows, :3] = u
            self.W[cl.distance_rows, 3:] = (self._arm[loop] @ u[:, :, None])[:, :, 0]
        if self._coupled is not None:
            self.c[self._coupled.rows] = self._coupled.value(self.Q.reshape(-1))

    def _evaluate_contacts(self) -> None:
        if self.J_eta.shape[1] != len(self.eta):
            self.J_eta = np.zeros((self.closed.n, len(self.eta)))
        for one in self.contacts:
            k = one.loop
            one.evaluate(self.frames_a[k], self.frames_b[k], self._arm[k], self.eta)
            self.c[one.rows], self.W[one.rows] = one.value, one.W
            if self.J_eta.shape[1]:
                self.J_eta[one.rows, one.eta] = one.by_eta

    def require_on_beams(self, where: str, t: float | None = None) -> None:
        """Raise a MotionError where a sleeve has left its beam, at a time t (s)."""
        for one in self.contacts:
            one.require_on_beam(self.closed.names[one.loop], where, t)

    def wrenches(self, lam: Array) -> Array:
        """World wrench [force; moment about the origin] on each B, shape (loops, 6)."""
        F = np.zeros((self._loops, 6))
        np.add.at(F, self.closed.loop_of, self.W * lam[:, None])
        return F

    def body_wrenches(self, lam: Array) -> dict[int, Array]:
        """World wrenches of the closures by joint: +W on B, -W on A."""
        total = {int(body): np.zeros(6) for body in self.closed.bodies}
        for k, wrench in enumerate(self.wrenches(lam)):
            total[int(self.closed.bodies[self._loops + k])] += wrench
            total[int(self.closed.bodies[k])] -= wrench
        return total

    def bias(self, V: Array) -> Array:
        """Jdot V, shape (rows,): needs J and dJ (time variation) current in the data.

        Rows of sleeves add what follows from `eta_rate`, so that cdd = J A + J_eta eta_a + bias.
        """
        cl, data = self.closed, self._data
        twist_a = (cl.support_a * V) @ columns(data.J).T
        twist_b = (cl.support_b * V) @ columns(data.J).T
        return self.drift(twist_a, twist_b, (cl.support_b - cl.support_a) * V @ columns(data.dJ).T)

    def drift(self, twist_a: Array, twist_b: Array, turned: Array) -> Array:
        """`bias` from the world twists of A and B and their relative acceleration, (loops, 6)."""
        cl, relative = self.closed, twist_b - twist_a
        rate = np.zeros_like(self.W)
        spin_a, spin_b = skew(twist_a[:, 3:]), skew(twist_b[:, 3:])
        p_b = self.frames_b[:, :, 3]
        v_b = twist_b[:, :3] + (spin_b @ p_b[:, :, None])[:, :, 0]
        v_a = twist_a[:, :3] + (spin_a @ self.frames_a[:, :, 3:])[:, :, 0]
        swept = skew(v_b)

        def point(rows: IntArray, loop: IntArray, u: Array, du: Array) -> None:
            rate[rows, :3] = du
            turn = swept[loop] @ u[:, :, None] + self._arm[loop] @ du[:, :, None]
            rate[rows, 3:] = turn[:, :, 0]

        if len(cl.point_rows):
            loop = self._point_loop
            u = self.frames_a[loop, :, cl.point_axes]
            point(cl.point_rows, loop, u, (spin_a[loop] @ u[:, :, None])[:, :, 0])
        if len(cl.dot_rows):
            loop = self._dot_loop
            e_a = self.frames_a[loop, :, cl.dot_a]
            e_b = self.frames_b[loop, :, cl.dot_b]
            de_a = (spin_a[loop] @ e_a[:, :, None])[:, :, 0]
            de_b = (spin_b[loop] @ e_b[:, :, None])[:, :, 0]
            rate[cl.dot_rows, 3:] = np.cross(de_b, e_a) + np.cross(e_b, de_a)
        if len(cl.distance_rows):
            loop = self._distance_loop
            u = self.gap[loop] / cl.lengths[:, None]
            du = (v_b - v_a)[loop] / cl.lengths[:, None]
            point(cl.distance_rows, loop, u, du)
        drift = np.zeros(cl.n)
        for one in self.contacts:
            k = one.loop
            rate[one.rows], drift[one.rows] = one.bias(
                spin_a[k], spin_b[k], (v_b - v_a)[k], swept[k], self.gap[k], self.eta,
                self.eta_rate,
            )  # fmt: skip
        loop = cl.loop_of
        total: Array = (rate * relative[loop]).sum(1) + (self.W * turned[loop]).sum(1)
        return total + drift

    def force_tangent(self, lam: Array, times_map: Callable[[Array], Array]) -> Array:
        """Part of d(J' lam)/dy that Pinocchio's derivatives with fixed local forces miss.

        The closure force follows frame a in direction and frame b in its point of attack, so in
        the bodies' own frames it changes with the relative motion of the two.

        Args:
            lam: Multipliers, shape (rows,).
            times_map: D (k, nV) to D X (k, nv).
        Returns:
            Shape (nv, nv).
        """
        cl, J = self.closed, columns(self._data.J)
        on_a, on_b = np.zeros((self._loops, 6, 6)), np.zeros((self._loops, 6, 6))
        force = np.zeros((self._loops, 3))
        np.add.at(force, self._point_loop, self.W[cl.point_rows, :3] * lam[cl.point_rows, None])
        pull = self.W[cl.distance_rows, :3] * lam[cl.distance_rows, None]
        np.add.at(force, self._distance_loop, pull)
        for one in self.contacts:
            force[one.loop] += lam[one.rows] @ self.W[one.rows, :3]
            turned_b, turned_a = one.turning_stiffness(lam)
            on_b[one.loop, 3:, 3:] += turned_b
            on_a[one.loop, 3:, 3:] += turned_a
        f, arm = skew(force), self._arm
        on_b[:, :3, 3:] += f
        on_b[:, 3:, 3:] += arm @ f
        on_a[:, 3:, :3] -= f
        on_a[:, 3:, 3:] += f @ arm
        for row, loop in zip(cl.distance_rows, self._distance_loop, strict=True):
            k = lam[row] / cl.lengths[list(cl.distance_rows).index(row)]
            move = np.hstack([np.eye(3), -arm[loop]]) * k
            for side in (on_a, on_b):
                side[loop, :3] += move
                side[loop, 3:] += arm[loop] @ move
        if len(cl.dot_rows):
            loop = self._dot_loop
            mu = lam[cl.dot_rows, None, None]
            e_a = skew(self.frames_a[loop, :, cl.dot_a])
            e_b = skew(self.frames_b[loop, :, cl.dot_b])
            np.add.at(on_b[:, 3:, 3:], loop, mu * (e_b @ e_a))
            np.add.at(on_a[:, 3:, 3:], loop, mu * (e_a @ e_b))
        n = J.shape[1]
        J_a = times_map((J * cl.support_a[:, None]).reshape(-1, n)).reshape(self._loops, 6, -1)
        J_b = times_map((J * cl.support_b[:, None]).reshape(-1, n)).reshape(self._loops, 6, -1)
        pushed = on_b @ (J_b - J_a), on_a @ (J_b - J_a)
        width = J_a.shape[2]
        total: Array = J_b.reshape(-1, width).T @ pushed[0].reshape(-1, width)
        total -= J_a.reshape(-1, width).T @ pushed[1].reshape(-1, width)
        for one in self.contacts:
            one.add_tangent(total, lam, (J_b - J_a)[one.loop], self.eta, width - len(self.eta))
        return total
