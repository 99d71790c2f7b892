"""Names that lead to what they name, and complete in a notebook: names["a"]."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Generic, Protocol, SupportsIndex, TypeVar, overload

from pinflex.errors import DescriptionError, nearest

T = TypeVar("T")
_SHOWN = 160  # characters of all names together, in one line


class Names(tuple[str, ...], Generic[T]):
    """A tuple of names; a name in brackets gives what it names, a number the name itself."""

    find: Callable[[str], T]

    def __new__(cls, names: Iterable[str], find: Callable[[str], T]) -> Names[T]:
        """Names and the function that leads from one to what it names."""
        made = super().__new__(cls, names)
        made.find = find
        return made

    @overload
    def __getitem__(self, key: str) -> T: ...
    @overload
    def __getitem__(self, key: SupportsIndex) -> str: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[str, ...]: ...
    def __getitem__(self, key: Any) -> Any:
        return self.find(key) if isinstance(key, str) else super().__getitem__(key)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the names alone."""
        return tuple, (tuple(self),)

    def __repr__(self) -> str:
        return listed(self)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)


class Named(Protocol):
    """Anything with a name."""

    @property
    def name(self) -> str:
        """Its name."""


N = TypeVar("N", bound=Named)


class Records(tuple[N, ...]):
    """A tuple of records, which a number or a name in brackets gives."""

    @overload
    def __getitem__(self, key: str) -> N: ...
    @overload
    def __getitem__(self, key: SupportsIndex) -> N: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[N, ...]: ...
    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, str):
            return super().__getitem__(key)
        for record in self:
            if record.name == key:
                return record
        raise DescriptionError(f"{key}: no such name.{nearest(key, self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all."""
        return tuple(record.name for record in self)

    def __repr__(self) -> str:
        return listed(self.names)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.names)


def listed(names: Iterable[str]) -> str:
    """Names in one short line: the first ones, and how many there are."""
    every = list(names)
    text = ", ".join(every)
    if len(text) <= _SHOWN:
        return f"({text})"
    head = text[: _SHOWN - 20].rpartition(", ")[0] or text[: _SHOWN - 20]
    return f"({head}, ... {len(every)} in all)"
