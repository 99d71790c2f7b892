"""The compiled march of a linear system says what the one in numpy says.

Claims:
    Tolerances, collocation
    - the compiled march of a linear system: 1 to 36 unknowns, marches side by side on the factors
      of a window, pieces at rest, singular systems | `integrators.linear.alpha` on LAPACK | 1e-14
      of d, 1e-8 of a and multipliers | 3e-17; 1e-9
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.errors import PinflexError
from pinflex.integrators.chebyshev import Interpolation, PiecewiseChebyshev, varying
from pinflex.integrators.collocation import generalized_alpha, newmark
from pinflex.kernel.library import kernel
from pinflex.levels import ked
from pinflex.levels.ked import LinearMarch, Workspace
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import Manifold

needs_kernel = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)
STEPS = 150
# Of d, v, a and the multipliers, of the largest: round-off of closures of size one, which
# accelerations and multipliers see over beta h^2 = 1e-5; seen: 3e-17, 3e-15, 7e-11 and 1e-9.
SAME = (1e-14, 1e-12, 1e-8, 1e-8)


def system(n: int, rows: int, corners: tuple[float, ...] = (), seed: int = 1) -> tuple:
    """A grid, and M, C, K (size, n, n) and J (size, rows, n): some entries move, some do not."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, STEPS)
    grid = Interpolation(PiecewiseChebyshev(0.0, 1.0, list(corners)), 8, t)
    s = np.where(grid.times < (corners or (2.0,))[0], np.sin(grid.times), 0.3)[:, None, None]

    def moving(shape: tuple[int, int], share: float) -> Array:
        return s * np.where(rng.uniform(size=shape) < share, rng.normal(size=shape), 0.0)

    half = rng.normal(size=(n, n))
    M = half @ half.T + n * np.eye(n) + moving((n, n), 0.3)
    C = 0.1 * rng.normal(size=(n, n)) + moving((n, n), 0.3)
    K = 50.0 * (half @ half.T + np.eye(n)) + moving((n, n), 0.3)
    J = rng.normal(size=(rows, n)) + moving((rows, n), 0.5)
    load = np.sin(5.0 * t)[:, None] * rng.normal(size=n)
    return grid, (M, C, K, J), load


def march_of(scheme, grid, parts, h, workspace=None) -> LinearMarch:
    return LinearMarch(scheme, grid, [varying(x) for x in parts], h, workspace)


def without_kernel(monkeypatch: pytest.MonkeyPatch, march: LinearMarch, *given: Array) -> tuple:
    with monkeypatch.context() as m:
        m.setenv("PINFLEX_KERNEL", "0")
        return march(*given)


def assert_same(found: tuple, expected: tuple) -> None:
    for a, b, same in zip(found, expected, SAME, strict=True):
        assert a.shape == b.shape
        assert np.max(np.abs(a - b), initial=0.0) <= same * np.max(np.abs(b), initial=1.0)


@needs_kernel
@pytest.mark.parametrize(
    ("n", "rows"), [(1, 0), (2, 1), (3, 0), (4, 1), (5, 2), (8, 3), (17, 4), (30, 6)]
)
@pytest.mark.parametrize("scheme", [generalized_alpha(0.8), newmark()])
def test_it_is_the_march_in_numpy(n, rows, scheme, monkeypatch):
    """Sizes around those of a panel of the factors, with and without closures."""
    grid, parts, load = system(n, rows, seed=n)
    march = march_of(scheme, grid, parts, float(grid.t[1]))
    start = np.zeros(n)
    expected = without_kernel(monkeypatch, march, load, start)
    assert np.max(np.abs(expected.d)) > 1e-3
    assert_same(march(load, start), expected)
    J = grid.between(parts[3])
    assert np.max(np.abs(J @ march(load, start).d[:, :, None]), initial=0.0) < 1e-12


