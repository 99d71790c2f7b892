"""Sections and materials: closed forms against their polygons, series and limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from pinflex.description import section as torsion
from pinflex.description.blocks import material
from pinflex.description.section import Points, Section, from_spec
from pinflex.errors import DescriptionError

ROUNDING = 1e-12  # a dozen floating-point operations on numbers of one magnitude
SIZES = st.floats(1e-4, 1.0)  # [m]


def polygon_moments(points: Points) -> tuple[float, float, float]:
    """Area, int z^2 dA and int y^2 dA of a polygon, by Green's theorem."""
    area = iy = iz = 0.0
    for (y0, z0), (y1, z1) in zip(points, points[1:] + points[:1], strict=True):
        cross = y0 * z1 - y1 * z0
        area += cross / 2
        iy += cross * (z0 * z0 + z0 * z1 + z1 * z1) / 12
        iz += cross * (y0 * y0 + y0 * y1 + y1 * y1) / 12
    return area, iy, iz


@given(width=SIZES, thickness=SIZES)
def test_a_rectangle_has_the_moments_of_its_outline(width: float, thickness: float) -> None:
    section = Section.rectangle(width, thickness)
    expected = polygon_moments(section.outline)
    assert (section.A, section.Iy, section.Iz) == pytest.approx(expected, rel=ROUNDING)


@given(width=SIZES, height=SIZES, flange=st.floats(0.05, 0.45), web=st.floats(0.05, 0.95))
def test_an_i_section_has_the_moments_of_its_outline(
    width: float, height: float, flange: float, web: float
) -> None:
    section = Section.i_section(width, height, flange * height, web * width)
    assert len(section.outline) == 12
    expected = polygon_moments(section.outline)
    # Differences of cubes lose up to three digits when the web fills the section.
    assert (section.A, section.Iy, section.Iz) == pytest.approx(expected, rel=1e3 * ROUNDING)


def test_a_circle_has_the_moments_of_its_outline_but_for_the_corners_cut_off() -> None:
    section = Section.circle(0.02)
    area, iy, iz = polygon_moments(section.outline)
    x = 2 * math.pi / 24
    # A regular n-gon in a circle: A = n r^2 sin(x) / 2, I = A r^2 (2 + cos x) / 12.
    cut = math.sin(x) / x
    assert area == pytest.approx(section.A * cut, rel=ROUNDING)
    assert iy == pytest.approx(section.Iy * cut * (2 + math.cos(x)) / 3, rel=ROUNDING)
    assert iz == pytest.approx(iy, rel=ROUNDING)


def test_the_outline_runs_counter_clockwise_so_that_it_can_be_extruded() -> None:
    for section in (Section.rectangle(2, 1), Section.circle(1), Section.i_section(2, 3, 0.2, 0.1)):
        assert polygon_moments(section.outline)[0] > 0


def test_the_thickness_bends_in_the_plane_of_the_joint() -> None:
    section = Section.rectangle(width=0.025, thickness=0.002)
    assert section.Iz == pytest.approx(0.025 * 0.002**3 / 12, rel=ROUNDING)
    assert section.Iy == pytest.approx(0.002 * 0.025**3 / 12, rel=ROUNDING)
    # The 25 x 2 mm link of the planar 3-RRR paper: I = 1.67e-11 m^4, printed with three digits.
    assert section.Iz == pytest.approx(1.67e-11, abs=0.005e-11)


@pytest.mark.parametrize(
    ("ratio", "k1", "k2"),
    [(1.0, 0.1406, 0.208), (1.5, 0.196, 0.231), (2.0, 0.229, 0.246), (3.0, 0.263, 0.267)]
    + [(5.0, 0.291, 0.291), (10.0, 0.312, 0.312)],
)
def test_torsion_of_a_rectangle_matches_the_printed_table(
    ratio: float, k1: float, k2: float
) -> None:
    """J = k1 a b^3 and Wt = k2 a b^2: Timoshenko, Goodier, Theory of Elasticity, section 109."""
    section = Section.rectangle(width=ratio, thickness=1.0)
    # The table has three digits (0.2 % of the smallest), the polynomial for J errs by 0.4 %.
    assert pytest.approx(k1 * ratio, rel=5e-3) == section.J
    assert section.Wt == pytest.approx(k2 * ratio, rel=3e-3)


def test_torsion_does_not_care_which_side_is_the_long_one() -> None:
    flat, upright = Section.rectangle(0.03, 0.002), Section.rectangle(0.002, 0.03)
    assert (flat.J, flat.Wt) == (upright.J, upright.Wt)
    assert (flat.Iy, flat.Iz) == pytest.approx((upright.Iz, upright.Iy), rel=ROUNDING)


