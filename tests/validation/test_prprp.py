"""The PR-PRP robot of Sharifnia and Akbarzadeh (2016): a flexible platform in a sliding sleeve.

Numbers: scenes 5, 6.3 and 7 (rows 19, 20, 25, 26). The paper shows curves only; these are our own
analyses of what it states (models/prprp/SOURCE.md).

Claims:
    Machines
    - prprp: four frequencies, point / 3 cm | beam elements | 0.1 % / 0.05 % | 0.006 % / 0.045 %
    - static tip, F_A, F_p; 3 cm | statics | 0.1 % | 1e-5; 0.08 %
    - w(0), w(x_p) along six runs | 0 | 1e-10 m | 8e-13 m
    - elements against modes, 1 s, point, cases 1 to 3 | - | 1e-4 m | 9e-6 m
    - the same, 3 cm, 24 elements, 50 modes | - | 1e-4 m | 3.1e-5 m
    - 3 cm, case 1, 30 / 50 / 80 modes against 100 cubic elements | exact in time | > 1e-3 / 1.5e-4
      / 1e-4 m | 3.0e-3 / 1.36e-4 / 8.5e-5 m: 50 modes are not enough
    - a tenth of the load: the coupled run is that sum of modes | exact in time | 1e-5 m | 6e-6 m
    - clamped-root elements differ with the cube of the load | - | 3 +- 0.3 | 3.00; 2.1e-4 m under
      the full load
    - `third_order`: nonlinear part of the tip after 1 s, case 1, point (second order: +146 um) |
      chain of exact kinematics: -107 um | 26 um | -84 um: the sleeve's contact is of second order
    - case 4: vibration above 4 Hz, undamped against controlled | the project | > 25 | 37.7
    - forces as printed grow at 50 modes, transposed ones do not | own analysis | > 1e4, < 1e-2 1/s
      | 8.2e4, 0
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import eigh, null_space

import pinflex as pf
from examples.paper_004 import (
    CASES,
    EI,
    ELEMENTS,
    MODES,
    MU,
    L,
    across,
    controlled,
    fast_part,
    literal_growth,
    tip,
)
from pinflex.arrays import Array
from pinflex.bodies.family import Family, assumed, hermite, quadrature
from tests.finite import slope

POINT = (7.2187, 48.772, 104.39, 159.11)  # [Hz] beam elements
SLEEVE = (7.849, 49.967, 108.59, 172.00)  # [Hz] 3 cm
LOAD = "gravity=[0,0,-10.41]"  # [m/s^2] case 1: weight and the constant acceleration of 0.6 m/s^2
FREE = ELEMENTS.format(8)
FINE = ELEMENTS.format(24)
LARGE = "limit=2"  # times 2 GB of memory, for FINE: 2.8
CLAMPED = "flexible.beam.basis={kind: finite_element, elements: 8, order: quintic}"
FEWER = MODES.format(30)  # 6e-6 m from 50 over a second
STEP = 1e-3  # [s] both bases take the same; its own error is 2e-4 m


@cache
def mechanism(*changes: str) -> pf.Mechanism:
    return pf.load("prprp", changes)


@cache
def run(case: int, sleeve: str, basis: str) -> pf.Result:
    m = mechanism(*CASES[case], f"loops.sleeve.sleeve={sleeve}", basis, LARGE)
    return pf.solve(m, dt=STEP, samples=401)


def frequencies(*changes: str) -> Array:
    return pf.modes(mechanism(*changes), count=4, preload="none").frequencies


def test_frequencies_of_case_1_with_a_point_sleeve() -> None:
    np.testing.assert_allclose(frequencies(), POINT, rtol=1e-3)


def test_frequencies_of_case_1_with_a_sleeve_of_3_cm() -> None:
    np.testing.assert_allclose(frequencies("loops.sleeve.sleeve=0.03"), SLEEVE, rtol=5e-4)


def test_frequencies_by_beam_elements() -> None:
    np.testing.assert_allclose(frequencies(FREE), POINT, rtol=1e-3)


def test_static_tip_and_forces() -> None:
    m = mechanism(LOAD)
    assert static_tip() == pytest.approx(-7.4973e-3, rel=1e-3)
    found = pf.linear_statics(m)
    # The carriages have no mass: what drives them is what the beam needs from them.
    np.testing.assert_allclose(found.r[m.flexible.motors], [2.02995, -0.56839], rtol=1e-3)


def static_tip(*changes: str) -> float:
    m = mechanism(LOAD, *changes)
    family = m.parts["beam"].bodies[0].families["v"]
    eta = pf.linear_statics(m).y[int(m.rigid.rigid.nv) :]
    return float(family.evaluate(np.array([0.5])).f[0] @ eta)


def test_static_tip_with_a_sleeve_of_3_cm() -> None:
    assert static_tip("loops.sleeve.sleeve=0.03") == pytest.approx(-6.3181e-3, rel=1e-3)


def test_a_pivoting_sleeve_is_close_to_the_published_one() -> None:
    pivoting = static_tip("loops.sleeve.sleeve=0.03", "loops.sleeve.pivoting=true")
    # Scenes 5.5: the two differ by less than 1e-4 m.
    assert pivoting == pytest.approx(-6.3181e-3, abs=1e-4)


@pytest.mark.parametrize("sleeve", ["0", "0.03"])
@pytest.mark.parametrize("case", CASES)
def test_the_beam_stays_in_hinge_and_sleeve_all_along(case: int, sleeve: str) -> None:
    r = run(case, sleeve, FEWER)
    family = mechanism(FEWER).parts["beam"].bodies[0].families["v"]
    q, eta = r.arrays["joint/q"], r.arrays["eta"]
    place = 0.18 / np.cos(np.arctan2(q[:, 0] - q[:, 1], 0.18))
    assert np.abs(eta @ family.evaluate(np.zeros(1)).f[0]).max() < 1e-10
    held = np.einsum("tn,tn->t", family.evaluate(place).f, eta)
    assert np.abs(held).max() < 1e-10
    assert r.arrays["residual/closure"].max() < 1e-10


@pytest.mark.parametrize("case", CASES)
def test_beam_elements_and_assumed_modes_agree(case: int) -> None:
    modes, elements = (run(case, "0", basis).frame("tip").position for basis in (FEWER, FREE))
    assert np.abs(modes - elements).max() < 1e-4  # the project's limit; measured 9e-6


def test_they_agree_with_a_sleeve_of_3_cm_too() -> None:
    """50 modes and 24 elements: with 8 or 16 the sleeve is not resolved, 7e-3 and 3e-4 m."""
    modes, elements = (
        run(3, "0.03", basis).frame("tip").position for basis in (MODES.format(50), FINE)
    )
    assert np.abs(modes - elements).max() < 1e-4


def case_1_alone(family: Family, t: Array, sleeve: float) -> Array:
    """Tip in case 1 (m) by a sum of modes, exact in time: a second formulation, linear."""
    x, w = (v.ravel() for v in quadrature(family.breaks, family.gauss))
    F = family.evaluate(x)
    M, K = MU * F.f.T @ (w[:, None] * F.f), EI * F.curv.T @ (w[:, None] * F.curv)
    a = 0.5 * sleeve
    at = family.evaluate(np.array([0.0, 0.18, 0.18 + a, 0.18 - a]))
    rows = [at.f[0], at.f[1]]
    if sleeve:
        rows += [at.f[2] - at.f[1] - a * at.df[1], at.f[3] - at.f[1] + a * at.df[1]]
    Z = null_space(np.array(rows))
    square, V = eigh(Z.T @ K @ Z, Z.T @ M @ Z)
    load = -10.41 * MU * (Z @ V).T @ (F.f.T @ w)
    swing = (1 - np.cos(np.sqrt(square) * t[:, None])) / square
    return np.asarray((swing * load) @ (family.evaluate(np.array([L])).f[0] @ Z @ V))


def test_how_many_modes_a_sleeve_of_3_cm_needs() -> None:
    """Against 100 cubic elements (the article's number): 50 modes are not within 1e-4 m, 80 are."""
    t = np.linspace(0.0, 1.0, 1001)
    fine = case_1_alone(hermite(L, 100, "cubic", "free"), t, 0.03)
    gap = {
        n: np.abs(case_1_alone(assumed(L, "free_free", n), t, 0.03) - fine).max()
        for n in (30, 50, 80)
    }
    assert gap[30] > 1e-3  # 3.0e-3
    assert 1e-4 < gap[50] < 1.5e-4  # 1.36e-4
    assert gap[80] < 1e-4  # 8.5e-5


def test_under_a_tenth_of_the_load_case_1_is_that_sum_of_modes() -> None:
    """Under the full load the second-order terms are worth 1.7e-4 m (scenes 5.5: 1.1e-4)."""
    m = mechanism("gravity=[0,0,-0.441]", FEWER)
    r = pf.solve(m, dt=5e-4, samples=401)
    own = 0.1 * case_1_alone(assumed(L, "free_free", 30), r.t, 0.0)
    # The step turns 7 Hz by (omega h)^2/12 of 45 rad and loses the phase of 100 Hz: 6e-6 of 1.5 mm.
    assert np.abs(tip(r) - own).max() < 1e-5


def test_a_clamped_root_differs_with_the_cube_of_the_deflection() -> None:
    """Not with the number of elements: second-order shapes in a frame tangent at the root.

    2.1e-4 m over a second under the full load, where the frame of the article, along the chord,
    leaves 2e-6.
    """
    loads = 10.41 * np.array([1.0, 0.5, 0.25])  # [m/s^2]
    gap = []
    for load in loads:
        weight = f"gravity=[0,0,{0.6 - load}]"  # the slides accelerate by 0.6 m/s^2
        ends = [
            pf.solve(mechanism(weight, basis), dt=STEP, samples=201).frame("tip").position
            for basis in (CLAMPED, FREE)
        ]
        gap.append(np.abs(ends[0] - ends[1]).max())
    assert slope(loads, gap) == pytest.approx(3.0, abs=0.3)
    assert gap[0] < 3e-4


@pytest.mark.parametrize("case", CASES)
def test_a_longer_sleeve_means_less_deflection(case: int) -> None:
    short, long = (tip(run(case, sleeve, FEWER)) for sleeve in ("0", "0.03"))
    assert np.ptp(long) < np.ptp(short)


def test_forces_of_hinge_and_sleeve_carry_weight_and_inertia() -> None:
    r = run(1, "0", FEWER)
    total = across(r, "slide_1") + across(r, "slide_2")
    # Over nearly seven periods of 7.2 Hz the vibration averages out to 3 % of the load.
    assert total.mean() == pytest.approx(0.2808 * 0.5 * 10.41, rel=0.03)


def test_forces_as_printed_are_unstable_at_50_modes_and_the_transposed_ones_are_not() -> None:
    assert literal_growth(50) > 1e4
    # Round-off of the largest eigenvalue, (1.6e5 rad/s)^2 * 1e-16, seen through a square root.
    assert literal_growth(50, transposed=True) < 1e-2


def test_patches_remove_the_free_vibration() -> None:
    runs = controlled(samples=801)
    before, after = (fast_part(tip(runs[key]), runs[key].t) for key in ("without", "with"))
    assert before > 25.0 * after  # the project's limit; measured 37.7, from an undamped beam
    for r in runs.values():
        assert r.arrays["residual/closure"].max() < 1e-10
        assert r.meta["status"] == "complete"
    volts = [runs["with"].arrays[f"control/pzt_{k}"] for k in (1, 2, 3)]
    # The same measure and gains: equal but for the order of one product.
    np.testing.assert_allclose(volts[0], volts[2], rtol=1e-12, atol=1e-9)
    assert all(np.isfinite(v).all() and np.ptp(v) > 0 for v in volts)


def test_third_order_turns_the_nonlinear_part_of_the_tip_round() -> None:
    """After 1 s of case 1, against a chain of exact kinematics (30 and 50 segments agree): -107 um.

    One body of second order gives +146 um: its frequency falls with the amplitude where it should
    rise. What is left, a tenth of that gap, is the sleeve's contact, which is of second order.
    """

    def tip_at_the_end(load: float, *changes: str) -> float:
        m = mechanism(f"gravity=[0,0,{0.6 - load}]", FREE, *changes)
        place = pf.solve(m, dt=STEP, samples=101).frame("tip").position[:, 2]
        return float(place[-1] - place[0] - 0.3)

    linear = 100 * tip_at_the_end(10.41e-2)
    found = tip_at_the_end(10.41, "flexible.beam.third_order=true") - linear
    assert found == pytest.approx(-107e-6, abs=26e-6)
    assert tip_at_the_end(10.41) - linear > 100e-6
