"""Descriptions: what a good file gives, and what a bad file is told."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import sys
from pathlib import Path

import pytest

from pinflex.description import description, loops, section
from pinflex.description.blocks import flexible, material
from pinflex.description.description import Basis, Description, JointExtra, SolveSpec, read
from pinflex.description.robots.urdf import check
from pinflex.errors import DescriptionError, ModelNotFoundError

URDF = """<?xml version="1.0"?>
<robot name="bar4">
  <link name="base"/>
  <link name="crank">
    <inertial>
      <mass value="0.2"/>
      <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>
    </inertial>
  </link>
  <link name="rod_1"/>
  <link name="rod_2"/>
  <link name="rod_tip"/>
  <link name="plate"/>
  <joint name="motor" type="revolute">
    <parent link="base"/><child link="crank"/>
    <axis xyz="0 0 1"/><limit effort="1" velocity="1" lower="-3" upper="3"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="crank"/><child link="rod_1"/>
    <origin xyz="0.1 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="ball" type="floating"><parent link="base"/><child link="rod_2"/></joint>
  <joint name="cross" type="fixed"><parent link="rod_2"/><child link="plate"/></joint>
  <joint name="tip" type="fixed"><parent link="rod_1"/><child link="rod_tip"/></joint>
</robot>
"""
YAML = """\
urdf: bar4.urdf
gravity: [0, 0, 0]
joints:
  ball: {type: spherical, damper: 1e-3}
  cross: {type: universal, axes: [x, [0, 3, 4]]}
  motor: {rotor_inertia: 8.3e-3, parallel_spring: 2, rest: 0.1}
actuated: [motor]
loops:
  pin: {kind: revolute, between: [rod_tip, plate]}
  bar: {kind: distance, between: [crank, plate], length: 0.2}
home: {motor: 0.3, ball: [0, 0, 1.5707963267948966], cross: [0.1, 0.2]}
platform: plate
frames: [rod_tip]
damping: {rayleigh: [2e-3, 3e-4]}
flexible:
  rod_?:
    material: {E: 7.1e10, nu: 0.33, rho: 2810}
    section: {shape: rectangle, width: 0.025, thickness: 0.002}
    damping: {modal: 0.01}
  crank: {material: steel, section: {shape: circle, diameter: 0.01}, torsion: true, up: -z}