def test_a_strip_twists_like_an_open_thin_wall() -> None:
    width, thickness = 1.0, 1e-3
    section = Section.rectangle(width, thickness)
    # The ends of the strip take away 0.63 b / a = 6.3e-4 of J, and of Wt.
    assert pytest.approx(width * thickness**3 / 3, rel=7e-4) == section.J
    assert section.Wt == pytest.approx(width * thickness**2 / 3, rel=7e-4)


def test_a_round_section_twists_with_its_polar_moment() -> None:
    for section in (Section.circle(0.02), Section.tube(0.02, 0.003)):
        assert pytest.approx(section.Ip, rel=ROUNDING) == section.J
        assert section.Wt == pytest.approx(section.J / 0.01, rel=ROUNDING)


def test_a_tube_is_a_circle_less_its_bore() -> None:
    tube, outer, bore = Section.tube(0.03, 0.002), Section.circle(0.03), Section.circle(0.026)
    assert pytest.approx(outer.A - bore.A, rel=1e2 * ROUNDING) == tube.A  # a difference
    assert tube.Iy == pytest.approx(outer.Iy - bore.Iy, rel=1e2 * ROUNDING)


def test_the_shear_factor_of_a_tube_goes_from_the_rod_to_the_thin_wall() -> None:
    rod = Section.circle(0.02).ky
    assert rod == pytest.approx(6 * 1.3 / 8.8, rel=ROUNDING)
    thick, thin = Section.tube(0.02, 0.00999), Section.tube(0.02, 1e-6)
    assert thick.ky == pytest.approx(rod, rel=1e-4)  # bore/diameter = 1e-3, squared, and margin
    # Cowper's thin round tube: 2 (1 + nu) / (4 + 3 nu); the wall is 1e-4 of the radius.
    assert thin.ky == pytest.approx(2 * 1.3 / 4.9, rel=1e-3)


def test_a_box_is_a_rectangle_less_its_bore_and_carries_its_height_along_y() -> None:
    box = Section.box(0.03, 0.08, 0.002)
    outer, bore = Section.rectangle(0.03, 0.08), Section.rectangle(0.026, 0.076)
    for key in ("A", "Iy", "Iz"):
        assert getattr(box, key) == pytest.approx(getattr(outer, key) - getattr(bore, key))
    assert box.Iz > box.Iy
    assert box.ky > box.kz  # most of the wall is along y


def membrane(width: float, height: float, wall: float, n: int) -> float:
    """J of a box: div grad phi = -2, phi = 0 outside and one number in the hole; 2 int phi dA."""
    h = wall / n
    shape = round(height / h) + 1, round(width / h) + 1
    free = np.zeros(shape, dtype=int)
    free[1:-1, 1:-1] = 1
    free[n:-n, n:-n] = 2  # the hole, its border included
    number = np.full(shape, -1)
    number[free == 1] = np.arange(np.sum(free == 1))
    hole = int(np.sum(free == 1))
    number[free == 2] = hole
    rows, columns = [], []
    for a, b in ((number[1:], number[:-1]), (number[:, 1:], number[:, :-1])):
        pairs = np.stack([a.ravel(), b.ravel()])[:, a.ravel() != b.ravel()]
        rows += [pairs[0], pairs[1]]
        columns += [pairs[1], pairs[0]]
    i, j = np.concatenate(rows), np.concatenate(columns)
    inside = i >= 0
    size = hole + 1
    D = coo_array((np.ones(inside.sum()), (i[inside], i[inside])), (size, size))
    both = inside & (j >= 0)
    A = D - coo_array((np.ones(both.sum()), (i[both], j[both])), (size, size))
    load = np.full(size, 2 * h**2)
    load[hole] = 2 * (height - 2 * wall) * (width - 2 * wall)  # circulation about the hole
    phi = spsolve(A.tocsc(), load)
    return float(2 * (phi[:hole].sum() * h**2 + phi[hole] * load[hole] / 2))


def test_a_box_twists_as_prandtls_membrane_says() -> None:
    """Differences on a grid of n steps across the wall, whose error falls with 1/n."""
    size = 0.06, 0.1, 0.004
    J = 2 * membrane(*size, 16) - membrane(*size, 8)
    # Bredt leaves out what varies across the wall and in the corners: 2.5 % of it here
    twists = Section.box(*size).J
    assert twists == pytest.approx(J, rel=0.03)


def test_the_shear_factor_of_a_box_is_that_of_its_webs_or_of_the_flow_in_its_wall() -> None:
    flat = Section.box(1e-6, 0.1, 1e-9).ky  # nothing but webs: Cowper's rectangle
    assert flat == pytest.approx(10 * 1.3 / (12 + 11 * 0.3), rel=1e-3)
    side, wall = 0.1, 1e-5
    s = np.linspace(0, side / 2, 2001)
    flange, web = s * side / 2, side**2 / 4 + (side**2 / 4 - s**2) / 2  # static moments over wall
    energy = 4 * trapezoid(flange**2 + web**2, s) * wall
    section = Section.box(side, side, wall)
    by_energy = section.Iz**2 / (section.A * energy)
    # of the same stresses, Cowper weighs the mean displacement, with Poisson's ratio
    assert section.ky == pytest.approx(by_energy, rel=0.05)


