"""The system of equations of one step, by name, against closed forms.

Claims:
    Tolerances, collocation
    - the system of equations of one step, M, C, K, J, r, c by name | trapezoidal rule on Euler and
      Bernoulli's first mode; the plain reference | 1e-3; 1e-10 (C, K 1e-6, differences) | passes
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.integrators.problem import build_step
from pinflex.mechanics.reference.evaluator import Reference

_FIRST = 1.87510407  # root of cos x cosh x = -1


def test_one_step_is_that_of_the_first_mode_of_a_clamped_beam() -> None:
    """The trapezoidal rule turns x into x (1 - k) / (1 + k), k = (omega h / 2)^2, from rest.

    omega is Euler and Bernoulli's: 1.8751^2 sqrt(EI / rho A) / L^2.
    """
    m = pf.load("cantilever", ["gravity=[0, 0, 0]"])
    part = m.parts["beam"]
    section, material = part.spec.section, part.spec.material
    stiffness = material.E * min(section.Iy, section.Iz)  # it lies flat
    omega = (_FIRST / part.length) ** 2 * np.sqrt(stiffness / (material.rho * section.A))
    shape = pf.modes(m, preload="none").shapes[:, 0]
    size, h = 1e-6 * shape, 0.3 / omega  # so small that it is linear
    y = m.undeformed() + size
    now, left, (M, C, K, J) = build_step(m, y, np.zeros_like(size), h)
    assert not len(J)
    free = m.loose.free
    # Newmark's gamma = 1/2, beta = 1/4: dv = gamma h da, dy = beta h^2 da
    S = (M + 0.5 * h * C + 0.25 * h**2 * K)[np.ix_(free, free)]
    end = now.y[free] - 0.25 * h**2 * np.linalg.solve(S, left.r[free])
    k = (0.5 * omega * h) ** 2
    # shapes of few elements: 1e-3 of omega, times k
    np.testing.assert_allclose(end, size[free] * (1 - k) / (1 + k), atol=1e-3 * abs(size).max())


@pytest.mark.parametrize("model", ["3rrr", "delta"])
def test_its_parts_are_those_of_the_plain_reference(model: str) -> None:
    m, rng = pf.load(model), np.random.default_rng(3)
    v = 0.1 * rng.standard_normal(m.flexible.nv)
    now, left, matrices = build_step(m, m.undeformed(), v, 1e-3)
    at = now.v, now.a, now.lam
    r, c = Reference(m.loose).residual(*(x[None] for x in (now.y, *at)), np.array([1e-3]))
    np.testing.assert_allclose(left.r, r[0], atol=1e-10 * np.abs(r).max())
    np.testing.assert_allclose(left.c, c[0], atol=1e-12)  # of a metre
    tangent = Reference(m.loose).tangent(now.y, *at, 1e-3)
    for name, limit in (
        ("M", 1e-11),
        ("C", 1e-6),
        ("K", 1e-6),
        ("J", 1e-11),
    ):  # C, K by differences
        found, plain = getattr(matrices, name), getattr(tangent, name)
        np.testing.assert_allclose(found, plain, atol=limit * np.abs(plain).max(), err_msg=name)
