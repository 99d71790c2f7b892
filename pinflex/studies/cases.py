"""Cases of a sweep: key paths into the YAML, the values they take, and how these combine."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from pinflex.description import schema, yaml_text
from pinflex.errors import DescriptionError
from pinflex.writing import plain

Case = dict[str, Any]  # value by key path
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_RANGE = re.compile(rf"{_NUMBER}:{_NUMBER}(?::(\d+)(:log)?)?(.*)")
_MOST = 1_000_000  # cases: more than anyone waits for


def values(text: str, where: str) -> list[Any]:
    """The values that a text names."""
    text = text.strip()
    span = _RANGE.fullmatch(text)
    if span is None:
        found = yaml_text.load(f"[{text}]", where)
        if not found:
            raise DescriptionError(f"{where}: no value. Write v, or v,w,..., or a:b:n.")
        return list(found)
    first, last, count = float(span[1]), float(span[2]), int(span[3] or 0)
    if not 1 <= count <= _MOST or span[5]:
        raise DescriptionError(
            f"{where}: {text!r} is not a range. Write a:b:n for n numbers from a to b, or "
            "a:b:n:log for equal factors."
        )
    if span[4] and first * last <= 0:
        raise DescriptionError(
            f"{where}: {text!r}: a range by equal factors cannot reach or cross zero. Write a:b:n, "
            "or ends of the same sign."
        )
    spread = np.geomspace(first, last, count) if span[4] else np.linspace(first, last, count)
    # 15 digits: 0.00225 and not 0.0022500000000000003
    found = [float(f"{x:.15g}") for x in spread]
    whole = span[1].lstrip("+-").isdigit() and all(x.is_integer() for x in found)
    return [int(x) for x in found] if whole else found


def parsed(assignments: Iterable[str], option: str) -> dict[str, list[Any]]:
    """Values by key from texts "key=values", such as an option takes on the command line."""
    found: dict[str, list[Any]] = {}
    for text in assignments:
        key, sign, rest = (part.strip() for part in text.partition("="))
        where = f"{option} {key}"
        if not sign or not key:
            raise DescriptionError(f"{option} {text}: not of the form KEY=VALUES. Write one.")
        if key in found:
            raise DescriptionError(f"{where}: given twice. List the values in one place.")
        found[key] = values(rest, where)
    return found


def listed(parameters: Mapping[str, object], where: str) -> dict[str, list[Any]]:
    """The same from Python: a text is read as above, anything with many entries is a list."""
    found = {}
    for key, given in parameters.items():
        place = f"{where}: {key}"
        if isinstance(given, str):
            found[key] = values(given, place)
            continue
        try:
            every = list(given) if isinstance(given, Iterable) else [given]
            found[key] = plain(every, finite=False)
        except (TypeError, RecursionError):
            found[key] = []
        if not found[key] or isinstance(given, Mapping):
            raise DescriptionError(
                f"{place}: {schema.shown(given)} is no list of values. Give numbers, texts, lists."
            )
    return found


def combined(parameters: Mapping[str, list[Any]], paired: bool = False) -> list[Case]:
    """Cases in order, the last parameter changing fastest."""
    sizes = {key: len(options) for key, options in parameters.items()}
    if paired:
        length = max(sizes.values(), default=1)
        if {*sizes.values()} - {1, length}:
            said = ", ".join(f"{key} has {size}" for key, size in sizes.items())
            raise DescriptionError(f"paired values: {said}. Give each as many, or one for all.")
        columns = [given * (length // len(given)) for given in parameters.values()]
        rows: Iterable[tuple[Any, ...]] = zip(*columns, strict=True) if columns else [()]
    else:
        if math.prod(sizes.values()) > _MOST:
            raise DescriptionError(
                f"{math.prod(sizes.values())} combinations are more than {_MOST}. Take fewer "
                "values, or pair them (--zip)."
            )
        rows = itertools.product(*parameters.values())
    return [dict(zip(parameters, row, strict=True)) for row in rows]
