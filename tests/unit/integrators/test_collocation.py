"""Radau IIA: nodes, weights and order, without any mechanism.

Claims:
    Tolerances, collocation
    - weights exact for polynomials, step to degree 2 s - 2, 2 to 7 stages | calculus; Hairer,
      Wanner | 1e-11 | passes
    - order 2 s - 1 on an oscillator by hand, 2 to 5 stages | cosine | +- 0.15 | passes
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from pinflex.integrators.collocation import radau
from tests.finite import slope

STAGES = range(2, 8)
ROUNDING = 1e-11  # the inverse of a Vandermonde matrix of 7 nodes has entries of 1e4


def test_two_and_three_stages_are_the_published_ones() -> None:
    """Hairer and Wanner 1996, tables IV.5.5 and IV.5.6."""
    s = np.sqrt(6)
    np.testing.assert_allclose(radau(2).c, [1 / 3, 1], atol=1e-15)
    np.testing.assert_allclose(radau(2).A, [[5 / 12, -1 / 12], [3 / 4, 1 / 4]], atol=1e-14)
    np.testing.assert_allclose(radau(3).c, [(4 - s) / 10, (4 + s) / 10, 1], atol=1e-15)
    np.testing.assert_allclose(radau(3).A[-1], [(16 - s) / 36, (16 + s) / 36, 1 / 9], atol=1e-14)


@pytest.mark.parametrize("s", STAGES)
def test_stage_integrals_are_exact_for_polynomials_the_last_to_degree_2s_minus_2(s: int) -> None:
    m = radau(s)
    for power in range(s):
        exact = m.c ** (power + 1) / (power + 1)
        np.testing.assert_allclose(m.A @ m.c**power, exact, atol=ROUNDING)
        twice = m.c ** (power + 2) / ((power + 1) * (power + 2))
        # The integral of degree s is itself seen through s nodes: of degree s - 1 but at the end.
        at = slice(None) if power < s - 1 else slice(-1, None)
        np.testing.assert_allclose((m.A2 @ m.c**power)[at], twice[at], atol=ROUNDING)
    for power in range(2 * s - 1):  # the quadrature of the whole step
        assert m.A[-1] @ m.c**power == pytest.approx(1 / (power + 1), abs=ROUNDING)
    short = m.A[-1] @ m.c ** (2 * s - 1) - 1 / (2 * s)
    assert abs(short) > 1e-9  # and of no higher degree


@pytest.mark.parametrize("s", STAGES)
def test_dense_weights_reproduce_polynomials_and_their_integrals(s: int) -> None:
    m, x = radau(s), np.linspace(0, 1, 23)
    p = np.polynomial.Polynomial(np.random.default_rng(s).normal(size=s))
    np.testing.assert_allclose(m.at(x) @ p(m.c), p(x), atol=ROUNDING)
    q = np.polynomial.Polynomial(np.random.default_rng(s).normal(size=s + 1))
    values = np.append(q(0.0), q(m.c))
    first, second, through = m.between(x)
    np.testing.assert_allclose(first @ p(m.c), p.integ()(x), atol=ROUNDING)
    np.testing.assert_allclose(second @ p(m.c), p.integ(2)(x), atol=ROUNDING)
    np.testing.assert_allclose(through @ values, q(x), atol=ROUNDING)


@pytest.mark.parametrize("s", STAGES)
def test_the_last_coefficient_is_that_of_the_legendre_polynomial(s: int) -> None:
    """2 s + 1 times the mean of p P_s over the step, for p of degree s that is 0 at its start."""
    m = radau(s)
    legendre = np.polynomial.Legendre.basis(s, domain=[0, 1])
    p = np.polynomial.Polynomial([0.0, *np.random.default_rng(s).normal(size=s)])
    exact = (2 * s + 1) * quad(lambda x: p(x) * legendre(x), 0, 1)[0]
    assert m.last @ p(m.c) == pytest.approx(exact, abs=ROUNDING)


@pytest.mark.parametrize("s", STAGES)
def test_newtons_eigenvectors_take_the_stages_apart_and_together(s: int) -> None:
    m = radau(s)
    inverse = np.linalg.inv(m.A)
    values, forward, back = (x.view(complex)[..., 0] for x in (m.value, m.forward, m.back))
    assert len(values) == (s + 1) // 2
    for mu, row in zip(values, forward, strict=True):
        np.testing.assert_allclose(row @ inverse, mu * row, rtol=0, atol=1e-9 * abs(mu))
    np.testing.assert_allclose((back @ forward).real, np.eye(s), atol=1e-9)
    rebuilt = (back @ (values[:, None] ** 2 * forward)).real
    np.testing.assert_allclose(rebuilt, m.A2_inverse, rtol=1e-9, atol=1e-9)


def oscillator(s: int, steps: int) -> float:
    """Error after 3 s of x'' = -4 x from x = 1 at rest, by the scheme written out by hand."""
    m, h, w2 = radau(s), 3.0 / steps, 4.0
    x, v = 1.0, 0.0
    for _ in range(steps):
        # a_i = -w2 x_i,  x_i = x + h c_i v + h^2 (A A a)_i
        a = np.linalg.solve(np.eye(s) + w2 * h * h * m.A @ m.A, -w2 * (x + h * m.c * v))
        x, v = x + h * v + h * h * (m.A[-1] @ m.A @ a), v + h * (m.A[-1] @ a)
    return float(np.hypot(x - np.cos(6.0), v / 2 + np.sin(6.0)))


@pytest.mark.parametrize(("s", "steps"), [(2, (24, 48)), (3, (12, 24)), (4, (6, 12)), (5, (4, 8))])
def test_the_order_on_an_oscillator_is_2s_minus_1(s: int, steps: tuple[int, int]) -> None:
    order = -slope(steps, [oscillator(s, n) for n in steps])
    assert order == pytest.approx(2 * s - 1, abs=0.15)  # the next term is of one order more


@pytest.mark.parametrize("s", STAGES)
def test_what_a_step_cannot_resolve_is_annihilated(s: int) -> None:
    """L-stable: the last stage of a step far too long is the equilibrium."""
    m, w2 = radau(s), 1e16
    a = np.linalg.solve(np.eye(s) + w2 * m.A @ m.A, -w2 * np.ones(s))
    assert abs(1.0 + m.A[-1] @ m.A @ a) < 1e-9


@pytest.mark.parametrize("s", [1, 8])
def test_numbers_of_stages_without_digits_are_refused(s: int) -> None:
    with pytest.raises(ValueError, match="2 to 7"):
        radau(s)
