"""The nominal motion: inverse kinematics of closed loops, and the poses it must refuse.

Claims:
    Equations
    - v, a of closed-loop inverse kinematics = rates of the position | differences | 1e-6 | passes
    Beams (frequencies relative; L = m = E I = 1)
    - three samples of 3rrr, delta, hexapod, race_r2 = those of 401, at level rigid | a fine march |
      1e-8 | passes
    Levels, energy, steps
    - many instants, none of them in the fast middle of a turn: the same motion as among others |
      a fine march | 1e-9 | 3e-13
    - nominal motion filled in = marched, six mechanisms; fewer than 10 of 401 instants are marched
      to | 1e-10; counted | passes
    Tolerances, collocation
    - quintics through positions, velocities, accelerations | scipy's `from_derivatives` | 1e-13 |
      6e-16
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path as File

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import BPoly

import pinflex as pf
from pinflex.actuation import drive as module
from pinflex.actuation.drive import Nominal, _filled, _hermite, _march, nominal
from pinflex.actuation.path import Path
from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion, from_spec
from pinflex.mechanics.evaluation.equations import Equations
from tests.scenes import Body, load

CLOSED = 1e-11  # [m] ten times the package's own limit of a closed pose
ROD = {"mass": 0.3, "inertia": (1e-4, 1e-3, 1e-3)}


@cache
def mechanism(name: str) -> pf.Mechanism:
    return pf.load(name)


def own_motion(m: pf.Mechanism) -> Motion:
    assert m.description.motion is not None
    return from_spec(m.description.motion, m.name)


def platform(m: pf.Mechanism, q: Array) -> pin.SE3:
    model = m.rigid.rigid
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    name = m.description.platform
    return data.oMf[model.getFrameId(name, pin.FrameType.BODY)].copy()


MOTIONS = {
    "3rrr": None,  # circle of the platform
    "3rrs": None,  # z, ry, rx of the platform
    "race_r1": None,  # joints, closed
    "race_r2": None,  # joints, closed, with a ball joint
    "ur5": None,  # joints, open
    "spinning_beam": None,  # a continuous joint, eleven turns
    "3rrs turning": pf.harmonic(platform={"z": 0.004, "ry": 0.1, "rx": -0.08}, frequency=2.0),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_velocity_and_acceleration_are_the_rates_of_the_position(name: str) -> None:
    m = mechanism(name.split()[0])
    motion = MOTIONS[name] or own_motion(m)
    model = m.rigid.rigid
    d = Equations(m.rigid)
    T = min(motion.duration, 2.0)
    h = 1e-4 * T  # [s]
    for t in np.array([0.23, 0.61]) * T:
        path = nominal(m, motion, t + h * np.arange(-2, 3))
        if d.looped:
            assert max(np.abs(d.close(q)[0]).max() for q in path.q) < CLOSED
        step = [pin.difference(model, path.q[2], q) for q in path.q]
        v = (8 * (step[3] - step[1]) - (step[4] - step[0])) / (12 * h)
        a = (8 * (path.v[3] - path.v[1]) - (path.v[4] - path.v[0])) / (12 * h)
        # Fourth-order differences: (1e-4)^4 of a motion's own scale, and 1e-11 m over h.
        scale = [np.abs(x).max() for x in (path.v, path.a)]
        np.testing.assert_allclose(path.v[2], v, atol=1e-6 * scale[0])
        np.testing.assert_allclose(path.a[2], a, atol=1e-6 * scale[1])


def test_the_platform_goes_where_it_is_told(tmp_path: File) -> None:
    m, t = mechanism("3rrr"), np.linspace(0, 0.2, 41)
    path = nominal(m, own_motion(m), t)
    w = 10 * np.pi
    for k, q in enumerate(path.q):
        pose = platform(m, q)
        x, y = 0.31 - 0.06 * np.cos(w * t[k]), 0.25 / np.sqrt(3) + 0.06 * np.sin(w * t[k])
        np.testing.assert_allclose(pose.translation[:2], [x, y], atol=CLOSED)
        np.testing.assert_allclose(pose.rotation, np.eye(3), atol=CLOSED)


def test_a_tilting_platform_follows_its_euler_angles_and_drags_the_rest() -> None:
    m, motion = mechanism("3rrs"), own_motion(mechanism("3rrs"))
    q = nominal(m, motion, np.array([0.0, 0.5, 1.0])).q[-1]
    pose, home = platform(m, q), platform(m, m.home)
    R = pose.rotation
    assert pose.translation[2] - home.translation[2] == pytest.approx(-0.0075, abs=CLOSED)
    assert np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])) == pytest.approx(-0.155, abs=CLOSED)
    assert np.arctan2(R[2, 1], R[2, 2]) == pytest.approx(0.03, abs=CLOSED)
    # The legs stay in their planes: each ball joint is where its plane through z holds it.
    for azimuth, corner in zip(np.deg2rad([90, 210, 330]), range(3), strict=True):
        ball = pose.act(0.1 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
        tangent = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        assert ball @ tangent == pytest.approx(0.0, abs=CLOSED), corner


def test_the_branch_is_kept_round_a_closed_path() -> None:
    m = mechanism("3rrr")
    motion = own_motion(m)
    path: Nominal = nominal(m, motion, np.linspace(0, 0.4, 81))  # two turns
    np.testing.assert_allclose(path.q[40], path.q[0], atol=1e-10)
    np.testing.assert_allclose(path.q[80], path.q[0], atol=1e-10)
    knees = path.q[:, [m.coordinates.index(f"knee_{i}") for i in (1, 2, 3)]]
    assert np.all(knees < 0)  # elbows stay on their side


def test_a_coarse_grid_and_a_fine_grid_find_the_same_motion() -> None:
    m = mechanism("race_r2")
    motion = own_motion(m)
    coarse, fine = (nominal(m, motion, np.linspace(0, 0.2, n)) for n in (6, 101))
    np.testing.assert_allclose(coarse.q, fine.q[::20], atol=1e-10)
    np.testing.assert_allclose(coarse.a, fine.a[::20], atol=1e-7)


def test_a_continuous_motor_turns_more_than_once() -> None:
    m = mechanism("spinning_beam")
    path = nominal(m, own_motion(m), np.linspace(0, 20, 51))
    t = path.t[-1]
    np.testing.assert_allclose(path.q[-1], [np.cos(6 * t - 45), np.sin(6 * t - 45)], atol=1e-12)
    assert path.v[-1, 0] == pytest.approx(6.0)


# Refused -----------------------------------------------------------------------------------------


def test_a_path_out_of_reach_is_refused_with_its_time() -> None:
    m = mechanism("3rrr")
    motion = pf.cycloid(platform={"x": 0.4, "y": 0.0, "rz": 0.0}, duration=1.0)
    with pytest.raises((pf.MotionError, pf.SingularityError), match=r"t = 0\.\d+ s") as caught:
        nominal(m, motion, np.linspace(0, 1, 201))
    # Leg 1 is stretched out when the platform pin is 0.42 m from its pivot; the platform goes
    # through every singular pose before that, the first of them names itself.
    assert 0.0 < caught.value.time < 1.0


def four_bar(
    folder: File, kind: str, lengths: Sequence[float], driven: str, home: Sequence[float]
) -> pf.Mechanism:
    """Of crank, coupler, ground and rocker so long; crank, coupler and rocker at these angles."""
    crank, coupler, ground, rocker = lengths
    bodies = (
        Body("crank", "base", kind, **ROD),
        Body("coupler", "crank", kind, xyz=(crank, 0, 0), **ROD),
        Body("coupler_end", "coupler", xyz=(coupler, 0, 0)),
        Body("rocker", "base", kind, xyz=(ground, 0, 0), **ROD),
        Body("rocker_end", "rocker", xyz=(rocker, 0, 0)),
    )
    yaml = f"""
