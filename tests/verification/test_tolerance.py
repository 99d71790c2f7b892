"""solve(tol=): what was asked is within the tolerance, by another method's converged answer.

Claims:
    Machines
    - a run by tol whose batches of steps hold no sample | the same with 61 samples | 1e-4 rad |
      passes (was a traceback)
    Tolerances, collocation
    - tol 1e-2 / 1e-3 / 1e-4: race_r1 (torque) | same | 3 tol | 9.5e-5 / 8.5e-5 / 6.1e-5
    - race_r2 (all outputs) | same | 3 tol | 8.1e-5 / 2.4e-5 / 1.3e-5
    - race_r3, start static | same | 3 tol | 4.2e-4 / 3.9e-4 / 1.5e-5
    - spinning_beam | same | 3 tol | 1.1e-2 / 8.6e-6 / 6.4e-6
    - 3rrs | same | 3 tol | 9.0e-3 / 6.2e-6 / 4.9e-6
    - 3rrr | same | 3 tol | 1.1e-3 / 1.0e-3 / 1.3e-5
    - ur5, gravity at once | same | 3 tol | 9.4e-5 / 5.7e-5 / 5.6e-5
    - what is told is the error of what is answered: race_r2, race_r3, 3rrr, spinning_beam (all
      outputs, tol 1e-3, 1e-4) | seven stages, tol / 1000 | told/true 0.5 to 5 | 0.5 to 5;
      [TOLERANCE.md](benchmarks/TOLERANCE.md)
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import pinflex as pf
from pinflex.integrators.collocation import radau
from pinflex.integrators.problem import Run
from pinflex.levels.outputs import Outputs
from pinflex.solver.scene import Scene
from pinflex.solver.solve import _run, _spec, default_motion
from pinflex.solver.tolerance import _OneRun
from tests.scenes import Body, load

SAMPLES = 51
TORQUE, ALL = ("torque",), ("torque", "deflection", "platform")
STATIC = "flexible.*.basis.internal=0"  # shapes whose frequencies the reference resolves
BENT = "flexible.*.axial=false"  # likewise
FIRST = "flexible.*.second_order=false"  # the published 3rrr
# Model: overrides, what is asked, end in s, step in s of the reference, which is then good to
# 3e-5 (measured between its step and half of it; less where deflections are slow).
SCENES = {
    "race_r1": ((STATIC, BENT), TORQUE, 0.05, 5e-6),
    "race_r2": ((), ALL, 0.1, 5e-5),
    "race_r3": (("solve.start=static",), ALL, 0.03, 2.5e-6),
    "spinning_beam": ((), ALL, 20.0, 2e-3),
    "3rrs": ((), ALL, 0.1, 1e-4),
    "3rrr": ((STATIC, BENT, FIRST), ALL, 0.02, 4e-6),
    "ur5": ((BENT, "solve.start=straight"), ALL, 0.1, 2e-5),
}


@cache
def mechanism(name: str) -> pf.Mechanism:
    return pf.load(name, list(SCENES[name][0]))


def run(name: str, **keys: object) -> Run:
    """States of a coupled run; by `solve`'s own path, without what it recovers of them."""
    m, end = mechanism(name), SCENES[name][2]
    newton = keys.pop("tolerance", None)
    dt = keys.pop("dt", None)
    spec = _spec(m, {"level": "coupled", "until": end, "dt": dt, "samples": SAMPLES, **keys})
    scene = Scene(m, default_motion(m), spec, None, newton)
    return _run(scene, end, None)  # type: ignore[arg-type]


@cache
def reference(name: str) -> Run:
    return run(name, integrator="generalized_alpha", dt=SCENES[name][3], tolerance=1e-10)


