"""One scene with many values of its parameters: a table with a row for each case."""

from __future__ import annotations

import inspect
import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.advice.solve import solve
from pinflex.boundary import public
from pinflex.description.description import Description, read
from pinflex.description.reading import schema, yaml_text
from pinflex.description.reading.parameters import assignments
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.evaluation.equations import share
from pinflex.mechanics.mechanism import Mechanism, load, takes_model
from pinflex.progress import Progress, barred, callback
from pinflex.results.pose_map import Columns, column
from pinflex.results.result import Result
from pinflex.studies.batch import Interrupted, Record, Work, keys, run
from pinflex.studies.outputs import OUTPUTS, check_outputs, prismatic, scene_outputs, unit
from pinflex.writing import plain

# Many cases of one robot in one call: other values, motions or starts, and a table of outputs.
#
# Copies of this process work on them where they can be made, else threads do, whose steps in the
# compiled kernel run side by side. Both inherit the robot and the cases as they are. A case is
# computed alike whoever has it: by how many they are divided does not change a bit.

_TRIED = 100  # cases, spread over all, before a batch is refused because none can be read
_OPTIONS = frozenset(inspect.signature(solve).parameters) - {"mechanism", "progress", "resume"}
Given = Mapping[str, Any]  # a case: values by key path, and options of `solve`
Measure = Callable[[Result], Mapping[str, float]]


@public
@barred
@takes_model
def batch(
    robot: Mechanism,
    /,
    cases: Iterable[Given],
    *,
    outputs: Iterable[str] | Measure = ("torque",),
    level: str | None = None,
    threads: int | None = None,
    progress: Progress = None,
    **options: Any,
) -> Columns:
    """Solve many cases of a robot, and keep a row of numbers of each.

        walls = np.random.default_rng(0).uniform(1e-3, 3e-3, 1000)
        cases = [{"flexible.arm_?.section.wall": w} for w in walls]
        table = pf.batch("delta", cases, level="coupled", tol=1e-2)
        table["torque.peak.motor_1"].max()

    What a case shares with the robot is not made anew, and only what `outputs` needs is computed.
    Numbers are those of `pf.solve` on `robot.with_` of the case, to the last bit.

    Args:
        robot: From `load`, or what it takes.
        cases: Of each what differs: values by key path into the YAML (segments may be globs), and
            arguments of `solve` by name, such as motion, start, level, tol or until.
        outputs: Groups of columns: torque, deviation, stress, frequency, cost, validity; or a
            function of the run that gives numbers by name.
        level: Of cases that name none; default: the level of the YAML.
        threads: How many cases are worked on at a time; default: as many as there are cores.
        progress: True: a bar; or a function called with (cases done, cases).
        options: Arguments of `solve` for every case that does not name them itself.

    Returns:
        Columns, a row for each case in order: `case` (its number, from 0), its plain values,
        `status` (done or failed), `error` (one line) and the outputs, SI units. A case that fails
        does not stop the others.

    Raises:
        DescriptionError: No case, an output or key path that does not exist, or no case that the
            robot takes.
        Interrupted: On Ctrl-C; `table` has the rows that there are.
    """
    for key in options.keys() - _OPTIONS:
        said = nearest(key, sorted(_OPTIONS))
        raise DescriptionError(f"{robot.name}: batch: {key}: no such option.{said}")
    given = [_checked(robot.name, number, case) for number, case in enumerate(cases)]
    every = [{**options, **case} for case in given]
    if not every:
        raise DescriptionError(f"{robot.name}: batch: no case. Give at least one, such as {{}}.")
    if threads is not None and threads < 1:
        raise DescriptionError(f"{robot.name}: batch: threads: {threads}. Give 1 or more.")
    measure = outputs if callable(outputs) else check_outputs(outputs, level)
    check_keys(robot.description, [changes(case) for case in every])
    shown = [{"case": number, **_plain(case)} for number, case in enumerate(given)]
    from joblib import cpu_count  # those that the process may use; takes 50 ms to import

    return _tabled(
        Solved(robot.description, level, measure, robot),
        [str(number) for number in range(len(every))],
        every,
        shown,
        prismatic(robot.description),
        jobs=min(threads or cpu_count(), len(every)),
        pickles=False,
        progress=callback(progress),
    )


