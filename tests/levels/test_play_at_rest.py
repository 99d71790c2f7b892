"""Equilibria with play: where pins, gears and cables come to rest, beside closed forms.

Claims:
    Levels, energy, steps
    - equilibria with play: a bead in its hole and its two frequencies, a gear on its flank, a slack
      cable, the 3-RRR under a load at the end of its play and, moving, with one loose pin | closed
      forms; the rigid play; the ideal joint | 1e-7 to 1e-10; 3 %; order 1 within 0.02 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.studies.checking.check import check
from tests.finite import slope
from tests.scenes import Body, load
from tests.verification.test_clearance import FLYING, GAP, MASS, PIN, K

G = 9.81
HUNG = """gravity: [0, -9.81, 0]
actuated: []
loops: {joint: {kind: planar, between: [hole, pin], clearance: %r, pin: %r}}
solve: {level: coupled, start: static}
""" % (GAP, PIN)  # noqa: UP031  (braces of YAML)
DEEP = (MASS * G / K) ** (2 / 3)  # [m] that Hertz's contact gives way by


def test_a_pin_hangs_at_the_bottom_of_its_hole_and_swings_there(tmp_path: Path) -> None:
    """A bead in a bowl of radius c + x: g / (c + x) across, 1.5 K x^(1/2) / m along."""
    robot = load(tmp_path, FLYING, HUNG)
    at = pf.static_equilibrium(robot, free_motors=True)
    np.testing.assert_allclose(at.y, [0.0, -(GAP + DEEP)], rtol=1e-9, atol=1e-12)
    found = pf.modes(robot, free_motors=True).frequencies
    exact = np.sqrt([G / (GAP + DEEP), 1.5 * K * DEEP**0.5 / MASS]) / (2 * np.pi)
    np.testing.assert_allclose(found, exact, rtol=1e-7)  # 1e-9 kg of 0.3 move in x alone


def test_a_run_that_starts_there_stays_there(tmp_path: Path) -> None:
    run = pf.solve(load(tmp_path, FLYING, HUNG), pf.hold(duration=0.05), tol=1e-4)
    assert np.ptp(run.array("joint/q"), axis=0).max() < 1e-6 * GAP
    assert not run.events


def test_without_a_load_it_stays_in_the_middle_and_says_so(tmp_path: Path) -> None:
    arm = [
        Body("arm", "base", "revolute", mass=1.0, com=(0.2, 0, 0)),
        Body("tip", "arm", xyz=(0.4, 0, 0)),
    ]
    drive = """gravity: [0, %r, 0]
joints: {arm_joint: {drive: {motor_inertia: 1e-3, stiffness: 200, backlash: 0.5 deg}}}
"""
    away, half = 0.2 * G / 200, np.radians(0.25)
    robot = load(tmp_path, arm, drive % -G)
    run = pf.solve(robot, pf.hold(duration=0.1), level="quasistatic", samples=3)
    # It lies on the lower flank: M g l cos(eta) / k beyond it.
    eta = float(run.drive("arm_joint").deflection[0])
    assert eta == pytest.approx(-(half + away * np.cos(eta)), rel=1e-10)
    assert not any("loose at home" in text for text in check(robot).warnings)
    still = load(tmp_path, arm, drive % 0.0)
    run = pf.solve(still, pf.hold(duration=0.1), level="quasistatic", samples=3)
    assert np.all(run.drive("arm_joint").deflection == 0.0)
    assert any("nothing holds what has play in 1 direction" in x for x in run.meta["warnings"])
    assert any("loose at home" in x and "play of arm_joint" in x for x in check(still).warnings)


def test_one_of_two_cables_is_slack(tmp_path: Path) -> None:
    """A load on rails between a cable above and one below: the upper one stretches by m g / k."""
    rail = [Body("load", "base", "prismatic", axis=(0, 1, 0), mass=2.0)]
    robot = load(tmp_path, rail, """gravity: [0, -9.81, 0]
actuated: []
springs:
  above: {between: [load, world], at: [0, 1, 0], stiffness: 1e4, length: 1.0, tension_only: true}
  below: {between: [load, world], at: [0, -1, 0], stiffness: 1e4, length: 1.0, tension_only: true}
