"""Stress at a point and the strength theories."""

from __future__ import annotations

import numpy as np
import pytest

from pinflex.description.section import Section
from pinflex.errors import DescriptionError
from pinflex.results.views import equivalent, principal, torsion_shear

FLAT = Section.rectangle(width=0.005, thickness=0.0015)
TALL = Section.rectangle(width=0.0015, thickness=0.005)


def test_torsion_of_a_rectangle_is_largest_amid_the_long_side() -> None:
    xy, xz = torsion_shear(FLAT, 0.00075, 0.0)
    # 0.03 %: J is Roark's polynomial, Wt the series.
    assert np.hypot(xy, xz) == pytest.approx(1 / FLAT.Wt, rel=5e-4)
    assert xz > 0  # tau_xz at +y turns about +x
    short = np.hypot(*torsion_shear(FLAT, 0.0, 0.0025))
    # Timoshenko and Goodier give 0.753 of it at the short side for a / b = 3, falling to 0.743.
    assert short == pytest.approx(0.749 / FLAT.Wt, rel=5e-3)
    assert torsion_shear(TALL, 0.0, 0.00075)[0] == pytest.approx(-xz, rel=1e-12)


@pytest.mark.parametrize("section", [FLAT, TALL, Section.circle(0.01)])
def test_the_shear_stresses_add_up_to_the_torque(section: Section) -> None:
    side = dict(section.dimensions)
    width, height = side.get("thickness", 0.01), side.get("width", 0.01)
    n = 60
    y = ((np.arange(n) + 0.5) / n - 0.5) * width
    z = ((np.arange(n) + 0.5) / n - 0.5) * height
    torque = 0.0
    for a in y:
        for b in z:
            if section.shape == "circle" and np.hypot(a, b) > 0.005:
                continue
            xy, xz = torsion_shear(section, a, b)
            torque += (a * xz - b * xy) * width / n * height / n
    assert torque == pytest.approx(1.0, rel=4e-3)  # midpoint rule of 60 x 60


def test_plane_sections_shear_like_the_radius() -> None:
    """The source's assumption: tau = G twist r."""
    xy, xz = torsion_shear(FLAT, 3e-4, 4e-4, warping=False)
    assert np.hypot(xy, xz) == pytest.approx(5e-4 / FLAT.J, rel=1e-12)


def test_other_shapes_are_refused_with_the_way_out() -> None:
    with pytest.raises(DescriptionError, match="torque / Wt"):
        torsion_shear(Section.i_section(0.02, 0.04, 0.002, 0.002), 0.0, 0.0)


def test_the_four_theories_agree_in_tension_and_differ_in_shear() -> None:
    s, zero = np.array([3.0e6]), np.zeros(1)
    for theory in ("first", "second", "third", "fourth"):
        np.testing.assert_allclose(equivalent(s, zero, theory, 0.3), s, rtol=1e-12)
    expected = {"first": 1.0, "second": 1.3, "third": 2.0, "fourth": np.sqrt(3)}
    for theory, factor in expected.items():
        np.testing.assert_allclose(equivalent(zero, s, theory, 0.3), factor * s, rtol=1e-12)


def test_the_fourth_theory_is_von_mises_and_the_invariants_hold() -> None:
    rng = np.random.default_rng(1)
    sigma, tau = rng.normal(size=(2, 50))
    np.testing.assert_allclose(equivalent(sigma, tau), np.sqrt(sigma**2 + 3 * tau**2), rtol=1e-12)
    s1, s2, s3 = principal(sigma, tau)
    np.testing.assert_allclose(s1 + s2 + s3, sigma, atol=1e-14)
    np.testing.assert_allclose(s1 * s3, -(tau**2), atol=1e-14)
    assert np.all(s1 >= 0)
    assert np.all(s3 <= 0)


def test_an_unknown_theory_is_named() -> None:
    with pytest.raises(DescriptionError, match='"third"'):
        equivalent(np.zeros(1), np.zeros(1), "thrid")
