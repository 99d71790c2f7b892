"""One feature of an MJCF at a time: the forces of every coordinate against MuJoCo's mj_inverse.

Each feature must change MuJoCo's own forces, so that a reader without it would be noticed.

Claims:
    Equations
    - a mesh of an MJCF is drawn as its file and the geom say, off its principal axes | by hand |
      1e-6 | 2e-8
    Machines
    - MJCF, one feature at a time (66): forces of all coordinates at a random state | `mj_inverse` |
      1e-13 | 1e-15
    - MJCF: distance and angle of loops that are apart; couplings, whichever joint leads | MuJoCo's
      equality violation | 1e-12, 8e-15 | passes
"""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.description.description import read
from pinflex.errors import DescriptionError

mujoco = pytest.importorskip("mujoco")

from tests import mujoco_inverse  # noqa: E402

BASE = """<mujoco>
  <compiler/>
  <option/>
  <default/>
  <asset/>
  <worldbody>
    <body name="a" pos="0.1 0.2 0.3">
      <joint name="p" axis="0 1 0.2"/>
      <geom name="g" type="box" size="0.1 0.02 0.03" pos="0.1 0 0"/>
      <body name="b" pos="0.3 0 0">
        <joint name="r" axis="1 0 0.5"/>
        <geom name="h" type="box" size="0.05 0.02 0.01" pos="0.02 0.05 0"/>
      </body>
    </body>
  </worldbody>
  <tendon/>
  <actuator/>
</mujoco>
"""
P, R = '<joint name="p" ', '<joint name="r" '
G, H = '<geom name="g" type="box" size="0.1 0.02 0.03"', '<geom name="h" type="box" '
A, B = '<body name="a" pos="0.1 0.2 0.3"', '<body name="b" pos="0.3 0 0"'
MESH = 'vertex="0 0 0 0.2 0 0 0 0.1 0 0 0 0.3"'
SHELL = '<mesh name="m" inertia="shell" ' + MESH + "/>"


def turned(how: str) -> tuple[tuple[str, str], ...]:
    return ((B, f"{B} {how}"),)


def compiler(what: str) -> tuple[str, str]:
    return ("<compiler/>", f"<compiler {what}/>")


def geom(what: str) -> tuple[tuple[str, str], ...]:
    return ((G, f'<geom name="g" {what}'),)


def joint(what: str) -> tuple[tuple[str, str], ...]:
    return ((P, f"{P}{what} "),)


def motor(what: str) -> tuple[tuple[str, str], ...]:
    return (("<actuator/>", f'<actuator><motor joint="p" {what}/></actuator>'),)


