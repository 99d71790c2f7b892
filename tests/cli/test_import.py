"""`pinflex import`, `new` and `schema`: what they write loads, and says its guesses.

Claims:
    Equations
    - what `import` writes loads as it is and runs at every level; guessed widths of a cylinder and
      a box | what is drawn | 1 % | 0.2 %
    - the shipped models are valid by the JSON Schema, slips are not; every key of models/README.md
      is in it | jsonschema | exact | exact
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import pinflex as pf
from pinflex.__main__ import main
from pinflex.description.description import json_schema
from pinflex.description.reading import yaml_text
from tests.unit.description.test_formats import INERTIA, gepetto
from tests.unit.description.test_mjcf import BARS

POINT = "closed_loop: [[tip_A, tip_B]]\ntype: [3d]\nname_mot: [motor]\n"

ROOT = Path(pf.__file__).resolve().parents[1]


def refused(capsys: pytest.CaptureFixture[str], words: str, *arguments: object) -> None:
    assert main([str(a) for a in arguments]) == 2
    assert words in capsys.readouterr().err


def test_an_imported_robot_loads_and_runs_as_it_is(tmp_path: Path) -> None:
    """Gepetto's pair of files: closed home, motors, one flexible link, a motion; every level."""
    source = gepetto(
        tmp_path, "closed_loop: [[tip_A, tip_B]]\ntype: [3d]\nname_mot: [motor]\nimu: 1\n"
    )
    out = tmp_path / "bars.yaml"
    assert main(["import", str(source), "-o", str(out), "--flexible", "coupler"]) == 0
    text = out.read_text("utf-8")
    assert "robot.yaml, line 4: `imu` is not taken over" in text
    assert "GUESS" in text
    robot = pf.load(out)
    assert set(robot.description.home) >= {"ball", "cross"}
    again = pf.load(out, ["flexible=null"])
    assert np.abs(again.home - pf.load(source).home).max() < 1e-8  # written with nine digits
    for level in ("rigid", "quasistatic", "coupled"):
        assert pf.solve(robot, level=level, samples=5, until=0.01).worst_closure < 1e-8


def test_without_a_wish_flexible_links_are_proposals(tmp_path: Path) -> None:
    out = tmp_path / "bars.yaml"
    assert main(["import", str(gepetto(tmp_path, POINT)), "-o", str(out)]) == 0
    text = out.read_text("utf-8")
    assert pf.load(out).description.flexible == ()
    # and load when their # is taken away
    start = text.index("# flexible:")
    stop = text.index("# A small motion") if "# A small motion" in text else len(text)
    block = re.sub(r"^# ?", "", text[start:stop], flags=re.M)
    out.write_text(text[:start] + block.split("\n\n")[0] + "\n", "utf-8")
    assert {part.link for part in pf.load(out).description.flexible} == {
        "coupler",
        "rocker",
        "crank",
    }


def test_an_imported_section_is_the_width_of_what_is_drawn(tmp_path: Path) -> None:
    for drawn, shape, widths in (
        ('<cylinder radius="0.03" length="0.5"/>', "tube", {"diameter": 0.06}),
        ('<box size="0.02 0.05 0.5"/>', "rectangle", {"width": 0.02, "thickness": 0.05}),
    ):
        path = tmp_path / f"{shape}.urdf"
        path.write_text(
            '<robot name="arm"><link name="base"/><link name="rod"><inertial><mass value="1"/>'
            f'<origin xyz="0.25 0 0"/>{INERTIA}</inertial><visual><geometry>{drawn}</geometry>'
            '<origin xyz="0.25 0 0" rpy="0 1.5707963267948966 0"/></visual></link><link name="tip">'
            f'<inertial><mass value="1"/>{INERTIA}</inertial></link><joint name="a" '
            'type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/></joint>'
            '<joint name="b" type="continuous"><parent link="rod"/><child link="tip"/>'
            '<origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint></robot>',
            "utf-8",
        )
        assert main(["new", str(path), "--flexible", "rod"]) == 0
        raw = yaml.safe_load(path.with_suffix(".yaml").read_text("utf-8"))
        section = raw["flexible"]["rod"]["section"]
        assert section["shape"] == shape
        for key, value in widths.items():  # a cylinder is drawn with 28 sides: 0.6 %
            assert section[key] == pytest.approx(value, rel=0.01)


