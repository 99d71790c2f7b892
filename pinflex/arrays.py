"""The array types of the package, and slices of stacked states."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]


def chosen(rows: IntArray, count: int) -> IntArray | slice:
    """Rows of `count` in order as an index: where they are all, one that copies nothing."""
    return slice(None) if len(rows) == count else rows


def distinct(*values: npt.ArrayLike) -> npt.NDArray[Any]:
    """Values of all, sorted, each once.

    `np.unique` and what is made of it look for masks, for which they load `numpy.ma` where counts
    are not asked for: a fortieth of a small run.
    """
    every = np.concatenate([np.ravel(x) for x in values])
    return np.unique(every, return_counts=True)[0]


def others(count: int, some: IntArray) -> IntArray:
    """Numbers below `count` that are not among some."""
    left = np.ones(count, dtype=bool)
    left[np.asarray(some, dtype=np.intp)] = False  # none of any kind, too
    return np.flatnonzero(left)


_TOGETHER = 32  # states: numpy's price for a call is spread, what is used stays in cache


def spans(count: int, most: int = _TOGETHER) -> Iterator[slice]:
    """Slices that cover all of `count` states, `most` in each."""
    for first in range(0, count, most):
        yield slice(first, min(first + most, count))