motion: {kind: cycloid, joints: {motor: 0.25}, duration: 0.1}
solve: {level: coupled, until: 0.2, dt: 1e-4, newmark: [0.5280, 0.2642]}
"""


def write(folder: Path, yaml: str = YAML, urdf: str = URDF) -> Path:
    (folder / "bar4.urdf").write_text(urdf, encoding="utf-8")
    path = folder / "scene.yaml"
    path.write_text(yaml, encoding="utf-8")
    return path


@pytest.fixture
def scene(tmp_path: Path) -> Description:
    return read(write(tmp_path))


def test_every_block_arrives(scene: Description) -> None:
    assert (scene.name, scene.urdf_name, scene.base) == ("scene", "bar4.urdf", "fixed")
    assert scene.gravity == (0.0, 0.0, 0.0)
    assert scene.actuated == ("motor",)
    assert (scene.platform, scene.frames) == ("plate", ("rod_tip",))
    assert scene.joints["ball"].type == "spherical"
    assert scene.joints["cross"].axes == ((1.0, 0.0, 0.0), (0.0, 0.6, 0.8))
    assert scene.joints["motor"].rotor_inertia == 8.3e-3
    pin, bar = scene.loops
    assert (pin.kind, pin.frame_a, pin.frame_b) == ("revolute", "rod_tip", "plate")
    assert (pin.axis, pin.length, bar.length) == ((0.0, 0.0, 1.0), None, 0.2)
    assert scene.sources == {"bar4.urdf": URDF, "scene.yaml": YAML}
    assert scene.motion == {"kind": "cycloid", "joints": {"motor": 0.25}, "duration": 0.1}
    assert (scene.solve.integrator, scene.solve.newmark) == ("newmark", (0.5280, 0.2642))


def test_a_glob_describes_several_links_at_once(scene: Description) -> None:
    first, second, crank = scene.flexible
    assert [link.link for link in scene.flexible] == ["rod_1", "rod_2", "crank"]
    assert (first.material, first.section) == (second.material, second.section)
    assert (crank.torsion, crank.axial, crank.up) == (True, "auto", (0.0, 0.0, -1.0))


def test_a_list_of_links_shares_one_block(tmp_path: Path) -> None:
    links = read(write(tmp_path, YAML.replace("rod_?", "rod_2, rod_1"))).flexible
    assert [link.link for link in links] == ["rod_2", "rod_1", "crank"]


def test_the_damping_of_a_link_replaces_the_common_one(scene: Description) -> None:
    rod, _, crank = scene.flexible
    assert (rod.rayleigh, rod.modal_damping) == ((0.0, 0.0), 0.01)
    assert (crank.rayleigh, crank.modal_damping) == ((2e-3, 3e-4), 0.0)


def test_home_is_laid_out_as_pinocchio_does(scene: Description) -> None:
    half = math.sqrt(0.5)  # a quarter turn about z
    assert scene.home["motor"] == 0.3
    assert scene.home["ball"] == pytest.approx((0, 0, half, half), abs=1e-15)  # rounding of sin
    assert (scene.home["cross.1"], scene.home["cross.2"]) == (0.1, 0.2)


def test_only_the_urdf_is_required(tmp_path: Path) -> None:
    plain = read(write(tmp_path, "urdf: bar4.urdf\n"))
    assert plain.gravity == (0.0, 0.0, -9.81)
    assert plain.actuated == ("motor", "elbow")
    assert (plain.loops, plain.flexible, plain.motion, plain.home) == ((), (), None, {})
    assert plain.solve.level == "coupled"
    assert plain.solve.start == "auto"


def test_an_empty_value_counts_as_not_written(tmp_path: Path) -> None:
    assert read(write(tmp_path, "urdf: bar4.urdf\nloops:\nhome:\n")).loops == ()


def test_exponents_need_no_point_and_no_sign(tmp_path: Path) -> None:
    """PyYAML alone reads 1e-3 and 7e5 as text."""
    text = "urdf: bar4.urdf\ngravity: [1e-3, 7e5, -2E+1]\n"
    assert read(write(tmp_path, text)).gravity == (1e-3, 7e5, -20.0)


def test_a_free_base_has_a_home(tmp_path: Path) -> None:
    text = "urdf: bar4.urdf\nbase: free_flyer\nhome: {root_joint: [0, 0, 1, 0, 0, 0]}\n"
    assert read(write(tmp_path, text)).home["root_joint"] == (0, 0, 1, 0, 0, 0, 1)


def test_a_description_survives_pickle_and_copy(scene: Description) -> None:
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert copy.deepcopy(scene) == scene
    assert scene.replace(platform=None).platform is None


def test_a_folder_stands_for_the_file_of_its_name(tmp_path: Path) -> None:
    folder = tmp_path / "bar4"
    folder.mkdir()
    write(folder).rename(folder / "bar4.yaml")
    assert read(folder) == read(folder / "bar4.yaml")


def test_a_shipped_model_is_found_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "bar4"
    folder.mkdir()
    write(folder).rename(folder / "bar4.yaml")
    monkeypatch.setattr(description, "_MODEL_FOLDERS", (tmp_path,))
    assert description.model_names() == ("bar4",)
    assert read("bar4").name == "bar4"
    with pytest.raises(ModelNotFoundError, match='bar5: no such file.* Did you mean "bar4"'):
        read("bar5")
    (tmp_path / "here" / "bar4").mkdir(parents=True)  # of meshes, say
    monkeypatch.chdir(tmp_path / "here")
    assert read("bar4").name == "bar4"
    write(tmp_path / "here" / "bar4")
    with pytest.raises(ModelNotFoundError, match="the folder holds no bar4.yaml"):
        read("bar4")


def test_a_robot_of_example_robot_data_is_found_without_its_meshes(tmp_path: Path) -> None:
    pytest.importorskip("example_robot_data")
    robot = read(write(tmp_path, "urdf: example-robot-data:ur5\n"))
    assert robot.urdf_name == "ur5_robot.urdf"
    assert len(robot.actuated) == 6
    bare = read("example-robot-data:ur5")  # as `pinflex new` takes it, without a YAML
    assert (bare.name, bare.actuated) == ("ur5", robot.actuated)
    folder = Path(robot.package_dirs[0])
    assert (folder / "example-robot-data" / "robots" / "ur_description").is_dir()


def test_a_robot_that_example_robot_data_lacks_is_named(tmp_path: Path) -> None:
    pytest.importorskip("example_robot_data")
    text = 'no robot "ur55" in example-robot-data. Did you mean "ur5"'
    with pytest.raises(DescriptionError, match=text):
        read(write(tmp_path, "urdf: example-robot-data:ur55\n"))


def test_a_missing_example_robot_data_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "example_robot_data", None)
    with pytest.raises(DescriptionError, match="pip install example-robot-data-loaders"):
        read(write(tmp_path, "urdf: example-robot-data:ur5\n"))


def test_every_key_is_explained_in_the_readme() -> None:
    text = (Path(description.__file__).parents[2] / "models" / "README.md").read_text("utf-8")
    keys = {*description.KEYS, *flexible.KEYS, *material.KEYS, *loops.LOOP_KINDS}
    for record in (JointExtra, SolveSpec, Basis):
        keys |= {field.name for field in dataclasses.fields(record)} - {"name"}
    keys |= {*material.MATERIALS, *flexible.BOUNDARIES}
    for shape in section.SHAPES.values():
        keys |= {shape.name, *shape.keys}
    assert [key for key in sorted(keys) if f"`{key}`" not in text] == []


# Overrides


def test_an_override_reaches_every_link_a_glob_names(scene: Description) -> None:
    thin = scene.with_overrides(["flexible.rod_*.section.thickness=1e-3", "gravity.2=-1.62"])
    assert [dict(f.section.dimensions)["thickness"] for f in thin.flexible[:2]] == [1e-3, 1e-3]
    assert thin.gravity == (0.0, 0.0, -1.62)
    assert dict(scene.flexible[0].section.dimensions)["thickness"] == 0.002


def test_an_override_may_single_out_a_link_written_in_a_group(scene: Description) -> None:
    one = scene.with_overrides(["flexible.rod_2.material=titanium"])
    assert [f.material.name for f in one.flexible] == ["custom", "titanium", "steel"]


def test_an_overridden_description_keeps_its_own_source(scene: Description) -> None:
    changed = scene.with_overrides(["solve.level=rigid", "motion=null", "solve.dt=2e-4"])
    assert (changed.solve.level, changed.motion, changed.solve.dt) == ("rigid", None, 2e-4)
    assert "level: rigid" in changed.sources["scene.yaml"]
    again = changed.with_overrides(["solve.level=rigid"])  # a removed key is written no more
    assert again.replace(yaml_text="") == changed.replace(yaml_text="")
    assert scene.with_overrides([]) is scene


def test_an_override_does_not_need_the_files_any_more(tmp_path: Path) -> None:
    path = write(tmp_path)
    scene = read(path)
    path.unlink()
    (tmp_path / "bar4.urdf").unlink()
    assert scene.with_overrides(["platform=crank"]).platform == "crank"


@pytest.mark.parametrize(
    ("override", "text"),
    [
        ("solve.level", "not of the form key.path=value"),
        ("solve.levle=rigid", 'scene.yaml: solve.levle: no such key. Did you mean "level"?'),
        ("flexible.x*.segments=2", 'nothing matches "x*"'),
        ("flexible.crank.material.E=1e9", "'steel' has no \"E\" inside. Set the whole value"),
        ("gravity.7=1", 'has no "7" inside'),
        ("flexible.rod_9.segments=2", "scene.yaml: flexible.rod_9: no such link in bar4.urdf"),
        ("solve.dt=[", "override 'solve.dt=[', line 1:"),
    ],
)
def test_a_bad_override_is_refused(scene: Description, override: str, text: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        scene.with_overrides([override])
    assert text in str(caught.value)


def test_a_joint_stands_for_the_frame_that_it_carries(tmp_path: Path) -> None:
    """Wherever a frame is asked for; the URDF's `tip` carries rod_tip, `cross` carries plate."""
    text = YAML.replace("[rod_tip, plate]", "[tip, cross]").replace(
        "platform: plate", "platform: cross"
    )
    text = text.replace("frames: [rod_tip]", "frames: [tip]")
    text += "forces: {push: {at: tip, force: [1, 0, 0]}}\n"
    text += "springs: {coil: {between: [cross, base], stiffness: 1}}\n"
    found = read(write(tmp_path, text))
    assert (found.platform, found.frames, found.forces[0].frame) == (
        "plate",
        ("rod_tip",),
        "rod_tip",
    )
    assert (found.loops[0].frame_a, found.loops[0].frame_b) == ("rod_tip", "plate")
    assert found.springs[0].frame_a == "plate"
    assert found.by_joint == {"cross": "plate", "tip": "rod_tip"}
    both = URDF.replace('name="tip"', 'name="plate"')  # a joint called as another link
    assert read(write(tmp_path, YAML, both)).loops[0].frame_b == "plate"
    with pytest.raises(DescriptionError, match=r'"rod_tip" is listed twice \(.tip. is the joint'):
        read(write(tmp_path, YAML.replace("[rod_tip, plate]", "[rod_tip, tip]")))


