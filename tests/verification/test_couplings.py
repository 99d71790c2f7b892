"""Joints that follow others: mimic tags of public robots, gears against closed forms.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - mimic and `follows`: motors, mobility, positions and torques of 6 public robots (panda, talos,
      romeo, ...) | Pinocchio's rnea, summed over what a motor moves | 1e-12 | 2e-16
    - geared pendulums: swing, torque beyond a turn, frequency of a spring behind a gear | equation
      of one angle, scipy | 1e-6 rad, 1e-10, 1e-10 | passes
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import pinflex as pf
from pinflex.studies.checking.check import check
from tests.scenes import Body, load

ROUNDING = 1e-12
SMOOTH = 1e-3  # rad/s, m/s: the default smoothing speed of dry friction
WITH_MIMIC = {"panda": 1, "talos_full": 12, "romeo": 22, "tiago_pro": 10, "pr2": 10, "baxter": 2}


def public(folder: Path, name: str, more: str = "") -> pf.Mechanism:
    path = folder / "robot.yaml"
    path.write_text(f"urdf: example-robot-data:{name}\n{more}")
    return pf.load(path)


def followers(text: str) -> dict[str, tuple[str, float, float]]:
    """Mimic tags of moving joints, read here once more."""
    found = {}
    for joint in ET.fromstring(text.strip()).findall("joint"):
        tag = joint.find("mimic")
        if tag is not None and joint.get("type") != "fixed":
            law = float(tag.get("multiplier", 1)), float(tag.get("offset", 0))
            found[joint.get("name", "")] = (tag.get("joint", ""), *law)
    return found


@pytest.mark.parametrize("name", WITH_MIMIC)
def test_fingers_move_as_one_and_need_one_motor(name: str, tmp_path: Path) -> None:
    """Motors, mobility, positions; torques are Pinocchio's and friction, summed over what moves."""
    robot = public(tmp_path, name)
    model = pin.buildModelFromXML(robot.description.urdf_text)
    tags = followers(robot.description.urdf_text)
    assert len(tags) == WITH_MIMIC[name]
    assert {*robot.motors} == {*robot.coordinates} - {*tags}
    assert robot.report.mobility == len(robot.motors) == model.nv - len(tags)
    motion = pf.quintic(joints={x: 0.02 * (-1) ** k for k, x in enumerate(robot.motors)},
                        duration=0.4)  # fmt: skip
    run = pf.solve(robot, motion, level="rigid", samples=11)
    for joint, (leader, ratio, offset) in tags.items():
        led = ratio * run.joint(leader).position + offset
        np.testing.assert_allclose(run.joint(joint).position, led, atol=ROUNDING)
    data, moved = model.createData(), np.zeros((model.nv, len(robot.motors)))
    for k, motor in enumerate(robot.motors):
        moved[robot.coordinates.index(motor), k] = 1.0
    for _ in tags:  # chains in any order
        for joint, (leader, ratio, _) in tags.items():
            rows = [robot.coordinates.index(x) for x in (joint, leader)]
            moved[rows[0]] = ratio * moved[rows[1]]
    x = run.arrays
    states = zip(x["joint/q"], x["joint/v"], x["joint/a"], strict=True)
    v = x["joint/v"]
    rubs = model.damping * v + model.friction * np.tanh(v / SMOOTH)  # as Pinocchio reads the URDF
    expected = (np.array([pin.rnea(model, data, *state) for state in states]) + rubs) @ moved
    np.testing.assert_allclose(run.torque, expected, atol=ROUNDING * np.abs(expected).max())


def test_every_level_moves_both_fingers_of_a_panda(tmp_path: Path) -> None:
    tube = "{material: aluminium, section: {shape: tube, diameter: 0.08, wall: 0.004}}"
    robot = public(tmp_path, "panda", f"flexible: {{panda_link4: {tube}}}\n")
    motion = pf.quintic(joints={"panda_joint2": 0.1, "panda_finger_joint1": 0.02}, duration=0.2)
    for level in pf.LEVELS:
        run = pf.solve(robot, motion, level=level, samples=5)
        one, two = (run.joint(f"panda_finger_joint{k}").position for k in (1, 2))
        assert one[-1] == pytest.approx(0.02, abs=ROUNDING)
        np.testing.assert_allclose(two, one, atol=ROUNDING)
    assert "panda_finger_joint2 = panda_finger_joint1" in str(check(robot))


def test_a_mimic_may_be_let_go(tmp_path: Path) -> None:
    robot = public(tmp_path, "panda", "joints: {panda_finger_joint2: {follows: false}}\n")
    assert robot.report.mobility == len(robot.motors) == robot.rigid.nv == 9