FEATURES = {
    "gravity": (("<option/>", '<option gravity="1 2 3"/>'),),
    "gravity off": (("<option/>", '<option><flag gravity="disable"/></option>'),),
    "two options": (("<option/>", '<option gravity="1 2 3"/><option gravity="0 5 0"/>'),),
    "euler": turned('euler="30 20 10"'),
    "euler radian": (compiler('angle="radian"'), *turned('euler="0.3 0.2 0.1"')),
    "euler zyx": (compiler('eulerseq="zyx"'), *turned('euler="30 20 10"')),
    "euler XYZ": (compiler('eulerseq="XYZ"'), *turned('euler="30 20 10"')),
    "euler xZy": (compiler('eulerseq="xZy"'), *turned('euler="30 20 10"')),
    "quat": turned('quat="1 0.2 0.3 -0.4"'),
    "axisangle": turned('axisangle="1 2 3 40"'),
    "xyaxes": turned('xyaxes="0 1 0 -1 0 0.2"'),
    "zaxis": turned('zaxis="1 1 0.3"'),
    "frame": ((B, '<frame pos="0 0 0.1" euler="0 40 0"><body name="b" pos="0.3 0 0"'),
              ("      </body>\n", "      </body></frame>\n")),
    "frame in a frame": (
        (B, '<frame euler="0 40 0"><frame pos="0 0 0.1"><body name="b" pos="0.3 0 0"'),
        ("      </body>\n", "      </body></frame></frame>\n"),
    ),
    "frame of the world": (
        (A, f'<frame euler="40 0 0">{A}'), ("    </body>\n  <", "    </body></frame>\n  <")),
    "geom in a frame": ((H, f'<frame euler="0 0 30"><geom size="0.03"/></frame>{H}'),),
    "replicate": (
        ("      </body>\n", "      </body>\n"
         '<replicate count="3" offset="0 0.1 0" euler="0 0 20">'
         '<body><joint axis="0 1 0"/><geom size="0.03"/></body></replicate>'),
    ),
    "replicate of the world": (
        ("<worldbody>", '<worldbody><replicate count="2" offset="0 1 0">'
         '<body><joint axis="0 1 0"/><geom size="0.03" pos="0.1 0 0"/></body></replicate>'),
    ),
    "sphere": geom('size="0.05"'),
    "capsule": geom('type="capsule" size="0.05 0.1" euler="0 30 0"'),
    "capsule fromto": (
        (f'{G} pos="0.1 0 0"', '<geom type="capsule" size="0.05" fromto="0 0 0 0.3 0.1 0"'),),
    "cylinder": geom('type="cylinder" size="0.05 0.1" euler="0 30 0"'),
    "ellipsoid": geom('type="ellipsoid" size="0.05 0.1 0.15"'),
    "mesh": (("<asset/>", f'<asset><mesh name="m" {MESH}/></asset>'),
             *geom('type="mesh" mesh="m"')),
    "mesh scale": (("<asset/>", f'<asset><mesh name="m" scale="2 -1 1" {MESH}/></asset>'),
                   *geom('type="mesh" mesh="m"')),
    "mesh shell": (("<asset/>", f"<asset>{SHELL}</asset>"), *geom('type="mesh" mesh="m"')),
    "box about a mesh": (("<asset/>", f'<asset><mesh name="m" {MESH}/></asset>'),
                         *geom('type="box" mesh="m"')),
    "density": geom('type="box" size="0.1 0.02 0.03" density="2700"'),
    "mass": geom('type="box" size="0.1 0.02 0.03" mass="3"'),
    "mass zero": ((H, f'<geom size="0.03" mass="0"/><geom size="0.03" pos="0 0.1 0"/>{H}'),),
    "shellinertia": geom('type="box" size="0.1 0.02 0.03" shellinertia="true"'),
    "diaginertia": ((G, '<inertial pos="0.01 0 0" mass="2" diaginertia="0.02 0.03 0.04" '
                     f'euler="0 30 0"/>{G}'),),
    "fullinertia": ((G, '<inertial pos="0.01 0 0" mass="2" '
                     f'fullinertia="0.02 0.03 0.04 0.001 0 0.002"/>{G}'),),
    "inertiafromgeom": (
        compiler('inertiafromgeom="false"'),
        (G, f'<inertial pos="0.1 0 0" mass="2" diaginertia="0.02 0.03 0.04"/>{G}'),
        (H, f'<inertial pos="0.1 0 0" mass="1" diaginertia="0.02 0.03 0.04"/>{H}')),
    "inertiagrouprange": (compiler('inertiagrouprange="0 2"'),
                          (H, f'<geom size="0.1"/>{H}group="3" ')),
    "settotalmass": (compiler('settotalmass="7"'),),
    "boundmass": (compiler('boundmass="1.5" boundinertia="0.01"'),),
    "balanceinertia": (
        compiler('balanceinertia="true"'),
        (G, f'<inertial pos="0.1 0 0" mass="2" diaginertia="0.1 0.03 0.04"/>{G}')),
    "fusestatic": (
        compiler('fusestatic="true"'),
        (H, f'<body name="c" pos="0 0.1 0"><geom size="0.04"/></body>{H}')),
    "default": (("<default/>", '<default><joint armature="0.1" damping="0.2"/></default>'),),
    "default class": (
        ("<default/>", '<default><default class="x"><geom density="3000"/>'
         '<default class="y"><joint armature="0.3"/></default></default></default>'),
        (P, f'{P}class="y" '), (H, f'{H}class="y" ')),
    "childclass": (
        ("<default/>", '<default><default class="x"><geom density="3000"/></default></default>'),
        (B, f'{B} childclass="x"')),
    "armature": joint('armature="0.2"'),
    "damping": joint('damping="0.3"'),
    "frictionloss": joint('frictionloss="0.4"'),
    "stiffness": joint('stiffness="3" springref="40"'),
    "stiffness at ref": joint('stiffness="3" springref="40" ref="15"'),
    "springdamper": joint('springdamper="0.5 0.7"'),
    "springs off": (("<option/>", '<option><flag spring="disable"/></option>'),
                    *joint('damping="0.3" stiffness="3"')),
    "dampers off": (("<option/>", '<option><flag damper="disable"/></option>'),
                    *joint('damping="0.3" stiffness="3"')),
    "friction off": (("<option/>", '<option><flag frictionloss="disable"/></option>'),
                     *joint('damping="0.3" frictionloss="3"')),
    "ref": joint('ref="25"'),
    "slide": joint('type="slide" ref="0.1"'),
    "slide spring": joint('type="slide" stiffness="30" springref="0.1"'),
    "joint pos": joint('pos="0.05 0.02 0"'),
    "two joints": ((P, '<joint name="q" type="slide" axis="1 0 0" pos="0 0.1 0"/>'
                    f'<joint name="s" axis="0 0 1" pos="0 0.1 0.1"/>{P}'),),
    "ball": ((f'{P}axis="0 1 0.2"',
              f'{P}type="ball" pos="0.02 0 0" armature="0.02" damping="0.1"'),),
    "free": ((P, f'<freejoint name="f"/><geom size="0.1"/></body>{A}><joint name="p" '.replace(
        'name="a"', 'name="c"')),),
    "free base": (('<joint name="p" axis="0 1 0.2"/>', "<freejoint/>"), (A, f'{A} euler="10 0 0"')),
    "gravcomp": ((B, f'{B} gravcomp="0.7"'),),
    "motor armature": motor('armature="0.5" gear="3"'),
    "motor damping": motor('damping="0.5" gear="-2"'),
    "spring beside a motor": (*joint('stiffness="3" springref="40"'), *motor("")),
    "motor default": (("<default/>", '<default><motor armature="0.5"/></default>'), *motor("")),
    "motor in the parent": (
        ("<actuator/>", '<actuator><general jointinparent="r" armature="0.2"/></actuator>'),),
    "damped motor without dampers": (
        ("<option/>", '<option gravity="1 2 3"><flag damper="disable"/></option>'),
        *motor('damping="0.5"')),
}  # fmt: skip


