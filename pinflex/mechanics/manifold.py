"""How joints move: their axes and rows, many poses moved at once, exponential coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.rotations import axis_turn, quaternion, quaternion_vector

if TYPE_CHECKING:
    from pinflex.mechanics.evaluation.equations import Equations


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


def support(model: pin.Model, joint: int) -> Array:
    """1 for the velocity rows that move a joint, else 0, shape (nV,)."""
    found, rows, counts = np.zeros(int(model.nv)), model.idx_vs, model.nvs
    parents = model.parents
    while joint:  # 0 is the world
        found[rows[joint] : rows[joint] + counts[joint]] = 1.0
        joint = parents[joint]
    return found


def twists_of(joint: pin.JointModel) -> Array:
    """Twists [v; w] in its own axes of a joint's velocities, which no pose changes, (6, nv)."""
    return np.asarray(joint.createData().S, dtype=float).reshape(6, -1)


def axis_of(joint: pin.JointModel) -> Array:
    """Direction about which a joint of one freedom turns, or along which it slides, (3,)."""
    v, w = twists_of(joint).reshape(2, 3)
    return w if w.any() else v


def bounded(joint: pin.JointModel) -> pin.JointModel:
    """The same joint with its angle for a coordinate."""
    return joint if joint.nq == joint.nv else pin.JointModelRevoluteUnaligned(axis_of(joint))


def pose_of(joint: pin.JointModel, twists: Array, q: Array) -> pin.SE3:
    """Pose of a joint with known twists in its place, at its own coordinates q (nq,)."""
    if len(q) == twists.shape[1]:
        return pin.exp6(twists @ q)
    if joint.nv == 1:
        return pin.exp6(twists @ np.arctan2(q[1:], q[:1]))
    if joint.shortname() == "JointModelPlanar":  # x, y, cos, sin
        return pin.SE3(axis_turn(np.eye(3)[2], np.arctan2(q[3], q[2])), np.array([*q[:2], 0.0]))
    return pin.XYZQUATToSE3(np.append(np.zeros(7 - len(q)), q))  # a ball's is a quaternion alone


def translations(model: pin.Model) -> Array:
    """1 for the velocity rows that are speeds, 0 for those that are rates of turn, shape (nv,)."""
    every = [twists_of(joint)[3:] for joint in model.joints.tolist()[1:]]
    size = np.abs(np.hstack([np.zeros((3, 0)), *every])).max(axis=0)
    return np.where(size > 0.0, 0.0, 1.0)


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


_SORTS = ("plain", "circle", "ball", "body")


def sorts_of(model: pin.Model) -> dict[str, IntArray]:
    """First places in q and v of joints by how they move, as `Stages` in source/stages.h has them.

    Every place of plain ones, which add up; circles are (cos, sin), balls quaternions; what is left
    are bodies, flat ones in a plane.
    """
    found: dict[str, list[int]] = {f"{sort}_{x}": [] for sort in _SORTS for x in "qv"}
    found["body_flat"] = []
    for joint in model.joints[1:]:
        sort, count = "plain", int(joint.nv)
        if joint.nq != joint.nv:
            name = joint.shortname()
            ball = "ball" if name == "JointModelSpherical" else "body"
            sort, count = "circle" if joint.nv == 1 else ball, 1
            found["body_flat"] += [name == "JointModelPlanar"] if sort == "body" else []
        found[f"{sort}_q"] += range(joint.idx_q, joint.idx_q + count)
        found[f"{sort}_v"] += range(joint.idx_v, joint.idx_v + count)
    return {name: np.array(places, dtype=np.intp) for name, places in found.items()}


class Manifold:
    """Poses y (+) move of a mechanism: plain joints, circles and spheres each side by side.

    Attributes:
        turning: Whether some joint turns in space, so that its rates are not those of its move.
    """

    def __init__(self, dynamics: Equations) -> None:
        self._dynamics, at = dynamics, sorts_of(dynamics.system.rigid)
        self._easy = not len(at["body_q"])
        self.turning = bool(len(at["ball_q"]) or len(at["body_q"]))
        eta = np.arange(dynamics.system.n_eta)  # which adds up too
        self._q = np.concatenate([at["plain_q"], dynamics.nq_rigid + eta])
        self._v = np.concatenate([at["plain_v"], dynamics.n_rigid + eta])
        self._circle_q, self._circle_v = at["circle_q"], at["circle_v"]
        self._sphere_q = at["ball_q"][:, None] + np.arange(4)
        self._sphere_v = at["ball_v"][:, None] + np.arange(3)

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
        n, model, q = d.n_rigid, d.system.rigid, y[: d.nq_rigid]
        rates = np.array([pin.dIntegrate(model, q, one[:n], pin.ARG1) for one in moves])
        turn[:, :n] = np.linalg.solve(rates, v[:, :n, None])[:, :, 0] - v[:, :n]
        return turn


def _product(p: Array, q: Array) -> Array:
    """Quaternions p q, shape (..., 4), scalar last."""
    left = (p @ _TIMES).reshape(*p.shape[:-1], 4, 4)
    return np.asarray((left @ q[..., None])[..., 0])


def _normal(q: Array) -> Array:
    """Quaternions kept on the sphere."""
    return np.asarray(q * (0.5 * (3.0 - np.sum(q * q, axis=-1, keepdims=True))))
