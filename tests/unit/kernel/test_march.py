"""The compiled march: its starts, tables, sizes, and how it gives way where it has to.

Claims:
    Tolerances, collocation
    - its moves of free, planar, ball and circle joints from 1e-6 to 2 rad, and their rates |
      `pin.integrate`, `pin.dIntegrate` | 1e-12 of the speed | 1e-13
    - a platform's motors are read from a table of their quintics, with no call of Python | the path
      itself at other times | 1e-14 of the largest | 2e-15
    - its starts at a random speed, also where coordinates have no mass; second derivatives of
      closures of every kind on random trees | `consistent_acceleration`; Pinocchio's Jacobian rates
      | 1e-9; 1e-11 | 5e-12; 2e-15
    - a signal stops it within a second, with the run so far; it comes back when its patience ends |
      clock | 1 s | 0.02 s
"""

from __future__ import annotations

import dataclasses
import gc
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.actuation import drive
from pinflex.arrays import Array
from pinflex.description.loops import LOOP_KINDS, Loop
from pinflex.errors import ConvergenceError, Ending, PinflexError, RunInterrupted
from pinflex.integrators import compiled, march
from pinflex.integrators.collocation import radau
from pinflex.integrators.compiled import STATE, Batch, MarchKernel, StageKernel, read, tabulated
from pinflex.integrators.march import March, Radau, Record
from pinflex.kernel import evaluate
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import kernel
from pinflex.mechanics.closure import closures
from pinflex.mechanics.evaluation.compiled import Compiled
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import sorts_of
from pinflex.solver.scene import Scene
from pinflex.solver.solve import default_motion
from tests.benchmarks.race.case import scene
from tests.property.trees import tree
from tests.scenes import Body, load
from tests.unit.kernel.test_kernel import bare

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.05, 0.1, 0.5, 2.0])
def test_free_bodies_move_as_pinocchio_has_them(size: float) -> None:
    """Stages of a step at constant speed: exp, and the inverse of its right Jacobian."""
    rng, model, at = np.random.default_rng(0), pin.Model(), 0
    for k, name in enumerate(("FreeFlyer", "Planar", "Spherical", "RUBX", "RX")):
        joint = getattr(pin, f"JointModel{name}")()
        at = model.addJoint(at, joint, pin.SE3.Random(), f"joint {k}")
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    system, m, none = bare(model), radau(3), np.zeros(0, dtype=np.intp)
    rows = {"free_at": np.arange(model.nv), "motor_v": none} | sorts_of(model)
    stages = StageKernel(Compiled(system), m, False, rows)
    pin.seed(1)
    y = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    v = size * rng.normal(size=model.nv)
    x = stages.arrays
    x["y0"][...], x["v0"][...], stages.at.h = y, v, 1.0
    stages.functions.pinflex_place(stages.tables, stages.address)
    for k, share in enumerate(m.c):
        rates = np.linalg.solve(pin.dIntegrate(model, y, share * v, pin.ARG1), v)
        assert np.max(np.abs(x["turn"][k] - (rates - v))) < 1e-12 * size
        back = pin.difference(model, x["y"][k], pin.integrate(model, y, x["move"][k]))
        assert np.max(np.abs(back)) < 1e-14 * (1 + 10 * size)


def test_what_has_no_table_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    given, t = scene(pf.load("race_r1"), ()), np.linspace(0.0, 0.02, 21)
    tabled = given.resolved(t, 1e-3)
    monkeypatch.setattr(compiled, "tabulated", lambda *_: None)
    asked = scene(pf.load("race_r1"), ()).resolved(t, 1e-3)  # which has no table of the run before
    assert asked.cost == tabled.cost
    # what Newton may leave: 1e-5 of what moves, and h^2 divides it
    most = 2e-6 * np.abs(tabled.torque).max()
    np.testing.assert_allclose(asked.torque, tabled.torque, rtol=0, atol=most)


