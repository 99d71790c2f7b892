"""Beams with known frequencies and stiffness, as mechanisms: URDF and YAML in, pf.modes out.

Every beam has L = rho A = E I = 1, so omega = b^2 [rad/s]. Sources: benchmarks' closed forms,
solved in tests/analytical.py and held against the printed digits.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a beam 0.2 as high as long shears by default, with four coordinates: first two frequencies;
      slender ones stay Euler's | Timoshenko, printed table | 1e-4, 2e-2; (h/L)^2 | 1e-5, 1.5e-2
      (3.1 and 21 % off before)
    - cantilever, modes 1 to 4, 12 internal modes | closed form | 1e-6 | 1.5e-10
    - far end pinned / clamped by a closure | closed form | 1e-6 | 4.0e-9 / 5.3e-9
    - hinged root, far end pinned by a closure | closed form | 1e-6 | 2.2e-10
    - free hub, Ih/(m L^3) = 0.1 and 1, as link, rotor or root inertia | closed form | 1e-6 |
      1.5e-10
    - tip mass M/(m L) = 0.1 to 10, as key or link | closed form | 1e-6 | 4.1e-11
    - Timoshenko, h/L = 0.01 / 0.05 / 0.1 / 0.2, modes 1 to 4 | six printed digits | 2e-6 / 4e-5 /
      2e-4 / 1e-3 | 1.1e-6 / 1.8e-5 / 1.7e-4 / 7.9e-4, first mode 2e-6
    - cubic elements converge at order 4, quintic at order 8 | Ritz | +- 0.2 | 3.92, 8.13
    - two quintic elements pinned at both ends: 9.8696 39.496 89.089 | printed | 1e-4 | passes
    - sheared elements at order 2, to the printed number | same | +- 0.1; 1e-6 | 2.0; 4e-7
    - each two internal modes divide the error of mode 2 by > 100 | - | > 100 | 104, 403, 1510
    - free modes held by a closure: order 3 in their number | - | +- 0.3 | 2.99, 2.80
    - tip load with any basis, no locking; parallel flexure 24 EI/L^3 | beam theory | 1e-8; 1e-7 |
      passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from tests import analytical
from tests.finite import slope
from tests.scenes import Body, load

# The project's limit for a converged discretisation.
LIMIT = 1e-6
BEAM = (Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0)))
WALL = Body("wall", "base", xyz=(1, 0, 0))
RICH = "{kind: craig_bampton, internal: 12}"
KAPPA = 5 / 6  # shear factor of the benchmark's rectangle

PRINTED = {
    "clamped_free": (1.87510407, 4.69409113, 7.85475744, 10.99554073),
    "clamped_clamped": (4.73004074, 7.85320462, 10.99560784, 14.13716549),
    "clamped_pinned": (3.92660231, 7.06858275, 10.21017612, 13.35176878),
    "pinned_pinned": (np.pi, 2 * np.pi, 3 * np.pi, 4 * np.pi),
}
PRINTED_HUB = {
    0.1: (2.63892470, 4.79377085, 7.87565294, 11.00310416),
    1.0: (2.01000332, 4.70379426, 7.85682355, 10.99629338),
}
PRINTED_TIP = {
    0.1: (1.72274152,),
    0.5: (1.41996443,),
    1.0: (1.24791741, 4.03113944, 7.13413224),
    10.0: (0.73578192,),
}


def scene(basis: str = RICH, head: str = "", extra: str = "", section: str = "") -> str:
    section = section or "{shape: given, A: 1, Iy: 1, Iz: 1, J: 1}"
    return f"""
gravity: [0, 0, 0]
actuated: []
{head}
flexible:
  beam:
    material: {{E: 1, nu: 0.3, rho: 1}}
    section: {section}
    basis: {basis}
    end: tip
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
    {extra}
