"""More motors than freedoms: a plate in the plane on four struts, held and moved.

Level rigid is the limit of stiff drives: the balance with the least sum of f^2 / k. The reference
knows points, lines and Lagrange multipliers, and nothing of joints and loops.

Claims:
    Levels, energy, steps
    - four motors for three freedoms: level rigid takes the least sum of f^2/k; quasistatic and
      coupled with drives tend to it like 1/k | pseudo-inverse of the struts' lines; -1 +- 0.1 |
      1e-6; passes
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.studies.checking.check import check
from tests.finite import slope
from tests.scenes import Body, load

BASES = np.array([(-0.9, -0.5), (-0.5, -0.8), (0.8, -0.6), (1.0, 0.4)])  # [m] in the x-y plane
CORNERS = np.array([(-0.15, 0.0), (-0.1, -0.1), (0.12, -0.08), (0.15, 0.05)])  # seen from the plate
MASS, TURN, G = 10.0, 0.4, 9.81  # [kg], [kg m^2], [m/s^2]
ROD = 1e-7  # [kg] of the parts of a strut: nothing, but for the tree


def struts() -> tuple[list[Body], dict[str, float]]:
    """Each from its base to its corner with the plate at (0, 0), the plate carried by the first."""
    light = {"mass": ROD, "inertia": (ROD, ROD, ROD)}
    bodies, home = [], {}
    for k, (base, corner) in enumerate(zip(BASES, CORNERS, strict=True)):
        line = corner - base
        angle, length = float(np.arctan2(line[1], line[0])), float(np.linalg.norm(line))
        bodies += [
            Body(f"swing_{k}", "base", "revolute", xyz=(*base, 0), **light),
            Body(f"slide_{k}", f"swing_{k}", "prismatic", axis=(1, 0, 0), **light),
        ]
        home |= {f"swing_{k}_joint": angle, f"slide_{k}_joint": length}
    com = (-CORNERS[0][0], -CORNERS[0][1], 0.0)
    bodies.append(Body("carrier", "slide_0", "revolute", mass=MASS, com=com, inertia=(1, 1, TURN)))
    home["carrier_joint"] = -home["swing_0_joint"]
    bodies.append(Body("plate", "carrier", xyz=com))
    corners = enumerate(CORNERS[1:], 1)
    bodies += [Body(f"corner_{k}", "plate", xyz=(*corner, 0)) for k, corner in corners]
    return bodies, home


def machine(
    folder: Path, stiffness: tuple[float, ...] | None = None, motors: str = "0123", more: str = ""
) -> pf.Mechanism:
    bodies, home = struts()
    drives = ""
    for k, value in enumerate(stiffness or ()):
        drives += f"  slide_{k}_joint: {{drive: {{motor_inertia: 1e-3, stiffness: {value!r}}}}}\n"
    loops = "\n".join(
        f"  p{k}: {{kind: planar, between: [slide_{k}, corner_{k}], axis: z}}" for k in (1, 2, 3)
    )
    yaml = f"""