# Bad YAML: (what is replaced, by what, text of the error)

BAD_VALUES = [
    ("urdf: bar4.urdf", "", "scene.yaml: urdf: missing."),
    ("urdf: bar4.urdf", "urdf: bar5.urdf", 'urdf: no file "bar5.urdf" beside the YAML. Did you'),
    ("gravity:", "graviti:", 'scene.yaml: graviti: no such key. Did you mean "gravity"?'),
    ("[0, 0, 0]", "[0, 0]", "scene.yaml: gravity: [0, 0] is not a list of 3."),
    ("[0, 0, 0]", "[0, 0, .nan]", "gravity[2]: nan is out of range. Allowed: a finite number."),
    ("[0, 0, 0]", "[0, 0, .inf]", "gravity[2]: inf is out of range"),
    ("[0, 0, 0]", "[0, 0, true]", "gravity[2]: True is not a number"),
    ("[0, 0, 0]", f"[0, 0, {'9' * 400}]", "is out of range"),
    ("gravity:", "base: fixd\ngravity:", "base: 'fixd' is not known. Did you mean \"fixed\"?"),
    ("  ball:", "  bal:", 'joints.bal: no such joint in bar4.urdf: "bal". Did you mean "ball"'),
    ("spherical,", "sperical,", "joints.ball.type: 'sperical' is not known. Did you mean \"sph"),
    ("{rotor_inertia: 8.3e-3", "{type: spherical", "parallel_spring: a spherical joint has no one"),
    ("{rotor_inertia: 8.3e-3", "{type: fixed", "motor.parallel_spring: the joint is fixed by its"),
    ("{type: universal, axes: [x, [0, 3, 4]]}", "{type: fixed}", "bar4.urdf says fixed already"),
    ("8.3e-3", "-1", "joints.motor.rotor_inertia: -1 is out of range. Allowed: a finite number >="),
    ("parallel_spring: 2, ", "", "joints.motor.rest: there is no spring."),
    ("damper: 1e-3", "spring: 1", "joints.ball.spring: a spherical joint has no one spring"),
    ("[0, 3, 4]", "-x", "joints.cross.axes: ['x', '-x'] are parallel"),
    ("[0, 3, 4]", "[0, 0, 0]", "joints.cross.axes[1]: [0, 0, 0] has no direction"),
    ("universal, axes", "spherical, axes", "only a universal joint has two"),
    ("actuated: [motor]", "", "scene.yaml: actuated: missing. With loops not every joint"),
    ("[motor]", "[moter]", 'actuated[0]: no such joint of one degree of freedom: "moter". Did'),
    ("[motor]", "[motor, motor]", 'actuated[1]: "motor" is listed twice'),
    ("revolute,", "hinge,", "loops.pin.kind: 'hinge' is not known. Allowed: weld, revolute"),
    ("{kind: revolute, ", "{", "loops.pin.kind: missing"),
    ("[rod_tip, plate]", "[rod_tip]", "loops.pin.between: ['rod_tip'] is not a list of 2"),
    ("[rod_tip, plate]", "[rod_tp, plate]", 'between[0]: no such link in bar4.urdf: "rod_tp". Did'),
    ("[rod_tip, plate]", "[plate, plate]", 'loops.pin.between[1]: "plate" is listed twice'),
    ("length: 0.2", "axis: z", "loops.bar.axis: has no meaning for the kind distance"),
    ("length: 0.2", "length: 0", "loops.bar.length: 0 is out of range. Allowed: a finite number >"),
    ("motor: 0.3", "motr: 0.3", 'home.motr: no such moving joint: "motr". Did you mean "motor"?'),
    ("motor: 0.3", "tip: 0.3", "home.tip: no such moving joint"),
    ("motor: 0.3", "motor: [1]", "home.motor: [1] is not a number"),
    (
        "[0.1, 0.2]",
        "0.1",
        "home.cross: 0.1 does not fit a universal joint, which takes a list of 2",
    ),
    (
        "[0, 0, 1.5707963267948966]",
        "[0, 0, 1, 1]",
        "home.ball: the quaternion x y z w has the norm",
    ),
    ("platform: plate", "platform: plat", 'platform: no such link in bar4.urdf: "plat". Did you'),
    ("platform: plate", "platform: [1]", "platform: [1] is not a text"),
    ("frames: [rod_tip]", "frames: rod_tip", "frames: 'rod_tip' is not a list"),
    ("rod_?:", "rods_*:", "flexible.rods_*: no such link in bar4.urdf."),
    ("rod_?:", "rod_1, rod_3:", "flexible.rod_1, rod_3: no such link in bar4.urdf. Did you mean"),
    ("crank: {", "rod_1: {", 'flexible.rod_1: the link "rod_1" is already described under "rod_?"'),
    ("material: steel, ", "", "flexible.crank.material: missing. Required here: material, section"),
    ("material: steel", "material: stel", "flexible.crank.material: 'stel' is not known. Did you"),
    (
        "torsion: true",
        "torsion: maybe",
        "torsion: 'maybe' is not known. Allowed: auto, true, false",
    ),
    (
        "torsion: true",
        "shear: 1",
        "flexible.crank.shear: 1 is not known. Allowed: auto, true, false.",
    ),
    ("torsion: true", "segments: 0", "segments: 0 is not valid. Allowed: a whole number >= 1."),
    ("torsion: true", "length: -1", "flexible.crank.length: -1 is out of range"),
    ("torsion: true", "end: rod", 'flexible.crank.end: no such link in bar4.urdf: "rod"'),
    ("torsion: true", "tip: {mass: -1}", "flexible.crank.tip.mass: -1 is out of range"),
    ("torsion: true", "basis: {order: cubic}", "order: has no meaning for the kind craig_bampton"),
    ("torsion: true", "basis: {kind: fe}", "basis.kind: 'fe' is not known."),
    (
        "torsion: true",
        "shear: true, basis: {kind: assumed}",
        "flexible.crank.shear: assumed modes have no shear. Use finite_element of order cubic",
    ),
    (
        "torsion: true",
        "shear: true, basis: {kind: finite_element, order: quintic}",
        "flexible.crank.shear: quintic elements have no shear",
    ),
    ("torsion: true", "basis: {internal: 1.5}", "internal: 1.5 is not valid. Allowed: a whole"),
    (
        "torsion: true",
        "bending_y: false, bending_z: false, torsion: false, axial: false",
        "flexible.crank: bending_y, bending_z, torsion, axial are all false, so nothing deforms",
    ),
    ("[2e-3, 3e-4]", "[2e-3, -1]", "damping.rayleigh[1]: -1 is out of range"),
    ("{rayleigh: [2e-3, 3e-4]}", "{}", "damping: {} is not one kind of damping"),
    (
        "modal: 0.01",
        "modal: 2",
        "damping.modal: 2 is out of range. Allowed: a finite number >= 0 a",
    ),
    ("cycloid", "cyclod", "motion.kind: 'cyclod' is no motion. Did you mean \"cycloid\"?"),
    ("joints: {motor: 0.25}", "joints: {elbow: 1}", "motion.joints: no such joint with a motor"),
    ("level: coupled", "level: coupld", "solve.level: 'coupld' is not known. Did you mean \"coup"),
    ("dt: 1e-4", "dt: 0", "solve.dt: 0 is out of range"),
    ("dt: 1e-4", "dt: 1", "solve.dt: 1 s is longer than the run, until = 0.2 s"),
    ("dt: 1e-4", "samples: 1", "solve.samples: 1 is not valid. Allowed: a whole number >= 2."),
    ("dt: 1e-4", "kp: 3", "solve.kp: only for `drive: torque`"),
    ("dt: 1e-4", "rho_inf: 0.8", "solve.rho_inf: has no meaning for the integrator newmark"),
    ("dt: 1e-4", "integrator: hht", "solve.newmark: has no meaning for the integrator hht"),
    ("0.2642", "0", "solve.newmark: gamma = 0.528, beta = 0 are out of range"),
]


