"""Motors driven by torques, on the kernel and without it, against damped oscillators.

A turntable beside a plane beam on a hinge of its own: they do not feel each other, and the beam
makes a system with flexible links of the scene.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a PD on a joint, by tol and in equal steps, with and without the kernel; what is fed forward
      alone moves a motor as its motion asks (cycloid, trapezoid); a motor that turns without end is
      pulled the shorter way | damped oscillator; J q'' | 1e-6 of the largest angle, 1e-5 (dt) |
      passes
    - a continuous PID on a joint, with and without the kernel, and as any function | exponential of
      its matrix; the other | 2e-5 rad (dt), 1e-4 (tol); 1e-9 | passes
    Tolerances, collocation
    - torques fed forward that jump, without the kernel: no loss of order | the law of the motion,
      effort | 1e-3, 600 steps | 1.5e-4, 485
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import pinflex as pf
from pinflex.arrays import Array
from tests.scenes import UNIT_BEAM, Body, load

J, KP, KD, SPEED = 0.5, 40.0, 1.5, 2.0  # kg m^2; N m/rad; N m s/rad; rad/s
BODIES = (
    Body("arm", "base", "continuous", mass=1.0, com=(0, 0, 0), inertia=(0.1, 0.1, J)),
    Body("beam", "base", "revolute", mass=1.0, com=(0.5, 0, 0), inertia=(1e-3,) * 3),
    Body("tip", "beam", xyz=(1, 0, 0)),
)
YAML = f"""gravity: [0, 0, 0]
actuated: [arm_joint, beam_joint]
frames: [tip]
motion: {{kind: hold, duration: 2}}
solve: {{level: coupled, drive: torque, kp: {KP}, kd: {KD}}}
flexible:{UNIT_BEAM}"""
WAYS = ({"tol": 1e-6}, {"dt": 2.5e-4})
STARTS = {"arm_joint": SPEED, "beam_joint": 1.0}


def angle(run: pf.Result) -> Array:
    """Of the turntable [rad], past half a turn too."""
    cos, sin = run.joint("arm_joint").position.T
    return np.asarray(np.unwrap(np.arctan2(sin, cos)))


def oscillator(t: Array) -> Array:
    """q of J q'' + kd q' + kp q = 0 with q(0) = 0, q'(0) = SPEED."""
    decay = KD / (2 * J)
    turning = np.sqrt(KP / J - decay**2)
    return np.asarray(SPEED / turning * np.exp(-decay * t) * np.sin(turning * t))


@pytest.mark.parametrize("serves", ["1", "0"])
@pytest.mark.parametrize("how", WAYS, ids=["tol", "dt"])
def test_a_pd_on_a_joint_is_a_damped_oscillator(
    how: dict[str, float], serves: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PINFLEX_KERNEL", serves)
    robot = load(tmp_path, BODIES, YAML)
    run = pf.solve(robot, samples=201, start_speeds=STARTS, **how)
    exact, speed = oscillator(run.t), run.joint("arm_joint").velocity
    size = np.abs(exact).max()
    # the tolerance; of second order in dt: (9 rad/s * dt)^2 / 12 of a period, 2 s long
    assert np.abs(angle(run) - exact).max() < (1e-6 if "tol" in how else 1e-5) * size
    torque = -KP * angle(run) - KD * speed
    np.testing.assert_allclose(run.torque[:, 0], torque, atol=1e-9 * KP * size)
    # No tolerance is about it: plain steps, halved until the outputs agree, leave 2e-6.
    by_tol = 1e-6 if serves == "1" else 5e-6
    assert run.meta["energy_balance"] < (by_tol if "tol" in how else 1e-4)


@pytest.mark.parametrize("kind", ["cycloid", "trapezoid"])
def test_what_is_fed_forward_alone_moves_a_motor_as_its_motion_asks(
    kind: str, tmp_path: Path
) -> None:
    """J q_d'' is all that the turntable needs, also where it jumps; 3 rad, so round the back."""
    ramp = ", ramp: 0.2" if kind == "trapezoid" else ""
    joints = "{arm_joint: 3.6, beam_joint: 0.1}"
    motion = f"motion={{kind: {kind}, joints: {joints}, duration: 1.0{ramp}}}"
    robot = load(tmp_path, BODIES, YAML, [motion, "solve.kp=0", "solve.kd=0"])
    run = pf.solve(robot, samples=101, tol=1e-6, until=1.2)
    wanted = pf.solve(robot, samples=101, tol=1e-6, until=1.2, drive="prescribed")
    assert np.abs(angle(run) - angle(wanted)).max() < 3.6e-6
    ours, theirs = (x.joint("arm_joint").velocity for x in (run, wanted))
    assert np.abs(ours - theirs).max() < 1e-6 * np.abs(theirs).max()


def test_torques_that_jump_keep_the_order_without_the_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step that ends at a jump takes the torque before it: else errors are of first order.

    J q'' = J q_d'' again, against the law of the motion. With four stages 485 steps are within
    1.5e-4, of first order 1937 were not within 4e-4.
    """
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    motion = (
        "{kind: trapezoid, joints: {arm_joint: 3.6, beam_joint: 0.1}, duration: 1.0, ramp: 0.2}"
    )
    robot = load(tmp_path, BODIES, YAML, [f"motion={motion}", "solve.kp=0", "solve.kd=0"])
    run = pf.solve(robot, samples=101, tol=1e-3, until=1.2)
    asked = pf.trapezoid(joints={"arm_joint": 3.6}, duration=1.0, ramp=0.2).evaluate(run.t)[0]
    assert np.abs(angle(run) - asked[:, 0]).max() < 3.6e-3
    assert run.meta["cost"]["last_steps"] < 600


