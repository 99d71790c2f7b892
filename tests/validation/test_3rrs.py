"""The spatial 3-RRS of the source articles: statics, frequencies, kineto-elastodynamics.

Numbers: scenes 6.1 and 7 (rows 13, 14). The trajectory of the articles is lost; the one used is a
fit to four of their numbers, so the last test shows consistency, not agreement.

Claims:
    Machines
    - 3rrs: linear sag 3.706 mm and 0.11296 N m, three bases | virtual work | 0.3 % | 0.002 %, 0.003
      %
    - full equilibrium (ours): 3.8894 mm, 0.11647 N m | - | 1e-4 | three bases agree to 1e-8
    - six frequencies 1.524 to 13.30 Hz, no preload, three bases | frame elements | 0.5 % | 0.02 %
    - preload makes them 1.2913 2.5416 3.9969 7.3804 7.8485 12.7386 Hz (ours) | - | 2e-4 | three
      bases agree to 3e-6
    - classical kineto-elastodynamics: -7.2 mm, -0.055 rad, 0.2246, 0.1053 N m | the articles; the
      path is a fit to these | 6 %, 3 %, 5 %, 5 % | 3.1, 0.6, 2.1, 0.4 %: consistency, no agreement
    - a quarter of the published step moves the extreme | - | 1 to 5 % | 3.1 %
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations

BASES = {
    "quintic": "{kind: finite_element, elements: 1, order: quintic}",
    "cubic": "{kind: finite_element, elements: 4, order: cubic}",
    "craig_bampton": "{kind: craig_bampton, internal: 2}",
}
FREQUENCIES = (1.524, 2.677, 4.544, 7.450, 8.224, 13.30)  # [Hz] undeformed, no preload
LOADED = (1.2913, 2.5416, 3.9969, 7.3804, 7.8485, 12.7386)  # [Hz] about the equilibrium; ours
WEIGHT_TORQUE = 0.11296  # [N m] of each motor in the undeformed pose


@cache
def mechanism(basis: str) -> pf.Mechanism:
    return pf.load("3rrs", [f"flexible.*.basis={BASES[basis]}"])


@cache
def frequencies(basis: str, preload: str) -> Array:
    return pf.modes(mechanism(basis), preload=preload).frequencies[:6]


def platform_height(m: pf.Mechanism, y: Array) -> float:
    d, here = Equations(m.flexible), m.frame("platform")
    pin.forwardKinematics(d.model, d.data, d.at(y).Q[0])
    return float((d.data.oMi[here.joint] * here.placement).translation[2])


def platform_velocity(m: pf.Mechanism, dy: Array) -> Array:
    """Linear displacement of the platform's centre for small coordinates dy, shape (3,)."""
    d, here = Equations(m.flexible), m.frame("platform")
    flat = d.at(m.undeformed())
    pin.computeJointJacobians(d.model, d.data, flat.Q[0])
    J = flat.times_map(pin.getJointJacobian(d.model, d.data, here.joint, pin.ReferenceFrame.WORLD))
    twist, at = J @ dy, (d.data.oMi[here.joint] * here.placement).translation
    return np.asarray(twist[:3] + np.cross(twist[3:], at))


