"""The equations of motion of every shipped model, against differences and against Pinocchio.

Claims:
    Equations
    - columns of X' crba X = differences of the residual | Pinocchio | 1e-9 | passes
    - X, Xdot; J, gamma; tangent M, C, K | central differences, extrapolated | 1e-8 of a column |
      passes
    - Newton's matrix = weighted sum of the tangents | - | 1e-11 | passes
    - power of all forces = rate of all energies | - | 1e-8 | passes
    - no flexible link: the torques are Pinocchio's rnea (ur5, panda) | Pinocchio | 0 (rigid), 1e-12
      (other levels) | 0
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model.system import System
from tests.every_model import NAMES, WHICH, at_home, manifold, mechanism
from tests.finite import by_configuration, by_speed, by_time, by_vector, close, random_state

# The differences are good to about 1e-10 of a column's largest entry; the smallest term that could
# be missing is 1e-3 of it.
DIFFERENCES = 1e-8
ROUNDING = 1e-11  # of sums of a few hundred terms
SEEDS = (1, 2)


def _bare(system: System) -> System:
    """Without the beams' own stiffness, beside which all else drowns; it is linear and constant."""
    return replace(system, K=np.zeros_like(system.K))


@pytest.fixture(scope="session")
def free_robot(tmp_path_factory: pytest.TempPathFactory) -> pf.Mechanism:
    return manifold(tmp_path_factory.mktemp("manifold"))


@pytest.fixture(params=[f"{name}-{which}" for name in (*NAMES, "manifold") for which in WHICH])
def case(request: pytest.FixtureRequest) -> tuple[System, Array]:
    """A system and its undeformed home."""
    name, which = request.param.rsplit("-", 1)
    robot = request.getfixturevalue("free_robot") if name == "manifold" else mechanism(name)
    return at_home(robot, which)


@pytest.mark.parametrize("seed", SEEDS)
def test_columns_of_crba_are_columns_of_rnea(case: tuple[System, Array], seed: int) -> None:
    system, home = case
    y, v, a, lam = random_state(system, home, seed)
    d = Equations(_bare(system))
    base = d.residual(y, v, np.zeros_like(a), lam, 0.0).r
    columns = [d.residual(y, v, e, lam, 0.0).r - base for e in np.eye(system.nv)]
    if columns:
        M = d.mass(y)
        close(np.array(columns).T, M, ROUNDING * 1e2)  # differences of forces far larger than M
        np.testing.assert_allclose(M, M.T, atol=ROUNDING * np.abs(M).max())
        assert np.linalg.eigvalsh(M).min() > -ROUNDING * np.abs(M).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_the_coordinate_map_has_X_for_derivative(case: tuple[System, Array], seed: int) -> None:
    system, home = case
    y, v, a, _ = random_state(system, home, seed)
    d, model = Equations(system), system.expansion.model

    def expanded(y: Array) -> Array:
        return np.array(d.at(y).Q[0])

    centre = expanded(y)
    X = by_configuration(d, lambda y: pin.difference(model, centre, expanded(y)), y)
    if system.nv:
        close(d.at(y).times_map(np.eye(model.nv)), X, DIFFERENCES)

    def velocity(y: Array, v: Array) -> Array:
        return np.array(d.at(y, v, np.zeros_like(v)).V[0])

    rate = by_time(d, velocity, y, v, a)
    A = d.at(y, v, a).A[0]
    np.testing.assert_allclose(A, rate, atol=DIFFERENCES)  # of order one