@pytest.mark.parametrize(("old", "new", "text"), BAD_VALUES)
def test_a_bad_value_is_named_with_its_place(tmp_path: Path, old: str, new: str, text: str) -> None:
    assert old in YAML
    with pytest.raises(DescriptionError) as caught:
        read(write(tmp_path, YAML.replace(old, new, 1)))
    assert text in str(caught.value)
    assert str(caught.value).startswith("scene.yaml")


@pytest.mark.parametrize(
    ("yaml", "text"),
    [
        ("", "scene.yaml: None is not a block"),
        ("- urdf\n", "scene.yaml: ['urdf'] is not a block"),
        ("urdf: a\nbase: fixed\nurdf: b\n", 'line 3: duplicate key "urdf", first on line 1'),
        ("urdf: a\nhome: {m: 1, m: 2}\n", 'scene.yaml, line 2: duplicate key "m", first on line 2'),
        ("urdf: a\n\tbase: fixed\n", "scene.yaml, line 2: found character '\\t'"),
        ("urdf: [a\nbase: fixed\n", "scene.yaml, line 2"),
        ("urdf: !!python/object/apply:os.getcwd []\n", "scene.yaml, line 1: could not determine"),
        ("urdf: a\n3: b\n", "the key 3 is not text. Put it in quotes."),
        ("urdf: a\nhome: " + "[" * 5000, "scene.yaml: nested too deeply"),
        ("urdf: a\nhome: " + "{a: " * 50_000, "scene.yaml: nested too deeply"),  # libyaml crashes
        ("- " * 50_000, "scene.yaml: nested too deeply"),
        ("urdf: 2020-99-99\n", "scene.yaml, line 1: '2020-99-99' is no timestamp"),
        ("urdf: \x01\n", "scene.yaml: cannot be read as YAML"),
    ],
)
def test_a_file_that_is_not_a_yaml_block_is_told_the_line(
    tmp_path: Path, yaml: str, text: str
) -> None:
    with pytest.raises(DescriptionError) as caught:
        read(write(tmp_path, yaml))
    assert text in str(caught.value)


