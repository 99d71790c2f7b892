"""Rows at a controller's rate, what its interpolation misses, playing them back, retiming.

Claims:
    Commands: motions that the platform follows
    - what hold, linear, cubic and quintic miss of a sine | remainders of Taylor, Hermite | 0.5 % |
      passes
    - 1 kHz CSV played back, level coupled: torque, speed, stress (delta; ur5, S-curve and
      trapezoid) | the motion itself | 1 % | 1e-7; 2e-4; 6e-5
    - retiming by speed, acceleration, jerk, effort of a quintic; shaped | its peaks; inertia by
      hand | 1e-7, 1e-5, 1e-6 | passes
    - ZVD's and EI's width at 5 % (published .286, .399), the time they cost | Singhose, Seering,
      Singer (1994) | 1.5e-3 | .287, .398
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.solver.solve import default_motion
from tests.unit.description.test_profiles import arm

# Of s = 10 u^3 - 15 u^4 + 6 u^5: the largest speed, acceleration and jerk of a unit in a second.
QUINTIC = {"velocity": 15 / 8, "acceleration": 10 / np.sqrt(3), "jerk": 60.0}
ABOUT_J1 = 2 * 0.01 + 0.2**2 + 0.6**2  # [kg m^2] of the arm stretched out, about its first axis


def test_what_interpolation_misses_of_a_sine() -> None:
    """Remainders of Taylor and Hermite: h w, (h w)^2 / 8, (h w)^4 / 384, (h w)^6 / 46080."""
    rate, frequency = 100.0, 1.0
    found = pf.harmonic(joints={"a": 1.0}, frequency=frequency, duration=1.0).at_rate(rate)
    hw = 2 * np.pi * frequency / rate
    sizes = {"hold": hw, "linear": hw**2 / 8, "cubic": hw**4 / 384, "quintic": hw**6 / 46080}
    for word, bound in sizes.items():
        # The next term is (h w)^2 = 4e-3 of it; a sixteenth of an interval misses none.
        assert found.missed[word][0] == pytest.approx(bound, rel=5e-3), word
        assert found.missed[word][0] <= bound * (1 + 1e-3)  # 1.3e-12 beside round-off of 1e-16
    assert "At 100 Hz" in found.text()


def test_rows_of_a_robot_are_all_its_motors_with_home_and_units(tmp_path: Path) -> None:
    robot = pf.load("ur5")
    motion = pf.quintic(joints={"elbow_joint": 0.5}, duration=0.1004)
    path = motion.to_csv(tmp_path / "m.csv", 500, robot)
    head = path.read_text().splitlines()[0].split(",")
    assert head[:3] == ["t [s]", "shoulder_pan_joint.position [rad]",
                        "shoulder_pan_joint.velocity [rad/s]"]  # fmt: skip
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert table.shape == (52, 1 + 3 * 6)  # 0 to 0.102 s: the first tick behind the end too
    elbow = table[:, head.index("elbow_joint.position [rad]")]
    assert elbow[[0, -1]] == pytest.approx([1.5, 2.0], abs=1e-12)  # home of the model is 1.5
    plain = motion.to_csv(tmp_path / "d.csv", 500).read_text().splitlines()[0]
    assert plain.startswith("t [s],elbow_joint.displacement [rad | m],elbow_joint.velocity")
    with pytest.raises(pf.DescriptionError, match="displacements from home. Give robot="):
        motion.to_joint_trajectory()
    with pytest.raises(pf.DescriptionError, match="the platform, not joints"):
        pf.circle(center=[0, 0], radius=0.1, omega=1).to_joint_trajectory()
    with pytest.raises(pf.DescriptionError, match="Allowed: at most 1000000"):
        motion.to_csv(tmp_path / "n.csv", 1e9)


def test_rows_of_motors_that_slide_are_metres(tmp_path: Path) -> None:
    robot = pf.load("3tpt")
    slides = [x for x in robot.description.actuated if robot.joints[x].kind == "prismatic"]
    assert slides
    rows = pf.hold(duration=0.01).at_rate(1000, robot)
    units = dict(zip(rows.names, rows.units, strict=True))
    assert {units[name] for name in slides} == {"m"}
    assert f"{slides[0]}.velocity [m/s]" in rows.to_csv(tmp_path / "s.csv").read_text()


def test_a_command_at_a_rate_and_as_a_joint_trajectory(tmp_path: Path) -> None:
    robot = pf.load("delta")
    move = pf.nonic(platform={"x": 0.1, "y": 0.0, "z": 0.0}, duration=0.3)
    command = pf.command(robot, move, "rigid", before=0.02, after=0.02)
    rows = command.at_rate(1000)
    run = pf.solve(robot, command.motion, level="rigid", samples=len(rows.t), until=rows.t[-1])
    assert run.t == pytest.approx(rows.t, abs=1e-12)
    # Torques between the instants of the command, 2 ms apart, by splines of fifth degree.
    assert rows.torque == pytest.approx(run.torque, abs=1e-5 * np.abs(run.torque).max())
    data = command.to_joint_trajectory(tmp_path / "c.json")
    assert data == json.loads((tmp_path / "c.json").read_text())
    assert data["points"][100]["effort"] == pytest.approx(rows.torque[100], rel=1e-12)
    back = pf.trajectory(command.to_csv(tmp_path / "c.csv", 1000))
    t = np.linspace(0.0, 0.34, 97)
    # Twelve digits in the file; quintic polynomials over a millisecond.
    assert back(t) == pytest.approx(command.motion(t), abs=1e-10)


@pytest.mark.parametrize("name, kind", [("delta", None), ("ur5", "scurve"), ("ur5", "trapezoid")])
def test_a_csv_of_one_kilohertz_played_back_does_what_the_motion_does(
    name: str, kind: str | None, tmp_path: Path
) -> None:
    robot = pf.load(name)
    motion = default_motion(robot)
    if kind is not None:
        more = {"jerk": 100} if kind == "scurve" else {}
        ways = {"shoulder_pan_joint": 0.5, "elbow_joint": -0.3}
        motion = getattr(pf, kind)(joints=ways, velocity=1.5, acceleration=6, **more)
    played = pf.trajectory(motion.to_csv(tmp_path / "x.csv", 1000, robot))
    end = motion.duration * 1.1
    options = {"level": "coupled", "tol": 1e-4, "samples": 201, "until": end}
    a, b = (pf.solve(robot, one, **options) for one in (motion, played))
    for largest in (
        lambda run: np.abs(run.torque).max(axis=0),
        lambda run: np.array([np.abs(run.joint(x).velocity).max() for x in run.motors]),
        lambda run: np.array([run.link(x).von_mises.max() for x in run.links]),
    ):
        # One per cent is asked; a motor that rests moves by round-off.
        assert largest(b) == pytest.approx(largest(a), rel=1e-2, abs=1e-8)


def moved(tmp_path: Path) -> tuple[pf.Mechanism, pf.Motion]:
    return arm(tmp_path, "{kind: hold, duration: 1}"), pf.quintic(joints={"j1": 0.8}, duration=1)


@pytest.mark.parametrize("quantity, power", [("velocity", 1), ("acceleration", 2), ("jerk", 3)])
def test_a_quintic_is_retimed_by_its_own_peaks(quantity: str, power: int, tmp_path: Path) -> None:
    robot, motion = moved(tmp_path)
    limits = dict.fromkeys(("velocity", "acceleration", "jerk", "effort"))
    found = pf.retime(robot, motion, limits | {quantity: 0.7})
    expected = (0.8 * QUINTIC[quantity] / 0.7) ** (1 / power)
    # Of 600 instants: peaks are parabolas, off by (pi / 600)^4 of them; jerks straight lines
    # through differences, off by 10 / 600^2.
    assert found.motion.duration == pytest.approx(expected, rel=1e-7 if power < 3 else 1e-5)
    assert found.held_by == f"{quantity} of j1" and found.factor == found.motion.duration
    assert found.motion(found.motion.duration)[0] == pytest.approx(0.8, rel=1e-15)


def test_effort_is_that_of_the_rigid_mechanism(tmp_path: Path) -> None:
    """No gravity along the plane: torque = inertia times acceleration, Coriolis terms vanish."""
    robot, motion = moved(tmp_path)
    only = {"velocity": None, "acceleration": None, "jerk": None, "effort": {"j1": 0.5}}
    found = pf.retime(robot, motion, only)
    peak = ABOUT_J1 * 0.8 * QUINTIC["acceleration"]
    assert found.motion.duration == pytest.approx(np.sqrt(peak / 0.5), rel=1e-6)
    assert found.held_by == "effort of j1"
    run = pf.solve(robot, found.motion, level="rigid", samples=801)
    assert np.abs(run.torque[:, 0]).max() == pytest.approx(0.5, rel=1e-5)


def test_limits_of_the_urdf_hold_by_themselves(tmp_path: Path) -> None:
    robot, motion = moved(tmp_path)
    found = pf.retime(robot, motion)  # 1 rad/s, 2 rad/s^2, 10 rad/s^3
    least = [(0.8 * QUINTIC[k] / m) ** (1 / p) for k, m, p in
             (("velocity", 1, 1), ("acceleration", 2, 2), ("jerk", 10, 3))]  # fmt: skip
    assert found.motion.duration == pytest.approx(max(least), rel=1e-5)  # as above
    worst = [max(by_motor.values()) for by_motor in found.shares.values()]
    assert max(worst) == pytest.approx(1.0, rel=1e-9)


def test_a_shaped_path_keeps_its_limits_and_says_how_far_it_leaves_a_bend(tmp_path: Path) -> None:
    robot, motion = moved(tmp_path)
    straight = pf.retime(robot, motion, shaper={"kind": "zv", "frequencies": [2.0]})
    plain = pf.retime(robot, motion)
    # Impulses half a period apart share the jerk that held the plain motion: a shorter one does.
    assert straight.motion.duration == pytest.approx(straight.factor + 0.25, rel=1e-12)
    assert straight.factor < 0.9 * plain.factor
    worst = max(max(by_motor.values()) for by_motor in straight.shares.values())
    assert worst == pytest.approx(1.0, abs=1e-5) and worst < 1.0 + 1e-8  # of the last halving
    assert straight.shares[straight.held_by.split()[0]]["j1"] == worst
    assert straight.off_path < 1e-12  # all in step: a straight line stays one
    points = [
        {"positions": p, "velocities": v, "accelerations": [0, 0], "time_from_start": t}
        for p, v, t in (([0, 0], [0, 0], 0.0), ([1, 0.2], [0.2, 0.2], 1.0), ([1, 1], [0, 0], 2.0))
    ]
    bent = {"joint_names": ["j1", "j2"], "points": points}
    found = pf.retime(robot, bent, shaper={"kind": "zv", "frequencies": [2.0]})
    assert 1e-3 < found.off_path < 0.2
    assert max(max(by_motor.values()) for by_motor in found.shares.values()) <= 1 + 1e-9


@pytest.mark.parametrize(
    "limits, words",
    [
        ({"velocity": 0}, r"limits\.velocity: 0 rad/s"),
        ({"speed": 1}, r"limits\.speed: no such limit"),
        ({"velocity": {"j3": 1}}, r"limits\.velocity\.j3: no motor"),
    ],
)
def test_what_is_no_limit_is_told(limits: dict[str, object], words: str, tmp_path: Path) -> None:
    robot, motion = moved(tmp_path)
    with pytest.raises(pf.DescriptionError, match=words):
        pf.retime(robot, motion, limits)


def test_jumps_and_poses_that_cannot_be_held_are_refused(tmp_path: Path) -> None:
    robot, _ = moved(tmp_path)
    ramps = pf.trapezoid(joints={"j1": 1}, ramp=0.1, duration=1)
    with pytest.raises(pf.MotionError, match="acceleration of j1 jumps by"):
        pf.retime(robot, ramps)
    assert pf.retime(robot, ramps, {"jerk": None}).motion.duration > 0
    with pytest.raises(pf.MotionError, match="of its effort limit to hold still on this path"):
        pf.retime("ur5", pf.quintic(joints={"elbow_joint": 0.1}, duration=1), {"effort": 1})


def test_a_rate_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    base = ["solve", "delta", "--level", "rigid"]
    assert main([*base, "--rate", "500", "--csv", "s.csv"]) == 0
    assert "At 500 Hz" in capsys.readouterr().out
    t = np.genfromtxt("s.csv", delimiter=",", skip_header=1)[:, 0]
    assert t == pytest.approx(np.arange(301) / 500, abs=1e-12)
    assert main([*base, "--rate", "500", "--until", "0.3005"]) == 2
    assert "Give --until 0.302." in capsys.readouterr().err
    command = ["command", "delta", "--level", "rigid", "--rate", "250"]
    assert main([*command, "-o", "c.yaml"]) == 0
    assert "At 250 Hz" in capsys.readouterr().out
    assert pf.trajectory("c.yaml").names == pf.load("delta").motors
    assert main(command) == 2 and "Add -o" in capsys.readouterr().err
