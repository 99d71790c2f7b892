"""Families of beam functions against closed forms, and beam frequencies they must give."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from pinflex.arrays import Array
from pinflex.bodies import family as beam_modes
from pinflex.bodies.family import (
    Family,
    assumed,
    combine,
    hermite,
    polynomial,
    quadrature,
    sines,
)
from pinflex.description.blocks.flexible import BOUNDARIES

# Roots b L (Blevins 1979; benchmarks A), to the digits printed.
TABLE = {
    "clamped_free": (1.87510407, 4.69409113, 7.85475744, 10.99554073),
    "clamped_clamped": (4.73004074, 7.85320462, 10.99560784, 14.13716549),
    "free_free": (4.73004074, 7.85320462, 10.99560784, 14.13716549),
    "clamped_pinned": (3.92660231, 7.06858275, 10.21017612, 13.35176878),
    "pinned_free": (3.92660231, 7.06858275, 10.21017612, 13.35176878),
    "pinned_pinned": (np.pi, 2 * np.pi, 3 * np.pi, 4 * np.pi),
}
# Timoshenko cantilever, nu = 0.3, k = 5/6: h/L -> omega / sqrt(EI / m L^4), modes 1-4.
TIMOSHENKO = {
    0.01: (3.515735, 22.022240, 61.615532, 120.606597),
    0.05: (3.509027, 21.734580, 59.760253, 114.194476),
    0.1: (3.488355, 20.906915, 54.988380, 99.747158),
    0.2: (3.409783, 18.363703, 43.709082, 72.567009),
}


def gram(family: Family, left: str, right: str) -> Array:
    x, w = quadrature(family.breaks, family.gauss)
    F = family.evaluate(x.ravel())
    return (getattr(F, left).T * w.ravel()) @ getattr(F, right)


def frequencies(family: Family, shear_ratio: float = 0.0, gyration: float = 0.0) -> Array:
    """omega / sqrt(EI / m) of a beam, from the family alone; gyration^2 = I / A."""
    K, M = gram(family, "curv", "curv"), gram(family, "f", "f")
    if shear_ratio:
        x, w = quadrature(family.breaks, family.gauss)
        F = family.evaluate(x.ravel())
        K = K + ((F.df - F.rot).T * w.ravel()) @ (F.df - F.rot) / shear_ratio
    M = M + gyration**2 * gram(family, "rot", "rot")
    root = np.linalg.inv(np.linalg.cholesky(K))
    # Of K^-1 M: massless coordinates are then harmless zeros at the end.
    return 1.0 / np.sqrt(np.maximum(np.linalg.eigvalsh(root @ M @ root.T)[::-1], 1e-30))


FAMILIES = {
    "hermite quintic": hermite(0.7, 3, "quintic"),
    "hermite quintic, free": hermite(0.7, 3, "quintic", root="free"),
    "hermite cubic": hermite(0.7, 3, "cubic"),
    "hermite shear": hermite(0.7, 3, "cubic", shear_ratio=0.01),
    "hermite torsion": hermite(0.7, 3, "quintic", direction="p"),
    "hermite torsion linear": hermite(0.7, 3, "cubic", direction="p"),
    "hermite axial": hermite(0.7, 3, "quintic", direction="u"),
    "polynomial": polynomial(0.7, 6),
    "polynomial shear": polynomial(0.7, 6, "v", 0.01),
    "polynomial free shear": polynomial(0.7, 6, "v", 0.01, shear_free=True),
    "polynomial axial": polynomial(0.7, 6, "u"),
    "free_free": assumed(0.7, "free_free", 6),
    "clamped_free": assumed(0.7, "clamped_free", 6),
    "sines": sines(0.7, 5),
    "combined": combine(polynomial(0.7, 4), np.arange(12.0).reshape(4, 3) ** 0.5),
}


@pytest.mark.parametrize("name", FAMILIES)
def test_derivatives_are_those_of_the_values(name: str) -> None:
    family = FAMILIES[name]
    assert len(family.names) == family.n
    x, h = np.array([0.05, 0.2, 0.31, 0.55]), 1e-6
    F, up, down = (family.evaluate(x + d) for d in (0.0, h, -h))
    # Central differences: h^2 f''' / 6 and rounding eps / h are both below 1e-8 of the scale.
    for value, derivative in (("f", "df"), ("rot", "curv")):
        slope = (getattr(up, value) - getattr(down, value)) / (2 * h)
        exact = getattr(F, derivative)
        np.testing.assert_allclose(exact, slope, atol=1e-7 * max(1.0, np.abs(exact).max()))
    if not family.shear and name not in ("sines",) and "axial" not in name and "tors" not in name:
        np.testing.assert_allclose(F.rot, F.df, atol=1e-12 * np.abs(F.df).max())


@pytest.mark.parametrize("name", [n for n in FAMILIES if "free" not in n or "shear" in n])
def test_a_clamped_family_leaves_the_root_in_place(name: str) -> None:
    F = FAMILIES[name].evaluate(np.array([0.0]))
    assert np.abs(F.f).max() < 1e-14
    assert np.abs(F.rot).max() < 1e-14


def test_a_quintic_element_has_the_ten_published_functions() -> None:
    L, e = 0.3, np.linspace(0, 1, 7)
    n = [
        1 - 10 * e**3 + 15 * e**4 - 6 * e**5,
        L * (e - 6 * e**3 + 8 * e**4 - 3 * e**5),
        L**2 / 2 * (e**2 - 3 * e**3 + 3 * e**4 - e**5),
        10 * e**3 - 15 * e**4 + 6 * e**5,
        L * (-4 * e**3 + 7 * e**4 - 3 * e**5),
        L**2 / 2 * (e**3 - 2 * e**4 + e**5),
        1 - 3 * e**2 + 2 * e**3,
        L * (e - 2 * e**2 + e**3),
        3 * e**2 - 2 * e**3,
        L * (e**3 - e**2),
    ]
    bending = hermite(L, 1, "quintic", root="free")
    torsion = hermite(L, 1, "quintic", root="free", direction="p")
    np.testing.assert_allclose(bending.evaluate(L * e).f, np.transpose(n[:6]), atol=1e-14)
    np.testing.assert_allclose(torsion.evaluate(L * e).f, np.transpose(n[6:]), atol=1e-14)
    axial = hermite(L, 1, "quintic", root="free", direction="u")
    np.testing.assert_allclose(axial.evaluate(L * e).f, np.transpose([1 - e, e]), atol=1e-14)


def test_hermite_coordinates_are_nodal_values_slopes_and_curvatures() -> None:
    family = hermite(0.8, 2, "quintic")
    assert family.names[:4] == ("curvature 0", "node 1", "slope 1", "curvature 1")
    nodes = family.evaluate(np.array([0.0, 0.4, 0.8]))
    rows = np.vstack([nodes.curv[0], nodes.f[1], nodes.df[1], nodes.curv[1]])
    np.testing.assert_allclose(rows, np.eye(4, 7), atol=1e-12)


def test_quintic_elements_give_the_published_cantilever_frequencies() -> None:
    # Exact integration, so the tolerance is that of the printed digits.
    one, two = (frequencies(hermite(1.0, k, "quintic"))[:3] for k in (1, 2))
    np.testing.assert_allclose(one, (3.5160, 22.158, 63.347), rtol=1e-4)
    np.testing.assert_allclose(two, (3.5160, 22.0347, 61.831), rtol=3e-5)


def test_two_cubic_elements_miss_the_first_frequency_by_less_than_a_thousandth() -> None:
    error = frequencies(hermite(1.0, 2, "cubic"))[0] / 3.51601527 - 1
    assert 0 < error < 1e-3  # Ritz: from above


def test_cubic_elements_converge_with_order_four_in_frequency() -> None:
    elements = np.array([4, 6, 8, 12])
    exact = beam_modes.roots("clamped_free", 2)[1] ** 2
    error = [frequencies(hermite(1.0, int(k), "cubic"))[1] / exact - 1 for k in elements]
    order = -np.polyfit(np.log(elements), np.log(error), 1)[0]
    assert order == pytest.approx(4, abs=0.1)  # 2 (p + 1 - m) = 4, p = 3, m = 2


@pytest.mark.parametrize("h", TIMOSHENKO)
def test_polynomials_with_shear_give_the_timoshenko_frequencies(h: float) -> None:
    gyration = h / np.sqrt(12)
    ratio = gyration**2 * 2.6 / (5 / 6)
    free = polynomial(1.0, 12, "v", ratio, shear_free=True)
    found = frequencies(free, ratio, gyration)[:4]
    np.testing.assert_allclose(found, TIMOSHENKO[h], rtol=1e-6)  # digits of the table: 1.5e-7
    fine = frequencies(hermite(1.0, 40, "cubic", shear_ratio=ratio), ratio, gyration)[:4]
    # Interdependent functions leave out rotary inertia in the shape: O((h/L)^2 / n^2).
    np.testing.assert_allclose(fine, TIMOSHENKO[h], rtol=2e-3)


def test_without_rotary_inertia_the_interdependent_polynomials_lose_nothing() -> None:
    ratio = 0.01
    half = frequencies(polynomial(1.0, 12, "v", ratio), ratio)[:3]
    full = frequencies(polynomial(1.0, 12, "v", ratio, shear_free=True), ratio)[:3]
    # Both have converged to 1e-9: the n spare shear coordinates carry no mass and add nothing.
    np.testing.assert_allclose(half, full, rtol=1e-8)


@pytest.mark.parametrize("make", ["element", "polynomial"])
def test_one_slender_shear_element_does_not_lock(make: str) -> None:
    h = 1e-3
    ratio = h**2 / 12 * 2.6 / (5 / 6)
    family = (
        hermite(1.0, 1, "cubic", shear_ratio=ratio)
        if make == "element"
        else polynomial(1.0, 2, "v", ratio, shear_free=True)
    )
    x, w = quadrature(family.breaks, family.gauss)
    F = family.evaluate(x.ravel())
    K = gram(family, "curv", "curv") + ((F.df - F.rot).T * w.ravel()) @ (F.df - F.rot) / ratio
    tip = family.evaluate(np.array([1.0])).f[0]
    # PL^3/3EI + PL/kGA exactly, with EI = 1; cond(K) = 1e7 leaves 9 digits.
    assert tip @ np.linalg.solve(K, tip) == pytest.approx(1 / 3 + ratio, rel=1e-8)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_roots_agree_with_the_table(boundary: str) -> None:
    found = beam_modes.roots(boundary, 60)
    np.testing.assert_allclose(found[:4], TABLE[boundary], rtol=3e-9)  # printed digits
    assert np.all(np.abs(np.diff(found[5:]) - np.pi) < 1e-6)  # none missed, none twice


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_fifty_modes_are_orthonormal_and_meet_their_boundary_conditions(boundary: str) -> None:
    L = 0.5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        family = assumed(L, boundary, 52)
        mass = gram(family, "f", "f") / L
    np.testing.assert_allclose(mass, np.eye(52), atol=1e-12)
    rigid = boundary == "free_free"
    modes = beam_modes.mode_functions(boundary, 50, L)
    zero = {"clamped": (0, 1), "pinned": (0, 2), "free": (2, 3)}
    for end, x in zip(boundary.split("_"), (0.0, L), strict=True):
        for k in zero[end]:
            # Relative to b^k; b L = 158 carries 158 eps into the phase.
            residual = modes.evaluate(np.array([x]), k) / modes.wavenumber**k
            assert np.abs(residual).max() < 1e-12
    stiffness = np.diag(gram(family, "curv", "curv")) / L
    wavenumber = np.append([0.0, 0.0], modes.wavenumber)[:52] if rigid else modes.wavenumber
    np.testing.assert_allclose(stiffness[: len(wavenumber)], wavenumber**4, rtol=1e-11)


def test_modes_satisfy_the_beam_equation() -> None:
    modes = beam_modes.mode_functions("clamped_pinned", 8, 0.3)
    x = np.linspace(0, 0.3, 9)
    np.testing.assert_allclose(
        modes.evaluate(x, 4), modes.wavenumber**4 * modes.evaluate(x), atol=1e-14
    )


def test_free_free_modes_begin_with_the_two_rigid_ones_and_stay_bounded() -> None:
    x = np.linspace(0, 2.0, 501)
    f = assumed(2.0, "free_free", 50).evaluate(x).f
    np.testing.assert_allclose(f[:, 0], 1.0)
    np.testing.assert_allclose(f[:, 1], np.sqrt(3) * (x - 1.0), atol=1e-14)
    np.testing.assert_allclose(np.abs(f[[0, -1], 2:]), 2.0, rtol=1e-12)  # amplitude 2 at free ends
    assert np.abs(f).max() < 2.0 + 1e-12


def test_pinned_free_modes_are_those_of_the_3rrr_paper() -> None:
    L, x = 0.21, np.linspace(0, 0.21, 11)
    modes = beam_modes.mode_functions("pinned_free", 3, L)
    th = modes.wavenumber * L
    s = np.outer(x / L, th)
    paper = (np.sin(s) + np.sin(th) / np.sinh(th) * np.sinh(s)) / np.sin(th)
    paper *= np.sign(paper[1])  # theirs is scaled to +1 at the tip, ours starts upward
    np.testing.assert_allclose(modes.evaluate(x), paper, atol=1e-9)


@pytest.mark.parametrize(
    ("boundary", "published"),
    [
        ("pinned_free", (161.48, 523.31, 1091.85)),
        ("pinned_pinned", (103.37, 413.48, 930.33)),
        ("clamped_pinned", (161.48, 523.31, 1091.85)),
        ("clamped_free", (36.83, 230.78)),
        ("clamped_clamped", (234.33, 645.94)),
    ],
)
def test_the_3rrr_link_has_the_transcendental_frequencies(
    boundary: str, published: tuple[float, ...]
) -> None:
    E, rho, L, h = 7.1e10, 2810.0, 0.21, 0.002
    speed = np.sqrt(E * h**2 / 12 / rho)
    found = beam_modes.roots(boundary, len(published)) ** 2 / L**2 * speed / (2 * np.pi)
    np.testing.assert_allclose(found, published, rtol=2e-4)  # printed to 0.01 Hz
