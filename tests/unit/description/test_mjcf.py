"""Robots of MJCF files, each our own and small, held against MuJoCo and Pinocchio.

Claims:
    Equations
    - MJCF with defaults, frames, refs, offsets and masses by geoms: mass matrix and bias at a
      random pose are MuJoCo's | MuJoCo | 1e-12 | 3e-16
    - the same without frames and refs: mass matrix is that of Pinocchio's reader | Pinocchio |
      1e-12 | passes
    - closed four-bar with a spring from an MJCF: 0.2 s of free motion; accelerations at its
      equilibrium | MuJoCo, equalities made stiff | 1e-3 of the travel | 2e-6
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.description.blocks.joints import Coupling
from pinflex.description.description import read
from pinflex.description.robots.tree_text import rpy
from pinflex.errors import DescriptionError
from pinflex.rotations import zyx_matrix
from tests.unit.description.test_formats import EXACT, line

# Everything that a pose, a joint and a mass can be written with; degrees, defaults, a frame.
TREE = """<mujoco model="tree">
  <compiler eulerseq="zyx"/>
  <default>
    <joint armature="0.01" damping="0.2"/>
    <default class="thick"><geom size="0.03" density="2700"/>
      <default class="thicker"><joint axis="0 1 0"/><geom rgba="1 0 0 1"/></default></default>
  </default>
  <worldbody>
    <body name="arm" pos="0.1 0.2 0.3" euler="30 20 10">
      <joint name="yaw" pos="0.02 0.01 0" range="-90 90"/>
      <geom type="capsule" class="thick" fromto="0 0 0 0.4 0.1 0"/>
      <frame pos="0.4 0.1 0" axisangle="0 0 1 40">
        <body name="fore" xyaxes="0 1 0 -1 0 0.2" childclass="thicker">
          <joint name="pitch" ref="25"/>
          <joint name="push" type="slide" axis="1 0 0.5" ref="0.02" pos="0.1 0 0"/>
          <geom type="box" size="0.1 0.02 0.03" pos="0.1 0 0" quat="1 0.2 0 0.1"/>
          <geom type="cylinder" size="0.02 0.05" mass="0.3" zaxis="1 1 0"/>
          <body name="hand" pos="0.25 0 0">
            <inertial pos="0.01 0 0" mass="0.4" fullinertia="1e-3 2e-3 2.5e-3 1e-4 0 2e-4"/>
            <joint name="wrist" type="ball"/>
            <body name="tool" pos="0 0 0.1">
              <geom type="ellipsoid" size="0.02 0.03 0.04"/><geom size="0.02" pos="0 0.1 0"/>
            </body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
  <actuator><motor joint="yaw" gear="5"/><position joint="push" kp="10"/></actuator>
  <sensor><jointpos joint="yaw"/></sensor>
