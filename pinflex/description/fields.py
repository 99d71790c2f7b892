"""Readers in the metadata of dataclass fields: unit, range, choices and owners of a key, said once.

    dt: float | None = fields.real(None, of="time", above=0)

A record whose fields are made so is read by `read`; what one key alone cannot tell (two keys that
exclude each other) is checked by the record's own module.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

from pinflex.description import schema

Reader = Callable[[object, str], Any]


def key(default: Any, reader: Reader, **about: Any) -> Any:
    """A field that `reader(value, where)` reads; `about`: further metadata."""
    return dataclasses.field(default=default, metadata={"read": reader, **about})


def real(
    default: Any,
    of: str | None = None,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    above: float = -math.inf,
    **about: Any,
) -> Any:
    """A finite number in bounds and in the range of its quantity (`ranges.RANGES`)."""
    return key(default, lambda v, at: schema.number(v, at, low, high, above, of), **about)


def whole(default: Any, low: int, high: int | None = None, **about: Any) -> Any:
    """A whole number in bounds."""
    return key(default, lambda v, at: schema.integer(v, at, low, high), **about)


def word(default: Any, choices: Collection[str], **about: Any) -> Any:
    """One of the choices, which may be a table that grows."""
    return key(default, lambda v, at: schema.choice(v, at, choices), choices=choices, **about)


def flag(default: Any, **about: Any) -> Any:
    """true or false."""
    return key(default, schema.boolean, **about)


def names_of(record: type) -> tuple[str, ...]:
    """The keys of a record: its fields that have a reader, in their order."""
    return tuple(f.name for f in dataclasses.fields(record) if "read" in f.metadata)


def read(record: type, block: Mapping[str, Any], place: Mapping[str, str]) -> dict[str, Any]:
    """The written keys of a record, each read by its field; other keys are left alone.

    Args:
        record: A dataclass.
        block: The parsed block.
        place: Of each key, for messages.
    """
    return {
        f.name: f.metadata["read"](block[f.name], place[f.name])
        for f in dataclasses.fields(record)
        if "read" in f.metadata and f.name in block
    }