@pytest.mark.parametrize("seed", SEEDS)
def test_the_closures_have_J_and_gamma_for_derivatives(
    case: tuple[System, Array], seed: int
) -> None:
    system, home = case
    if not system.closed.n:
        pytest.skip("no loops")
    y, v, a, _ = random_state(system, home, seed)
    d = Equations(system)
    J = by_configuration(d, lambda y: d.close(y).c, y)
    close(d.close(y).J, J, DIFFERENCES)
    rate = by_time(d, lambda y, v: d.close(y).J @ v, y, v, a)
    gamma = d.closure_bias(y, v)
    np.testing.assert_allclose(d.close(y).J @ a + gamma, rate, atol=DIFFERENCES)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_tangent_is_the_derivative_of_the_residual(
    case: tuple[System, Array], seed: int
) -> None:
    system, home = case
    if not system.nv:
        pytest.skip("nothing moves")
    bare = _bare(system)
    y, v, a, lam = random_state(system, home, seed)
    d = Equations(bare)
    M, C, K, _ = d.tangent(y, v, a, lam, 0.0)
    close(M, by_vector(lambda a: d.residual(y, v, a, lam, 0.0).r, a), DIFFERENCES)
    by_rates = by_speed if system.friction.present else by_vector
    close(C, by_rates(lambda v: d.residual(y, v, a, lam, 0.0).r, v), DIFFERENCES)
    close(K, by_configuration(d, lambda y: d.residual(y, v, a, lam, 0.0).r, y), DIFFERENCES)
    stiff = Equations(system)
    np.testing.assert_allclose(
        stiff.tangent(y, v, a, lam, 0.0).K,
        K + system.K,
        atol=ROUNDING * np.abs(K + system.K).max(),
    )
    elastic = system.K[:, int(system.rigid.nv) :] @ y[int(system.rigid.nq) :]
    difference = stiff.residual(y, v, a, lam, 0.0).r - d.residual(y, v, a, lam, 0.0).r
    np.testing.assert_allclose(
        difference, elastic, atol=ROUNDING * max(1.0, np.abs(elastic).max(initial=0.0))
    )


def test_newtons_matrix_is_the_weighted_sum_of_the_tangents(case: tuple[System, Array]) -> None:
    system, home = case
    if not system.nv:
        pytest.skip("nothing moves")
    y, v, a, lam = random_state(system, home, 5)
    d = Equations(system)
    weights = (0.7, 3e-2, 1e-3)
    expected = sum(
        w * part for w, part in zip(weights, d.tangent(y, v, a, lam, 0.0)[:3], strict=True)
    )
    found = d.iteration_matrix(y, v, a, lam, 0.0, weights, rates=True)[0]
    close(found, np.asarray(expected), ROUNDING)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_power_of_all_forces_is_the_rate_of_all_energies(
    case: tuple[System, Array], seed: int
) -> None:
    system, home = case
    y, v, a, lam = random_state(system, home, seed)
    d = Equations(system)
    rate = by_time(d, lambda y, v: np.array([sum(d.energies(y, v, 0.0))]), y, v, a)[0]
    r = d.residual(y, v, a, lam, 0.0).r
    J = d.close(y).J
    power = v @ (r + J.T @ lam) - system.dissipation(v)
    size = max(1.0, np.abs(v * r).sum())
    assert power == pytest.approx(rate, abs=DIFFERENCES * size)


@pytest.mark.parametrize("name", [*NAMES, "manifold"])
def test_undeformed_links_weigh_and_pull_as_the_rigid_mechanism(
    name: str, request: pytest.FixtureRequest
) -> None:
    m = request.getfixturevalue("free_robot") if name == "manifold" else mechanism(name)
    n = int(m.rigid.rigid.nv)
    if not n:
        pytest.skip("nothing moves rigidly")
    q, v, a, _ = random_state(m.rigid, m.home, 3)
    rigid, flexible = Equations(m.rigid), Equations(m.flexible)
    still = np.zeros(m.flexible.n_eta)
    y = np.concatenate([q, still])
    expected = rigid.residual(q, v, a, np.zeros(m.rigid.closed.n), 0.0).r
    found = flexible.residual(
        y,
        np.concatenate([v, still]),
        np.concatenate([a, still]),
        np.zeros(m.flexible.closed.n),
        0.0,
    ).r
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found[:n], expected, atol=ROUNDING * scale)
    M = rigid.mass(q)
    np.testing.assert_allclose(flexible.mass(y)[:n, :n], M, atol=ROUNDING * np.abs(M).max())


