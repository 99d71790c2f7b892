"""Rotation matrices, rotation vectors, quaternions x y z w and Z-Y-X angles; all in rad."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pinflex.arrays import Array


def cross(a: Array, b: Array) -> Array:
    """a x b of vectors (..., 3): numpy's own moves axes about, at three times the cost."""
    (a0, a1, a2), (b0, b1, b2) = ((x[..., 0], x[..., 1], x[..., 2]) for x in (a, b))
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def rotation_vector(R: Array) -> Array:
    """Rotation vectors log(R), shape (..., 3), of rotation matrices (..., 3, 3)."""
    # component by component: numpy is slow along short last axes
    x, y, z = (0.5 * (R[..., i, j] - R[..., j, i]) for i, j in ((2, 1), (0, 2), (1, 0)))
    cosine = 0.5 * (R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2] - 1.0)
    if np.all(cosine > 0.0):
        size = np.sqrt(x * x + y * y + z * z)
        ratio = np.where(size > 0.0, np.arctan2(size, cosine) / np.maximum(size, 1e-300), 1.0)
        return np.stack([ratio * x, ratio * y, ratio * z], axis=-1)
    from scipy.spatial.transform import Rotation  # beyond a right angle it takes more care

    flat = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat.reshape(*R.shape[:-2], 3))


def axis_turn(axis: Array, angle: float) -> Array:
    """Rotation about an axis, shape (3, 3)."""
    x, y, z = axis / max(float(np.linalg.norm(axis)), 1e-300)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def zyx_matrix(angles: Array) -> Array:
    """Rz(rz) Ry(ry) Rx(rx), shape (..., 3, 3), of angles (rz, ry, rx), shape (..., 3)."""
    z, y, x = (angles[..., k] for k in range(3))
    cz, sz, cy, sy, cx, sx = np.cos(z), np.sin(z), np.cos(y), np.sin(y), np.cos(x), np.sin(x)
    rows = (
        (cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx),
        (sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx),
        (-sy, cy * sx, cy * cx),
    )
    R = np.empty((*angles.shape[:-1], 3, 3), angles.dtype)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            R[..., i, j] = entry
    return R


def zyx_angles(R: Array) -> Array:
    """Intrinsic angles (rz, ry, rx) of R = Rz Ry Rx, shape (..., 3), of rotations (..., 3, 3)."""
    rz = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    ry = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 0, 0], R[..., 1, 0]))
    return np.stack([rz, ry, np.arctan2(R[..., 2, 1], R[..., 2, 2])], axis=-1)


def euler_rates(angles: Array) -> Array:
    """B (n, 3, 3) in omega = B (rz, ry, rx)', columns the current axes, of angles (n, 3)."""
    z, y = angles[:, 0], angles[:, 1]
    cz, sz, cy, sy = np.cos(z), np.sin(z), np.cos(y), np.sin(y)
    none, one = np.zeros_like(cz), np.ones_like(cz)
    rows = [[none, -sz, cz * cy], [none, cz, sz * cy], [one, none, -sy]]
    return np.array(rows).transpose(2, 0, 1)


def quaternion(vector: Array) -> Array:
    """Quaternions (..., 4) of rotation vectors (..., 3)."""
    half = 0.5 * np.sqrt((vector * vector).sum(axis=-1, keepdims=True))
    out = np.empty((*vector.shape[:-1], 4))
    safe = np.maximum(half, 1e-150)  # below that sine and angle are the same
    out[..., :3] = (0.5 * np.sin(safe) / safe) * vector
    out[..., 3:] = np.cos(half)
    return out


def quaternion_vector(q: Array) -> Array:
    """The shorter rotation vectors (..., 3) of quaternions (..., 4)."""
    q = np.where(q[..., 3:] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    # Below the smallest number whose square is one, sine and angle are the same.
    ratio = np.where(
        sine < 1e-150, 2.0, 2.0 * np.arctan2(sine, q[..., 3:]) / np.maximum(sine, 1e-150)
    )
    return np.asarray(ratio * q[..., :3])


def axis_frame(z: Sequence[float] | None, x: Sequence[float] | None) -> Array:
    """A rotation whose z (or x) axis is the given one, the identity where it can be."""
    if z is None and x is None:
        return np.eye(3)
    return _axis_frame(2, tuple(z)) if z is not None else _axis_frame(0, tuple(x or ()))


@lru_cache(maxsize=256)
def _axis_frame(k: int, wish: tuple[float, ...]) -> Array:
    """A rotation, not to be changed, whose axis k is the given one."""
    axis = np.array(wish, float) / np.linalg.norm(np.array(wish, float))
    helper = np.eye(3)[(k + 1) % 3]
    if abs(axis @ helper) > 0.9:
        helper = np.eye(3)[(k + 2) % 3]
    second = helper - axis * (axis @ helper)
    second /= np.linalg.norm(second)
    columns = [np.zeros(3)] * 3
    columns[k] = axis
    if abs(helper[(k + 1) % 3]) > 0.5:
        columns[(k + 1) % 3] = second
        columns[(k + 2) % 3] = np.cross(axis, second)
    else:
        columns[(k + 2) % 3] = second
        columns[(k + 1) % 3] = np.cross(second, axis)
    found = np.column_stack(columns)
    found.setflags(write=False)
    return found