def test_the_motion_of_a_platform_needs_one(tmp_path: Path) -> None:
    text = "urdf: bar4.urdf\nmotion: {kind: cycloid, platform: {z: 0.01}, duration: 1}\n"
    with pytest.raises(DescriptionError, match="motion: moves the platform, but .* names none"):
        read(write(tmp_path, text))


def test_aliases_that_multiply_do_not_fill_the_memory(tmp_path: Path) -> None:
    """Nine aliases of nine aliases, thirty deep: 9^30 entries if they were written out."""
    lines = ["- &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"- &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30)]
    with pytest.raises(DescriptionError, match="has more than 500000 values") as caught:
        read(write(tmp_path, "urdf: bar4.urdf\nplatform:\n" + "\n".join(lines)))
    assert len(str(caught.value)) < 200  # one line of text


# Bad URDF

CRANK = '<mass value="0.2"/>'
BAD_URDFS = [
    ("</robot>", "", "bar4.urdf, line 24: malformed XML: no element found"),
    ('<link name="base"/>', "<link name=base/>", "bar4.urdf, line 3: malformed XML: not well-f"),
    ('<robot name="bar4">', "<!DOCTYPE r><robot>", "bar4.urdf: holds a <!DOCTYPE>"),
    (
        '<robot name="bar4">',
        '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;">',
        "holds a <!DOCTYPE>",
    ),
    ("robot", "sdf", "bar4.urdf: the root element is <sdf>. A URDF has <robot>."),
    ('name="rod_2"', 'name="rod_1"', 'bar4.urdf: two of <link> are named "rod_1"'),
    ('name="base"', 'name=""', 'bar4.urdf: <link> number 1 has the name ""'),
    ('name="elbow"', 'name="universe"', '<joint> number 2 has the name "universe"'),
    ('"revolute"', '"revolut"', 'bar4.urdf: joint "motor": no such type: "revolut". Did you mean'),
    ('"revolute"', '"spherical"', "For a spherical or universal joint write fixed"),
    (
        '<parent link="crank"/>',
        '<parent link="crnk"/>',
        'joint "elbow": parent: no such link in bar4.urdf: "crnk". Did you mean "crank"?',
    ),
    ('<parent link="crank"/>', "", 'joint "elbow": parent: no such link in bar4.urdf: ""'),
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', 'joint "motor": axis: (0.0, 0.0, 0.0) has no'),
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>', '"0 1" is not three numbers'),
    (
        '<axis xyz="0 0 1"/>',
        '<axis xyz="0 0 nan"/>',
        "'nan' is not valid. Allowed: a finite number",
    ),
    ('xyz="0.1 0 0"', 'xyz="0.1 0 ${a}"', "joint \"elbow\": origin xyz: '${a}' is not valid"),
    (
        CRANK,
        '<mass value="-1"/>',
        "link \"crank\": mass: '-1' is not valid. Allowed: a finite numbe",
    ),
    (CRANK, "", 'link "crank": <inertial> has no <mass>'),
    ('iyy="1e-4"', 'iyy="nan"', "link \"crank\": inertia iyy: 'nan' is not valid"),
    ('iyy="1e-4"', "", 'link "crank": inertia iyy: None is not valid'),
    (
        'ixy="0"',
        'ixy="1"',
        'link "crank": inertia has the principal moments -0.9999, 0.0001, 1 kg m^2',
    ),
    (
        '<child link="plate"/>',
        '<child link="rod_1"/>',
        'link "rod_1" has two parents, through the joints "elbow" and "cross". A URDF is a tree: '
        "cut the loop there and close it under `loops` in the YAML.",
    ),
    (
        '<parent link="base"/><child link="rod_2"/>',
        '<parent link="plate"/><child link="rod_2"/>',
        "bar4.urdf: the links plate -> rod_2 go round",
    ),
    (
        '<joint name="tip" type="fixed"><parent link="rod_1"/><child link="rod_tip"/></joint>',
        "",
        "bar4.urdf: the links base, rod_tip have no parent",
    ),
]


