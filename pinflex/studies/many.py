"""Many cases of one robot in one call: other values, motions or starts, and a table of outputs.

Copies of this process work on them where they can be made, else threads do, whose steps in the
compiled kernel run side by side. Both inherit the robot and the cases as they are. A case is
computed alike whoever has it: by how many they are divided does not change a bit.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pinflex.advice.solve import solve
from pinflex.boundary import public
from pinflex.description.description import Description
from pinflex.description.reading.parameters import assignments
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.evaluation.equations import share
from pinflex.mechanics.mechanism import Mechanism, load, takes_model
from pinflex.progress import Progress, barred, callback
from pinflex.results.columns import Columns, column
from pinflex.results.result import Result
from pinflex.studies.batch import Interrupted, Record, run
from pinflex.studies.outputs import check_outputs, prismatic, scene_outputs, unit

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
    slides = prismatic(robot.description)
    shown = [{"case": number, **_plain(case)} for number, case in enumerate(given)]
    named = [str(number) for number in range(len(every))]
    from joblib import cpu_count  # those that the process may use; takes 50 ms to import

    try:
        records = run(
            Solved(robot.description, level, measure, robot),
            dict(zip(named, every, strict=True)),
            jobs=min(threads or cpu_count(), len(every)),
            pickles=False,
            progress=callback(progress),
        )
    except Interrupted as stop:
        stop.table = table_of(named, shown, stop.records, slides)
        raise
    return table_of(named, shown, records, slides)


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
    named: Sequence[str],
    cases: Sequence[Given],
    records: Mapping[str, Record],
    slides: frozenset[str],
) -> Columns:
    """Parameters, status, error and outputs of the cases that ended."""
    pairs = zip(named, cases, strict=True)
    ended = [(case, records[key]) for key, case in pairs if key in records]
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
