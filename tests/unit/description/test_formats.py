"""Robots of other formats: Gepetto robot.yaml, MJCF, SDF, xacro, a URDF alone; units.

Every file is our own and small. What it means is checked by closed forms, by Pinocchio's reader of
MJCF, and by MuJoCo where that is installed.

Claims:
    Equations
    - Gepetto robot.yaml, MJCF, SDF, xacro, URDF alone: loops, motors, types, springs, home; what is
      left out by its line | the files by hand | exact | exact
    - MJCF with defaults, frames, refs, offsets and masses by geoms: mass matrix and bias at a
      random pose are MuJoCo's | MuJoCo | 1e-12 | 3e-16
    - the same without frames and refs: mass matrix is that of Pinocchio's reader | Pinocchio |
      1e-12 | passes
    - closed four-bar with a spring from an MJCF: 0.2 s of free motion; accelerations at its
      equilibrium | MuJoCo, equalities made stiff | 1e-3 of the travel | 2e-6
    - an axis of an SDF in the frame of the model (`use_parent_model_frame`) | by hand | 1e-12 N m |
      exact
    - an SDF with all axes of universal joints in tree and loop, products of inertia, the rest of a
      spring | by hand | 1e-12 | exact
    - a spring of an SDF swings as sqrt(k / I); a rotor behind a gear is I n^2 | by hand | 1e-9;
      1e-12 | passes
    - "20 mm" and "3 deg" are 0.02 and pi / 60; a length for an angle is refused | - | 1e-12 | exact
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.description import sources
from pinflex.description.blocks.joints import Coupling
from pinflex.description.description import read
from pinflex.description.files import Source
from pinflex.description.robots.tree_text import rpy
from pinflex.errors import DescriptionError
from pinflex.rotations import zyx_matrix

EXACT = 1e-12  # relative: sums of a few products


def line(text: str, part: str) -> int:
    """Line of a text on which a part of it begins."""
    return text[: text.index(part)].count("\n") + 1


INERTIA = '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="2e-2" iyz="0" izz="2e-2"/>'
BAR = f'<inertial><origin xyz="0.2 0 0"/><mass value="1"/>{INERTIA}</inertial>'
# Two bars on the ground and one between them, whose far end is to meet the second one's.
GEPETTO = f"""<robot name="bars">
  <link name="base"/><link name="crank">{BAR}</link><link name="coupler">{BAR}</link>
  <link name="rocker">{BAR}</link><link name="end_a"/><link name="end_b"/>
  <joint name="motor" type="revolute"><parent link="base"/><child link="crank"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="1"/></joint>
  <joint name="ball" type="revolute"><parent link="crank"/><child link="coupler"/>
    <origin xyz="0.2 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="1"/>
  </joint>
  <joint name="cross" type="revolute"><parent link="base"/><child link="rocker"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="1"/>
  </joint>
  <joint name="tip_A" type="fixed"><parent link="coupler"/><child link="end_a"/>
    <origin xyz="0.4 0 0"/></joint>
  <joint name="tip_B" type="fixed"><parent link="rocker"/><child link="end_b"/>
    <origin xyz="0.3 0 0"/></joint>