gravity: [0, {-G}, 0]
actuated: [{", ".join(f"slide_{k}_joint" for k in motors)}]
{"joints:" if drives else ""}
{drives}
loops:
{loops}
home: {home}
platform: plate
{more}
"""
    return load(folder, bodies, yaml)


def wrenches(x: float, y: float, turn: float) -> Array:
    """Force and moment about the plate centre that each strut of 1 N gives, shape (3, 4)."""
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    arms = CORNERS @ R.T
    lines = np.array([x, y]) + arms - BASES
    u = lines / np.linalg.norm(lines, axis=1)[:, None]
    return np.array([u[:, 0], u[:, 1], arms[:, 0] * u[:, 1] - arms[:, 1] * u[:, 0]])


def shared(W: Array, wrench: Array, stiffness: Array) -> Array:
    """Forces f with W f = wrench and the least sum of f^2 / k."""
    root = np.sqrt(stiffness)
    return np.asarray(root * (np.linalg.pinv(W * root) @ wrench))


EQUAL, UNEQUAL = np.ones(4), np.array([1.0, 3.0, 0.5, 2.0])
HOLD = pf.quintic(platform={"x": 0.0, "y": 0.0, "rz": 0.0}, duration=0.1)
MOVE = pf.quintic(platform={"x": 0.1, "y": -0.05, "rz": 0.2}, duration=0.4)


def test_level_rigid_takes_the_least_forces_and_says_so(tmp_path: Path) -> None:
    run = pf.solve(machine(tmp_path), MOVE, level="rigid", samples=21)
    u = run.t / 0.4
    s = 10 * u**3 - 15 * u**4 + 6 * u**5
    dds = (60 * u - 180 * u**2 + 120 * u**3) / 0.16
    for k in range(21):
        W = wrenches(0.1 * s[k], -0.05 * s[k], 0.2 * s[k])
        need = np.array([MASS * 0.1 * dds[k], MASS * (G - 0.05 * dds[k]), TURN * 0.2 * dds[k]])
        # The mass of the rods, 1e-6 kg in all, at 10 m/s^2.
        np.testing.assert_allclose(run.torque[k], shared(W, need, EQUAL), rtol=1e-6, atol=1e-4)
    assert any("4 motors for 3 degrees of freedom" in said for said in run.meta["warnings"])


@pytest.mark.parametrize("ratios", [EQUAL, UNEQUAL], ids=["equal", "unequal"])
@pytest.mark.parametrize("level", ["quasistatic", "coupled"])
def test_stiff_drives_tend_to_it(level: str, ratios: Array, tmp_path: Path) -> None:
    weight = np.array([0.0, MASS * G, 0.0])
    gaps, stiffness = [], (2e5, 2e6, 2e7)  # [N/m]
    for k in stiffness:
        robot = machine(tmp_path, tuple((k * ratios).tolist()))
        runs = [
            pf.solve(robot, HOLD, level=x, samples=5, **({"tol": 1e-4} if x == "coupled" else {}))
            for x in ("rigid", level)
        ]
        rigid, found = (run.torque[-1] for run in runs)
        np.testing.assert_allclose(rigid, shared(wrenches(0, 0, 0), weight, ratios), rtol=1e-6)
        gaps.append(float(np.max(np.abs(found - rigid))))
    # 0.1: the next power of 1/k, and the time error of coupled.
    assert slope(stiffness, gaps) == pytest.approx(-1.0, abs=0.1)
    assert gaps[-1] < 1e-3 * np.max(np.abs(rigid))


def test_a_drive_without_stiffness_is_the_stiffest(tmp_path: Path) -> None:
    """One strut with a soft drive beside three that have none: it carries nothing more."""
    robot = machine(tmp_path, (1e5,))
    run = pf.solve(robot, HOLD, level="rigid", samples=3)
    weight = np.array([0.0, MASS * G, 0.0])
    three = np.linalg.solve(wrenches(0, 0, 0)[:, 1:], weight)
    np.testing.assert_allclose(run.torque[0, 1:], three, rtol=1e-4)  # 1e-6 of the compliance
    assert abs(run.torque[0, 0]) < 1e-4 * np.max(np.abs(three))


def test_check_says_how_they_share_and_keeps_its_advice_for_motors_that_fight(
    tmp_path: Path,
) -> None:
    moved = {
        "platform": "motion: {kind: quintic, platform: {x: 0.1, y: 0, rz: 0}, duration: 1}",
        "joints": "motion: {kind: quintic, joints: {slide_0_joint: 0.1}, duration: 1}",
    }
    for target, motion in moved.items():
        said = " ".join(check(machine(tmp_path, more=motion)).warnings)
        assert "least sum of torque^2" in said
        assert ("prescribe the platform's motion" in said) == (target == "joints")


def test_another_way_to_share_is_refused(tmp_path: Path) -> None:
    assert machine(tmp_path, more="share: least").description.share == "least"
    with pytest.raises(pf.DescriptionError, match="share: 'most' is not known. Allowed: least"):
        machine(tmp_path, more="share: most")


def test_without_anything_that_gives_way_the_elastic_levels_say_so(tmp_path: Path) -> None:
    keys: dict[str, Any] = {"samples": 3}
    with pytest.raises(pf.MotionError, match="no one answer"):
        pf.solve(machine(tmp_path), HOLD, level="quasistatic", **keys)