def written(folder: Path, changes: tuple[tuple[str, str], ...], name: str = "one.xml") -> Path:
    text = BASE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / name
    path.write_text(text, "utf-8")
    return path


def forces(path: Path) -> np.ndarray:
    model = mujoco.MjModel.from_xml_path(str(path))
    return mujoco_inverse.theirs(model, mujoco_inverse.state(model))


@pytest.mark.filterwarnings("ignore:compiler attribute")
@pytest.mark.parametrize("feature", FEATURES)
def test_forces_are_those_of_mj_inverse(tmp_path: Path, feature: str) -> None:
    path = written(tmp_path, FEATURES[feature])
    # round-off of rotations; the smoothing of dry friction is 1 - tanh(v / 1e-3), less
    assert mujoco_inverse.difference(path) < 1e-13
    plain, now = forces(written(tmp_path, (), "plain.xml")), forces(path)
    if len(plain) == len(now):
        assert np.abs(now - plain).max() > 1e-4 * np.abs(plain).max()


# What is named: the change, words of the note, and whether MuJoCo's forces change by it.
NAMED = {
    "fluid": ((("<option/>", '<option density="1000" viscosity="1"/>'),),
              "fluid.*density, visc", True),
    "tendon spring": (
        (("<tendon/>", '<tendon><fixed name="t" stiffness="3" springlength="0.1">'
          '<joint joint="p" coef="1"/></fixed></tendon>'),), "friction of the tendons t", True),
    "tendon actuator": (
        (("<tendon/>", '<tendon><fixed name="t"><joint joint="r" coef="1"/></fixed></tendon>'),
         ("<actuator/>", '<actuator><motor name="pull" tendon="t" armature="1"/></actuator>')),
        "armature and damping.* of the actuators pull", True),
    "polynomial spring": (joint('stiffness="3 4"'), "polynomials.*of the joints p", True),
    "polynomial damper": (joint('damping="3 4"'), "polynomials.*of the joints p", True),
    "polynomial motor": (motor('name="m" damping="3 4"'), "polynomials.*the actuators m", True),
    "free damper": (
        (('<joint name="p" axis="0 1 0.2"/>', '<joint name="p" type="free" damping="1"/>'),),
        "dampers of the free joints p", True),
    "free armature": (
        (('<joint name="p" axis="0 1 0.2"/>', '<joint name="p" type="free" armature="1"/>'),),
        "armature of the free joints p", True),
    "ball spring": (
        ((f'{P}axis="0 1 0.2"', f'{P}type="ball" stiffness="3"'),),
        "springs of the joints p", True),
    "ball friction": (
        ((f'{P}axis="0 1 0.2"', f'{P}type="ball" frictionloss="3"'),),
        "frictionloss of the joints p", True),
    "ball range": (
        ((f'{P}axis="0 1 0.2"', f'{P}type="ball" range="0 90"'),), "range of the joints p", False),
    "gear": (motor('name="m" gear="3"'), "the gears of m", False),
    "law": ((("<actuator/>", '<actuator><position joint="p" kp="3"/></actuator>'),),
            "control laws of line 17", False),
    "contact": (joint(""), "contacts", False),
    "site actuator": (
        ((G, f'<site name="s"/>{G}'),
         ("<actuator/>", '<actuator><motor name="m" site="s"/></actuator>')),
        "actuators m, which drive no joint", False),
}  # fmt: skip