def test_ends_that_coincide_are_proposed_as_loops(tmp_path: Path) -> None:
    link = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1e-3" ixy="0" ixz="0" ' + (
        'iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>'
    )
    joint = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>' + (
        '<origin xyz="{}" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>'
    )
    text = '<robot name="v"><link name="base"/>' + "".join(
        [link.format("a"), link.format("b"), '<link name="a_end"/><link name="b_end"/>',
         joint.format("ja", "continuous", "base", "a", "0 0 0"),
         joint.format("jb", "continuous", "base", "b", "0.6 0 0"),
         joint.format("fa", "fixed", "a", "a_end", "0.3 0.4 0"),
         joint.format("fb", "fixed", "b", "b_end", "-0.3 0.4 0")]
    )  # fmt: skip
    path = tmp_path / "v.urdf"
    path.write_text(text + "</robot>", "utf-8")
    assert main(["new", str(path)]) == 0
    written = (tmp_path / "v.yaml").read_text("utf-8")
    assert re.search(r"# +a_end_b_end: .*between: \[a_end, b_end\]\}  # drawn together", written)
    assert pf.load(tmp_path / "v.yaml").description.loops == ()
    pair = pf.load(path)  # a URDF alone
    assert pair.description.actuated == ("ja", "jb")


BAR = (
    '<link name="{name}"><inertial><origin xyz="{half} 0 0"/><mass value="{mass}"/><inertia '
    'ixx="1e-6" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<visual><origin xyz="{half} 0 0"/><geometry>'
    '<box size="{length} .02 .004"/></geometry></visual></link>'
)
HINGE = (
    '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
    '<axis xyz="0 0 1"/></joint>'
)


def five_bar() -> str:
    """Two open branches of aluminium bars of 20 x 4 mm, whose tips are to meet in a pin."""
    text = '<robot name="fivebar"><link name="base"/>'
    for side, x, crank, coupler in (("l", -0.09, 0.117, 0.214), ("r", 0.09, 0.093, 0.187)):
        for name, length in ((f"crank_{side}", crank), (f"coupler_{side}", coupler)):
            mass = 2700 * length * 0.02 * 0.004
            text += BAR.format(name=name, length=length, half=length / 2, mass=mass)
        text += f'<link name="tip_{side}"/>' + "".join(
            (HINGE.format(f"motor_{side}", "continuous", "base", f"crank_{side}", x),
             HINGE.format(f"elbow_{side}", "continuous", f"crank_{side}", f"coupler_{side}", crank),
             HINGE.format(f"end_{side}", "fixed", f"coupler_{side}", f"tip_{side}", coupler))
        )  # fmt: skip
    return text + "</robot>"


@pytest.mark.parametrize(("crank", "said"), [
    ("drive", "actuated: [drive]  # mobility 1 with these loops"),
    ("driven_pin", "actuated: [...]  # mobility 1 with these loops: name 1 joint with a motor"),
])  # fmt: skip
def test_a_four_bar_has_one_motor_by_its_name_or_asks_for_one(
    crank: str, said: str, tmp_path: Path
) -> None:
    """Four links and four pins leave 3 (4 - 1) - 2 * 4 freedoms."""
    text = '<robot name="fourbar"><link name="base"/>'
    for name, length in (("crank", 0.1), ("rod", 0.4), ("rocker", 0.3)):
        text += BAR.format(name=name, length=length, half=length / 2, mass=0.1)
    text += '<link name="tip_a"/><link name="tip_b"/>' + "".join((
        HINGE.format(crank, "continuous", "base", "crank", 0),
        HINGE.format("pin_a", "continuous", "crank", "rod", 0.1),
        HINGE.format("pin_b", "continuous", "base", "rocker", 0.35),
        HINGE.format("end_a", "fixed", "rod", "tip_a", 0.4),
        HINGE.format("end_b", "fixed", "rocker", "tip_b", 0.3),
    ))  # fmt: skip
    path = tmp_path / "fourbar.urdf"
    path.write_text(text + "</robot>", "utf-8")
    assert main(["new", str(path)]) == 0
    assert f"# {said}\n" in path.with_suffix(".yaml").read_text("utf-8")


