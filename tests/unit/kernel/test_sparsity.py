"""Newton's equations of a collocation step, whatever is zero in them.

Claims:
    Equations
    - Newton's equations of a step, arms side by side, full, a massless coordinate | the equations
      of all stages, by numpy | 1e-13 of the largest term | 3e-15
    - two long branches behind a long link, eliminated block by block | the same | 1e-12 of the
      largest term | 5e-14
    - torques of such a tree with elbows | the run by full matrices | 1e-11 | 1e-15
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.integrators.collocation import radau
from pinflex.integrators.compiled import StageKernel
from pinflex.kernel.library import constant, kernel
from pinflex.lab.scene import Body, scene
from pinflex.mechanics.evaluation import kernel_tables
from pinflex.mechanics.evaluation.compiled import Compiled
from pinflex.mechanics.manifold import sorts_of

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)

H, STAGES = 0.1, 5  # two pairs of eigenvalues and a real one


def linked(kind: str, n: int, rows: int) -> tuple[Array, Array]:
    """Entries of M, C and K, and of J: of three arms on a shared body, or all."""
    square, across = np.zeros((n, n), bool), np.zeros((rows, n), bool)
    if kind == "full":
        return ~square, ~across
    arm = np.arange(n) * 3 // (n - 6)  # the last six belong to the body
    square[:] = arm[:, None] == arm
    square[-6:] = square[:, -6:] = True
    across[np.arange(rows)[:, None] * 3 // rows == arm] = True
    across[:, -6:] = True
    if kind == "crossed":  # an entry far away, as a spring between arms has it
        square[1, n // 2] = square[n // 2, 1] = True
    return square, across


@pytest.mark.parametrize("kind", ["arms", "crossed", "full", "massless"])
def test_all_stages_are_solved_as_by_the_whole_matrix(kind: str) -> None:
    """Also where a coordinate has neither mass nor stiffness: no pivot of its own serves."""
    system = pf.load("delta").flexible
    m, none, free = radau(STAGES), np.zeros(0, dtype=np.intp), system.free
    stages = StageKernel(
        Compiled(system),
        m,
        False,
        {"free_at": free, "motor_v": none} | sorts_of(system.rigid),
    )
    x, n, rows = stages.arrays, len(free), system.closed.n
    rng = np.random.default_rng(1)
    for again in (kind, "full", kind):  # what is known of one pattern serves no other
        square, across = linked(again, n, rows)
        for name in "MCK":
            A = rng.normal(size=(n, n)) * square
            x[name][...] = A @ A.T * square + n * np.eye(n)
        x["C"][...] += 0.1 * rng.normal(size=(n, n)) * square  # friction is not symmetric
        x["J"][...] = rng.normal(size=(rows, n)) * across
        if again == "massless":
            for name in "MCK":
                x[name][3] = x[name][:, 3] = 0.0
        r, gap = rng.normal(size=(STAGES, n)), rng.normal(size=(STAGES, rows))
        x["r"][:, free], x["open"][...] = r, gap
        stages.at.h = H
        assert stages.functions.pinflex_factor(stages.tables, stages.address)
        stages.functions.pinflex_solve(stages.tables, stages.address)
        dz, dlam = x["change"][:, free], x["dlam"]
        # A^-2 M dz + h A^-1 C dz + h^2 K dz - J' dlam = -r, J dz = -c / h^2, stage by stage
        inverse = np.linalg.inv(m.A)
        first = inverse @ inverse @ dz @ x["M"].T
        left = first + H * inverse @ dz @ x["C"].T + H**2 * dz @ x["K"].T - dlam @ x["J"]
        # round-off of the largest term, and of a hundred that are summed up
        assert left == pytest.approx(-r, abs=1e-13 * np.abs(first).max())
        assert dz @ x["J"].T == pytest.approx(-gap / H**2, abs=1e-12 / H**2)


LINK = """
  {name}:
    material: {{E: 7.0e10, nu: 0.3, rho: 2700}}
    section: {{shape: rectangle, width: 0.02, thickness: 0.004}}
    segments: {segments}
    basis: {{kind: craig_bampton, internal: 0}}
