"""Profiles by limits: no other motion goes as far in their time, and every limit is kept.

Claims:
    Commands: motions that the platform follows
    - profiles by limits: no motion goes further in the time of an S-curve or trapezoid (every case
      of short ways) | linear programme over jerks; areas by hand | 1e-6; 1e-12 | passes
    - all limits kept, one met, in step; the time of the slowest joint alone | samples; ruckig |
      1e-9; 1e-8 | passes
"""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import pinflex as pf
from pinflex.description.motions.motion import from_spec
from pinflex.description.robots.urdf import limits

STEP = 0.1  # [s]: every profile below changes its jerk at multiples of it

URDF = """<robot name="arm" version="1.2"><link name="base"/>
<link name="a"><inertial><mass value="1"/><origin xyz=".2 0 0"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><mass value="1"/><origin xyz=".2 0 0"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="50" velocity="1" acceleration="2" deceleration="3" jerk="10"/>
</joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz=".4 0 0"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="50" velocity="4"/></joint></robot>
"""


def furthest(time: float, v: float, a: float, j: float) -> float:
    """How far a mass gets from rest to rest in a time, by a linear programme over jerks.

    Jerks are constant in every step; speeds between are bounded by their Bezier points, so that
    every solution keeps the limits: no profile with jerks on this grid goes further.
    """
    n = round(time / STEP)
    powers = np.arange(n, 0, -1) - 0.5  # of a step's middle, before the end
    A = np.tril(np.full((n, n), STEP))  # accelerations at the ends of steps
    before = np.vstack([np.zeros(n), A[:-1]])
    V = np.cumsum(STEP * before + 0.5 * STEP**2 * np.eye(n), axis=0)
    V_before = np.vstack([np.zeros(n), V[:-1]])
    bezier = V_before + 0.5 * STEP * before
    distance = STEP**3 * (0.5 * powers**2 + 1.0 / 24.0)
    rows = np.vstack([A, -A, V, -V, bezier, -bezier])
    most = np.concatenate([np.full(2 * n, a), np.full(4 * n, v)])
    rest = np.vstack([A[-1], V[-1]])
    found = linprog(-distance, rows, most, rest, np.zeros(2), bounds=[(-j, j)] * n)
    return float(-found.fun)


@pytest.mark.parametrize(
    "v, a, j, way, time",
    [
        (1.0, 2.0, 10.0, 1.0, 1.7),  # speed and acceleration are reached
        (1.0, 2.0, 10.0, 0.48, 1.2),  # the acceleration is, the speed is not
        (0.4, 3.0, 10.0, 0.28, 1.1),  # the speed is, the acceleration is not
        (1.0, 3.0, 10.0, 0.16, 0.8),  # neither
        (1.0, 5.0, 25.0, 0.4, 0.8),  # both just so, without constant speed
    ],
)
def test_no_motion_goes_further_in_the_time_of_an_scurve(
    v: float, a: float, j: float, way: float, time: float
) -> None:
    motion = pf.scurve(joints={"x": -way}, velocity=v, acceleration=a, jerk=j)
    assert motion.duration == pytest.approx(time, rel=1e-12)  # by hand, from the areas
    # HiGHS ends within 1e-7 of feasible.
    assert furthest(time, v, a, j) == pytest.approx(way, abs=1e-6)
    assert motion(motion.duration)[0] == -way


@pytest.mark.parametrize(
    "v, a, way, time", [(1.0, 2.0, 1.5, 2.0), (3.0, 2.0, 2.0, 2.0), (2.0, 2.0, 2.0, 2.0)]
)
def test_trapezoids_by_limits(v: float, a: float, way: float, time: float) -> None:
    """way = v (T - v / a), or a T^2 / 4 where the speed is not reached."""
    motion = pf.trapezoid(joints={"x": way}, velocity=v, acceleration=a)
    assert motion.duration == pytest.approx(time, rel=1e-14)
    t = np.linspace(0.0, time, 401)
    _, speed, acceleration = motion.evaluate(t)
    assert speed.max() == pytest.approx(min(v, np.sqrt(a * way)), rel=1e-12)
    assert np.abs(acceleration).max() == pytest.approx(a, rel=1e-12)
    again = from_spec(motion.spec, "motion")
    assert again.duration == motion.duration and (again(t) == motion(t)).all()


def random_limits(seed: int, names: str) -> dict[str, dict[str, float]]:
    draw = np.random.default_rng(seed)
    sizes = {"velocity": 1.0, "acceleration": 3.0, "jerk": 20.0}
    return {
        key: {name: float(x * 10.0 ** draw.uniform(-1, 1)) for name in names}
        for key, x in sizes.items()
    }


