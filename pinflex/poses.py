"""Joint poses straight from Pinocchio's memory, and cross products as matrices."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array

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


class JointPoses:
    """Rotations and translations of all joints, read straight from Pinocchio's memory.

    Pinocchio keeps the poses of a `Data` in one block (12 numbers each); one strided view of it
    spares a Python call per joint. The layout is checked once; if it changes, poses are copied.
    """

    def __init__(self, model: pin.Model, data: pin.Data) -> None:
        self._data = data
        self.rotation = np.zeros((model.njoints, 3, 3))
        self.translation = np.zeros((model.njoints, 3))
        # Any pose in which all joints differ shows whether the view reads the right numbers.
        move = np.linspace(0.1, 0.2, model.nv)
        pin.forwardKinematics(model, data, pin.integrate(model, pin.neutral(model), move))
        rotation, translation = data.oMi[0].rotation, data.oMi[0].translation
        shape, n = np.lib.stride_tricks.as_strided, model.njoints
        views = (
            shape(rotation, (n, 3, 3), (96, *rotation.strides)),
            shape(translation, (n, 3), (96, *translation.strides)),
        )
        self._direct = not rotation.flags.owndata and all(
            np.array_equal(views[0][k], data.oMi[k].rotation)
            and np.array_equal(views[1][k], data.oMi[k].translation)
            for k in range(n)
        )
        if self._direct:
            self.rotation, self.translation = views

    def refresh(self) -> None:
        """Make the arrays current (nothing to do when they are views)."""
        if not self._direct:
            for k, pose in enumerate(self._data.oMi):
                self.rotation[k], self.translation[k] = pose.rotation, pose.translation


def columns(jacobian: Array) -> Array:
    """A (6, nV) matrix, also where Pinocchio hands a single column over as a vector."""
    return jacobian if jacobian.ndim == 2 else jacobian.reshape(6, 1)
