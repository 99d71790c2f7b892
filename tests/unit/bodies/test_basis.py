"""Flexible bodies against beam theory: frequencies, statics, masses, damping.

Claims:
    Equations
    - second-order rows of stretch, bendings, twist and shear together = the rod of linear strains,
      integrated | R' = R kappa^, r' = R gamma | 1e-4 | passes
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pinflex.arrays import Array
from pinflex.bodies import family as beam_modes
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.beam import second_order
from pinflex.description.blocks.flexible import BOUNDARIES, Basis, EndMass
from pinflex.description.section import Section
from tests.bar import BAR, CB, CUBIC, QUINTIC, STEEL, L, bending_unit, body, omega


def test_craig_bampton_gives_the_cantilever_frequencies() -> None:
    b = body("vw", Basis(internal=10))
    for d in "vw":
        at = b.slices[d]
        found = np.sqrt(omega(b.K[at, at], b.M[at, at])[:4] / bending_unit(b, d))
        table = (1.87510407, 4.69409113, 7.85475744, 10.99554073)
        np.testing.assert_allclose(found, table, rtol=1e-6)  # the project's own limit
    np.testing.assert_array_equal(b.K[b.slices["v"], b.slices["w"]], 0.0)


@pytest.mark.parametrize("direction", ["u", "p"])
@pytest.mark.parametrize("kind", ["craig_bampton", "assumed"])
def test_axial_and_torsional_frequencies_are_those_of_a_fixed_free_bar(
    direction: str, kind: str
) -> None:
    b = body(direction, Basis(kind, internal=10, modes=3))
    stiffness, inertia = (
        (STEEL.E * BAR.A, STEEL.rho * BAR.A)
        if direction == "u"
        else (STEEL.G * BAR.J, STEEL.rho * BAR.Ip)
    )
    exact = (np.arange(3) + 0.5) * np.pi / L * np.sqrt(stiffness / inertia)
    np.testing.assert_allclose(omega(b.K, b.M)[:3], exact, rtol=1e-6)  # 9 polynomials


def test_craig_bampton_end_shapes_have_the_static_stiffness_of_a_beam() -> None:
    b = body("v")
    assert b.labels == ("v tip", "v slope", "v1", "v2")
    EI = STEEL.E * BAR.Iz
    exact = EI / L**3 * np.array([[12, -6 * L], [-6 * L, 4 * L**2]])
    np.testing.assert_allclose(b.K[:2, :2], exact, rtol=1e-10)  # 12 EI/L^3, slope held
    assert 1 / np.linalg.inv(b.K)[0, 0] == pytest.approx(3 * EI / L**3, rel=1e-10)
    # Internal modes are K-orthogonal to the static shapes and K- and M-orthogonal to each other.
    scale = np.sqrt(np.outer(np.diag(b.K), np.diag(b.K)))
    assert np.abs((b.K / scale)[:2, 2:]).max() < 1e-12
    assert abs((b.K / scale)[2, 3]) < 1e-12
    assert abs(b.M[2, 3]) < 1e-12 * b.M[2, 2]
    # int f^2 dx = L, so the modal mass is that of the beam.
    np.testing.assert_allclose(np.diag(b.M)[2:], b.mass.sum(), rtol=1e-12)
    Phi, _ = b.rows(L)
    np.testing.assert_allclose(Phi[[1, 3]], np.eye(2, 4), atol=1e-12)


def test_internal_modes_approach_the_clamped_clamped_beam() -> None:
    b = body("v", Basis(internal=10))
    found = np.sqrt(omega(b.K[2:, 2:], b.M[2:, 2:])[:3] / bending_unit(b))
    np.testing.assert_allclose(found, beam_modes.roots("clamped_clamped", 3), rtol=1e-6)


@pytest.mark.parametrize(
    ("ratio", "table"),
    [
        (0.1, (1.72274152,)),
        (0.5, (1.41996443,)),
        (1.0, (1.24791741, 4.03113944, 7.13413224)),
        (10.0, (0.73578192,)),
    ],
)
def test_a_tip_mass_lowers_the_frequencies_as_it_should(
    ratio: float, table: tuple[float, ...]
) -> None:
    mass = STEEL.rho * BAR.A * L
    b = body("v", Basis(internal=8))
    tip = b.rows(L)[0][1]
    with_mass = body("v", Basis(internal=8), tip=EndMass(ratio * mass))
    np.testing.assert_allclose(with_mass.M, b.M + ratio * mass * np.outer(tip, tip), atol=1e-14)
    np.testing.assert_array_equal(with_mass.mass, b.mass)  # end masses are no stations
    found = np.sqrt(omega(with_mass.K, with_mass.M)[: len(table)] / bending_unit(b))
    np.testing.assert_allclose(found, table, rtol=1e-7)


def test_end_inertia_acts_on_the_rotation_about_its_own_axis() -> None:
    tip = EndMass(0.0, (1e-3, 2e-3, 3e-3))
    bare, loaded = body("vwp"), body("vwp", tip=tip)
    Phi = bare.rows(L)[0]
    added = sum(J * np.outer(r, r) for J, r in zip((3e-3, 2e-3, 1e-3), Phi[3:], strict=True))
    np.testing.assert_allclose(loaded.M - bare.M, added, atol=1e-15)


@pytest.mark.parametrize(
    ("hub", "table"),
    [(0.1, (2.63892470, 4.79377085, 7.87565294)), (1.0, (2.01000332, 4.70379426, 7.85682355))],
)
def test_stations_carry_the_coupling_with_a_free_hub(hub: float, table: tuple[float, ...]) -> None:
    # The rigid rotation moves station k by x_k: what Pinocchio sees of the beam.
    b = body("v", Basis(internal=8))
    rows = np.column_stack([b.x, b.Phi[:, 1]])
    M = (rows.T * b.mass) @ rows
    M[0, 0] += hub * b.mass.sum() * L**2
    reduced = M[1:, 1:] - np.outer(M[0, 1:], M[0, 1:]) / M[0, 0]
    found = np.sqrt(omega(b.K, reduced)[:3] / bending_unit(b))
    np.testing.assert_allclose(found, table, rtol=1e-7)


@pytest.mark.parametrize("rotary", [False, True])
@pytest.mark.parametrize(
    "basis",
    [CB, QUINTIC, CUBIC, Basis("assumed", boundary="clamped_free", modes=6)],
    ids=["cb", "quintic", "cubic", "assumed"],
)
def test_stations_hold_the_mass_matrix(basis: Basis, rotary: bool) -> None:
    b = body("uvwp", basis, rotary_inertia=rotary)
    assert b.mass.sum() == pytest.approx(STEEL.rho * BAR.A * L, rel=1e-13)
    assert (b.mass @ b.x**2) == pytest.approx(STEEL.rho * BAR.A * L**3 / 3, rel=1e-13)
    M = np.einsum("k,kri,krj->ij", b.mass, b.Phi, b.Phi)
    if rotary:
        assert len(b.xt) == 0
        # inertia is about (x, y, z), the rows are (rz, ry, rx)
        M += np.einsum("kr,kri,krj->ij", b.inertia[:, ::-1], b.Phi_r, b.Phi_r)
    else:
        assert b.inertia is None and b.Phi_r is None and b.G_r is None
        assert b.It.sum() == pytest.approx(STEEL.rho * BAR.Ip * L, rel=1e-13)
        M += (b.Phi_t.T * b.It) @ b.Phi_t
    scale = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    assert np.abs((M - b.M) / scale).max() < 1e-12


@pytest.mark.parametrize("h_over_L", [0.05, 0.2])
def test_shear_and_rotary_inertia_give_a_timoshenko_beam(h_over_L: float) -> None:
    table = {0.05: (3.509027, 21.734580), 0.2: (3.409783, 18.363703)}[h_over_L]
    steel = replace(STEEL, G=STEEL.E / 2.6)
    bar = replace(Section.rectangle(0.02, h_over_L * L), ky=5 / 6)
    both: dict[str, Any] = {"material": steel, "section": bar, "shear": True}
    b = body("v", Basis(internal=8), rotary_inertia=True, **both)
    assert b.n == 10  # the lowest fixed-interface modes only
    unit = np.sqrt(steel.E * bar.Iz / (7800.0 * bar.A)) / L**2
    # 8 internal modes of 18 are kept, and that truncation shows at h/L = 0.2 in mode 2 (1.2e-4);
    # the whole family gives 1e-6 (test_family).
    np.testing.assert_allclose(omega(b.K, b.M)[:2] / unit, table, rtol=2e-4)
    compliance = np.linalg.inv(b.K)[0, 0]
    exact = L**3 / (3 * steel.E * bar.Iz) + L / (5 / 6 * steel.G * bar.A)
    assert compliance == pytest.approx(exact, rel=1e-9)
    assert set(b.fields(b.x)) == {"deflection", "curvature_v", "shear_v"}


def rod(b: FlexibleBody, eta: Array, size: float, count: int = 200) -> Array:
    """Rows (u, v, w, rz, ry, rx) at the tip of a rod with the linear strains of size * eta.

    R' = R kappa^, r' = R (1 + u', gv, gw) by Runge and Kutta's rule of fourth order.
    """
    x = np.linspace(0.0, b.length, 2 * count + 1)
    F = {d: family.evaluate(x) for d, family in b.families.items()}

    def field(d: str, name: str) -> Array:
        return np.asarray(size * getattr(F[d], name) @ eta[b.slices[d]])

    curved = np.stack([field("p", "df"), -field("w", "curv"), field("v", "curv")], axis=1)
    sheared = [field(d, "df") - field(d, "rot") for d in "vw"]
    strained = np.stack([1.0 + field("u", "df"), *sheared], axis=1)

    def slope_at(k: int, T: Array) -> Array:
        x, y, z = curved[k]
        turn = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.column_stack([T[:, :3] @ turn, T[:, :3] @ strained[k]])

    T, h = np.eye(3, 4), b.length / count
    for k in range(0, 2 * count, 2):
        one = slope_at(k, T)
        two = slope_at(k + 1, T + h / 2 * one)
        three = slope_at(k + 1, T + h / 2 * two)
        T = T + h / 6 * (one + 2 * two + 2 * three + slope_at(k + 2, T + h * three))
    R, r = T[:, :3], T[:, 3] - [b.length, 0, 0]
    turns = [np.arctan2(R[1, 0], R[0, 0]), -np.arcsin(R[2, 0]), np.arctan2(R[2, 1], R[2, 2])]
    return np.array([*r, *turns])


@pytest.mark.parametrize("shear", [False, True])
def test_second_order_is_that_of_a_rod_with_linear_strains(shear: bool) -> None:
    """Shortening, drift and turning of stretch, both bendings and twist together."""
    b = body("uvwp", CB, shear=shear, free_shear=shear)
    rng = np.random.default_rng(7)
    G = second_order(b.families, b.slices, np.array([b.length]), range(6))[0]
    for _ in range(3):
        eta = rng.normal(size=b.n)
        for d, at in b.slices.items():  # rotations, stretch and shear of size one each
            F = b.families[d].evaluate(np.array([0.3, 0.7, 1.0]) * b.length)
            eta[at] /= np.max(np.abs((F.df if d == "u" else F.rot if d in "vw" else F.f) @ eta[at]))
        twice = [
            (rod(b, eta, h) + rod(b, eta, -h) - 2 * rod(b, eta, 0.0)) / h**2 for h in (0.04, 0.02)
        ]
        expected = (4 * twice[1] - twice[0]) / 3
        found = np.einsum("i,rij,j->r", eta, G, eta)
        # Fourth powers are extrapolated away; the sixth leave 0.04^4 of the strains' shapes.
        np.testing.assert_allclose(found, expected, atol=1e-4 * np.max(np.abs(expected)))


def test_without_second_order_there_are_no_second_order_rows() -> None:
    b = body("uvwp", second_order=False, rotary_inertia=True)
    assert b.G is None and b.G_t is None and b.G_r is None and b.rows(L)[1] is None


def test_absent_directions_are_absent() -> None:
    b = body("v")
    assert b.n == 4 and len(b.xt) == 0 and set(b.fields(L)) == {"deflection", "curvature_v"}
    assert len(b.x) == 6  # degree 5 in v
    Phi, G = b.rows(L)
    assert not np.any(Phi[[0, 2, 4, 5]]) and not np.any(G[1:])


def test_only_families_free_at_the_root_move_it() -> None:
    moves = {
        boundary: body("v", Basis("assumed", boundary=boundary)).root_moves
        for boundary in BOUNDARIES
    }
    assert [k for k, v in moves.items() if v] == ["pinned_free", "pinned_pinned", "free_free"]
    assert not body("uvwp").root_moves and not body("uvwp", QUINTIC).root_moves
    assert body("v").interfaces == (L,)


def test_a_root_mass_matters_where_the_root_moves() -> None:
    free, mass = Basis("assumed", boundary="free_free", modes=3), EndMass(0.5)
    added = body("v", free, root=mass).M - body("v", free).M
    row = body("v", free).rows(0.0)[0][1]
    np.testing.assert_allclose(added, 0.5 * np.outer(row, row), atol=1e-13)
    np.testing.assert_allclose(body("v", root=mass).M, body("v").M, atol=1e-15)


def test_the_segments_of_a_cut_link_do_not_own_its_end_masses() -> None:
    cut = body("v", segments=2, tip=EndMass(0.5))
    np.testing.assert_array_equal(cut.M, body("v").M)


@pytest.mark.parametrize("planes", ["v", "uvwp"])
def test_modal_damping_is_that_ratio_of_every_mode(planes: str) -> None:
    b = body(planes, modal_damping=0.03, tip=EndMass(0.2))
    squares, V = np.linalg.eig(np.linalg.solve(b.M, b.K))
    damping = np.einsum("ik,ij,jk->k", V, b.D, V) / np.einsum("ik,ij,jk->k", V, b.M, V)
    np.testing.assert_allclose(damping, 2 * 0.03 * np.sqrt(squares), rtol=1e-8)
    np.testing.assert_allclose(b.D, b.D.T, atol=1e-12 * np.abs(b.D).max())


def test_rayleigh_damping_is_alpha_m_plus_beta_k() -> None:
    b = body("uvwp", rayleigh=(2e-3, 3e-4))
    np.testing.assert_allclose(b.D, 2e-3 * b.M + 3e-4 * b.K)
    assert not np.any(body("v").D)


def test_rigid_modes_have_no_stiffness_and_no_modal_damping() -> None:
    b = body("v", Basis("assumed", boundary="free_free", modes=4), modal_damping=0.1)
    assert np.abs(b.K[:2]).max() < 1e-9 * b.K[2, 2]
    assert np.abs(b.D[:2]).max() < 1e-5 * b.D[2, 2]  # the root of rounding in K


def test_labels_name_nodes_and_modes() -> None:
    assert body("up", QUINTIC).labels == (
        "u node 1", "u node 2", "p rate 0", "p node 1", "p rate 1", "p node 2", "p rate 2",
    )  # fmt: skip
    assert body("pv", Basis("assumed", modes=2)).labels == ("v1", "v2", "p1", "p2")


def test_polynomial_stretch_is_that_of_a_quadratic_bar_element() -> None:
    """Nodes in the middle and at the tip: K = EA/3L [16 -8; -8 7], M = m/15 [8 1; 1 2]."""
    b = body("u", Basis("assumed", modes=2, stretch="polynomials"))
    nodes = b.families["u"].evaluate(np.array([0.5, 1.0]) * b.length).f
    T = np.linalg.inv(nodes)
    K, M = T.T @ b.K @ T, T.T @ b.M @ T
    assert K / K[1, 1] == pytest.approx(np.array([[16, -8], [-8, 7]]) / 7, rel=1e-12)
    assert M / b.mass.sum() == pytest.approx(np.array([[8, 1], [1, 2]]) / 15, rel=1e-12)