def test_an_i_section_carries_its_height_along_y() -> None:
    section = Section.i_section(width=0.05, height=0.1, flange=0.005, web=0.004)
    assert section.Iz > 4 * section.Iy
    assert pytest.approx((2 * 0.05 * 0.005**3 + 0.095 * 0.004**3) / 3, rel=ROUNDING) == section.J
    assert section.Wt == pytest.approx(section.J / 0.005, rel=ROUNDING)
    assert section.ky + section.kz * 6 / 5 == pytest.approx(1.0, rel=ROUNDING)


def test_given_numbers_of_a_rectangle_draw_that_rectangle() -> None:
    wanted = Section.rectangle(0.03, 0.004)
    section = Section.given(wanted.A, wanted.Iy, wanted.Iz, wanted.J)
    for found, corner in zip(section.outline, wanted.outline, strict=True):
        assert found == pytest.approx(corner, rel=ROUNDING)


def test_a_section_is_read_from_a_block_with_its_own_factors() -> None:
    section = from_spec({"shape": "rectangle", "width": 0.02, "thickness": 0.01, "ky": 0.85})
    assert (section.ky, section.kz) == (0.85, 5 / 6)
    plain = Section.rectangle(0.02, 0.01)
    halved = from_spec({"shape": "rectangle", "width": 0.02, "thickness": 0.01, "J": plain.J / 2})
    assert halved.Wt == pytest.approx(plain.Wt / 2, rel=ROUNDING)
    numbers = {"shape": "given", "A": 1.0, "Iy": 0.1, "Iz": 0.2, "J": 0.1}
    corners = [[-1, -1], [1, -1], [0, 2]]
    drawn = from_spec(numbers | {"Wt": 0.3, "fibres": corners})
    assert drawn.fibres == tuple(map(tuple, corners))
    assert drawn.Wt == 0.3


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        ("rectangle", "section: 'rectangle' has no shape. Write {shape: rectangle"),
        ({"width": 1}, "has no shape"),
        ({"shape": "rectangel"}, "section.shape: 'rectangel' is not known. Did you mean \"rectan"),
        ({"shape": "rectangle", "width": 1}, "section.thickness: missing. Required here: width,"),
        ({"shape": "circle", "diameter": -1}, "section.diameter: -1 is out of range"),
        ({"shape": "circle", "diameter": math.nan}, "section.diameter: nan is out of range"),
        ({"shape": "circle", "diameter": "1 ft"}, "Units that may be written: m, cm, mm, um."),
        ({"shape": "circle", "diameter": True}, "section.diameter: True is not a number"),
        ({"shape": "circle", "radius": 1}, "section.radius: no such key."),
        ({"shape": "box", "width": 2, "height": 3, "wall": 1}, "section.wall: 1 leaves no bore"),
        ({"shape": "tube", "diameter": 2, "wall": 1}, "section.wall: 1 leaves no bore"),
        (
            {"shape": "i", "width": 1, "height": 1, "flange": 0.5, "web": 0.1},
            "section.flange: 0.5 fills the I section",
        ),
        (
            {"shape": "i", "width": 1, "height": 1, "flange": 0.1, "web": 1},
            "section.web: 1 fills the I section",
        ),
        (
            {"shape": "given", "A": 1, "Iy": 1, "Iz": 1, "J": 3},
            "section.J: 3 is more than Iy + Iz = 2",
        ),
        (
            {"shape": "given", "A": 1, "Iy": 1, "Iz": 1, "J": 1, "fibres": [[0, 0], [1, 1]]},
            "section.fibres: 2 points.",
        ),
    ],
)
def test_a_section_that_cannot_be_is_refused(spec: object, text: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        from_spec(spec, "x.yaml: section")
    assert text in str(caught.value)
    assert str(caught.value).startswith("x.yaml: section")


@pytest.mark.parametrize("name", [n for n in material.MATERIALS if n != "carbon_epoxy"])
def test_named_materials_are_isotropic(name: str) -> None:
    m = material.named(name)
    assert m.name == name
    assert m.rho is not None
    assert pytest.approx(m.E / (2 * (1 + m.nu)), rel=ROUNDING) == m.G
    # Stiff and light engineering materials: E / rho of metals is near 2.6e7 m^2/s^2.
    assert 1e6 < m.E / m.rho < 1e8


def test_aluminum_may_be_spelled_without_its_second_i() -> None:
    assert material.named("aluminum") is material.named("aluminium")
    assert material.named("aluminum_7075") is material.named("aluminium_7075")


def test_one_of_nu_and_g_gives_the_other() -> None:
    by_nu = material.from_spec({"E": 2.0e11, "nu": 0.25})
    assert pytest.approx(8.0e10, rel=ROUNDING) == by_nu.G
    assert by_nu.rho is None
    by_g = material.from_spec({"E": 2.11e11, "G": 8.0e10, "rho": 7800})
    assert by_g.nu == pytest.approx(0.31875, rel=ROUNDING)
    both = material.from_spec({"E": 1.3e11, "G": 5e9, "nu": 0.3})
    assert (both.G, both.nu) == (5e9, 0.3)


def test_a_named_material_can_be_changed_in_one_number() -> None:
    steel = material.named("steel")
    light = material.from_spec({"like": "steel", "rho": "urdf", "name": "frame"})
    assert (light.E, light.G, light.rho, light.name) == (steel.E, steel.G, None, "frame")
    soft = material.from_spec({"like": "steel", "E": 1e11})
    assert (soft.nu, soft.yield_strength) == (steel.nu, steel.yield_strength)
    assert pytest.approx(1e11 / 2.6, rel=ROUNDING) == soft.G
    composite = material.from_spec({"like": "carbon_epoxy", "E": 1.4e11})
    assert (composite.G, composite.nu) == (6.6e9, 0.28)


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        ("steal", "material: 'steal' is not known. Did you mean \"steel\"?"),
        ({"nu": 0.3}, "material: E is missing."),
        ({"E": 1e11}, "material: nu (or G) is missing."),
        ({"E": -1, "nu": 0.3}, "material.E: -1 is out of range. Allowed: a finite number > 0"),
        ({"E": 1e11, "nu": 0.6}, "material.nu: 0.6 is out of range"),
        ({"E": 1e11, "G": 1e10}, "give nu = 4. An isotropic material has -1 < nu <= 0.5"),
        ({"E": 1e11, "nu": 0.3, "rho": "udrf"}, 'Did you mean "urdf"?'),
        ({"E": 1e11, "nu": 0.3, "rho": 0}, "material.rho: 0 is out of range"),
        ({"E": 1e11, "nu": 0.3, "density": 1}, "material.density: no such key"),
        ({"like": "gold"}, "material.like: 'gold' is not known"),
        (7.1e10, "material: 71000000000.0 is not a block of `key: value`"),
    ],
)
def test_a_material_that_cannot_be_is_refused(spec: object, text: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        material.from_spec(spec, "x.yaml: material")
    assert text in str(caught.value)


def test_a_given_section_may_turn_with_an_inertia_that_does_not_go_with_its_stiffness() -> None:
    spec = {"shape": "given", "A": 1.0, "Iy": 2.0, "Iz": 3.0, "J": 1.0}
    plain, heavy = from_spec(spec), from_spec({**spec, "my": 20.0, "mz": 30.0})
    assert (plain.turning, plain.Ip) == ((2.0, 3.0), 5.0)
    assert (heavy.turning, heavy.Ip, heavy.Iz) == ((20.0, 30.0), 50.0, 3.0)


@pytest.mark.parametrize(("width", "thickness"), [(0.03, 0.01), (0.01, 0.03), (0.02, 0.02)])
def test_shear_stresses_of_a_twisted_rectangle_make_the_torque(
    width: float, thickness: float
) -> None:
    """int (y tau_xz - z tau_xy) dA = 1, and no traction on the sides; 60 Gauss points each way."""
    section = Section.rectangle(width, thickness)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    torque = 0.0
    for y, wy in zip(nodes * thickness / 2, weights * thickness / 2, strict=True):
        for z, wz in zip(nodes * width / 2, weights * width / 2, strict=True):
            tau_xy, tau_xz = torsion.rectangle(section, float(y), float(z))
            torque += wy * wz * (y * tau_xz - z * tau_xy)
    assert torque == pytest.approx(1.0, rel=2e-3)  # J by Roark is within 0.2 % of the series
    largest = 1.0 / section.Wt
    for share in (-0.6, 0.3):
        assert abs(torsion.rectangle(section, thickness / 2, share * width / 2)[0]) < 1e-3 * largest
        assert abs(torsion.rectangle(section, share * thickness / 2, width / 2)[1]) < 1e-3 * largest


def test_a_given_strip_shears_most_by_its_thickness() -> None:
    """tau = T t / J of an open thin wall, whichever way the strip lies."""
    for width, thickness in ((0.1, 1e-3), (1e-3, 0.1)):
        s = Section.rectangle(width, thickness)
        given = Section.given(s.A, s.Iy, s.Iz, s.J)
        assert given.Wt == pytest.approx(s.J / 1e-3, rel=1e-9)
