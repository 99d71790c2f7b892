"""One scene with many values of its parameters: a table with a row for each case."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.boundary import public
from pinflex.description.description import Description, read
from pinflex.description.reading import schema, yaml_text
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.progress import Progress, barred, callback
from pinflex.results.columns import Columns
from pinflex.studies.batch import Interrupted, keys, run
from pinflex.studies.many import Solved, check_keys, table_of
from pinflex.studies.outputs import OUTPUTS, check_outputs, prismatic
from pinflex.writing import plain

# Cases of a sweep: key paths into the YAML, the values they take, and how these combine.

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


@public
@barred
def sweep(
    model: str | Path | Description | Mechanism,
    parameters: Mapping[str, object],
    *,
    level: str | None = None,
    outputs: Iterable[str] = OUTPUTS,
    paired: bool = False,
    jobs: int = 1,
    scheduler: str | None = None,
    journal: str | Path | None = None,
    fresh: bool = False,
    progress: Progress = None,
) -> Columns:
    """Solve a scene for many values of its parameters.

        table = pf.sweep("3rrr", {"flexible.*.section.thickness": [1e-3, 2e-3]}, level="ked")
        table["stress.peak"]

    Args:
        model: A model, or what `load` takes.
        parameters: Values by key path into the YAML, whose segments may be globs: a list, or a text
            such as "1e-3:3e-3:9" (see `cases.values`).
        level: Default: the level of the YAML.
        outputs: Groups of columns, see `outputs.scene_outputs`.
        paired: Take the n-th values together, instead of every combination.
        jobs: Processes of this machine.
        scheduler: Address of a Dask cluster to use instead.
        journal: File that keeps every case as it ends. The same call goes on from there after it
            was stopped or killed; a case is solved again when the model or the version changed.
        fresh: Forget what the journal has.
        progress: True: a bar; or a function called with (cases done, cases) of those left to do.

    Returns:
        Columns: the parameters, `status` (done or failed), `error` (one line) and the outputs. A
        case that fails does not stop the others.

    Raises:
        DescriptionError: A key path that does not exist, or no value that the model takes.
        Interrupted: On Ctrl-C; `table` has the rows that there are.
    """
    description = described(model)
    groups = check_outputs(outputs, level)
    cases = combined(listed(parameters, f"{description.name}: sweep"), paired)
    check_keys(description, cases)
    named = keys(description, cases, level, groups)
    slides = prismatic(description)
    try:
        records = run(
            Solved(description, level, groups), dict(zip(named, cases, strict=True)),
            jobs=jobs, scheduler=scheduler, journal=journal, fresh=fresh,
            progress=callback(progress),
        )  # fmt: skip
    except Interrupted as stop:
        stop.table = table_of(named, cases, stop.records, slides)
        raise
    return table_of(named, cases, records, slides)


def described(model: str | Path | Description | Mechanism) -> Description:
    """The description of a model, however it is given."""
    if isinstance(model, Mechanism):
        return model.description
    return model if isinstance(model, Description) else read(model)
