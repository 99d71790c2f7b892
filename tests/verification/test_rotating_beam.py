"""Vibration of a beam that turns steadily: geometric stiffening, gyroscopic terms.

eta = Omega sqrt(m L^4/EI) with L = m = EI = 1. The hub's motor prescribes Omega: `pf.modes(at=...)`
about the steady state.
Source: Wright, Smith, Thresher, Wang (1982), recomputed with a 14-term Ritz series.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - rotating beam, flap modes 1 to 3, eta = 0 to 12 | Wright et al. 1982 | 1e-5 | 1.1e-8
    - chord modes 1 to 3 = sqrt(mu^2 - eta^2) | same | 1e-5 | 1.7e-8
    - Southwell slopes, hub radius | exact quotients | 5e-5, 1e-4 | passes
    - stretch and Coriolis, slenderness 70: segments converge to the exact rod | exact linearisation
      | monotone, tenfold | eta = 2: 4.9e-5 with one body, 1.9e-6 with eight; eta = 4: 6.8e-4,
      2.7e-5
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from tests import analytical
from tests.scenes import Body, load

LIMIT = 1e-5  # the project's own
FLAP = {
    0: (3.51601527, 22.0344916, 61.6972144),
    1: (3.68164681, 22.1810112, 61.8417626),
    2: (4.13731957, 22.6149220, 62.2731841),
    4: (5.58500142, 24.2733494, 63.9667605),
    6: (7.36037302, 26.8090817, 66.6839144),
    8: (9.25683760, 29.9953819, 70.2929622),
    10: (11.2023278, 33.6403659, 74.6492946),
    12: (13.1701505, 37.6031123, 79.6144785),
}
# First chord frequency at slenderness 70, with the stretch that Coriolis forces cause.
SLENDER_CHORD = {2: 3.6195, 4: 3.888, 6: 4.2393, 8: 4.6105, 10: 4.97}


def steady(
    folder: Path,
    eta: float,
    plane: str,
    *,
    internal: int = 8,
    segments: int = 1,
    second_order: bool = True,
    area: float | None = None,
    offset: float = 0.0,
) -> tuple[Array, Array, Array]:
    """Frequencies [rad/s], growth rates [1/s] and the balanced elastic coordinates."""
    bodies = (
        Body("hub", "base", "continuous", mass=1.0, inertia=(1, 1, 1)),
        Body("beam", "hub", xyz=(offset, 0, 0)),
        Body("tip", "beam", xyz=(1, 0, 0)),
    )
    yaml = f"""
gravity: [0, 0, 0]
actuated: [hub_joint]
flexible:
  beam:
    material: {{E: {1 / (area or 1.0)!r}, nu: 0.3, rho: {1 / (area or 1.0)!r}}}
    section: {{shape: given, A: {area or 1.0!r}, Iy: {area or 1.0!r}, Iz: {area or 1.0!r}, J: 1}}
    basis: {{kind: craig_bampton, internal: {internal}}}
    bending_y: {str(plane == "chord").lower()}
    bending_z: {str(plane == "flap").lower()}
    torsion: false
    axial: {str(area is not None).lower()}
    segments: {segments}
    second_order: {str(second_order).lower()}