@pytest.mark.parametrize("basis", BASES)
def test_linear_statics_give_the_sag_and_the_drive_moment(basis: str) -> None:
    m = mechanism(basis)
    found = pf.linear_statics(m)
    sag = platform_velocity(m, Equations(m.flexible).difference(m.undeformed(), found.y))
    assert sag[2] == pytest.approx(-3.706e-3, rel=3e-3)
    np.testing.assert_allclose(sag[:2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.abs(found.r[m.flexible.motors]), WEIGHT_TORQUE, rtol=3e-3)


@pytest.mark.parametrize("basis", BASES)
def test_the_full_equilibrium_sags_five_per_cent_more(basis: str) -> None:
    """Deflections of 2.5 % of the links are not small; values of our own, alike in every basis."""
    m = mechanism(basis)
    rest = pf.static_equilibrium(m)
    assert platform_height(m, rest.y) - 0.237 == pytest.approx(-3.8894e-3, rel=1e-4)
    np.testing.assert_allclose(np.abs(rest.r[m.flexible.motors]), 0.11647, rtol=1e-4)
    d = Equations(m.flexible)
    still = np.zeros(m.flexible.nv)
    left = d.residual(rest.y, still, still, rest.lam, 0.0).r[m.flexible.free]
    assert np.abs(left).max() < 1e-10  # [N m] of 0.1
    assert np.abs(d.close(rest.y)[0]).max() < 1e-11  # [m]


@pytest.mark.parametrize("basis", BASES)
def test_the_six_frequencies_are_those_of_the_linear_frame(basis: str) -> None:
    found = frequencies(basis, "none")
    np.testing.assert_allclose(found, FREQUENCIES, rtol=5e-3)


def test_the_three_bases_agree_far_beyond_that() -> None:
    for preload in ("none", "gravity"):
        found = [frequencies(basis, preload) for basis in BASES]
        np.testing.assert_allclose(found[1], found[0], rtol=1e-5)
        np.testing.assert_allclose(found[2], found[0], rtol=1e-4)


@pytest.mark.parametrize("basis", BASES)
def test_its_own_weight_softens_the_machine(basis: str) -> None:
    """Gravity preload takes 15 % off the first frequency, 1 to 12 % off the others."""
    found = frequencies(basis, "gravity")
    np.testing.assert_allclose(found, LOADED, rtol=2e-4)
    assert np.all(found < np.array(FREQUENCIES))


def test_every_link_shares_in_the_motion_of_a_symmetric_machine() -> None:
    found = pf.modes(mechanism("craig_bampton"), preload="none", count=6)
    np.testing.assert_allclose(found.share.sum(axis=1), 1.0, rtol=1e-12)
    cranks = [found.links.index(f"crank_{leg}") for leg in (1, 2, 3)]
    distals = [found.links.index(f"distal_{leg}") for leg in (1, 2, 3)]
    # Heave and yaw of the platform load all three legs alike; tilting and sliding cannot.
    alike = [np.ptp(row[cranks]) < 1e-6 and np.ptp(row[distals]) < 1e-6 for row in found.share]
    assert sum(alike) == 2


@pytest.fixture(scope="module")
def published_run() -> dict[str, pf.Result]:
    m = pf.load("3rrs")
    rigid = pf.solve(m, level="rigid", samples=101)
    linear = pf.solve(m, level="ked", ked="structural", samples=101)
    return {"rigid": rigid, "ked": linear}


def test_the_classical_method_gives_back_the_numbers_the_trajectory_was_fitted_to(
    published_run: dict[str, pf.Result],
) -> None:
    rigid, linear = published_run["rigid"], published_run["ked"]
    deviation = linear.deviation_from(rigid, "platform")
    # The fit itself is good to 5 %, the step of 0.01 s to another 4 %.
    assert deviation.position[:, 2].min() == pytest.approx(-7.2e-3, rel=0.06)
    assert deviation.rotation[:, 1].min() == pytest.approx(-0.055, rel=0.03)
    torque = np.abs(linear.torque[:, 2])
    assert torque.max() == pytest.approx(0.2246, rel=0.05)
    assert torque.mean() == pytest.approx(0.1053, rel=0.05)
    # The sudden load swings to about twice the static torque.
    assert 1.7 < torque.max() / WEIGHT_TORQUE < 2.2


def test_a_quarter_of_the_published_step_moves_the_extreme_by_some_per_cent() -> None:
    """Newmark at 0.01 s is visibly coarse for 13 Hz: reported, not hidden."""
    m = pf.load("3rrs")
    rigid = pf.solve(m, level="rigid", samples=101)

    def drop(dt: float) -> float:
        r = pf.solve(m, level="ked", ked="structural", dt=dt, samples=101)
        return float(r.deviation_from(rigid, "platform").position[:, 2].min())

    assert 0.01 < drop(0.0025) / drop(0.01) - 1 < 0.05  # measured 3.1 %


def test_tilted_the_published_machine_finds_no_equilibrium() -> None:
    """Beyond linear theory: under its weight the tilted platform has nothing to rest on."""
    with pytest.raises(pf.ConvergenceError, match="no equilibrium") as caught:
        pf.solve(pf.load("3rrs"), level="quasistatic", samples=201)
    result = caught.value.result
    assert result is not None
    assert 0.55 < result.t[-1] < 0.62  # [s] measured 0.595