def test_open_branches_are_proposed_as_a_closed_robot(tmp_path: Path) -> None:
    """Couplers that end in bare frames are candidates; the tips meet in a pin, drawn apart."""
    path = tmp_path / "fivebar.urdf"
    path.write_text(five_bar(), "utf-8")
    assert main(["new", str(path)]) == 0
    out = path.with_suffix(".yaml")
    raw = yaml.safe_load(out.read_text("utf-8"))
    assert raw["platform"] in ("tip_l", "tip_r")
    assert "loops" not in raw
    bare = re.sub(
        r"^# (loops:|actuated:|flexible:|  \w+: \{)", r"\1", out.read_text("utf-8"), flags=re.M
    )
    out.write_text(bare, "utf-8")
    raw = yaml.safe_load(bare)
    assert raw["loops"]["tip_l_tip_r"]["kind"] == "revolute"
    assert raw["actuated"] == ["motor_l", "motor_r"]
    assert {*raw["flexible"]} == {
        f"{part}_{side}" for part in ("crank", "coupler") for side in "lr"
    }
    for link in raw["flexible"].values():  # solid, since it weighs what a solid bar does
        assert link["material"] == "aluminium"
        widths = sorted(link["section"][key] for key in ("width", "thickness"))
        assert widths == pytest.approx([0.004, 0.02])
    robot = pf.load(out)
    assert robot.report.mobility == 3 * (5 - 1) - 2 * 5  # Gruebler: five links, five pins
    assert pf.solve(robot, level="rigid", samples=5).worst_closure < 1e-8  # it runs as proposed


SLIDER = (
    '<joint name="{}" type="prismatic"><parent link="{}"/><child link="{}"/>'
    '<origin xyz="0.15 0 0"/><axis xyz="1 0 0"/>'
    '<limit lower="-.1" upper=".1" effort="100" velocity="1"/></joint>'
)


def two_legs() -> str:
    """A triangle whose two sides turn about the base and lengthen; both tips are drawn together."""
    text = '<robot name="legs"><link name="base"/>'
    for side, x, turn in (("l", 0, 0.9273), ("r", 0.6, math.pi - 0.9273)):  # sides 3, 4, 5
        hinge = HINGE.format(f"pin_{side}", "continuous", "base", f"case_{side}", x)
        text += hinge.replace('0 0"/><axis', f'0 0" rpy="0 0 {turn}"/><axis')
        for part in ("case", "rod"):
            text += BAR.format(name=f"{part}_{side}", length=0.35, half=0.175, mass=0.2)
        text += SLIDER.format(f"leg_{side}", f"case_{side}", f"rod_{side}")
        text += f'<link name="tip_{side}"/>'
        text += HINGE.format(f"end_{side}", "fixed", f"rod_{side}", f"tip_{side}", 0.35)
    return text + "</robot>"


@pytest.mark.parametrize(
    ("robot", "motors"),
    [(two_legs(), "leg_l, leg_r"), (five_bar().replace("motor_", "pin_"), "pin_l, pin_r")],
    ids=["sliders", "on the base"],
)
def test_motors_without_such_names_are_as_many_as_the_freedoms(
    tmp_path: Path, robot: str, motors: str
) -> None:
    """Joints that slide, else those on the base: two of them, and Gruebler leaves two freedoms."""
    path = tmp_path / "robot.urdf"
    path.write_text(robot, "utf-8")
    assert main(["new", str(path)]) == 0
    written = path.with_suffix(".yaml").read_text("utf-8")
    assert f"# actuated: [{motors}]  # mobility 2 with these loops\n" in written