</robot>
"""
ROBOT_YAML = """closed_loop: [[tip_A, tip_B]]
type: ['6d']
name_mot: [motor]
joint_name: [ball, cross]
joint_type: [SPHERICAL, UJOINT_ZY]
"""


def gepetto(folder: Path, text: str = ROBOT_YAML) -> Path:
    (folder / "robot.urdf").write_text(GEPETTO, "utf-8")
    path = folder / "robot.yaml"
    path.write_text(text, "utf-8")
    return path


def test_gepettos_yaml_says_loops_motors_and_types(tmp_path: Path) -> None:
    robot = read(gepetto(tmp_path))
    assert robot.actuated == ("motor",)
    (loop,) = robot.loops
    assert (loop.name, loop.kind, loop.frame_a, loop.frame_b) == ("tip", "weld", "end_a", "end_b")
    assert robot.joints["ball"].type == "spherical"
    assert robot.joints["cross"].axes == ((0, 0, 1), (0, 1, 0))
    m = pf.load(gepetto(tmp_path, ROBOT_YAML.replace("6d", "3d")))
    # motor, ball 3, cross 2, less the three equations of a point
    assert m.report.mobility + len(m.idle.names) == 6 - 3
    data = m.rigid.rigid.createData()
    pin.framesForwardKinematics(m.rigid.rigid, data, m.home)
    a, b = (data.oMf[m.rigid.rigid.getFrameId(name)].translation for name in ("end_a", "end_b"))
    assert np.abs(a - b).max() < 1e-12  # Newton's


def test_a_motor_that_follows_another_is_left_out_and_named(tmp_path: Path) -> None:
    """A robot.yaml lists each finger as a motor; by the URDF they move as one."""
    path = gepetto(tmp_path, ROBOT_YAML.replace("[motor]", "[motor, ball]").replace(
        "[ball, cross]", "[cross]").replace("[SPHERICAL, UJOINT_ZY]", "[UJOINT_ZY]"))  # fmt: skip
    urdf = tmp_path / "robot.urdf"
    tag = '<child link="coupler"/>'
    urdf.write_text(GEPETTO.replace(tag, f'{tag}<mimic joint="motor" multiplier="-2"/>'), "utf-8")
    robot = read(path)
    assert robot.actuated == ("motor",)
    assert [(c.joint, c.leader, c.ratio) for c in robot.couplings] == [("ball", "motor", -2.0)]
    (note,) = sources.find("robot.yaml", tmp_path, "urdf").notes
    assert "line 3: ball follows motor" in note


def test_a_yaml_may_change_and_take_away_what_the_file_says(tmp_path: Path) -> None:
    gepetto(tmp_path)
    path = tmp_path / "scene.yaml"
    path.write_text("urdf: robot.yaml\nloops: {tip: }\nactuated: [motor]\n", "utf-8")
    assert read(path).loops == ()
    path.write_text("urdf: robot.yaml\nloops: {tip: {kind: spherical}}\n", "utf-8")
    robot = read(path)
    assert [loop.kind for loop in robot.loops] == ["spherical"]
    assert robot.with_overrides(["limit=2"]).loops == robot.loops


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("'6d'", "5d", r"robot.yaml: type\[0\]: '5d' is not known. Did you mean \"6d\""),
        ("tip_B", "tip_C", r'no such frame in robot.urdf: "tip_C". Did you mean "tip_B"'),
        ("SPHERICAL", "BALL", r"joint_type\[0\]: 'BALL' is not known.*UJOINT_XY"),
        ("name_mot: [motor]", "name_mot: [motr]", 'no such joint in robot.urdf: "motr". Did you'),
        ("type: ['6d']", "type: ['6d', '3d']", r"robot.yaml: type: .* is not a list of 1"),
    ],
)
def test_a_wrong_robot_yaml_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(DescriptionError, match=words):
        read(gepetto(tmp_path, ROBOT_YAML.replace(old, new)))


def test_a_robot_yaml_without_its_urdf_says_so(tmp_path: Path) -> None:
    path = gepetto(tmp_path)
    (tmp_path / "robot.urdf").unlink()
    with pytest.raises(DescriptionError, match="same folder, which has none"):
        read(path)


# MJCF ----------------------------------------------------------------------------------------

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


# SDF -----------------------------------------------------------------------------------------

# A bar on the ground with a spring, a rotor behind a gear of 20, and a link that closes a loop.
SDF = """<sdf version="1.7"><model name="leg">
  <link name="base"/>
  <link name="thigh"><pose>0 0 1 0 1.5707963267948966 0</pose>
    <inertial><pose>0.2 0 0 0 0 0</pose><mass>2</mass>
      <inertia><ixx>0.001</ixx><iyy>0.03</iyy><izz>0.03</izz></inertia></inertial>
    <collision name="c"/></link>
  <link name="rotor"><pose>0 0 1 0 0 0</pose>
    <inertial><mass>0.1</mass><inertia><ixx>1e-5</ixx><iyy>2e-5</iyy><izz>1e-5</izz></inertia>
    </inertial></link>
  <link name="shin"><pose relative_to="thigh">0.4 0 0 0 0 0</pose>
    <inertial><pose>0.1 0 0 0 0 0</pose><mass>0.5</mass>
      <inertia><ixx>1e-4</ixx><iyy>4e-3</iyy><izz>4e-3</izz></inertia></inertial></link>
  <link name="strut"><pose relative_to="thigh">0.2 0 0.1 0 0 0</pose>
    <inertial><mass>0.2</mass><inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia>
    </inertial></link>
  <joint name="ground" type="fixed"><parent>world</parent><child>base</child></joint>
  <joint name="spin" type="revolute"><parent>base</parent><child>rotor</child>
    <axis><xyz>0 1 0</xyz></axis></joint>
  <joint name="hip" type="revolute"><parent>base</parent><child>thigh</child>
    <axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>1</upper><effort>50</effort></limit></axis>
  </joint>
  <joint name="gear" type="gearbox"><parent>rotor</parent><child>thigh</child>
    <gearbox_reference_body>base</gearbox_reference_body><gearbox_ratio>0.05</gearbox_ratio></joint>
  <joint name="knee" type="revolute"><parent>thigh</parent><child>shin</child>
    <axis><xyz expressed_in="__model__">0 2 0</xyz><dynamics><damping>0.1</damping>
      <friction>0.3</friction><spring_stiffness>80</spring_stiffness>
      <spring_reference>0</spring_reference></dynamics></axis>
  </joint>
  <joint name="slot" type="ball"><parent>thigh</parent><child>strut</child></joint>
  <joint name="foot" type="ball"><pose>0.3 0 -0.1 0 0 0</pose><parent>shin</parent>
    <child>strut</child></joint>
  <plugin name="driver" filename="x.so"/>