"""


def omega(m: pf.Mechanism, preload: str = "none") -> Array:
    return 2 * np.pi * pf.modes(m, preload=preload).frequencies


def test_the_closed_forms_give_the_printed_wave_numbers() -> None:
    rounding = 6e-9  # eight printed decimals
    for ends, printed in PRINTED.items():
        np.testing.assert_allclose(analytical.wave_numbers(ends), printed, atol=rounding)
    for inertia, printed in PRINTED_HUB.items():
        np.testing.assert_allclose(analytical.hub(inertia), printed, atol=rounding)
    for mass, first in PRINTED_TIP.items():
        np.testing.assert_allclose(analytical.tip_mass(mass, len(first)), first, atol=rounding)


# Frequencies -----------------------------------------------------------------------------------


@pytest.mark.parametrize("plane", ["bending_y", "bending_z"])
def test_a_cantilever_has_its_four_frequencies(plane: str, tmp_path: Path) -> None:
    yaml = scene()
    if plane == "bending_z":
        yaml = yaml.replace("y: true", "y: false", 1).replace("z: false", "z: true", 1)
    found = omega(load(tmp_path, BEAM, yaml))[:4]
    np.testing.assert_allclose(found, analytical.wave_numbers("clamped_free") ** 2, rtol=LIMIT)


@pytest.mark.parametrize(
    ("ends", "kind", "hinged"),
    [
        ("clamped_pinned", "planar", False),
        ("clamped_clamped", "weld", False),
        ("pinned_pinned", "planar", True),
        ("clamped_pinned", "weld", True),
    ],
)
def test_a_loop_holds_the_far_end(ends: str, kind: str, hinged: bool, tmp_path: Path) -> None:
    """The end conditions come from closures, not from the basis, which stays clamped-free."""
    bodies = (Body("beam", "base", "revolute") if hinged else BEAM[0], BEAM[1], WALL)
    head = f"loops: {{end: {{kind: {kind}, between: [tip, wall]}}}}"
    m = load(tmp_path, bodies, scene(head=head))
    np.testing.assert_allclose(omega(m)[:4], analytical.wave_numbers(ends) ** 2, rtol=LIMIT)


@pytest.mark.parametrize("inertia", PRINTED_HUB)
def test_a_free_hub_takes_part_in_the_vibration(inertia: float, tmp_path: Path) -> None:
    """A code that clamps the root finds 1.8751 for any hub: the test of rigid-elastic coupling."""
    hub = Body("hub", "base", "revolute", mass=1.0, inertia=(inertia,) * 3)
    bodies = (hub, Body("beam", "hub"), BEAM[1])
    expected = np.append(0.0, analytical.hub(inertia) ** 2)
    found = omega(load(tmp_path, bodies, scene()))[:5]
    np.testing.assert_allclose(found, expected, rtol=LIMIT, atol=1e-6)
    # The same inertia as a rotor, and as an end mass of the beam.
    bodies = (Body("beam", "base", "revolute"), BEAM[1])
    rotor = scene(head=f"joints: {{beam_joint: {{rotor_inertia: {inertia}}}}}")
    end = scene(extra=f"root: {{inertia: [0, 0, {inertia}]}}")
    for yaml in (rotor, end):
        found = omega(load(tmp_path, bodies, yaml))[:5]
        np.testing.assert_allclose(found, expected, rtol=LIMIT, atol=1e-6)


def test_a_locked_hub_is_a_cantilever_and_a_freed_motor_a_hub(tmp_path: Path) -> None:
    bodies = (Body("beam", "base", "revolute"), BEAM[1])
    yaml = scene(head="joints: {beam_joint: {rotor_inertia: 0.1}}")
    m = load(tmp_path, bodies, yaml.replace("actuated: []", "actuated: [beam_joint]"))
    locked = 2 * np.pi * pf.modes(m, preload="none").frequencies
    freed = 2 * np.pi * pf.modes(m, preload="none", free_motors=True).frequencies
    np.testing.assert_allclose(
        locked[0], analytical.wave_numbers("clamped_free")[0] ** 2, rtol=LIMIT
    )
    np.testing.assert_allclose(freed[1], analytical.hub(0.1)[0] ** 2, rtol=LIMIT)


@pytest.mark.parametrize("mass", PRINTED_TIP)
def test_a_tip_mass_lowers_the_frequencies(mass: float, tmp_path: Path) -> None:
    expected = analytical.tip_mass(mass) ** 2
    by_key = load(tmp_path, BEAM, scene(extra=f"tip: {{mass: {mass}}}"))
    np.testing.assert_allclose(omega(by_key)[:3], expected, rtol=LIMIT)
    body = Body("tip", "beam", xyz=(1, 0, 0), mass=mass)
    by_link = load(tmp_path, (BEAM[0], body), scene())
    np.testing.assert_allclose(omega(by_link)[:3], expected, rtol=LIMIT)


@pytest.mark.parametrize("direction", ["axial", "torsion"])
def test_a_bar_stretches_and_twists_at_quarter_waves(direction: str, tmp_path: Path) -> None:
    yaml = scene().replace("bending_y: true", "bending_y: false")
    yaml = yaml.replace(f"{direction}: false", f"{direction}: true")
    m = load(tmp_path, BEAM, yaml)
    speed = 1.0 if direction == "axial" else np.sqrt(1 / 2.6 / 2)  # sqrt(E/rho), sqrt(GJ/rho Ip)
    expected = speed * np.pi * (np.arange(1, 4) - 0.5)
    np.testing.assert_allclose(omega(m)[:3], expected, rtol=LIMIT)


TIMOSHENKO = {  # h/L: omega of nu = 0.3, kappa = 5/6, rectangle; six printed decimals
    0.01: (3.515735, 22.022240, 61.615532, 120.606597),
    0.05: (3.509027, 21.734580, 59.760253, 114.194476),
    0.1: (3.488355, 20.906915, 54.988380, 99.747158),
    0.2: (3.409783, 18.363703, 43.709082, 72.567009),
}


def deep(depth: float, basis: str, folder: Path) -> Array:
    """EI/(rho A L^4) = h^2 E/(12 rho): with E = 12/h^2 frequencies are in the printed unit."""
    second = depth**3 / 12
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
flexible:
  beam:
    material: {{E: {12 / depth**2!r}, nu: 0.3, rho: 1}}
    section: {{shape: given, A: {depth!r}, Iy: {second!r}, Iz: {second!r}, J: {second!r}, ky: {KAPPA}, kz: {KAPPA}}}
    basis: {basis}
    end: tip
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
    shear: true
    rotary_inertia: true
    second_order: false
"""  # noqa: E501
    return omega(load(folder, BEAM, yaml))[:4]