def test_a_ball_is_proposed_where_its_name_says_it_and_the_freedoms_need_it(
    tmp_path: Path,
) -> None:
    """A crank, a rod between two balls, one drawn as a hinge, and a plate; five decimals."""
    one = '<inertial><origin xyz="0.15 0.1 0.05"/><mass value="1"/><inertia ixx="1e-2" ixy="0" '
    one += 'ixz="0" iyy="1e-2" iyz="0" izz="1e-2"/></inertial>'  # the rod's on its own line
    text = '<robot name="rssr"><link name="base"/><link name="tip"/><link name="socket"/>'
    text += "".join(f'<link name="{name}">{one}</link>' for name in ("crank", "rod", "plate"))
    for name, kind, parent, child, xyz, axis in (
        ("motor", "continuous", "base", "crank", "0 0 0", "0 0 1"),
        ("ball", "continuous", "crank", "rod", "0.1 0 0", "0 0 1"),
        ("end", "fixed", "rod", "tip", "0.3 0.2 0.1", "0 0 1"),
        ("pin", "continuous", "base", "plate", "0.4 0 0", "1 0 0"),
        ("seat", "fixed", "plate", "socket", "0.00001 0.2 0.1", "0 0 1"),
    ):
        text += f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        text += f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/></joint>'
    (tmp_path / "rssr.urdf").write_text(text + "</robot>", "utf-8")
    out = tmp_path / "rssr.yaml"
    assert main(["new", str(tmp_path / "rssr.urdf"), "-o", str(out)]) == 0
    made = out.read_text("utf-8")
    taken = re.sub(r"^# (loops:|joints:|actuated:|  .*# drawn)", r"\1", made, flags=re.M)
    assert "# joints: {ball: {type: spherical}}" in made and "1e-05 m apart" in made
    out.write_text(taken, "utf-8")
    robot = pf.load(out)
    assert robot.motors == ("motor",) and robot.report.mobility == 1
    assert pf.solve(robot, level="rigid", samples=5).worst_closure < 1e-9


def test_the_tip_of_an_arm_is_its_platform_and_a_bent_root_is_none(tmp_path: Path) -> None:
    """A blade with a frame `tip1`: the blade was proposed, whose frame does not bend with it."""
    path = tmp_path / "rotor.urdf"
    path.write_text(
        '<robot name="rotor"><link name="tower"/><link name="blade1"><inertial>'
        '<origin xyz="5 0 0"/><mass value="100"/><inertia ixx="1" ixy="0" ixz="0" iyy="833" '
        'iyz="0" izz="833"/></inertial></link><link name="tip1"/><joint name="spin" '
        'type="continuous"><parent link="tower"/><child link="blade1"/><axis xyz="0 0 1"/></joint>'
        '<joint name="f" '
        'type="fixed"><parent link="blade1"/><child link="tip1"/><origin xyz="10 0 0"/></joint>'
        "</robot>"
    )
    assert main(["new", str(path), "--flexible", "blade1"]) == 0
    scene = path.with_suffix(".yaml")
    assert yaml.safe_load(scene.read_text("utf-8"))["platform"] == "tip1"

    def said(*overrides: str) -> list[str]:
        return [w for w in pf.check(pf.load(scene, overrides)).warnings if "far end" in w]

    assert said() == []
    (warning,) = said("platform=blade1")
    assert "platform: blade1 is the frame at the root" in warning
    assert "(tip1)" in warning


JOINT = (
    '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-2" upper="{}" effort="900" velocity="{}"/></joint>'
)


def bar(name: str, length: float, mass: float, sides: tuple[float, float], drawn: bool) -> str:
    """A box of uniform density along x."""
    one = np.array([length, *sides])
    x, y, z = mass * (one @ one - one**2) / 12
    look = f'<box size="{length} {sides[0]} {sides[1]}"/></geometry></visual>'
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>'
        + f'<visual><origin xyz="{length / 2} 0 0"/><geometry>{look}' * drawn
        + "</link>"
    )


