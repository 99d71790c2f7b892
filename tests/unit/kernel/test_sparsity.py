"""Newton's equations of a collocation step, whatever is zero in them.

Claims:
    Equations
    - Newton's equations of a step, arms side by side, full, a massless coordinate | the equations
      of all stages, by numpy | 1e-13 of the largest term | 3e-15
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.integrators.collocation import radau
from pinflex.integrators.compiled import sorts_of
from pinflex.kernel.library import kernel
from pinflex.kernel.march import Rows, Scheme, StageKernel
from pinflex.mechanics.evaluation.compiled import Compiled

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)

H, STAGES = 0.1, 5  # two pairs of eigenvalues and a real one


def linked(kind: str, n: int, rows: int) -> tuple[Array, Array]:
    """Entries of M, C and K, and of J: of three arms on a shared body, or all."""
    square, across = np.zeros((n, n), bool), np.zeros((rows, n), bool)
    if kind == "full":
        return ~square, ~across
    arm = np.arange(n) * 3 // (n - 6)  # the last six belong to the body
    square[:] = arm[:, None] == arm
    square[-6:] = square[:, -6:] = True
    across[np.arange(rows)[:, None] * 3 // rows == arm] = True
    across[:, -6:] = True
    if kind == "crossed":  # an entry far away, as a spring between arms has it
        square[1, n // 2] = square[n // 2, 1] = True
    return square, across


@pytest.mark.parametrize("kind", ["arms", "crossed", "full", "massless"])
def test_all_stages_are_solved_as_by_the_whole_matrix(kind: str) -> None:
    """Also where a coordinate has neither mass nor stiffness: no pivot of its own serves."""
    system = pf.load("delta").flexible
    m, none, free = radau(STAGES), np.zeros(0, dtype=np.intp), system.free
    scheme = Scheme(m.c, m.A, m.A2, m.A2_inverse, m.values, m.forward, m.back)
    stages = StageKernel(
        Compiled(system).evaluator, scheme, Rows(False, free, none, none, none, *sorts_of(system))
    )
    x, n, rows = stages._keep[1].arrays, len(free), system.closed.n
    rng = np.random.default_rng(1)
    for again in (kind, "full", kind):  # what is known of one pattern serves no other
        square, across = linked(again, n, rows)
        for name in "MCK":
            A = rng.normal(size=(n, n)) * square
            x[name][...] = A @ A.T * square + n * np.eye(n)
        x["C"][...] += 0.1 * rng.normal(size=(n, n)) * square  # friction is not symmetric
        x["J"][...] = rng.normal(size=(rows, n)) * across
        if again == "massless":
            for name in "MCK":
                x[name][3] = x[name][:, 3] = 0.0
        r, gap = rng.normal(size=(STAGES, n)), rng.normal(size=(STAGES, rows))
        x["r"][:, free], x["open"][...] = r, gap
        stages._structure.h = H
        assert stages.functions.pinflex_factor(stages.tables, stages.address)
        stages.functions.pinflex_solve(stages.tables, stages.address)
        dz, dlam = x["change"][:, free], x["dlam"]
        # A^-2 M dz + h A^-1 C dz + h^2 K dz - J' dlam = -r, J dz = -c / h^2, stage by stage
        inverse = np.linalg.inv(m.A)
        first = inverse @ inverse @ dz @ x["M"].T
        left = first + H * inverse @ dz @ x["C"].T + H**2 * dz @ x["K"].T - dlam @ x["J"]
        # round-off of the largest term, and of a hundred that are summed up
        assert left == pytest.approx(-r, abs=1e-13 * np.abs(first).max())
        assert dz @ x["J"].T == pytest.approx(-gap / H**2, abs=1e-12 / H**2)
