"""What no robot may break, on robots nobody chose: symmetry, frames, units, order, time.

Claims:
    Invariances, a second opinion, workspaces
    - mass symmetric and positive; T = v' M v / 2; power of all forces = rate of all energies | - |
      1e-13; 1e-12; 1e-7 | passes
    - place and heading of the robot, mirror: the same forces | - | 1e-11 | passes
    - order of links in the file, of loops; units (in scenes that `allow` any size) | - | 1e-10;
      1e-10 rad; 1e-9 | passes
    - a swing run backwards comes back | trapezoidal rule | 1e-6 of its size | passes
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import pinflex as pf
from pinflex.arrays import Array
from pinflex.lab.loops import four_bars
from pinflex.mechanics.evaluation.equations import Equations
from tests import finite
from tests.property.trees import Recipe, mirrored, moved, renumbered, tree

SEEDS = st.integers(0, 2**31)
FEW = settings(
    max_examples=12, deadline=None, derandomize=True, database=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
FEWER = settings(FEW, max_examples=6)


def forces(m: pf.Mechanism, y: Array, v: Array, a: Array) -> Array:
    return np.asarray(
        Equations(m.flexible).residual(y, v, a, np.zeros(m.flexible.closed.n), 0.0).r, dtype=float
    )


def relative(found: Array, expected: Array) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@FEW
@given(SEEDS)
def test_mass_is_symmetric_and_positive_definite(seed: int) -> None:
    m = tree(seed).build()
    y, _, _, _ = finite.random_state(m.flexible, m.undeformed(), seed)
    M = Equations(m.flexible).mass(y)
    scale = 1 / np.sqrt(np.diag(M))
    M = M * scale * scale[:, None]
    assert np.abs(M - M.T).max() < 1e-13
    assert np.linalg.eigvalsh(M)[0] > 1e-12


@FEW
@given(SEEDS)
def test_kinetic_energy_is_that_of_the_mass_matrix_and_power_balances(seed: int) -> None:
    """dE/dt = v . r along any motion: inertia, gravity and stiffness are one mechanism."""
    m = tree(seed).build()
    d = Equations(m.flexible)
    y, v, a, lam = finite.random_state(m.flexible, m.undeformed(), seed)
    assert d.energies(y, v, 0.0)[0] == pytest.approx(0.5 * v @ d.mass(y) @ v, rel=1e-12)
    rate = finite.by_time(d, lambda y, v: np.array([sum(d.energies(y, v, 0.0))]), y, v, a)[0]
    power = np.abs(v * d.residual(y, v, a, lam, 0.0).r).sum()
    assert abs(rate - v @ d.residual(y, v, a, lam, 0.0).r) < 1e-7 * power


@FEWER
@given(SEEDS)
@example(2001)
def test_the_tangent_is_the_derivative_of_the_residual(seed: int) -> None:
    """Differences are of all but K eta, of 1e8 N m, whose rounding alone is 4e-6 of a column."""
    m = tree(seed).build()
    K = m.flexible.K
    d = Equations(replace(m.flexible, K=0.0 * K))
    y, v, a, lam = finite.random_state(m.flexible, m.undeformed(), seed)
    own = d.tangent(y, v, a, lam, 0.0)
    whole = Equations(m.flexible).tangent(y, v, a, lam, 0.0)
    for mine, theirs, more in zip(own[:3], whole[:3], (0.0, 0.0, K), strict=True):
        np.testing.assert_allclose(theirs, mine + more, atol=1e-14 * np.abs(theirs).max())
    finite.close(own[0], finite.by_vector(lambda x: d.residual(y, v, x, lam, 0.0).r, a), 2e-6)
    finite.close(own[1], finite.by_vector(lambda x: d.residual(y, x, a, lam, 0.0).r, v), 2e-6)
    by_place = finite.by_configuration(d, lambda x: d.residual(x, v, a, lam, 0.0).r, y)
    finite.close(own[2], by_place, 1e-6)


@FEW
@given(SEEDS)
def test_where_the_robot_stands_changes_nothing(seed: int) -> None:
    recipe = tree(seed)
    here = recipe.build()
    rng = np.random.default_rng(seed)
    there = moved(
        recipe, Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3)
    ).build()
    y, v, a, _ = finite.random_state(here.flexible, here.undeformed(), seed)
    assert relative(forces(there, y, v, a), forces(here, y, v, a)) < 1e-11


@FEW
@given(
    SEEDS, st.sampled_from([(1e3, 1.0, 1.0), (1.0, 1e3, 1.0), (1.0, 1.0, 1e3), (39.37, 2.2, 60)])
)
def test_units_change_numbers_and_nothing_else(seed: int, scale: tuple[float, ...]) -> None:
    """Metres to millimetres, kilograms to grams, seconds to milliseconds, and odd ones."""
    meter, kilogram, second = scale
    one, other = tree(seed).build(), tree(seed, scale=scale).build()
    f, g = (pf.modes(m, preload="none").frequencies for m in (one, other))
    top = np.abs(f).max()
    np.testing.assert_allclose(g * second, f, rtol=1e-7, atol=1e-6 * top)
    n = int(one.rigid.nv)
    q = one.home[: one.rigid.nq]
    tau, scaled = (forces(m, m.undeformed(), np.zeros(m.flexible.nv), np.zeros(m.flexible.nv))[:n]
                   for m in (one, other))  # fmt: skip
    joule = kilogram * meter**2 / second**2
    slides = [j.shortname().startswith("JointModelP") for j in one.rigid.rigid.joints[1:]]
    unit = np.where(slides, joule / meter, joule)
    np.testing.assert_allclose(scaled / unit, tau, rtol=1e-9, atol=1e-9 * np.abs(tau).max())
    assert len(q) == n


@FEW
@given(SEEDS)
def test_the_order_of_links_in_the_file_changes_nothing(seed: int) -> None:
    recipe = tree(seed)
    one, other = recipe.build(), renumbered(recipe, seed).build()
    f, g = (pf.modes(m, preload="none").frequencies for m in (one, other))
    np.testing.assert_allclose(g, f, rtol=1e-7, atol=1e-6 * np.abs(f).max())
    for name, q in zip(one.coordinates, one.home, strict=True):
        assert other.home[other.coordinates.index(name)] == q
    tau = {}
    for m in (one, other):
        still = np.zeros(m.flexible.nv)
        tau[id(m)] = dict(zip(m.coordinates, forces(m, m.undeformed(), still, still), strict=False))
    size = max(abs(x) for x in tau[id(one)].values())
    assert all(abs(tau[id(other)][n] - x) < 1e-10 * size for n, x in tau[id(one)].items())


@FEWER
@given(st.permutations(["pin_0", "pin_1"]))
def test_the_order_of_loops_changes_nothing(order: list[str]) -> None:
    m = four_bars(2)
    v = np.array([-1.0 if name.startswith("crank") else 1.0 for name in m.coordinates])
    loops = {p.name: p for p in m.description.loops}
    other = pf.load(m.description.replace(loops=tuple(loops[n] for n in order)))
    y = m.undeformed()
    for robot in (m, other):
        d = Equations(robot.flexible)
        c, J = d.close(y)
        assert robot.report.mobility == 1
        assert np.abs(c).max() < 1e-12
        assert np.abs(J @ v).max() < 1e-12
    a, b = (pf.solve(x, pf.hold(duration=0.2), level="coupled", dt=1e-3) for x in (m, other))
    np.testing.assert_allclose(a.arrays["joint/q"], b.arrays["joint/q"], atol=1e-10)
    for name in order:
        np.testing.assert_allclose(a.loop(name).wrench, b.loop(name).wrench, atol=1e-6)


@FEW
@given(SEEDS)
def test_a_mirrored_robot_has_mirrored_forces(seed: int) -> None:
    """y -> -y turns every angle and every sideways deflection round, stretch stays."""
    recipe = tree(seed, planar=True)
    one, other = recipe.build(), mirrored(recipe).build()
    y, v, a, _ = finite.random_state(one.flexible, one.undeformed(), seed)
    sign = np.ones(one.flexible.nv)
    n = int(one.rigid.nv)
    sign[:n] = -1.0
    for slot in one.flexible.expansion.slots:
        eta = sign[n + slot.eta.start : n + slot.eta.stop]
        if "v" in slot.body.slices:
            eta[slot.body.slices["v"]] = -1.0
    assert (
        relative(sign * forces(other, sign * y, sign * v, sign * a), forces(one, y, v, a)) < 1e-11
    )


def swing(m: pf.Mechanism, y: Array, v: Array, until: float, h: float) -> tuple[Array, Array]:
    run = pf.solve(m, pf.hold(duration=until), "coupled", start=(y, v), dt=h, samples=2,
                   integrator="newmark", tolerance=1e-10)  # fmt: skip
    return (np.append(run.array("joint/q")[-1], run.array("eta")[-1]),
            np.append(run.array("joint/v")[-1], run.array("eta_v")[-1]))  # fmt: skip


def released(recipe: Recipe) -> pf.Mechanism:
    m = recipe.build()
    return pf.load(m.description.replace(actuated=()))


@FEWER
@given(SEEDS)
def test_a_swing_run_backwards_comes_back(seed: int) -> None:
    """The trapezoidal rule is its own reverse: only Newton's tolerance is lost."""
    m = released(tree(seed))
    y, v = m.undeformed(), np.zeros(m.flexible.nv)
    n = int(m.rigid.nv)
    v[:n] = 0.2 * np.random.default_rng(seed).uniform(-1, 1, n)
    y1, v1 = swing(m, y, v, 0.05, 2e-4)
    y0, v0 = swing(m, y1, -v1, 0.05, 2e-4)
    assert np.abs(y1 - y).max() > 1e-4  # it did move
    np.testing.assert_allclose(y0, y, atol=1e-6 * np.abs(y1 - y).max())
    np.testing.assert_allclose(-v0, v, atol=1e-4 * np.abs(v1).max())
