"""Freedoms that nothing hangs on: found, held, and without effect on anything else.

Claims:
    Hard cases
    - rod between balls, of three hinges or one: torques, sag and frequencies of the one on a cross,
      all levels | same machine | 2e-5 (inertia about its axis); rigid without it 1e-12 | passes
    - its rigid torques and the couple that holds it = rnea = S tau + J' lam + N mu | Pinocchio |
      1e-12 | passes
    - a rod whose hinges miss each other by 0.2 mm is held as nearly idle: its torques are those of
      the exact one | the exact one | 4e-3 | 1.4e-3
    - no singular pose where a motor on a hinge of the ball has one; two halves welded by a loop are
      one rod | ball | 1e-10 | passes
    - balanced wheel held, let go by coupled; massless ball without effect; free base held but by
      coupled | closed form | 1e-9; 1e-12; 1e-8 | passes
    - pendulums, governor, door on two hinges: still refused | - | exact | passes
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.studies.checking.check import check
from tests.scenes import Body, load

# A spatial four-bar: the crank turns about z, the rocker about x; their tips are 0.5 m apart.
CRANK, ROCKER, BETWEEN = 0.1, 0.3, np.array([0.3, 0.4, 0.0])


def four_bar(root: str, com: float = 0.0, spin: float = 0.0) -> tuple[Body, ...]:
    """The rod's root is a ball, a cross, or a ball of three hinges; its far end is a ball.

    com: Distance of the rod's centre of mass from its axis [m]. spin: Its inertia about the axis.
    """
    yaw = float(np.arctan2(BETWEEN[1], BETWEEN[0]))
    rod = {"mass": 0.4, "com": (0.25, com, 0.0), "inertia": (spin, 8e-3, 8e-3)}
    crank = Body("crank", "base", "revolute", mass=0.5, com=(0.05, 0, 0), inertia=(1e-3,) * 3)
    if root == "hinges":
        turned = {"xyz": (CRANK, 0, 0), "rpy": (0, 0, yaw)}
        ball = (
            Body("ball_x", "crank", "revolute", axis=(1, 0, 0), **turned),  # type: ignore[arg-type]
            Body("ball_y", "ball_x", "revolute", axis=(0, 1, 0)),
            Body("rod", "ball_y", "revolute", axis=(0, 0, 1), **rod),  # type: ignore[arg-type]
        )
    else:
        ball = (Body("rod", "crank", "fixed", (CRANK, 0, 0), (0, 0, yaw), **rod),)  # type: ignore[arg-type]
    pivot = (CRANK + BETWEEN[0], BETWEEN[1], -ROCKER)
    return (
        crank,
        *ball,
        Body("rod_end", "rod", xyz=(0.5, 0, 0)),
        Body("rocker", "base", "revolute", pivot, axis=(1, 0, 0), mass=0.6, com=(0, 0, 0.15),
             inertia=(5e-3,) * 3),
        Body("rocker_end", "rocker", xyz=(0, 0, ROCKER)),
    )  # fmt: skip


TYPES = {
    "ball": "joints: {rod_joint: {type: spherical}}",
    "cross": "joints: {rod_joint: {type: universal, axes: [z, y]}}",
    "hinges": "",
}
LINKS = """
flexible:
  rod:
    material: {E: 7.0e10, nu: 0.3, rho: 2700}
    section: {shape: circle, diameter: 0.008}
    end: rod_end
    torsion: false
    axial: false
  rocker:
    material: {E: 7.0e10, nu: 0.3, rho: 2700}
    section: {shape: rectangle, width: 0.02, thickness: 0.006}
    end: rocker_end
    up: y
"""


def robot(folder: Path, root: str, flexible: bool = True, **rod: float) -> pf.Mechanism:
    text = f"""
