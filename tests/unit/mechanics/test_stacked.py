"""Residuals of several states at once are those of the states one by one.

Claims:
    Tolerances, collocation
    - residuals of stages together = one by one, all models and a free robot with every joint |
      `Equations` | 1e-12 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model.system import System
from tests.every_model import NAMES, WHICH, at_home, manifold, mechanism
from tests.finite import random_state

# The same sums in another order: round-off of a few hundred terms.
ROUNDING = 1e-12
SIZES = (1, 5)

FORCE = "forces: {pull: {at: hand, force: [1.0, 2.0, 3.0], follower: true, ramp: 2.0}}\n"


def random_states(system: System, home: Array, count: int) -> tuple[Array, Array, Array, Array]:
    states = [random_state(system, home, seed) for seed in range(1, count + 1)]
    Y, V, A, lam = (np.array(part) for part in zip(*states, strict=True))
    return Y, V, A, lam


def disagreement(system: System, home: Array, size: int) -> tuple[float, float]:
    """Of residuals, relative to the largest force in play, and of closures, in m."""
    Y, V, A, lam = random_states(system, home, size)
    t = 0.3 * np.arange(1, size + 1)
    R, C = Equations(system).residual(Y, V, A, lam, t)
    worst = gap = 0.0
    for k in range(size):
        d = Equations(system)  # fresh: nothing left of another state
        one, c = d.residual(Y[k], V[k], A[k], lam[k], float(t[k]))
        scale = float(np.max(np.abs(one), initial=1e-300))
        worst = max(worst, float(np.max(np.abs(R[k] - one), initial=0.0)) / scale)
        gap = max(gap, float(np.max(np.abs(C[k] - c), initial=0.0)))
    return worst, gap


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("which", WHICH)
@pytest.mark.parametrize("name", NAMES)
def test_stages_together_are_stages_one_by_one(name: str, which: str, size: int) -> None:
    force, gap = disagreement(*at_home(mechanism(name), which), size)
    assert force < ROUNDING
    assert gap < ROUNDING


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("loads", ["", FORCE])
def test_a_free_robot_with_every_kind_of_joint_too(loads: str, size: int, tmp_path: Path) -> None:
    force, gap = disagreement(*at_home(manifold(tmp_path, loads), "flexible"), size)
    assert force < ROUNDING
    assert gap < ROUNDING


def test_a_second_call_remembers_nothing_of_the_first() -> None:
    m = pf.load("race_r2")
    system = m.flexible
    Y, V, A, lam = random_states(system, m.undeformed(), 4)
    equations, t = Equations(system), np.zeros(2)
    first, second = slice(0, 2), slice(2, 4)
    # without the kernel, the very first look at a large model places joints in other arithmetic
    equations.residual(Y[second], V[second], A[second], lam[second], t)
    R, c = (x.copy() for x in equations.residual(Y[first], V[first], A[first], lam[first], t))
    equations.residual(Y[second], V[second], A[second], lam[second], t)
    again = equations.residual(Y[first], V[first], A[first], lam[first], t)
    np.testing.assert_array_equal(again.r, R)
    np.testing.assert_array_equal(again.c, c)
