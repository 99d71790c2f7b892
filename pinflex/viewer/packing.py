"""Data with many arrays as one short text, which a page unpacks (page/load.js).

A number is kept to a millionth of the largest one of its array, as an integer. Motion is smooth, so
second differences in time are small: their high bytes, gathered, deflate to almost nothing.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from typing import Any

import numpy as np

from pinflex.arrays import Array

STEPS = 2**20  # of the largest magnitude of an array
_LEVEL = 6  # of zlib: more takes twice the time for one percent


def pack(data: Any) -> str:
    """Lists, mappings, numbers, texts and arrays (time first) as base64 of deflated bytes."""
    pieces: list[bytes] = []

    def placed(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{type(value).__name__} has no place in a page")
        step, coded = _coded(value)
        at = sum(map(len, pieces))
        pieces.append(coded)
        return {"packed": at, "shape": list(value.shape), "step": step}

    head = json.dumps(data, default=placed, allow_nan=False).encode()
    return deflated(len(head).to_bytes(4, "little") + head + b"".join(pieces))


def deflated(raw: bytes) -> str:
    """Bytes as base64 of zlib's format."""
    return base64.b64encode(zlib.compress(raw, _LEVEL)).decode()


def _coded(values: Array) -> tuple[float, bytes]:
    """Size of a step, and the steps: second differences in time, byte by byte of significance."""
    values = np.nan_to_num(values)
    if values.dtype.kind == "f":
        step = float(np.abs(values).max(initial=0.0)) / STEPS or 1.0
        steps = np.round(values / step).astype(np.int32)
    else:
        step, steps = 1.0, values.astype(np.int32)
    steps = steps.reshape(len(steps), math.prod(values.shape[1:]))
    for _ in range(2):
        steps = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
    folded = ((steps << 1) ^ (steps >> 31)).astype("<u4")  # 0, -1, 1, -2, ... as 0, 1, 2, 3, ...
    series = np.ascontiguousarray(folded.T).reshape(-1)
    return step, series.view(np.uint8).reshape(-1, 4).T.tobytes()
