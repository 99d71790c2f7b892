"""Poses moved side by side are the poses moved one by one.

Claims:
    Levels, energy, steps
    - circles and spheres moved side by side = one by one, and back | 1e-14 | passes
    - coordinates that the caller writes are left alone | equal | passes
    - poses and Jacobians of a tree with joints of every kind, half a turn and nearly so too, seen
      joint by joint | Pinocchio | 1e-12 | 3e-14
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.reference.evaluator import Placing
from tests.scenes import Body, load

_BENDS = """
flexible:
  arm:
    material: steel
    section: {shape: circle, diameter: 0.01}
    end: tip
"""

_CIRCLE = """<robot name="circle"><link name="a"/><link name="b"/>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0.6 0.8"/></joint>
</robot>"""


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


@pytest.mark.parametrize("short", [0.0, 1e-12, 1e-8, 1e-4, 1.0])
def test_joints_seen_one_by_one_are_where_pinocchio_has_them(short: float) -> None:
    """A large tree, of which Pinocchio's workspace is not made; angles short of half a turn."""
    model, rng = pin.Model(), np.random.default_rng(5)
    axis = np.array([0.0, 0.6, 0.8])
    circle = pin.buildModelFromXML(_CIRCLE).joints[1]
    kinds = (
        pin.JointModelFreeFlyer(), pin.JointModelPlanar(), pin.JointModelSpherical(), circle,
        pin.JointModelRUBZ(), pin.JointModelRevoluteUnaligned(axis), pin.JointModelRX(),
        pin.JointModelPrismaticUnaligned(axis), pin.JointModelPY(), pin.JointModelTranslation(),
    )  # fmt: skip
    for k, kind in enumerate(kinds * 2):
        model.addJoint(k, kind, pin.SE3.Random(), f"joint {k}")
    move = np.pi * np.sign(rng.normal(size=model.nv)) - short
    move[3:6] /= np.sqrt(3.0)  # of a rotation vector
    Q = np.array([pin.integrate(model, pin.neutral(model), x) for x in (move, 0.1 * move)])
    seen, known = Placing(model), Placing(model)
    assert model.nv > 31 and known.data is not None  # made: the other way round
    for mine, theirs in zip(seen.jacobians(Q), known.jacobians(Q), strict=True):
        # round-off: a chain of twenty joints, each some metres from the next
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12)
    assert "data" not in vars(seen)
