"""Poses of joints as rows of twelve numbers, and cross products as matrices.

A pose is the three axes of the joint, one after the other, and then its origin, in the world [m].
"""

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


def as_matrices(poses: Array) -> Array:
    """Poses [R | p], shape (..., 3, 4), of poses (..., 12)."""
    columns_of = poses.reshape(*poses.shape[:-1], 4, 3)
    return np.ascontiguousarray(columns_of.swapaxes(-1, -2))


def support(model: pin.Model, joint: int) -> Array:
    """1 for the velocity rows that move a joint, else 0, shape (nV,)."""
    found, rows, counts = np.zeros(int(model.nv)), model.idx_vs, model.nvs
    while joint:  # 0 is the world
        found[rows[joint] : rows[joint] + counts[joint]] = 1.0
        joint = model.parents[joint]
    return found