@pytest.mark.parametrize("feature", NAMED)
def test_what_is_not_taken_over_is_named(tmp_path: Path, feature: str) -> None:
    changes, words, moves = NAMED[feature]
    path = written(tmp_path, changes)
    notes = read(path).notes
    assert any(re.search(f"one.xml: not taken over: .*{words}", note) for note in notes), notes
    assert (mujoco_inverse.difference(path) > 1e-3) == moves


def test_at_most_ten_lines_and_what_moves_first(tmp_path: Path) -> None:
    every = [change for feature in ("fluid", "polynomial spring", "ball friction", "site actuator")
             for change in NAMED[feature][0]]  # fmt: skip
    every = [(old, new) for old, new in every if "ball" not in new]
    many = "".join(f'<motor name="m{k}" joint="r" gear="2"/>' for k in range(30))
    every[-1] = ("<actuator/>", f'<actuator><general site="s" gainprm="2"/>{many}</actuator>')
    notes = read(written(tmp_path, tuple(every))).notes
    assert len(notes) <= 10
    assert "fluid" in notes[0]
    assert any("the gears of m0, m1, m2, m3 and 26 more" in note for note in notes)


# Equalities ------------------------------------------------------------------------------------

PAIR = """<mujoco><worldbody>
  <site name="s0" pos="0.1 0.2 0.3" euler="0 30 0"/>
  <body name="a" pos="0.1 0 0"><joint name="x" ref="20"/><joint name="y" axis="0 1 0"/>
    <geom size="0.1"/><site name="s1" pos="0 0.1 0" euler="20 0 0"/></body>
  <body name="b" pos="0.4 0 0" euler="0 0 30"><joint name="u" ref="-30" axis="1 0 0"/>
    <joint name="w" type="slide" ref="0.1"/>
    <geom size="0.1"/><site name="s2" pos="0 0 0.1" euler="0 20 10"/></body>
  </worldbody><equality>%s</equality><actuator>%s</actuator></mujoco>
"""
LOOPS = (
    '<connect body1="a" body2="b" anchor="0.1 0.2 0.3"/>',
    '<connect body1="a" anchor="0.1 0.2 0.3"/>',
    '<connect site1="s1" site2="s2"/>',
    '<connect site1="s0" site2="s2"/>',
    '<weld body1="a" body2="b"/>',
    '<weld body1="b"/>',
    '<weld body1="a" body2="b" anchor="0.1 0 0.2"/>',
    '<weld body1="a" body2="b" relpose="0.1 0.2 0.3 0.8 0.6 0 0.1" anchor="0 0.1 0"/>',
    '<weld site1="s1" site2="s2"/>',
)


