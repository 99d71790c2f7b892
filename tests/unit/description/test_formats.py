"""Robots of other formats: Gepetto robot.yaml, xacro, a URDF alone; units.

Every file is our own and small. MJCF and SDF have files of tests beside this one.

Claims:
    Equations
    - Gepetto robot.yaml, MJCF, SDF, xacro, URDF alone: loops, motors, types, springs, home; what is
      left out by its line | the files by hand | exact | exact
    - "20 mm" and "3 deg" are 0.02 and pi / 60; a length for an angle is refused | - | 1e-12 | exact
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.description import sources
from pinflex.description.description import read
from pinflex.description.files import Source
from pinflex.errors import DescriptionError

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
