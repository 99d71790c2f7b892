"""Second-order rows of a beam: against finite rotations, rotating beams and buckling."""

from __future__ import annotations

import numpy as np
import pytest

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody
from pinflex.description.blocks.flexible import Basis
from pinflex.description.section import Section
from tests.bar import BAR, CUBIC, QUINTIC, STEEL, L, bending_unit, body, omega

CB_4 = Basis("craig_bampton", internal=4)


def nonlinear(b: FlexibleBody, eta: Array, x: float) -> Array:
    """(u, v, w, rz, ry, rx) from R' = R kappa^, r' = R (1 + eps, gy, gz), strains linear in eta."""
    from scipy.integrate import solve_ivp

    def strain(s: float) -> tuple[Array, Array]:
        rows = {k: float(r[0] @ eta) for k, r in b.fields(np.array([s])).items() if r.ndim == 2}
        kappa = [rows.get(k, 0.0) for k in ("twist", "curvature_w", "curvature_v")]
        gamma = [rows.get(k, 0.0) for k in ("axial", "shear_v", "shear_w")]
        return np.array(kappa) * (1, -1, 1), np.array(gamma)

    def rhs(s: float, y: Array) -> Array:
        R = y[:9].reshape(3, 3)
        (kx, ky, kz), gamma = strain(s)
        hat = np.array([[0, -kz, ky], [kz, 0, -kx], [-ky, kx, 0]])
        return np.concatenate([(R @ hat).ravel(), R @ (gamma + (1, 0, 0))])

    root = b.rows(0.0)[0] @ eta
    (ca, cb, cc), (sa, sb, sc) = np.cos(root[3:]), np.sin(root[3:])
    Rz, Ry = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]]), np.eye(3)
    Ry[0, 0] = Ry[2, 2] = cb
    Ry[0, 2], Ry[2, 0] = sb, -sb
    Rx = np.array([[1, 0, 0], [0, cc, -sc], [0, sc, cc]])
    y = np.concatenate([(Rz @ Ry @ Rx).ravel(), root[:3]])
    inner = next(iter(b.families.values())).breaks
    for start, end in zip(inner[:-1], np.minimum(inner[1:], x), strict=True):
        if end > start:
            y = solve_ivp(rhs, (start, end), y, "DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    R = y[:9].reshape(3, 3)
    turn = (np.arctan2(R[1, 0], R[0, 0]), -np.arcsin(R[2, 0]), np.arctan2(R[2, 1], R[2, 2]))
    return np.concatenate([y[9:] - (x, 0, 0), turn])


BODIES = {
    "cb, all": ("uvwp", CB_4, {}),
    "cb, two bendings": ("vw", CB_4, {}),
    "cb, one bending and torsion": ("wp", CB_4, {}),
    "cb, shear": ("uvwp", CB_4, {"shear": True, "rotary_inertia": True}),
    "cb, shear only": ("uvwp", CB_4, {"shear": True}),
    "cubic": ("uvwp", CUBIC, {}),
    "cubic, shear": ("uvwp", CUBIC, {"shear": True}),
    "quintic": ("uvwp", QUINTIC, {}),
    "pinned_free": ("uvwp", Basis("assumed", boundary="pinned_free", modes=2), {}),
    "free_free": ("vwp", Basis("assumed", boundary="free_free", modes=4), {}),
}


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("x", [0.55 * L, L])
def test_second_order_rows_leave_a_third_order_error(name: str, x: float) -> None:
    planes, basis, extra = BODIES[name]
    section = Section.rectangle(0.12, 0.2) if extra else BAR  # thick: the shear is seen
    b = body(planes, basis, section=section, **extra)
    Phi, G = b.rows(x)
    assert G is not None
    np.testing.assert_array_equal(G, np.swapaxes(G, 1, 2))
    rng = np.random.default_rng(3)
    shape = rng.standard_normal(b.n)
    for family, at in zip(b.families.values(), b.slices.values(), strict=True):
        shape[at] *= 0.3 / np.abs(family.evaluate(np.linspace(0, L, 9)).curv @ shape[at]).max()
    for d, at in b.slices.items():  # all strains of a size: 0.3/L of curvature, twist, stretch
        shape[at] /= 1.0 if d == "u" else L
    error = []
    sizes = np.array([1 / 16, 1 / 32, 1 / 64])  # small enough for the cube to rule
    for size in sizes:
        eta = size * shape
        predicted = Phi @ eta + 0.5 * np.einsum("rij,i,j->r", G, eta, eta)
        error.append(np.abs(nonlinear(b, eta, x) - predicted))
        quadratic = 0.5 * np.einsum("rij,i,j->r", G, eta, eta)
    worst = np.max(error, axis=1)
    assert np.abs(quadratic).max() > 3 * worst[-1]  # the rows are not a detail
    for row in range(6):
        values = np.array(error)[:, row]
        if values[-1] > 1e-12:  # above the rounding of the integration, 3e-13
            assert np.polyfit(np.log(sizes), np.log(values), 1)[0] > 2.9, row


@pytest.mark.parametrize("name", BODIES)
def test_station_rows_are_the_section_rows_there(name: str) -> None:
    planes, basis, extra = BODIES[name]
    b = body(planes, basis, **extra)
    for k in (0, len(b.x) // 2, -1):
        Phi, G = b.rows(b.x[k])
        np.testing.assert_allclose(b.Phi[k], Phi[:3], atol=1e-13)
        np.testing.assert_allclose(b.G[k], G[:3], atol=1e-11 * np.abs(G).max())
        if b.inertia is not None:
            np.testing.assert_allclose(b.G_r[k], G[3:], atol=1e-11 * np.abs(G).max())
    for k in range(len(b.xt)):
        Phi, G = b.rows(b.xt[k])
        np.testing.assert_allclose(b.Phi_t[k], Phi[5], atol=1e-13)
        np.testing.assert_allclose(b.G_t[k], G[5], atol=1e-11 * np.abs(G).max())
    Phi = np.array([b.rows(x)[0] for x in b.x])
    np.testing.assert_allclose(b.fields(b.x)["deflection"], Phi[:, [0, 1, 2, 5, 4, 3]])


@pytest.mark.parametrize(
    ("speed", "flap"),
    [
        (2, (4.13731957, 22.6149220, 62.2731841)),
        (6, (7.36037302, 26.8090817, 66.6839144)),
        (12, (13.1701505, 37.6031123, 79.6144785)),
    ],
)
def test_foreshortening_stiffens_a_rotating_beam(speed: float, flap: tuple[float, ...]) -> None:
    # Wright, Smith, Thresher, Wang (1982): the centrifugal force m Omega^2 x works on u.
    b = body("v", Basis(internal=10))
    unit = bending_unit(b)
    Omega = speed * unit
    K = b.K - Omega**2 * np.einsum("k,kij->ij", b.mass * b.x, b.G[:, 0])
    np.testing.assert_allclose(omega(K, b.M)[:3] / unit, flap, rtol=1e-7)
    chord = np.sqrt(flap[0] ** 2 - speed**2)  # the deflection itself is in the plane of rotation
    assert omega(K - Omega**2 * b.M, b.M)[0] / unit == pytest.approx(chord, rel=1e-7)


def test_foreshortening_gives_the_euler_load() -> None:
    b = body("v", Basis(internal=6))
    # P u_tip of a compressive load: K + P G_u(L) is singular at pi^2 EI / 4 L^2.
    load = 1 / np.linalg.eigvals(-np.linalg.solve(b.K, b.rows(L)[1][0])).real.max()
    exact = np.pi**2 / 4 * STEEL.E * BAR.Iz / L**2
    assert load == pytest.approx(exact, rel=1e-9)


def test_the_twist_rows_give_the_lateral_buckling_load() -> None:
    # Dead tip load along y of a beam deep in y: 4.01259934 sqrt(EI_y GJ) / L^2 (Prandtl, Michell).
    b = body("wp", Basis(internal=8))
    loads = np.linalg.eigvals(np.linalg.solve(b.K, b.rows(L)[1][1])).real
    exact = 4.01259934 * np.sqrt(STEEL.E * BAR.Iy * STEEL.G * BAR.J) / L**2
    assert 1 / loads.max() == pytest.approx(exact, rel=1e-6)
    assert -1 / loads.min() == pytest.approx(exact, rel=1e-6)  # either sign of the load