@pytest.mark.parametrize(
    ("depth", "tolerance"), [(0.01, 2e-6), (0.05, 4e-5), (0.1, 2e-4), (0.2, 1e-3)]
)
def test_a_deep_beam_shears(depth: float, tolerance: float, tmp_path: Path) -> None:
    """The fourth mode decides the tolerance: internal modes converge like 1/n^2 with shear."""
    found = deep(depth, RICH, tmp_path)
    np.testing.assert_allclose(found, TIMOSHENKO[depth], rtol=tolerance)
    assert found[0] == pytest.approx(TIMOSHENKO[depth][0], rel=3e-6)


@pytest.mark.parametrize("depth", [0.01, 0.1, 0.2])
def test_a_short_beam_shears_by_itself(depth: float, tmp_path: Path) -> None:
    """By default; its four coordinates stay four. A slender one is Euler's, to what that costs."""
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
flexible:
  beam:
    material: {{E: {12 / depth**2!r}, nu: 0.3, rho: 1}}
    section: {{shape: rectangle, thickness: {depth}, width: {depth}}}
    end: tip
    bending_z: false
    torsion: false
    axial: false
    second_order: false
"""
    m = load(tmp_path, BEAM, yaml)
    found, exact = omega(m), TIMOSHENKO[depth]
    assert len(found) == 4
    part = m.parts["beam"]
    if depth == 0.2:
        # 1e-4 and 2e-2: the default shapes; Euler's beam misses by 3.1 and 21 %
        assert found[0] == pytest.approx(exact[0], rel=1e-4)
        assert found[1] == pytest.approx(exact[1], rel=2e-2)
        assert part.spec.rotary_inertia is True and "short, so with shear" in part.reason
    else:
        # 0.8 (h / L)^2: the first term of what shear and rotary inertia lower it by
        assert found[0] == pytest.approx(exact[0], rel=depth**2)
        assert part.spec.shear is False and part.spec.rotary_inertia is False


def test_sheared_elements_converge_with_the_square_to_the_printed_number(tmp_path: Path) -> None:
    """Their shear is constant along an element: order two, so two meshes give the limit."""
    basis = "{kind: finite_element, elements: %d, order: cubic}"
    coarse, middle, fine = (deep(0.2, basis % n, tmp_path)[0] for n in (4, 8, 16))
    exact = TIMOSHENKO[0.2][0]
    error = [w / exact - 1 for w in (coarse, middle, fine)]
    assert -slope((4, 8, 16), error) == pytest.approx(2.0, abs=0.1)
    assert (4 * fine - middle) / 3 == pytest.approx(exact, rel=LIMIT)


# Convergence -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "counts", "power"), [("cubic", (4, 8, 16), 4), ("quintic", (4, 5, 6, 8), 8)]
)
def test_elements_converge_at_the_order_of_their_polynomials(
    order: str, counts: tuple[int, ...], power: int, tmp_path: Path
) -> None:
    """Rayleigh-Ritz: the error of omega falls like h^(2 (p + 1 - 2)), p = 3 or 5."""
    exact = analytical.wave_numbers("clamped_free", 2)[1] ** 2
    error = []
    for n in counts:
        yaml = scene(f"{{kind: finite_element, elements: {n}, order: {order}}}")
        error.append(omega(load(tmp_path, BEAM, yaml + "    second_order: false\n"))[1] / exact - 1)
    assert min(error) > 0  # from above
    # The coarsest mesh is not in the asymptotic range yet; measured 3.92 and 8.13.
    assert -slope(counts, error) == pytest.approx(power, abs=0.2)


def test_two_cubic_elements_have_the_first_mode_to_a_thousandth(tmp_path: Path) -> None:
    basis = "{kind: finite_element, elements: 2, order: cubic}"
    first = omega(load(tmp_path, BEAM, scene(basis)))[0]
    assert first == pytest.approx(analytical.wave_numbers("clamped_free")[0] ** 2, rel=1e-3)


def test_one_and_two_quintic_elements_give_the_printed_numbers(tmp_path: Path) -> None:
    one, two = (
        omega(
            load(tmp_path, BEAM, scene(f"{{kind: finite_element, elements: {n}, order: quintic}}"))
        )
        for n in (1, 2)
    )
    np.testing.assert_allclose(one[:3], (3.5160, 22.158, 63.347), rtol=1e-3)  # scenes.md 7, row 1
    np.testing.assert_allclose(two[:3], (3.5160, 22.0347, 61.831), rtol=1e-4)  # row 2


def test_two_quintic_elements_pinned_at_both_ends_give_the_printed_numbers(tmp_path: Path) -> None:
    """The curvature at the pins stays free: it vanishes in the weak sense only."""
    bodies = (Body("beam", "base", "revolute"), BEAM[1], WALL)
    head = "loops: {end: {kind: planar, between: [tip, wall]}}"
    basis = "{kind: finite_element, elements: 2, order: quintic}"
    found = omega(load(tmp_path, bodies, scene(basis, head=head)))[:3]
    np.testing.assert_allclose(found, (9.8696, 39.496, 89.089), rtol=1e-4)  # scenes.md 7, row 2


def test_internal_modes_converge_faster_than_any_power_at_hand(tmp_path: Path) -> None:
    """Each pair of modes more divides the error of omega_2 by at least 100, down to rounding."""
    exact = analytical.wave_numbers("clamped_free", 2)[1] ** 2
    basis = "{kind: craig_bampton, internal: %d}"
    error = [omega(load(tmp_path, BEAM, scene(basis % n)))[1] / exact - 1 for n in (0, 2, 4, 6)]
    assert min(error) > 0
    assert np.all(np.array(error[:-1]) / error[1:] > 100)  # measured 104, 403, 1510


@pytest.mark.parametrize("ends", ["clamped_free", "pinned_free"])
def test_assumed_modes_are_exact_for_their_own_ends_and_converge_for_others(
    ends: str, tmp_path: Path
) -> None:
    hinged = Body("beam", "base", "revolute")
    bodies = (BEAM[0] if ends == "clamped_free" else hinged, BEAM[1], WALL)
    basis = f"{{kind: assumed, boundary: {ends}, modes: MODES}}"
    own = omega(load(tmp_path, bodies, scene(basis.replace("MODES", "3"))))
    b = analytical.wave_numbers("clamped_free" if ends == "clamped_free" else "clamped_pinned", 3)
    np.testing.assert_allclose(own[-3:], b**2, rtol=1e-8)
    # Held at the far end by a loop, the series of free modes converges like 1/r^3: its terms have
    # no force at the tip, so the reaction is caught by none of them.
    head = "loops: {end: {kind: planar, between: [tip, wall]}}"
    exact = analytical.wave_numbers("clamped_pinned" if ends == "clamped_free" else "pinned_pinned")
    counts = (6, 12, 24)
    error = [
        omega(load(tmp_path, bodies, scene(basis.replace("MODES", str(r)), head=head)))[0]
        / exact[0] ** 2
        - 1
        for r in counts
    ]
    assert -slope(counts, error) == pytest.approx(3.0, abs=0.3)


# Stiffness -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "basis",
    [
        RICH,
        "{kind: craig_bampton, internal: 0}",
        "{kind: finite_element, elements: 1, order: cubic}",
    ],
)
def test_a_tip_load_bends_by_PL3_over_3EI_with_any_basis(basis: str, tmp_path: Path) -> None:
    """A heavy tip on a light beam; also sheared, where a locked element gives 1e-6 of it."""
    for shear in (False, True):
        extra = f"tip: {{mass: 1.0}}\n    shear: {str(shear).lower()}"
        h = 1e-3  # h/L: shear adds 3 EI/(kappa G A L^2) = 7.8e-7
        section = (
            f"{{shape: given, A: {12 / h**2!r}, Iy: 1, Iz: 1, J: 1, ky: {KAPPA}, kz: {KAPPA}}}"
        )
        yaml = scene(basis, extra=extra, section=section)
        yaml = yaml.replace("rho: 1", "rho: 1e-16").replace("[0, 0, 0]", "[0, -1, 0]", 1)
        m = load(tmp_path, BEAM, yaml)
        slot = m.flexible.expansion.slots[0]
        tip = slot.body.rows(1.0)[0][1] @ pf.linear_statics(m).y
        expected = -1.0 / 3.0 * (1 + shear * 3 * 2.6 * 1.2 * h**2 / 12)
        assert tip == pytest.approx(expected, rel=1e-8)


def test_a_parallel_flexure_has_24_EI_over_L_cubed(tmp_path: Path) -> None:
    """Two clamped beams and a rigid plate, closed by a weld, of which no row is redundant."""
    bodies = (
        Body("left", "base"),
        Body("plate", "left", xyz=(1, 0, 0), mass=1.0, com=(0, 0.15, 0)),
        Body("right", "base", xyz=(0, 0.3, 0)),
        Body("right_end", "right", xyz=(1, 0, 0)),
        Body("plate_end", "plate", xyz=(0, 0.3, 0)),
    )
    beam = """
    material: {E: 1, nu: 0.3, rho: 1.0e-20}
    section: {shape: given, A: 1.0e8, Iy: 1, Iz: 1, J: 1}
    basis: {kind: craig_bampton, internal: 0}
    bending_y: true
    bending_z: true
    torsion: true
    axial: true
"""
    yaml = f"""
gravity: [0, -1, 0]
actuated: []
loops: {{weld: {{kind: weld, between: [right_end, plate_end]}}}}
flexible:
  left:{beam}    end: plate
  right:{beam}    end: right_end
"""
    m = load(tmp_path, bodies, yaml)
    assert (m.flexible_report.rank, m.flexible_report.redundant) == (6, ())
    y = pf.linear_statics(m).y
    for slot in m.flexible.expansion.slots:
        tip = slot.body.rows(1.0)[0] @ y[slot.eta]
        assert tip[1] == pytest.approx(-1.0 / 24.0, abs=1e-7)  # EA = 1e8 EI/L^2: it turns 1e-7
        assert tip[3] == pytest.approx(0.0, abs=2e-7)
