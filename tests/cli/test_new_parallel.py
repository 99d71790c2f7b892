"""`pinflex new` on parallel robots: the joints, motors and platform proposed are those drawn."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pinflex as pf
from pinflex.__main__ import main

MASS = (
    '<inertial><origin xyz="0.05 0 0"/><mass value="0.4"/><inertia ixx="1e-3" iyy="2e-3" '
    'izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
)
Row = tuple[
    str, str, str, str, object, object, str
]  # joint, type, parent, child, place, turn, axis


def drawn(folder: Path, rows: list[Row], heavy: str) -> Path:
    """A URDF of joints; links whose names match `heavy` have a mass."""
    text = '<robot name="robot"><link name="base"/>'
    for joint, kind, parent, child, place, turn, axis in rows:
        xyz = " ".join(f"{x:.15g}" for x in np.asarray(place, dtype=float))
        rpy = " ".join(f"{x:.15g}" for x in Rotation.from_matrix(turn).as_euler("xyz"))
        axis = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}[axis]
        limit = '<limit lower="-1" upper="1" effort="9" velocity="1"/>' * (kind == "prismatic")
        text += (
            f'<link name="{child}">{MASS * bool(re.search(heavy, child))}</link>'
            f'<joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
        )
    path = folder / "robot.urdf"
    path.write_text(text + "</robot>", "utf-8")
    return path


def proposed(path: Path) -> tuple[str, pf.Mechanism]:
    """What `new` writes, and the robot with its loops and motors uncommented."""
    assert main(["new", str(path)]) == 0
    out = path.with_suffix(".yaml")
    text = out.read_text("utf-8")
    out.write_text(re.sub(r"^# (loops:|actuated:|  .*# drawn)", r"\1", text, flags=re.M), "utf-8")
    return text, pf.load(out)


def turned(axis: str, angle: float) -> np.ndarray:
    return Rotation.from_euler(axis, angle).as_matrix()


def test_a_linkage_of_bennett_is_proposed_with_hinges(tmp_path: Path) -> None:
    """Four skew hinges, a / sin alpha = b / sin beta: tan(t1/2) tan(t2/2) is constant.

    A ball at the fourth leaves it one freedom, too, but another linkage with bent links.
    Source: Hunt, Kinematic Geometry of Mechanisms (1978), ch. 11.
    """
    a, alpha, beta = 0.3, np.deg2rad(40), np.deg2rad(75)
    lengths = [a, a * np.sin(beta) / np.sin(alpha)] * 2
    twists = [alpha, beta] * 2
    constant = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    second = 2 * np.arctan(constant / np.tan(0.45))
    angles = [0.9, second, -0.9, -second]
    rows: list[Row] = []
    place, turn, end = np.zeros(3), np.eye(3), np.eye(4)
    for k, parent in enumerate(("base", "link_1", "link_2")):
        turn = turn @ turned("z", angles[k])
        rows.append((f"j{k + 1}", "continuous", parent, f"link_{k + 1}", place, turn, "z"))
        place, turn = np.array([lengths[k], 0, 0]), turned("x", twists[k])
    end[:3, :3] = turned("z", angles[3]) @ turned("x", twists[3])
    end[:3, 3] = turned("z", angles[3]) @ [lengths[3], 0, 0]
    end = np.linalg.inv(end)
    rows.append(("f3", "fixed", "link_3", "end", place, turn, "z"))
    rows.append(("f0", "fixed", "base", "seat", end[:3, 3], end[:3, :3], "z"))
    path = drawn(tmp_path, rows, "^link")
    (said,) = pf.check(pf.load(path)).warnings  # of the bare file
    assert "seat_end: {axis: z, between: [seat, end], kind: revolute}" in said
    _, robot = proposed(path)
    (loop,) = robot.description.loops
    assert (loop.kind, loop.axis, robot.report.mobility) == ("revolute", (0, 0, 1), 1)
    run = pf.solve(robot, pf.cycloid(joints={"j1": 1.5}, duration=1.0), level="rigid", samples=21)
    first, other = (run.joint(name).angle for name in ("j1", "j2"))
    product = np.tan((0.9 + first) / 2) * np.tan((second + other) / 2)
    np.testing.assert_allclose(product, constant, rtol=1e-8)  # loops are closed to 1e-10
    moved = np.ptp(run.frame("platform").position, axis=0)
    assert np.linalg.norm(moved) > 0.1 * a  # the frame at the fourth hinge only turns


def test_the_platform_is_no_rod_that_spins(tmp_path: Path) -> None:
    """RSSR: nothing says how the coupler is turned about the line of its balls; one freedom."""
    tip, seat = np.array([0.1, 0, 0]), np.array([0.3, 0.2, 0.25])
    along = Rotation.align_vectors([seat - tip], [[0, 0, 1]])[0].as_matrix()
    length, one = float(np.linalg.norm(seat - tip)), np.eye(3)
    path = drawn(tmp_path, [
        ("motor", "continuous", "base", "crank", (0, 0, 0), one, "z"),
        ("rock", "continuous", "base", "rocker", (0.3, 0.2, 0), one, "x"),
        ("end_r", "fixed", "rocker", "rocker_tip", (0, 0, 0.25), one, "z"),
        ("sx", "continuous", "crank", "c1", tip, along, "x"),
        ("sy", "continuous", "c1", "c2", (0, 0, 0), one, "y"),
        ("sz", "continuous", "c2", "coupler", (0, 0, 0), one, "z"),
        ("end_c", "fixed", "coupler", "coupler_tip", (0, 0, length), one, "z"),
    ], "crank|rocker$|coupler$")  # fmt: skip
    path.write_text(path.read_text("utf-8").replace('xyz="0.05 0 0"', 'xyz="0 0 0.05"'), "utf-8")
    text, robot = proposed(path)
    assert "platform: rocker_tip\n" in text
    assert robot.report.mobility == 1  # two by Kutzbach, one of them the spin, which is idle
    assert "motion: {kind: cycloid, joints: {motor: 0.1}" in text


def legs(count: int) -> list[Row]:
    """A plate in the x-z plane on struts between pins about y, the first of which carries it."""
    rows: list[Row] = []
    for k in range(count):
        angle = 0.5 + 2 * np.pi * k / count
        out = np.array([np.cos(angle), 0, np.sin(angle)])
        corner = 0.2 * np.array([np.cos(angle + 0.3), 0, np.sin(angle + 0.3)])
        way = corner - out
        turn = turned("y", float(np.arctan2(way[0], way[2])))
        far = (0, 0, float(np.linalg.norm(way)))
        rows += [
            (f"pin_{k}", "continuous", "base", f"drum_{k}", out, turn, "y"),
            (f"winch_{k}", "prismatic", f"drum_{k}", f"cable_{k}", far, np.eye(3), "z"),
            (f"end_{k}", "fixed", f"cable_{k}", f"end_{k}", (0, 0, 0), np.eye(3), "z"),
        ]
        if k == 0:
            rows += [
                ("hub", "continuous", "end_0", "hub", (0, 0, 0), turn.T, "y"),
                ("hub_f", "fixed", "hub", "platform", -corner, np.eye(3), "z"),
            ]
        else:
            rows.append((f"f_{k}", "fixed", "platform", f"eye_{k}", corner, np.eye(3), "z"))
    return rows


@pytest.mark.parametrize("count", [3, 4])
def test_motors_beyond_the_freedoms_are_proposed_as_such(tmp_path: Path, count: int) -> None:
    """Struts end in eyes, which are no sensors; four hold a plate in the plane once too often."""
    text, robot = proposed(drawn(tmp_path, legs(count), "^(drum|cable|platform)"))
    assert robot.report.mobility == 3  # of a plate in the plane
    assert robot.motors == tuple(f"winch_{k}" for k in range(count))
    assert ("4 motors: redundantly actuated" in text) == (count == 4)
    assert ("motors beyond the freedoms have to agree" in text) == (count == 4)


def test_half_a_universal_joint_is_an_end(tmp_path: Path) -> None:
    """3-UPU (Tsai): the yokes meet the platform in hinges about x, as in the leg that is whole."""
    rows: list[Row] = []
    one = np.eye(3)
    for k in range(3):
        angle = 2 * np.pi * k / 3
        x = np.array([-np.sin(angle), np.cos(angle), 0])
        foot, ear = 0.5 * np.cross(x, [0, 0, 1]), 0.25 * np.cross(x, [0, 0, 1])
        way = ear + [0, 0, 0.6] - foot
        z = way / np.linalg.norm(way)
        turn = np.column_stack([x, np.cross(z, x), z])
        far = (0, 0, float(np.linalg.norm(way)))
        rows += [
            (f"a_{k}", "continuous", "base", f"cross_{k}", foot, turn, "x"),
            (f"b_{k}", "continuous", f"cross_{k}", f"lower_{k}", (0, 0, 0), one, "y"),
            (f"slide_{k}", "prismatic", f"lower_{k}", f"upper_{k}", far, one, "z"),
            (f"c_{k}", "continuous", f"upper_{k}", f"yoke_{k}", (0, 0, 0), one, "y"),
        ]
        rows += [
            ("hub", "continuous", "yoke_0", "hub", (0, 0, 0), one, "x"),
            ("plate", "fixed", "hub", "platform", -turn.T @ ear, turn.T, "z"),
        ] if k == 0 else [(f"f_{k}", "fixed", "platform", f"ear_{k}", ear, turn, "z")]  # fmt: skip
    text, robot = proposed(drawn(tmp_path, rows, "^(lower|upper|platform)"))
    assert {(loop.kind, loop.axis) for loop in robot.description.loops} == {("revolute", (1, 0, 0))}
    assert "mobility 3 with these loops, as with axis z: look" in text
    run = pf.solve(robot, pf.cycloid(joints={"slide_0": 0.03}, duration=1.0), level="rigid")
    turns = run.frame("platform").rotation
    assert np.abs(turns - turns[0]).max() < 1e-7  # it translates; hinges are closed to 1e-10


UP, STRAIGHT = (0, 0, 0.9), np.eye(3)


def test_a_parallelogram_on_a_column_that_turns_has_hinges_across_it(tmp_path: Path) -> None:
    """A palletizer: nine joints less two rows of three plane loops leave three freedoms (Gruebler).

    The column carries both ends. Hinges about its axis would block the parallelograms: one
    freedom and, at the base, one joint, which looks as if it were meant.
    """
    rows: list[Row] = [
        ("j1", "continuous", "base", "column", (0, 0, 0.6), STRAIGHT, "z"),
        ("j2", "continuous", "column", "lower_arm", (0.2, 0, 0), STRAIGHT, "y"),
        ("elbow", "continuous", "lower_arm", "upper_arm", UP, STRAIGHT, "y"),
        ("f1", "fixed", "upper_arm", "rear", (-0.25, 0, 0), STRAIGHT, "x"),
        ("j3", "continuous", "column", "crank", (0.2, 0, 0), STRAIGHT, "y"),
        ("foot", "continuous", "crank", "rod", (-0.25, 0, 0), STRAIGHT, "y"),
        ("f2", "fixed", "rod", "rod_top", UP, STRAIGHT, "x"),
        ("lr1", "continuous", "column", "level_1", (0.3, -0.1, 0.1), STRAIGHT, "y"),
        ("f3", "fixed", "level_1", "level_1_end", UP, STRAIGHT, "x"),
        ("tri", "continuous", "lower_arm", "triangle", UP, STRAIGHT, "y"),
        ("f4", "fixed", "triangle", "tri_b", (0.1, -0.1, 0.1), STRAIGHT, "x"),
        ("lr2", "continuous", "triangle", "level_2", (0, -0.1, 0.15), STRAIGHT, "y"),
        ("f5", "fixed", "level_2", "level_2_end", (1, 0, 0), STRAIGHT, "x"),
        ("pitch", "continuous", "upper_arm", "wrist", (1, 0, 0), STRAIGHT, "y"),
        ("f6", "fixed", "wrist", "wrist_d", (0, -0.1, 0.15), STRAIGHT, "x"),
    ]
    path = drawn(tmp_path, rows, "column|arm|crank|^rod$|level_.$|triangle|wrist$")
    assert main(["new", str(path)]) == 0
    text = path.with_suffix(".yaml").read_text("utf-8")
    assert "{kind: revolute, between: [rear, rod_top], axis: y}" in text
    assert text.count("axis: y}  # drawn") == 3
    assert "mobility 3 with these loops: name 3 joints with a motor" in text


@pytest.mark.parametrize("right, kind", [(np.pi / 2, "revolute"), (1.57075, "planar")])
def test_a_leg_drawn_stretched_is_bent(tmp_path: Path, right: float, kind: str) -> None:
    """A five-bar leg as of Minitaur, both halves straight and one over the other: singular there.

    Four joints less two rows leave the motors' two freedoms (Gruebler). With 1.57075 for a right
    angle the hinges are not parallel, and only pins leave them.
    """
    rows: list[Row] = []
    for side, turn in (("r", turned("x", right)), ("l", turned("z", np.pi) @ turned("x", right))):
        rows += [
            (f"motor_{side}", "continuous", "base", f"drum_{side}", (0, 0, 0), turn, "z"),
            (f"f_{side}", "fixed", f"drum_{side}", f"thigh_{side}", (0, 0.06, 0),
             turned("x", -right), "x"),
            (f"knee_{side}", "continuous", f"thigh_{side}", f"shank_{side}", (0, 0, 0.055),
             STRAIGHT, "y"),
            (f"e_{side}", "fixed", f"shank_{side}", f"foot_{side}", (0, 0, 0.2), STRAIGHT, "x"),
        ]  # fmt: skip
    path = drawn(tmp_path, rows, "drum|thigh|shank")
    assert main(["new", str(path)]) == 0
    out = path.with_suffix(".yaml")
    text = out.read_text("utf-8")
    assert f"kind: {kind}, between:" in text
    assert "GUESS: the pose drawn is singular" in text
    taken = re.sub(r"^# (loops:|home:|actuated:|  .*# drawn)", r"\1", text, flags=re.M)
    out.write_text(taken, "utf-8")
    robot = pf.load(out)
    assert (robot.report.mobility, robot.motors) == (2, ("motor_r", "motor_l"))
    assert robot.report.sigma_min > 0.05  # of a well-placed machine


def test_cylinders_with_an_effort_limit_are_the_motors_beside_a_passive_slider(
    tmp_path: Path,
) -> None:
    """A pivoted ram pushed by two cylinders, a Tricept in the plane.

    Grubler: 6 joints less two pins of two rows each leave 2 freedoms; three joints slide.
    """
    reach, half = 0.5, 0.3
    rows: list[Row] = [
        ("pivot", "continuous", "base", "tube", np.zeros(3), np.eye(3), "z"),
        ("slide", "prismatic", "tube", "ram", np.array([0.2, 0, 0]), np.eye(3), "x"),
    ]
    for k, side in ((1, 1), (2, -1)):
        lean = turned("z", -side * np.arctan2(half, reach))
        rest = np.array([np.hypot(reach, half) - 0.2, 0, 0])
        rows += [
            (f"pin_{k}", "continuous", "base", f"barrel_{k}", [0, side * half, 0], lean, "z"),
            (f"leg_{k}", "prismatic", f"barrel_{k}", f"rod_{k}", [0.2, 0, 0], np.eye(3), "x"),
            (f"eye_{k}", "fixed", f"rod_{k}", f"end_{k}", rest, np.eye(3), "z"),
            (f"seat_{k}", "fixed", "ram", f"lug_{k}", [reach - 0.2, 0, 0], np.eye(3), "z"),
        ]
    path = drawn(tmp_path, rows, "^(tube|ram|barrel_.|rod_.)$")
    path.write_text(path.read_text("utf-8").replace('effort="9"', 'effort="0"', 1), "utf-8")
    text, robot = proposed(path)
    assert robot.report.mobility == 2
    assert robot.motors == ("leg_1", "leg_2")
    assert "actuated: [leg_1, leg_2]  # mobility 2 with these loops" in text


def wishbones(ball: str, axes: str) -> list[Row]:
    """An upright between two wishbones that turn about x; its lower joint as a file draws it."""
    lower: list[Row] = [
        ("hinge_l", "continuous", "base", "lower_arm", (0, 0.2, 0), STRAIGHT, "x"),
        ("hinge_u", "continuous", "base", "upper_arm", (0, 0.25, 0.25), STRAIGHT, "x"),
        ("f1", "fixed", "upper_arm", "upper_tip", (0, 0.28, 0), STRAIGHT, "z"),
    ]
    parts = ["lower_arm", *(f"part_{k}" for k in range(len(axes) - 1)), "upright"]
    for k, axis in enumerate(axes):
        place = (0, 0, 0) if k else (0, 0.35, 0)
        lower.append((ball + axis, "continuous", *parts[k : k + 2], place, STRAIGHT, axis))
    seat = (0, -0.02, 0.25)
    return [*lower, ("f2", "fixed", "upright", "upright_top", seat, STRAIGHT, "z")]


@pytest.mark.parametrize(("ball", "axes"), [("ball_", "x"), ("motor_", "xyz")])
def test_a_double_wishbone_has_balls(tmp_path: Path, ball: str, axes: str) -> None:
    """One named a ball and drawn as a hinge, one drawn as three hinges: it travels and steers.

    Grubler: two hinges and a ball less the three rows of another leave two freedoms. Hinges about
    x fit as well, and leave two of the three drawn no motion.
    """
    rows = wishbones(ball, axes)
    rows[0] = ("motor_l" if ball == "motor_" else "hinge_l", *rows[0][1:])
    rows = [(row[0].replace("motor_x", "b_x").replace("motor_y", "b_y").replace("motor_z", "b_z"),
             *row[1:]) for row in rows]  # fmt: skip
    path = drawn(tmp_path, rows, "arm|upright$")
    assert main(["new", str(path)]) == 0
    text = path.with_suffix(".yaml").read_text("utf-8")
    assert re.search(
        "kind: spherical, between: .(upper_tip, upright_top|upright_top, upper_tip)]", text
    )
    assert "mobility 2 with these loops" in text
    assert ("joints: {ball_x: {type: spherical}}" in text) == (ball == "ball_")


def test_the_linkage_of_sarrus_is_closed_by_a_hinge(tmp_path: Path) -> None:
    """Two folding legs of three hinges, their planes at right angles: the plate goes up and down.

    By Grubler it is rigid; a ball would leave it two freedoms, as many as hinges on its base.
    """
    bend, length = 0.8, 0.2
    rows: list[Row] = []
    for k, yaw in ((1, 0.0), (2, np.pi / 2)):
        turn = turned("z", yaw)
        rows += [
            (f"foot_{k}", "continuous", "base", f"low_{k}", turn @ [-0.15, 0, 0],
             turn @ turned("y", -bend), "y"),
            (f"knee_{k}", "continuous", f"low_{k}", f"up_{k}", (length, 0, 0),
             turned("y", 2 * bend - np.pi), "y"),
        ]  # fmt: skip
    back = turned("y", np.pi - bend)
    rows += [
        ("top_1", "continuous", "up_1", "platform", (length, 0, 0), back, "y"),
        ("f1", "fixed", "platform", "ear", (0.15, -0.15, 0), turned("z", np.pi / 2), "z"),
        ("f2", "fixed", "up_2", "end", (length, 0, 0), back, "z"),
    ]
    path = drawn(tmp_path, rows, "low|up_|platform")
    assert main(["new", str(path)]) == 0
    out = path.with_suffix(".yaml")
    text = out.read_text("utf-8")
    assert "between: [ear, end], axis: y}" in text
    assert "mobility 1 with these loops: name 1 joint" in text
    taken = re.sub(r"^# (loops:|actuated:|  .*# drawn)", r"\1", text, flags=re.M)
    out.write_text(taken.replace("[...]", "[foot_1]"), "utf-8")
    run = pf.solve(pf.load(out), pf.cycloid(joints={"foot_1": -0.3}, duration=1.0), level="rigid")
    plate = run.frame("platform")
    lifted = 2 * length * (np.sin(bend + 0.3) - np.sin(bend))
    way = plate.position[-1] - plate.position[0]
    np.testing.assert_allclose(way, [0, 0, lifted], atol=1e-9)  # loops are closed to 1e-10
    assert np.abs(plate.rotation - plate.rotation[0]).max() < 1e-8


def test_a_pose_that_closes_but_cannot_move_is_not_said_to_stay_open(tmp_path: Path) -> None:
    """Three hinges less the three rows of a ball: no freedom (Gruebler); a ball is missing."""
    path = drawn(tmp_path, wishbones("steer_", "z"), "arm|upright$")
    assert main(["new", str(path)]) == 0
    text = path.with_suffix(".yaml").read_text("utf-8")
    assert "mobility 0 with these loops: a joint is of another type" in text


@pytest.mark.parametrize("effort", [60, 0])
def test_two_arms_whose_tips_are_near_are_open(tmp_path: Path, effort: float) -> None:
    """Each joint has a motor by its effort limit; where none has one, it may be a loop."""
    rows: list[Row] = []
    for side, y in (("l", 0.1), ("r", -0.1)):
        rows += [
            (f"a_{side}", "revolute", "base", f"upper_{side}", (0, y, 0), STRAIGHT, "z"),
            (f"b_{side}", "revolute", f"upper_{side}", f"fore_{side}", (0.3, 0, 0), STRAIGHT, "z"),
            (f"f_{side}", "fixed", f"fore_{side}", f"tip_{side}", (0.2, 0, 0), STRAIGHT, "z"),
        ]
    path = drawn(tmp_path, rows, "upper|fore")
    limit = f'<limit lower="-2" upper="2" effort="{effort}" velocity="1"/></joint>'
    text = path.read_text("utf-8").replace('xyz="0 0 1"/></joint>', f'xyz="0 0 1"/>{limit}')
    path.write_text(text, "utf-8")
    assert main(["new", str(path)]) == 0
    assert ("# loops:" in path.with_suffix(".yaml").read_text("utf-8")) == (effort == 0)


def test_efforts_name_the_motors_where_names_leave_a_freedom(tmp_path: Path) -> None:
    """A leg with a parallelogram: `drive` is a motor by its name, `hip` by its effort limit."""
    rows: list[Row] = [
        ("hip", "revolute", "base", "thigh", (0, 0, 0), turned("y", 1.2), "y"),
        ("knee", "revolute", "thigh", "shank", (0.3, 0, 0), turned("y", 0.9), "y"),
        ("f1", "fixed", "shank", "foot", (0.42, 0, 0), STRAIGHT, "x"),
        ("f2", "fixed", "shank", "shank_pin", (-0.1, 0, 0), STRAIGHT, "x"),
        ("drive", "revolute", "base", "lever", (0, 0, 0), turned("y", 2.1 + np.pi), "y"),
        ("pin", "revolute", "lever", "rod", (0.1, 0, 0), turned("y", -0.9 - np.pi), "y"),
        ("f3", "fixed", "rod", "rod_end", (0.3, 0, 0), STRAIGHT, "x"),
    ]
    path = drawn(tmp_path, rows, "thigh|shank$|lever|rod$")
    text = path.read_text("utf-8")
    for name in ("hip", "knee", "drive", "pin"):
        effort = 40 if name in ("hip", "drive") else 0
        limit = f'<limit lower="-2" upper="2" effort="{effort}" velocity="8"/></joint>'
        start = text.index(f'<joint name="{name}"')
        text = text[:start] + text[start:].replace("</joint>", limit, 1)
    path.write_text(text, "utf-8")
    written, robot = proposed(path)
    assert "actuated: [hip, drive]  # mobility 2 with these loops" in written
    assert robot.report.mobility == 2  # four joints less two rows of a plane loop