</model></sdf>
"""


def sdf(folder: Path, text: str = SDF) -> Path:
    path = folder / "leg.sdf"
    path.write_text(text, "utf-8")
    return path


def test_an_sdf_is_a_tree_with_the_further_joints_as_loops(tmp_path: Path) -> None:
    m = pf.load(sdf(tmp_path), ["frames=[shin, foot_a, foot_b]"])
    robot = m.description
    assert robot.base == "fixed"
    assert robot.actuated == ("hip",)
    (loop,) = robot.loops
    assert (loop.kind, loop.frame_a, loop.frame_b) == ("spherical", "foot_a", "foot_b")
    assert robot.joints["slot"].type == "spherical"
    knee = robot.joints["knee"]
    assert (knee.spring, knee.damper) == (80.0, 0.1)
    assert knee.friction is not None
    assert knee.friction.coulomb == 0.3
    # the rotor's moment about its axis, times the square of the gear
    assert robot.joints["hip"].rotor_inertia == pytest.approx(2e-5 * 20**2, rel=EXACT)
    said = " ".join(robot.notes)
    assert f'line {line(SDF, "<plugin")}: <plugin> of <model> "leg" is not taken over' in said
    assert f"line {line(SDF, '<collision')}: <collision> is not taken over, here and below" in said
    gear = line(SDF, 'type="gearbox"')
    assert f"line {gear}: the gearbox gear is rotor inertia 0.008" in said
    model, data = m.rigid.rigid, m.rigid.rigid.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    at = {name: data.oMf[model.getFrameId(name)] for name in ("shin", "foot_a", "foot_b")}
    np.testing.assert_allclose(at["shin"].translation, [0, 0, 0.6], atol=1e-15)
    assert at["foot_a"].isApprox(at["foot_b"], 1e-15)


def test_a_leaf_spring_of_an_sdf_swings_as_by_hand(tmp_path: Path) -> None:
    """sqrt(k / I) of the shin about the knee, the strut taken away; and gravity as a pendulum."""
    cut = SDF[: SDF.index('  <joint name="slot"')] + SDF[SDF.index("  <plugin") :]
    strut = cut[cut.index('  <link name="strut"') : cut.index('  <joint name="ground"')]
    robot = pf.load(sdf(tmp_path, cut.replace(strut, "")), ["gravity=[0, 0, 0]"])
    moment = 4e-3 + 0.5 * 0.1**2
    assert pf.modes(robot, count=1).frequencies[0] == pytest.approx(
        math.sqrt(80 / moment) / (2 * math.pi), rel=1e-9
    )


# A hand on a frame of an arm, all angles in degrees; its axis is written in that frame.
HAND = """<sdf version="1.9"><model name="reach">
  <link name="arm"><pose degrees="true">0 0 1 0 0 90</pose></link>
  <frame name="tool" attached_to="arm"><pose degrees="true">0.3 0 0 0 0 90</pose></frame>
  <link name="hand"><pose relative_to="tool" degrees="true">0.1 0 0 0 0 90</pose>
    <inertial><pose>0.2 0 0 0 0 0</pose><mass>2</mass></inertial></link>
  <joint name="ground" type="fixed"><parent>world</parent><child>arm</child></joint>
  <joint name="wrist" type="revolute"><parent>arm</parent><child>hand</child>
    <axis><xyz expressed_in="tool">1 0 0</xyz></axis></joint>
