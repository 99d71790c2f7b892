"""A mapping that computes groups of its values on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from threading import RLock
from typing import TypeVar

T = TypeVar("T")
Groups = Mapping[tuple[str, ...], Callable[[], Mapping[str, T]]]


class Late(Mapping[str, T]):
    """Read-only: values that are known, and others that come in groups.

    A group is asked for by the head of a key ("link" of "link/distal_1/x"), one without heads by
    any key that is not known. It is found once, also where several threads ask. Whoever lists the
    keys asks for all of them.
    """

    def __init__(
        self, known: Mapping[str, T], later: Groups[T], unlisted: Groups[T] | None = None
    ) -> None:
        """Values at hand, and functions for the others."""
        self._known, self._later, self._lock = dict(known), dict(later), RLock()
        self._unlisted = None if unlisted is None else Late({}, unlisted)

    def __getitem__(self, key: str) -> T:
        if key not in self._known:
            self._find(key.partition("/")[0])
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

    def _find(self, head: str | None = None) -> None:
        with self._lock:
            for heads, group in tuple(self._later.items()):
                if head is None or head in heads or not heads:
                    self._known.update(group())
                    del self._later[heads]
