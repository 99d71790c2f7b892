"""The ground as a frame of a loop: robots on a free base that stand on their feet.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a leg on a free base, its foot welded to the ground = the leg built on the ground, every level
      | second formulation | 1e-12; 2e-4, ked 1e-3 | 3e-16; 5e-5, 4e-4
    - a quadruped on four feet: every level; the feet bear its weight; a tool pinned at a point |
      balance of forces; triangle | 1e-6, ked 1e-3; 1e-12 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load

L, M, G = 0.5, 4.0, 9.81
TRUNK = {"mass": M, "inertia": (0.05, 0.06, 0.04)}
SHANK = {"mass": 1.2, "inertia": (0.03, 0.03, 0.002)}
# The same leg from the ground up, and from the trunk down.
STANDING = (
    Body("shank", "base", "revolute", axis=(0, 1, 0), com=(0, 0, L / 2), **SHANK),
    Body("trunk", "shank", "revolute", xyz=(0, 0, L), axis=(0, 1, 0), com=(0.05, 0, 0.1), **TRUNK),
)
FLYING = (
    Body("trunk", "base", com=(0.05, 0, 0.1), **TRUNK),
    Body("shank", "base", "revolute", axis=(0, -1, 0), com=(0, 0, -L / 2), **SHANK),
    Body("foot", "shank", "revolute", xyz=(0, 0, -L), axis=(0, -1, 0), mass=0.3,
         inertia=(1e-3, 1e-3, 1e-3)),
)  # fmt: skip
FLEXIBLE = """
flexible:
  shank:
    material: {E: 7e10, nu: 0.3, rho: 5000}
    section: {shape: tube, diameter: 0.04, wall: 0.002}
"""
STANDS = """
actuated: [shank_joint, trunk_joint]
home: {shank_joint: 0.4, trunk_joint: -0.3}
platform: trunk
"""
FLIES = f"""
base: free_flyer
actuated: [foot_joint, shank_joint]
home: {{foot_joint: 0.4, shank_joint: -0.3,
        root_joint: [{L * np.sin(0.4)}, 0, {L * np.cos(0.4)}, 0, 0.1, 0]}}
loops: {{sole: {{kind: weld, between: [foot, world]}}}}
platform: trunk
"""


@pytest.mark.parametrize("level", pf.LEVELS)
def test_a_leg_held_at_its_foot_is_the_leg_built_on_the_ground(level: str, tmp_path: Path) -> None:
    runs = []
    legs = ((STANDING, STANDS, ("shank", "trunk")), (FLYING, FLIES, ("foot", "shank")))
    for bodies, yaml, (ankle, knee) in legs:
        robot = load(tmp_path, bodies, yaml + FLEXIBLE)
        assert robot.report.mobility == len(robot.motors) == 2
        joints = {f"{ankle}_joint": 0.2, f"{knee}_joint": -0.3}
        run = pf.solve(robot, pf.quintic(joints=joints, duration=0.3), level=level, samples=13,
                       dt=5e-4)  # fmt: skip
        torque = np.column_stack([run.joint(f"{x}_joint").torque for x in (ankle, knee)])
        runs.append((run, torque))
    (one, expected), (two, torque) = runs
    # Rigid: round-off. Else the same beam is clamped at its other end: what two internal modes and
    # the second order leave, 3 mm / 0.5 m squared, at level ked what the second order makes.
    accuracy = {"rigid": 1e-12, "ked": 1e-3}.get(level, 2e-4)
    np.testing.assert_allclose(torque, expected, atol=accuracy * np.abs(expected).max())
    away = two.frame("trunk").position - one.frame("trunk").position
    assert np.abs(away).max() < (1e-12 if level == "rigid" else 1e-6)  # [m], of 3 mm


LEGS = ("FL", "FR", "RL", "RR")


def quadruped(folder: Path, motors: str, more: str = "") -> pf.Mechanism:
    home = ", ".join(f"{x}_thigh_joint: 0.8, {x}_calf_joint: -1.5" for x in LEGS)
    feet = ", ".join(f"{x}: {{kind: spherical, between: [{x}_foot, world]}}" for x in LEGS)
    path = folder / "go2.yaml"
    path.write_text(
        f"urdf: example-robot-data:go2\nbase: free_flyer\nplatform: base\nactuated: [{motors}]\n"
        f"home: {{root_joint: [0, 0, 0.3, 0, 0, 0], {home}}}\nloops: {{{feet}}}\n{more}"
    )
    return pf.load(path)


SIX = "FL_hip_joint, FL_thigh_joint, FL_calf_joint, FR_thigh_joint, FR_calf_joint, RL_calf_joint"
EVERY = ", ".join(f"{x}_{j}_joint" for x in LEGS for j in ("hip", "thigh", "calf"))
THIGH = """flexible:
  FL_thigh: {material: aluminium, section: {shape: tube, diameter: 0.03, wall: 0.002}}