def violation(path: Path, q: dict[str, float]) -> np.ndarray:
    """How far MuJoCo's equalities are from closed."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in q.items():
        data.joint(name).qpos[:] = value
    mujoco.mj_forward(model, data)
    rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return np.array(data.efc_pos[rows])


@pytest.mark.parametrize("equality", LOOPS)
def test_loops_close_where_those_of_mujoco_do(tmp_path: Path, equality: str) -> None:
    """Distance and angle between the two frames at a pose at which they are apart."""
    path = tmp_path / "pair.xml"
    path.write_text(PAIR % (equality, ""), "utf-8")
    robot = read(path)
    (loop,) = robot.loops
    q = {"x": 0.3, "y": -0.4, "u": 0.7, "w": 0.2}
    model = pin.buildModelFromXML(robot.urdf_text)
    data, at = model.createData(), pin.neutral(model)
    for name, value in q.items():
        joint = model.joints[model.getJointId(name)]
        at[joint.idx_q : joint.idx_q + joint.nq] = (
            value if joint.nq == 1 else (np.cos(value), np.sin(value))
        )
    pin.framesForwardKinematics(model, data, at)
    one, other = (data.oMf[model.getFrameId(frame)] for frame in (loop.frame_a, loop.frame_b))
    apart = violation(path, q)
    assert loop.kind == ("weld" if "weld" in equality else "spherical")
    between = one.actInv(other)
    assert np.linalg.norm(apart[:3]) > 0.05  # not where it is closed anyway
    if loop.kind == "weld":
        # MuJoCo has the vector of the quaternion between them: sin of half the angle, at any point
        half = np.sin(np.linalg.norm(pin.log3(between.rotation)) / 2)
        assert half == pytest.approx(np.linalg.norm(apart[3:]), rel=1e-12)
    far = np.linalg.norm(apart[:3])
    assert np.linalg.norm(between.translation) == pytest.approx(far, rel=1e-12)


@pytest.mark.parametrize("motors", ["x", "u", "", "w"])
@pytest.mark.parametrize("pair", ["xu", "ux", "wx", "x"])
def test_couplings_are_those_of_mujoco(tmp_path: Path, pair: str, motors: str) -> None:
    """Whichever of the two has the motor leads; positions by our law close MuJoCo's."""
    path = tmp_path / "pair.xml"
    words = " ".join(f'joint{k + 1}="{name}"' for k, name in enumerate(pair))
    path.write_text(
        PAIR % (f'<joint {words} polycoef="0.2 -0.5 0 0 0"/>',
                "".join(f'<motor joint="{name}"/>' for name in motors)), "utf-8"
    )  # fmt: skip
    robot = read(path)
    (law,) = robot.couplings
    if motors and motors in pair and len(pair) > 1:
        assert law.leader == motors
        assert robot.actuated == (motors,)
    q = {} if law.leader is None else {law.leader: 0.7}
    q[law.joint] = law.ratio * q.get(law.leader or "", 0.0) + law.offset
    assert np.abs(violation(path, q)).max() < 1e-15 * 8  # a few roundings
    q[law.joint] += 0.1
    assert np.abs(violation(path, q)).max() > 0.01


# Refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ((compiler("eulerseq=''"),), "attribute 'eulerseq' must have exactly 3 characters"),
        (joint('type="hinge2"'), "invalid keyword: 'hinge2'"),
        ((("<asset/>", "<asset>" + "<x>" * 20000 + "</x>" * 20000 + "</asset>"),),
         "more than 500 deep"),
        ((("<asset/>", '<asset><mesh name="m" file="none.stl"/></asset>'),), "none.stl"),
        ((("<asset/>", '<asset><mesh name="m" file="."/></asset>'),), "is no regular file"),
        ((("<asset/>", '<include file="none.xml"/>'),), "line 5: include: cannot read none.xml"),
        ((("<asset/>", '<include file="one.xml"/>'),), "one.xml is included before"),
        (((A, '<replicate count="400">'
           f'<replicate count="400"><site/></replicate></replicate>{A}'),
          ),
         "line 7: <replicate> comes to more than 100000 elements"),
        (((A, f'<replicate count="{"9" * 400}"><body/></replicate>{A}'),), "line 7: <replicate>"),
        ((("<mujoco>", "<mujoco><!DOCTYPE x>"),), "DOCTYPE"),
        ((("</mujoco>", ""),), "line 17: malformed XML"),
        (((G, ""),), "(?s).*"),
    ],
)  # fmt: skip
def test_a_bad_file_is_refused_in_one_line(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], words: str
) -> None:
    with pytest.raises(DescriptionError, match=words) as caught:
        read(written(tmp_path, changes))
    assert str(caught.value).startswith("one.xml")
    assert "\n" not in str(caught.value)


def test_without_mujoco_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(DescriptionError, match=r'Run `pip install "pinflex\[mjcf\]"`.$'):
        read(written(tmp_path, ()))


def test_an_included_part_of_any_root_is_read(tmp_path: Path) -> None:
    body = BASE[BASE.index("    <body") : BASE.index("  </worldbody>")]
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>{body}</mujocoinclude>", "utf-8")
    path = written(tmp_path, ((body, '<include file="part.xml"/>'),))
    whole = written(tmp_path, (), "plain.xml")
    assert mujoco_inverse.difference(path) < 1e-13
    np.testing.assert_array_equal(forces(path), forces(whole))
    part = tmp_path / "part.xml"
    with pytest.raises(DescriptionError, match="part.xml: MuJoCo: .*mujocoinclude"):
        read(part)


def test_springs_follow_the_motors_that_the_yaml_lists(tmp_path: Path) -> None:
    """A spring of the file acts in a joint with and without a motor."""
    path = written(tmp_path, (*joint('stiffness="3" springref="40"'), *motor("")))
    assert read(path).actuated == ("p",)
    loose = pf.load(path, ["actuated=[]"]).description
    both = pf.load(path, ["actuated=[p, r]"]).description
    for robot in (loose, both, loose.with_overrides(["actuated=[r]"])):
        assert (robot.joints["p"].spring, robot.joints["p"].rest) == (3.0, np.radians(40))
    scene = tmp_path / "scene.yaml"
    scene.write_text("urdf: one.xml\nactuated: []\njoints: {p: {spring: 5}}\n", "utf-8")
    own = read(scene).joints["p"]
    assert (own.spring, own.parallel_spring, own.rest) == (5.0, False, np.radians(40))


def test_a_mesh_is_drawn_where_the_file_puts_it(tmp_path: Path) -> None:
    """MuJoCo moves a mesh to its centre and principal axes; its file is drawn as it is written."""
    (tmp_path / "tetra.obj").write_text(
        "v 0 0 0\nv 0.2 0 0\nv 0 0.1 0\nv 0 0 0.3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    )
    path = tmp_path / "robot.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="tetra.obj"/></asset><worldbody><body name="a">'
        '<joint name="p"/><geom type="mesh" mesh="m" pos="0.3 -0.1 0.2" euler="0 0 90"/></body>'
        "</worldbody></mujoco>"
    )
    visual = ET.fromstring(read(path).urdf_text).find(".//visual/origin")
    assert visual is not None
    xyz, rpy = ([float(x) for x in visual.get(key, "").split()] for key in ("xyz", "rpy"))
    # The axes of an OBJ's vertices are of single precision there.
    np.testing.assert_allclose([xyz, rpy], [[0.3, -0.1, 0.2], [0, 0, np.pi / 2]], atol=1e-6)