@pytest.mark.parametrize("name", ["3rrr", "race_r1", "spinning_beam", "ur5"])
def test_slender_beams_weigh_what_the_urdf_says(name: str) -> None:
    """Pinocchio's own model of the URDF, against the beams that replace its links."""
    m = mechanism(name)
    d = m.description
    model = pin.buildModelFromXML(d.urdf_text)
    for joint, extra in d.joints.items():
        model.armature[model.joints[model.getJointId(joint)].idx_v] = extra.rotor_inertia
    M = pin.crba(model, model.createData(), m.home)
    ours = Equations(m.rigid).mass(m.home)
    # The ur5 keeps the URDF's inertia; the other URDFs have rods, written to nine digits.
    tolerance = 1e-12 if name == "ur5" else 1e-8
    np.testing.assert_allclose(np.diag(ours), np.diag(M), rtol=tolerance)


def _loaded(name: str, folder: Path) -> pf.Mechanism:
    path = folder / f"{name}.yaml"
    path.write_text(f"urdf: example-robot-data:{name}\nuse_urdf_dynamics: false\n")
    return pf.load(path)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_robot_without_flexible_links_is_pinocchio_to_the_last_bit(
    name: str, tmp_path: Path
) -> None:
    m = _loaded(name, tmp_path)
    assert m.flexible is m.rigid
    model = pin.buildModelFromXML(m.description.urdf_text)
    data = model.createData()
    rng = np.random.default_rng(4)
    lower = np.maximum(model.lowerPositionLimit, -3.0)
    upper = np.minimum(model.upperPositionLimit, 3.0)
    q = rng.uniform(lower, upper, (20, model.nq))
    v, a = rng.uniform(-2, 2, (2, 20, model.nv))
    expected = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    np.testing.assert_array_equal(pf.inverse_dynamics(m, q, v, a), expected)
    d = Equations(m.rigid)
    apart = np.zeros(m.rigid.closed.n)  # no force between panda's fingers
    found = [d.residual(*row, apart, 0.0).r for row in zip(q, v, a, strict=True)]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_every_level_of_a_robot_without_flexible_links_gives_pinocchios_torques(
    name: str, tmp_path: Path
) -> None:
    m = _loaded(name, tmp_path)
    joints = {motor: 0.2 * (-1) ** k for k, motor in enumerate(m.motors[:4])}
    motion = pf.cycloid(joints=joints, duration=0.5)
    model = m.rigid.rigid
    data = model.createData()
    driven = np.eye(model.nv)[:, m.rigid.motors]
    if name == "panda":  # one motor moves both fingers
        driven[m.coordinates.index("panda_finger_joint2"), -1] = 1.0
    for level in pf.LEVELS:
        r = pf.solve(m, motion, level=level, dt=5e-3, samples=51)
        j = r.arrays
        expected = [
            pin.rnea(model, data, *row) @ driven
            for row in zip(j["joint/q"], j["joint/v"], j["joint/a"], strict=True)
        ]
        # The motors prescribe everything, so no step error is left: rigid is the same call, the
        # others solve an empty system around it.
        tolerance = 0.0 if level == "rigid" else 1e-12
        np.testing.assert_allclose(
            r.torque, expected, rtol=0, atol=tolerance * np.abs(expected).max()
        )


def test_what_cannot_move_has_empty_matrices() -> None:
    system = mechanism("cantilever").rigid
    none, still = np.zeros(0), np.zeros((3, 0))
    d = Equations(system)
    assert [part.shape for part in d.tangent(none, none, none, none, 0.0)] == [(0, 0)] * 4
    assert d.residual(still, still, still, still, 0.0).r.shape == (3, 0)
