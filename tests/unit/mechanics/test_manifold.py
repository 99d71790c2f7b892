"""Poses moved side by side are the poses moved one by one.

Claims:
    Levels, energy, steps
    - circles and spheres moved side by side = one by one, and back | 1e-14 | passes
    - coordinates that the caller writes are left alone | equal | passes
    Tolerances, collocation
    - rates of rotation vectors in closed form | Pinocchio | 1e-12 | 4e-14
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import Manifold
from tests.scenes import Body, load

_BENDS = """
flexible:
  arm:
    material: steel
    section: {shape: circle, diameter: 0.01}
    end: tip
"""


@pytest.mark.parametrize(
    ("first", "second", "circles"),
    [
        ("revolute", "continuous", "arm"),
        ("continuous", "fixed", "crank"),  # made spherical in the YAML
        ("continuous", "floating", "crank"),
    ],
)
def test_side_by_side_as_one_by_one(tmp_path: Path, first: str, second: str, circles: str) -> None:
    """Circles, plain joints and elastic coordinates together; a joint that turns in space."""
    bodies = (
        Body("crank", "base", first, mass=1, inertia=(1, 1, 1)),
        Body("arm", "crank", second, xyz=(0, 0, 1)),
        Body("tip", "arm", xyz=(1, 0, 0)),
    )
    ball = "joints:\n  arm_joint: {type: spherical}\n" if second == "fixed" else ""
    m = load(tmp_path, bodies, f"actuated: []\n{ball}{_BENDS}")
    d, rng = Equations(m.flexible), np.random.default_rng(7)
    moves = rng.normal(size=(5, m.flexible.nv))
    each = np.array([d.integrate(m.undeformed(), 0.3 * move) for move in moves])
    one_by_one = np.array([d.integrate(y, move) for y, move in zip(each, moves, strict=True)])
    # Round-off of sines and cosines.
    np.testing.assert_allclose(Manifold(d).retract(each, moves), one_by_one, atol=1e-14)
    from_one = np.array([d.integrate(each[0], move) for move in moves])
    np.testing.assert_allclose(Manifold(d).retract(each[0], moves), from_one, atol=1e-14)
    back = np.array([d.difference(y, y1) for y, y1 in zip(each, one_by_one, strict=True)])
    np.testing.assert_allclose(Manifold(d).log(each, one_by_one), back, atol=1e-14)
    none = Manifold(d).log(each, each)
    np.testing.assert_allclose(none, np.zeros_like(moves), atol=1e-15)
    for _ in range(100):
        each = Manifold(d).retract(each, moves)
    circle = m.flexible.rigid.joints[m.flexible.rigid.getJointId(f"{circles}_joint")].idx_q
    away = np.sum(each[:, circle : circle + 2] ** 2, axis=1) - 1.0
    assert np.abs(away).max() < 1e-13  # a hundred moves in a row stay on the circle


@pytest.mark.parametrize("angle", [1e-8, 1.9e-2, 2.1e-2, 1.0, 3.0])
def test_rates_of_a_rotation_vector_are_those_of_pinocchio(tmp_path: Path, angle: float) -> None:
    bodies = (
        Body("crank", "base", "continuous", mass=1, inertia=(1, 1, 1)),
        Body("arm", "crank", "fixed", xyz=(0, 0, 1)),  # made spherical in the YAML
        Body("tip", "arm", xyz=(1, 0, 0)),
    )
    m = load(tmp_path, bodies, f"actuated: []\njoints:\n  arm_joint: {{type: spherical}}\n{_BENDS}")
    d, rng = Equations(m.flexible), np.random.default_rng(3)
    moves, v = rng.normal(size=(2, 4, m.flexible.nv))
    ball = slice(1, 4)
    moves[:, ball] *= angle / np.linalg.norm(moves[:, ball], axis=1, keepdims=True)
    n, q = d.n_rigid, m.undeformed()[: d.nq_rigid]
    rates = np.array([pin.dIntegrate(d.system.rigid, q, one[:n], pin.ARG1) for one in moves])
    expected = np.linalg.solve(rates, v[:, :n, None])[:, :, 0] - v[:, :n]
    turn = Manifold(d).turn(m.undeformed(), moves, v)
    # Pinocchio's own series loses digits at small angles.
    np.testing.assert_allclose(turn[:, :n], expected, atol=1e-12)
    assert not turn[:, n:].any()