</mujoco>
"""


def test_poses_masses_and_joints_of_an_mjcf_are_mujocos(tmp_path: Path) -> None:
    """Mass matrix and bias at a random pose and speed; joint positions mean the same."""
    mujoco = pytest.importorskip("mujoco")
    path = tmp_path / "tree.xml"
    path.write_text(TREE, "utf-8")
    theirs = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(theirs)
    m = pf.load(path)
    model = m.rigid.rigid
    rng = np.random.default_rng(1)
    q, v, rows = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv, int)
    for j in range(theirs.njnt):
        joint = model.joints[model.getJointId(theirs.joint(j).name)]
        at, row = theirs.jnt_qposadr[j], theirs.jnt_dofadr[j]
        ball = joint.nv == 3
        value = rng.normal(size=4 if ball else 1)
        value /= np.linalg.norm(value) if ball else 1.0
        data.qpos[at : at + len(value)] = value
        circle = np.array([*np.cos(value), *np.sin(value)])[: joint.nq]
        place = value[[1, 2, 3, 0]] if ball else value if joint.nq == 1 else circle
        q[joint.idx_q : joint.idx_q + joint.nq] = place
        v[joint.idx_v : joint.idx_v + joint.nv] = speed = rng.normal(size=joint.nv)
        data.qvel[row : row + joint.nv] = speed
        rows[joint.idx_v : joint.idx_v + joint.nv] = range(row, row + joint.nv)
    mujoco.mj_forward(theirs, data)
    mass = np.zeros((theirs.nv, theirs.nv))
    if hasattr(data, "qM"):  # before MuJoCo 4
        mujoco.mj_fullM(theirs, mass, data.qM)
    else:
        mujoco.mj_fullM(theirs, data, mass)
    ours = pin.crba(model, model.createData(), q)
    ours = np.triu(ours) + np.triu(ours, 1).T
    np.testing.assert_allclose(ours, mass[np.ix_(rows, rows)], atol=EXACT * np.abs(mass).max())
    bias = pin.rnea(model, model.createData(), q, v, np.zeros(model.nv))
    np.testing.assert_allclose(bias, data.qfrc_bias[rows], atol=EXACT * np.abs(bias).max())
    # ranges are in degrees there
    assert m.description.urdf_text.count("1.5707963267948966") >= 2


def test_an_mjcf_is_the_one_that_pinocchio_reads(tmp_path: Path) -> None:
    """Where no `ref` moves the drawing; Pinocchio loses what stands in a <frame>, so none does."""
    path = tmp_path / "tree.xml"
    text = re.sub(r'</?frame[^>]*>| ref="[^"]*"| armature="0.01"', "", TREE)
    path.write_text(text, "utf-8")
    theirs = pin.buildModelFromMJCF(str(path))
    ours = pf.load(path).rigid.rigid
    assert ours.nv == theirs.nv
    q = [pin.neutral(model) for model in (ours, theirs)]
    a, b = (
        pin.crba(model, model.createData(), at) for model, at in zip((ours, theirs), q, strict=True)
    )
    assert np.abs(np.triu(a) - np.triu(b)).max() < EXACT * np.abs(a).max()


def test_what_an_mjcf_says_beside_its_tree(tmp_path: Path) -> None:
    path = tmp_path / "tree.xml"
    path.write_text(TREE, "utf-8")
    robot = read(path)
    assert robot.actuated == ("yaw", "push")
    assert robot.joints["wrist"].type == "spherical"
    assert robot.joints["wrist"].damper == 0.2
    assert robot.joints["yaw"].rotor_inertia == 0.01
    assert robot.home["pitch"] == pytest.approx(math.radians(25), rel=EXACT)
    said = " ".join(robot.notes)
    at = line(TREE, "<motor")
    for words in (
        f"the gears of line {at}",
        f"the control laws of line {at}",
        "sensors",
        "contacts",
    ):
        assert words in said


# A four-bar closed by <connect>; springs with a rest; a second pair of bars that follows the first.
BARS = """<mujoco model="bars">
  <compiler angle="radian" autolimits="false"/>
  <option gravity="0 -9.81 0"/>
  <default><geom type="capsule" size="0.01" density="2000" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="crank"><joint name="motor"/><geom fromto="0 0 0 0.2 0 0"/>
      <body name="coupler" pos="0.2 0 0"><joint name="knee" stiffness="3" springref="0.4"/>
        <geom fromto="0 0 0 0.25 0.15 0"/></body></body>
    <body name="rocker" pos="0.4 0 0"><joint name="heel" damping="0.01"/>
      <geom fromto="0 0 0 0.05 0.15 0"/></body>
    <body name="bar_1" pos="1 0 0"><joint name="lead" ref="0.1"/>
      <geom fromto="0 0 0 0.2 0 0"/></body>
    <body name="bar_2" pos="2 0 0"><joint name="follow"/><geom fromto="0 0 0 0.2 0 0"/></body>
  </worldbody>
  <equality>
    <connect name="pin" body1="coupler" body2="rocker" anchor="0.25 0.15 0"/>
    <joint joint1="follow" joint2="lead" polycoef="0.2 -0.5 0 0 0"/>
    <joint joint1="heel" joint2="motor" polycoef="0 1 2 0 0"/>
  </equality>
  <tendon><fixed name="both"><joint joint="lead" coef="1"/></fixed></tendon>
  <actuator><motor name="pull" tendon="both"/></actuator>
