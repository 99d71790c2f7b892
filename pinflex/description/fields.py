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

from pinflex.description import ranges, schema

Reader = Callable[[object, str], Any]


def key(default: Any, reader: Reader, **about: Any) -> Any:
    """A field that a reader reads.

    `about` is further metadata; `form` in it is what the value looks like, as JSON Schema says it.
    """
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
    bounds = {"minimum": low, "maximum": high, "exclusiveMinimum": above}
    form: dict[str, Any] = {"type": "number"} | {
        k: v for k, v in bounds.items() if math.isfinite(v)
    }
    if of in ranges.UNITS:  # with its unit behind it
        form = {"anyOf": [form, {"type": "string"}]}
    return key(
        default, lambda v, at: schema.number(v, at, low, high, above, of), form=form, **about
    )


def whole(default: Any, low: int, high: int | None = None, **about: Any) -> Any:
    """A whole number in bounds."""
    form = {"type": "integer", "minimum": low} | ({} if high is None else {"maximum": high})
    return key(default, lambda v, at: schema.integer(v, at, low, high), form=form, **about)


def word(default: Any, choices: Collection[str], **about: Any) -> Any:
    """One of the choices, which may be a table that grows."""
    form = {"enum": choices}  # as it is when it is asked for
    return key(
        default, lambda v, at: schema.choice(v, at, choices), choices=choices, form=form, **about
    )


def flag(default: Any, **about: Any) -> Any:
    """true or false."""
    return key(default, schema.boolean, form={"type": "boolean"}, **about)


def names_of(record: type) -> tuple[str, ...]:
    """The keys of a record: its fields that have a reader, in their order."""
    return tuple(f.name for f in dataclasses.fields(record) if "read" in f.metadata)


def read(record: type, block: Mapping[str, Any], place: Mapping[str, str]) -> dict[str, Any]:
    """The written keys of a record, each read by its field; other keys are left alone."""
    return {
        f.name: f.metadata["read"](block[f.name], place[f.name])
        for f in dataclasses.fields(record)
        if "read" in f.metadata and f.name in block
    }
