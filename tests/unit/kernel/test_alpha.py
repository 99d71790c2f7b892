"""Equal steps of the alpha family: those of the kernel are those of numpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import PinflexError, RunInterrupted
from pinflex.integrators.run import Run
from pinflex.kernel.alpha import AlphaKernel
from pinflex.kernel.library import kernel
from pinflex.lab.four_bars import SPEEDS, four_bars, four_bars_exact
from pinflex.mechanics.equations import Equations
from pinflex.solver.scene import Scene
from pinflex.solver.solve import default_motion

pytestmark = pytest.mark.skipif(kernel().functions is None, reason="no kernel")

# Loops and circles; balls and gravity; a tree; a switched load and a spring; torques of motors;
# dry friction.
SCENES: dict[str, tuple[str, list[str], float]] = {
    "race_r1": ("race_r1", [], 0.02),
    "race_r2": ("race_r2", [], 0.05),
    "ur5": ("ur5", [], 0.05),
    "loaded": (
        "ur5",
        ["forces.push={at: tool0, force: [0, 0, 9], start: 0.01, until: 0.03}"],
        0.05,
    ),
    "driven": ("race_r1", ["solve.drive=torque", "solve.kp=100", "solve.kd=5"], 0.02),
    "driven tree": ("ur5", ["solve.drive=torque", "solve.kp=1000", "solve.kd=50"], 0.05),
    "rubbing": ("race_r1", ["joints.knee_1.friction={coulomb: 0.01, speed: 0.5}"], 0.02),
}

# Poses are known to 1e-16 m, accelerations of stiff undamped coordinates to that over
# beta h^2 = 2e-9 s^2, which rings on: 8e-7 measured, 9e-10 of speeds, 7e-9 of multipliers.
ALIKE = {"y": 1e-12, "v": 1e-8, "a": 5e-6, "lam": 5e-8, "torque": 5e-8}


PD = pf.pid(kp=-800.0, ki=-300.0, kd=-20.0)
# Feedback on a motor driven by torques, beside its own drive, and on a joint of a loop.
CONTROLS = {
    "driven tree": pf.Control((pf.Travel("elbow_joint"),), (pf.Effort("elbow_joint"),), PD),
    "driven": pf.Control((pf.Travel("motor_1"),), (pf.Effort("knee_1"),), pf.pid(kp=-2.0, kd=-0.1)),
}


def run_of(
    name: str, tolerance: float = 1e-10, progress: object = None, control: object = None
) -> Run:
    model, overrides, end = SCENES[name]
    return steps_of(pf.load(model, overrides), end, tolerance, progress, control=control)


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
def test_steps_of_rigid_loops_are_too(windows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rigid windows in a row, of which nothing gives way."""
    m = four_bars(windows)
    found = steps_of(m, 0.05, speeds=SPEEDS)
    assert Equations(found.system, marched=True).on_kernel and not Equations(found.system).on_kernel
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    # What round-off leaves in undamped loops rings on, more so in long rows: 3e-5 of accelerations
    # and multipliers in 30 windows, as much as numpy's own answer to a start faster by 1e-14.
    limits = {**ALIKE, "a": 1e-4, "lam": 1e-4}
    assert_alike(found, steps_of(m, 0.05, speeds=SPEEDS), limits)
    # Cranks stay parallel: one equation, of which the scheme keeps 1e-7 in so short a time.
    angle = np.arctan2(found.y[:, 1], found.y[:, 0])
    x, y = four_bars_exact(windows, found.t).T
    np.testing.assert_allclose([-np.sin(angle), np.cos(angle)], [x, y], atol=1e-6)


def assert_alike(found: Run, wanted: Run, limits: Mapping[str, float] = ALIKE) -> None:
    assert found.cost["steps"] == wanted.cost["steps"]
    for name, close in limits.items():
        ours, theirs = getattr(found, name), getattr(wanted, name)
        limit = close * np.abs(theirs).max(initial=0.0)
        assert np.abs(ours - theirs).max(initial=0.0) <= limit, name
    np.testing.assert_allclose(found.work, wanted.work, atol=1e-9 * np.abs(wanted.work).max())


@pytest.mark.parametrize("name", SCENES)
def test_steps_of_the_kernel_are_those_of_numpy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    plain = AlphaKernel.march

    def march(self: AlphaKernel, first: int, count: int) -> int:
        calls.append(plain(self, first, count))
        return calls[-1]

    monkeypatch.setattr(AlphaKernel, "march", march)
    found = run_of(name)
    assert sum(calls) == 200  # all on the kernel
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    assert_alike(found, run_of(name))
    assert sum(calls) == 200


@pytest.mark.parametrize("name", CONTROLS)
def test_and_under_a_feedback(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every third batch is left to numpy: the states of the feedback go along."""
    plain, calls = AlphaKernel.march, []

    def march(self: AlphaKernel, first: int, count: int) -> int:
        calls.append(first)
        return 0 if len(calls) % 3 == 0 else plain(self, first, min(count, 7))

    monkeypatch.setattr(AlphaKernel, "march", march)
    found = run_of(name, control=CONTROLS[name])
    assert len(calls) > 20
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    wanted = run_of(name, control=CONTROLS[name])
    assert_alike(found, wanted)
    assert found.signals is not None and wanted.signals is not None
    for a, b in (
        (found.signals.u, wanted.signals.u),
        (found.signals.measured, wanted.signals.measured),
    ):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-8 * np.abs(b).max())


def test_torques_go_with_the_state_that_the_last_correction_led_to() -> None:
    found = run_of("race_r2", tolerance=1e-2)  # few iterations: the last one moves a good deal
    motors = found.system.motors
    exact = Equations(found.system).residual(found.y, found.v, found.a, found.lam, found.t).r
    # What is left is of second order in the last correction: 1.9e-6 measured, 1.5e-3 with the
    # multipliers' share of that correction left in with the wrong sign.
    assert np.abs(found.torque - exact[:, motors]).max() < 1e-5 * np.abs(found.torque).max()


def test_steps_that_the_kernel_leaves_are_taken_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted, plain, calls = run_of("race_r1"), AlphaKernel.march, []

    def march(self: AlphaKernel, first: int, count: int) -> int:
        calls.append(first)
        return 0 if len(calls) % 3 == 0 else plain(self, first, min(count, 7))

    monkeypatch.setattr(AlphaKernel, "march", march)
    assert_alike(run_of("race_r1"), wanted)
    assert len(calls) > 40


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
    made, plain = [], AlphaKernel.march

    def march(self: AlphaKernel, first: int, count: int) -> int:
        made.append(self)
        return plain(self, first, count)

    monkeypatch.setattr(AlphaKernel, "march", march)
    run_of("ur5")
    for first, count in ((0, 3), (199, 3), (1, -1)):
        with pytest.raises(PinflexError, match=f"{count} steps from {first}"):
            plain(made[0], first, count)
    rows = [np.zeros((3, 2))] * 4
    with pytest.raises(PinflexError, match="numbers, not"):
        AlphaKernel(made[0]._stages, None, rows, [np.zeros((3, 1))] * 7)  # type: ignore[arg-type]
