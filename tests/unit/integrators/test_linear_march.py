"""The methods for linear, time-varying systems: order, closures, stability, truncation.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - central differences: the last acceleration, looking back | closed form | order 2 +- 0.1 |
      passes
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from papers.classical import (
    central_difference,
    houbolt,
    mode_superposition,
    stable_step,
    wilson_theta,
)

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.integrators.collocation import At, Instant, Method, alpha, newmark
from pinflex.linalg import saddle
from tests.finite import slope

METHODS: dict[str, Method] = {
    "newmark": partial(alpha, newmark()),
    "central_difference": central_difference,
    "houbolt": houbolt,
    "wilson_theta": wilson_theta,
    "mode_superposition": mode_superposition,
}
OMEGA, ZETA, DRIVE = 2 * np.pi, 0.05, 3.0  # [rad/s], [-], [rad/s]


def oscillator(h: float) -> At:
    """x'' + 2 zeta omega x' + omega^2 x = 5 cos(3 t)."""

    def at(k: int) -> Instant:
        load = np.array([-5 * np.cos(DRIVE * k * h)])
        C = np.array([[2 * ZETA * OMEGA]])
        return Instant(np.eye(1), C, np.array([[OMEGA**2]]), load, np.zeros((0, 1)))

    return at


def exact(t: Array) -> tuple[Array, Array]:
    """Displacement and velocity of the oscillator from x = 1 at rest."""
    steady = 5 / (OMEGA**2 - DRIVE**2 + 2j * ZETA * OMEGA * DRIVE)
    pole = OMEGA * (-ZETA + 1j * np.sqrt(1 - ZETA**2))
    x0, v0 = 1 - steady.real, -(1j * DRIVE * steady).real
    free = x0 - 1j * (v0 - pole.real * x0) / pole.imag
    x = (steady * np.exp(1j * DRIVE * t)).real + (free * np.exp(pole * t)).real
    v = (1j * DRIVE * steady * np.exp(1j * DRIVE * t)).real + (pole * free * np.exp(pole * t)).real
    return x, v


def errors(march: Method, scene: Callable[[float], At], counts: tuple[int, ...]) -> Array:
    found = []
    for n in counts:
        states = list(march(scene(1 / n), n + 1, 1 / n, np.array([1.0])))
        x, v = exact(np.linspace(0, 1, n + 1))
        d = np.abs([s.d[0] for s in states] - x).max()
        found.append((d, np.abs([s.v[0] for s in states] - v).max()))
    return np.array(found).T


def test_the_last_acceleration_of_central_differences_is_of_second_order_too() -> None:
    """There nothing lies ahead, and differences look back."""
    (x, v), gaps, counts = (f.item() for f in exact(np.array([1.0]))), [], (64, 128, 256)
    a = 5 * np.cos(DRIVE) - 2 * ZETA * OMEGA * v - OMEGA**2 * x
    for n in counts:
        *_, last = central_difference(oscillator(1 / n), n + 1, 1 / n, np.array([1.0]))
        gaps.append(abs(last.a.item() - a))
    assert slope([1 / n for n in counts], gaps) == pytest.approx(2.0, abs=0.1)
    assert gaps[-1] < 0.01 * abs(a)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_is_of_second_order_on_an_oscillator(name: str) -> None:
    counts = (64, 128, 256)
    for error in errors(METHODS[name], oscillator, counts):
        # Houbolt's third differences reach their order slowly.
        assert slope([1 / n for n in counts], error) == pytest.approx(2.0, abs=0.1)
        assert error[-1] < 0.01


def test_the_published_newmark_is_of_first_order() -> None:
    """gamma = 0.5280 damps: the error falls with the step only."""
    counts = (256, 512, 1024)
    error = errors(partial(alpha, newmark(0.5280, 0.2642)), oscillator, counts)[0]
    assert slope([1 / n for n in counts], error) == pytest.approx(1.0, abs=0.1)


def guided(h: float) -> At:
    """A unit mass between springs on a straight guide that turns: J(t) d = 0."""

    def at(k: int) -> Instant:
        angle = 0.5 * (1 - np.cos(2 * k * h))
        J = np.array([[-np.sin(angle), np.cos(angle)]])
        load = -5 * np.array([np.cos(3 * k * h), 0.3])
        return Instant(np.eye(2), 0.1 * np.eye(2), OMEGA**2 * np.eye(2), load, J)

    return at


