"""The compiled march takes the steps of the one in Python, and gives way where it has to."""

from __future__ import annotations

import dataclasses
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.description.loops import LOOP_KINDS, Loop
from pinflex.errors import ConvergenceError, PinflexError, RunInterrupted
from pinflex.integrators import compiled_march
from pinflex.integrators.collocation import radau
from pinflex.integrators.compiled_march import STATE, Batch, CompiledMarch
from pinflex.integrators.compiled_stages import _sorts
from pinflex.integrators.prescribed import tabulated
from pinflex.integrators.radau import Stages
from pinflex.integrators.record import Record
from pinflex.integrators.run import Run
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import kernel
from pinflex.kernel.stages import Rows, Scheme, StageKernel
from pinflex.mechanics.closure import closures
from pinflex.mechanics.compiled import Compiled
from pinflex.mechanics.equations import Equations
from pinflex.solver.same_steps import SameSteps
from pinflex.solver.scene import Scene
from pinflex.solver.tolerance import solve_to_tolerance
from tests.benchmarks.race.case import scene
from tests.every_model import manifold
from tests.property.trees import tree
from tests.scenes import Body, load
from tests.unit.kernel.test_kernel import bare

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)

COUNTS = ("steps", "newton", "tangents", "rejected", "unresolved", "repeated")
# Of the largest value: poses as far as round-off goes. What Newton may leave (1e-5 of what moves)
# shows where h^2 divides it: 3rrr and race_r3 ring. Seen: 3e-11, and 7e-6 of accelerations.
SAME = {"y": 1e-9, "v": 1e-6, "a": 2e-5, "lam": 2e-6, "torque": 2e-6, "work": 1e-7}
DRIVEN = ["solve.drive=torque", "solve.kp=1000", "solve.kd=50"]
# Model and part of its motion; delta and 3rrr move by interpolated inverse kinematics.
RUNS = {
    "race_r1": 0.3, "race_r2": 0.1, "race_r3": 0.03, "spinning_beam": 0.1, "3rrr": 0.1,
    "ur5": 0.1, "delta": 0.1, "cassie": 0.1, "models/ur5/geared.yaml": 0.1,
}  # fmt: skip


def same(found: Run, expected: Run, limits: dict[str, float]) -> None:
    assert {k: found.cost[k] for k in COUNTS} == {k: expected.cost[k] for k in COUNTS}
    for name, limit in limits.items():
        a, b = getattr(found, name), getattr(expected, name)
        assert a.shape == b.shape
        scale = np.max(np.abs(b), initial=1e-300)
        assert np.max(np.abs(a - b), initial=0.0) < limit * scale, name


def both(monkeypatch: pytest.MonkeyPatch, run: Callable[[], Run]) -> tuple[Run, Run]:
    compiled = run()
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    return compiled, run()


