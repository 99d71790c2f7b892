"""The error that a correction leaves, from how the polynomials of the steps decay.

What a correction with one stage more changes is the error of the run before it, but the corrected
samples are answered. Where the coefficients of the displacement fall from degree to degree by a
small ratio, the next correction would be small beside this one; where they hardly fall, something
rings too fast for either, and the error is more than what the correction tells.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array

# Error left over the correction: (ratio / _EVEN)^_POWER within _LEAST and _MOST. Fitted to 35 runs
# with known errors, and checked on others (tests/benchmarks/TOLERANCE.md).
_EVEN, _POWER, _LEAST, _MOST = 0.3, 4.0, 0.35, 3.0
_AROUND = 2  # steps on either side that a ratio is taken over: odd and even degrees take turns
_NOTHING = 1e-14  # of the largest coefficient: below, round-off


class Decay:
    """Coefficients of the last two degrees and corrections of the steps of one run."""

    def __init__(self) -> None:
        self._sizes: list[Array] = []

    def add(self, sizes: Array) -> None:
        """Take steps.

        Args:
            sizes: Last coefficient but one, last coefficient, correction, shape (n, 3).
        """
        self._sizes.append(sizes)

    @property
    def left(self) -> float:
        """Error of the corrected run over its correction."""
        sizes = np.concatenate([np.zeros((0, 3)), *self._sizes])
        weight = sizes[:, 2].sum() if len(sizes) else 0.0
        if not 0.0 < weight < np.inf:
            return 1.0
        least = _NOTHING * sizes[:, 0].max()
        before, last = (_around(np.maximum(x, least)) for x in sizes[:, :2].T)
        ratio = np.minimum(last / np.maximum(before, 1e-300), _MOST)
        mean = float(ratio @ sizes[:, 2]) / weight
        return float(np.clip((mean / _EVEN) ** _POWER, _LEAST, _MOST))


def _around(x: Array) -> Array:
    """Root of the sum of squares of each number and those beside it."""
    square = x * x
    wide = np.concatenate([square[:1].repeat(_AROUND), square, square[-1:].repeat(_AROUND)])
    return np.asarray(np.sqrt(np.convolve(wide, np.ones(2 * _AROUND + 1), "valid")))
