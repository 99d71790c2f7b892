"""Equal steps of the alpha family on the kernel; `test_plain.py` has them against plain ones.

Claims:
    Tolerances, collocation
    - rigid windows in a row, 1, 6 and 30: steps of the kernel = plain ones, and cranks by one
      equation | the plain march; exact solution | 2e-11 of y, 1e-4 of multipliers; 1e-6 | 8e-15,
      3e-5 (of a start faster by 1e-14: 3e-5); passes
    - the same: steps that fail on kept tangents balance by exact ones; torques of the state that
      the last correction led to; stopped between batches | Pinocchio | 1e-7; 1e-5 | 7e-9; 2e-6
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import PinflexError, RunInterrupted
from pinflex.integrators.equal_steps import CompiledAlpha
from pinflex.integrators.problem import Run
from pinflex.kernel.library import kernel
from pinflex.lab.loops import SPEEDS, four_bars, four_bars_exact
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.solver.scene import Scene
from pinflex.solver.solve import default_motion
from tests.unit.kernel.test_plain import CONTROLS, SAME_ALPHA, same

pytestmark = pytest.mark.skipif(kernel().functions is None, reason="no kernel")


def run_of(model: str, tolerance: float = 1e-10, progress: object = None) -> Run:
    return steps_of(pf.load(model), 0.05, tolerance, progress)


def steps_of(
    m: pf.Mechanism,
    end: float,
    tolerance: float = 1e-10,
    progress: object = None,
    speeds: Mapping[str, float] | None = None,
    control: object = None,
) -> Run:
    spec = replace(m.description.solve, level="coupled", until=end, tol=None, dt=None)
    spec = replace(spec, start_speeds=tuple((name, (x,)) for name, x in (speeds or {}).items()))
    given = Scene(m, default_motion(m), spec, control, tolerance)  # type: ignore[arg-type]
    return given.stepped(np.linspace(0.0, end, 101), end / 200, progress)  # type: ignore[arg-type]


@pytest.mark.parametrize("windows", [1, 6, 30])
def test_steps_of_rigid_loops(windows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rigid windows in a row, of which nothing gives way."""
    m = four_bars(windows)
    found = steps_of(m, 0.05, speeds=SPEEDS)
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    # What round-off leaves in undamped loops rings on, more so in long rows: 3e-5 of accelerations
    # and multipliers in 30 windows, as much as from a start faster by 1e-14.
    plain = steps_of(m, 0.05, speeds=SPEEDS)
    same(found, plain, {**SAME_ALPHA, "a": 1e-4, "lam": 1e-4})
    monkeypatch.delenv("PINFLEX_KERNEL")
    assert Equations(found.system, marched=True).on_kernel and not Equations(found.system).on_kernel
    # Cranks stay parallel: one equation, of which the scheme keeps 1e-7 in so short a time.
    angle = np.arctan2(found.y[:, 1], found.y[:, 0])
    x, y = four_bars_exact(windows, found.t).T
    np.testing.assert_allclose([-np.sin(angle), np.cos(angle)], [x, y], atol=1e-6)


@pytest.mark.parametrize("model", CONTROLS)
def test_a_feedback_goes_on_from_batch_to_batch(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    overrides, control = CONTROLS[model]
    m, plain, calls = pf.load(model, overrides), CompiledAlpha.march, []
    whole = steps_of(m, 0.02, control=control)

    def march(self: CompiledAlpha, first: int, count: int) -> int:
        calls.append(first)
        return plain(self, first, min(count, 7))

    monkeypatch.setattr(CompiledAlpha, "march", march)
    found = steps_of(m, 0.02, control=control)
    assert len(calls) > 20 and found.signals is not None and whole.signals is not None
    np.testing.assert_array_equal(found.y, whole.y)
    # errors plus their target, and back: to the last digits
    np.testing.assert_allclose(found.signals.measured, whole.signals.measured, atol=1e-15)


COARSE = {"3rrs": (0.2, 6), "race_r1": (0.2, 9), "race_r3": (0.1, 6)}


@pytest.mark.parametrize("name", COARSE)
def test_steps_that_fail_on_kept_tangents_are_taken_by_exact_ones(name: str) -> None:
    """Each of these runs breaks off without them."""
    (end, count), m = COARSE[name], pf.load(name)
    spec = replace(m.description.solve, level="coupled", until=end)
    run = Scene(m, default_motion(m), spec, tolerance=1e-10)
    found = run.stepped(np.linspace(0.0, end, count + 1), end / count)
    d = Equations(found.system)
    r, c = d.residual(found.y, found.v, found.a, found.lam, found.t)
    # 1e-10 of the forces by Newton's tolerance, those of inertia some hundred times the motors'
    assert np.abs(r[:, found.system.free]).max() < 1e-7 * np.abs(found.torque).max()
    assert np.abs(c).max() < 1e-9


def test_torques_go_with_the_state_that_the_last_correction_led_to() -> None:
    found = run_of("race_r2", tolerance=1e-2)  # few iterations: the last one moves a good deal
    motors = found.system.motors
    exact = Equations(found.system).residual(found.y, found.v, found.a, found.lam, found.t).r
    # What is left is of second order in the last correction: 1.9e-6 measured, 1.5e-3 with the
    # multipliers' share of that correction left in with the wrong sign.
    assert np.abs(found.torque - exact[:, motors]).max() < 1e-5 * np.abs(found.torque).max()


def test_a_run_is_told_of_and_stopped_between_batches() -> None:
    told = []

    def progress(step: int, steps: int) -> None:
        told.append((step, steps))
        if step == 128:
            raise KeyboardInterrupt

    with pytest.raises(RunInterrupted) as stopped:
        run_of("ur5", progress=progress)
    assert told == [(64, 200), (128, 200)]
    part = stopped.value.result
    assert isinstance(part, Run) and len(part.t) == 65  # every second step is a sample
    np.testing.assert_array_equal(part.y, run_of("ur5").y[:65])


def test_sizes_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    made, plain = [], CompiledAlpha.march

    def march(self: CompiledAlpha, first: int, count: int) -> int:
        made.append(self)
        return plain(self, first, count)

    monkeypatch.setattr(CompiledAlpha, "march", march)
    run_of("ur5")
    for first, count in ((0, 3), (199, 3), (1, -1)):
        with pytest.raises(PinflexError, match=f"{count} steps from {first}"):
            plain(made[0], first, count)