@pytest.mark.parametrize("name", RUNS)
def test_the_steps_are_those_of_python(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given = scene(pf.load(name), ())
    t = np.linspace(0.0, RUNS[name] * given.motion.duration, 21)
    same(*both(monkeypatch, lambda: given.resolved(t, 1e-3)), SAME)


@pytest.mark.parametrize("name", ["ur5", "delta", "race_r1"])
def test_and_so_are_those_of_motors_driven_by_torques(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = scene(pf.load(name, DRIVEN), ("torque", "platform"))
    t = np.linspace(0.0, RUNS[name] * given.motion.duration, 21)
    same(*both(monkeypatch, lambda: given.resolved(t, 1e-3)), SAME)


def test_and_in_given_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = SameSteps(pf.load("ur5", DRIVEN), None)
    found, expected = (
        steps.run(pf.load("ur5", [*DRIVEN, "solve.kp=900"]), steps.look[::9])
        for _ in (monkeypatch.setenv("PINFLEX_KERNEL", serves) for serves in ("1", "0"))
    )
    a, b = found.torque, expected.torque
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-7 * np.abs(b).max())


@pytest.mark.parametrize(
    ("name", "changes"), [("race_r2", []), ("spinning_beam", []), ("ur5", DRIVEN)]
)
def test_and_so_are_corrections(
    name: str, changes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = scene(pf.load(name, changes), ("torque", "platform"))
    t = np.linspace(0.0, given.motion.duration, 41)
    found, expected = both(monkeypatch, lambda: solve_to_tolerance(given, t, 1e-2))
    same(found, expected, SAME)
    for key, error in expected.settings["error"].items():  # type: ignore[attr-defined]
        # 5e-4, of runs that differ by 1e-8
        assert found.settings["error"][key] == pytest.approx(error, rel=1e-3)  # type: ignore[index]


def test_a_free_robot_takes_them_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A floating base beside a ball, circles, a slide and an elastic gear, in time and by tol."""
    motion = "motion: {kind: quintic, joints: {boom_joint: 0.3}, duration: 0.3}\n"
    given, t = scene(manifold(tmp_path, motion), ()), np.linspace(0.0, 0.05, 11)
    with monkeypatch.context() as patch:
        same(*both(patch, lambda: given.resolved(t, 1e-2)), SAME)
    same(*both(monkeypatch, lambda: solve_to_tolerance(given, t, 1e-1)), SAME)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.05, 0.1, 0.5, 2.0])
def test_free_bodies_move_as_pinocchio_has_them(size: float) -> None:
    """Stages of a step at constant speed: exp, and the inverse of its right Jacobian."""
    rng, model, at = np.random.default_rng(0), pin.Model(), 0
    for k, name in enumerate(("FreeFlyer", "Planar", "Spherical", "RUBX", "RX")):
        joint = getattr(pin, f"JointModel{name}")()
        at = model.addJoint(at, joint, pin.SE3.Random(), f"joint {k}")
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    system, m = bare(model), radau(3)
    scheme = Scheme(m.c, m.A, m.A2, m.A2_inverse, m.values, m.forward, m.back)
    none, sorts = np.zeros(0, dtype=np.intp), _sorts(system)
    assert sorts is not None
    rows = Rows(False, np.arange(model.nv), none, none, none, *sorts)
    stages = StageKernel(Compiled(system).evaluator, scheme, rows)
    pin.seed(1)
    y = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    v = size * rng.normal(size=model.nv)
    stages.y0[...], stages.v0[...], stages.a[...], stages.turn[...] = y, v, 0.0, 0.0
    stages.place(1.0)
    for k, share in enumerate(m.c):
        rates = np.linalg.solve(pin.dIntegrate(model, y, share * v, pin.ARG1), v)
        assert np.max(np.abs(stages.turn[k] - (rates - v))) < 1e-12 * size
        back = pin.difference(model, stages.y[k], pin.integrate(model, y, stages.move[k]))
        assert np.max(np.abs(back)) < 1e-14 * (1 + 10 * size)


def moving(kind: str) -> Scene:
    """A load that ramps up and ends, and a motion with corners."""
    ramp = ", ramp: 0.006" if kind == "trapezoid" else ""
    motion = f"{{kind: {kind}, joints: {{motor_1: 0.2}}, duration: 0.02{ramp}}}"
    load = "{at: platform, force: [5, 0, 0], start: 0.004, ramp: 0.003, until: 0.015}"
    return scene(pf.load("race_r1", [f"motion={motion}", f"forces={{push: {load}}}"]), ())


@pytest.mark.parametrize("kind", ["quintic", "trapezoid"])
def test_motions_and_loads_switch_where_they_are_told_to(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, t = moving(kind), np.linspace(0.0, 0.03, 31)
    same(*both(monkeypatch, lambda: given.resolved(t, 1e-3)), SAME)


def test_what_has_no_table_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    given, t = scene(pf.load("race_r1"), ()), np.linspace(0.0, 0.02, 21)
    tabled = given.resolved(t, 1e-3)
    monkeypatch.setattr(compiled_march, "tabulated", lambda *_: None)
    asked = scene(pf.load("race_r1"), ())  # which has no table of the run before
    same(asked.resolved(t, 1e-3), tabled, SAME)


def table_of(function: Callable[[Array], Array], corners: Sequence[float] = ()) -> object:
    return tabulated(lambda t: function(t)[:, None], [slice(0, 1)], 0.0, 1.0, corners)


def test_only_what_is_smooth_has_a_table() -> None:
    assert table_of(lambda t: np.sin(40.0 * t)) is not None
    assert table_of(lambda t: np.abs(t - 0.3)) is None
    assert table_of(lambda t: np.abs(t - 0.3), (0.3,)) is not None
    assert table_of(lambda t: np.maximum(t - 0.3, 0.0) ** 3) is None
    noisy = table_of(lambda t: 1e-3 * t + 0.1 * ((1e4 + t**3) - 1e4))  # round-off of 1e-12
    assert noisy is not None


@pytest.mark.parametrize("seed", range(6))
def test_closures_move_as_pinocchio_says(seed: int) -> None:
    """Second derivatives of closures of every kind, at states of random trees."""
    m, rng = tree(seed).build(), np.random.default_rng(seed)
    links, loops = [link.name for link in m.links], []
    for kind in LOOP_KINDS:
        one, two = rng.choice(links, 2, replace=False)
        z, x = (tuple(axis / np.linalg.norm(axis)) for axis in rng.normal(size=(2, 3)))
        if kind != "slider":
            loops.append(Loop(kind, kind, one, two, z, x, 0.7))
    on = m.flexible.expansion
    system = dataclasses.replace(m.flexible, closed=closures(loops, on.frames, on.model))
    d, nv, rows = Equations(system, often=False), system.nv, system.closed.n
    size = np.ones(nv)
    size[d.n_rigid :] = 0.02
    y = d.integrate(m.undeformed(), 0.5 * size * rng.uniform(-1, 1, nv))
    v, a = (size * rng.uniform(-1, 1, nv) for _ in range(2))
    evaluator = Evaluator(system.tables)
    matrices, r, rates = np.empty(nv * (3 * nv + rows)), np.empty(nv), np.empty(rows)
    given = (y, v, a, np.zeros(rows), np.zeros(0), matrices, r, rates)
    pointers = (x.ctypes.data for x in given)
    evaluator.functions.pinflex_motion(evaluator.tables.address, evaluator.work, *pointers)
    expected = d.close(y).J @ a + d.closure_bias(y, v)
    # Sums in another order; seen: 2e-15 of the largest.
    np.testing.assert_allclose(rates, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_a_run_that_breaks_off_keeps_its_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    m = pf.load("spinning_beam", ["flexible.*.second_order=false", "motion.joints={hub: 60.0}"])
    given, t = scene(m, ()), np.linspace(0.0, 15.0, 151)

    def stopped() -> Run:
        with pytest.raises(ConvergenceError) as caught:
            given.resolved(t, 1e-3)
        run: Run = caught.value.result
        return run

    found, expected = both(monkeypatch, stopped)
    assert 1 < len(found.t) < 151
    assert found.stopped
    # What runs away magnifies round-off.
    assert len(found.t) == pytest.approx(len(expected.t), abs=2)


def test_a_signal_stops_the_march_within_a_second() -> None:
    given = scene(pf.load("race_r3"), ())
    t = np.linspace(0.0, given.motion.duration, 4001)
    rung: list[float] = []

    def ring(done: int, samples: int) -> None:
        if done > 1 and not rung:
            rung.append(time.process_time())
            signal.setitimer(signal.ITIMER_REAL, 0.05)

    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        with pytest.raises(RunInterrupted) as caught:
            given.resolved(t, 1e-11, ring)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert time.process_time() - rung[0] < 1.05
    run = caught.value.result
    assert run.stopped == "interrupted"
    assert 1 < len(run.t) < len(t)
    assert np.isfinite(run.y).all()


def test_the_kernel_returns_when_its_patience_is_at_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given, t = scene(pf.load("race_r2"), ()), np.linspace(0.0, 0.02, 11)
    patient = given.resolved(t, 1e-3)
    monkeypatch.setattr(compiled_march, "_PATIENCE", 0.0)
    hasty = given.resolved(t, 1e-3)
    np.testing.assert_array_equal(hasty.y, patient.y)
    assert hasty.cost == patient.cost


def test_sizes_are_checked_where_arrays_go_over() -> None:
    given, batches = scene(pf.load("race_r1"), ()), []
    t = np.linspace(0.0, 0.01, 11)

    class Kept(Record):
        def take(self, steps: Batch, count: object = None) -> int:  # type: ignore[override]
            batches.append(steps)
            return super().take(steps)

    given.kept(t, 1e-2, lambda stages: Kept(stages, t, 1e-2), 0.02, 0.0)
    made, kernel = batches[-1].made, batches[-1].made.kernel
    room = [
        np.zeros((len(t), width)) for width in (*(getattr(kernel, name).size for name in STATE), 2)
    ]
    with pytest.raises(PinflexError, match="samples outside"):
        made.samples(t, np.full(len(t), 99), room)
    with pytest.raises(PinflexError, match="samples outside"):
        made.samples(t, np.full(len(t), -2), room)
    with pytest.raises(PinflexError, match="inputs of"):
        kernel.samples(t, np.ones(len(t), int), np.zeros((3, 1)), room)
    with pytest.raises(PinflexError, match="room of"):
        kernel.samples(t, np.ones(len(t), int), None, room[::-1])
    with pytest.raises(PinflexError, match="weights"):
        made.kernel.correct(made.kernel, np.zeros((2, 2)), None, None)
    whole = list(batches[-1])
    assert [step.h for step in batches[-1][:2]] == [step.h for step in whole[:2]]
    assert whole[-1].path.acceleration.shape == (6, 3)


def same_start(given: Scene) -> None:
    """Accelerations, multipliers and torques at a random speed."""
    t = np.linspace(0.0, 0.1, 3)
    stages = given._stages(t, Equations(given._system), 1e-3)[0]
    assert isinstance(stages, Stages)
    y = given._start.y
    v = 0.1 * np.random.default_rng(0).normal(size=given._system.nv)
    march = CompiledMarch("", stages, (y, v), t, (), 1e-3, False)
    assert march._kernel.begin()
    found, stages.dynamics = march.now, Equations(given._system, often=False)
    expected = stages.first(0.0, y, v)
    for name in ("a", "lam", "torque"):
        wanted = getattr(expected, name)
        scale = np.abs(wanted).max(initial=1e-300)
        # M by the kernel and by crba, 5e-14, times its condition; seen: 5e-12.
        np.testing.assert_allclose(getattr(found, name), wanted, rtol=0, atol=1e-9 * scale)


def test_a_start_is_that_of_python() -> None:
    same_start(scene(pf.load("race_r2"), ()))


@pytest.mark.parametrize("loop", ["", "loops: {rope: {kind: distance, between: [rod, hand]}}\n"])
def test_and_so_it_is_where_coordinates_have_no_mass(loop: str, tmp_path: Path) -> None:
    """Pins that move a rod's origin twice, between a motor and a tip: the least of the answers."""
    bodies = (
        Body("arm", "base", "revolute", mass=2.0, com=(0.3, 0, 0), inertia=(0.1, 0.1, 0.1)),
        Body("pin", "arm", "revolute", xyz=(0.5, 0, 0)),
        Body("cross", "pin", "revolute", axis=(0, 1, 0)),
        Body("twin", "cross", "revolute", axis=(0, 1, 0)),
        Body("rod", "twin", "revolute", mass=1.0, com=(1, 0, 0), inertia=(1e-3, 1e-3, 1e-3)),
        Body(
            "hand",
            "base",
            "prismatic",
            xyz=(0, 1, 0),
            axis=(0, 1, 0),
            mass=0.5,
            inertia=(0.01, 0.01, 0.01),
        ),
    )
    sprung = ", ".join(f"{x}_joint: {{spring: 100}}" for x in ("pin", "cross", "twin", "rod"))
    m = load(
        tmp_path, bodies, f"actuated: [arm_joint]\njoints: {{{sprung}}}\n{loop}"
        "motion: {kind: quintic, joints: {arm_joint: 0.5}, duration: 1}\n",
    )  # fmt: skip
    same_start(scene(m, ()))
