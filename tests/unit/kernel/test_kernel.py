"""The compiled kernel says what Pinocchio says, on every system that it covers.

Claims:
    Tolerances, collocation
    - the compiled kernel: residual and closures of 1200 states, all models rigid and flexible, the
      free robot with an elastic gear, dry friction, loads and springs, random trees with every
      closure, with joints that follow others, masses that differ with the direction, bends that are
      not small; every joint of Pinocchio's that it has | numpy and Pinocchio; `pin.rnea` | 1e-11 of
      the largest force | 2e-15
    - the same: M, C, K (without the stiffness of links), J | Pinocchio's derivatives | 1e-9 of the
      largest entry | 5e-14
    - its poses of every frame of random trees | Pinocchio | 1e-12 | 4e-15
    - its sines up to 1e7 rad; a not-a-number stays in its state; both builds; sizes and indices
      refused | libm | 4e-16 | passes
    - closures of several states, their Jacobians, accelerations without a, first and second time
      derivatives, every kind | Pinocchio's Jacobians and their rates | 1e-11 | passes
"""

from __future__ import annotations

import dataclasses
import os
import pickle
import subprocess
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.arrays import Array
from pinflex.bodies.basis import Curvature
from pinflex.description.blocks.joints import Coupling
from pinflex.description.loops import LOOP_KINDS, Loop
from pinflex.errors import KernelWarning, PinflexError
from pinflex.kernel import build, library
from pinflex.kernel.evaluate import Evaluator, Tables
from pinflex.kernel.library import kernel
from pinflex.mechanics.closure import Closures, closures
from pinflex.mechanics.evaluation.compiled import Compiled, evaluated_by, serves
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import Frame, closure_motion, frame_poses
from pinflex.mechanics.evaluation.kernel_tables import uncovered
from pinflex.mechanics.model.loads import AddedMasses, Expansion, Loads, Slot, Springs
from pinflex.mechanics.model.system import System
from pinflex.mechanics.reference.evaluator import Reference
from tests.every_model import NAMES, WHICH, at_home, manifold, mechanism
from tests.property.trees import tree
from tests.sound_tables import UnsoundTables

# The same sums in another order, up to a few thousand terms; seen: 2e-15 of the largest force.
SAME = 1e-11
SAME_TANGENT = 1e-9  # of the largest entry of each matrix; seen: 5e-14
STATES = 24

FOLLOWER = "forces: {pull: {at: hand, force: [1.0, 2.0, 3.0], follower: true, ramp: 2.0}}"
LOADS = """
forces:
  pull: {at: hand, force: [1.0, 2.0, 3.0], follower: true, ramp: 2.0}
  push: {at: foot, force: [3.0, 2.0, 1.0], moment: [1.0, 2.0, 3.0]}
springs: {rope: {between: [grip, foot], stiffness: 30, damper: 4, length: 0.2}}
"""

needs_kernel = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)


def states(system: System, home: Array, count: int, seed: int = 1) -> tuple[Array, ...]:
    """y, v, a, lam of size one; links bend by a few per cent of a metre-size span."""
    rng, d = np.random.default_rng(seed), Equations(system)
    size = np.ones(system.nv)
    size[d.n_rigid :] = 0.02
    Y = np.array(
        [d.integrate(home, 0.5 * size * m) for m in rng.uniform(-1, 1, (count, len(size)))]
    )
    V, A = (size * rng.uniform(-1, 1, (count, len(size))) for _ in range(2))
    return Y, V, A, rng.uniform(-1, 1, (count, system.closed.n)), rng.uniform(0, 3, count)


def apart(found: Array, expected: Array) -> float:
    """Largest difference over the largest entry of each state."""
    scale = np.max(np.abs(expected), axis=1, initial=1e-300)
    return float(np.max(np.max(np.abs(found - expected), axis=1, initial=0.0) / scale, initial=0.0))


