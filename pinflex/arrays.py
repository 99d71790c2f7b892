"""The array types of the package, and slices of stacked states."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]


def chosen(rows: IntArray, count: int) -> IntArray | slice:
    """Rows of `count` in order as an index: where they are all, one that copies nothing."""
    return slice(None) if len(rows) == count else rows


_TOGETHER = 32  # states: numpy's price for a call is spread, what is used stays in cache


def spans(count: int, most: int = _TOGETHER) -> Iterator[slice]:
    """Slices that cover all of `count` states, `most` in each."""
    for first in range(0, count, most):
        yield slice(first, min(first + most, count))
