"""Types of joints that the YAML writes over those of the URDF.

Claims:
    Equations
    - joint types over the URDF's: fixed = Pinocchio's reduced model (ur5), spherical and universal
      = its model with that joint | Pinocchio | 1e-12 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations

UR5 = "urdf: example-robot-data:ur5\n"


def load(folder: Path, text: str) -> pf.Mechanism:
    path = folder / "robot.yaml"
    path.write_text(UR5 + text, encoding="utf-8")
    return pf.load(path)


def test_a_fixed_joint_is_that_of_a_reduced_model(tmp_path: Path) -> None:
    """A UR5 with two joints locked against Pinocchio's own reduced model."""
    locked = ("shoulder_pan_joint", "wrist_1_joint")
    robot = load(tmp_path, f"joints: {{{', '.join(f'{x}: {{type: fixed}}' for x in locked)}}}\n")
    assert not {*locked} & {*robot.motors} and len(robot.motors) == 4
    full = pin.buildModelFromXML(robot.description.urdf_text)
    numbers = [full.getJointId(name) for name in locked]
    reduced = pin.buildReducedModel(full, numbers, pin.neutral(full))
    q, v, a = np.random.default_rng(0).normal(size=(3, 4))
    torque = pf.inverse_dynamics(robot, q[None], v[None], a[None])[0]
    expected = pin.rnea(reduced, reduced.createData(), q, v, a)
    assert torque == pytest.approx(expected, abs=1e-12)  # round-off of 100 N m


@pytest.mark.parametrize(("kind", "freedoms"), [("spherical", 3), ("universal", 2)])
def test_a_revolute_may_become_another_joint(tmp_path: Path, kind: str, freedoms: int) -> None:
    """Over a revolute, against a model of Pinocchio in which that joint is exchanged."""
    robot = load(tmp_path, f"joints: {{wrist_3_joint: {{type: {kind}}}}}\n")
    assert robot.rigid.nv == 5 + freedoms
    assert "wrist_3_joint" not in robot.motors
    model = pin.buildModelFromXML(robot.description.urdf_text)
    last = model.getJointId("wrist_3_joint")
    exchanged, at = pin.Model(), 0
    ball = pin.JointModelSpherical() if kind == "spherical" else pin.JointModelUniversal(
        np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    )  # fmt: skip
    for k in range(1, last + 1):
        joint = ball if k == last else model.joints[k]
        at = exchanged.addJoint(at, joint, model.jointPlacements[k], model.names[k])
        exchanged.appendBodyToJoint(at, model.inertias[k], pin.SE3.Identity())
    pin.seed(0)
    q = pin.randomConfiguration(exchanged, -np.ones(exchanged.nq), np.ones(exchanged.nq))
    expected = pin.crba(exchanged, exchanged.createData(), q)
    assert Equations(robot.rigid).mass(q) == pytest.approx(expected, abs=1e-12)  # round-off
