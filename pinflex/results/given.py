"""Arrays and meta as a result keeps them: read-only, time first, plain."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.writing import plain

_WITHOUT_TIME = ("/x", "/mesh/nodes", "/mesh/triangles")


def plain_meta(meta: Any) -> dict[str, Any]:
    """A mapping as JSON has it."""
    try:
        found = plain(meta, finite=False)
    except (TypeError, RecursionError) as error:
        raise DescriptionError(
            f"result: meta: {error}. Use numbers, texts, lists and mappings only."
        ) from None
    if not isinstance(found, dict):
        raise DescriptionError(f"result: meta: {found!r} is not a mapping. Give names to values.")
    return found


def without_time(key: str) -> bool:
    """Whether the array of a flat key belongs to no instants."""
    return key.startswith("link/") and key.endswith(_WITHOUT_TIME)


def timed(key: str, values: Any, t: Array) -> Array:
    """An array of a result, read-only, with a row for each instant."""
    array = read_only(values, key)
    if not without_time(key) and array.shape[:1] != t.shape:
        raise DescriptionError(
            f"result: {key}: shape {array.shape} does not start with the "
            f"{len(t)} instants of t. Arrays are time first.",
            key=key,
        )
    return array


def read_only(values: Any, key: str) -> Array:
    """A copy of numbers that nobody writes to."""
    try:
        array = np.array(values, dtype=np.float64)  # a copy: the caller's array stays writable
    except (TypeError, ValueError) as error:
        raise DescriptionError(
            f"result: {key}: {error}. Every array holds real numbers.", key=key
        ) from None
    array.setflags(write=False)
    return array