"""
    if area is not None:  # E I = 1 with E A = slenderness^2
        yaml = yaml.replace(f"E: {1 / area!r}", "E: 1.0")
        yaml = yaml.replace(f"Iy: {area!r}, Iz: {area!r}", "Iy: 1.0, Iz: 1.0")
    m = load(folder, bodies, yaml)
    found = pf.modes(m, at={"hub_joint": eta}, count=m.flexible.nv)
    assert found.growth is not None
    omega = 2 * np.pi * found.frequencies
    return omega[omega > 0], found.growth, found.y[int(m.rigid.nq) :]


@pytest.mark.parametrize("eta", FLAP)
def test_flapping_stiffens_as_published(eta: float, tmp_path: Path) -> None:
    found, growth, bent = steady(tmp_path, eta, "flap")
    np.testing.assert_allclose(found[:3], FLAP[eta], rtol=LIMIT)
    assert np.abs(growth).max() < 1e-8  # nothing dissipates or feeds
    assert np.abs(bent).max() < 1e-12


@pytest.mark.parametrize("eta", FLAP)
def test_lagging_stiffens_less_by_the_square_of_the_speed(eta: float, tmp_path: Path) -> None:
    """mu_c^2 = mu^2 - eta^2: at eta = 2 this is 3.62179697 (one printed table has 3.62169696)."""
    found, growth, _ = steady(tmp_path, eta, "chord")
    np.testing.assert_allclose(found[:3], np.sqrt(np.square(FLAP[eta]) - eta**2), rtol=LIMIT)
    assert np.abs(growth).max() < 1e-8
    if eta == 2:
        assert found[0] == pytest.approx(3.62179697, abs=1e-7)


def test_segments_change_nothing_of_a_straight_spinning_beam(tmp_path: Path) -> None:
    one, three = (steady(tmp_path, 6.0, "chord", segments=n, internal=6)[0][:2] for n in (1, 3))
    np.testing.assert_allclose(one, three, rtol=LIMIT)


def test_the_stiffening_starts_with_southwells_slope(tmp_path: Path) -> None:
    """mu^2 = mu0^2 + a eta^2. The slopes of one printed table differ from the exact by 1.5e-4."""
    exact, _ = analytical.southwell()
    np.testing.assert_allclose(exact, (1.19332776, 6.47726535, 17.8593923, 36.0553608), rtol=2e-4)
    eta = 0.05
    still, turning = (steady(tmp_path, e, "flap", internal=10)[0][:4] for e in (0.0, eta))
    # The next term is of relative size eta^2/100.
    np.testing.assert_allclose((turning**2 - still**2) / eta**2, exact, rtol=5e-5)


def test_a_hub_with_a_radius_stiffens_more(tmp_path: Path) -> None:
    still = steady(tmp_path, 0.0, "flap")[0][0] ** 2
    turning = [steady(tmp_path, 0.05, "flap", offset=r)[0][0] ** 2 for r in (0.0, 0.5, 1.0)]
    slopes = (np.array(turning) - still) / 0.05**2
    slope, per_radius = (a[0] for a in analytical.southwell(1))
    np.testing.assert_allclose(slopes, slope + np.array([0, 0.5, 1]) * per_radius, rtol=1e-4)


@pytest.mark.parametrize("eta", SLENDER_CHORD)
def test_the_reference_of_a_stretching_rod_has_the_published_digits(eta: float) -> None:
    """The publication leaves the steady stretch out of the geometry."""
    found = analytical.lagging_rod(eta, 70.0, steady_stretch=False)[0]
    assert found == pytest.approx(SLENDER_CHORD[eta], abs=1e-4)


@pytest.mark.parametrize("eta", [2.0, 4.0])
def test_stretch_and_coriolis_lower_the_chord_frequency_of_a_stubby_beam(
    eta: float, tmp_path: Path
) -> None:
    exact = analytical.lagging_rod(eta, 70.0)[0]
    error = []
    for segments in (1, 2, 4, 8):
        found, growth, _ = steady(
            tmp_path, eta, "chord", area=70.0**2, segments=segments, internal=5
        )
        assert np.abs(growth).max() < 1e-6
        error.append(abs(found[0] / exact - 1))
    # Stretch times rotation squared is of third order: one body errs by part of the steady strain,
    # eta^2/(2 70^2), and segments take the rest away.
    assert error[0] < 0.5 * eta**2 / (2 * 70.0**2)
    assert np.all(np.diff(error) < 0)
    assert error[-1] < 0.1 * error[0]
    assert exact < np.sqrt(FLAP[int(eta)][0] ** 2 - eta**2) * (1 - 5e-4)  # an effect to be seen


@pytest.mark.parametrize("eta", [2.0, 3.6])
def test_without_second_order_the_beam_softens_and_then_runs_away(
    eta: float, tmp_path: Path
) -> None:
    """The wrong answer, documented: mu^2 = mu0^2 - eta^2, unstable beyond 3.516."""
    found, growth, _ = steady(tmp_path, eta, "chord", second_order=False)
    square = FLAP[0][0] ** 2 - eta**2
    if square > 0:
        assert found[0] == pytest.approx(np.sqrt(square), rel=LIMIT)
    else:
        assert growth.max() == pytest.approx(np.sqrt(-square), rel=LIMIT)
