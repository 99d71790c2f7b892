"""The spline through a command's instants against scipy's.

Claims:
    Commands: motions that the platform follows
    - quintic spline through a command | scipy's B-splines | 1e-12 | 6e-14
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from pinflex.inversion.exact import spline


def test_the_quintic_spline_is_that_of_b_splines() -> None:
    """From rest, third and fourth derivative zero at the end; no rate grows with the nodes."""
    t, rng, still = np.linspace(0.1, 0.5, 41), np.random.default_rng(0), np.zeros(2)
    x = np.stack([np.sin(9 * t) ** 5, np.exp(-(((t - 0.3) / 0.05) ** 2))], 1)
    x += 1e-3 * rng.normal(size=x.shape)
    ends = ([(1, still), (2, still)], [(3, still), (4, still)])
    known, found, at = make_interp_spline(t, x, k=5, bc_type=ends), spline(t, x), rng.random(500)
    at = 0.1 + 0.4 * at
    for order in range(5):
        # round-off of the fifth difference of numbers of one size
        size = float(np.abs(known(at, order)).max())
        assert found(at, order) == pytest.approx(known(at, order), abs=1e-12 * size)