def along_guide(t: Array) -> Array:
    """Distance z along the guide: z'' + 0.1 z' + (omega^2 - angle'^2) z = e(t) . load."""
    from scipy.integrate import solve_ivp

    def rate(s: float, state: Array) -> list[float]:
        angle, turn = 0.5 * (1 - np.cos(2 * s)), np.sin(2 * s)
        load = 5 * (np.cos(3 * s) * np.cos(angle) + 0.3 * np.sin(angle))
        z, zd = state
        return [zd, load - 0.1 * zd - (OMEGA**2 - turn**2) * z]

    run = solve_ivp(rate, (0, t[-1]), [1.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-12)
    return np.asarray(run.y[0])


@pytest.mark.parametrize("name", METHODS)
def test_a_turning_closure_is_followed_with_its_centrifugal_term(name: str) -> None:
    counts, error = (64, 128, 256), []
    for n in counts:
        states = list(METHODS[name](guided(1 / n), n + 1, 1 / n, np.array([1.0, 0.0])))
        t = np.linspace(0, 1, n + 1)
        angle = 0.5 * (1 - np.cos(2 * t))
        line = np.column_stack([np.cos(angle), np.sin(angle)])
        error.append(np.abs([s.d for s in states] - line * along_guide(t)[:, None]).max())
    assert slope([1 / n for n in counts], error) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("name", ["houbolt", "wilson_theta", "mode_superposition"])
def test_the_multiplier_is_the_force_of_the_guide(name: str) -> None:
    """lam = n . (M a + C v + K d + r), from the exact motion along the guide."""
    n = 2048
    states = list(METHODS[name](guided(1 / n), n + 1, 1 / n, np.array([1.0, 0.0])))
    k = n // 2
    now, state = guided(1 / n)(k), states[k]
    d = np.array([s.d for s in states[k - 2 : k + 3]])
    a = (-d[0] + 16 * d[1] - 30 * d[2] + 16 * d[3] - d[4]) * n**2 / 12
    force = now.J @ (now.M @ a + now.C @ state.v + now.K @ state.d + now.r)
    # 1e-3: second order at h = 5e-4 with rates of about 2 pi.
    np.testing.assert_allclose(state.lam, force, rtol=1e-3)


def test_central_difference_names_its_longest_step() -> None:
    assert stable_step(oscillator(0.1)(0)) == pytest.approx(2 / OMEGA, rel=1e-12)
    with pytest.raises(DescriptionError, match=r"stable below 2 / omega_max = 0\.318 s"):
        list(central_difference(oscillator(0.33), 10, 0.33, np.array([1.0])))
    last = list(central_difference(oscillator(0.31), 400, 0.31, np.array([1.0])))[-1]
    assert abs(last.d[0]) < 1.0  # just below the limit it stays bounded


@pytest.mark.parametrize("theta", [1.0, 1.36])
def test_wilsons_theta_below_its_stable_range_is_refused(theta: float) -> None:
    with pytest.raises(DescriptionError, match=r"1\.37"):
        list(wilson_theta(oscillator(0.01), 5, 0.01, np.array([1.0]), theta=theta))


def test_modes_left_out_follow_statically() -> None:
    """A stiff oscillator beside a soft one: one mode gives the soft motion, the rest statically."""
    M, K = np.eye(2), np.diag([OMEGA**2, (200 * OMEGA) ** 2])

    def at(k: int) -> Instant:
        load = -np.array([1.0, 1e4]) * np.sin(k * 0.01) ** 2
        return Instant(M, 0.02 * OMEGA * M, K, load, np.zeros((0, 2)))

    one = list(mode_superposition(at, 201, 0.01, np.zeros(2), modes=1))
    all_of_them = list(mode_superposition(at, 201, 0.01, np.zeros(2)))
    soft, every = (np.array([s.d for s in run]) for run in (one, all_of_them))
    np.testing.assert_allclose(soft[:, 0], every[:, 0], atol=1e-12)
    static = 1e4 * np.sin(np.arange(201) * 0.01) ** 2 / K[1, 1]
    np.testing.assert_allclose(soft[:, 1], static, atol=1e-12)
    # What a mode of 200 Hz adds to its static part under this slow load: (2 / omega)^2 of it.
    np.testing.assert_allclose(every[:, 1], static, atol=2e-5 * static.max())


def test_a_start_is_not_divided_by_round_off_of_a_mass() -> None:
    """Two twists in series with all inertia beyond both: only their sum has a mass.

    M has 1e-16 of it in their difference, by which a load of round-off would be divided to 1.
    """
    M = 0.08 * np.array([[1.0, 1.0 - 1e-16], [1.0 - 1e-16, 1.0 + 2.2e-16]])
    load = 0.08 * np.array([1.0, 1.0 + 4e-16])
    a, _ = saddle(M, np.zeros((0, 2)), np.zeros((0, 2)), load, np.zeros(0))
    np.testing.assert_allclose(a, [0.5, 0.5], atol=1e-12)  # round-off of sums of products


def test_saddles_with_mass_are_solved_and_with_rows_on_no_mass_too() -> None:
    """A mass of 2 kg held to another without any: a = 3 / 2, and the rest follows the closure."""
    J = np.array([[1.0, -1.0]])
    a, lam = saddle(np.diag([2.0, 0.0]), J, J, np.array([3.0, 0.0]), np.zeros(1))
    np.testing.assert_allclose([*a, *lam], [1.5, 1.5, 0.0], atol=1e-14)


@pytest.mark.parametrize("noise", [0.0, 1e-44, -1e-31, 1e-20])
def test_the_round_off_of_a_hinge_without_stiffness_is_no_scale(noise: float) -> None:
    """A force f on a hinge that bends a rod over an arm l: it turns by f / (k l^2)."""
    k, arm, f = 1e6, 0.3, 2.0
    A, J = np.diag([noise, k]), np.array([[arm, -1.0]])
    (turn, bend), lam = saddle(A, J, J, np.array([f, 0.0]), np.zeros(1))
    # 1e-12: round-off, times the condition of the scaled matrix, 1e3
    np.testing.assert_allclose([turn, bend, lam[0]], [f / (k * arm**2), f / (k * arm), -f / arm],
                               rtol=1e-12)  # fmt: skip
