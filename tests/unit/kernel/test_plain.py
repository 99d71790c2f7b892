"""The marches of the kernel against plain ones in Python, step by step in the same steps.

Both solve every step to round-off, one with tables, batches and a factorisation for each eigenvalue
of the tableau, the other as the equations stand; the plain run evaluates them by Pinocchio. So do
equal steps of the alpha family, one by tangents that are kept for long.

Claims:
    Tolerances, collocation
    - the compiled march, step by step the plain one of Python: all models, rigid, geared and driven
      ones, a free robot, loads that switch, corners, friction, sleeves over a border, a digital
      controller | the plain march by Pinocchio | 1e-11 of poses, 2e-8 of torques and multipliers (a
      free robot that is stiff in shear: 1e-6) | 1e-12, 4e-9
    - without the kernel a tolerance is kept: ur5, driven ur5, friction, cassie by 1e-2 | the kernel
      by 1e-3 | 1e-2 | passes
    - a continuous PID in equal steps on the kernel: states and signals (ur5, race_r1) | the plain
      march by Pinocchio | 2e-11 of poses, 1e-9 of signals | 3e-14, 2e-11
    - equal steps of the alpha family on the kernel: the scenes of the compiled march, Newton to
      1e-13 | the plain march by Pinocchio | 2e-11 of y, 2e-8 of v, 2e-5 of a, 2e-7 of multipliers,
      1e-8 of torques (a free robot that is stiff in shear: 4e-7, 4e-4, 1e-5) | 4e-12, 4e-9, 4e-6,
      5e-8, 2e-9 (8e-8, 7e-5, 2e-6)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import PinflexError
from pinflex.integrators.collocation import radau
from pinflex.integrators.problem import Run
from pinflex.kernel.library import kernel
from pinflex.levels.outputs import Outputs
from pinflex.solver.scene import Scene
from pinflex.solver.tolerance import solve_to_tolerance
from tests.benchmarks.race.case import scene
from tests.every_model import manifold
from tests.scenes import load
from tests.unit.mechanics.test_slider import DRAWN, TELESCOPE, TUBE

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)

STEPS, STAGES = 15, 4
TWICE = ("free base", "load", "corners")  # twice the steps: of switches, that steps end at
# Of the largest value. Newton stops at 1e-12 of what moves, at 1e-10 where round-off ends it, and
# h^2 divides that in accelerations and forces. Seen of five: 0.54; of poses with sleeves 0.9 (the
# plain march stops at round-off there; under sanitizers 1.3 over a border).
SAME = {"y": 1e-11, "v": 5e-9, "a": 1e-6, "lam": 2e-8, "torque": 2e-8, "work": 1e-9}
APART = {
    # stiff in shear: 1e-16 m in coordinates that hardly move are 1e-5 of what is fastest
    "free base": {**SAME, "v": 2e-6, "a": 1e-4, "lam": 1e-6, "torque": 1e-6},
    # ends of a short sleeve carry 1e4 N that cancel to 60 N: its multipliers are not compared
    **{
        name: {k: x for k, x in SAME.items() if k != "lam"}
        for name in ("sleeve", "sleeve over a border")
    },
}
# Equal steps of the alpha family: poses are known to 1e-16 m, accelerations of stiff undamped
# coordinates to that over beta h^2, which rings on. Seen: at most a fifth.
SAME_ALPHA = {"y": 2e-11, "v": 2e-8, "a": 2e-5, "lam": 2e-7, "torque": 1e-8, "work": 1e-9}
APART_ALPHA = {
    "free base": {**SAME_ALPHA, "v": 4e-7, "a": 4e-4, "lam": 1e-5},
    **{
        name: {k: x for k, x in SAME_ALPHA.items() if k != "lam"}
        for name in ("sleeve", "sleeve over a border")
    },
}
DRIVEN = ["solve.drive=torque", "solve.kp=1000", "solve.kd=50"]


DRAWN_FAR = (
    "flexible.rod.basis={kind: craig_bampton, internal: 1}", "loops.mouth.sleeve=0.02",
    "flexible.rod.bending_y=true", "flexible.rod.bending_z=true",
    "motion={kind: cycloid, joints: {rod_joint: -0.2}, duration: 0.2}",
)  # fmt: skip


def law() -> pf.Control:
    pid = pf.digital_pid(kp=800.0, ki=300.0, kd=20.0, period=1e-3)
    drives = (pf.Effort("elbow_joint"),)
    return pf.Control((pf.Travel("elbow_joint"),), drives, pid, period=1e-3, follow=(True,))


def moving(kind: str) -> pf.Mechanism:
    """A load that ramps up and ends, and a motion with corners."""
    ramp = ", ramp: 0.006" if kind == "trapezoid" else ""
    motion = f"{{kind: {kind}, joints: {{motor_1: 0.2}}, duration: 0.02{ramp}}}"
    push = "{at: platform, force: [5, 0, 0], start: 0.004, ramp: 0.003, until: 0.015}"
    return pf.load("race_r1", [f"motion={motion}", f"forces={{push: {push}}}"])


def of(model: str, *changes: str) -> Callable[[Path], pf.Mechanism]:
    return lambda _: pf.load(model, list(changes))


def telescope(segments: int) -> Callable[[Path], pf.Mechanism]:
    parts = (*DRAWN, *DRAWN_FAR, f"flexible.rod.segments={segments}")
    return lambda folder: load(folder, TELESCOPE, TUBE, parts)


FREE = "motion: {kind: quintic, joints: {boom_joint: 0.3}, duration: 0.3}\n"
RUBBING = "joints.knee_1.friction={coulomb: 0.01, speed: 0.5}"
# Scenes and how long they are marched [s]: loops, balls, interpolated inverse kinematics, elastic
# gears, manifolds, motors driven by torques, loads that switch, friction, sleeves over a border.
SCENES: dict[str, tuple[Callable[[Path], pf.Mechanism], float]] = {
    "race_r1": (of("race_r1"), 0.01),
    "race_r2": (of("race_r2"), 0.015),
    "race_r3": (of("race_r3"), 0.005),
    "spinning_beam": (of("spinning_beam"), 0.25),
    "3rrr": (of("3rrr"), 0.025),
    "3rrs": (of("3rrs"), 0.01),
    "ur5": (of("ur5"), 0.05),
    "delta": (of("delta"), 0.015),
    "cassie": (of("cassie"), 0.05),
    "hexapod": (of("hexapod"), 0.01),
    "geared": (of("models/ur5/geared.yaml"), 0.05),
    "free base": (lambda folder: manifold(folder, FREE), 0.03),
    "driven ur5": (of("ur5", *DRIVEN), 0.025),
    "driven delta": (of("delta", *DRIVEN), 0.015),
    "rigid, driven": (of("ur5", *DRIVEN, "solve.level=rigid"), 0.05),
    "load": (lambda _: moving("quintic"), 0.03),
    "corners": (lambda _: moving("trapezoid"), 0.03),
    "friction": (of("race_r1", RUBBING), 0.01),
    "sleeve": (telescope(1), 0.1),
    "sleeve over a border": (telescope(2), 0.1),
}  # fmt: skip


def given(m: pf.Mechanism, control: pf.Control | None = None) -> Scene:
    found = scene(m, ())
    spec = replace(found.spec, integrator=radau(STAGES))
    if m.description.solve.level == "rigid":
        spec = replace(spec, level="rigid")
    return replace(found, spec=spec, control=control)


def both(
    monkeypatch: pytest.MonkeyPatch, run: Scene, end: float, steps: int = STEPS
) -> tuple[Run, Run]:
    """In equal steps, on the kernel and without."""
    t, ends = np.linspace(0.0, end, 41), np.linspace(0.0, end, steps + 1)[1:]
    compiled = run.along(t, ends)
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    return compiled, run.along(t, ends)


def same(found: Run, expected: Run, limits: dict[str, float] = SAME) -> None:
    for name, limit in limits.items():
        a, b = getattr(found, name), getattr(expected, name)
        assert a.shape == b.shape
        scale = np.max(np.abs(b), initial=1e-300)
        assert np.max(np.abs(a - b), initial=0.0) <= limit * scale, name


@pytest.mark.parametrize("name", SCENES)
def test_steps_are_those_of_the_plain_march(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, end = SCENES[name]
    steps = STEPS * (1 + (name in TWICE))
    same(*both(monkeypatch, given(make(tmp_path)), end, steps), APART.get(name, SAME))


def equal(
    monkeypatch: pytest.MonkeyPatch, run: Scene, end: float, steps: int = 4 * STEPS
) -> tuple[Run, Run]:
    """In equal steps of the alpha family, on the kernel and without."""
    spec = replace(run.spec, integrator="generalized_alpha", until=end, tol=None, dt=None)
    run, t = replace(run, spec=spec, tolerance=1e-13), np.linspace(0.0, end, steps // 4 + 1)
    compiled = run.stepped(t, end / steps)
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    return compiled, run.stepped(t, end / steps)


@pytest.mark.parametrize("name", SCENES)
def test_equal_steps_are_those_of_the_plain_march(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, end = SCENES[name]
    steps = 4 * STEPS * (1 + (name in TWICE))
    same(*equal(monkeypatch, given(make(tmp_path)), end, steps), APART_ALPHA.get(name, SAME_ALPHA))


def test_equal_steps_end_within_newtons_tolerance() -> None:
    """Where links swing so far in a step that tangents are made anew within it, what the new one
    promises must not rest on what the old one did: velocities were off by 2e-6."""
    run, t = scene(pf.load("3rrs"), ()), np.linspace(0.0, 1.5, 301)
    spec = replace(run.spec, integrator="generalized_alpha", until=1.5, tol=None, dt=None)
    found, near = (replace(run, spec=spec, tolerance=x).stepped(t, 1e-3) for x in (1e-7, 1e-10))
    same(found, near, {"y": 5e-8, "v": 6e-7})  # of accelerations: 1e-7. Seen: a third, a fifth


# Feedback on a motor driven by torques, beside its own drive, and on a joint of a loop.
CONTROLS = {
    "ur5": (
        DRIVEN,
        pf.Control(
            (pf.Travel("elbow_joint"),),
            (pf.Effort("elbow_joint"),),
            pf.pid(kp=-800.0, ki=-300.0, kd=-20.0),
        ),
    ),
    "race_r1": (
        ["solve.drive=torque", "solve.kp=100", "solve.kd=5"],
        pf.Control((pf.Travel("motor_1"),), (pf.Effort("knee_1"),), pf.pid(kp=-2.0, kd=-0.1)),
    ),
}


@pytest.mark.parametrize("model", CONTROLS)
def test_equal_steps_under_a_continuous_law_too(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    overrides, control = CONTROLS[model]
    run = replace(scene(pf.load(model, overrides), ()), control=control)
    found, plain = equal(monkeypatch, run, 0.02)
    same(found, plain, SAME_ALPHA)
    assert found.signals is not None and plain.signals is not None
    for name in ("u", "measured"):
        a, b = getattr(found.signals, name), getattr(plain.signals, name)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize("steps", [STEPS, 20, 2 * STEPS])
def test_under_a_digital_controller_too(steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps pass instants of 1 ms, end at them, or are cut; accelerations jump by 1e5 there."""
    drive = ["solve.drive=torque", "solve.kp=2000", "solve.kd=100"]
    found, plain = both(monkeypatch, given(pf.load("ur5", drive), law()), 0.02, steps)
    same(
        found, plain, {**SAME, "v": 2e-8}
    )  # long steps: eta ends at 1e-12 of 6e-4, v is that over h
    assert found.signals is not None and plain.signals is not None
    np.testing.assert_allclose(found.signals.u, plain.signals.u, rtol=1e-7, atol=1e-9)


def test_steps_that_follow_the_motion_need_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    run, t = scene(pf.load("race_r1"), ()), np.linspace(0.0, 0.01, 11)
    run.resolved(t, 1e-2)  # leaves spare arrays
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    with pytest.raises(PinflexError, match="plain steps"):
        run.resolved(t, 1e-2)


@pytest.mark.parametrize("name", ["ur5", "driven ur5", "friction", "cassie"])
def test_a_tolerance_is_kept_without_the_kernel(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By whole runs, each in half the steps, against one run at a tenth that corrects its steps."""
    make, end = SCENES[name]
    run, t, tol = scene(make(tmp_path), ("torque", "deflection")), np.linspace(0.0, end, 41), 1e-2
    fine = solve_to_tolerance(run, t, 0.1 * tol)
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    plain = solve_to_tolerance(run, t, tol)
    compare = Outputs(run.mechanism, run.motion, t, run.spec.asked)
    assert max(compare.differences(plain, fine).values()) < tol
    assert max(plain.settings["error"].values()) < tol  # type: ignore[attr-defined]
