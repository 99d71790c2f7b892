"""Data with many arrays as one short text, which a page unpacks (page/load.js).

A number is kept to a millionth of the largest one of its array, or as coarsely as `Coarse` says, as
an integer. Motion is smooth in time and along a link, so second differences are small: their high
bytes, gathered, deflate to almost nothing. Equal arrays are kept once.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array

STEPS = 2**20  # of the largest magnitude of an array
Steps = npt.NDArray[np.int32]
_LEVEL = 4  # of zlib: its default takes half as long again for 1 % less
_ALONG = 2  # differences along the second axis, at most
_ENOUGH = 8  # entries of a second axis that may be smooth: fewer are components of a vector


@dataclass(frozen=True)
class Coarse:
    """An array kept to `1 / steps` of its largest number."""

    values: Array
    steps: int


def pack(data: Any) -> str:
    """Lists, mappings, numbers, texts and arrays (time first) as base64 of deflated bytes."""
    pieces: list[bytes] = []
    places: dict[bytes, dict[str, Any]] = {}

    def placed(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        steps = STEPS
        if isinstance(value, Coarse):
            value, steps = value.values, value.steps
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{type(value).__name__} has no place in a page")
        step, along, coded = _coded(value, steps)
        head = {"shape": list(value.shape), "step": step, "along": along}
        key = json.dumps(head).encode() + coded
        if key not in places:
            places[key] = {"packed": sum(map(len, pieces)), **head}
            pieces.append(coded)
        return places[key]

    head = json.dumps(data, default=placed, allow_nan=False).encode()
    return deflated(len(head).to_bytes(4, "little") + head + b"".join(pieces))


def deflated(raw: bytes) -> str:
    """Bytes as base64 of zlib's format."""
    return base64.b64encode(zlib.compress(raw, _LEVEL)).decode()


def _coded(values: Array, count: int) -> tuple[float, int, bytes]:
    """Size of a step, differences along the second axis, and bytes by significance."""
    if not np.isfinite(np.sum(values)):
        values = np.nan_to_num(values)
    if values.dtype.kind == "f":
        step = float(np.abs(values).max(initial=0.0)) / count or 1.0
        steps = np.round(values / step).astype(np.int32)
    else:
        step, steps = 1.0, values.astype(np.int32)
    for _ in range(2):
        steps = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
    along, steps = _along(steps)
    steps = steps.reshape(len(steps), math.prod(values.shape[1:]))
    folded = ((steps << 1) ^ (steps >> 31)).astype("<u4")  # 0, -1, 1, -2, ... as 0, 1, 2, 3, ...
    series = np.ascontiguousarray(folded.T).reshape(-1)
    return step, along, series.view(np.uint8).reshape(-1, 4).T.tobytes()


def _along(steps: Steps) -> tuple[int, Steps]:
    """Differences along the second axis as often as makes the numbers shorter."""
    if steps.ndim < 2 or steps.shape[1] < _ENOUGH:
        return 0, steps
    best, times, shortest = steps, 0, _bits(steps)
    for n in range(1, _ALONG + 1):
        steps = np.diff(steps, axis=1, prepend=np.zeros_like(steps[:, :1]))
        if (bits := _bits(steps)) < shortest:
            best, times, shortest = steps, n, bits
    return times, best


def _bits(steps: Steps) -> float:
    sizes = np.abs(steps).astype(np.float32)  # in single precision a logarithm takes a quarter
    return float(np.log2(1 + sizes).sum(dtype=np.float64))