actuated: [{driven}_joint]
loops: {{pin: {{kind: planar, between: [coupler_end, rocker_end]}}}}
home: {{crank_joint: {home[0]}, coupler_joint: {home[1]}, rocker_joint: {home[2]}}}
"""
    return load(folder, bodies, yaml)


def test_a_four_bar_says_where_its_rocker_can_turn_no_further(tmp_path: File) -> None:
    """Non-Grashof linkage driven at the rocker: the limit follows from the cosine rule."""
    m = four_bar(tmp_path, "revolute", (0.2, 0.5, 0.6, 0.4), "rocker", (1.0, -0.5, 1.8))
    start = m.home[m.rigid.motors[0]]
    # Crank and coupler in line: 0.7 m between the pivot of the crank and the end of the rocker.
    inner = np.arccos((0.4**2 + 0.6**2 - 0.7**2) / (2 * 0.4 * 0.6))
    limit = np.pi - inner
    motion = pf.trapezoid(joints={"rocker_joint": -1.5}, duration=1.5, ramp=1e-3)
    with pytest.raises(pf.SceneError) as caught:
        nominal(m, motion, np.linspace(0, 1.5, 301))
    reached = start - caught.value.time * 1.5 / (1.5 - 1e-3)
    assert reached == pytest.approx(limit, abs=0.01)  # two grid steps
    assert isinstance(caught.value, (pf.MotionError, pf.SingularityError))


def test_the_hard_variant_of_r2_names_its_singular_pose_before_it() -> None:
    """scenes.md 8: 1.5 mm links, four times the move: type-2 singularity at t = 0.103 s."""
    m = pf.load(
        "race_r2",
        [
            "flexible.*.section.thickness=0.0015",
            "motion.joints={motor_1: 0.2, motor_2: -0.1, motor_3: 0.05}",
        ],
    )
    with pytest.raises(pf.SingularityError, match="singular pose") as caught:
        pf.solve(m, level="rigid")
    assert 0.095 < caught.value.time <= 0.1035
    assert caught.value.loop in ("ball_2", "ball_3")
    assert "knee" in caught.value.motion or "ball" in caught.value.motion


def test_motors_that_do_not_determine_the_motion_are_named(tmp_path: File) -> None:
    bodies = (
        Body("one", "base", "revolute", **ROD),
        Body("two", "one", "revolute", xyz=(1, 0, 0), **{**ROD, "com": (0.5, 0, 0)}),
    )
    m = load(tmp_path, bodies, "actuated: [one_joint]\n")
    with pytest.raises(pf.MotionError, match="two_joint"):
        nominal(m, pf.cycloid(joints={"one_joint": 1.0}, duration=1.0), np.linspace(0, 1, 3))


def test_too_few_platform_coordinates_are_counted() -> None:
    with pytest.raises(pf.MotionError, match=r"imposes 2 coordinates .* mobility 3"):
        nominal(
            mechanism("3rrr"),
            pf.cycloid(platform={"x": 0.01, "y": 0.0}, duration=1.0),
            np.linspace(0, 1, 3),
        )


def test_coordinates_the_platform_cannot_follow_are_refused() -> None:
    with pytest.raises(pf.SceneError, match=r"3rrr"):
        nominal(
            mechanism("3rrr"),
            pf.cycloid(platform={"x": 0.01, "y": 0.0, "z": 0.01}, duration=1.0),
            np.linspace(0, 1, 11),
        )


@pytest.mark.parametrize("name", ["race_r1", "race_r2", "3rrs", "3rrr", "3tpt", "race_r3"])
def test_instants_filled_in_are_those_of_the_march(name):
    """Motions of joints and of platforms; both close loops to 1e-12 m."""
    robot = mechanism(name)
    motion = own_motion(robot)
    t = np.linspace(0.0, robot.description.solve.until or motion.duration, 301)
    one, many = _march(Path(robot, motion), t), nominal(robot, motion, t)
    assert _filled(_started(robot, motion), one.at(slice(None, None, 10)), t) is not None
    for key in "qva":
        a, b = getattr(one, key), getattr(many, key)
        assert np.max(np.abs(a - b)) < 1e-10 * np.max(np.abs(a)), key


def test_a_motion_too_fast_for_its_samples_is_left_to_the_march():
    """Some hundred periods in a second, seen 60 times: a quintic knows nothing of it."""
    robot = pf.load("race_r1")
    motion = pf.harmonic(joints={"motor_1": 0.002}, frequency=97.0, duration=1.0)
    t = np.linspace(0.0, 1.0, 60)
    one, many = _march(Path(robot, motion), t), nominal(robot, motion, t)
    assert _filled(_started(robot, motion), one.at(slice(None, None, 2)), t) is None
    assert np.allclose(one.q, many.q, rtol=0, atol=1e-11)


def _started(robot, motion):
    path = Path(robot, motion)
    path.start_from(nominal(robot, motion, np.array([0.0])).q[0])
    return path


@pytest.mark.parametrize("name", ["race_r1", "race_r2", "3rrr", "3rrs", "3tpt"])
def test_of_many_instants_few_are_marched_to(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the motion ends before the run does (race_r1)."""
    m, counted = mechanism(name), list[int]()
    until = m.description.solve.until or own_motion(m).duration
    march = module._march
    monkeypatch.setattr(module, "_march", lambda p, t, _: (counted.append(len(t)), march(p, t))[1])
    t = np.linspace(0.0, until, 401)
    m.followed.nominals.values.clear()
    m.followed.solved.values.clear()
    many = nominal(m, own_motion(m), t)
    assert sum(counted) < 10
    one = march(Path(m, own_motion(m)), t[::20])
    np.testing.assert_allclose(many.q[::20], one.q, atol=1e-11)