actuated: [crank_joint]
{TYPES[root]}
loops: {{tip: {{kind: spherical, between: [rod_end, rocker_end]}}}}
platform: rocker_end
{LINKS if flexible else ""}
"""
    return load(folder, four_bar(root, **rod), text)


MOVE = pf.cycloid(joints={"crank_joint": 0.6}, duration=0.2)


def test_the_spin_of_a_rod_is_found_and_named(tmp_path: Path) -> None:
    m = robot(tmp_path, "ball")
    assert m.idle.names == ("spin of rod",)
    assert (m.report.rows, m.report.rank, m.report.mobility) == (3, 3, 1)
    text = str(check(m))
    assert "mobility  1 = 5 joint coordinates - 3 independent closure rows - 1 idle" in text
    assert "idle      spin of rod: nothing hangs on it" in text
    assert robot(tmp_path, "cross").idle.names == ()


@pytest.mark.parametrize("root", ["ball", "hinges"])
def test_a_rod_between_balls_is_the_same_machine_as_with_a_cross(root: str, tmp_path: Path) -> None:
    """Torques of every level, sag and frequencies.

    A cross and a ball do not turn the rod about its axis alike: its 5e-7 kg m^2 about it make 1e-5
    of the torque. Without them the rigid torques are the same to round-off.
    """
    one, other = (robot(tmp_path, kind) for kind in (root, "cross"))
    still = [pf.static_equilibrium(m) for m in (one, other)]
    assert still[0].r[0] == pytest.approx(still[1].r[0], rel=1e-9)
    sag = [check(m).statics.full for m in (one, other)]
    assert sag[0] is not None and sag[1] is not None
    assert np.linalg.norm(sag[0].position) > 1e-9
    np.testing.assert_allclose(sag[0].position, sag[1].position, rtol=1e-7, atol=1e-12)
    f = [pf.modes(m, count=4).frequencies for m in (one, other)]
    np.testing.assert_allclose(f[0], f[1], rtol=1e-7)
    for level in pf.LEVELS:
        step = {"dt": 5e-4} if level in ("ked", "coupled") else {}
        runs = [pf.solve(m, MOVE, level=level, samples=41, **step) for m in (one, other)]
        peak = np.abs(runs[1].torque).max()
        assert np.abs(runs[0].torque - runs[1].torque).max() < 2e-5 * peak
        if level != "ked":
            # Newton of a step ends where the loops were open by 1e-9 before its last correction.
            gap = 1e-10 if level == "coupled" else 1e-12
            assert runs[0].arrays["residual/closure"].max() < gap
        spin = runs[0].arrays["multiplier"][:, -1]
        assert np.abs(spin).max() < 2e-5 * peak  # nothing else loads what holds it
    thin = [robot(tmp_path, kind, flexible=False) for kind in (root, "cross")]
    runs = [pf.solve(m, MOVE, level="rigid", samples=41) for m in thin]
    np.testing.assert_allclose(runs[0].torque, runs[1].torque, rtol=0, atol=1e-12)


def inverse_dynamics(m: pf.Mechanism, r: pf.Result) -> tuple[Array, Array]:
    """rnea = S tau + J' lam + N mu with Pinocchio alone: motor torque and holding couple, (nt,).

    J of the two points that the ball joins, N of the couple between crank and rod about what is
    perpendicular to the directions that the spin row keeps perpendicular.
    """
    model, spin = m.rigid.rigid, m.idle.spins[0]
    data = model.createData()
    ends = [m.rigid.expansion.frames[name] for name in ("rod_end", "rocker_end")]
    sides = [m.rigid.expansion.frames[name] for name in (spin.frame_a, spin.frame_b)]
    tau, mu = np.zeros(len(r.t)), np.zeros(len(r.t))
    for k in range(len(r.t)):
        q, v, a = (r.arrays[f"joint/{x}"][k] for x in "qva")
        left = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        world = pin.LOCAL_WORLD_ALIGNED
        points, turns, axes = [], [], []
        for end in ends:
            J = pin.getJointJacobian(model, data, end.joint, world)
            arm = data.oMi[end.joint].rotation @ end.placement.translation
            points.append(J[:3] - pin.skew(arm) @ J[3:])
        for side, axis in zip(sides, (spin.axis, spin.axis_b), strict=True):
            turns.append(pin.getJointJacobian(model, data, side.joint, world)[3:])
            R = data.oMi[side.joint].rotation @ side.placement.rotation
            axes.append(R @ np.array(axis))
        couple = np.cross(axes[1], axes[0]) @ (turns[1] - turns[0])
        S = np.eye(model.nv)[:, m.rigid.motors]
        A = np.hstack([S, (points[1] - points[0]).T, couple[:, None]])
        x = np.linalg.solve(A, left)
        tau[k], mu[k] = x[0], x[-1]
    return tau, mu


@pytest.mark.parametrize("root", ["ball", "hinges"])
def test_rigid_torques_are_those_of_constrained_inverse_dynamics(root: str, tmp_path: Path) -> None:
    m = robot(tmp_path, root, flexible=False, com=0.01, spin=1e-4)
    r = pf.solve(m, MOVE, level="rigid", samples=101)
    tau, mu = inverse_dynamics(m, r)
    scale = np.abs(tau).max()
    assert np.abs(r.torque[:, 0] - tau).max() < 1e-12 * scale
    assert np.abs(r.arrays["multiplier"][:, -1] - mu).max() < 1e-12 * scale
    assert r.arrays["residual/closure"].max() < 1e-15


def test_a_rod_that_is_not_straight_is_held_by_a_couple_that_check_names(tmp_path: Path) -> None:
    m = robot(tmp_path, "ball", flexible=False, com=0.01)
    warned = [w for w in check(m).warnings if w.startswith("spin of rod")]
    # The rod lies level, its centre beside it: m g times 10 mm.
    assert len(warned) == 1
    assert "spin of rod (0.0392 N m): the mass is off the axis" in warned[0]
    # Further off than a tenth of the rod it is a pendulum, which only level coupled lets swing.
    bent = robot(tmp_path, "ball", flexible=False, com=0.06)
    assert bent.idle.names == ()
    with pytest.raises(pf.MotionError, match="the motors do not determine the motion of"):
        pf.solve(bent, MOVE, level="rigid")


def test_what_holds_a_spin_stays_regular_where_a_motor_on_it_does_not(tmp_path: Path) -> None:
    """The crank turns by 115 degrees: a hinge that lay along the rod comes to lie across it.

    A motor on that hinge makes a pose singular that is not one of the machine.
    """
    bodies = four_bar("hinges")
    text = """