def same_closure_motion(system: System, given: Sequence[Array]) -> None:
    """Closures, their Jacobians and derivatives are Pinocchio's."""
    Y, V, A = given
    plain = without_kernel(system)
    (c, J), gamma = plain.close(Y), plain.closure_bias(Y, V)
    mine = Equations(system)
    for found, known in zip((*mine.close(Y), mine.closure_bias(Y, V)), (c, J, gamma), strict=True):
        assert np.max(np.abs(found - known), initial=0.0) < SAME * np.max(
            np.abs(known), initial=1.0
        )
    expected = c, (J @ V[:, :, None])[:, :, 0], (J @ A[:, :, None])[:, :, 0] + gamma
    for found, known in zip(closure_motion(Equations(system), Y, V, A), expected, strict=True):
        # Of the largest term of all: sums of a row may cancel.
        scale = np.max(np.abs(known), initial=1.0)
        assert np.max(np.abs(found - known), initial=0.0) < SAME * scale


def same_outputs(system: System, given: Sequence[Array]) -> None:
    """What recovery asks for: motions, energies and forces are those of numpy and Pinocchio."""
    (Y, V, A, lam, t), joints = given, system.looked_at
    mine, plain = Compiled(system), without_kernel(system)
    forces, known = (x.joint_forces(Y, V, A, lam, t, joints[1:]) for x in (mine, plain))
    rates, moved = (x.motions(Y, V, A, joints)[1] for x in (mine, plain))
    pairs = [
        (mine.poses(Y, joints), plain.motions(Y, V, A, joints)[0]), (rates, moved),
        *zip(mine.energies(Y, V, t), plain.energies(Y, V, t), strict=True),
        *zip(forces, known, strict=True),
    ]  # fmt: skip
    for found, expected in pairs:
        assert found.shape == expected.shape
        scale = np.max(np.abs(expected), initial=1.0)
        assert np.max(np.abs(found - expected), initial=0.0) < SAME * scale


def agrees(system: System, home: Array, count: int = STATES, seed: int = 1) -> None:
    given = states(system, home, count, seed)
    R, C = Compiled(system).residual(*given)
    r, c = without_kernel(system).residual(*given)
    assert apart(R, r) < SAME
    assert np.max(np.abs(C - c), initial=0.0) < SAME  # m, of metre-size mechanisms
    same_closure_motion(system, given[:3])
    same_outputs(system, given)
    # Stiffness and damping, which both take from the same tables, would hide the rest.
    zero = np.zeros_like(system.K)
    same_tangent(dataclasses.replace(system, K=zero, D=zero), [x[0] for x in given])


_LAST: list[Reference] = []


def without_kernel(system: System) -> Reference:
    """The plain reference of Pinocchio and numpy, on the last one's workspace where it may be."""
    found, last = Reference(system), _LAST[-1:]
    for placing in (one.placing for one in last if one.model is found.model):
        if "data" in placing.__dict__:  # of a large model, 4 nV^3 numbers: it takes half a second
            found.placing.data = placing.data
    _LAST[:] = [found]
    return found


def same_tangent(system: System, state: list[Array]) -> None:
    """With the rates of second-order rows; without them where elastic coordinates have none."""
    (y, v, a, lam, t), n = state, int(system.rigid.nv)
    compiled, reference = Compiled(system), without_kernel(system)
    for rates in (True, False) if n else (True,):
        if not rates:
            v, a = (np.append(x[:n], np.zeros(system.n_eta)) for x in (v, a))
        r = reference.residual(y[None], v[None], a[None], lam[None], np.array([t]))[0]
        expected = reference.tangent(y, v, a, lam, float(t))
        # A matrix that is zero has the round-off of the forces whose difference it is.
        least = 1e-3 * float(np.max(np.abs(r), initial=0.0))
        found = compiled.tangent(y, v, a, lam, float(t), rates)
        same_matrices(found, expected, least)


def same_matrices(found: Sequence[Array], expected: Sequence[Array], least: float) -> None:
    for one, other in zip(found, expected, strict=True):
        scale = max(np.max(np.abs(other), initial=1e-300), least)
        assert np.max(np.abs(one - other), initial=0.0) < SAME_TANGENT * scale


