"""Start speeds of joints and links against equations of motion written out.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - start speeds: double pendulum, spatial slider-crank from crank, slider joint or slider |
      Lagrange's equations, one-freedom reduction, scipy | 2e-6, 1e-5 rad | passes
    - start speed of a beam's tip: a blow, every mode takes the same share | modal sum of a
      cantilever | 2e-4 | passes
    - a run that starts from the bent, moving state of another goes on as that would have | P L^3 /
      3, first mode; the run itself | 1e-5 | passes
    Tolerances, collocation
    - a thrown spinning brick at tol 1e-8: its parabola | closed form | 3e-9 m | 1e-9 (6e-9 where
      corrected steps are not turned by their corrections)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinflex as pf
from pinflex.arrays import Array
from pinflex.lab.loops import slider_crank, slider_crank_exact
from tests.scenes import UNIT_BEAM, Body, load

G = 9.81
# Two rods on hinges, and what their joints do (relative angles).
ROD = {"mass": 1.0, "com": (0.5, 0, 0), "inertia": (1e-4, 1 / 12, 1 / 12)}
ARMS = (
    Body("upper", "base", "revolute", **ROD),
    Body("lower", "upper", "revolute", xyz=(1, 0, 0), **ROD),
    Body("tip", "lower", xyz=(1, 0, 0)),
)
FALLING = "gravity: [0, -9.81, 0]\nactuated: []\nframes: [tip]\n"


def double_pendulum(t: Array, speeds: tuple[float, float]) -> Array:
    """Relative angles of the two rods from the x axis down, by Lagrange's equations."""

    def rate(_: float, s: Array) -> Array:
        a, b, da, db = s[0], s[0] + s[1], s[2], s[2] + s[3]  # absolute
        c, sn = 0.5 * np.cos(a - b), 0.5 * np.sin(a - b)
        M = np.array([[1 / 3 + 1, c], [c, 1 / 3]])
        f = np.array([-sn * db**2 - 1.5 * G * np.cos(a), sn * da**2 - 0.5 * G * np.cos(b)])
        dda, ddb = np.linalg.solve(M, f)
        return np.array([s[2], s[3], dda, ddb - dda])

    run = solve_ivp(rate, (0, t[-1]), [0, 0, *speeds], t_eval=t, rtol=1e-11, atol=1e-12)
    return np.asarray(run.y.T)


@pytest.mark.parametrize("named", [{"upper_joint": 3.0}, {"upper_joint": 3.0, "lower_joint": -4.0}])
def test_a_double_pendulum_starts_with_its_speeds(named: dict[str, float], tmp_path: Path) -> None:
    """A joint that is not named does not turn at first."""
    robot = load(tmp_path, ARMS, FALLING)
    run = pf.solve(robot, level="coupled", until=1.0, samples=21, tol=1e-7, start_speeds=named)
    angles = np.column_stack([run.joint(x).position for x in ("upper_joint", "lower_joint")])
    speeds = named["upper_joint"], named.get("lower_joint", 0.0)
    exact = double_pendulum(run.t, speeds)
    assert np.abs(angles - exact[:, :2]).max() < 2e-6  # twenty times the tolerance asked for


@pytest.mark.parametrize(
    "speeds",
    [{"crank_joint": 6.0}, {"slider_joint": 0.24}, {"slider": [0.24, None, None]}],
)
def test_one_speed_of_a_loop_makes_the_others(speeds: dict[str, object]) -> None:
    """The spatial slider-crank of the IFToMM library, from its crank, slider joint or slider."""
    run = pf.solve(slider_crank(), pf.hold(duration=0.2), "coupled", tol=1e-6, samples=11,
                   start_speeds=speeds)  # fmt: skip
    assert run.joint("crank_joint").velocity[0] == pytest.approx(6.0, rel=1e-12)
    assert run.joint("slider_joint").velocity[0] == pytest.approx(0.24, rel=1e-12)
    turn = run.joint("crank_joint").position
    angle = np.unwrap(np.arctan2(turn[:, 1], turn[:, 0]))
    assert np.abs(angle - slider_crank_exact(run.t)[:, 0]).max() < 1e-5


def test_the_yaml_says_it_too(tmp_path: Path) -> None:
    yaml = FALLING + "solve: {until: 0.1, samples: 3, dt: 1e-3, start_speeds: {lower_joint: -2}}\n"
    run = pf.solve(load(tmp_path, ARMS, yaml))
    assert run.joint("lower_joint").velocity[0] == -2.0
    assert run.joint("upper_joint").velocity[0] == 0.0


