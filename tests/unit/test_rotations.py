"""Rotation vectors, quaternions and Euler angles against those of scipy.

Claims:
    Pages, pictures, figures
    - rotation vectors, quaternions, Z-Y-X angles and their rates | scipy | 1e-12 near half a turn,
      else 1e-14; rates 1e-8 (differences) | passes
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pinflex.rotations import (
    euler_rates,
    quaternion,
    quaternion_vector,
    rotation_vector,
    zyx_angles,
    zyx_matrix,
)


def test_rotations_are_those_of_scipy_near_nothing_and_near_half_a_turn() -> None:
    rng = np.random.default_rng(1)
    axis = rng.normal(size=(200, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    for largest in (0.0, 1e-160, 1e-9, 1.0, 1.5, 3.1):
        vector = largest * rng.uniform(size=(200, 1)) * axis
        turn = Rotation.from_rotvec(vector)
        # 1e-12: near half a turn round-off of the matrix counts 1 / (pi - angle) times
        np.testing.assert_allclose(rotation_vector(turn.as_matrix()), vector, rtol=0, atol=1e-12)
        q = quaternion(vector)
        np.testing.assert_allclose(q, turn.as_quat(), rtol=0, atol=1e-15)
        np.testing.assert_allclose(quaternion_vector(q), vector, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(quaternion_vector(-q), vector, rtol=1e-14, atol=1e-14)


def test_zyx_angles_turn_about_the_moved_axes() -> None:
    angles = np.random.default_rng(2).uniform(-3, 3, size=(4, 5, 3))  # (rz, ry, rx)
    turn = Rotation.from_euler("ZYX", angles.reshape(-1, 3)).as_matrix()
    np.testing.assert_allclose(zyx_matrix(angles).reshape(-1, 3, 3), turn, atol=1e-15)


def test_zyx_angles_and_their_rates_are_those_of_the_matrix() -> None:
    angles, rates = np.random.default_rng(3).uniform(-1.5, 1.5, size=(2, 50, 3))
    R = Rotation.from_euler("ZYX", angles)
    found = zyx_angles(R.as_matrix().reshape(5, 10, 3, 3)).reshape(-1, 3)
    # 1e-14: within 0.07 rad of the pole, where round-off counts 1 / cos(ry) = 14 times
    np.testing.assert_allclose(found, angles, rtol=0, atol=1e-14)
    h = 1e-5  # central differences: h^2 of the third derivatives, about 1e-9
    before, after = (Rotation.from_euler("ZYX", angles + s * h * rates) for s in (-1, 1))
    omega = (after * before.inv()).as_rotvec() / (2 * h)
    swept = (euler_rates(angles) @ rates[:, :, None])[:, :, 0]
    np.testing.assert_allclose(swept, omega, rtol=0, atol=1e-8)