@needs_kernel
@pytest.mark.parametrize("which", WHICH)
@pytest.mark.parametrize("name", NAMES)
def test_the_kernel_is_pinocchio_on_every_shipped_model(name: str, which: str) -> None:
    system, home = at_home(mechanism(name), which)
    served = evaluated_by(system)
    assert served == f"kernel ({kernel().said})" or system.n_eta == 0
    agrees(system, home)


@needs_kernel
@pytest.mark.parametrize("which", WHICH)
@pytest.mark.parametrize("loads", ["", FOLLOWER, LOADS])
def test_and_on_a_free_robot_with_springs_and_loads(loads: str, which: str, tmp_path: Path) -> None:
    agrees(*at_home(manifold(tmp_path, loads), which))


def closed_anyhow(seed: int) -> tuple[System, Array]:
    """A random tree with a loop of every kind between random links, and its pose."""
    m, rng = tree(seed).build(), np.random.default_rng(seed)
    links = [link.name for link in m.links]
    loops = []
    for kind in LOOP_KINDS:
        a, b = rng.choice(links, 2, replace=False)
        axes = rng.normal(size=(2, 3))
        z, x = (tuple(axis / np.linalg.norm(axis)) for axis in axes)
        if kind != "slider":
            loops.append(Loop(kind, kind, a, b, z, x, 0.7))
    expansion = m.flexible.expansion
    closed = closures(loops, expansion.frames, expansion.model)
    return dataclasses.replace(m.flexible, closed=closed), m.undeformed()


@needs_kernel
@pytest.mark.parametrize("seed", range(12))
def test_and_on_random_trees_with_every_kind_of_closure(seed: int) -> None:
    agrees(*closed_anyhow(seed), STATES, seed)


@needs_kernel
@pytest.mark.parametrize("first", range(12, 60, 16))
def test_and_the_residuals_of_sixty_of_them(first: int) -> None:
    for seed in range(first, first + 16):
        system, home = closed_anyhow(seed)
        given = states(system, home, 4, seed)
        R, C = Compiled(system).residual(*given)
        r, c = without_kernel(system).residual(*given)
        assert apart(R, r) < SAME, seed  # seen: 5e-15
        assert np.max(np.abs(C - c), initial=0.0) < SAME, seed


def bare(model: pin.Model) -> System:
    """A model of Pinocchio's as a system, with nothing added."""
    none, nv = np.zeros(0, dtype=np.intp), int(model.nv)
    expansion = Expansion(model, np.arange(model.nq), np.arange(nv), (), {}, (), 0)
    springs = Springs(none, none, none, np.zeros(0), np.zeros(0))
    free: Closures = closures((), {}, model)
    zero = np.zeros((nv, nv))
    return System(model, expansion, free, zero, zero, springs, none, Loads((), ()))


def turning_without_end(axis: Array) -> pin.JointModel:
    """A continuous joint about any axis, which only a URDF can make."""
    xyz = " ".join(f"{x:.17g}" for x in axis)
    return pin.buildModelFromXML(
        f'<robot name="one"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        f'<parent link="a"/><child link="b"/><axis xyz="{xyz}"/></joint></robot>'
    ).joints[1]