def test_a_blow_at_the_tip_gives_each_mode_of_a_beam_its_share(tmp_path: Path) -> None:
    """Speeds by least kinetic energy: dv = M^-1 w (w' M^-1 w)^-1 V, so every mode of a cantilever

    starts with the share phi_k(L)^2 of the impulse: the same for all of them (2 at unit mass).
    """
    beam = (Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0)))
    yaml = f"gravity: [0, 0, 0]\nactuated: []\nframes: [tip]\nflexible:{UNIT_BEAM}"
    basis = ["flexible.beam.basis={kind: assumed, modes: 4}", "flexible.beam.second_order=false"]
    robot = load(tmp_path, beam, yaml, basis)
    speed = 1e-3
    run = pf.solve(robot, level="coupled", until=0.5, samples=1001, tol=1e-5,
                   start_speeds={"tip": [None, speed, None]})  # fmt: skip
    moved = run.frame("tip").position[:, 1]
    omega = np.array([1.87510407, 4.69409113, 7.85475744, 10.99554073]) ** 2
    # Clamped-free modes have the same |phi(L)|, so that four of them share the speed equally.
    expected = speed / 4 * np.sum(np.sin(np.outer(run.t, omega)) / omega, axis=1)
    assert np.abs(moved - expected).max() < 2e-4 * np.abs(expected).max()
    assert np.gradient(moved, run.t)[0] == pytest.approx(speed, rel=1e-2)


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        (
            {"uper_joint": 1},
            'no such moving joint or link: "uper_joint". Did you mean "upper',
        ),
        ({"upper_joint": [1, 2]}, "start_speeds.upper_joint: 2 values. Allowed: 1"),
        ({"tip": 1}, "start_speeds.tip: 1 values. Allowed: 3"),
        ({"upper_joint": "fast"}, "'fast' is not a number"),
        ({"tip": [0, 1, 1]}, "do not allow these speeds together; they miss by"),
    ],
)
def test_speeds_that_cannot_be_are_refused(
    speeds: dict[str, object], said: str, tmp_path: Path
) -> None:
    robot = load(tmp_path, ARMS, FALLING)
    with pytest.raises(pf.DescriptionError) as error:
        pf.solve(robot, level="coupled", until=0.1, start_speeds=speeds)
    assert said in str(error.value)


def test_a_motor_follows_its_motion_unless_torques_drive_it(tmp_path: Path) -> None:
    robot = load(tmp_path, ARMS, FALLING.replace("[]", "[upper_joint]"))
    with pytest.raises(pf.DescriptionError, match="is a motor, and follows the motion"):
        pf.solve(robot, level="coupled", until=0.1, start_speeds={"upper_joint": 1.0})
    run = pf.solve(robot, level="coupled", until=0.1, samples=3, drive="torque",
                   start_speeds={"upper_joint": 1.0})  # fmt: skip
    assert run.joint("upper_joint").velocity[0] == 1.0


KICKED = Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0))


def test_a_run_may_start_from_the_bent_and_moving_state_of_another(tmp_path: Path) -> None:
    """A beam held by a force and let go: a free vibration, and where it is stopped it goes on."""
    force = "forces: {push: {at: tip, force: [0, 0.01, 0]}}\n"
    yaml = f"gravity: [0, 0, 0]\nactuated: []\nframes: [tip]\nflexible:{UNIT_BEAM}"
    basis = ["flexible.beam.second_order=false", "flexible.beam.basis.internal=4"]
    pushed = load(tmp_path, KICKED, force + yaml, basis)
    bent = pf.solve(pushed, pf.hold(duration=0.1), "coupled", start="static", samples=3, dt=1e-3)
    free = load(tmp_path, KICKED, yaml, basis)
    both = pf.solve(free, pf.hold(duration=1.0), "coupled", start=bent, samples=101, tol=1e-6)
    # P L^3 / 3 at first, then the modes' sum: all but 3 % of it is the first mode's.
    tip = both.frame("tip").position[:, 1]
    assert tip[0] == pytest.approx(0.01 / 3, rel=1e-9)
    first = np.cos(1.87510407**2 * both.t)
    share = 4 / 1.87510407**4 * 3  # phi(L)^2 = 4 over omega^2, of the sum 1/3
    assert np.abs(tip / tip[0] - share * first).max() < 1.1 * (1 - share)
    rest = pf.solve(free, pf.hold(duration=0.6), "coupled", start=(both, 0.4), samples=61, tol=1e-6)
    np.testing.assert_allclose(rest.frame("tip").position[:, 1], tip[40:], atol=1e-5 * tip[0])


def test_a_run_that_is_no_start_of_the_motion_is_refused(tmp_path: Path) -> None:
    robot = load(tmp_path, ARMS, FALLING.replace("[]", "[upper_joint]"))
    away = pf.quintic(joints={"upper_joint": 1.0}, duration=0.1)
    run = pf.solve(robot, away, "coupled", samples=3, dt=1e-3)
    with pytest.raises(pf.DescriptionError, match="its motors stand 1"):
        pf.solve(robot, pf.hold(duration=0.1), "coupled", start=run, dt=1e-3)
    with pytest.raises(pf.DescriptionError, match="Allowed: auto, static, straight, a result"):
        pf.solve(robot, away, "coupled", start=(run,), dt=1e-3)


@pytest.mark.parametrize(("tol", "close"), [(1e-7, 1e-6), (1e-8, 3e-9)])
def test_a_thrown_body_flies_its_parabola_and_spins(
    tmp_path: Path, tol: float, close: float
) -> None:
    """`root_joint`: linear, then angular, in the body's own axes.

    3e-9 m: 1e-9 measured; 6e-9 where a corrected step is not turned by its correction.
    """
    body = (Body("brick", "base", mass=2.0, inertia=(0.1, 0.2, 0.3)),)
    robot = load(tmp_path, body, "base: free_flyer\nactuated: []\nframes: [brick]\n")
    run = pf.solve(robot, pf.hold(duration=0.8), "coupled", samples=9, tol=tol,
                   start_speeds={"root_joint": [1.0, 0.0, 2.0, 0.0, 0.0, 3.0]})  # fmt: skip
    place = run.frame("brick").position
    exact = np.column_stack([run.t, 0 * run.t, 2 * run.t - G * run.t**2 / 2])
    np.testing.assert_allclose(place, exact, atol=close)
    turned = run.frame("brick").rotation[-1]
    np.testing.assert_allclose(turned[0, 0], np.cos(2.4), atol=1e-6)  # about a principal axis