def test_a_motor_that_turns_without_end_is_pulled_the_shorter_way(tmp_path: Path) -> None:
    """Past half a turn an angle read off (cos, sin) jumps; the torque of a motor does not."""
    motion = "motion={kind: cycloid, joints: {arm_joint: 9.0, beam_joint: 0.1}, duration: 1.0}"
    for way in WAYS:
        run = pf.solve(load(tmp_path, BODIES, YAML, [motion]), samples=101, until=1.2, **way)
        assert np.abs(run.torque[:, 0]).max() < 1.01 * J * 9.0 * 2 * np.pi  # J q_d'' of a cycloid


@pytest.mark.parametrize("serves", ["1", "0"])
def test_a_continuous_pid_is_a_linear_system_of_third_order(
    serves: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """J q'' = kp e + ki int e dt - kd q', e = target - q, by the exponential of its matrix."""
    monkeypatch.setenv("PINFLEX_KERNEL", serves)
    ki, target = 60.0, 0.3
    law = pf.pid(-KP, -ki, -KD, target)
    control = pf.Control((pf.Travel("arm_joint"),), (pf.Effort("arm_joint"),), law)
    robot = load(tmp_path, BODIES, YAML, ["solve.kp=0", "solve.kd=0"])
    given = {"control": control, "start_speeds": STARTS, "samples": 201}
    run = pf.solve(robot, dt=5e-4, **given)
    A = np.array([[0, 1, 0], [-KP / J, -KD / J, -ki / J], [1, 0, 0]])  # of q - target, q', integral
    start = np.array([-target, SPEED, 0.0])
    exact = np.array([expm(A * t) @ start for t in run.t])
    # of second order in dt: (9 rad/s * dt)^2 / 12 of a period, 2 s long
    assert np.abs(angle(run) - target - exact[:, 0]).max() < 2e-5
    u = -exact @ np.array([KP, KD, ki])
    np.testing.assert_allclose(run.arrays["control/arm_joint"], u, atol=2e-5 * KP)
    np.testing.assert_allclose(run.arrays["measured"][:, 0] % (2 * np.pi), angle(run) % (2 * np.pi))
    assert run.meta["energy_balance"] < 1e-4
    assert "march" not in run.meta["settings"]
    given["control"] = replace(control, law=lambda *of: law(*of))  # any function: Python marches
    other = pf.solve(robot, dt=5e-4, **given)
    assert np.abs(angle(other) - angle(run)).max() < 1e-9
    assert "in Python" in other.meta["settings"]["march"]
    given["control"] = control
    close = pf.solve(robot, tol=1e-4, **given)  # in halves of steps, until two runs agree
    assert np.abs(angle(close) - target - exact[:, 0]).max() < 1e-4


def test_steps_that_resolve_no_vibration_start_straight_too() -> None:
    """The slope of accelerations, 1e7 rad/s^2 by steps of 1 ms, threw the first step off."""
    robot = pf.load("ur5", ["solve.drive=torque"])
    keys = {"level": "coupled", "start": "straight", "until": 0.02, "samples": 5}
    fine = pf.solve(robot, **keys, tol=1e-4).array("joint/q")
    off = [
        np.abs(pf.solve(robot, **keys, dt=dt).array("joint/q") - fine).max() for dt in (1e-3, 5e-4)
    ]
    # 0.01 rad of sag, of which steps as long as half the links' period keep a fiftieth.
    assert off[0] < 5e-4 and off[1] < 2e-4