@pytest.mark.parametrize("kind", ["scurve", "ruckig"])
@pytest.mark.parametrize("seed", range(8))
def test_every_limit_is_kept_and_one_is_met(kind: str, seed: int) -> None:
    if kind == "ruckig":
        pytest.importorskip("ruckig")
    most = random_limits(seed, "abc")
    ways = dict(zip("abc", np.random.default_rng(99 + seed).uniform(-2, 2, 3), strict=True))
    motion = getattr(pf, kind)(joints=ways, **most)
    t = np.linspace(0.0, motion.duration, 4001)
    p, v, a = motion.evaluate(t)
    jerk = np.diff(a, axis=0) / (t[1] - t[0])
    used = [
        np.abs(x).max(axis=0) / [*limit.values()]
        for x, limit in zip((v, a, jerk), most.values(), strict=True)
    ]
    assert np.max(used) <= 1.0 + 1e-9 if kind == "scurve" else np.max(used) <= 1.0 + 1e-7
    # Between samples of 1/4000 of the time a peak of the speed is missed by 1e-6 of it.
    assert np.max(used) > 1.0 - 1e-3
    assert p[-1] == pytest.approx([*ways.values()], rel=1e-12)
    if kind == "scurve":  # straight, in step
        share = p / [*ways.values()]
        assert np.ptp(share, axis=1).max() < 1e-12
    again = from_spec(motion.spec, "motion")
    assert (again(t) == motion(t)).all() and (pickle.loads(pickle.dumps(motion))(t) == p).all()


@pytest.mark.parametrize("seed", range(8))
def test_ruckig_takes_the_time_of_the_slowest_joint_alone(seed: int) -> None:
    """Another's solution, from general states, of what `scurve` has in closed form."""
    pytest.importorskip("ruckig")
    most = random_limits(100 + seed, "abc")
    ways = dict(zip("abc", np.random.default_rng(seed).uniform(-2, 2, 3), strict=True))
    alone = [pf.scurve(joints={name: way}, **most).duration for name, way in ways.items()]
    together = pf.ruckig(joints=ways, **most)
    # Roots of ruckig's polynomials: 1e-9 and better.
    assert together.duration == pytest.approx(max(alone), rel=1e-8)
    assert pf.scurve(joints=ways, **most).duration >= max(alone) * (1 - 1e-12)


def arm(folder: Path, motion: str) -> pf.Mechanism:
    (folder / "arm.urdf").write_text(URDF)
    (folder / "arm.yaml").write_text(f"urdf: arm.urdf\nmotion: {motion}\n")
    return pf.load(folder / "arm.yaml")


def test_a_scene_takes_the_limits_of_its_urdf(tmp_path: Path) -> None:
    robot = arm(tmp_path, "{kind: scurve, joints: {j1: 1}}")
    run = pf.solve(robot, level="rigid", samples=3)
    # 1 rad at 1 rad/s, 2 rad/s^2 (less than the 3 of slowing down), 10 rad/s^3.
    assert run.t[-1] == pytest.approx(1.7, rel=1e-12)
    found = robot.limits
    assert (found.velocity, found.acceleration) == ({"j1": 1.0, "j2": 4.0}, {"j1": 2.0})
    assert (found.jerk, found.effort) == ({"j1": 10.0}, {"j1": 50.0, "j2": 50.0})
    own = pf.scurve(joints={"j1": 1}, velocity=1, acceleration=found.acceleration, jerk=10)
    assert own.duration == run.t[-1]
    faster = arm(tmp_path, "{kind: trapezoid, joints: {j1: 1}, acceleration: {j1: 4}}")
    assert pf.solve(faster, level="rigid", samples=3).t[-1] == pytest.approx(1.25, rel=1e-12)
    assert limits(URDF.replace('deceleration="3"', 'deceleration="1"'))["j1"].acceleration == 1.0


@pytest.mark.parametrize(
    "motion, words",
    [
        ("{kind: scurve, joints: {j2: 1}}", r"motion\.acceleration: j2 has no acceleration limit"),
        ("{kind: scurve, joints: {j1: 1}, jerk: 0}", r"motion\.jerk: 0 rad/s\^3"),
        ("{kind: scurve, joints: {j1: 0}}", "every displacement is 0"),
        ("{kind: scurve, joints: {j1: 1}, jerk: {j1: x}}", r"motion\.jerk\.j1: 'x'"),
        ("{kind: trapezoid, joints: {j1: 1}, duration: 1}", r"motion\.ramp: missing"),
        (
            "{kind: trapezoid, joints: {j1: 1}, ramp: 0.1, duration: 1, velocity: 1}",
            "times and limits are given",
        ),
    ],
)
def test_what_makes_no_profile_is_told(motion: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(pf.DescriptionError, match=words):
        arm(tmp_path, motion)


def test_a_motion_without_a_kind_is_told_so() -> None:
    with pytest.raises(pf.DescriptionError, match=r"motion\.kind: None is no motion"):
        pf.load("ur5", ["motion={joints: {elbow_joint: 0.3}, duration: 1}"])