actuated: [crank_joint{}]
loops: {{tip: {{kind: spherical, between: [rod_end, rocker_end]}}}}
"""
    turn = pf.cycloid(joints={"crank_joint": 2.0}, duration=1.0)
    fake = load(tmp_path, bodies, text.format(", ball_x_joint"))
    with pytest.raises(pf.SingularityError):
        pf.solve(fake, turn, level="rigid", samples=201)
    free = load(tmp_path, bodies, text.format(""))
    assert free.idle.names == ("spin of rod",)
    ball = load(tmp_path, four_bar("ball"), TYPES["ball"] + text.format(""))
    runs = [pf.solve(m, turn, level="rigid", samples=201) for m in (free, ball)]
    peak = np.abs(runs[1].torque).max()
    assert np.abs(runs[0].torque - runs[1].torque).max() < 1e-10 * peak


def test_two_halves_of_a_rod_that_a_loop_welds_are_one_rod(tmp_path: Path) -> None:
    whole = robot(tmp_path, "ball", flexible=False)
    half = {"mass": 0.2, "inertia": (0.0, 1e-3, 1e-3)}
    bodies = tuple(b for b in four_bar("ball") if not b.name.startswith("rod"))
    yaw = float(np.arctan2(BETWEEN[1], BETWEEN[0]))
    bodies += (
        Body("near", "crank", "fixed", (CRANK, 0, 0), (0, 0, yaw), com=(0.125, 0, 0), **half),  # type: ignore[arg-type]
        # The weld is beside the line between the balls: it moves when the rod spins.
        Body("near_end", "near", xyz=(0.25, 0.01, 0)),
        Body("far", "rocker_end", "fixed", rpy=(0, 0, yaw), com=(-0.125, 0, 0), **half),  # type: ignore[arg-type]
        Body("far_end", "far", xyz=(-0.25, 0.01, 0)),
    )
    text = """
