"""The closures as a search wants them: angles instead of their sines, everything in metres.

The rows of `pinflex.mechanics.closure` are sines of small angles, exact and cheap near a closed
pose; far from one a sine also vanishes at half a turn. Here the rotation of frame b against frame a

    TURNED (weld)          r = log(R_a' R_b)                    the rotation vector, |r| <= pi
    ALONG (revolute)       r = theta (n . x_a, n . y_a) ,       theta the angle from axis to axis
    one pair (universal)   r = asin(e_a . e_b)                  the angle short of a right one

is zero only where the frames fit. Points, distances and sleeves keep their rows. A rotation counts
as the path that it makes at the distance `length`, so that metres and radians weigh alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.loops import ALONG, TURNED, Pairs, loop_kind
from pinflex.mechanics.closure import LENGTHS, Closures

if TYPE_CHECKING:
    from pinflex.mechanics.equations import Equations

_STRAIGHT = 1e-9  # sine of the angle of two axes below which they count as one line


class LogClosure:
    """c and J of one system with rotations as angles, workspace included."""

    def __init__(self, dynamics: Equations, length: float) -> None:
        """`length` (m) weighs the rotations: the size of the mechanism."""
        self.dynamics, self.length = dynamics, length
        closed: Closures = dynamics.system.closed
        owner = closed.loop_of[closed.dot_rows]
        self._turns = [
            (k, kind, closed.dot_rows[owner == k])
            for k, kind in enumerate(closed.kinds)
            if np.any(owner == k)
        ]
        # -1 where two axes are to point against each other
        self.signs = np.ones(len(closed.names))

    def _frames(self, pose: Array) -> tuple[Array, Array]:
        """Rotations of the frames of the loops, (loops, 3, 3) each."""
        return _frames(self.dynamics.system.closed, self.dynamics.joint_poses(pose))

    def axes(self, pose: Array) -> Array:
        """Cosine of the angle of the two axes of each loop (1 where it has none), at a pose."""
        (a, b), closed = self._frames(pose), self.dynamics.system.closed
        cosines = (a[:, :, 2] * b[:, :, 2]).sum(axis=1)
        return np.where([_holds(kind) == ALONG for kind in closed.kinds], cosines, 1.0)

    def flipped(self, pose: Array) -> bool:
        """Whether the rows vanish, at a pose, with the frames of a loop turned by half a turn.

        A revolute joint can be that, as its pin may be put in from either side; `signs` says from
        which.
        """
        frames_a, frames_b = self._frames(pose)
        for k, kind in enumerate(self.dynamics.system.closed.kinds):
            if _holds(kind) == TURNED:
                turn = frames_a[k].T @ frames_b[k]
                if np.min(np.diag(turn)) < 0.5:
                    return True
        return bool(np.any(self.axes(pose) * self.signs < 0))

    def at(self, y: Array) -> tuple[Array, Array]:
        """Residual (m), shape (rows,), and its Jacobian, shape (rows, nv)."""
        d = self.dynamics
        at, closed, (c, J) = d.kinematics(y), d.system.closed, d.close(y)
        frames_a, frames_b = _frames(closed, at.poses)
        spin = at.J[0, 3:]
        for k, kind, rows in self._turns:
            a, b = frames_a[k], frames_b[k]
            relative = spin * closed.row_mask[rows[0]]
            if _holds(kind) == TURNED:
                R = a.T @ b
                c[rows] = pin.log3(R)
                J[rows] = np.asarray(pin.Jlog3(R)) @ (b.T @ relative)
            elif _holds(kind) == ALONG:
                c[rows], by_turn = _between(self.signs[k] * (a.T @ b[:, 2]))
                J[rows] = by_turn @ (a.T @ relative)
            else:
                sine = float(np.clip(c[rows[0]], -1.0, 1.0))
                J[rows] /= max(np.sqrt(1.0 - sine * sine), _STRAIGHT)
                c[rows] = np.arcsin(sine)
            c[rows] *= self.length
            J[rows] *= self.length
        return c, J

    def gaps(self, c: Array) -> tuple[Array, Array]:
        """How far each loop is open at a residual of `at`: m and rad, shape (loops,) each."""
        closed = self.dynamics.system.closed
        turned = np.zeros(closed.n, dtype=bool)
        turned[closed.dot_rows] = True
        apart, angles = (np.zeros(len(closed.names)) for _ in range(2))
        np.add.at(apart, closed.loop_of[~turned], c[~turned] ** 2)
        np.add.at(angles, closed.loop_of[turned], (c[turned] / self.length) ** 2)
        return np.sqrt(apart), np.sqrt(angles)


def _holds(kind: str) -> Pairs:
    """Directions that a kind of loop holds."""
    return loop_kind(kind).directions


def _between(z: Array) -> tuple[Array, Array]:
    """theta (z_x, z_y) / sin(theta) of a unit axis z seen from a, and its change with a turn."""
    sine = float(np.hypot(z[0], z[1]))
    turn = np.array([[0.0, z[2], -z[1]], [-z[2], 0.0, z[0]], [z[1], -z[0], 0.0]])  # dz = w x z
    if sine < _STRAIGHT:
        if z[2] > 0:
            return z[:2].copy(), turn[:2]
        return np.array([np.pi, 0.0]), np.zeros((2, 3))
    theta = float(np.arctan2(sine, z[2]))
    f = theta / sine
    outward = z[:2] / sine
    # d theta = -dz_z / sin(theta), d sin(theta) = outward . dz
    df = (-turn[2] / sine - f * (outward @ turn[:2])) / sine
    return f * z[:2], f * turn[:2] + np.outer(z[:2], df)


def _frames(closed: Closures, poses: Array) -> tuple[Array, Array]:
    """Rotations of the frames of the loops, (loops, 3, 3) each, at one state's joint poses."""
    frames_a, frames_b = np.split(closed.frames(poses)[0, :, :, :3], 2)
    return frames_a, frames_b


def size_of(dynamics: Equations, y: Array) -> float:
    """Size of a mechanism at y (nq,): the largest distance of two joints or frames, m."""
    poses = dynamics.joint_poses(y)
    frames = dynamics.system.closed.frames(poses)[0, :, :, 3]
    points = np.concatenate([poses[0, 1:, 9:], frames])
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    largest = float(np.max(apart, initial=0.0))
    return largest if largest > LENGTHS else 1.0


def translations(model: pin.Model) -> Array:
    """1 for the velocity rows that are speeds, 0 for those that are rates of turn, shape (nv,)."""
    found = np.zeros(int(model.nv))
    for joint in model.joints[1:]:
        kind = joint.shortname().removeprefix("JointModel")
        if kind.startswith("P") and kind != "Planar":
            found[joint.idx_v] = 1.0
        elif kind == "Planar":
            found[joint.idx_v : joint.idx_v + 2] = 1.0
        elif kind in ("FreeFlyer", "Translation"):
            found[joint.idx_v : joint.idx_v + 3] = 1.0
    return found
