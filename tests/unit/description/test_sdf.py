"""Robots of SDF files, each our own and small, held against closed forms.

Claims:
    Equations
    - an axis of an SDF in the frame of the model (`use_parent_model_frame`) | by hand | 1e-12 N m |
      exact
    - an SDF with all axes of universal joints in tree and loop, products of inertia, the rest of a
      spring | by hand | 1e-12 | exact
    - a spring of an SDF swings as sqrt(k / I); a rotor behind a gear is I n^2 | by hand | 1e-9;
      1e-12 | passes
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.description.description import read
from pinflex.errors import DescriptionError
from tests.unit.description.test_formats import EXACT, GEPETTO, gepetto, line

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
