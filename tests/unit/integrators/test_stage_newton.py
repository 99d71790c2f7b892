"""Newton's equations of a step, eigenvalue by eigenvalue and in one piece."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pinflex.integrators.collocation import radau
from pinflex.integrators.stage_newton import StageNewton, Tangent

# Condition of the matrices below, about 1e4, times round-off, with room for other processors.
SOLVED = 1e-9


@pytest.mark.parametrize("s", [5, 6, 7])
@pytest.mark.parametrize("rows", [0, 2])
def test_corrections_solve_the_equations_of_all_stages(s: int, rows: int) -> None:
    """M da_i + C h A_ij da_j + K h^2 A2_ij da_j - J' dlam_i = -r_i and J h^2 A2_ij da_j = -c_i."""
    rng, nv, h, m = np.random.default_rng(10 * s + rows), 7, 0.3, radau(s)
    free, motors = np.array([0, 2, 3, 4, 6]), np.array([1, 5])
    n = len(free)
    M, C, K = rng.normal(size=(3, nv, nv))
    M = M @ M.T + nv * np.eye(nv)
    of = Tangent(M, C, K, rng.normal(size=(rows, nv)), free, motors)
    dynamics = cast(Any, SimpleNamespace(system=SimpleNamespace(motors=motors)))
    newton = StageNewton(dynamics, m, free, None)
    newton.adopt(of)
    newton.factor(h)
    r, c = rng.normal(size=(s, n)), rng.normal(size=(s, rows))

    dz, dlam = newton.step(r, c)

    da = m.A2_inverse @ dz  # dz = A^2 da
    left = da @ of.M.T + h * (m.A @ da) @ of.C.T + h * h * dz @ of.K.T - dlam @ of.J
    np.testing.assert_allclose(left, -r, atol=SOLVED)
    np.testing.assert_allclose(h * h * dz @ of.J.T, -c, atol=SOLVED)


def test_a_singular_matrix_is_told() -> None:
    free, none = np.arange(2), np.zeros(0, dtype=np.intp)
    dynamics = cast(Any, SimpleNamespace(system=SimpleNamespace(motors=none)))
    for M in (np.zeros((2, 2)), np.full((2, 2), np.nan)):
        newton = StageNewton(dynamics, radau(6), free, None)
        newton.adopt(Tangent(M, 0.0 * M, 0.0 * M, np.zeros((0, 2)), free, none))
        with pytest.raises(np.linalg.LinAlgError):
            newton.factor(0.1)