</model></sdf>
"""


def test_frames_degrees_and_axes_of_other_frames_of_an_sdf(tmp_path: Path) -> None:
    """By hand: the arm looks along y, the tool along -x, the hand along -y."""
    m = pf.load(sdf(tmp_path, HAND), ["frames=[hand]"])
    model, data = m.rigid.rigid, m.rigid.rigid.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    hand = data.oMf[model.getFrameId("hand")]
    np.testing.assert_allclose(hand.translation, [-0.1, 0.3, 1.0], atol=1e-15)
    np.testing.assert_allclose(hand.rotation[:, 0], [0, -1, 0], atol=1e-15)
    # 2 kg at (0, -0.2, 0) from a wrist that turns about -x: gravity pulls the hand back
    held = pf.solve(m, pf.hold(duration=0.1), level="rigid", samples=2)
    assert held.torque[0, 0] == pytest.approx(2 * 9.81 * 0.2, rel=1e-12)


# A pendulum whose frame is turned a quarter about z, in the words of before 1.7.
TURNED = """<sdf version="1.5"><model name="pendulum">
  <link name="base"/>
  <link name="bob"><pose>0 0 1 0 0 1.5707963267948966</pose>
    <inertial><pose>0.2 0 0 0 0 0</pose><mass>2</mass></inertial></link>
  <joint name="ground" type="fixed"><parent>world</parent><child>base</child></joint>
  <joint name="pin" type="revolute"><parent>base</parent><child>bob</child>
    <axis><xyz>1 0 0</xyz><use_parent_model_frame>FLAG</use_parent_model_frame></axis></joint>
</model></sdf>
"""


@pytest.mark.parametrize(("flag", "arm"), [("1", 0.2), ("true", 0.2), ("0", 0.0)])
def test_an_axis_in_the_frame_of_the_model(flag: str, arm: float, tmp_path: Path) -> None:
    """The bob, along y, hangs on the model's x with its whole arm, on its own x with none."""
    m = pf.load(sdf(tmp_path, TURNED.replace("FLAG", flag)))
    held = pf.solve(m, pf.hold(duration=0.1), level="rigid", samples=2)
    # by round-off of the torque of the whole arm
    assert held.torque[0, 0] == pytest.approx(2 * 9.81 * arm, abs=1e-12)


