"""A threefold symmetric machine that turns about its centre: no leg is told from another.

A 3-RRR whose platform hangs on the first leg in the tree of its URDF and is closed to the others.
What it does may not depend on that.

Claims:
    Levels, energy, steps
    - three equal legs that turn about their centre share alike, whichever carries the tree: rigid,
      quasistatic, coupled; ked to second order | the symmetry; 1e-6 of the peak and 1e-8 m (ked
      1e-5, 9e-4 m) | 2e-8, 1e-9 m; ked 7e-7, 5e-4 m
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
from tests.scenes import Body, load

BASE, LINK, CORNER = 0.35, 0.25, 0.10  # [m] radius of the motors, length, radius of the platform
_BEND = math.acos((BASE - CORNER) / 2 / LINK)  # [rad] of each link off the line to the centre
_SLIM = (1e-4, 1e-3, 1e-3)  # [kg m^2]


def _leg(k: int) -> list[Body]:
    at = 2 * math.pi * k / 3
    foot = (BASE * math.cos(at), BASE * math.sin(at), 0.0)
    half = (LINK / 2, 0.0, 0.0)
    return [
        Body(f"crank_{k}", "base", "revolute", xyz=foot, mass=0.5, com=half, inertia=_SLIM),
        Body(f"rod_{k}", f"crank_{k}", "revolute", (LINK, 0, 0), mass=0.3, com=half, inertia=_SLIM),
        Body(f"tip_{k}", f"rod_{k}", xyz=(LINK, 0, 0)),
    ]  # fmt: skip


def _corner(k: int) -> Body:
    at = 2 * math.pi * k / 3
    return Body(f"corner_{k}", "plate", xyz=(CORNER * (math.cos(at) - 1), CORNER * math.sin(at), 0))


def machine(folder: Path) -> pf.Mechanism:
    middle = (-CORNER, 0.0, 0.0)  # of the platform, seen from its first corner
    plate = Body("plate", "tip_0", "revolute", mass=2.0, com=middle, inertia=(0.02, 0.02, 0.04))
    bodies = [body for k in range(3) for body in _leg(k)]
    bodies += [plate, Body("centre", "plate", xyz=middle), _corner(1), _corner(2)]
    home = {f"crank_{k}_joint": 2 * math.pi * k / 3 + math.pi + _BEND for k in range(3)}
    home |= {f"rod_{k}_joint": -2 * _BEND for k in range(3)} | {"plate_joint": _BEND - math.pi}
    yaml = f"""
gravity: [0, 0, 0]
actuated: [crank_0_joint, crank_1_joint, crank_2_joint]
loops:
  pin_1: {{kind: planar, between: [tip_1, corner_1], axis: z}}
  pin_2: {{kind: planar, between: [tip_2, corner_2], axis: z}}
home: {home}
platform: centre
flexible:
  "crank_?":
    material: {{E: 7.0e10, nu: 0.3, rho: 2700}}
    section: {{shape: rectangle, width: 0.03, thickness: 0.006}}
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
damping: {{modal: 0.02}}
"""
    return load(folder, bodies, yaml)


MOTION = pf.quintic(platform={"rz": 0.4, "x": 0.0, "y": 0.0}, duration=0.12)
# level, keys, torques off their mean (of the peak), platform off the centre [m]
CASES: list[tuple[str, dict[str, Any], float, float]] = [
    ("rigid", {}, 1e-12, 1e-12),  # round-off
    ("quasistatic", {}, 1e-10, 1e-11),  # what a balance to round-off leaves
    ("quasistatic", {"tol": 1e-4}, 1e-6, 1e-8),
    ("quasistatic", {"samples": 11}, 1e-10, 1e-11),  # from instant to instant
    ("coupled", {"tol": 1e-6}, 1e-6, 1e-8),
    # Linear about the rigid motion: of second order in the links' slope, which is below 0.06 rad.
    ("ked", {"tol": 1e-4}, 1e-5, LINK * 0.06**2),
]


@pytest.mark.parametrize("level, keys, alike, centred", CASES)
def test_three_equal_legs_share_alike(
    level: str, keys: dict[str, Any], alike: float, centred: float, tmp_path: Path
) -> None:
    run = pf.solve(machine(tmp_path), MOTION, level=level, until=0.12, **({"samples": 61} | keys))
    torque, peak = run.torque, np.abs(run.torque).max()
    assert peak > 6.0  # [N m]
    assert np.abs(torque - torque.mean(axis=1, keepdims=True)).max() < alike * peak
    assert np.abs(run.array("frame/centre/position")[:, :2]).max() < centred
    if level != "rigid":
        assert np.abs(run.array("eta")).max() > 0.02  # bent: the pose is not the rigid one


def test_a_quasistatic_motion_meets_its_loops_in_speed(tmp_path: Path) -> None:
    """Velocity of the closing corners, out of their positions and as the run has it."""
    robot = machine(tmp_path)
    run = pf.solve(robot, MOTION, level="quasistatic", until=0.12, samples=61)
    y = np.hstack([run.array("joint/q"), run.array("eta")])
    v = np.hstack([run.array("joint/v"), run.array("eta_v")])
    dynamics = Equations(robot.flexible)
    opening = [dynamics.close(y[k]).J @ v[k] for k in range(len(y))]
    assert np.abs(v).max() > 1.0
    assert np.abs(opening).max() < 1e-12  # [m/s], round-off