@pytest.mark.parametrize(("old", "new", "text"), BAD_URDFS)
def test_a_bad_urdf_is_told_the_element(tmp_path: Path, old: str, new: str, text: str) -> None:
    assert old in URDF
    count = -1 if old == "robot" else 1
    with pytest.raises(DescriptionError) as caught:
        read(write(tmp_path, urdf=URDF.replace(old, new, count)))
    assert text in str(caught.value)


def test_a_urdf_with_one_link_round_itself_is_refused() -> None:
    text = '<robot><link name="a"/><joint name="j" type="fixed"><parent link="a"/>'
    with pytest.raises(DescriptionError, match="the links a go round"):
        check(text + '<child link="a"/></joint></robot>', "x.urdf")


def test_a_xacro_and_an_empty_robot_are_refused() -> None:
    with pytest.raises(DescriptionError, match="is a xacro, not a URDF"):
        check('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:a/></robot>', "x.urdf")
    with pytest.raises(DescriptionError, match="no <link>"):
        check("<robot/>", "x.urdf")


def test_a_long_chain_is_checked_in_its_length_only() -> None:
    """A recursive check would stop at a thousand links."""
    count = 3000
    links = "".join(f'<link name="l{i}"/>' for i in range(count))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l{i + 1}"/><child link="l{i}"/></joint>'
        for i in range(count - 1)
    )
    assert len(check(f"<robot>{links}{joints}</robot>", "x.urdf").links) == count


