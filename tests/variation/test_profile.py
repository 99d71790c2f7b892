"""Ends of confidence intervals: published and closed ones, and those of a robot another way.

Claims:
    Derivatives, designs, scatter, fits
    - ends of intervals where the search gives up; what cannot be had is said to be unsure |
      published (Bates, Watts) | a hundredth of half the width | passes
    - intervals each alone and all at once of straight residuals, scale known or estimated, 4000
      sets | 0.95 | three standard errors | passes
    - ends of profiles: enzyme kinetics (Bates, Watts 1988) | closed form in one number, R's
      `confint` | 1 % of half the width; 2e-4 | 2.5e-4
    - one data set of the ur5, 2 % of noise: S at the told ends with the others fitted again |
      stiffness matrices summed | 6 % of z^2 | passes
    - straight residuals: no profile, two designs a parameter; an end that the data do not tell, or
      past which nothing can be built | closed form | 1e-9; 1 % | passes
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh, expm
from scipy.optimize import brentq, least_squares
from scipy.stats import norm

import pinflex as pf
from pinflex.variation import profile
from pinflex.variation.profile import Best, ends, quantile
from pinflex.variation.variants import variants
from tests.variation.summed import Summed

# Rates of an enzyme treated with puromycin against concentration [ppm]: Treloar 1974, in Bates and
# Watts 1988, table A1.3; rate = V c / (K + c).
CONCENTRATION = np.repeat([0.02, 0.06, 0.11, 0.22, 0.56, 1.10], 2)
RATE = np.array([76, 47, 97, 107, 123, 139, 159, 152, 191, 201, 207, 200.0])
FIRST = np.array([205.0, 0.08])
WIDE = np.array([[-2.3, 2.3]] * 2)


def best_of(rows, n, J=None):
    """The least squares of rows, with derivatives by differences."""
    found = least_squares(rows, np.zeros(n), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return Best(found.x, found.fun, found.jac, np.linalg.inv(found.jac.T @ found.jac))


def test_intervals_of_a_published_problem():
    def rate(x):
        V, K = FIRST * np.exp(x)
        return V * CONCENTRATION / (K + CONCENTRATION) - RATE

    plain = best_of(rate, 2)
    s, t = np.sqrt(plain.r @ plain.r / 10), quantile(10)
    calls = []

    def rows(x):
        calls.append(x)
        return rate(x) / s

    best = Best(plain.x, plain.r / s, plain.J / s, s**2 * plain.C)
    found = ends(rows, best, WIDE, t)
    low, high = FIRST[1] * np.exp(found.x[1])

    # V is linear once K is held: its best value and S are closed, and the ends roots of one number
    def rise(K):
        c = CONCENTRATION / (K + CONCENTRATION)
        r = RATE - c * (c @ RATE) / (c @ c)
        return (r @ r - plain.r @ plain.r) / s**2 - t**2

    K = FIRST[1] * np.exp(plain.x[1])
    exact = brentq(rise, 0.3 * K, K), brentq(rise, K, 3 * K)
    # S is met within 2 % of t^2, so ends within a hundredth of half the width
    assert (low, high) == pytest.approx(exact, abs=0.01 * (exact[1] - exact[0]) / 2)
    assert exact == pytest.approx((0.04692517, 0.08615995), rel=2e-4)  # R: by splines
    # V is straight enough: its linear interval is within a tenth of the published 197.30 to 229.29
    assert found.profiled == (False, True)
    assert FIRST[0] * np.exp(found.x[0]) == pytest.approx([197.30, 229.29], abs=0.1 * 16)
    assert len(calls) < 25


def test_straight_rows_are_not_profiled():
    A = np.array([[1.0, 2.0], [3.0, -1.0], [0.5, 1.0]])
    best = best_of(lambda x: A @ x - [0.1, 0.2, 0.3], 2)
    calls = []

    def rows(x):
        calls.append(x)
        return A @ x - [0.1, 0.2, 0.3]

    found = ends(rows, best, WIDE, quantile(None))
    half = norm.ppf(0.975) * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    np.testing.assert_allclose(found.x, best.x[:, None] + half[:, None] * [-1, 1], rtol=1e-9)
    assert found.profiled == (False, False) and len(calls) == 4  # both ends of each


@pytest.mark.parametrize("known", [True, False])
def test_intervals_all_at_once_hold_as_often_as_told(known):
    # Straight rows, twelve data and four parameters, 4000 data sets of a fixed seed.
    rng = np.random.default_rng(5)
    A, noise = rng.standard_normal((12, 4)), rng.standard_normal((4000, 12))
    C = np.linalg.inv(A.T @ A)
    off = noise @ A @ C  # of the best values
    left = np.sum((noise - off @ A.T) ** 2, axis=1) / 8
    s = 1.0 if known else np.sqrt(left)[:, None]
    spread = s * np.sqrt(np.diag(C))

    def held(count):
        inside = np.abs(off) < quantile(None if known else 8, count) * spread
        return np.all(inside, axis=1).mean(), inside.mean(axis=0)

    # 0.95 within three standard errors of 4000 sets, 0.0035 each
    assert held(1)[1] == pytest.approx(0.95, abs=0.0105)
    assert held(1)[0] < 0.9 and held(4)[0] > 0.95 - 0.0105
    # the region itself: off' C^-1 off within the square of the quantile
    limit = (quantile(None if known else 8, 4) * np.ravel(s)) ** 2
    inside = np.einsum("ki,ij,kj->k", off, A.T @ A, off) < limit
    assert inside.mean() == pytest.approx(0.95, abs=0.0105)


def test_a_fit_tells_intervals_that_hold_all_at_once():
    robot = pf.load("ur5")
    f = pf.modes(robot, count=4).frequencies
    data, keys = {"frequency": f, "std": 1e-4 * f}, ["flexible.*.material.E"]
    each, both = pf.fit(robot, data, keys), pf.fit(robot, data, keys, simultaneous=True)
    assert not np.any((*each.profiled, *both.profiled))
    widths = [np.log(found.intervals[:, 1] / found.intervals[:, 0]) for found in (each, both)]
    # chi^2 with two freedoms is -2 ln(1 - p)
    ratio = np.sqrt(-2 * np.log(0.05)) / norm.ppf(0.975)
    np.testing.assert_allclose(widths[1] / widths[0], ratio, rtol=1e-6)  # of roots found to 1e-9
    assert "95 % confidence, all at once" in both.text() and both.as_json()["simultaneous"]
    assert "all at once" not in each.text()
    assert "Every parameter is told" in each.text()
    for end in (0, np.inf):  # an end that is not told
        intervals = each.intervals.copy()
        intervals[0, int(end > 0)] = end
        assert "Every parameter is told" not in replace(each, intervals=intervals).text()


@pytest.mark.parametrize("floor", [-9.0, -0.95, -0.5])
def test_an_end_that_the_data_do_not_tell(floor):
    # 1 - exp(-3 e^x) saturates: 0.9 with a standard deviation of 0.1 is 1 within the quantile,
    # and the lower end, -0.90, is where it is z standard deviations less. Below `floor` there is
    # nothing: a step across it is taken back, and from -0.5 on there is no end.
    def rows(x):
        if x[0] < floor:
            return None
        return np.array([(1 - np.exp(-3 * np.exp(x[0])) - 0.9) / 0.1])

    x = np.array([np.log(-np.log(0.1) / 3)])
    J = np.array([[10 * 0.1 * -np.log(0.1)]])
    found = ends(rows, Best(x, rows(x), J, 1 / J**2), np.array([[-2.3, 2.3]]), quantile(None))
    exact = np.log(-np.log(0.1 + 0.1 * norm.ppf(0.975)) / 3)
    low, high = found.x[0]
    assert found.profiled == (True,) and high == np.inf
    assert low == (-np.inf if floor > exact else pytest.approx(exact, abs=0.01 * (x[0] - exact)))


@pytest.mark.parametrize("steps", [0, 1, 40])
def test_a_search_that_gives_up_is_followed_by_fits_with_the_parameter_held(monkeypatch, steps):
    # The published problem again; `steps` is how far the sequence of small problems may go.
    monkeypatch.setattr(profile, "_MOST", steps)

    def rate(x):
        V, K = FIRST * np.exp(x)
        return V * CONCENTRATION / (K + CONCENTRATION) - RATE

    plain = best_of(rate, 2)
    s = np.sqrt(plain.r @ plain.r / 10)
    best = Best(plain.x, plain.r / s, plain.J / s, s**2 * plain.C)
    found = ends(lambda x: rate(x) / s, best, WIDE, quantile(10))
    # As published, within a hundredth of half the width (0.02)
    assert FIRST[1] * np.exp(found.x[1]) == pytest.approx([0.04692517, 0.08615995], abs=2e-4)
    assert found.unsure == ((False, False), (False, False))
    narrow = np.array([WIDE[0], plain.x[1] + np.array([-0.1, 0.1])])  # bounds within the limit
    found = ends(lambda x: rate(x) / s, best, narrow, quantile(10))
    assert np.all((found.x[1] < narrow[1, 0]) | (found.x[1] > narrow[1, 1]))
    assert not any(found.unsure[1])


def test_an_end_that_cannot_be_had_is_said_to_be_unsure(monkeypatch):
    # S jumps from inside to outside the limit, at -0.4: no point meets it.
    monkeypatch.setattr(profile, "_MOST", 0)

    def rows(x):
        return np.array([x[0] + 0.3 * x[0] ** 2 if x[0] > -0.4 else 50.0])

    best = Best(np.zeros(1), np.zeros(1), np.ones((1, 1)), np.ones((1, 1)))
    found = ends(rows, best, WIDE[:1], quantile(None))
    assert found.unsure == ((True, False),)
    exact = (np.sqrt(1 + 1.2 * quantile(None)) - 1) / 0.6  # x + 0.3 x^2 = z
    assert found.x[0, 1] == pytest.approx(exact, rel=0.02)


def test_no_scale_no_ends():
    best = Best(np.zeros(1), np.zeros(1), np.ones((1, 1)), np.ones((1, 1)))
    assert np.all(np.isnan(ends(lambda x: x, best, WIDE[:1], quantile(0)).x))


def test_four_drives_and_two_moduli_of_the_ur5_with_noise():
    stiffness = {"shoulder_pan_joint": 2.0e4, "shoulder_lift_joint": 1.6e4, "elbow_joint": 1.0e4,
                 "wrist_1_joint": 4.0e3}  # fmt: skip
    drives = [f"joints.{joint}.drive={{stiffness: {k}, gear: 101, motor_inertia: 1.0e-4}}"
              for joint, k in stiffness.items()]  # fmt: skip
    designs = variants(
        pf.load("ur5", drives), ["joints.*.drive.stiffness", "flexible.*.material.E"]
    )
    sensors = ("forearm_link", "wrist_1_link", "tool0")
    summed = Summed(designs, sensors)
    std = 0.02 * summed.frequencies
    measured = summed.frequencies + std * np.random.default_rng(1).standard_normal(6)
    names = [f"{sensor}.{axis}" for sensor in sensors for axis in "xyz"]
    data = {"frequency": measured, "std": std, **dict(zip(names, summed.shapes.T, strict=True))}
    found = pf.fit(designs.source, data, [parameter.key for parameter in designs.parameters])
    low, high = found.intervals.T
    assert np.all((low < designs.first) & (designs.first < high))  # 7 of 10 such sets at least
    assert all(found.profiled)
    assert "Intervals are of the profile likelihood" in found.text()
    # the others fitted again with stiffness matrices summed: S rises by the square of the quantile
    place = np.log(found.best / designs.first)
    least = summed.least(measured, std, starts=[place])[0]
    for k in (1, 2):
        for end in np.log(found.intervals[k] / designs.first[k]):
            rise = summed.least(measured, std, (k, end), [place])[0] - least
            # 2 % of what is sought, and 4e-4 of frequencies in standard deviations of 2 %
            assert rise == pytest.approx(norm.ppf(0.975) ** 2, rel=0.06)


LENGTH, WIDTH, DEPTH, DENSITY, BETA = 0.8, 0.03, 0.004, 7850.0, 2e-4  # m, kg/m^3, s
TRUTH, START = (1.93e11, 260.0, 0.23), np.array([2.1e11, 400.0, 0.2])  # E, k of the hub, tip mass


def tip(E, k, m, t, elements=8, count=6):
    """Tip of a beam on a hub spring that a motor turns by 0.02 in 0.12 s: Hermite elements.

    Modes, first-order hold of the acceleration between the samples, damping BETA of the beam.
    """
    size, I = LENGTH / elements, WIDTH * DEPTH**3 / 12  # noqa: E741
    a, b, n = 6 * size, size * size, 2 * (elements + 1)
    stiff = [[12, a, -12, a], [a, 4 * b, -a, 2 * b], [-12, -a, 12, -a], [a, 2 * b, -a, 4 * b]]
    c, d = 22 * size, 13 * size
    heavy = [[156, c, 54, -d], [c, 4 * b, d, -3 * b], [54, d, 156, -c], [-d, -3 * b, -c, 4 * b]]
    K, M, rigid = np.zeros((n, n)), np.zeros((n, n)), np.ones(n)
    for at in range(0, n - 2, 2):
        K[at : at + 4, at : at + 4] += E * I / size**3 * np.array(stiff)
        M[at : at + 4, at : at + 4] += DENSITY * WIDTH * DEPTH * size / 420 * np.array(heavy)
    M[-2, -2] += m
    D, rigid[::2] = BETA * K, np.linspace(0, LENGTH, elements + 1)
    K[1, 1] += k
    w2, V = eigh(K[1:, 1:], M[1:, 1:], subset_by_index=[0, count - 1])
    h = t[1] - t[0]
    big = np.zeros((2 * count + 2, 2 * count + 2))  # Van Loan (1978)
    big[:count, count : 2 * count] = h * np.eye(count)
    big[count : 2 * count, :count] = -h * np.diag(w2)
    big[count : 2 * count, count : 2 * count] = -h * V.T @ D[1:, 1:] @ V
    big[count : 2 * count, -2] = -h * V.T @ M[1:, 1:] @ rigid[1:]
    big[-2, -1] = 1.0
    X = expm(big)[:-2]
    s = np.clip(t / 0.12, 0, 1)
    angle = 0.02 * (10 * s**3 - 15 * s**4 + 6 * s**5)
    u = 0.02 * (60 * s - 180 * s**2 + 120 * s**3) / 0.12**2
    state, found = np.zeros(2 * count), np.zeros(len(t))
    for i in range(1, len(t)):
        state = X[:, :-2] @ state + (X[:, -2] - X[:, -1]) * u[i - 1] + X[:, -1] * u[i]
        found[i] = V[-2] @ state[:count]
    return found + LENGTH * angle


def slopes(rows, x, h=1e-4):
    return np.stack([(rows(x + h * e) - rows(x - h * e)) / (2 * h) for e in np.eye(len(x))], 1)


def least_of(rows, starts, limit):
    """x and S of the best of several fits within +-limit."""
    fits = [
        least_squares(
            rows, np.clip(start, 1e-9 - limit, limit - 1e-9), jac=lambda x: slopes(rows, x),
            bounds=(-limit, limit), x_scale="jac", ftol=1e-10, xtol=1e-10, gtol=1e-10, max_nfev=60,
        )
        for start in starts
    ]  # fmt: skip
    found = min(fits, key=lambda fit: fit.cost)
    return found.x, 2 * found.cost


@pytest.mark.parametrize("seed", [1, 4])
def test_a_history_tells_the_ends_that_other_fits_find(seed):
    """301 samples of a tip with noise of 0.25 % of the swing: E, hub and tip mass in one valley.

    With 1 the valley bends, and a search on its own stops on a branch (E at most 2.003e11 where
    2.035e11 still fits); with 4 the hub has no upper end below ten times its first value.
    """
    t, limit, z = np.linspace(0, 0.6, 301), np.log(10), quantile(None)
    clean = tip(*TRUTH, t, elements=40, count=8)
    std = 0.0025 * np.ptp(clean)
    measured = clean + std * np.random.default_rng(seed).standard_normal(301)

    def rows(x):
        return (tip(*START * np.exp(x), t) - measured) / std

    x, S = least_of(rows, [np.zeros(3), np.array([-0.05, -1, -0.3])], limit)
    J = slopes(rows, x)
    bounds = np.array([[-limit, limit]] * 3)
    found = ends(rows, Best(x, rows(x), J, np.linalg.inv(J.T @ J)), bounds, z)
    assert not np.any(found.unsure)
    assert np.isfinite(found.x).sum() == (6 if seed == 1 else 5)
    for k, side in np.ndindex(3, 2):
        others, end = np.arange(3) != k, found.x[k, side]
        at = end if np.isfinite(end) else bounds[k, side]

        def held(u, others=others, at=at):
            y = np.full(3, at)
            y[others] = u
            return rows(y)

        starts = [x[others], np.zeros(2), np.array([-0.05, -0.8])]
        rise = least_of(held, starts, limit)[1] - S
        if np.isfinite(end):  # 2 % of S where it ends, a share of 1 % of the width where it judges
            assert rise == pytest.approx(z**2, rel=0.1), (k, side)
        else:
            assert rise < z**2, (k, side)