@needs_kernel
@pytest.mark.parametrize("steps", [20, 10 * STEPS])
def test_marches_side_by_side_are_those_one_by_one(steps, monkeypatch):
    """Factors of a window serve all of them, and another march between uses the same room."""
    monkeypatch.setattr(ked, "_FACTORS", 11 * 11 * steps)
    workspace = Workspace()
    grid, parts, load = system(9, 2, seed=1)
    march, other = (
        march_of(generalized_alpha(0.8), grid, x, float(grid.t[1]), workspace)
        for x in (parts, [2.0 * x for x in parts])
    )
    start, loads = np.zeros(9), (load, -2.0 * load, 0.5 * load)
    going = [march.begin() for _ in loads]
    windows = list(march.windows())
    assert (len(windows) > 3) == (steps == 20)
    for s in windows:
        for one, given in zip(going, loads, strict=True):
            one.go(s, given[s], start)
    assert_same(other(load, start), without_kernel(monkeypatch, other, load, start))
    assert_same(march(load, start), going[0].response)
    for one, given in zip(going, loads, strict=True):
        assert_same(one.response, without_kernel(monkeypatch, march, given, start))


@needs_kernel
@pytest.mark.parametrize("kept", [True, False])
def test_a_piece_at_rest_is_one_system(kept, monkeypatch):
    """Beyond 0.4 s nothing moves: factors are kept there, also in batches."""
    grid, parts, load = system(6, 2, corners=(0.4,))
    march = march_of(newmark(), grid, parts, float(grid.t[1]), Workspace() if kept else None)
    assert len(np.unique(march._at)) < 0.45 * STEPS
    start = np.zeros(6)
    assert_same(march(load, start), without_kernel(monkeypatch, march, load, start))


@needs_kernel
def test_coordinates_without_mass_and_stiffness_fall_back_on_least_squares(monkeypatch):
    """A system is singular: numpy answers, as it does where there is no kernel."""
    grid, (M, C, K, J), load = system(5, 1)
    for x in (M, C, K):
        x[:, 4], x[:, :, 4] = 0.0, 0.0
    J[:, :, 4], load[:, 4] = 0.0, 0.0
    march = march_of(newmark(), grid, (M, C, K, J), float(grid.t[1]))
    found = march(load, np.zeros(5))
    assert_same(found, without_kernel(monkeypatch, march, load, np.zeros(5)))
    assert np.all(np.isfinite(found.d)) and not np.any(found.d[:, 4])


@needs_kernel
def test_linear_systems_of_several_states_are_the_tangents_at_each():
    robot = pf.load("race_r1")
    dynamics, nv, closures = Equations(robot.flexible), robot.flexible.nv, robot.flexible.closed.n
    rng = np.random.default_rng(3)
    v, a, lam = (rng.normal(size=(3, n)) for n in (nv, nv, closures))
    y = Manifold(dynamics).retract(np.tile(robot.undeformed(), (3, 1)), 0.01 * v)
    compiled, t = dynamics.compiled, np.zeros(3)
    at = rng.permutation(nv * (3 * nv + closures))[:200]
    found = np.full((3, 210), np.nan)
    compiled.linear_systems((y, v, a, lam, t), at, found)
    for k in range(3):
        each = dynamics.tangent(y[k], v[k], a[k], lam[k], 0.0)
        whole = np.concatenate([x.ravel() for x in each])
        assert np.array_equal(found[k, :200], whole[at]) and np.all(np.isnan(found[k, 200:]))
    with pytest.raises(PinflexError, match="an array of"):
        compiled.linear_systems((y, v, a, lam, t), at, found[:, :100])
    with pytest.raises(PinflexError, match="an array of"):
        compiled.linear_systems((y[:2], v, a, lam, t), at, found)
    with pytest.raises(PinflexError, match="an entry of a tangent"):
        compiled.linear_systems((y, v, a, lam, t), at + nv * (3 * nv + closures), found)