def random_model(seed: int) -> pin.Model:
    """A tree of every joint of Pinocchio's that the kernel has, in random order."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    model.gravity.linear = rng.normal(size=3)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    straight = ("RX", "RY", "RZ", "RUBX", "RUBY", "RUBZ", "PX", "PY", "PZ")
    joints = [getattr(pin, f"JointModel{name}")() for name in straight]
    joints += [pin.JointModelRevoluteUnaligned(axis), pin.JointModelPrismaticUnaligned(axis)]
    joints += [pin.JointModelSpherical(), pin.JointModelFreeFlyer(), pin.JointModelPlanar()]
    joints += [pin.JointModelTranslation(), pin.JointModelRX(), turning_without_end(axis)]
    for k in rng.permutation(len(joints)):
        # Depth first: Pinocchio's derivatives take a subtree for neighbouring rows.
        chain = list(model.supports[model.njoints - 1])
        parent = int(chain[-int(rng.integers(1, min(3, len(chain)) + 1))])
        joint = model.addJoint(parent, joints[k], pin.SE3.Random(), f"joint {k}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
    model.armature = rng.uniform(0, 1, model.nv)
    return model


@needs_kernel
@pytest.mark.parametrize("seed", range(12))
def test_and_is_rnea_on_random_trees_with_every_joint(seed: int) -> None:
    model = random_model(seed)
    Y, V, A, lam, t = states(bare(model), pin.neutral(model), STATES, seed)
    R, _ = Compiled(bare(model)).residual(Y, V, A, lam, t)
    data = pin.Data(model)
    assert apart(R, np.array([pin.rnea(model, data, *x) for x in zip(Y, V, A)])) < SAME  # noqa: B905
    same_tangent(bare(model), [Y[0], V[0], A[0], lam[0], t[0]])


@needs_kernel
@pytest.mark.parametrize("seed", range(8))
def test_and_where_joints_follow_others_beside_loops(seed: int) -> None:
    """Revolutes, slides and an elastic gear of random trees, some twice and one to the base."""
    m, rng = tree(seed).build(), np.random.default_rng(seed)
    on = m.flexible.expansion
    a, b = rng.choice([link.name for link in m.links], 2, replace=False)
    loops = [Loop("rope", "distance", a, b, length=0.7)]
    joints = zip(on.model.names, on.model.joints, strict=True)
    single = [name for name, joint in joints if joint.nq == 1 and name in m.coordinates]
    pairs = rng.choice(single, (2, 2)) if len(single) > 1 else np.zeros((0, 2))
    coupled = [Coupling(a, b, *rng.normal(size=2)) for a, b in pairs if a != b]
    coupled += [Coupling(single[-1], None, 0.0, 0.3)] if single else []
    closed = closures(loops, on.frames, on.model, couplings=coupled)
    system = dataclasses.replace(m.flexible, closed=closed)
    assert len(closed.coupled.rows) == len(coupled) and serves(system)
    agrees(system, m.undeformed(), STATES, seed)


@needs_kernel
@pytest.mark.parametrize("seed", range(8))
def test_and_with_masses_that_differ_with_the_direction(seed: int) -> None:
    """Of two bodies, sections of links among them, with all 21 numbers each."""
    m, rng = tree(seed).build(), np.random.default_rng(seed)
    joints = rng.choice(np.arange(1, m.flexible.expansion.model.njoints), 2, replace=False)
    X = rng.normal(size=(2, 6, 6))
    added = AddedMasses(tuple(map(int, joints)), X @ X.swapaxes(1, 2))
    agrees(dataclasses.replace(m.flexible, added=added), m.undeformed(), STATES, seed)


@needs_kernel
@pytest.mark.parametrize("seed", range(4))
def test_and_with_bends_that_are_not_small(seed: int) -> None:
    """In one direction or in two, with random rows."""
    m, rng = tree(seed).build(), np.random.default_rng(seed)

    def curved(slot: Slot) -> Slot:
        rows = rng.normal(size=(2, 1 + seed % 2, 5, slot.body.n))
        bent = Curvature(rows[0], rows[1], 100.0 * rng.uniform(1, 2, 5))
        return dataclasses.replace(slot, body=dataclasses.replace(slot.body, curvature=bent))

    on = m.flexible.expansion
    on = dataclasses.replace(on, slots=tuple(map(curved, on.slots)))
    assert on.slots
    agrees(dataclasses.replace(m.flexible, expansion=on), m.undeformed(), STATES, seed)


@needs_kernel
@pytest.mark.parametrize("seed", range(4))
def test_and_frames_stand_where_pinocchio_has_them(seed: int) -> None:
    m = tree(seed).build()
    system, compiled = m.flexible, Equations(m.flexible)
    assert compiled.compiled is not None
    Y = states(system, m.undeformed(), 7, seed)[0]
    nodes = [system.node_of_joints[place.joint] for place in system.expansion.frames.values()]
    assert max(nodes) > 0
    for place in system.expansion.frames.values():
        found = frame_poses(compiled, Y, place)
        expected = Frame(compiled.model, place).pose(compiled.joint_poses(Y))
        for one, other in zip(found, expected, strict=True):  # seen: 4e-15 in metres of chain
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    evaluator = Evaluator(system.tables)
    with pytest.raises(PinflexError, match="an array of"):
        evaluator.poses(Y[:, 1:], [0])
    with pytest.raises(PinflexError, match="a node that is none"):
        evaluator.poses(Y, [evaluator.tables.counts["nodes"]])
    with pytest.raises(PinflexError, match="no joints that outputs look at"):
        compiled.compiled.poses(Y, [int(np.flatnonzero(system.node_of_joints[1:] < 0)[0]) + 1])


@needs_kernel
def test_sines_hold_far_from_zero() -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "joint")
    body = pin.Inertia(1.0, np.array([1.0, 0.0, 0.0]), np.eye(3))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.gravity.linear = np.array([0.0, -1.0, 0.0])
    angle = np.concatenate([np.linspace(-10, 10, 997), np.logspace(-9, 7, 100), [1e300]])[:, None]
    none = np.zeros_like(angle)
    R, _ = Compiled(bare(model)).residual(angle, none, none, none[:, :0], none[:, 0])
    # cos(x) is the moment of gravity; k pi / 2 in three parts loses 1e-16 k 1e-11 of the angle.
    np.testing.assert_allclose(R[:, 0], np.cos(angle[:, 0]), rtol=0, atol=4e-16)


@needs_kernel
def test_a_number_that_is_none_stays_one() -> None:
    system, home = at_home(mechanism("3rrr"), "flexible")
    Y, V, A, lam, t = states(system, home, 8)
    Y[3, 0] = np.nan
    R, _ = Compiled(system).residual(Y, V, A, lam, t)
    assert np.isnan(R[3]).any()
    assert np.isfinite(np.delete(R, 3, axis=0)).all()


@needs_kernel
def test_sizes_and_indices_are_checked_at_the_boundary() -> None:
    system, home = at_home(mechanism("3rrr"), "flexible")
    Y, V, A, lam, _ = states(system, home, 3)
    evaluator = Evaluator(system.tables)
    with pytest.raises(PinflexError, match="an array of"):
        evaluator.residual(Y[:, 1:], V, A, lam, np.zeros((3, 0)))
    counts, arrays = system.tables.__reduce__()[1]
    for name, wrong in (("node_v", 1_000_000), ("parent", 1_000_000), ("kind", 7), ("phi_at", -1)):
        bad = {**arrays, name: np.full_like(arrays[name], wrong)}
        with pytest.raises((UnsoundTables, PinflexError, ValueError, IndexError)):
            Tables(counts, bad)  # see `conftest.py`
    for name, wrong in (("x_at", 0), ("block_of", 0), ("block_above", -1), ("node_block", 0)):
        with pytest.raises(UnsoundTables, match="do not fit their paths"):
            Tables(counts, {**arrays, name: np.full_like(arrays[name], wrong)})
    with pytest.raises(PinflexError, match="entries, not"):
        Tables(counts, {**arrays, "mass": arrays["mass"][1:]})


@needs_kernel
def test_tables_travel_to_other_processes() -> None:
    system, home = at_home(mechanism("race_r1"), "flexible")
    Y, V, A, lam, _ = states(system, home, 2)
    none = np.zeros((2, 0))
    there = pickle.loads(pickle.dumps(system.tables))
    found = Evaluator(there).residual(Y, V, A, lam, none)
    np.testing.assert_array_equal(
        found[0], Evaluator(system.tables).residual(Y, V, A, lam, none)[0]
    )


def test_what_the_kernel_does_not_know_it_does_not_do() -> None:
    """Kinds of joints; records and their fields: test_terms.py."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelHZ(), pin.SE3.Identity(), "screw")
    assert uncovered(bare(model)) == "joint of Pinocchio's kind HZ"