def guessed(path: Path, urdf: str) -> tuple[dict[str, Any], pf.Mechanism]:
    """What `new` writes, without the # of its flexible links, and the robot."""
    path.write_text(f'<robot name="r"><link name="base"/>{urdf}</robot>', "utf-8")
    assert main(["new", str(path), "--force"]) == 0
    out = path.with_suffix(".yaml")
    text = re.sub(r"^# (flexible:|  \w+: \{.*section)", r"\1", out.read_text("utf-8"), flags=re.M)
    out.write_text(text, "utf-8")
    return yaml.safe_load(text), pf.load(out)


def test_an_end_beyond_a_head_is_the_platform_and_the_first_motion_keeps_limits(
    tmp_path: Path,
) -> None:
    """A head of a machine tool and a slewing ring are neither a sensor nor a finger."""
    urdf = bar("slewing_ring", 0.1, 5, (0.1, 0.1), True) + bar("boom", 1, 9, (0.1, 0.1), True)
    urdf += bar("head", 0.2, 6, (0.1, 0.1), True) + '<link name="spindle"/>'
    urdf += JOINT.format("turn", "revolute", "base", "slewing_ring", 0, 0, 0.1)
    urdf += JOINT.format("lift", "revolute", "slewing_ring", "boom", 0.1, 1, 1)
    urdf += JOINT.format("tilt", "revolute", "boom", "head", 1, 1, 1)
    urdf += JOINT.format("f", "fixed", "head", "spindle", 0.2, 0, 0)
    raw, robot = guessed(tmp_path / "mill.urdf", urdf)
    assert raw["platform"] == "spindle"
    # a cycloid's largest speed is 2 d / T; the other way, as the joint stands at its upper limit
    assert raw["motion"] == {"kind": "cycloid", "joints": {"turn": -0.1}, "duration": 2}
    assert not [w for w in pf.check(robot).warnings if w.startswith("motion")]


def test_a_camera_that_motors_turn_is_the_end_of_a_crane(tmp_path: Path) -> None:
    """Its pan would take 900 N m at .5 s, half of which motors may be asked for; a mesh is missing.

    The peak torque of a cycloid about a still axis is 2 pi D I / T^2.
    """
    urdf = bar("boom", 4, 30, (0.1, 0.1), True) + bar("camera_body", 0.2, 9, (0.1, 0.1), False)
    urdf = urdf.replace(
        '<link name="camera_body">', '<link name="camera_body"><visual><geometry>'
        '<mesh filename="package://crane/camera.stl"/></geometry></visual>',
    )  # fmt: skip
    urdf += '<link name="lens"/>' + JOINT.format("pan", "revolute", "base", "boom", 0, 1, 1)
    urdf += JOINT.format("tilt", "revolute", "boom", "camera_body", 4, 1, 1)
    urdf += JOINT.format("f", "fixed", "camera_body", "lens", 0.2, 1, 1)
    raw, robot = guessed(tmp_path / "crane.urdf", urdf)
    assert raw["platform"] == "lens"
    assert "mesh not found: package://crane/camera.stl" in (tmp_path / "crane.yaml").read_text()
    seconds = raw["motion"]["duration"]
    peak = np.abs(pf.solve(robot, level="rigid", samples=201).torque).max()
    about = 30 * 4**2 / 3 + 9 * 4.1**2  # and the small ones about their own centres: 1 %
    assert peak == pytest.approx(2 * np.pi * 0.1 * about / seconds**2, rel=0.01)
    assert peak < 450 < 4 * peak


def test_a_link_drawn_elsewhere_than_along_its_span_is_no_beam(tmp_path: Path) -> None:
    """A trolley of a gantry: its mast slides from a point that a file puts anywhere on the line."""
    urdf = bar("trolley", 0.1, 6, (0.2, 0.2), True) + bar("mast", 0.8, 5, (0.06, 0.06), True)
    urdf += '<link name="nozzle"/>' + JOINT.format("y", "revolute", "base", "trolley", 0, 1, 1)
    urdf += JOINT.format("z", "revolute", "trolley", "mast", 0.9, 1, 1)
    urdf += JOINT.format("f", "fixed", "mast", "nozzle", 0.8, 1, 1)
    raw, _ = guessed(tmp_path / "gantry.urdf", urdf)
    assert [*raw["flexible"]] == ["mast"]