actuated: [crank_joint]
joints: {near_joint: {type: spherical}, far_joint: {type: spherical}}
loops: {middle: {kind: weld, between: [near_end, far_end]}}
"""
    m = load(tmp_path, bodies, text)
    assert m.idle.names == ("spin of near",)
    assert m.report.mobility == 1
    runs = [pf.solve(x, MOVE, level="rigid", samples=41) for x in (m, whole)]
    # Two halves of 1e-3 kg m^2, 0.125 m from the middle, are the rod's 8e-3 less 2.5e-4.
    assert np.abs(runs[0].arrays["joint/q"][:, 0] - runs[1].arrays["joint/q"][:, 0]).max() == 0
    assert np.abs(runs[0].torque).max() == pytest.approx(np.abs(runs[1].torque).max(), rel=1e-2)


ARM = Body(
    "arm", "base", "revolute", axis=(0, 0, 1), mass=1.0, com=(0.2, 0, 0), inertia=(0.01,) * 3
)
WHEEL = Body("wheel", "arm", "continuous", (0.4, 0, 0), axis=(0, 0, 1), mass=0.5,
             inertia=(1e-3, 1e-3, 4e-2))  # fmt: skip


def test_a_balanced_wheel_is_held_by_the_rigid_level_and_let_go_by_coupled(tmp_path: Path) -> None:
    m = load(tmp_path, (ARM, WHEEL), "actuated: [arm_joint]\n")
    assert m.idle.names == ("wheel_joint",)
    assert m.report.mobility == 1
    move = pf.quintic(joints={"arm_joint": 1.0}, duration=0.5)
    held, free = (pf.solve(m, move, level=x, samples=51, dt=1e-3) for x in ("rigid", "coupled"))
    a = held.joint("arm_joint").acceleration
    point = 0.01 + 1.0 * 0.2**2 + 0.5 * 0.4**2
    np.testing.assert_allclose(held.torque[:, 0], (point + 4e-2) * a, atol=1e-12)
    # Let go, the wheel keeps its attitude: its inertia about its own axis is not felt.
    np.testing.assert_allclose(free.torque[:, 0], point * a, atol=1e-9)
    turning = free.joint("wheel_joint").velocity + free.joint("arm_joint").velocity
    assert np.abs(turning).max() < 1e-4  # of 3.7 rad/s: what steps of 1/500 of the move leave


def test_a_massless_ball_is_held_at_every_level(tmp_path: Path) -> None:
    bodies = (ARM, Body("ball", "arm", "fixed", (0.4, 0, 0)))
    head = "actuated: [arm_joint]\njoints: {ball_joint: {type: spherical}}\n"
    m = load(tmp_path, bodies, head)
    assert len(m.idle.rows) == 3
    move = pf.quintic(joints={"arm_joint": 1.0}, duration=0.5)
    alone = load(tmp_path, (ARM,), "actuated: [arm_joint]\n")
    for level in ("rigid", "coupled"):
        r, plain = (pf.solve(x, move, level=level, samples=51, dt=1e-3) for x in (m, alone))
        np.testing.assert_allclose(r.torque, plain.torque, atol=1e-12)


BOB = {"mass": 1.0, "inertia": (0.01,) * 3}
MOVING = {
    "pendulum": (Body("rod", "base", "revolute", axis=(0, 1, 0), com=(0, 0, -0.5), **BOB),),  # type: ignore[arg-type]
    "upright pendulum": (Body("rod", "base", "revolute", axis=(0, 1, 0), com=(0, 0, 0.5), **BOB),),  # type: ignore[arg-type]
    "pendulum without gravity": (Body("rod", "base", "revolute", com=(0.5, 0, 0), **BOB),),  # type: ignore[arg-type]
    "governor": (
        Body("shaft", "base", "continuous", **BOB),  # type: ignore[arg-type]
        Body("left", "shaft", "revolute", (0, 0, 1), axis=(1, 0, 0), com=(0, 0.3, -0.3), **BOB),  # type: ignore[arg-type]
        Body("right", "shaft", "revolute", (0, 0, 1), axis=(1, 0, 0), com=(0, -0.3, -0.3), **BOB),  # type: ignore[arg-type]
    ),
    "wheel with the platform on it": (ARM, WHEEL, Body("tool", "wheel", xyz=(0.1, 0, 0))),
}  # fmt: skip


@pytest.mark.parametrize("name", MOVING)
def test_what_truly_moves_is_still_refused(name: str, tmp_path: Path) -> None:
    motors = "[arm_joint]\nplatform: tool" if "platform" in name else "[]"
    m = load(tmp_path, MOVING[name], f"actuated: {motors}\n")
    assert m.idle.names == ()
    assert m.report.mobility > len(m.motors)
    with pytest.raises(pf.MotionError, match="the motors do not determine the motion of"):
        pf.solve(m, pf.hold(duration=0.1), level="rigid")


def test_a_door_on_two_hinges_is_no_idle_rod(tmp_path: Path) -> None:
    door = Body("door", "base", "revolute", axis=(1, 0, 0), com=(0.5, 0.4, 0), **BOB)  # type: ignore[arg-type]
    bodies = (door, Body("door_end", "door", xyz=(1, 0, 0)), Body("post", "base", xyz=(1, 0, 0)))
    text = "actuated: []\nloops: {hinge: {kind: spherical, between: [door_end, post]}}\n"
    m = load(tmp_path, bodies, text)
    assert m.idle.names == ()
    assert m.report.mobility == 1


FLYING = """
base: free_flyer
actuated: [arm_joint]
platform: hand
flexible:
  arm:
    material: {E: 7.0e10, nu: 0.3, rho: 2700}
    section: {shape: circle, diameter: 0.01}
    bending_y: true
    bending_z: true
    torsion: false
    axial: false
    end: hand