def test_the_kernel_is_switched_off_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    m = pf.load("3rrr")
    assert not serves(m.flexible)
    assert m.evaluated_by == "numpy and Pinocchio (kernel: switched off by PINFLEX_KERNEL=0)"
    with pytest.raises(PinflexError, match="switched off"):
        Evaluator(m.flexible.tables)


def test_a_run_says_by_which_equations_it_was_made(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = pf.load("3rrr")
    run = pf.solve(robot, level="coupled", dt=1e-3, until=2e-3, samples=2)
    assert run.meta["evaluated_by"] == robot.evaluated_by
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    plain = pf.solve(robot, level="coupled", dt=1e-3, until=2e-3, samples=2)
    by = "numpy and Pinocchio (kernel: switched off by PINFLEX_KERNEL=0)"
    assert plain.meta["evaluated_by"] == by and by in plain.summary()
    rigid = pf.solve(robot, level="rigid", until=2e-3, samples=2)
    assert "equations" not in rigid.summary()  # there the kernel would not serve either


def test_a_missing_kernel_is_warned_of_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Switched off by PINFLEX_KERNEL=0 it is not missing."""
    robot = pf.load("3rrr")
    monkeypatch.setattr(library, "_load", lambda: library.Library(None, "not built: build it"))
    library.warn_if_missing.cache_clear()
    with pytest.warns(KernelWarning, match=r"does not run \(not built: build it\)"):
        run = pf.solve(robot, level="quasistatic", until=1e-3, samples=2)
    assert run.meta["evaluated_by"] == "numpy and Pinocchio (kernel: not built: build it)"
    with warnings.catch_warnings():
        warnings.simplefilter("error", KernelWarning)
        pf.solve(robot, level="quasistatic", until=1e-3, samples=2)
        library.warn_if_missing.cache_clear()
        monkeypatch.setenv("PINFLEX_KERNEL", "0")
        pf.solve(robot, level="quasistatic", until=1e-3, samples=2)
    library.warn_if_missing.cache_clear()


def test_the_command_says_in_one_line_that_the_kernel_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(library, "_load", lambda: library.Library(None, "not built: build it"))
    for command in ("solve 3rrr --level rigid --until 0.001 --samples 2", "check 3rrr"):
        library.warn_if_missing.cache_clear()
        assert main(command.split()) == 0
        said = capsys.readouterr().err
        assert said.count("\n") == (command[:5] == "solve"), said
        assert ("pinflex: the compiled kernel does not run (not built" in said) == bool(said)
    library.warn_if_missing.cache_clear()


@needs_kernel
@pytest.mark.parametrize("name", [name for name, _, _ in build.BUILDS["x86_64"]])
def test_every_build_that_runs_here_gives_the_same_numbers(name: str, tmp_path: Path) -> None:
    if build.here() != "linux-x86_64" or (name == "v3" and not kernel().said.endswith("v3")):
        pytest.skip("this processor does not run it")
    program = (
        "import numpy as np, tests.unit.kernel.test_kernel as here\n"
        "system, home = here.at_home(here.mechanism('race_r1'), 'flexible')\n"
        "print(here.kernel().said)\n"
        "here.agrees(system, home)\n"
    )
    env = {**os.environ, "PINFLEX_KERNEL": name}
    run = subprocess.run([sys.executable, "-c", program], env=env, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == ["linux-x86_64", name]


def test_a_build_without_a_compiler_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "compilers", lambda target: [])
    with pytest.raises(RuntimeError, match="no compiler"):
        build.compile_all(tmp_path, "linux-x86_64")
    with pytest.raises(RuntimeError, match="no build for plan9-vax"):
        build.compile_all(tmp_path, "plan9-vax")
