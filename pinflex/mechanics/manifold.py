"""Many poses moved at once, and the rates of their exponential coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.rotations import quaternion, quaternion_vector

if TYPE_CHECKING:
    from pinflex.mechanics.evaluation.equations import Equations


# Poses of joints as rows of twelve numbers, and cross products as matrices.
#
# A pose is the three axes of the joint, one after the other, and then its origin, in the world [m].

ACROSS = (1, 2, 5)  # v, w and the twist, of the rows of a section: what a sleeve holds
# p @ SKEW gives the 3x3 matrix of p x (.) for every row of p.
SKEW = np.array(
    [
        [[0, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[0, 0, 1], [0, 0, 0], [-1, 0, 0]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 0]],
    ],
    dtype=float,
).reshape(3, 9)


def skew(p: Array) -> Array:
    """Matrices of p x (.), shape (n, 3, 3), for p of shape (n, 3)."""
    return np.asarray((p @ SKEW).reshape(-1, 3, 3))


def as_matrices(poses: Array) -> Array:
    """Poses [R | p], shape (..., 3, 4), of poses (..., 12)."""
    columns_of = poses.reshape(*poses.shape[:-1], 4, 3)
    return np.ascontiguousarray(columns_of.swapaxes(-1, -2))


def support(model: pin.Model, joint: int) -> Array:
    """1 for the velocity rows that move a joint, else 0, shape (nV,)."""
    found, rows, counts = np.zeros(int(model.nv)), model.idx_vs, model.nvs
    parents = model.parents
    while joint:  # 0 is the world
        found[rows[joint] : rows[joint] + counts[joint]] = 1.0
        joint = parents[joint]
    return found


# p @ _TIMES gives the 4x4 matrix of a product from the left by each quaternion p.
_TIMES = np.array(
    [
        [[0, 0, 0, 1], [0, 0, -1, 0], [0, 1, 0, 0], [-1, 0, 0, 0]],
        [[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0, 0, 0], [0, -1, 0, 0]],
        [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]],
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    ],
    dtype=float,
).reshape(4, 16)

# Coordinates that add up; (cos, sin) of an angle; a unit quaternion; what Pinocchio must move.
_KINDS = ("plain", "circle", "sphere", "other")


class Manifold:
    """Poses y (+) move of a mechanism: plain joints, circles and spheres each side by side.

    Attributes:
        turning: Whether some joint turns in space, so that its rates are not those of its move.
    """

    def __init__(self, dynamics: Equations) -> None:
        self._dynamics = dynamics
        joints: dict[str, list[pin.JointModel]] = {kind: [] for kind in _KINDS}
        for joint in dynamics.system.rigid.joints[1:]:
            if joint.nv:
                joints[_kind(joint)].append(joint)
        self._easy = not joints["other"]
        self.turning = bool(joints["sphere"] or joints["other"])
        q, v = _rows(joints["plain"])
        eta = np.arange(dynamics.system.n_eta)  # which adds up too
        self._q = np.concatenate([q, dynamics.nq_rigid + eta])
        self._v = np.concatenate([v, dynamics.n_rigid + eta])
        self._circle_q, self._circle_v = _first_rows(joints["circle"])
        q, v = _first_rows(joints["sphere"])
        self._sphere_q, self._sphere_v = q[:, None] + np.arange(4), v[:, None] + np.arange(3)

    def retract(self, y: Array, moves: Array) -> Array:
        """Poses that moves lead to, shape (k, nq)."""
        d = self._dynamics
        if d.vector_space:
            return np.asarray(y + moves)
        if not self._easy:
            pairs = zip(np.broadcast_to(y, (len(moves), y.shape[-1])), moves, strict=True)
            return np.array([d.integrate(*pair) for pair in pairs]).reshape(-1, y.shape[-1])
        out = np.empty((len(moves), y.shape[-1]))
        out[:, self._q] = y.take(self._q, axis=-1) + moves.take(self._v, axis=1)
        if len(self._circle_q):
            angle, at = moves[:, self._circle_v], self._circle_q
            c, s = y[..., at], y[..., at + 1]
            grown = 0.5 * (3.0 - c * c - s * s)  # keeps (cos, sin) on the circle
            c, s, cos, sin = grown * c, grown * s, np.cos(angle), np.sin(angle)
            out[:, at], out[:, at + 1] = c * cos - s * sin, s * cos + c * sin
        if len(self._sphere_q):
            turned = quaternion(moves.take(self._sphere_v, axis=1))
            out[:, self._sphere_q] = _normal(_product(y.take(self._sphere_q, axis=-1), turned))
        return out

    def log(self, y0: Array, y1: Array) -> Array:
        """Moves that take poses y0 to y1, shape (k, nv)."""
        d = self._dynamics
        if d.vector_space:
            return y1 - y0
        if not self._easy:
            one_by_one = [d.difference(*pair) for pair in zip(y0, y1, strict=True)]
            return np.array(one_by_one).reshape(-1, d.system.nv)
        moves, at = np.zeros((len(y0), d.system.nv)), self._circle_q
        moves[:, self._v] = y1.take(self._q, axis=1) - y0.take(self._q, axis=1)
        if len(at):
            c, s, c1, s1 = y0[:, at], y0[:, at + 1], y1[:, at], y1[:, at + 1]
            moves[:, self._circle_v] = np.arctan2(c * s1 - s * c1, c * c1 + s * s1)
        if len(self._sphere_q):
            q0, q1 = y0[:, self._sphere_q], y1[:, self._sphere_q]
            moves[:, self._sphere_v] = quaternion_vector(_product(q0 * [-1.0, -1.0, -1.0, 1.0], q1))
        return moves

    def turn(self, y: Array, moves: Array, v: Array) -> Array:
        """Rates of the exponential coordinates less the velocities, shape (k, nv)."""
        d, turn = self._dynamics, np.zeros(v.shape)
        if self._easy:
            at = self._sphere_v
            turn[:, at] = _turning(moves.take(at, axis=1), v.take(at, axis=1))
            return turn
        n, model, q = d.n_rigid, d.system.rigid, y[: d.nq_rigid]
        rates = np.array([pin.dIntegrate(model, q, one[:n], pin.ARG1) for one in moves])
        turn[:, :n] = np.linalg.solve(rates, v[:, :n, None])[:, :, 0] - v[:, :n]
        return turn


def _kind(joint: pin.JointModel) -> str:
    """How a joint moves, one of `_KINDS`."""
    if joint.nq == joint.nv:
        return "plain"
    if joint.nq == 2 > joint.nv:
        return "circle"
    return "sphere" if joint.shortname() == "JointModelSpherical" else "other"


def _first_rows(joints: Sequence[pin.JointModel]) -> tuple[IntArray, IntArray]:
    """First row in q and in v of each joint."""
    rows = np.array([(j.idx_q, j.idx_v) for j in joints], dtype=np.intp).reshape(-1, 2)
    return rows[:, 0].copy(), rows[:, 1].copy()


def _rows(joints: Sequence[pin.JointModel]) -> tuple[IntArray, IntArray]:
    """Rows in q and in v of joints that have as many of one as of the other."""
    steps = [(j.idx_q + k, j.idx_v + k) for j in joints for k in range(j.nv)]
    q, v = np.array(steps, dtype=np.intp).reshape(-1, 2).T
    return np.ascontiguousarray(q), np.ascontiguousarray(v)


def _product(p: Array, q: Array) -> Array:
    """Quaternions p q, shape (..., 4), scalar last."""
    left = (p @ _TIMES).reshape(*p.shape[:-1], 4, 4)
    return np.asarray((left @ q[..., None])[..., 0])


def _turning(angle: Array, v: Array) -> Array:
    """Rates of rotation vectors (..., 3) less the velocities (..., 3) in the turned axes.

    Source: Bullo and Murray 1995, Proportional derivative control on the Euclidean group: the
    inverse of the right Jacobian of SO(3).
    """
    cross = skew(angle.reshape(-1, 3)).reshape(*angle.shape, 3)
    across = cross @ v[..., None]
    square = (angle * angle).sum(axis=-1, keepdims=True)
    half = 0.5 * np.sqrt(square)
    # 1/a^2 - 1/(2 a tan(a/2)), by its series where that loses digits.
    small = half < 1e-2
    safe = np.where(small, 1.0, half)
    part = np.where(
        small, 1.0 / 12.0 + square / 720.0, (1.0 - safe / np.tan(safe)) / (4.0 * safe * safe)
    )
    return np.asarray(0.5 * across[..., 0] + part * (cross @ across)[..., 0])


def _normal(q: Array) -> Array:
    """Quaternions kept on the sphere."""
    return np.asarray(q * (0.5 * (3.0 - np.sum(q * q, axis=-1, keepdims=True))))
