"""A mapping that computes groups of its values on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from fnmatch import fnmatchcase
from threading import RLock
from typing import Any, TypeVar

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.writing import plain

T = TypeVar("T")
Groups = Mapping[tuple[str, ...], Callable[[], Mapping[str, T]]]


class Late(Mapping[str, T]):
    """Read-only: values that are known, and others that come in groups.

    A group is asked for by a key, by its head ("link" of "link/distal_1/x"), or by a glob that the
    whole key fits ("link/*/stress/*"), one without heads by any key that is not known. It is found
    once, also where several threads ask. Whoever lists the keys asks for all of them.
    """

    def __init__(
        self, known: Mapping[str, T], later: Groups[T], unlisted: Groups[T] | None = None
    ) -> None:
        """Values at hand, and functions for the others."""
        self._known, self._later, self._lock = dict(known), dict(later), RLock()
        self._unlisted = None if unlisted is None else Late({}, unlisted)

    def __getitem__(self, key: str) -> T:
        if key not in self._known:
            self._find(key)
        if key not in self._known and self._unlisted is not None:
            return self._unlisted[key]
        return self._known[key]

    def __iter__(self) -> Iterator[str]:
        self._find()
        return iter(self._known)

    def __len__(self) -> int:
        self._find()
        return len(self._known)

    def __repr__(self) -> str:
        return f"Late({len(self._known)} found, {len(self._later)} groups not yet asked for)"

    def _find(self, key: str | None = None) -> None:
        with self._lock:
            for heads, group in tuple(self._later.items()):
                if key is None or not heads or any(_asks(key, head) for head in heads):
                    self._known.update(group())
                    del self._later[heads]
                if key is not None and key in self._known:
                    return


def _asks(key: str, head: str) -> bool:
    return fnmatchcase(key, head) if "*" in head else head in (key, key.partition("/")[0])


# Arrays and meta as a result keeps them: read-only, time first, plain.

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