""")  # fmt: skip
    assert pf.static_equilibrium(robot, free_motors=True).y[0] == pytest.approx(
        -2 * G / 1e4, rel=1e-9
    )


def test_a_loaded_platform_leans_to_the_end_of_its_play() -> None:
    """A load takes up the play along it: that place of the play (rigid) beside the ideal pins' sag.

    To first order in 50 um: contacts give way by 1 um under 20 N, and turns of 1e-3 of the links
    change the sag of 0.4 mm by less.
    """
    push = ["forces.push={at: platform, force: [12, -16, 0]}"]
    pins = [f"loops.pin_{k}.{key}" for k in (2, 3) for key in ("clearance=50 um", "pin=5 mm")]
    ideal, loose = pf.load("3rrr", push), pf.load("3rrr", [*push, *pins])
    keys = {"level": "quasistatic", "samples": 2}
    runs = [pf.solve(x, pf.hold(duration=0.1), **keys) for x in (ideal, loose)]
    moved = runs[1].frame("platform").position[0] - runs[0].frame("platform").position[0]
    there = pf.play(loose).where([0.6, -0.8, 0, 0, 0, 0])
    np.testing.assert_allclose(moved[:2], there[:2], atol=0.03 * np.linalg.norm(there[:2]))
    # Along the load no place of the play is further, and contacts add what they give way by.
    assert moved @ [0.6, -0.8, 0] == pytest.approx(
        float(pf.play(loose).reach([0.6, -0.8, 0, 0, 0, 0])), rel=0.03
    )


def test_a_loop_with_one_loose_pin_moves_as_the_ideal_one() -> None:
    """Quasistatic with what accelerates it: off by the clearance at first order, not singular.

    What the pin of one loop lets go other joints must not: they move with the pin in its hole.
    """
    keys = {"level": "quasistatic", "until": 0.02, "samples": 3}
    ideal, gaps, off = pf.solve(pf.load("3rrr"), **keys), (5e-5, 2.5e-5, 1.25e-5), []
    for gap in gaps:
        pin = [f"loops.pin_2.clearance={gap}", "loops.pin_2.pin=5 mm"]
        run = pf.solve(pf.load("3rrr", pin), **keys)
        moved = [run.array(key) - ideal.array(key) for key in ("joint/q", "torque")]
        off.append([np.abs(x).max() for x in moved])
    # Hertz's contact adds x ~ gap^(1/3), which turns the slope by 1e-2.
    assert slope(gaps, np.array(off)[:, 0]) == pytest.approx(1.0, abs=0.02)
    assert slope(gaps, np.array(off)[:, 1]) == pytest.approx(1.0, abs=0.02)
    assert off[0][0] < 10 * gaps[0] and off[0][1] < 1e-3 * np.abs(ideal.torque).max()


def test_a_robot_without_free_coordinates_is_balanced_in_silence(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Rigid links, every joint a motor: quasistatic is rigid, and LAPACK says nothing."""
    robot = pf.load("ur5", ["flexible={}"])
    still, rigid = (pf.solve(robot, level=x, samples=41) for x in ("quasistatic", "rigid"))
    np.testing.assert_allclose(still.torque, rigid.torque, rtol=1e-12, atol=1e-11)
    assert capfd.readouterr() == ("", "")


def test_a_rigid_stop_holds_at_rest_and_starts_no_run(tmp_path: Path) -> None:
    """A pendulum that lies on a stop: the stop's place, and m g l cos(a) / 1e9 beyond it."""
    arm = [Body("arm", "base", "revolute", mass=1.0, com=(0.2, 0, 0))]
    robot = load(tmp_path, arm, """gravity: [0, -9.81, 0]
actuated: []
joints: {arm_joint: {stops: {lower: -0.3, restitution: 0.5}}}
solve: {level: coupled, start: static, until: 0.1}
""")  # fmt: skip
    at = pf.static_equilibrium(robot, free_motors=True)
    assert at.y[0] == pytest.approx(-0.3 - 0.2 * G * np.cos(0.3) / 1e9, abs=1e-15)
    with pytest.raises(pf.ConvergenceError, match="gives speeds back and bears no force"):
        pf.solve(robot)
