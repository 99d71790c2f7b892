"""Symmetric systems of equations in C, of which some have many answers, against LAPACK.

Claims:
    Tolerances, collocation
    - symmetric systems in C: bands in any order, several pieces; of many answers the least | LAPACK
      | 1e-14 times the condition; 1e-12 | passes
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import kernel

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)


def solved(S: Array, b: Array) -> Array:
    return Evaluator(pf.load("race_r1").flexible.tables).saddle(S, b)


def banded(n: int, band: int, seed: int) -> Array:
    """A symmetric matrix of a band, indefinite, its unknowns in random order."""
    rng = np.random.default_rng(seed)
    S = np.triu(np.tril(rng.normal(size=(n, n)), band))
    S += S.T
    S[:: band + 2, :: band + 2] = 0.0  # as multipliers have them
    at = rng.permutation(n)
    return np.asarray(S[np.ix_(at, at)])


@pytest.mark.parametrize("n", [2, 7, 40, 200])
@pytest.mark.parametrize("band", [0, 1, 3, 12, 40])
def test_bands_in_any_order_are_those_of_lapack(n: int, band: int) -> None:
    S = banded(n, min(band, n - 1), n + band) if band else np.diag(np.arange(1.0, n + 1))
    b = np.random.default_rng(1).normal(size=n)
    x = np.linalg.solve(S, b)
    # Round-off of either, times the condition.
    limit = 1e-14 * np.linalg.cond(S) * np.abs(x).max()
    assert np.abs(solved(S, b) - x).max() < max(limit, 1e-14)


@pytest.mark.parametrize("pieces", [1, 5])
def test_graphs_of_several_pieces_too(pieces: int) -> None:
    S = np.kron(np.eye(pieces), banded(30, 2, 3))
    S += np.diag([4.0] * len(S))
    b = np.arange(1.0, len(S) + 1)
    np.testing.assert_allclose(solved(S, b), np.linalg.solve(S, b), rtol=1e-9)


@pytest.mark.parametrize("n", [2, 9, 60])
@pytest.mark.parametrize("missing", [1, 2, 5])
def test_of_many_answers_the_least(n: int, missing: int) -> None:
    """Consistent or not: least squares, of least norm."""
    rng, rank = np.random.default_rng(n), max(n - missing, 1)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0][:, :rank]
    S = (Q * rng.uniform(1, 3, rank) * rng.choice([-1, 1], rank)) @ Q.T
    b = rng.normal(size=n)
    expected = np.linalg.lstsq(S, b, rcond=1e-13)[0]
    np.testing.assert_allclose(solved(S, b), expected, rtol=0, atol=1e-12 * np.abs(b).max())


def test_a_narrow_band_that_is_singular_too() -> None:
    """A narrow band that is singular: a row of zeros."""
    S = banded(80, 2, 5)
    S[3] = S[:, 3] = 0.0
    b = np.random.default_rng(2).normal(size=80)
    expected = np.linalg.lstsq(S, b, rcond=1e-13)[0]
    np.testing.assert_allclose(solved(S, b), expected, rtol=0, atol=1e-10 * np.abs(expected).max())
