"""The play of a platform beside every contact state, and beside an independent programme.

Claims:
    Levels, energy, steps
    - play of the 3-RRR with 50 um in nine pins: along 48 directions, farthest, turn; two poses |
      own Newton over the contact states of the pins; 1 % | 0.26 %
    - play of overconstrained loops | scipy's SLSQP on the other programme; closed form of a bar on
      three cranks; 1e-6 | passes
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

import pinflex as pf
from pinflex.__main__ import main
from pinflex.arrays import Array
from pinflex.results.play import Play
from pinflex.studies.pose import moved
from tests.scenes import Body, load

C = 5e-5  # [m] in each of the nine pins of the 3-RRR


def legs(robot: pf.Mechanism, q: Array) -> tuple[Array, Array, Array]:
    """Of the 3-RRR by its URDF alone: ends of cranks, pins on the platform, its origin, in x-y."""
    model = pin.buildModelFromXML(robot.description.urdf_text)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    at = {frame.name: data.oMf[k].translation[:2] for k, frame in enumerate(model.frames)}
    cranks = np.array([at[f"distal_{k}"] for k in (1, 2, 3)])
    corners = np.array([at["pin_1"], at["platform_c2"], at["platform_c3"]])
    return cranks, corners, at["platform"]


def brute(cranks: Array, corners: Array, origin: Array) -> Array:
    """Platform (x, y, turn) in all states in which every pin leans against its hole, (states, 3).

    A crank does not turn while its motor stands, so its pins move its end by a disc; so does the
    pin on the platform. Of three discs in a row the sum is a disc, and the distal link, rigid, is
    longest and shortest with all pins leaning along it: 2^9 states, of which those of a leg that
    add to the same length are one.
    """
    ways = cranks - corners
    lengths, found = np.linalg.norm(ways, axis=1), []
    for leans in product((-3 * C, -C, C, 3 * C), repeat=3):
        z = np.zeros(3)
        for _ in range(20):
            turned = (corners - origin) @ np.array(
                [[np.cos(z[2]), np.sin(z[2])], [-np.sin(z[2]), np.cos(z[2])]]
            )
            d = origin + z[:2] + turned - cranks
            now = np.linalg.norm(d, axis=1)
            u = d / now[:, None]
            J = np.column_stack([u, u[:, 1] * turned[:, 0] - u[:, 0] * turned[:, 1]])
            step = np.linalg.solve(J, lengths + leans - now)
            z += step
        assert np.max(np.abs(step)) < 1e-15
        found.append(z)
    return np.array(found)


@pytest.mark.parametrize("by", [{}, {"x": 0.05, "y": -0.04}], ids=["home", "aside"])
def test_the_three_rrr_reaches_what_its_contact_states_reach(by: dict[str, float]) -> None:
    robot = pf.load("3rrr")
    q = moved(robot, by)
    found, states = pf.play(robot, q, "50 um"), brute(*legs(robot, q))
    assert len(found.places) == 9
    turn = 2 * np.pi * np.arange(48) / 48
    u = np.zeros((50, 6))
    u[:48, 0], u[:48, 1], u[48:, 5] = np.cos(turn), np.sin(turn), (1.0, -1.0)
    exact = np.max(states @ u[:, [0, 1, 5]].T, axis=0)
    # The second order of 150 um on legs of 0.17 m and more, and of 2.6 mrad.
    np.testing.assert_allclose(found.reach(u), exact, rtol=0.01)
    assert found.farthest[0] == pytest.approx(np.linalg.norm(states[:, :2], axis=1).max(), rel=0.01)
    assert found.largest_turn[0] == pytest.approx(np.abs(states[:, 2]).max(), rel=0.01)
    assert np.all(found.extent[2:5] < 1e-12)


def test_a_smaller_clearance_is_closer_to_first_order() -> None:
    """What is left out is of second order: a share as large as the turn itself."""
    robot = pf.load("3rrr")
    exact = brute(*legs(robot, robot.home))
    whole, u = pf.play(robot, clearance=C), np.eye(6)[[0, 1, 5]]
    off = np.abs(whole.reach(u) / np.max(exact, axis=0) - 1.0)
    assert np.max(off) < 2.6e-3  # 2.6 mrad of turn, to the first power


@pytest.mark.parametrize("seed", [1, 2])
def test_overconstrained_loops_reach_what_another_programme_finds(seed: int) -> None:
    """max u . sum T d, |d| <= c, sum S d = 0 (scipy) against the dual that pinflex solves."""
    random = np.random.default_rng(seed)
    T, S = random.normal(size=(5, 6, 2)), random.normal(size=(5, 2, 2))
    c, u = random.uniform(0.5, 2.0, 5), random.normal(size=6)
    loose = Play("", tuple("abcde"), c, tuple(T), tuple(S), np.zeros((6, 0)))
    gain = np.concatenate([u @ each for each in T])
    best = minimize(
        lambda d: -gain @ d, np.zeros(10), jac=lambda d: -gain, method="SLSQP",
        constraints=[
            {"type": "eq", "fun": lambda d: np.concatenate(S, axis=1) @ d},
            {"type": "ineq", "fun": lambda d: c**2 - (d.reshape(5, 2) ** 2).sum(axis=1)},
        ],
        options={"ftol": 1e-12, "maxiter": 500},
    )  # fmt: skip
    assert best.success
    assert loose.reach(u) == pytest.approx(-best.fun, rel=1e-6)  # SLSQP's feasibility


def test_a_bar_on_three_equal_cranks_needs_its_pins_to_agree(tmp_path: Path) -> None:
    """A bar along x on three legs along y, the middle one twice as loose: moves along y agree.

    Legs hold y at three places of a bar that has y and a turn: the outer ones let its middle move
    by 2 c (two pins a leg), the middle leg by 4 c; and the bar cannot move along x, where its motor
    holds the first leg, by more than that leg's two pins.
    """
    legs = [
        part
        for k, x in enumerate((0.0, 0.3, 0.6))
        for part in (
            Body(f"leg_{k}", "base", "revolute", xyz=(x, 0, 0), mass=1.0),
            Body(f"tip_{k}", f"leg_{k}", xyz=(0, 0.2, 0)),
        )
    ]
    bar = [
        Body("bar", "tip_0", "revolute", mass=1.0, com=(0.3, 0, 0)),
        *(Body(f"seat_{k}", "bar", xyz=(0.3 * k, 0, 0)) for k in (1, 2)),
    ]
    loops = ", ".join(f"p{k}: {{kind: planar, between: [tip_{k}, seat_{k}]}}" for k in (1, 2))
    robot = load(tmp_path, [*legs, *bar], f"""