"""
SQUAT = pf.quintic(platform={"x": 0.0, "y": 0.0, "z": -0.02, "rz": 0.0, "ry": 0.0, "rx": 0.02},
                   duration=0.2)  # fmt: skip


def test_a_quadruped_on_four_feet_runs_every_level_and_bears_its_weight(tmp_path: Path) -> None:
    robot = quadruped(tmp_path, SIX, THIGH)
    assert robot.report.mobility == len(robot.motors) == 6
    weight = sum(link.inertia.mass for link in robot.links) * G
    for level in pf.LEVELS:
        run = pf.solve(robot, SQUAT, level=level, samples=9, until=0.2)
        borne = -sum(run.loop(x).force[0] for x in LEGS)  # on the feet, at rest at the start
        up = np.array([0, 0, weight])
        # ked: linear about the rigid pose; what it leaves is of second order in the deflection.
        np.testing.assert_allclose(-borne, -up, atol=(1e-3 if level == "ked" else 1e-6) * weight)
        assert run.frame("base").position[-1, 2] == pytest.approx(0.28, abs=1e-3)


def test_twelve_motors_share_the_load_at_level_rigid_and_are_refused_elsewhere(
    tmp_path: Path,
) -> None:
    robot = quadruped(tmp_path, EVERY, THIGH)
    run = pf.solve(robot, SQUAT, level="rigid", samples=5)
    assert np.isfinite(run.torque).all()
    with pytest.raises(pf.MotionError, match="12 motors prescribe a mechanism of mobility 6"):
        pf.solve(robot, SQUAT, level="coupled", samples=5)


def test_a_tool_is_held_at_a_given_point(tmp_path: Path) -> None:
    """A two-link arm whose hand is pinned at (0.6, 0.3): the angles of the triangle."""
    a = 0.5
    arm = (
        Body("upper", "base", "revolute", axis=(0, 0, 1), mass=1, inertia=(0.1, 0.1, 0.1)),
        Body("lower", "upper", "revolute", xyz=(a, 0, 0), axis=(0, 0, 1), mass=1,
             inertia=(0.1, 0.1, 0.1)),
        Body("hand", "lower", xyz=(a, 0, 0)),
    )  # fmt: skip
    yaml = """
actuated: []
home: {upper_joint: 0.0, lower_joint: 1.0}
loops: {grip: {kind: planar, between: [hand, world], at: [0.6, 0.3, 0]}}
"""
    robot = load(tmp_path, arm, yaml)
    reach = np.hypot(0.6, 0.3)
    elbow = np.pi - 2 * np.arcsin(reach / 2 / a)
    assert robot.home == pytest.approx([np.arctan2(0.3, 0.6) - elbow / 2, elbow], abs=1e-12)
    assert robot.report.mobility == 0


@pytest.mark.parametrize(
    ("loop", "said"),
    [
        ("{kind: weld, between: [world, world]}", "the ground cannot be held to itself"),
        ("{kind: weld, between: [hand, upper], at: [0, 0, 0]}", "neither frame is world"),
        ("{kind: slider, between: [upper, world]}", "a sleeve needs a frame of the robot"),
        ("{kind: distance, between: [hand, world]}", "a distance of zero"),
    ],
)
def test_a_loop_to_the_ground_that_cannot_be_is_refused(
    loop: str, said: str, tmp_path: Path
) -> None:
    arm = (Body("upper", "base", "revolute", mass=1), Body("hand", "upper", xyz=(1, 0, 0)))
    with pytest.raises(pf.DescriptionError, match=said):
        load(tmp_path, arm, f"actuated: []\nloops: {{grip: {loop}}}\n")
