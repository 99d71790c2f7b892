"""Where joints are and how they move, at n configurations, by Pinocchio.

Poses are rows of twelve numbers, the three axes of the joint and then its origin, in the world;
Jacobians give the twist of a body at the world's origin by the velocity rows that move it.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array

_LARGE = 31  # velocity rows from which a workspace (4 nV^3 numbers) is dear beside a few looks


class Placing:
    """The joints of one model."""

    def __init__(self, model: pin.Model, joints: Iterable[int] = ()) -> None:
        """`joints`: those at leaves of the tree that are looked at."""
        self.model, self._joints = model, joints
        self._steps = [
            (joint, int(above), place)
            for joint, above, place in zip(
                model.joints, model.parents, model.jointPlacements, strict=True
            )
        ][1:]

    @cached_property
    def data(self) -> pin.Data:
        """Pinocchio's workspace, made when first needed: a large one takes half a second."""
        return pin.Data(self.model)

    @property
    def _dear(self) -> bool:
        return self.model.nv > _LARGE and "data" not in self.__dict__

    def poses(self, Q: Array) -> Array:
        """Poses (n, joints, 12) at Q (n, nQ)."""
        if self._dear:
            return self.jacobians(Q)[0]
        placed = []
        for q in Q:
            pin.forwardKinematics(self.model, self.data, q)
            placed.append([place.np for place in self.data.oMi])
        return _twelve(placed)

    def jacobians(self, Q: Array, joint: int | None = None) -> tuple[Array, Array]:
        """Poses (n, joints, 12) and world Jacobians (n, 6, nV) at Q (n, nQ).

        Of one joint alone poses are read in a tenth of the time; those of the others are NaN. So
        are, at several configurations of a large model, those of stations that carry nothing.
        """
        if self._dear:
            return self._bones.jacobians(Q) if len(Q) > 1 else self._step_by_step(Q[0])
        placed, J = [], np.empty((len(Q), 6, self.model.nv))
        for k, q in enumerate(Q):
            J[k] = _matrix(pin.computeJointJacobians(self.model, self.data, q))
            every = self.data.oMi if joint is None else (self.data.oMi[joint],)
            placed.append([place.np for place in every])
        if joint is None:
            return _twelve(placed), J
        poses = np.full((len(Q), self.model.njoints, 12), np.nan)
        poses[:, joint] = _twelve(placed)[:, 0]
        return poses, J

    @cached_property
    def _bones(self) -> _Bones:
        return _Bones(self.model, self._joints)

    def jacobian_rates(self, Q: Array, V: Array) -> Array:
        """Rates of the world Jacobians (n, 6, nV) at Q (n, nQ), V (n, nV)."""
        model, data = self.model, self.data
        rates = [
            np.array(_matrix(pin.computeJointJacobiansTimeVariation(model, data, q, v)))
            for q, v in zip(Q, V, strict=True)
        ]
        return np.array(rates).reshape(len(Q), 6, model.nv)

    def _step_by_step(self, q: Array) -> tuple[Array, Array]:
        """Poses (1, joints, 12) and Jacobian (1, 6, nV) without a workspace."""
        placed, J = [pin.SE3.Identity()], np.zeros((6, self.model.nv))
        for joint, above, place in self._steps:
            data = joint.createData()
            joint.calc(data, q)
            here = placed[above] * (place * data.M)
            placed.append(here)
            S = np.asarray(data.S, dtype=float).reshape(6, -1)
            J[:, joint.idx_v : joint.idx_v + joint.nv] = here.action @ S
        return _twelve([[place.np for place in placed]]), J[None]


class _Bones:
    """A large model without the stations that carry nothing: a small workspace does for it."""

    def __init__(self, model: pin.Model, joints: Iterable[int]) -> None:
        wanted, self._model, part = set(joints), model, pin.Model()
        here, q, v = {0: 0}, list[int](), list[int]()
        for j, joint in enumerate(model.joints):
            if j and (len(model.children[j]) or j in wanted):
                above = here[int(model.parents[j])]
                here[j] = part.addJoint(above, joint, model.jointPlacements[j], model.names[j])
                q += range(joint.idx_q, joint.idx_q + joint.nq)
                v += range(joint.idx_v, joint.idx_v + joint.nv)
        self._q, self._v, self._joints, self._placing = q, v, list(here), Placing(part)
        self._placing.data  # noqa: B018  (small: no look is dear)

    def jacobians(self, Q: Array) -> tuple[Array, Array]:
        """As `Placing.jacobians`; columns of what is left out are zero."""
        poses = np.full((len(Q), self._model.njoints, 12), np.nan)
        J = np.zeros((len(Q), 6, self._model.nv))
        poses[:, self._joints], J[:, :, self._v] = self._placing.jacobians(Q[:, self._q])
        return poses, J


def _twelve(placed: list[list[Array]]) -> Array:
    """Poses of n times k homogeneous matrices, shape (n, k, 12)."""
    columns = np.array(placed).reshape(len(placed), -1, 4, 4)[:, :, :3].swapaxes(2, 3)
    return columns.reshape(len(placed), -1, 12)


def _matrix(J: Array) -> Array:
    """A (6, nV) matrix, also where Pinocchio hands a single column over as a vector."""
    return J if J.ndim == 2 else J.reshape(6, 1)


def falling(model: pin.Model, poses: Array, J: Array) -> Array:
    """Generalised forces of a unit gravity along x, y, z, shape (3, nV).

    Of each row the mass beyond it, times how it moves its centre.
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
