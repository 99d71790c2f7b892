"""Commands that cannot be had: what is said, and that it helps."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from inversion.test_command import nonic_motion
from inversion.test_command_bars import five_bar, off_path, two_links

import pinflex as pf
from pinflex.inversion import on_grid
from pinflex.inversion.on_grid import Poles


def test_links_that_swing_too_far_beside_the_path_say_where_none_is_held(tmp_path: Path) -> None:
    with pytest.raises(pf.ConvergenceError, match="held: z, by 2 motors; in what is not named"):
        pf.command(two_links(tmp_path), nonic_motion(0.1, x=-0.2, z=0.3), coordinates=["z"])


BOOM = """
actuated: [post_joint, boom_joint]
platform: hook
joints: {sway_joint: {spring: 1e-3}, load_joint: {spring: 1e-3}}
flexible:
  boom: {material: steel, section: {shape: tube, diameter: 0.15, wall: 0.01}, end: sway}
"""


def test_a_crane_whose_inversion_does_not_settle_hears_what_does(tmp_path: Path) -> None:
    """150 kg on a rope of 2.5 m below a boom that bends, slewed by 0.4 rad in 6 s.

    Exact corrections shrink by a few per cent each there, and more instants do not help.
    """
    body = scenes.Body
    robot = scenes.load(tmp_path, [
        body("post", "base", "revolute", mass=200, com=(0, 0, 1), inertia=(80, 80, 20)),
        body("boom", "post", "revolute", (0, 0, 2), (0, -0.6, 0), (0, 1, 0), 138, (2, 0, 0),
             (0.7, 184, 184)),
        body("sway", "boom", "continuous", (4, 0, 0), (0, 0.6, 0), (0, 1, 0)),
        body("load", "sway", "continuous", axis=(1, 0, 0), mass=150, com=(0, 0, -2.5),
             inertia=(5, 5, 5)),
        body("hook", "load", xyz=(0, 0, -2.5)),
    ], BOOM, inertia="urdf")  # fmt: skip
    motion = pf.nonic(joints={"post_joint": 0.4}, duration=6.0)
    said = r"Take level quasistatic, which misses (\S+) m of (\w), the rigid one (\S+), or slow"
    with pytest.raises(pf.ConvergenceError, match=said) as refused:
        pf.command(robot, motion)
    told = re.search(said, str(refused.value))
    found = pf.command(robot, motion, "quasistatic")
    assert told is not None
    k = found.coordinates.index(told[2])
    assert found.error[k] == pytest.approx(float(told[1]), rel=0.05)  # two digits, another grid
    off, rigid = (
        off_path(robot, motion, x, 0.0)
        for x in (found, pf.command(robot, motion, "rigid", before=found.before, after=found.after))
    )
    # 1 %: the bar is of a forward run that looks at other instants
    assert np.all(off < 1.01 * found.error) and np.all(off > 0.5 * found.error)
    assert np.max(off) < 0.01 * np.max(rigid)  # 0.4 mm of 250


def test_a_swing_that_grows_slowly_is_met_on_a_coarse_grid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """0.6 in 1 s at 20 rad/s is not held by 0.6 s of rest ahead; damped, or with 40 s, none is.

    An inversion that does not settle then costs instants by that swing, not by the fastest mode.
    """
    grows, fades = np.array([0.6 + 20j, 0.6 - 20j]), np.array([-0.6 + 20j, -0.6 - 20j])
    assert Poles(grows, grows).swing_from(0.6) == pytest.approx(abs(grows[0]), rel=1e-15)
    assert Poles(grows, grows).swing_from(40.0) == Poles(fades, grows).swing_from(0.6) == 0.0
    robot, quick = two_links(tmp_path), nonic_motion(0.1, x=-0.2, z=0.3)
    seen = []
    for rate in (0.0, 150.0):
        monkeypatch.setattr(Poles, "swing_from", lambda *_, rate=rate: rate)
        with pytest.raises(pf.ConvergenceError, match=r"over \d+ instants") as refused:
            pf.command(robot, quick, coordinates=["z"])
        seen.append(int(str(refused.value).split("over ")[1].split()[0]))
    assert seen[1] < 0.5 * seen[0]


def test_a_finer_grid_that_does_not_settle_leaves_the_coarser_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rotor of 20 m did so; its coarse command is right to 1e-6 rad."""
    robot, motion = five_bar(tmp_path), pf.cycloid(joints={"cl_joint": 0.5}, duration=0.2)
    tried, first = [], on_grid.invert

    def once(*given: Any) -> Any:
        tried.append(len(given[1].y))
        if len(tried) > 1:
            raise pf.ConvergenceError("finer: no")
        return first(*given)

    monkeypatch.setattr(on_grid, "invert", once)
    found = pf.command(robot, motion)
    assert len(tried) == 2 and len(found.t) < tried[0] < tried[1]


