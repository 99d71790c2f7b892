"""Starts from a given state: shapes of vibration, blows of motors that start or stop at once.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - `start=(y, v)`: a beam let go in a shape of vibration, or thrown with it, stays in that mode |
      closed form, modes 1 and 2 | 1e-6 | passes
    - a motor that starts or stops at once strikes what hangs on it: a rod on a hinge, as a joint
      and as a loop; a beam's modes | momentum about the hinge; int x phi = 2/b^2 | 1e-9 | passes
    - a torque-driven run cut in the middle and gone on with | the run itself | 1e-6 rad | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests import analytical
from tests.scenes import UNIT_BEAM, Body, load

BEAM = Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0))
OMEGA = analytical.wave_numbers("clamped_free") ** 2  # [rad/s] L = rho A = E I = 1
STILL = f"gravity: [0, 0, 0]\nactuated: []\nframes: [tip]\nflexible:{UNIT_BEAM}"
# Assumed modes are the beam's own: without second order they do not mix.
MODES = ["flexible.beam.basis={kind: assumed, modes: 3}", "flexible.beam.second_order=false"]


@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.parametrize("thrown", [False, True])
def test_a_beam_let_go_in_a_shape_of_vibration_stays_in_it(
    mode: int, thrown: bool, tmp_path: Path
) -> None:
    """eta cos(w t) from the deflection, eta sin(w t)/w from the speed; |phi(L)| is 2."""
    robot = load(tmp_path, BEAM, STILL, MODES)
    shape, w = 1e-3 * pf.modes(robot).shapes[:, mode], OMEGA[mode]
    y = robot.undeformed()
    start = (y, w * shape) if thrown else (y + shape, 0 * shape)
    run = pf.solve(robot, pf.hold(duration=1.0), "coupled", start=start, samples=101, tol=1e-7)
    expected = 2e-3 * (np.sin if thrown else np.cos)(w * run.t)
    moved = run.frame("tip").position[:, 1]
    sign = np.sign(moved @ expected)
    # Ten times the tolerance asked for.
    np.testing.assert_allclose(moved, sign * expected, atol=1e-6 * 2e-3)


ROD = {"mass": 1.0, "com": (0.5, 0, 0), "inertia": (1e-4, 1 / 12, 1 / 12)}
TREE = (
    Body("upper", "base", "revolute", **ROD),
    Body("lower", "upper", "revolute", xyz=(1, 0, 0), **ROD),
)
# The same two rods; the lower one is a free body of the plane that a loop holds.
LOOP = (
    TREE[0],
    Body("elbow", "upper", xyz=(1, 0, 0)),
    Body("along", "base", "prismatic", axis=(1, 0, 0)),
    Body("across", "along", "prismatic", axis=(0, 1, 0)),
    Body("lower", "across", "revolute", **ROD),
)
PIN = "loops: {pin: {kind: planar, between: [elbow, lower]}}\n"
PUSHED = "gravity: [0, 0, 0]\nactuated: [upper_joint]\n"


@pytest.mark.parametrize("bent", [0.0, 0.8, 2.0])
@pytest.mark.parametrize("looped", [False, True])
def test_a_motor_that_starts_at_once_strikes_what_hangs_on_it(
    bent: float, looped: bool, tmp_path: Path
) -> None:
    """The lower rod has no angular momentum about the hinge: 1/3 w_2 + 1/2 cos(bent) w_1 = 0."""
    home = f"lower_joint: {bent}" + (", along_joint: 1" if looped else "")
    yaml = f"{PUSHED}home: {{{home}}}\n{PIN if looped else ''}"
    robot = load(tmp_path, LOOP if looped else TREE, yaml)
    rest = pf.solve(robot, pf.hold(duration=0.01), "coupled", dt=0.01, samples=2)
    turn = pf.formula(joints={"upper_joint": "3*t"}, duration=0.01)
    run = pf.solve(robot, turn, "coupled", dt=1e-3, samples=11, start=rest)
    assert run.joint("upper_joint").velocity[0] == pytest.approx(3.0, rel=1e-12)
    expected = -1.5 * np.cos(bent) * 3.0
    seen = run.joint("lower_joint").velocity[0] + (0.0 if looped else 3.0)  # absolute
    assert seen == pytest.approx(expected, rel=1e-9, abs=1e-9)
    if looped:  # the elbow moves across the upper rod
        assert run.joint("across_joint").velocity[0] == pytest.approx(3.0, rel=1e-9)


def test_a_motor_that_stops_at_once_leaves_a_beam_its_momentum(tmp_path: Path) -> None:
    """A turn w x stops: each mode keeps its share of it, with the energy 1/2 (w int x phi)^2.

    int x phi = 2 / b^2 of a cantilever's modes.
    """
    hub = Body("hub", "base", "continuous", mass=1.0, inertia=(1, 1, 1))
    bodies, yaml = (hub, Body("beam", "hub"), BEAM[1]), STILL.replace("[]", "[hub_joint]")
    # Beyond half a turn, where (cos, sin) of a continuous joint do not tell the turns.
    robot = load(tmp_path, bodies, f"home: {{hub_joint: 4}}\n{yaml}", MODES)
    w = 0.01  # [rad/s]
    turn = pf.formula(joints={"hub_joint": f"4 + {w}*t"}, duration=0.1, absolute=True)
    turning = pf.solve(robot, turn, "coupled", dt=1e-3, samples=2, start="straight")
    stop = pf.formula(joints={"hub_joint": "4"}, duration=0.01, absolute=True)
    run = pf.solve(robot, stop, "coupled", dt=1e-3, samples=2, start=(turning, 0.0))
    assert run.joint("hub_joint").velocity[0] == 0.0
    b = analytical.wave_numbers("clamped_free")[:3]
    # The hub is worth another 1/2 w^2, and stops with its motor.
    kept = 2 * w**2 * np.sum(b**-4.0)
    assert run.array("energy/kinetic")[0] == pytest.approx(kept, rel=1e-9)
    assert turning.array("energy/kinetic")[0] == pytest.approx(0.5 * w**2 * 4 / 3, rel=1e-9)


def test_torque_driven_motors_go_on_as_they_are(tmp_path: Path) -> None:
    """A run cut in the middle and gone on with, against the run that was not."""
    robot = load(tmp_path, TREE, PUSHED.replace("[0, 0, 0]", "[0, -9.81, 0]"))
    keys = {"drive": "torque", "kp": 300.0, "kd": 2.0, "dt": 1e-3}
    whole = pf.solve(robot, pf.hold(duration=0.4), "coupled", samples=41, **keys)
    rest = pf.solve(robot, pf.hold(duration=0.2), "coupled", samples=21, start=(whole, 0.2), **keys)
    assert np.abs(whole.joint("upper_joint").velocity[20]) > 0.1
    np.testing.assert_allclose(  # second order: the cut is a start of the multistep quantities
        rest.array("joint/q"), whole.array("joint/q")[20:], atol=1e-6
    )


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ((np.zeros(3), np.zeros(2)), r"y and v have shapes \(3,\) and \(2,\). Allowed: \(2,\)"),
        ((np.zeros(2), np.full(2, np.nan)), "give finite numbers"),
        ((np.zeros(2), "fast"), r"Allowed: auto, .*\(y, v\), coordinates and velocities"),
        ((np.ones(2), np.zeros(2)), "its motors stand 1 "),
    ],
)
def test_a_state_that_is_none_is_refused(start: object, said: str, tmp_path: Path) -> None:
    robot = load(tmp_path, TREE, PUSHED)
    with pytest.raises(pf.DescriptionError, match=said):
        pf.solve(robot, pf.hold(duration=0.1), "coupled", dt=1e-2, start=start)


def test_velocities_that_open_a_loop_are_refused(tmp_path: Path) -> None:
    robot = load(tmp_path, LOOP, f"{PUSHED}home: {{along_joint: 1}}\n{PIN}")
    start = robot.undeformed(), np.array([0.0, 0.5, 0.0, 0.0])
    with pytest.raises(pf.DescriptionError, match=r"open the loops by 0.5 \(m/s or rad/s\)"):
        pf.solve(robot, pf.hold(duration=0.1), "coupled", dt=1e-2, start=start)
    with pytest.raises(pf.DescriptionError, match="a given state is one of level coupled"):
        pf.solve(robot, pf.hold(duration=0.1), "ked", dt=1e-2, start=start)
