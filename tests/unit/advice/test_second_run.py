"""Which sections of two models are compared."""

from __future__ import annotations

import numpy as np

from pinflex.levels.outputs import shared


def test_only_sections_at_one_place_are_compared() -> None:
    """By hand: of 0, 0.3 and 1 m the first and the last are among 0, 0.25, 0.5, 1 m."""
    x, at = np.array([0.0, 0.3, 1.0]), np.array([0.0, 0.25, 0.5, 1.0])
    assert shared(x, at) == ([0, 2], [0, 3])
    assert shared(at, x) == ([0, 3], [0, 2])
    # a hundredth of a millimetre is another place, round-off is not
    assert shared(at + 1e-5, at) == ([], [])
    assert shared(at + 1e-9, at) == ([0, 1, 2, 3], [0, 1, 2, 3])