def test_what_cannot_be_commanded_is_refused_by_name(planar: pf.Mechanism) -> None:
    with pytest.raises(pf.MotionError, match="acceleration of x jumps in a trapezoid"):
        pf.command(planar, pf.trapezoid(platform={"x": 0.01}, duration=0.1, ramp=0.02))
    with pytest.raises(pf.DescriptionError, match="level: exakt.*exact"):
        pf.command(planar, nonic_motion(0.1, x=0.01, y=0.0, rz=0.0), "exakt")
    move = nonic_motion(0.1, x=0.01, y=0.0, rz=0.0)
    for options, what in (
        ({"tol": -1.0}, "tol = -1"),
        ({"tol": 1e-3, "level": "quasistatic"}, "the others have one grid"),
        ({"instants": -3}, "instants = -3. Give a whole number from 30"),
        ({"instants": 10}, "instants = 10"),
        ({"before": -0.1}, "before = -0.1. Give seconds"),
    ):  # fmt: skip
        with pytest.raises(pf.DescriptionError, match=what):
            pf.command(planar, move, **options)
    with pytest.raises(pf.MotionError, match="the speed of x jumps where a harmonic motion begins"):
        pf.command(planar, pf.harmonic(platform={"x": 0.002}, frequency=2.0, duration=1.0))
    with pytest.raises(pf.DescriptionError, match="nothing deforms"):
        pf.command(pf.load("ur5", ["flexible=null", "damping=null"]))


def test_a_tolerance_out_of_reach_is_refused_with_its_floor(planar: pf.Mechanism) -> None:
    move = nonic_motion(0.1, x=0.01, y=0.0, rz=0.0)
    begun = time.process_time()
    with pytest.raises(pf.ConvergenceError, match="tol = 1e-11 is out of reach") as refused:
        pf.command(planar, move, tol=1e-11)
    floor = refused.value.data["floor"]
    assert 1e-11 < floor < 1e-4
    had = pf.command(planar, move, tol=2 * floor)
    assert (had.error - had.cut_off).max() < 2 * floor * 0.01  # it can be had
    assert time.process_time() - begun < 60  # it was 63 s for the first alone


def test_a_command_beyond_the_motors_is_refused_and_says_how_long_it_must_take() -> None:
    """The delta's motors have 120 N m and 15 rad/s in its URDF; rigid inverse dynamics judge."""
    robot, most = pf.load("delta"), []
    quick = pf.nonic(platform={"x": 0.305, "y": 0.0, "z": 0.0}, duration=0.08)
    given = {"level": "rigid", "before": 0.01, "after": 0.01, "instants": 60}
    said = r"motor_\d needs .* effort limit is 120. Slow .* to ([\d.]+) s, .*limited"
    with pytest.raises(pf.MotionError, match=said) as refused:
        pf.command(robot, quick, **given)
    told = re.search(said, str(refused.value))
    assert told is not None
    for share in (1.0, 0.98):
        move = pf.nonic(platform={"x": 0.305, "y": 0.0, "z": 0.0}, duration=share * float(told[1]))
        most.append(np.abs(pf.solve(robot, move, level="rigid").torque).max())
    # instants are 3 ms apart, and a peak of 50 ms is 0.5 % higher between two of them at the most
    assert most[0] < 1.005 * 120.0 < most[1]
