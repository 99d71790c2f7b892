"""Closures at one state or at many: residual c, Jacobian J and their exact derivatives.

See `pinflex.mechanics.closure` for the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.poses import LEVERS, skew

if TYPE_CHECKING:
    from pinflex.mechanics.closure_rows import ClosureRows
    from pinflex.mechanics.contact import ContactState
    from pinflex.mechanics.passing import PassingState


class ClosureState:
    """Closures at n states: a value, made by `ClosureRows.at`.

    Attributes:
        c: Residuals, shape (n, rows). W: By the relative world twists, shape (n rows, 6).
        contacts: Sleeves, of one state after the other.
    """

    def __init__(self, rows: ClosureRows, poses: Array, eta: Array, Q: Array) -> None:
        self._rows, self._poses, self._n = rows, poses, rows.size
        self.contacts: list[ContactState | PassingState] = []
        if rows.points is not None:
            self.c, W = rows.points.of(poses)
            self.W = W.reshape(-1, 6)
            return
        each = rows.closed.n
        c, self.W = np.empty(rows.size * each), np.zeros((rows.size * each, 6))
        self._mixed_rows(c)
        self.c = c.reshape(rows.size, each)
        if rows.coupled is not None:
            self.c[:, rows.coupled.rows] = rows.coupled.value(Q)
        if rows.closed.contacts:
            self._slide(c, eta)

    @cached_property
    def _frames(self) -> Array:
        """Frames of A, then of B, in the world, shape (2 n loops, 3, 4)."""
        joints = self._poses.take(self._rows.bodies, axis=0)
        rotations = joints[:, :9].reshape(-1, 3, 3).transpose(0, 2, 1)
        frames: Array = np.matmul(rotations, self._rows.local)
        frames[:, :, 3] += joints[:, 9:]
        return frames

    @property
    def frames_a(self) -> Array:
        """Frames of A in the world, [R | p], shape (n loops, 3, 4)."""
        return self._frames[: self._rows.loops]

    @property
    def frames_b(self) -> Array:
        """Frames of B in the world, [R | p], shape (n loops, 3, 4)."""
        return self._frames[self._rows.loops :]

    @cached_property
    def _levers(self) -> Array:
        """Matrices that take u to u . (p_b - p_a) and p_b x u, shape (n loops, 3, 4)."""
        loops = self._rows.loops
        ends = self._frames[:, :, 3].reshape(2, loops, 3).transpose(1, 0, 2).reshape(loops, 6)
        return np.asarray((ends @ LEVERS).reshape(loops, 3, 4))

    @property
    def gap(self) -> Array:
        """Origin of b less that of a, shape (n loops, 3)."""
        return np.asarray(self._levers[:, :, 0])

    @property
    def _arm(self) -> Array:
        """Matrices of p_b x (.), shape (n loops, 3, 3)."""
        return np.asarray(self._levers[:, :, 1:].swapaxes(1, 2))

    def _mixed_rows(self, c: Array) -> None:
        """Rows of points, of directions and of distances."""
        r = self._rows
        if len(r.point_rows):
            u = self._frames.take(r.u_at)
            held = np.matmul(u[:, None], self._levers[r.point_loop])[:, 0]
            c[r.point_rows], self.W[r.point_rows] = held[:, 0], np.hstack([u, held[:, 1:]])
        if len(r.dot_rows):
            e_a = self.frames_a[r.dot_loop, :, r.dot_a]
            e_b = self.frames_b[r.dot_loop, :, r.dot_b]
            c[r.dot_rows] = (e_a * e_b).sum(1)
            self.W[r.dot_rows, 3:] = (skew(e_b) @ e_a[:, :, None])[:, :, 0]
        if len(r.distance_rows):
            loop = r.distance_loop
            d = self.gap[loop]
            c[r.distance_rows] = ((d * d).sum(1) - r.lengths**2) / (2 * r.lengths)
            u = d / r.lengths[:, None]
            self.W[r.distance_rows, :3] = u
            self.W[r.distance_rows, 3:] = (self._arm[loop] @ u[:, :, None])[:, :, 0]

    def _slide(self, c: Array, eta: Array) -> None:
        """Rows of sleeves, one state after the other."""
        r = self._rows
        loops, count = len(r.closed.names), r.closed.n
        for k in range(r.size):
            for rows in r.contacts[k]:
                loop = rows.loop + k * loops
                one = rows.at(self.frames_a[loop], self.frames_b[loop], self._arm[loop], eta[k])
                at = rows.rows + k * count
                c[at], self.W[at] = one.value, one.W
                self.contacts.append(one)

    def jacobian(self, J: Array) -> Array:
        """dc/dQ, shape (n, rows, nV), for world Jacobians J (n, 6, nV) of the joints."""
        found: Array = self.W.reshape(self._n, -1, 6) @ J * self._rows.row_mask
        if self._rows.coupled is not None:
            found[:, self._rows.coupled.rows] = self._rows.coupled.J
        return found

    def by_eta(self, n_eta: int) -> Array:
        """dc/deta of the sleeves' rows at fixed poses, shape (n, rows, n_eta)."""
        out = np.zeros((*self.c.shape, n_eta))
        if n_eta:
            for k, one in self._by_state():
                block = np.zeros((len(one.rows), n_eta))
                block[:, one.eta] = one.by_eta
                out[k, one.rows] = block
        return out

    def _by_state(self) -> list[tuple[int, ContactState | PassingState]]:
        each = len(self._rows.closed.contacts)
        return [(i // each, one) for i, one in enumerate(self.contacts)]

    def wrenches(self, lam: Array) -> Array:
        """World wrench [force; moment about the origin] on each B, shape (n, loops, 6)."""
        rows = (self.W * lam.reshape(-1, 1)).reshape(self._n, -1, 6)
        return np.asarray(np.matmul(self._rows.of_loop, rows))

    def on_joints(self, lam: Array, joints: Sequence[int]) -> Array:
        """World wrenches about the origin on some joints, shape (n, joints, 6): +1 B, -1 A.

        Args:
            lam: Multipliers, shape (n, rows).
            joints: Numbers of the joints.
        """
        return np.asarray(self._rows.of_joints(joints) @ self.wrenches(lam))

    def loop_wrenches(self, lam: Array) -> Array:
        """Wrench on each B about the origin of frame b, in the world, shape (n, loops, 6)."""
        out = self.wrenches(lam)
        origin = self.frames_b[:, :, 3].reshape(self._n, -1, 3)
        out[..., 3:] -= np.cross(origin, out[..., :3])
        return out

    def sleeves(self, lam: Array) -> Array:
        """(x, F, M, segment) of sleeves on beams at three places, shape (n, sleeves, 3, 8)."""
        found = [one.forces(lam[k]) for k, one in self._by_state()]
        return np.array(found).reshape(self._n, len(self._rows.closed.contacts), 3, 8)

    def forces(self, lam: Array, J: Array) -> Array:
        """Generalised forces J_Q' lam of the closures in expanded coordinates, shape (n, nV).

        Args:
            lam: Multipliers [N | N m], shape (n, rows).
            J: World Jacobians of the joints, shape (n, 6, nV).
        """
        force: Array = (lam[:, None] @ self.jacobian(J))[:, 0]
        return force

    def bias(self, V: Array, J: Array, dJ: Array, eta_rate: Array) -> Array:
        """Jdot V, shape (n, rows).

        Rows of sleeves add what follows from `eta_rate`, so that cdd = J A + J_eta eta_a + bias.

        Args:
            V: Shape (n, nV). J, dJ: World Jacobians and their rates, shape (n, 6, nV).
            eta_rate: Rates of the elastic coordinates, shape (n, n_eta).
        """
        r = self._rows
        twist_a, twist_b = (
            ((mask * V[:, None]) @ J.swapaxes(1, 2)).reshape(-1, 6)
            for mask in (r.support_a, r.support_b)
        )
        turned = (r.mask * V[:, None] @ dJ.swapaxes(1, 2)).reshape(-1, 6)
        return self._drift(twist_a, twist_b, turned, eta_rate).reshape(self._n, -1)

    def _drift(self, twist_a: Array, twist_b: Array, turned: Array, eta_rate: Array) -> Array:
        """`bias` from the world twists of A and B and their relative acceleration, (n loops, 6)."""
        r, relative = self._rows, twist_b - twist_a
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

        if len(r.point_rows):
            loop = r.point_loop
            u = self.frames_a[loop, :, r.point_axes]
            point(r.point_rows, loop, u, (spin_a[loop] @ u[:, :, None])[:, :, 0])
        if len(r.dot_rows):
            loop = r.dot_loop
            e_a = self.frames_a[loop, :, r.dot_a]
            e_b = self.frames_b[loop, :, r.dot_b]
            de_a = (spin_a[loop] @ e_a[:, :, None])[:, :, 0]
            de_b = (spin_b[loop] @ e_b[:, :, None])[:, :, 0]
            rate[r.dot_rows, 3:] = np.cross(de_b, e_a) + np.cross(e_b, de_a)
        if len(r.distance_rows):
            loop = r.distance_loop
            u = self.gap[loop] / r.lengths[:, None]
            du = (v_b - v_a)[loop] / r.lengths[:, None]
            point(r.distance_rows, loop, u, du)
        drift = np.zeros(len(rate))
        loops, count = len(r.closed.names), r.closed.n
        for i, one in self._by_state():
            k, at = one.loop + i * loops, one.rows + i * count
            rate[at], drift[at] = one.bias(
                spin_a[k], spin_b[k], (v_b - v_a)[k], swept[k], self.gap[k], eta_rate[i]
            )
        loop = r.loop_of
        total: Array = (rate * relative[loop]).sum(1) + (self.W * turned[loop]).sum(1)
        return total + drift

    def force_tangent(self, lam: Array, J: Array, times_map: Callable[[Array], Array]) -> Array:
        """Part of d(J' lam)/dy of one state that Pinocchio's derivatives miss.

        They hold local forces fixed. The closure force follows frame a in direction and frame b in
        its point of attack, so in the bodies' own frames it changes with their relative motion.

        Args:
            lam: Multipliers, shape (rows,). J: World Jacobian, shape (6, nV).
            times_map: D (k, nV) to D X (k, nv).
        Returns:
            Shape (nv, nv).
        """
        r, loops = self._rows, self._rows.loops
        on_b, on_a = both = np.zeros((2, loops, 6, 6))
        force = np.zeros((loops, 3))
        if r.points is not None:
            force = (r.of_loop * lam) @ self.W[:, :3]
        elif len(r.point_rows):
            np.add.at(force, r.point_loop, self.W[r.point_rows, :3] * lam[r.point_rows, None])
        if len(r.distance_rows):
            pull = self.W[r.distance_rows, :3] * lam[r.distance_rows, None]
            np.add.at(force, r.distance_loop, pull)
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
        for row, loop in zip(r.distance_rows, r.distance_loop, strict=True):
            k = lam[row] / r.lengths[list(r.distance_rows).index(row)]
            move = np.hstack([np.eye(3), -arm[loop]]) * k
            for side in (on_a, on_b):
                side[loop, :3] += move
                side[loop, 3:] += arm[loop] @ move
        if len(r.dot_rows):
            loop = r.dot_loop
            mu = lam[r.dot_rows, None, None]
            e_a = skew(self.frames_a[loop, :, r.dot_a])
            e_b = skew(self.frames_b[loop, :, r.dot_b])
            np.add.at(on_b[:, 3:, 3:], loop, mu * (e_b @ e_a))
            np.add.at(on_a[:, 3:, 3:], loop, mu * (e_a @ e_b))
        n = J.shape[1]
        supports = np.concatenate([r.support_b[:, None], r.support_a.reshape(loops, 1, n)])
        sides = times_map((J * supports).reshape(-1, n)).reshape(2, loops, 6, -1)
        apart, width = sides[0] - sides[1], sides.shape[3]
        np.negative(sides[1], out=sides[1])
        total: Array = sides.reshape(-1, width).T @ (both @ apart).reshape(-1, width)
        for one in self.contacts:
            one.add_tangent(total, lam, apart[one.loop])
        return total
