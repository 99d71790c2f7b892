"""A tolerance by the alpha family: equal steps, halved until two runs agree.

Claims:
    Alpha family, within a tolerance
    - tol 1e-2 and 1e-3, newmark: race_r1 (torque), race_r2, spinning_beam | Radau IIA, 1e-5 | 3 tol
      | 1.9e-4, 7.4e-5, 4.8e-6
    - the same, hht | same | 3 tol | 5.0e-5, 9.4e-5, 4.9e-6
    - the same, generalized_alpha | same | 3 tol | 4.2e-5, 7.8e-5, 4.8e-6
    - a free top (exponential coordinates), a motor that pushes, tol 1e-2 | Radau IIA, 1e-4 | 3 tol
      | passes
    Hard cases
    - a shaped motion that bends 17 times, gears and links stiffer than the step resolves: default
      steps against a quarter of them | finer run | 1e-3 of the peak torque | 1.6e-4
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import pinflex as pf
from pinflex.integrators.equal_steps import _diverged
from pinflex.integrators.problem import Run
from pinflex.levels.outputs import Outputs
from pinflex.solver.solve import default_motion
from tests.hard.test_collocation_runs import ARM, BEAM, top
from tests.scenes import load
from tests.verification.test_tolerance import SCENES, mechanism, run

DAMPED = ("generalized_alpha", "hht")
MEMBERS = (*DAMPED, "newmark")


@cache
def exact(name: str) -> Run:
    """By another method, good to 1e-5."""
    return run(name, integrator="radau", tol=1e-5, asked=SCENES[name][1])


NAMES = ("race_r1", "race_r2", "spinning_beam")


@pytest.mark.parametrize("tol", [1e-2, 1e-3])
@pytest.mark.parametrize("integrator", MEMBERS)
@pytest.mark.parametrize("name", NAMES)
def test_the_error_against_radau_is_what_was_allowed(
    name: str, integrator: str, tol: float
) -> None:
    _, asked, _, _ = SCENES[name]
    found, m = run(name, integrator=integrator, tol=tol, asked=asked), mechanism(name)
    outputs = Outputs(m, default_motion(m), found.t, asked)
    # The tolerance is judged by two runs; what both leave out is not seen.
    assert max(outputs.differences(found, exact(name)).values()) < 3 * tol
    assert found.settings["integrator"] == integrator


def test_a_sphere_that_turns_and_motors_that_push(tmp_path: Path) -> None:
    """Between states on a manifold: exponential coordinates; motors free, by a torque."""
    falling, arm = top(tmp_path), load(tmp_path, ARM, BEAM)
    move = pf.quintic(joints={"beam_joint": 0.5}, duration=0.1)
    push = {"drive": "torque", "kp": 500.0, "kd": 10.0}
    for m, motion, keys in ((falling, pf.hold(duration=0.1), {}), (arm, move, push)):
        found, fine = (
            pf.solve(m, motion, level="coupled", samples=41, integrator=integrator, tol=tol, **keys)
            for integrator, tol in (("hht", 1e-2), ("radau", 1e-4))
        )
        for key in ("eta", "joint/q", "joint/v"):
            a, b = found.arrays[key], fine.arrays[key]
            assert np.abs(a - b).max() < 3e-2 * np.abs(b).max(), key


def test_who_names_no_integrator_gets_radau_and_a_control_keeps_equal_steps(
    tmp_path: Path,
) -> None:
    m = load(tmp_path, ARM, "actuated: []\n" + BEAM)
    effort = pf.Control(
        (pf.Deflection("beam", 0.5),), (pf.Effort("beam_joint"),), lambda t, m, dm, im: -1e2 * m
    )
    keys = {"level": "coupled", "tol": 1e-2, "samples": 11}
    plain, controlled = (
        pf.solve(m, pf.hold(duration=0.01), control=control, **keys) for control in (None, effort)
    )
    assert plain.meta["settings"]["integrator"] == "radau"
    assert controlled.meta["settings"]["integrator"] == "generalized_alpha"
    assert "rejected" not in controlled.meta["cost"]


GEARED = [
    "damping={modal: 0.01}",
    *(
        f"joints.{joint}.drive={{gear: 101, motor_inertia: 2.0e-4, stiffness: 2.0e4, damping: 20}}"
        for joint in ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint")
    ),
]


def test_a_motion_that_bends_seventeen_times_runs_in_default_steps() -> None:
    # Gears and links with modes of 300 Hz and more, which steps of 1.4 ms do not resolve: they grew
    # from bend to bend of the shaped motion.
    robot = pf.load("ur5", GEARED)
    move = pf.quintic(joints={"shoulder_pan_joint": 0.8, "shoulder_lift_joint": 0.3}, duration=0.8)
    shaped = move.shaped("zvd", modes=[7.83, 10.44])
    runs = [
        pf.solve(robot, shaped, "coupled", until=1.6, dt=dt, samples=101) for dt in (1.4e-3, 3.5e-4)
    ]
    largest = np.max(np.abs(runs[1].torque))
    # Second order of the longer step, 1e-3 of the motion's time, in a motion of 0.8 s
    assert np.max(np.abs(runs[0].torque - runs[1].torque)) < 1e-3 * largest


def test_a_run_that_diverges_with_elastic_drives_names_what_grew() -> None:
    robot = pf.load("ur5", GEARED)
    march = SimpleNamespace(
        dynamics=SimpleNamespace(system=robot.flexible), h=1e-3,
        problem=SimpleNamespace(free=robot.flexible.free),
    )  # fmt: skip
    r = np.zeros(len(robot.flexible.free))
    r[-1] = 1.0  # the last of all coordinates is a gear's
    error = _diverged(robot, march, 0.1, 7, r, None)
    assert "largest in gear of elbow_joint" in str(error)