def test_flexible_links_that_are_bolted_together_do_not_overlap(tmp_path: Path) -> None:
    urdf = bar("boom", 1, 8, (0.06, 0.06), True) + bar("extension", 0.8, 4, (0.05, 0.05), True)
    urdf += bar("jib", 0.5, 2, (0.04, 0.04), True) + '<link name="tool0"/>'
    urdf += JOINT.format("lift", "revolute", "base", "boom", 0, 1, 1)
    urdf += JOINT.format("bolt", "fixed", "boom", "extension", 1, 1, 1)
    urdf += JOINT.format("elbow", "revolute", "extension", "jib", 0.8, 1, 1)
    urdf += JOINT.format("f", "fixed", "jib", "tool0", 0.5, 1, 1)
    raw, robot = guessed(tmp_path / "crane.urdf", urdf)
    assert raw["flexible"]["boom"]["end"] == "extension"
    assert {n: part.length for n, part in robot.parts.items()} == pytest.approx(
        {"boom": 1, "extension": 0.8, "jib": 0.5}
    )


@pytest.mark.parametrize(("mass", "shape"), [(1.2, "box"), (2700 * 0.5 * 0.15 * 0.04, "rectangle")])
@pytest.mark.parametrize("drawn", [True, False])
def test_a_wide_box_is_guessed_as_one_drawn_or_not(
    tmp_path: Path, mass: float, shape: str, drawn: bool
) -> None:
    """What is not drawn has the sides of the full bar of its moments of inertia."""
    urdf = bar("arm", 0.5, mass, (0.15, 0.04), drawn) + '<link name="tool0"/>'
    urdf += JOINT.format("j", "revolute", "base", "arm", 0, 1, 1)
    urdf += JOINT.format("f", "fixed", "arm", "tool0", 0.5, 1, 1)
    raw, robot = guessed(tmp_path / "arm.urdf", urdf)
    section = raw["flexible"]["arm"]["section"]
    height = "height" if shape == "box" else "thickness"
    assert (section["shape"], section["width"], section[height]) == (shape, 0.04, 0.15)
    (part,) = robot.parts.values()
    # three digits of the wall; its mass is no more than the link's
    assert pytest.approx(mass, rel=5e-3) == 2700 * 0.5 * part.spec.section.A


def test_a_link_of_which_nothing_is_known_but_its_mass_weighs_that(tmp_path: Path) -> None:
    """Moments of inertia as a placeholder say nothing; a tube of 3 mm for 3 kg was guessed."""
    urdf = bar("arm", 0.5, 3, (0.1, 0.1), False) + '<link name="tool0"/>'
    urdf = re.sub('i(xx|yy|zz)="[^"]+"', r'i\1="1.0"', urdf)
    urdf += JOINT.format("j", "revolute", "base", "arm", 0, 1, 1)
    urdf += JOINT.format("f", "fixed", "arm", "tool0", 0.5, 1, 1)
    raw, _ = guessed(tmp_path / "arm.urdf", urdf)
    tube = raw["flexible"]["arm"]["section"]
    area = np.pi * tube["wall"] * (tube["diameter"] - tube["wall"])
    assert 2700 * area * 0.5 == pytest.approx(3, rel=5e-3)  # three digits are written


def test_a_finger_is_no_platform(tmp_path: Path) -> None:
    """Fingers hang further out than the palm that carries them, and matter less."""
    parts = ("base", "upper", "palm", "thumb_1", "thumb_2", "index_1")
    text = "".join(BAR.format(name=n, length=0.2, half=0.1, mass=0.1) for n in parts)
    for parent, child in (
        ("base", "upper"), ("upper", "palm"), ("palm", "thumb_1"), ("thumb_1", "thumb_2"),
        ("palm", "index_1"),
    ):  # fmt: skip
        text += HINGE.format(f"to_{child}", "continuous", parent, child, 0.2)
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm">{text}</robot>', "utf-8")
    assert main(["new", str(path)]) == 0
    assert yaml.safe_load(path.with_suffix(".yaml").read_text("utf-8"))["platform"] == "palm"