# Turned a quarter about z, with all axes of two kinds of joints, one in the tree and one in a loop.
CARDAN = """<sdf version="1.9"><model name="cardan">
  <link name="base"/>
  <link name="fork"><pose degrees="true">0 0 0 0 0 90</pose></link>
  <link name="shaft"><pose relative_to="fork">0.3 0 0 0 0 0</pose>
    <inertial><mass>2</mass><inertia><ixx>0.01</ixx><iyy>0.02</iyy><izz>0.025</izz>
      <ixy>1e-3</ixy><ixz>2e-3</ixz><iyz>3e-3</iyz></inertia></inertial></link>
  <joint name="ground" type="fixed"><parent>world</parent><child>base</child></joint>
  <joint name="cross" type="universal"><pose degrees="true">0 0 0 0 0 90</pose>
    <parent>base</parent><child>fork</child>
    <axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint>
  <joint name="screw" type="revolute"><parent>fork</parent><child>shaft</child>
    <axis><xyz>1 0 0</xyz><dynamics><spring_stiffness>5</spring_stiffness>
      <spring_reference>0.2</spring_reference></dynamics></axis></joint>
  <joint name="back" type="universal"><parent>base</parent><child>shaft</child>
    <axis><xyz expressed_in="__model__">1 0 0</xyz></axis>
    <axis2><xyz expressed_in="__model__">0 0.6 0.8</xyz></axis2></joint>
</model></sdf>
"""


def test_axes_products_of_inertia_and_rests_of_an_sdf(tmp_path: Path) -> None:
    """By hand: fork and shaft look along y of the model, so its x is their -y, and its y their x.

    Axes of a joint are in its own frame, which is turned once more by its pose in the fork.
    """
    sdf(tmp_path, CARDAN)
    yaml = tmp_path / "scene.yaml"
    yaml.write_text("urdf: leg.sdf\nactuated: []\n", "utf-8")
    robot = read(yaml)
    axes = robot.joints["cross"].axes
    np.testing.assert_allclose(axes, [[0, 1, 0], [-1, 0, 0]], atol=1e-15)
    (loop,) = robot.loops
    assert loop.kind == "universal"
    np.testing.assert_allclose([loop.axis, loop.axis_b], [[0, -1, 0], [0.6, 0, 0.8]], atol=1e-15)
    assert robot.joints["screw"].rest == 0.2
    model = pin.buildModelFromXML(robot.urdf_text)
    tensor = model.inertias[model.getJointId("screw")].inertia
    products = [tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    np.testing.assert_allclose(products, [1e-3, 2e-3, 3e-3], rtol=EXACT)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('type="fixed"', 'type="screw"', 'a joint of type "screw" cannot be taken over'),
        (
            "<child>shin</child>",
            "<child>shim</child>",
            'no such frame: "shim". Did you mean "shin"',
        ),
        ('relative_to="thigh">0.4', 'relative_to="tigh">0.4', 'no such frame: "tigh"'),
        ("<xyz>0 1 0</xyz></axis></joint>", "<xyz>0 0 0</xyz></axis></joint>", "has no direction"),
    ],
)
def test_a_wrong_sdf_is_refused_by_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = SDF.replace(old, new, 1)
    with pytest.raises(DescriptionError, match=f"leg.sdf, line .*: .*{words}"):
        read(sdf(tmp_path, text))