# Bad files


def test_a_file_that_is_not_there_leads_to_its_neighbour(tmp_path: Path) -> None:
    write(tmp_path)
    with pytest.raises(ModelNotFoundError, match='Did you mean "scene.yaml"'):
        read(tmp_path / "scen.yaml")


def test_a_folder_without_its_file_is_named(tmp_path: Path) -> None:
    write(tmp_path)
    with pytest.raises(ModelNotFoundError, match=r"holds no .*\.yaml\. .*scene\.yaml"):
        read(tmp_path)


def test_a_urdf_alone_is_a_robot_with_a_motor_in_every_joint_of_one_freedom(tmp_path: Path) -> None:
    write(tmp_path)
    robot = read(tmp_path / "bar4.urdf")
    assert robot.name == "bar4"
    assert robot.actuated == ("motor", "elbow")
    assert robot.with_overrides(["base=free_flyer"]).base == "free_flyer"


def test_a_file_of_another_kind_is_no_description(tmp_path: Path) -> None:
    (tmp_path / "bar4.stl").write_text("solid")
    with pytest.raises(DescriptionError, match='a YAML with "urdf: bar4.stl"'):
        read(tmp_path / "bar4.stl")


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(b"urdf: \xff\xfe\n")
    with pytest.raises(DescriptionError, match=r"scene.yaml is not UTF-8 text \(byte 6\)"):
        read(path)
