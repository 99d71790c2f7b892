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

# [p_a, p_b] @ LEVERS gives, row by row, [p_b - p_a | (p_b x (.))'], the 3x4 matrix of a closure.
_LEVERS = np.zeros((6, 3, 4))
_LEVERS[:3, :, 0], _LEVERS[3:, :, 0] = -np.eye(3), np.eye(3)
_LEVERS[3:, :, 1:] = SKEW.reshape(3, 3, 3).swapaxes(1, 2)
LEVERS = _LEVERS.reshape(6, 12)


def skew(p: Array) -> Array:
    """Matrices of p x (.), shape (n, 3, 3), for p of shape (n, 3)."""
    return np.asarray((p @ SKEW).reshape(-1, 3, 3))


class JointPoses:
    """Rotations and translations of all joints, read straight from Pinocchio's memory.

    Pinocchio keeps the poses of a `Data` in one block of 12 numbers each; one view of it spares a
    Python call per joint. The layout is checked once; if it ever changes, poses are copied.

    Attributes:
        direct: Whether they are read from there. block: All of them, shape (joints, 12).
    """

    def __init__(self, model: pin.Model, data: pin.Data) -> None:
        self._data, n = data, int(model.njoints)
        # Any pose in which all joints differ shows whether the view reads the right numbers.
        move = np.linspace(0.1, 0.2, model.nv)
        pin.forwardKinematics(model, data, pin.integrate(model, pin.neutral(model), move))
        first = data.oMi[0].rotation
        view = np.lib.stride_tricks.as_strided(first, (n, 12), (96, 8))
        self.direct = not first.flags.owndata and np.array_equal(view, self._copied())
        self.block: Array = view if self.direct else self._copied()
        # A rotation is stored column by column.
        self.rotation = np.lib.stride_tricks.as_strided(
            self.block, (n, 3, 3), (self.block.strides[0], 8, 24)
        )
        self.translation = self.block[:, 9:]

    def _copied(self) -> Array:
        return np.array(
            [np.concatenate([p.rotation.T.ravel(), p.translation]) for p in self._data.oMi]
        )

    def refresh(self) -> None:
        """Make the arrays current (nothing to do when they are views)."""
        if not self.direct:
            self.block[:] = self._copied()

    def current(self) -> Array:
        """The poses as they are now, shape (joints, 12): read, or copied, before the next call."""
        self.refresh()
        return self.block


def columns(jacobian: Array) -> Array:
    """A (6, nV) matrix, also where Pinocchio hands a single column over as a vector."""
    return jacobian if jacobian.ndim == 2 else jacobian.reshape(6, 1)


def as_matrices(poses: Array) -> Array:
    """Poses [R | p], shape (..., 3, 4), of poses (..., 12)."""
    columns_of = poses.reshape(*poses.shape[:-1], 4, 3)
    return np.ascontiguousarray(columns_of.swapaxes(-1, -2))


def local_wrench(poses: Array, wrench: Array) -> Array:
    """World wrenches about the origin (..., 6), in the joint frames of poses (..., 12) instead.

    Args:
        poses: Joint poses, shape (..., 12), see `JointPoses`.
        wrench: [force; moment about the world origin] in world axes (N, N m), shape (..., 6); it is
            overwritten.
    """
    turned = poses[..., :9].reshape(*poses.shape[:-1], 3, 3)  # columns first
    both = wrench.reshape(*wrench.shape[:-1], 2, 3)
    arm = (poses[..., 9:] @ SKEW).reshape(turned.shape)  # p x (.)
    both[..., 1, :] -= (arm @ both[..., 0, :, None])[..., 0]
    return np.asarray((both @ turned.swapaxes(-1, -2)).reshape(wrench.shape))


def support(model: pin.Model, joint: int) -> Array:
    """1 for the velocity rows that move a joint, else 0, shape (nV,).

    Args:
        model: Model of Pinocchio.
        joint: Number of the joint in it.
    """
    found = np.zeros(int(model.nv))
    for above in list(model.supports[joint])[1:]:  # the first is the world
        step = model.joints[above]
        found[step.idx_v : step.idx_v + step.nv] = 1.0
    return found
