"""Arrays of a run as few bytes: states to the last digit, fields of links and bodies to 5e-7.

Motion is smooth in time, and a beam along its axis, so that second differences are small: their
high bytes, gathered, deflate to almost nothing. A field is kept in steps of a millionth of the
largest value of each component. One that has a rigid counterpart is kept by its difference from
that, so that a displacement of a micrometre in a robot of a metre stays as fine; of a state the
bits themselves are differenced, and nothing is lost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array
from pinflex.errors import DescriptionError

STEPS = 2**20  # of the largest magnitude of a component: an error of half a step is 4.8e-7 of it
FINE = 2**24  # of the rigid counterparts: a short link stays straight; differences fit 32 bits
ROUNDED = "fields of links and bodies are kept to 5e-7 of the largest value of each component"
FIELDS = ("link", "body")  # heads of keys that follow from the states
_PLAIN = ("x", "nodes", "triangles")  # of a link, without time

Bytes = npt.NDArray[np.uint8]
Codes = npt.NDArray[Any]


def encode(
    arrays: Mapping[str, Array], read: dict[str, Array] | None = None
) -> tuple[dict[str, Array | Bytes], dict[str, Any]]:
    """What to write of each array, and how to read back those that are not as they were."""
    members: dict[str, Array | Bytes] = {}
    coded: dict[str, Any] = {}
    exact: dict[str, Array] = {}
    for key, values in arrays.items():
        head, _, rest = key.partition("/")
        name = rest.rpartition("/")[2]
        if not values.size or values.ndim < 1 or (head == "link" and name in _PLAIN):
            members[key] = exact[key] = values
        elif head in FIELDS and np.all(np.isfinite(values)):
            along = head == "link" and "/mesh/" not in key and values.ndim > 1
            rigid = arrays.get(f"{key}_rigid")
            if rigid is not None:
                values = values - rigid
            step = _step(values, FINE if key.endswith("_rigid") else STEPS)
            rounded = np.rint(values / step)
            members[key] = _bytes(_differences(rounded.astype(np.int32), along))
            coded[key] = {"shape": list(values.shape), "step": step.tolist(), "along": along}
            coded[key] |= {} if rigid is None else {"beside": f"{key}_rigid"}
            if read is not None:
                read[key] = np.multiply(rounded, step, out=rounded)
        else:
            exact[key] = values
            bits = np.ascontiguousarray(values, np.float64).view(np.int64)
            members[key] = _bytes(np.diff(bits, axis=0, prepend=np.zeros_like(bits[:1])))
            coded[key] = {"shape": list(values.shape)}
    if read is not None:
        read |= exact | _with_rigid(read, coded)
    return members, coded


def decoded(stored: Mapping[str, Any], coded: Mapping[str, Any]) -> dict[str, Array]:
    """The arrays of a file."""
    arrays = {key: decode(key, stored[key], coded[key]) if key in coded else stored[key]
              for key in stored}  # fmt: skip
    return arrays | _with_rigid(arrays, coded)


def _with_rigid(arrays: Mapping[str, Array], coded: Mapping[str, Any]) -> dict[str, Array]:
    """Arrays that are kept by their difference from a rigid counterpart."""
    own = {key: how["beside"] for key, how in coded.items() if "beside" in how}
    return {key: arrays[key] + arrays[beside] for key, beside in own.items()}


def decode(key: str, stored: npt.NDArray[Any], how: Mapping[str, Any]) -> Array:
    """An array that `encode` wrote."""
    shape, field = tuple(int(n) for n in how["shape"]), "step" in how
    width = 4 if field else 8
    if stored.dtype != np.uint8 or stored.size != width * math.prod(shape) or not shape:
        raise DescriptionError(f"{key}: {stored.size} bytes are not an array of shape {shape}")
    codes = _codes(stored, shape, width)
    if not field:
        return np.cumsum(codes, axis=0, dtype=np.int64).view(np.float64)
    for axis in (1, 1, 0, 0) if how["along"] else (0, 0):
        codes = np.cumsum(codes, axis=axis, dtype=np.int32)
    return np.asarray(codes * np.asarray(how["step"], np.float64))


def _step(values: Array, count: int) -> Array:
    """Size of a step of each component, broadcast over the others; components are the last axis."""
    rows = values.reshape(len(values), -1)
    largest = np.maximum(np.max(rows, axis=0), -np.min(rows, axis=0))  # over time: long rows
    components = values.shape[-1] if values.ndim > 2 else 1
    largest = largest.reshape(-1, components).max(axis=0)
    step = np.where(largest > 0, largest / count, 1.0)
    return step.reshape(*[1] * (values.ndim - 1), components)


def _differences(steps: Codes, along: bool) -> Codes:
    """Second differences in time, and along a beam."""
    for axis in (0, 0, 1, 1) if along else (0, 0):
        first = np.zeros_like(np.take(steps, [0], axis=axis))
        steps = np.diff(steps, axis=axis, prepend=first)
    return steps


def _bytes(codes: Codes) -> Bytes:
    """Integers with the sign in the last bit, byte by byte of significance, series after series."""
    width = codes.dtype.itemsize
    folded = (codes << 1) ^ (codes >> (8 * width - 1))  # 0, -1, 1, -2, ... as 0, 1, 2, 3, ...
    series = np.ascontiguousarray(folded.reshape(len(codes), -1).T).astype(f"<i{width}")
    return np.ascontiguousarray(series.reshape(-1).view(np.uint8).reshape(-1, width).T).reshape(-1)


def _codes(stored: Bytes, shape: tuple[int, ...], width: int) -> Codes:
    flat = np.ascontiguousarray(stored.reshape(width, -1).T).reshape(-1).view(f"<u{width}")
    kind = np.int32 if width == 4 else np.int64
    sign = np.negative((flat & 1).astype(kind))
    unfolded = np.bitwise_xor((flat >> 1).astype(kind), sign)
    return np.ascontiguousarray(unfolded.reshape(-1, shape[0]).T).reshape(shape)
