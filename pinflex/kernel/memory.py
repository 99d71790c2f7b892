"""Arrays for the C code in one block: numpy's answer to where an array lies takes 1 us each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

_ALIGNED = 64  # bytes


class Block:
    """Arrays of one type, zero or given, each at a multiple of 64 bytes.

    Attributes:
        arrays, addresses: By name. size: Bytes.
    """

    def __init__(
        self,
        shapes: Mapping[str, tuple[int, ...]],
        given: Mapping[str, npt.NDArray[Any]],
        dtype: npt.DTypeLike = np.float64,
    ) -> None:
        """`shapes`: of arrays of zeros by name; `given`: what others hold."""
        wide = np.dtype(dtype).itemsize
        every = _ALIGNED // wide
        shapes = dict(shapes) | {name: array.shape for name, array in given.items()}
        sizes = [_size(shape) for shape in shapes.values()]
        self._raw = np.zeros(sum(sizes) + every * (len(sizes) + 1), dtype=dtype)
        self.size = self._raw.nbytes
        first = self._raw.ctypes.data
        at = -first % _ALIGNED // wide
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        self.addresses: dict[str, int] = {}
        for (name, shape), size in zip(shapes.items(), sizes, strict=True):
            self.arrays[name] = self._raw[at : at + size].reshape(shape)
            self.addresses[name] = first + at * wide
            at += (size + every - 1) // every * every
        for name, array in given.items():
            self.arrays[name][...] = array


def _size(shape: tuple[int, ...]) -> int:
    size = 1
    for n in shape:
        size *= n
    return size