def _tabled(
    work: Work,
    named: Sequence[str],
    cases: Sequence[Given],
    shown: Sequence[Given],
    slides: frozenset[str],
    **how: Any,
) -> Columns:
    """The table of cases by their keys; of those that ended, where it is interrupted."""
    try:
        records: Mapping[str, Record] = run(work, dict(zip(named, cases, strict=True)), **how)
    except Interrupted as stop:
        stop.table = table_of(shown, [stop.records.get(key) for key in named], slides)
        raise
    return table_of(shown, [records[key] for key in named], slides)


class Solved:
    """The outputs of one case after the other; what they have in common is found once."""

    def __init__(
        self,
        description: Description,
        level: str | None,
        outputs: Sequence[str] | Measure,
        like: Mechanism | None = None,
    ) -> None:
        self._description, self._level, self._outputs = description, level, outputs
        self._last, self._robot = like, like

    def __reduce__(self) -> tuple[type[Solved], tuple[Any, ...]]:
        return Solved, (self._description, self._level, self._outputs)

    def __call__(self, case: Given) -> dict[str, Any]:
        """The outputs of a case, by name."""
        options = {key: value for key, value in case.items() if _is_option(key, value)}
        mechanism = self._mechanism(changes(case))
        level = options.pop("level", self._level)
        if callable(self._outputs):
            return dict(self._outputs(solve(mechanism, level=level, **options)))
        return scene_outputs(mechanism, level, self._outputs, options=options)

    def _mechanism(self, values: Mapping[str, Any]) -> Mechanism:
        if not values and self._robot is not None:
            # what it knows of its rigid motion depends on what was asked of it before
            same = replace(self._robot)
            share(self._robot, same)
            return same
        changed = self._description.with_overrides(assignments(values))
        found = load(changed) if self._last is None else self._last.described(changed)
        self._last = found
        return found


def changes(case: Given) -> dict[str, Any]:
    """What a case changes of the YAML."""
    return {key: value for key, value in case.items() if not _is_option(key, value)}


def _is_option(key: str, value: object) -> bool:
    """Whether an entry of a case is an argument of `solve`; `motion` may be a block of the YAML."""
    return key in _OPTIONS and (key != "motion" or not isinstance(value, Mapping))


def _checked(name: str, number: int, case: object) -> Given:
    if isinstance(case, Mapping) and all(isinstance(key, str) for key in case):
        return case
    raise DescriptionError(
        f"{name}: batch: case {number}: {type(case).__name__} is no case. Give a mapping, from key "
        'paths to values and from arguments of solve, as {"flexible.*.section.wall": 2e-3, '
        '"tol": 1e-2}.'
    )


def _plain(case: Given) -> dict[str, Any]:
    """Entries of a case that a table can show."""
    return {key: x for key, x in case.items() if isinstance(x, bool | int | float | str)}


def check_keys(description: Description, cases: Sequence[Mapping[str, Any]]) -> None:
    """Refuse what no case can take, such as a key that does not exist, before anything runs.

    One accepted case shows that the keys are right; single bad values fail in their own row.
    """
    first: DescriptionError | None = None
    for case in cases[:: max(1, len(cases) // _TRIED)]:
        try:
            description.with_overrides(assignments(case))
            return
        except DescriptionError as error:
            first = first or error
    if first is not None:
        raise first


def table_of(
    cases: Sequence[Given], records: Sequence[Record | None], slides: frozenset[str]
) -> Columns:
    """Parameters, status, error and outputs of the cases that ended."""
    pairs = zip(cases, records, strict=True)
    ended = [(case, record) for case, record in pairs if record is not None]
    names = _keys(record.found for _, record in ended)
    arrays = {
        name: column([case.get(name) for case, _ in ended])
        for name in _keys(case for case, _ in ended)
    }
    arrays["status"] = column(["failed" if record.error else "done" for _, record in ended])
    arrays["error"] = column([record.error for _, record in ended])
    arrays |= {name: column([record.found.get(name) for _, record in ended]) for name in names}
    return Columns(arrays, {name: unit(name, slides) for name in names if unit(name, slides)})


def _keys(mappings: Iterable[Mapping[str, object]]) -> list[str]:
    """Every key once, in the order of its first appearance."""
    return list(dict.fromkeys(key for mapping in mappings for key in mapping))


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
    return _tabled(
        Solved(description, level, groups), named, cases, cases, prismatic(description),
        jobs=jobs, scheduler=scheduler, journal=journal, fresh=fresh, progress=callback(progress),
    )  # fmt: skip


def described(model: str | Path | Description | Mechanism) -> Description:
    """The description of a model, a name or a path."""
    if isinstance(model, Mechanism):
        return model.description
    return model if isinstance(model, Description) else read(model)