"""


def test_a_free_base_is_held_but_at_level_coupled(tmp_path: Path) -> None:
    bodies = (
        Body("hull", "base", mass=5.0, inertia=(0.1,) * 3),
        Body("arm", "hull", "revolute", axis=(0, 1, 0)),
        Body("hand", "arm", xyz=(0.6, 0, 0), mass=0.2, inertia=(1e-4,) * 3),
    )
    free = load(tmp_path, bodies, FLYING)
    assert free.idle.names == ("free base",)
    assert free.report.mobility == 1
    fixed = load(tmp_path, bodies, FLYING.replace("free_flyer", "fixed"))
    both = (free, fixed)
    np.testing.assert_allclose(*(pf.modes(m, count=4).frequencies for m in both), rtol=1e-9)
    sags = [check(m).statics.full for m in both]
    assert sags[0] is not None and sags[1] is not None
    np.testing.assert_allclose(sags[0].position, sags[1].position, atol=1e-12)
    move = pf.cycloid(joints={"arm_joint": 0.5}, duration=0.2)
    for level in ("rigid", "quasistatic", "ked"):
        r, plain = (pf.solve(m, move, level=level, samples=41, dt=5e-4) for m in both)
        np.testing.assert_allclose(r.torque, plain.torque, atol=1e-8)
    fall = pf.solve(free, pf.hold(duration=0.1), level="coupled", samples=11, dt=1e-3)
    # Straight, and nothing to bend it while it falls.
    assert fall.meta["settings"]["start"] == "straight"
    z = fall.frame("hand").position[:, 2]
    np.testing.assert_allclose(z, -0.5 * 9.81 * fall.t**2, atol=1e-9)


def test_frequencies_list_what_is_elastic_and_count_what_is_not(tmp_path: Path) -> None:
    text = "actuated: [arm_joint]\n" + FLYING.split("\n", 3)[3].replace("platform: hand", "")
    bodies = (
        Body("arm", "base", "revolute", axis=(0, 1, 0)),
        Body("hand", "arm", xyz=(0.6, 0, 0), mass=0.2, inertia=(1e-4,) * 3),
        Body("bob", "hand", "revolute", axis=(0, 1, 0), com=(0, 0, -0.2), mass=0.1),
    )
    m = load(tmp_path, bodies, "gravity: [0, 0, 0]\n" + text)
    found = check(m)
    assert min(found.frequencies) > 1.0
    assert found.frequency_note.endswith("1 rigid-body mode at 0 Hz")


def missed(by: float) -> tuple[Body, ...]:
    """The four-bar with a ball of three hinges whose last one misses the others."""
    return tuple(
        replace(body, xyz=(by, by, by)) if body.name == "rod" else body
        for body in four_bar("hinges", spin=1e-5)
    )


def test_a_spin_whose_hinges_miss_by_a_cad_s_decimals_is_held_and_said(tmp_path: Path) -> None:
    """0.2 mm in a rod of 0.5 m; by 20 mm it is a freedom, and level rigid refuses."""
    text = f"""
actuated: [crank_joint]
loops: {{tip: {{kind: spherical, between: [rod_end, rocker_end]}}}}
platform: rocker_end
{LINKS}
"""
    exact, near, far = (load(tmp_path, missed(by), text) for by in (0.0, 2e-4, 2e-2))
    assert (exact.idle.names, near.report.mobility) == (("spin of rod",), 1)
    (name,) = near.idle.names
    said = re.fullmatch(r"spin of rod \(nearly: other bodies move by (\S+) of it\)", name)
    # The hinges turn the rod about a line beside the one that they meet on: the rest, of second
    # order, moves by the square of 0.2 mm over a link, or less.
    assert said is not None and float(said[1]) < (2e-4 / CRANK) ** 2
    assert name in str(check(near))
    for level in ("rigid", "quasistatic"):
        one, other = (pf.solve(m, MOVE, level=level, samples=11).torque for m in (exact, near))
        # the linkage itself is another: by 0.2 mm of the crank's 0.1 m, 2e-3
        np.testing.assert_allclose(other, one, atol=2 * 2e-3 * np.abs(one).max())
    with pytest.raises(pf.MotionError, match="do not determine the motion of"):
        pf.solve(far, MOVE, level="rigid")
