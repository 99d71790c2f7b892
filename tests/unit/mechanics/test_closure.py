"""Loop closures of every kind on a small spatial loop: what they hold, and their derivatives.

Claims:
    Equations
    - closures: 6 5 5 4 4 3 2 1 rows by kind, exactly the joint's motions left free | screw of each
      joint | 1e-10 | passes
    - their J, gamma and force tangent, default and oblique axes | central differences | 1e-8 |
      passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import skew
from pinflex.mechanics.model.loads import DISTANCE
from tests.finite import by_configuration, by_time, by_vector, close
from tests.scenes import Body, load

DIFFERENCES = 1e-8  # as in test_dynamics
ROUNDING = 1e-10  # of a rank decision: what is zero here is 1e-15, what is not is above 1e-2
KINDS = {
    "weld": 6,
    "revolute": 5,
    "prismatic": 5,
    "cylindrical": 4,
    "universal": 4,
    "spherical": 3,
    "planar": 2,
    "distance": 1,
}
OBLIQUE = "[2, -1, 3]"

# Two arms on one base; 7 + 3 skew axes, so that no closure is dependent by chance.
ROD_X = {"mass": 1.0, "com": (0.1, 0, 0), "inertia": (0.01, 0.02, 0.02)}
ROD_Z = {"mass": 1.0, "com": (0, 0, 0.1), "inertia": (0.02, 0.02, 0.01)}
LUMP = {"mass": 0.5, "com": (0.05, 0.1, 0), "inertia": (0.01, 0.01, 0.01)}
ARMS = (
    Body("a1", "base", "revolute", xyz=(0, 0, 0.1), axis=(0, 0, 1), **ROD_X),
    Body("a2", "a1", "revolute", xyz=(0.3, 0, 0.1), axis=(0, 1, 0), **ROD_X),
    Body("a3", "a2", "revolute", xyz=(0.3, 0.1, 0), axis=(1, 0, 0), **ROD_X),
    Body("a4", "a3", "prismatic", xyz=(0.1, 0, 0.1), axis=(0.6, 0, 0.8), **LUMP),
    Body("a5", "a4", "revolute", xyz=(0.1, 0.1, 0), axis=(0, 0.6, 0.8), **LUMP),
    Body("a6", "a5", "continuous", xyz=(0.2, 0, 0), axis=(0, 1, 0), **LUMP),
    Body("a7", "a6", "revolute", xyz=(0.1, 0, 0), axis=(1, 0, 0), **LUMP),
    Body("hook", "a7", xyz=(0.1, 0.05, -0.02), rpy=(0.2, -0.3, 0.4)),
    Body("b1", "base", "revolute", xyz=(0.8, 0.3, 0), axis=(0, 1, 0), **ROD_Z),
    Body("b2", "b1", "revolute", xyz=(0, 0, 0.3), axis=(1, 0, 0), **ROD_Z),
    Body("b3", "b2", "prismatic", xyz=(0, 0, 0.2), axis=(0, 0, 1), **LUMP),
    Body("eye", "b3", xyz=(0.02, 0.03, 0.1), rpy=(-0.1, 0.25, 0.3)),
)


def loop(folder: Path, kind: str, extra: str = "") -> pf.Mechanism:
    yaml = f"actuated: []\nloops: {{ring: {{kind: {kind}, between: [hook, eye]{extra}}}}}\n"
    return load(folder, ARMS, yaml)


def spots(d: Equations, m: pf.Mechanism, y: Array) -> tuple[pin.SE3, pin.SE3]:
    """World poses of both frames, by Pinocchio alone."""
    pin.forwardKinematics(d.model, d.data, y)
    a, b = (m.rigid.expansion.frames[name] for name in ("hook", "eye"))
    return d.data.oMi[a.joint] * a.placement, d.data.oMi[b.joint] * b.placement


def relative_twists(d: Equations, m: pf.Mechanism, y: Array) -> Array:
    """Twist of b against a at the point of b, on the axes of a, per joint: shape (6, nv)."""
    A, B = spots(d, m, y)
    pin.computeJointJacobians(d.model, d.data, y)
    J = []
    for name in ("hook", "eye"):
        joint = m.rigid.expansion.frames[name].joint
        J.append(pin.getJointJacobian(d.model, d.data, joint, pin.ReferenceFrame.WORLD))
    W = J[1] - J[0]
    point = W[:3] - skew(B.translation[None])[0] @ W[3:]
    R = A.rotation.T
    return np.vstack([R @ point, R @ W[3:]])


@pytest.mark.parametrize("axis", ["default", "oblique"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_derivatives_of_a_closure_are_exact(kind: str, axis: str, tmp_path: Path) -> None:
    turns = kind in ("revolute", "prismatic", "cylindrical", "universal", "planar")
    if axis == "oblique" and not turns:
        pytest.skip("it has no axis")
    extra = f", axis: {OBLIQUE}" if axis == "oblique" else ""
    extra += ", axis_b: [0, 1, -1]" if kind == "universal" and extra else ""
    m = loop(tmp_path, kind, extra)
    d, rng = Equations(m.rigid), np.random.default_rng(5)
    n = m.rigid.nv
    for _ in range(3):
        y = d.integrate(m.home, rng.uniform(-0.4, 0.4, n))  # away from closed: more than needed
        v, a, lam = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), rng.uniform(-9, 9, KINDS[kind])
        check_derivatives(d, y, v, a, lam)


def check_derivatives(d: Equations, y: Array, v: Array, a: Array, lam: Array) -> None:
    close(d.close(y)[1], by_configuration(d, lambda y: d.close(y)[0].copy(), y), DIFFERENCES)
    rate = by_time(d, lambda y, v: d.close(y)[1] @ v, y, v, a)
    np.testing.assert_allclose(d.closure_bias(y, v) + d.close(y)[1] @ a, rate, atol=DIFFERENCES)
    M, C, K, _ = d.tangent(y, v, a, lam, 0.0)
    close(K, by_configuration(d, lambda y: d.residual(y, v, a, lam, 0.0).r, y), DIFFERENCES)
    close(C, by_vector(lambda v: d.residual(y, v, a, lam, 0.0).r, v), DIFFERENCES)
    close(M, by_vector(lambda a: d.residual(y, v, a, lam, 0.0).r, a), DIFFERENCES)


@pytest.mark.parametrize(("kind", "rank"), KINDS.items())
def test_a_closure_takes_as_many_freedoms_as_documented(
    kind: str, rank: int, tmp_path: Path
) -> None:
    m = loop(tmp_path, kind)
    assert (m.report.rows, m.report.rank, m.report.redundant) == (rank, rank, ())
    assert m.report.mobility == m.rigid.nv - rank
    d = Equations(m.rigid)
    c, J = d.close(m.home)
    assert np.abs(c).max() < 1e-12  # the package's own limit of a closed pose [m or rad]
    assert np.linalg.matrix_rank(J) == rank


def allowed(kind: str, A: pin.SE3, B: pin.SE3, z: Array, x_b: Array) -> Array:
    """Basis of the relative twists (on the axes of a) that a joint of this kind leaves, (6, k)."""
    e = np.eye(3)
    move, turn = lambda n: np.append(n, 0 * n), lambda n: np.append(0 * n, n)
    towards = A.rotation.T @ (B.translation - A.translation)
    basis = {
        "weld": [],
        "revolute": [turn(z)],
        "prismatic": [move(z)],
        "cylindrical": [turn(z), move(z)],
        "universal": [turn(z), turn(A.rotation.T @ B.rotation @ x_b)],
        "spherical": [turn(n) for n in e],
        "planar": [move(z), *(turn(n) for n in e)],
        "distance": [
            *(turn(n) for n in e),
            *(move(n) for n in np.linalg.svd(towards[None])[2][1:]),
        ],
    }
    return np.array(basis[kind]).reshape(-1, 6).T


@pytest.mark.parametrize("kind", KINDS)
def test_a_closure_leaves_exactly_the_motions_of_its_joint(kind: str, tmp_path: Path) -> None:
    turns = kind in ("revolute", "prismatic", "cylindrical", "universal", "planar")
    extra = f", axis: {OBLIQUE}" if turns else ""
    extra += ", axis_b: [0, 1, -1]" if kind == "universal" else ""
    m = loop(tmp_path, kind, extra)
    d = Equations(m.rigid)
    A, B = spots(d, m, m.home)
    z = np.array([2.0, -1.0, 3.0]) / np.sqrt(14.0)
    free = allowed(kind, A, B, z, np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0))
    _, J = d.close(m.home)
    J = J.copy()
    twists = relative_twists(d, m, m.home)
    # Motions of the tree that the closure allows move b against a in the joint's way only ...
    null = np.linalg.svd(J)[2][KINDS[kind] :].T
    seen = twists @ null
    outside = seen - free @ np.linalg.lstsq(free, seen, rcond=None)[0] if free.size else seen
    assert np.abs(outside).max() < ROUNDING
    # ... and in all of it.
    assert np.linalg.matrix_rank(seen, tol=1e-6) == free.shape[1]


def test_a_closed_pose_looks_as_its_name_says(tmp_path: Path) -> None:
    for kind in KINDS:
        m = loop(tmp_path, kind)
        A, B = spots(Equations(m.rigid), m, m.home)
        gap = A.rotation.T @ (B.translation - A.translation)
        turn = A.rotation.T @ B.rotation
        if kind in ("weld", "revolute", "universal", "spherical"):
            np.testing.assert_allclose(gap, 0, atol=1e-11)
        if kind in ("prismatic", "cylindrical", "planar"):
            np.testing.assert_allclose(gap[:2], 0, atol=1e-11)
        if kind in ("weld", "prismatic"):
            np.testing.assert_allclose(turn, np.eye(3), atol=1e-11)
        if kind in ("revolute", "cylindrical"):
            np.testing.assert_allclose(np.abs(turn[2, 2]), 1.0, atol=1e-11)
        if kind == "universal":
            assert turn[2, 0] == pytest.approx(0.0, abs=1e-11)


def test_a_distance_is_kept_at_its_home_value_or_the_given_one(tmp_path: Path) -> None:
    m = loop(tmp_path, "distance")
    A, B = spots(Equations(m.rigid), m, pin.neutral(m.rigid.rigid))
    home = np.linalg.norm(B.translation - A.translation)
    closed = m.rigid.closed
    assert closed.lengths[closed.of(DISTANCE)] == pytest.approx(home, rel=1e-12)
    given = loop(tmp_path, "distance", ", length: 0.5")
    A, B = spots(Equations(given.rigid), given, given.home)
    assert np.linalg.norm(B.translation - A.translation) == pytest.approx(0.5, rel=1e-12)


def test_a_closure_force_pulls_both_bodies_with_equal_and_opposite_wrenches(
    tmp_path: Path,
) -> None:
    """J' lam of a loop on a free-flying base cannot push the base: internal forces have no sum."""
    yaml = "base: free_flyer\nactuated: []\nloops: {ring: {kind: KIND, between: [hook, eye]}}\n"
    heavy = Body("ballast", "base", mass=1.0, inertia=(1, 1, 1))
    for kind, rows in KINDS.items():
        m = load(tmp_path, (heavy, *ARMS), yaml.replace("KIND", kind))
        _, J = Equations(m.rigid).close(m.home)
        assert J.shape == (rows, m.rigid.nv)
        np.testing.assert_allclose(J[:, :6], 0.0, atol=1e-12)