@pytest.mark.parametrize("tol", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("name", SCENES)
def test_the_error_against_generalized_alpha_is_what_was_allowed(name: str, tol: float) -> None:
    _, asked, _, _ = SCENES[name]
    found = run(name, integrator="radau", tol=tol, asked=asked)
    m = mechanism(name)
    outputs = Outputs(m, default_motion(m), found.t, asked)
    errors = outputs.differences(found, reference(name))
    # A run is judged by its correction; what both leave out is not seen.
    assert max(errors.values()) < 3 * tol, errors
    assert set(errors) == set(found.settings["error"])  # type: ignore[call-overload]


@pytest.mark.parametrize("tol", [1e-3, 1e-4])
@pytest.mark.parametrize("name", ["race_r2", "race_r3", "3rrr", "spinning_beam"])
def test_what_is_told_is_the_error_of_what_is_answered(name: str, tol: float) -> None:
    """Against seven stages at a thousandth of it; race_r3 rings, 3rrr's floor is near 1e-6."""
    least = 1e-6 if name == "3rrr" else 0.0
    found, exact = (
        run(name, integrator=radau(stages), tol=at, asked=ALL)
        for stages, at in ((6, tol), (7, max(1e-3 * tol, least)))
    )
    m = mechanism(name)
    errors = Outputs(m, default_motion(m), found.t, ALL).differences(found, exact)
    told = found.settings["error"]
    ratios = {key: told[key] / errors[key] for key in errors}  # type: ignore[index]
    assert min(ratios.values()) > 0.5, ratios  # measured: 0.85 to 3.0; 2 is aimed at
    assert max(ratios.values()) < 5.0, ratios


def test_what_rings_from_the_start_on_is_not_left_out_by_all_runs_alike() -> None:
    """The UR5's links begin to ring at 50 Hz; with long first steps two runs agreed without it."""
    m, coupled = pf.load("ur5", ["solve.start=static"]), {"level": "coupled", "samples": SAMPLES}
    exact = pf.solve(m, **coupled, integrator="generalized_alpha", dt=2e-4)  # good to 8e-4
    found = pf.solve(m, **coupled, integrator="radau", tol=0.03)
    eta = exact.arrays["eta"]
    assert np.abs(found.arrays["eta"] - eta).max() < 0.03 * np.abs(eta).max()


def test_a_shorter_tolerance_costs_more_and_is_said() -> None:
    cost = [run("race_r2", integrator="radau", tol=tol).cost["last_steps"] for tol in (1e-2, 1e-4)]
    assert cost[0] < cost[1] < 100
    r = pf.solve(mechanism("race_r2"), level="coupled", tol=1e-2, until=0.05, samples=11)
    assert r.meta["settings"]["tol"] == 1e-2
    assert max(r.meta["settings"]["error"].values()) <= 0.5e-2


@pytest.mark.parametrize("bad", [0.0, -1e-3, 0.5, np.nan])
def test_a_tolerance_that_is_none_is_refused(bad: float) -> None:
    with pytest.raises(pf.DescriptionError, match="solve.tol"):
        pf.solve(mechanism("race_r1"), tol=bad)


def test_a_step_together_with_a_tolerance_is_refused() -> None:
    with pytest.raises(pf.DescriptionError, match="dt and tol"):
        pf.solve(mechanism("race_r1"), tol=1e-3, dt=1e-4)


def test_a_tolerance_asked_for_replaces_the_step_of_the_yaml_and_back() -> None:
    m = pf.load("3rrs")  # its YAML says dt
    r = pf.solve(m, level="coupled", integrator="radau", tol=1e-2, until=0.01, samples=11)
    assert r.meta["settings"]["integrator"] == "radau"
    m = pf.load("race_r2", ["solve.tol=1e-3"])
    r = pf.solve(m, integrator="generalized_alpha", dt=1e-3, until=0.01, samples=11)
    assert r.meta["settings"]["dt"] == pytest.approx(1e-3)


def test_an_output_that_nobody_has_is_refused() -> None:
    with pytest.raises(pf.DescriptionError, match='Did you mean "torque"') as caught:
        pf.load("race_r1", ["solve.asked=[torqe]"])
    assert "asked" in str(caught.value)
    with pytest.raises(pf.DescriptionError, match='Did you mean "torque"'):
        pf.solve(mechanism("race_r1"), tol=1e-3, asked=("torqe",))


def test_many_steps_between_two_samples_are_judged_too(tmp_path: Path) -> None:
    """A free double pendulum with two samples: batches of steps without a sample."""
    bodies = (
        Body("a", "base", "revolute", axis=(0, 1, 0), mass=1, inertia=(0.1, 0.1, 0.1)),
        Body("rod", "a", "revolute", axis=(0, 1, 0), xyz=(1, 0, 0)),
        Body("tip", "rod", xyz=(1, 0, 0), mass=0.5, inertia=(1e-3, 1e-3, 1e-3)),
    )
    yaml = """
actuated: []
flexible:
  rod: {material: steel, section: {shape: circle, diameter: 0.01}, end: tip,
        basis: {kind: craig_bampton, internal: 0}}
"""
    m = load(tmp_path, bodies, yaml)
    few, many = (
        pf.solve(m, level="coupled", tol=1e-5, until=0.3, samples=samples, start="straight")
        for samples in (2, 61)
    )
    gap = np.abs(few.arrays["joint/q"][-1] - many.arrays["joint/q"][-1]).max()
    assert gap < 1e-4  # ten times the tolerance, of angles of the order of one


def test_corrections_that_have_grown_are_no_round_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 5 %, as in a four-bar that turns freely (which was refused with a floor of 0.05).

    Several runs answer then: a pendulum let go at 90 degrees, by its energy.
    """
    grown = SimpleNamespace(differences={"deflection": 0.05}, stuck=True)
    passed = _OneRun._passed
    monkeypatch.setattr(_OneRun, "_passed", lambda self, size: (passed(self, size)[0], grown))
    bob = Body("bob", "base", "continuous", axis=(0, 1, 0), mass=2.0, com=(0.5, 0, 0))
    robot = load(tmp_path, [bob], "actuated: []\n")
    run = pf.solve(robot, level="coupled", tol=1e-4, until=1.0)
    fallen = run.joint("bob_joint").position[:, 1]  # sine of the angle
    speed = run.joint("bob_joint").velocity
    # 1e-4 of the largest, the tolerance, for v^2 twice
    limit = 2e-4 * 2 * 9.81 / 0.5
    np.testing.assert_allclose(speed**2, 2 * 9.81 * fallen / 0.5, atol=limit)
    assert "two runs" in run.errors.time_note