</mujoco>
"""


def bars(folder: Path, text: str = BARS) -> Path:
    path = folder / "bars.xml"
    path.write_text(text, "utf-8")
    return path


def test_equalities_springs_and_tendons_of_an_mjcf(tmp_path: Path) -> None:
    robot = read(bars(tmp_path))
    assert [(loop.name, loop.kind) for loop in robot.loops] == [("pin", "spherical")]
    assert (robot.joints["knee"].spring, robot.joints["knee"].rest) == (3.0, 0.4)
    assert robot.actuated == ("lead",)
    assert robot.gravity == (0.0, -9.81, 0.0)
    # follow = 0.2 - 0.5 (lead - 0.1)
    assert robot.couplings == (Coupling("follow", "lead", -0.5, 0.25),)
    said = " ".join(robot.notes)
    for words in ("the equalities joint_3, whose joints follow a curve", "the tendons both",
                  "the tendons that the actuators pull pull"):  # fmt: skip
        assert words in said
    assert robot.with_overrides(["limit=2"]).notes == robot.notes


def test_a_closed_chain_of_an_mjcf_moves_as_in_mujoco(tmp_path: Path) -> None:
    """0.2 s under gravity and a spring, nothing driven; MuJoCo's equality is made stiff.

    Its closure gives way by about dt^2 times the acceleration: 1e-3 of the travel is far above.
    """
    mujoco = pytest.importorskip("mujoco")
    both = BARS[: BARS.index('    <body name="bar_1"')] + "  </worldbody>" + """
      <equality><connect name="pin" body1="coupler" body2="rocker" anchor="0.25 0.15 0"/></equality>
      </mujoco>"""  # fmt: skip
    m = pf.load(bars(tmp_path, both), ["home={knee: 0}"])
    run = pf.solve(m, level="coupled", until=0.2, samples=11, tol=1e-4, start="straight")
    theirs = mujoco.MjModel.from_xml_path(str(tmp_path / "bars.xml"))
    theirs.opt.timestep = dt = 1e-4
    theirs.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    theirs.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)
    theirs.eq_solref[:], theirs.eq_solimp[:, :2] = [4 * dt, 1.0], 0.9999
    data = mujoco.MjData(theirs)
    rows = []
    for _ in range(11):
        rows.append(data.qpos.copy())
        for _ in range(round(0.02 / dt)):
            mujoco.mj_step(theirs, data)
    found = np.array(rows)
    names = [theirs.joint(k).name for k in range(theirs.njnt)]
    turns = [np.reshape(run.joint(name).position, (11, -1)) for name in names]
    ours = np.stack([np.unwrap(np.arctan2(x[:, 1], x[:, 0])) for x in turns], axis=1)
    travel = np.abs(found - found[0]).max()
    assert travel > 0.2
    assert np.abs(ours - found).max() < 1e-3 * travel
    # and where the spring holds it, MuJoCo accelerates it by 1e-3 of what it does at the start
    still = pf.solve(m, pf.hold(duration=0.1), level="quasistatic", samples=2)
    mujoco.mj_resetData(theirs, data)
    mujoco.mj_forward(theirs, data)
    moved = np.abs(data.qacc).max()
    turns = [np.reshape(still.joint(name).position, (2, -1))[0] for name in names]
    data.qpos[:] = [np.arctan2(x[1], x[0]) for x in turns]
    mujoco.mj_forward(theirs, data)
    assert np.abs(data.qacc).max() < 1e-3 * moved


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('body2="rocker"', 'body2="roker"', "unknown element 'roker'"),
        ('<geom fromto="0 0 0 0.05', '<geom class="x" fromto="0 0 0 0.05', "unknown default class"),
        (
            'fromto="0 0 0 0.2 0 0"/>',
            'fromto="0 0 0 0.2"/>',
            "attribute 'fromto' does not have enough data",
        ),
        ('name="motor"/>', 'name="motor" type="hinge2"/>', "invalid keyword: 'hinge2'"),
        ('joint name="heel"', 'joint name="knee"', "repeated name 'knee' in joint"),
    ],
)
def test_a_wrong_mjcf_is_refused_as_mujoco_says_it(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    text = BARS.replace(old, new, 1)
    with pytest.raises(DescriptionError, match=f"^bars.xml: MuJoCo: {words}.*, line "):
        read(bars(tmp_path, text))


def test_roll_pitch_yaw_are_exact_at_a_right_angle() -> None:
    for angles in ([0.3, math.pi / 2, 0.5], [0.3, 1.5708, -2.0], [1.0, -math.pi / 2, 0.2]):
        turned = zyx_matrix(np.array(angles)[::-1])
        assert np.abs(zyx_matrix(rpy(turned)[::-1]) - turned).max() < 1e-15 * 8  # a few roundings
