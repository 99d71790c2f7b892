"""A motor that a loop locks is refused by name; where something gives way to it, it runs."""

from __future__ import annotations

from pathlib import Path

import pytest

import pinflex as pf
from tests.scenes import Body, load

ROD = {"mass": 0.5, "com": (0.25, 0, 0), "inertia": (1e-3, 1e-2, 1e-2)}
# Two arms side by side, welded at their tips so that neither turns, and a free double pendulum.
LOCKED = (
    Body("a", "base", "revolute", **ROD),
    Body("tip_a", "a", xyz=(0.5, 0, 0)),
    Body("b", "base", "revolute", xyz=(0, 0.3, 0), **ROD),
    Body("tip_b", "b", xyz=(0.5, -0.3, 0)),
    Body("c", "base", "revolute", xyz=(0, 0.6, 0), axis=(0, 1, 0), **ROD),
    Body("d", "c", "revolute", xyz=(0.5, 0, 0), axis=(0, 1, 0), **ROD),
)
YAML = """
actuated: [a_joint]
loops: {glue: {kind: weld, between: [tip_a, tip_b]}}
motion: {kind: hold, duration: 0.05}
solve: {level: coupled}
"""
BENT = """
flexible:
  a: {material: aluminium, section: {shape: tube, diameter: 0.03, wall: 0.002}, end: tip_a}
"""


@pytest.mark.parametrize("how", [{"tol": 1e-3}, {"dt": 1e-3}])
def test_a_motor_that_a_weld_locks_is_named(how: dict[str, float], tmp_path: Path) -> None:
    with pytest.raises(pf.MotionError, match="loops lock a_joint, .* takes up 1 of 2 closures"):
        pf.solve(load(tmp_path, LOCKED, YAML), samples=3, **how)


@pytest.mark.parametrize("how", [{"tol": 1e-3}, {"dt": 1e-3}])
def test_it_runs_where_a_link_gives_way_or_the_motor_is_a_torque(
    how: dict[str, float], tmp_path: Path
) -> None:
    for m in (
        load(tmp_path, LOCKED, YAML + BENT),
        load(tmp_path, LOCKED, YAML, ["solve.drive=torque"]),
    ):
        run = pf.solve(m, samples=3, **how)
        assert abs(run.joint("b_joint").position).max() < 1e-6  # nothing pushes the arms
        assert run.joint("c_joint").position[-1] > 1e-3  # the pendulum falls
