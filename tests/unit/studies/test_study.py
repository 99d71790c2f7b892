"""A comparison: level coupled within a tolerance, or in the steps that a scene asks for.

Claims:
    Pages, pictures, figures
    - compare solves coupled to 1e-3 where the steps are open, in equal steps where they are not or
      that is out of reach | ur5 by tol 1e-6: 1e-3 | 2.2e-4 (equal steps 2.6e-3)
"""

from __future__ import annotations

import gc
import re
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import settled
from pinflex.errors import ConvergenceError
from pinflex.studies import study as open_steps

LEVELS = ("coupled",)


def test_coupled_is_within_a_thousandth_where_the_scene_leaves_its_steps_open() -> None:
    robot = pf.load("ur5")
    run = pf.compare(robot, levels=LEVELS)["coupled"]
    exact = pf.solve(robot, level="coupled", tol=1e-6)
    equal = pf.solve(robot, level="coupled")

    def miss(found: pf.Result) -> float:
        return float(np.max(np.abs(found.torque - exact.torque)) / np.max(np.abs(exact.torque)))

    assert run.meta["settings"]["tol"] == 1e-3
    assert miss(run) < 1e-3  # 2.2e-4, where equal steps leave 2.6e-3
    assert miss(run) < 0.2 * miss(equal)


@pytest.mark.parametrize("asked", ["solve.dt=1e-3", "solve.integrator=hht", "solve.rho_inf=0.9"])
def test_steps_that_a_scene_asks_for_are_taken(asked: str) -> None:
    robot = pf.load("3rrr", ["solve.until=0.02", "solve.samples=21", asked])
    assert "tol" not in pf.compare(robot, levels=LEVELS)["coupled"].meta["settings"]


def test_equal_steps_answer_where_the_tolerance_is_out_of_reach(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[Any] = []

    def refusing(*scene: Any, **options: Any) -> pf.Result:
        tried.append(options.get("tol"))
        if options.get("tol"):
            raise ConvergenceError("its floor is higher. Give a larger tol.")
        return pf.solve(*scene, **options)

    monkeypatch.setattr(open_steps, "solve", refusing)
    robot = pf.load("3rrr", ["solve.until=0.02", "solve.samples=21"])
    done = pf.compare(robot, levels=LEVELS)
    assert tried == [None, 1e-3, None] and not done.unsolved
    assert "tol" not in done["coupled"].meta["settings"]


@pytest.mark.parametrize(("steps", "within"), [(16, False), (400, True)])
def test_equal_steps_answer_where_the_tolerance_takes_more_of_them(
    steps: int, within: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(open_steps, "default_step", lambda robot, end: end / steps)
    robot = pf.load("ur5", ["solve.until=0.3", "solve.samples=21"])
    settings = pf.compare(robot, levels=LEVELS)["coupled"].meta["settings"]
    assert ("tol" in settings) is within  # by collocation it takes 20 to 60 steps


def test_what_is_loaded_is_collected_again_after_a_command() -> None:
    before = gc.get_freeze_count()
    with settled(ends=False):
        assert gc.get_freeze_count() > before
    assert gc.get_freeze_count() == 0


def test_a_process_that_ends_with_its_command_collects_nothing_more() -> None:
    try:
        with settled(ends=True):
            made, before = [[] for _ in range(1000)], gc.get_freeze_count()
        assert gc.get_freeze_count() > before + 0.9 * len(made)  # a few older ones are gone
    finally:
        gc.unfreeze()


@pytest.mark.parametrize(("until", "said"), [(0.05, True), (0.08, False), (0.04, False)])
def test_a_run_that_ends_as_its_motion_stops_says_what_it_does_not_show(
    until: float, said: bool
) -> None:
    """A motion of 0.05 s, to its end, beyond it, and not so far."""
    move = "motion={kind: cycloid, joints: {motor: 0.5}, duration: 0.05}"
    robot = pf.load("race_r3", [move, f"solve.until={until}"])
    notes = pf.compare(robot, levels=("rigid", "ked")).table.notes
    assert any("end as the motion stops: --set solve.until=0.1000" in x for x in notes) == said


def test_a_motion_beyond_the_limits_of_the_urdf_is_named() -> None:
    """A cycloid's top speed is 2 D / T: 3.2 rad/s of a ur5 that may do 3.15."""
    said = "shoulder_pan_joint takes a speed of up to 3.2 rad/s, more than the URDF's 3.15"
    notes = pf.compare(pf.load("ur5"), levels=("rigid", "ked")).table.notes
    assert any(said in note for note in notes)

    def warned(*values: str) -> str:
        return " ".join(pf.check(pf.load("ur5", values)).warnings)

    assert "takes a speed" in warned()
    assert "takes a speed" not in warned("motion.duration=0.51", "solve.until=0.51")  # 3.14 rad/s
    degrees = warned("motion.joints.shoulder_pan_joint=30")
    assert "shoulder_pan_joint gets to 30 rad, outside the URDF's limits -6.28" in degrees
    assert "Degrees? Write 90 deg" in degrees
    # and where the mechanism cannot follow: a crank of a 3-RRS that stands at 1 rad is to go 20
    move = "motion={kind: quintic, joints: {motor_1: 20}, duration: 1}"
    far = " ".join(pf.check(pf.load("3rrs", [move])).warnings)
    assert re.search(r"singular pose.*motor_1 gets to 21 rad, outside.*Degrees\?", far)
