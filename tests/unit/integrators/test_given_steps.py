"""Runs in given steps: the states of other steps, halves of what Newton does not solve, breaks.

Claims:
    Derivatives, designs, scatter, fits
    - a run in given steps, in pieces where Newton fails, breaks, motions of other lengths | runs by
      `tol`; similarity | 1e-9 to 1e-8 m; 1e-9 | passes
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinflex as pf
from pinflex.integrators import march
from pinflex.kernel.library import kernel
from pinflex.solver.same_steps import SameSteps
from pinflex.solver.scene import Scene


@pytest.fixture(scope="module")
def strip():
    robot = pf.load("cantilever", ["solve={level: coupled, until: 0.1, start: straight}"])
    return robot, SameSteps(robot, None)


def test_the_steps_of_a_run_halved_have_its_states(strip):
    robot, steps = strip
    own = pf.solve(robot, tol=1e-8, samples=401)
    run = steps.run(robot, steps.grid)
    # the tip sinks by 16 mm: 1e-7 of that
    np.testing.assert_allclose(
        run.frame("tip").position, own.frame("tip").position, rtol=0, atol=1e-9
    )
    assert np.all(np.diff(steps.ends) > 0) and steps.ends[-1] == pytest.approx(0.1, rel=1e-12)


def test_a_step_that_newton_does_not_solve_is_taken_in_pieces(strip, monkeypatch):
    robot, steps = strip
    expected = steps.run(robot, steps.grid, halved=False).frame("tip").position
    monkeypatch.setattr(march, "_PATIENT", 2)  # most steps take three
    found = steps.run(robot, steps.grid, halved=False)
    if kernel().functions is not None:
        assert found.meta["cost"]["rejected"] > 0
    # what a whole step leaves: 1e-7 of 16 mm
    np.testing.assert_allclose(found.frame("tip").position, expected, rtol=0, atol=1e-8)


def test_steps_and_instants_follow_a_motion_that_takes_longer():
    # the same law over twice the time, without gravity: a quarter of the torques at every instant
    robot, slow = (
        pf.load("3rrr", [
            f"motion={{kind: cycloid, platform: {{x: 0.01, y: 0, rz: 0}}, duration: {duration}}}",
            f"solve={{level: rigid, until: {duration}, samples: 51}}",
        ])
        for duration in (0.1, 0.2)
    )  # fmt: skip
    steps = SameSteps(robot, None)
    near, far = (steps.run(design, steps.grid).torque for design in (robot, slow))
    np.testing.assert_allclose(far, near / 4, atol=1e-9 * np.abs(near).max())


def test_a_break_inside_a_given_step_ends_it():
    push = "{at: tip, force: [0, 0, 1], start: 0.03}"
    robot = pf.load("cantilever", [f"forces={{push: {push}}}", "solve={until: 0.1}"])
    spec = replace(robot.description.solve, level="coupled")
    scene, t = Scene(robot, pf.hold(duration=0.1), spec), np.linspace(0.0, 0.1, 11)
    ends = np.linspace(0.0, 0.1, 38)[1:]
    found, expected = (scene.along(t, more) for more in (ends, np.union1d(ends, 0.03)))
    np.testing.assert_allclose(found.y, expected.y, rtol=0, atol=1e-14)
