"""Cassie as example-robot-data installs it: loops, motors, and its leaf springs by hand.

Claims:
    Machines
    - cassie: 10 motors, 4 leaf springs; heel spring alone; all four frequencies (11.8, 28.8 Hz);
      foot shakes by 0.5 to 5 mm after a squat | sqrt(k / I) by hand; Pinocchio, loops and null
      space | 1e-6; 1e-4 | passes
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import eigh, null_space
from scipy.spatial.transform import Rotation

import pinflex as pf

pytest.importorskip("example_robot_data")


@pytest.fixture(scope="module")
def robot() -> pf.Mechanism:
    return pf.load("cassie")


def test_ten_motors_determine_what_four_leaf_springs_leave(robot: pf.Mechanism) -> None:
    # 26 coordinates of the tree; a plane ball of three and a ball of three a leg, four rows of them
    # independent besides the spins; four springs
    assert len(robot.motors) == robot.report.mobility == 10
    springs = {
        name: extra.spring for name, extra in robot.description.joints.items() if extra.spring
    }
    assert springs == {
        f"{side}-{joint}": k
        for side in ("left", "right")
        for joint, k in (("knee-shin-joint", 1500.0), ("tarsus-spring-joint", 1250.0))
    }
    assert robot.idle.names == ("spin of left-achilles-rod", "spin of right-achilles-rod")


def test_the_heel_spring_alone_swings_as_by_hand() -> None:
    """f = sqrt(k / (a'Ia + m r^2)) / 2 pi, all other joints held and the rod off."""
    others = [
        "joints.{}-shin-tarsus-joint={{type: fixed}}",
        "joints.{}-knee-shin-joint={{type: fixed}}",
        "loops.{}-achilles-spring-joint=null",
    ]
    changes = [change.format(side) for side in ("left", "right") for change in others]
    # the pose of what is fixed is the file's
    home = "home={left-foot-op: -1.2, right-foot-op: -1.2, left-tarsus-crank-joint: -1.2, "
    home += "right-tarsus-crank-joint: -1.2, left-crank-rod-joint: 1.2, right-crank-rod-joint: 1.2}"
    rods_too = pf.modes(pf.load("cassie", [*changes, home]), count=8, preload="none").frequencies
    heels = rods_too[rods_too > 1]  # the loose rods have none
    # of cassie.sdf, left: the axis (0, -1, 0) of the model, 4 degrees off the link's own z
    axis = Rotation.from_euler("xyz", [1.6878, -1.3734, -0.18949]).inv().apply([0, -1, 0])
    xx, yy, zz, xy, xz, yz = 2.959e-05, 2.2231e-4, 2.007e-4, 7.15e-06, -6e-07, 1e-07
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    arm = np.cross(axis, [0.081, 0.0022, 0])
    moment = axis @ about @ axis + 0.126 * arm @ arm
    assert heels == pytest.approx(
        np.full(2, math.sqrt(1250 / moment) / (2 * math.pi)), rel=1e-6
    )  # right: its mirror


def test_its_frequencies_are_those_of_pinocchio_and_the_loops(robot: pf.Mechanism) -> None:
    """K = diag(1500, 1250, ...), M = crba, both on what loops, motors and spins leave free."""
    sides = ("left", "right")
    rods = [(f"{side}-achilles-rod", f"{side}-hip-pitch") for side in sides]
    wanted = [frame for pair in rods for frame in pair]
    robot = pf.load("cassie", [f"frames=[{', '.join(wanted)}]"])
    model, q = robot.rigid.rigid, robot.home
    data = model.createData()
    mass = pin.crba(model, data, q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)

    def place(frame: str, part: slice) -> np.ndarray:
        number = model.getFrameId(frame)
        return pin.getFrameJacobian(model, data, number, pin.LOCAL_WORLD_ALIGNED)[part]

    point, turn = slice(0, 3), slice(3, 6)
    rows = [place(x.frame_a, point) - place(x.frame_b, point) for x in robot.description.loops]
    stiff = np.zeros(model.nv)
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        extra = robot.description.joints.get(name)
        stiff[joint.idx_v] = extra.spring if extra is not None else 0.0
        if name in robot.description.actuated:
            rows.append(np.eye(model.nv)[[joint.idx_v]])
    for rod, hip in rods:
        along = data.oMf[model.getFrameId(rod)].rotation[:, 0]
        rows.append((along @ (place(rod, turn) - place(hip, turn)))[None])
    free = null_space(np.vstack(rows), rcond=1e-9)
    by_hand = np.sqrt(eigh(free.T @ np.diag(stiff) @ free, free.T @ mass @ free)[0]) / (2 * np.pi)
    ours = pf.modes(robot, count=4, preload="none").frequencies
    # the rods' spin is held by another row there, which for these thin rods is 1e-5
    assert ours == pytest.approx(by_hand, rel=1e-4)


def test_the_springs_shake_the_foot_after_the_squat(robot: pf.Mechanism) -> None:
    rigid, run = (pf.solve(robot, level=level, samples=101) for level in ("rigid", "coupled"))
    # within 1e-4, the line that `solve` prints; Pinocchio forgets rotors on oblique axes
    assert "good" in str(run).split("energy balance")[1].splitlines()[0]
    away = run.deviation_from(rigid, "left-foot")
    still = rigid.t > 0.3 + 0.01
    assert 5e-4 < np.abs(away.position[still]).max() < 5e-3