"""


def branched(segments: int) -> pf.Mechanism:
    """A link with an elbow at its end, to which two links are fixed by elbows of their own."""
    bodies, names = [], ("arm", "left", "right")
    for name, parent, x in (("arm", "base", 0.0), ("left", "arm", 0.5), ("right", "arm", 0.5)):
        bodies.append(Body(name, parent, "revolute", (x, 0, 0), axis=(0, 0.6, 0.8)))
        if name != "arm":
            bodies.append(Body(f"{name}_tip", name, xyz=(0.4, 0.1, 0), mass=0.1))
    links = "".join(LINK.format(name=name, segments=segments) for name in names)
    moves = ", ".join(f"{name}_joint: 0.3" for name in names)
    motion = f"motion: {{kind: cycloid, joints: {{{moves}}}, duration: 0.2}}\n"
    yaml = f"flexible:{links}damping: {{rayleigh: [0, 1.0e-4]}}\n{motion}"
    return scene("branched", bodies, yaml, (0, 0, -9.81), ", ".join(f"{n}_joint" for n in names))


@pytest.mark.parametrize("stages", [4, 5])  # pairs of eigenvalues; and a real one
def test_a_tree_is_eliminated_block_by_block(stages: int) -> None:
    """Of a tangent within its blocks, and what these ask of each other."""
    robot = branched(9)
    system, m, none = robot.flexible, radau(stages), np.zeros(0, dtype=np.intp)
    free = np.setdiff1d(system.free, system.motors)
    steps = StageKernel(
        Compiled(system),
        m,
        False,
        {"free_at": free, "motor_v": none} | sorts_of(system.rigid),
    )
    nv, x, of = system.nv, steps.arrays, steps.functions
    assert steps.counts["joined"] > 0
    rng = np.random.default_rng(2)
    y = robot.undeformed() + 1e-3 * rng.normal(size=system.nq)
    v, a = rng.normal(size=(2, nv))
    nothing = np.zeros(0)
    state = [z.ctypes.data for z in (y, v, a, nothing, nothing)]
    found = np.full((2, 3 * nv * nv + steps.counts["joined"]), np.nan)
    for part, wanted in zip(found, ("WITH_RATES", "WITHIN_BLOCKS"), strict=True):
        at = [part.ctypes.data + 8 * nv * nv * k for k in (0, 1, 2, 3)]
        of.pinflex_tangent(steps.tables, steps.work, constant(wanted), *state, *at)
        of.pinflex_joined(steps.tables, steps.work, at[3])
    assert np.array_equal(found[0, 3 * nv * nv :], found[1, 3 * nv * nv :])
    assert np.isnan(found[1]).sum() > nv * nv  # what is outside the blocks was not written
    steps.at.h = H
    r = rng.normal(size=(stages, len(free)))
    x["r"][:, free] = r
    assert of.pinflex_factor_tangent(steps.tables, steps.address, found[1].ctypes.data)
    of.pinflex_solve(steps.tables, steps.address)
    M, C, K = (A[np.ix_(free, free)] for A in found[0, : 3 * nv * nv].reshape(3, nv, nv))
    dz, inverse = x["change"][:, free], np.linalg.inv(m.A)
    terms = inverse @ inverse @ dz @ M.T, H * inverse @ dz @ C.T, H**2 * dz @ K.T
    # Round-off of sums along the whole length, of some 200 terms.
    assert sum(terms) == pytest.approx(-r, abs=1e-12 * max(np.abs(z).max() for z in terms))


def test_a_long_tree_runs_as_by_full_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps, their corrections and the torques of motors."""
    torque = []
    for most in (kernel_tables._LONG, np.inf):
        monkeypatch.setattr(kernel_tables, "_LONG", most)
        robot = branched(9)
        assert (robot.flexible.tables.arrays["joined_at"][-1] > 0) == np.isfinite(most)
        torque.append(pf.solve(robot, level="coupled", until=0.02, tol=1e-3, samples=11).torque)
    # Round-off of their matrices; the last correction of Newton is not looked at closer.
    assert torque[0] == pytest.approx(torque[1], abs=1e-11 * np.abs(torque[1]).max())


@pytest.mark.parametrize("model", ["delta", "ur5", "cassie", "prprp"])
def test_mass_and_closures_alone_are_those_of_the_whole_tangent(model: str) -> None:
    """Starts and holds ask for no more."""
    robot = pf.load(model)
    of, system = Compiled(robot.flexible), robot.flexible
    nv, rows = system.nv, system.closed.n
    rng = np.random.default_rng(3)
    v, a = rng.normal(size=(2, nv))
    scale, lam, y = np.ones(of.tables.counts["forces"]), rng.normal(size=rows), robot.undeformed()
    state = [z.ctypes.data for z in (y, v, a, lam, scale)]
    found = np.zeros((2, 3 * nv * nv + rows * nv))
    for part, wanted in zip(found, ("WITH_RATES", "MASS"), strict=True):
        at = [part.ctypes.data + 8 * nv * nv * k for k in (0, 1, 2, 3)]
        of.functions.pinflex_tangent(of.tables.address, of.work, constant(wanted), *state, *at)
    whole, mass = found
    M = slice(0, nv * nv)
    # The same sums in another order.
    assert mass[M] == pytest.approx(whole[M], abs=1e-14 * np.abs(whole[M]).max())
    assert mass[3 * nv * nv :] == pytest.approx(whole[3 * nv * nv :], abs=1e-14)
    assert not mass[nv * nv : 3 * nv * nv].any()