# Two pendulums on gears: the small one turns `RATIO` times as far, the other way.
RATIO, OFFSET, G = -2.5, 0.4, 9.81
I1, M1, L1, I2, M2, L2 = 0.35, 2.0, 0.4, 0.02, 0.5, 0.15
GEARS = (
    Body("big", "base", "continuous", axis=(0, 1, 0), mass=M1, com=(0, 0, -L1),
         inertia=(0, I1 - M1 * L1**2, 0)),
    Body("small", "base", "continuous", xyz=(0.5, 0, 0), axis=(0, 1, 0), mass=M2,
         com=(0, 0, -L2), inertia=(0, I2 - M2 * L2**2, 0)),
)  # fmt: skip
LAW = f"small_joint: {{follows: big_joint, ratio: {RATIO}, offset: {OFFSET}}}"


def test_geared_pendulums_swing_as_the_equation_of_one_angle_says(tmp_path: Path) -> None:
    """(I1 + r^2 I2) a'' = -m1 g l1 sin a - r m2 g l2 sin(r a + o)."""
    robot = load(tmp_path, GEARS, f"actuated: []\njoints: {{{LAW}}}\nhome: {{big_joint: 1.2}}\n")
    assert (robot.report.mobility, robot.report.coupled, robot.report.rows) == (1, 1, 0)

    def rate(_: float, x: np.ndarray) -> list[float]:
        small = RATIO * x[0] + OFFSET
        pull = M1 * G * L1 * np.sin(x[0]) + RATIO * M2 * G * L2 * np.sin(small)
        return [x[1], -pull / (I1 + RATIO**2 * I2)]

    run = pf.solve(robot, level="coupled", until=2.0, samples=21, tol=1e-7)
    exact = solve_ivp(rate, (0, 2), [1.2, 0], t_eval=run.t, rtol=1e-11, atol=1e-12)
    big, small = (run.joint(f"{x}_joint").position for x in ("big", "small"))
    np.testing.assert_allclose(big, exact.y[0], atol=1e-6)  # the tolerance of a swing of 1.2 rad
    np.testing.assert_allclose(small, RATIO * big + OFFSET, atol=1e-10)


def test_turns_of_a_gear_count(tmp_path: Path) -> None:
    """Two turns of the big wheel are five of the small one: no angle is cut at a turn."""
    robot = load(tmp_path, GEARS, f"actuated: [big_joint]\njoints: {{{LAW}}}\n")
    motion = pf.quintic(joints={"big_joint": 4 * np.pi}, duration=1.0)
    run = pf.solve(robot, motion, level="rigid", samples=41)
    assert run.joint("small_joint").position[-1] == pytest.approx(RATIO * 4 * np.pi + OFFSET)
    t = run.t
    a = motion.evaluate(t)[0][:, 0]
    drag = M1 * G * L1 * np.sin(a) + RATIO * M2 * G * L2 * np.sin(RATIO * a + OFFSET)
    expected = (I1 + RATIO**2 * I2) * motion.evaluate(t)[2][:, 0] + drag
    np.testing.assert_allclose(run.torque[:, 0], expected, atol=1e-10)  # of 70 N m


def test_a_spring_on_the_far_side_of_a_gear_is_stiff_by_its_square(tmp_path: Path) -> None:
    """omega^2 = k r^2 / (I1 + r^2 I2)."""
    spring = LAW.replace("}", ", spring: 40, rest: 0.4}")
    robot = load(tmp_path, GEARS, f"gravity: [0, 0, 0]\nactuated: []\njoints: {{{spring}}}\n")
    omega = np.sqrt(40 * RATIO**2 / (I1 + RATIO**2 * I2))
    assert pf.modes(robot).frequencies == pytest.approx([omega / (2 * np.pi)], rel=1e-10)


@pytest.mark.parametrize(
    ("joints", "actuated", "said"),
    [
        ("small_joint: {follows: bg_joint}", "[]", 'no such joint in scene.urdf: "bg_joint". Did'),
        ("small_joint: {ratio: 2}", "[]", "small_joint.ratio: there is no joint to follow. Add"),
        (LAW, "[big_joint, small_joint]", "small_joint follows big_joint, so that it has no motor"),
        (f"{LAW}, big_joint: {{follows: small_joint}}", "[]", "round and round"),
        ("small_joint: {follows: big_joint}, big_joint: {type: spherical}", "[]",
         "big_joint is spherical. Couplings are between"),
    ],
)  # fmt: skip
def test_a_coupling_that_cannot_be_is_refused(
    joints: str, actuated: str, said: str, tmp_path: Path
) -> None:
    with pytest.raises(pf.DescriptionError) as error:
        load(tmp_path, GEARS, f"actuated: {actuated}\njoints: {{{joints}}}\n")
    assert said in str(error.value)