actuated: [leg_0_joint]
loops: {{{loops}}}
platform: seat_1
""")  # fmt: skip
    pins = {"leg_0_joint": C, "bar_joint": C, "leg_2_joint": C, "p2": C}
    found = pf.play(robot, clearance=pins | {"leg_1_joint": 2 * C, "p1": 2 * C})
    assert found.agree[0].shape[0] == 1
    x, y, turn = found.reach(np.eye(6)[[0, 1, 5]])
    assert x == pytest.approx(2 * C, rel=1e-6)
    assert y == pytest.approx(2 * C, rel=1e-6)
    assert turn == pytest.approx(4 * C / 0.6, rel=1e-6)
    # 2 c (cos a, (1 + sin a) / 2), the first leg leaning to a and the third up: sin a = 1/3.
    assert found.farthest[0] == pytest.approx(4 / np.sqrt(3) * C, rel=1e-6)


def test_backlash_moves_the_arm_and_clearance_needs_a_pin(tmp_path: Path) -> None:
    """An arm of 0.4 m in a gear of 0.2 deg: half of it, times the arm."""
    arm = [Body("arm", "base", "revolute", mass=1.0), Body("tip", "arm", xyz=(0.4, 0, 0))]
    drive = "joints: {arm_joint: {drive: {stiffness: 1e4, backlash: 0.2 deg}}}\nplatform: tip\n"
    found = pf.play(load(tmp_path, arm, drive))
    assert found.reach([0, 1, 0, 0, 0, 0]) == pytest.approx(0.4 * np.radians(0.1), rel=1e-12)
    assert found.extent[0] < 1e-15
    with pytest.raises(pf.DescriptionError, match="elbow: no pin or ball"):
        pf.play(load(tmp_path, arm, drive), clearance={"elbow": C})
    with pytest.raises(pf.DescriptionError, match="nothing is loose"):
        pf.play(load(tmp_path, arm, "platform: tip\n"))


def test_the_map_has_the_play_of_each_pose() -> None:
    grid = {"x": [-0.03, 0.03], "y": [0.0, 0.02]}
    found = pf.play_map("3rrr", grid, clearance=C)
    robot = pf.load("3rrr")
    one = pf.play(robot, moved(robot, {"x": 0.03, "y": 0.0}), C)
    assert found.table["play"][2] == pytest.approx(one.farthest[0], rel=1e-12)
    ax, _ = found.plot()
    assert len(ax.collections[0].get_paths()) == 4
    assert len(one.outline()) == len(one.plot().patches[0].get_xy()) - 1


def test_the_command_line_maps_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = tmp_path / "play.png"
    given = ["map", "3rrr", "--play", "50um", "--grid", "x=0:.02:2", "--plot", str(figure)]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert "play.turn" in said and "2 cases, 2 done" in said
    assert figure.stat().st_size > 1000