def test_a_joint_that_cannot_stand_at_zero_begins_in_the_middle_of_its_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The elbow of a Panda bends from -3.0718 to -0.0698 rad; all other joints may stay at zero."""
    out = tmp_path / "panda.yaml"
    assert main(["new", "example-robot-data:panda", "-o", str(out)]) == 0
    assert yaml.safe_load(out.read_text("utf-8"))["home"] == {"panda_joint4": -1.57}
    capsys.readouterr()
    assert main(["check", str(out)]) == 0
    assert "outside the URDF's limits" not in capsys.readouterr().out


@pytest.mark.parametrize(("effort", "level"), [("30", "rigid"), ("0", None)])
def test_a_joint_without_a_transmission_is_a_motor_where_it_has_an_effort_limit(
    tmp_path: Path, effort: str, level: str | None
) -> None:
    """A gripper has an effort limit and a caster has none; the file says how to hold that."""
    turning = 'ixx="1e-2" ixy="0" ixz="0" iyy="1e-2" iyz="0" izz="1e-2"'
    one = f'<inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia {turning}/></inertial>'
    text = '<robot name="arm"><link name="base"/>'
    for name, parent, child, most in (
        ("shoulder", "base", "arm", "9"), ("grip", "arm", "finger", effort),
    ):  # fmt: skip
        text += f'<link name="{child}">{one}</link><joint name="{name}" type="revolute">'
        text += f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0.3 0 0"/>'
        text += (
            f'<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="9" effort="{most}"/></joint>'
        )
    text += '<transmission name="t"><joint name="shoulder"/><actuator name="m"/></transmission>'
    (tmp_path / "arm.urdf").write_text(text + "</robot>", "utf-8")
    out = tmp_path / "arm.yaml"
    assert main(["new", str(tmp_path / "arm.urdf"), "-o", str(out)]) == 0
    made = out.read_text("utf-8")
    robot = pf.load(out)
    if level:
        assert robot.motors == ("shoulder", "grip")
        assert "GUESSES, by effort limits, not by a <transmission>: grip" in made
        assert len(pf.solve(robot, level=level, samples=5).torque) == 5
    else:
        assert robot.motors == ("shoulder",)
        assert "# joints: {grip: {type: fixed}}" in made
        cured = out.with_name("cured.yaml")
        cured.write_text(made.replace("# joints:", "joints:"), "utf-8")
        assert pf.load(cured).report.mobility == 1
        bare = text.replace('type="revolute"', 'type="continuous"')  # and no transmission at all
        bare = bare[: bare.index("<transmission")] + "</robot>"
        (tmp_path / "arm.urdf").write_text(bare, "utf-8")
        assert main(["new", str(tmp_path / "arm.urdf"), "-o", str(out), "--force"]) == 0
        assert (
            "Without an effort limit: grip. If these are passive, write actuated: [shoulder]"
            in (out.read_text("utf-8"))
        )


def test_arguments_of_a_xacro_are_taken_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("xacro")
    path = tmp_path / "rod.urdf.xacro"
    bar = BAR.format(name="rod", length=0.4, half=0.2, mass=0.002)
    path.write_text(
        '<robot name="rod" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="length" '
        f'default="0.4"/><link name="base"/>{bar}<link name="tool"/>'
        + HINGE.format("j", "continuous", "base", "rod", 0)
        + HINGE.format("f", "fixed", "rod", "tool", "$(arg length)")
        + "</robot>",
        "utf-8",
    )
    out = tmp_path / "rod.yaml"
    refused(capsys, "no value. Give NAME=VALUE", "new", path, "-o", out, "--arg", "length")
    assert main(["new", str(path), "-o", str(out), "--arg", "length=0.6", "--flexible", "rod"]) == 0
    raw = yaml.safe_load(out.read_text("utf-8"))
    box = raw["flexible"]["rod"]["section"]  # lighter than the solid bar drawn: hollow, of its mass
    area = box["width"] * box["height"]
    area -= (box["width"] - 2 * box["wall"]) * (box["height"] - 2 * box["wall"])
    assert 2700 * area * 0.6 == pytest.approx(0.002, rel=0.01)  # three digits are written
    frame = pf.solve(pf.load(out), level="rigid", samples=3).frame("tool")
    assert np.linalg.norm(frame.position[0]) == pytest.approx(0.6)


def test_what_cannot_be_imported_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = gepetto(tmp_path, POINT)
    refused(capsys, "is there already. Give another -o FILE", "import", source)
    refused(capsys, "ends in .yaml", "import", source, "-o", tmp_path / "a.txt")
    refused(capsys, "no such file", "import", tmp_path / "b.urdf")
    out = tmp_path / "c.yaml"
    refused(capsys, "no such link", "import", source, "-o", out, "--flexible", "krank")
    refused(capsys, "base: no beam fits", "import", source, "-o", out, "--flexible", "base")
    assert not out.exists()


def test_a_robot_whose_loops_do_not_close_is_written_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = gepetto(tmp_path, POINT)
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(urdf.read_text("utf-8").replace('xyz="0.4 0 0"', 'xyz="4 0 0"', 1), "utf-8")
    out = tmp_path / "bars.yaml"
    assert main(["import", str(source), "-o", str(out)]) == 1
    assert "does not load yet" in capsys.readouterr().out
    assert "does not close" in out.read_text("utf-8")


def test_what_is_not_taken_over_is_in_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bars.xml"
    path.write_text(BARS, "utf-8")
    assert main(["check", str(path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "bars.xml: not taken over: the tendons both." in said


# The schema ----------------------------------------------------------------------------------


def test_the_shipped_models_are_what_the_schema_says() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    validator.check_schema(json_schema())
    files = sorted((ROOT / "models").glob("*/*.yaml"))
    assert len(files) > 12
    for path in files:
        raw = yaml_text.load(path.read_text("utf-8"), path.name)
        if "urdf" in raw:
            assert [error.message for error in validator.iter_errors(raw)] == []
    raw = yaml_text.load((ROOT / "models/delta/delta.yaml").read_text("utf-8"), "delta")
    joint = {"joint": "motor_1"}
    entry = {"measure": joint, "drive": joint, "kp": -1.0, "target": "motion", "limit": 3.0}
    assert validator.is_valid(raw | {"control": {"period": 0.001, "delay": 0, "hub": entry}})
    for path, value in (
        (("gravty",), [0, 0, 0]), (("base",), "fixd"), (("limit",), -1), (("solve", "dt"), "soon"),
        (("control",), {"period": "x"}), (("control",), {"hub": {"measure": {"joint": "motor_1"}}}),
        (("motion", "kind"), "cycliod"), (("loops", "new"), {"kind": "pin", "between": ["a", "b"]}),
    ):  # fmt: skip
        broken = json.loads(json.dumps(raw))
        block = broken
        for key in path[:-1]:
            block = block.setdefault(key, {})
        block[path[-1]] = value
        assert not validator.is_valid(broken), path


def test_every_key_of_the_description_of_the_keys_is_in_the_schema(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["schema"]) == 0
    whole = json.loads(capsys.readouterr().out)
    known: set[str] = set()
    pending = [whole]
    while pending:
        item = pending.pop()
        if isinstance(item, dict):
            known |= (
                {*item.get("properties", {})} if isinstance(item.get("properties"), dict) else set()
            )
            pending += list(item.values())
        elif isinstance(item, list):
            pending += item
    text = (ROOT / "models/README.md").read_text("utf-8")
    tables = re.findall(r"\| key \|.*?\n((?:\|.*\n)+)", text)
    keys = {
        key for table in tables for row in table.splitlines()[1:]
        for key in re.findall(r"`(\w+)`", row.split("|")[1])
    }  # fmt: skip
    assert len(keys) > 90
    assert keys - known == set()