def test_a_platform_is_marched_without_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its motors follow quintics between poses: the table has them to the last digits."""
    robot = pf.load("3tpt")  # accelerations jump
    given, t = scene(robot, ()), np.linspace(0.0, 0.7, 15)
    monkeypatch.setattr(march.Radau, "inside", None)  # whoever calls it fails
    run = given.resolved(t, 1e-3)
    assert run.t[-1] == t[-1]
    motion = default_motion(robot)
    path = drive.path_between(robot, motion, 0.0, 0.7)

    def columns(t: Array) -> Array:
        at = path(t)
        return np.concatenate([at.position, at.velocity, at.acceleration], axis=1)

    kinds = [slice(3 * k, 3 * k + 3) for k in range(3)]
    table = tabulated(columns, kinds, 0.0, 0.7, motion.switches, path.pieces)
    assert table is not None and len(table.arrays["node"]) == 7
    times = np.random.default_rng(0).uniform(0.0, 0.7, 500)
    off = np.abs(read(table, times) - columns(times))
    for kind in kinds:  # seen: 2e-15 of the largest
        assert off[:, kind].max() < 1e-14 * np.abs(columns(times)[:, kind]).max()


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
    d, nv, rows = Equations(system), system.nv, system.closed.n
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


def test_a_run_that_breaks_off_keeps_its_steps() -> None:
    m = pf.load("spinning_beam", ["flexible.*.second_order=false", "motion.joints={hub: 60.0}"])
    given, t = scene(m, ()), np.linspace(0.0, 15.0, 151)
    with pytest.raises(ConvergenceError) as caught:
        given.resolved(t, 1e-3)
    found = caught.value.result
    assert 1 < len(found.t) < 151
    assert caught.value.ending is Ending.RUNS_AWAY


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
    assert 1 < len(run.t) < len(t)
    assert np.isfinite(run.y).all()


def test_the_kernel_returns_when_its_patience_is_at_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given, t = scene(pf.load("race_r2"), ()), np.linspace(0.0, 0.02, 11)
    patient = given.resolved(t, 1e-3)
    monkeypatch.setattr(march, "_PATIENCE", 0.0)
    hasty = given.resolved(t, 1e-3)
    np.testing.assert_array_equal(hasty.y, patient.y)
    assert hasty.cost == patient.cost


def test_sizes_are_checked_where_arrays_go_over() -> None:
    given, batches = scene(pf.load("race_r1"), ()), []
    t = np.linspace(0.0, 0.01, 11)

    class Kept(Record):
        def take(self, steps: Batch) -> int:
            batches.append(steps)
            return super().take(steps)

    given.kept(t, 1e-2, lambda _: Kept(given.mechanism.flexible, t, 1e-2), 0.02, 0.0)
    made, kernel = batches[-1], batches[-1].kernel
    room = [
        np.zeros((len(t), width)) for width in (*(getattr(kernel, name).size for name in STATE), 2)
    ]
    with pytest.raises(PinflexError, match="samples outside"):
        made.samples(t, np.full(len(t), 99), room)
    with pytest.raises(PinflexError, match="samples outside"):
        made.samples(t, np.full(len(t), -2), room)
    with pytest.raises(PinflexError, match="an array of"):
        kernel.samples(t, np.ones(len(t), int), np.zeros((3, 1)), room)
    with pytest.raises(PinflexError, match="an array of"):
        kernel.samples(t, np.ones(len(t), int), None, room[::-1])
    with pytest.raises(PinflexError, match="weights"):
        kernel.correct(kernel, np.zeros((2, 2)), None, None)
    assert list(made.upto(2).h) == list(made.h[:2])


def same_start(given: Scene) -> None:
    """Accelerations, multipliers and torques at a random speed."""
    t = np.linspace(0.0, 0.1, 3)
    problem = given._problem(t, Equations(given._system, marched=True))
    y = given.start.y
    v = 0.1 * np.random.default_rng(0).normal(size=given._system.nv)
    begun = March("", Radau(problem, radau(6)), (y, v), (0.0, 0.1), {}, 1e-4, (8, 9))
    assert begun.kernel.begin()
    problem.dynamics = Equations(given._system)
    found, expected = begun.now, problem.first(0.0, y, v)
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


def test_arrays_of_a_large_run_go_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """No circle keeps them until a garbage collection: three runs of 100 MB would be 300."""
    monkeypatch.setattr(evaluate, "_LARGEST", 0.0)  # as beside a large run: none is kept to spare

    def alive() -> int:
        return sum(isinstance(x, (StageKernel, MarchKernel)) for x in gc.get_objects())

    robot = pf.load("3rrr")
    gc.collect()
    gc.disable()
    try:
        before = alive()
        run = pf.solve(robot, level="coupled", tol=1e-2, samples=11)
        del run
        assert alive() == before
    finally:
        gc.enable()