def test_quintics_are_those_of_scipy() -> None:
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0.0, 3.0, 9))
    values = [rng.normal(size=(9, 3)) for _ in range(3)]
    expected = BPoly.from_derivatives(t, np.stack(values, axis=1))
    at = np.linspace(t[0], t[-1], 97)
    for order, found in enumerate(_hermite(t, values)(at)):
        np.testing.assert_allclose(found, expected(at, order), rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize("name", ["3rrr", "delta", "hexapod", "race_r2"])
def test_three_samples_are_followed_as_finely_as_it_takes(name: str) -> None:
    """Half a turn of 3rrr in one step was refused as singular: the guess led to another branch."""
    few, many = (pf.solve(name, level="rigid", samples=n) for n in (3, 401))
    assert np.max(np.abs(few.torque - many.torque[::200])) < 1e-8 * np.max(np.abs(many.torque))


def test_instants_with_a_gap_are_followed_as_finely_as_it_takes(tmp_path: File) -> None:
    """Torques fed forward under friction ask so; Newton crossed the gap to the other branch."""
    m = four_bar(tmp_path, "continuous", (0.15, 0.4, 0.4, 0.35), "crank", (0.5, 0.5, 1.5))
    motion = pf.quintic(joints={"crank_joint": 2.5}, duration=0.5)
    t = np.linspace(0.0, 0.5, 1001)
    beside = (t < 0.15) | (t > 0.4)
    whole, parts = nominal(m, motion, t), nominal(m, motion, t[beside])
    # Newton leaves 1e-11 of a closed pose.
    np.testing.assert_allclose(parts.q, whole.q[beside], atol=1e-9)
