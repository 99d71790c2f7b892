"""Two wheels on gears behind one elastic drive: vibration, friction, torques in closed form.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - two wheels on gears behind one elastic drive: frequencies, response, friction of both at the
      motor, command, sensitivity to the ratio | closed form; the run itself | 1e-6 to 1e-11; 1e-5
      rad of a command | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.studies.frequency_response import frequency_response
from tests.scenes import load
from tests.verification.test_couplings import GEARS, I1, I2, L1, L2, LAW, M1, M2, OFFSET, RATIO, G

K, ROTOR, GEAR = 500.0, 1e-4, 50.0  # N m/rad, kg m^2
WHEELS, MOTOR = I1 + RATIO**2 * I2, GEAR**2 * ROTOR  # I, J at the big joint [kg m^2]
NATURAL = np.sqrt(K / WHEELS) / (2 * np.pi)  # motor locked [Hz]
DRIVE = f"gear: {GEAR:g}, motor_inertia: {ROTOR}"
ELASTIC = f"{DRIVE}, stiffness: {K:g}"
WEIGHTLESS = "gravity: [0, 0, 0]\n"


def wheels(folder: Path, drive: str, more: str = "", follower: str = LAW) -> pf.Mechanism:
    """The two wheels, the big one driven."""
    big = f"big_joint: {{drive: {{{drive}}}}}"
    text = f"{more}actuated: [big_joint]\nplatform: small\njoints: {{{follower}, {big}}}\n"
    return load(folder, GEARS, text)


def test_both_wheels_swing_on_the_one_gear(tmp_path: Path) -> None:
    """Motor locked: omega^2 = k / (I1 + r^2 I2); free: omega^2 = k (1 / J + 1 / I)."""
    robot = wheels(tmp_path, ELASTIC, WEIGHTLESS)
    assert (robot.report.mobility, robot.report.coupled) == (1, 1)
    assert pf.modes(robot).frequencies == pytest.approx([NATURAL], rel=1e-10)
    poles = pf.linearise(robot).poles
    assert max(poles.imag) == pytest.approx(np.sqrt(K * (1 / MOTOR + 1 / WHEELS)), rel=1e-10)


def test_the_linear_model_and_its_response_know_the_coupling(tmp_path: Path) -> None:
    """Small wheel over torque: r / (-w^2 (J (1 - w^2 I / k) + I)); zero of the motor's own side."""
    robot = wheels(tmp_path, ELASTIC, WEIGHTLESS)
    f = np.array([1.0, 3.0, 12.0])
    w2 = (2 * np.pi * f) ** 2
    found = pf.linearise(robot, outputs=["small_joint"]).response(f).ravel()
    np.testing.assert_allclose(
        found, RATIO / (-w2 * (MOTOR * (1 - w2 * WHEELS / K) + WHEELS)), rtol=1e-9
    )
    zeros = frequency_response(robot).zeros[0]
    assert max(zeros.imag) == pytest.approx(np.sqrt(K / WHEELS), rel=1e-9)


def test_friction_of_both_joints_reaches_the_motor(tmp_path: Path) -> None:
    """Torque = (J + I) a'' + gravity + F1 + b a' + r F2, with the gear between; levels agree."""
    dry, small = 0.3, 0.2
    follower = LAW.replace("}", f", friction: {{coulomb: {small}}}}}")
    friction = f"friction: {{coulomb: {dry}, viscous: 0.1}}"
    stiff = f"{DRIVE}, stiffness: 1e9, {friction}"
    rigid = wheels(tmp_path, f"{DRIVE}, {friction}", follower=follower)
    motion = pf.quintic(joints={"big_joint": 1.0}, duration=0.5)
    run = pf.solve(rigid, motion, level="rigid", samples=21)
    a, v, acceleration = (x[:, 0] for x in motion.evaluate(run.t))
    pull = M1 * G * L1 * np.sin(a) + RATIO * M2 * G * L2 * np.sin(RATIO * a + OFFSET)
    rubs = dry * np.tanh(v / 1e-3) + 0.1 * v + RATIO * small * np.tanh(RATIO * v / 1e-3)
    expected = (WHEELS + MOTOR) * acceleration + pull + rubs
    np.testing.assert_allclose(run.torque[:, 0], expected, atol=1e-11 * np.abs(expected).max())
    drive = run.drive("big_joint")
    behind = expected - MOTOR * acceleration - dry * np.tanh(v / 1e-3) - 0.1 * v
    np.testing.assert_allclose(drive.torque, behind, atol=1e-10)
    bent = pf.solve(wheels(tmp_path, stiff, follower=follower), motion, level="quasistatic",
                    samples=21)  # fmt: skip
    # a gear of 1e9 N m/rad gives way by 1e-8 rad
    np.testing.assert_allclose(bent.torque, run.torque, atol=1e-6)


def test_what_follows_is_behind_the_gear_and_no_energy_is_lost(tmp_path: Path) -> None:
    """The small wheel follows the link's side of an elastic drive, not its motor."""
    robot = wheels(tmp_path, f"{ELASTIC}, damping: 0.5")
    motion = pf.quintic(joints={"big_joint": 1.0}, duration=0.5)
    run = pf.solve(robot, motion, level="coupled", samples=201)
    drive = run.drive("big_joint")
    assert np.ptp(drive.deflection) > 5e-3
    followed = RATIO * drive.position + OFFSET
    np.testing.assert_allclose(run.joint("small_joint").position, followed, atol=1e-10)
    # within 1e-4, the line that `solve` prints
    assert "good" in str(run).split("energy balance")[1].splitlines()[0]


def test_a_command_moves_the_wheel_that_follows(tmp_path: Path) -> None:
    """Motor motion by inversion: the wheel behind coupling and gear ends where it is told."""
    robot = wheels(tmp_path, ELASTIC, WEIGHTLESS)
    wanted = pf.nonic(platform={"ry": 1.0}, duration=0.5)
    rest = {"before": 0.1, "after": 0.1}
    reached = {}
    for level in ("rigid", "quasistatic"):
        found = pf.command(robot, wanted, level, **rest)
        run = pf.solve(robot, found.motion, level="coupled", tol=1e-5)
        told = wanted.evaluate(np.clip(run.t - 0.1, 0, 0.5))[0][:, 0]
        reached[level] = np.abs(run.joint("small_joint").position - OFFSET - told).max()
    assert reached["rigid"] > 0.05
    assert reached["quasistatic"] < 1e-5  # the run's own tolerance


def test_the_ratio_is_a_parameter(tmp_path: Path) -> None:
    """r / f df/dr = -r^2 I2 / (I1 + r^2 I2); the stiffness counts by half."""
    robot = wheels(tmp_path, ELASTIC, WEIGHTLESS)
    keys = ("joints.small_joint.ratio", "joints.big_joint.drive.stiffness")
    table = pf.sensitivities(robot, by=keys, of=["frequency.1"])
    assert table["frequency.1", keys[0]] == pytest.approx(-(RATIO**2) * I2 / WHEELS, rel=1e-6)
    assert table["frequency.1", keys[1]] == pytest.approx(0.5, rel=1e-6)


def test_a_wheel_that_follows_has_no_drive(tmp_path: Path) -> None:
    follower = LAW.replace("}", ", drive: {gear: 3}}")
    with pytest.raises(pf.DescriptionError) as error:
        wheels(tmp_path, DRIVE, follower=follower)
    assert "small_joint.drive: it follows big_joint, whose motor moves both" in str(error.value)
