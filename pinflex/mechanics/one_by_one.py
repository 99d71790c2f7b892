"""Joints placed one by one, without a workspace: for a model that is looked at a few times.

A workspace of Pinocchio takes ten times as long to make as this takes to look once (`workspace`).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array


class OneByOne:
    """Poses and Jacobians of a model; the calls are those of `pinflex.mechanics.whole.Whole`."""

    def __init__(self, model: pin.Model) -> None:
        self.model, self._joints, self._nV = model, int(model.njoints), int(model.nv)
        steps = zip(model.joints, model.parents, model.jointPlacements, strict=True)
        self._steps = [(j, j.createData(), int(above), at) for j, above, at in steps][1:]
        self._last: tuple[Array, tuple[Array, Array]] | None = None

    def poses(self, Q: Array) -> Array:
        """Poses of the joints, see `JointPoses`, shape (n, joints, 12), at Q (n, nQ)."""
        return self.jacobians(Q)[0]

    def jacobians(self, Q: Array) -> tuple[Array, Array, Array]:
        """Poses (n, joints, 12), world Jacobians (n, 6, nV), and no rates.

        Args:
            Q: Coordinates, shape (n, nQ).
        """
        poses, J = (np.stack(x) for x in zip(*(self._at(q) for q in Q), strict=True))
        return poses, J, np.empty((0, 6, self._nV))

    def _at(self, q: Array) -> tuple[Array, Array]:
        """Poses (joints, 12) and Jacobians (6, nV) at one state: frame after frame is asked for."""
        if self._last is None or not np.array_equal(self._last[0], q):
            self._last = q.copy(), self._placed(q)
        return self._last[1]

    def _placed(self, q: Array) -> tuple[Array, Array]:
        poses, J = np.zeros((self._joints, 12)), np.zeros((6, self._nV))
        poses[0, :9:4] = 1.0  # of the base
        placed = [pin.SE3.Identity()]
        for number, (joint, data, above, at) in enumerate(self._steps, start=1):
            joint.calc(data, q)
            here = placed[above] * (at * data.M)
            placed.append(here)
            poses[number, :9] = here.rotation.T.ravel()
            poses[number, 9:] = here.translation
            S = np.asarray(data.S, dtype=float).reshape(6, -1)
            J[:, joint.idx_v : joint.idx_v + joint.nv] = here.action @ S
        return poses, J

    def falling(self, Q: Array) -> Array:
        """As `Whole.falling`."""
        poses, J, _ = self.jacobians(Q[None])
        return falling(self.model, poses[0], J[0])


def falling(model: pin.Model, poses: Array, J: Array) -> Array:
    """Generalised forces of a unit gravity along x, y, z, shape (3, nV).

    Of each row the mass beyond it, times how it moves its centre.

    Args:
        model: Model. poses: Of its joints, shape (joints, 12). J: In the world, shape (6, nV).
    """
    joints = int(model.njoints)
    mass, first = np.zeros(joints), np.zeros((joints, 3))
    for j in range(joints - 1, 0, -1):
        inertia, R = model.inertias[j], poses[j, :9].reshape(3, 3).T
        mass[j] += inertia.mass
        first[j] += inertia.mass * (R @ inertia.lever + poses[j, 9:])
        mass[model.parents[j]] += mass[j]
        first[model.parents[j]] += first[j]
    of = np.repeat(np.arange(joints), np.array(model.nvs))
    return np.asarray(mass[of] * J[:3] + np.cross(J[3:].T, first[of]).T)