def test_deep_files_end_in_a_sentence(tmp_path: Path) -> None:
    """Elements in elements, and poses of poses: no RecursionError."""
    deep = "<a>" * 5000 + "</a>" * 5000
    yaml, inside = gepetto(tmp_path), '<link name="base">'
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(GEPETTO.replace('<link name="base"/>', f"{inside}{deep}</link>"), "utf-8")
    bottomless = SDF.replace('<link name="base"/>', f"{inside}{deep}</link>")
    for path in (yaml, urdf, sdf(tmp_path, bottomless)):
        with pytest.raises(DescriptionError, match="elements go more than 500 deep"):
            read(path)
    frames = "".join(
        f'<frame name="f{k}"><pose relative_to="f{k + 1}">0 0 0.001 0 0 0</pose></frame>'
        for k in range(2000)
    )
    last = (
        '<frame name="f2000"/><link name="arm"><pose relative_to="f0">0 0 -1 0 0 90</pose></link>'
    )
    text = re.sub(r'<link name="arm">.*</link>', frames + last, HAND, count=1)
    model = pin.buildModelFromXML(read(sdf(tmp_path, text)).urdf_text)
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    arm = data.oMf[model.getFrameId("arm")].translation
    np.testing.assert_allclose(arm, [0, 0, 1.0], atol=1e-12)  # 2000 roundings
    with pytest.raises(DescriptionError, match="the poses of f1999 go round"):
        read(
            sdf(
                tmp_path,
                text.replace('<frame name="f2000"/>', '<frame name="f2000" attached_to="f1999"/>'),
            )
        )


# Xacro, units ----------------------------------------------------------------------------------


def test_a_xacro_is_expanded_where_xacro_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("xacro")
    path = tmp_path / "arm.xacro"
    path.write_text(
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:property name="l" value="0.5"/><link name="base"/>'
        f'<link name="rod">{BAR}</link><joint name="j" type="continuous"><parent link="base"/>'
        '<child link="rod"/><origin xyz="${2*l} 0 0"/><axis xyz="0 0 1"/></joint></robot>'
    )
    robot = read(path)
    assert robot.actuated == ("j",)
    assert 'xyz="1.0 0 0"' in robot.urdf_text
    monkeypatch.setitem(__import__("sys").modules, "xacro", None)
    with pytest.raises(DescriptionError, match="the package xacro is not installed"):
        read(path)


UNITS = """urdf: robot.urdf
actuated: [motor, cross]
home: {motor: ANGLE, cross: 0.1}
joints: {ball: {spring: 5, rest: ANGLE}}
flexible: {rocker: {material: steel, section: {shape: circle, diameter: LENGTH}, length: 300 mm}}
motion: {kind: cycloid, joints: {motor: ANGLE}, duration: 1}
"""


def test_lengths_and_angles_may_have_their_unit(tmp_path: Path) -> None:
    gepetto(tmp_path)
    path = tmp_path / "scene.yaml"

    def of(angle: str, length: str) -> pf.Mechanism:
        path.write_text(UNITS.replace("ANGLE", angle).replace("LENGTH", length), "utf-8")
        return pf.load(path)

    written, plain = of("30 deg", "20 mm").description, of(str(math.pi / 6), "0.02").description
    assert written.flexible[0].section == plain.flexible[0].section
    assert written.flexible[0].length == 0.3
    assert written.home["motor"] == pytest.approx(math.pi / 6, rel=EXACT)
    assert written.joints["ball"].rest == pytest.approx(math.pi / 6, rel=EXACT)
    assert written.motion is not None
    assert written.motion["joints"]["motor"] == pytest.approx(math.pi / 6, rel=EXACT)
    for angle, length, words in (
        (
            "30 mm",
            "0.02",
            "rest: '30 mm' is not a number.*Units that may be written: rad, deg",
        ),
        ("30deg", "2 deg", "diameter: '2 deg' is not a number.*Units that may be written: m, cm"),
        ("30 grad", "0.02", "rest: '30 grad' is not a number"),
    ):
        with pytest.raises(DescriptionError, match=words):
            of(angle, length)


def test_the_blocks_of_a_file_lie_under_those_of_the_yaml() -> None:
    source = Source(
        "a", "", (), (), {}, {"pin": {"kind": "weld"}}, {"joints": {"a": {"spring": 1, "rest": 2}}}
    )
    found = source.joined({"joints": {"a": {"rest": None, "damper": 3}}, "actuated": ["a"]})
    assert found == {
        "joints": {"a": {"spring": 1, "damper": 3}},
        "actuated": ["a"],
        "loops": {"pin": {"kind": "weld"}},
    }
