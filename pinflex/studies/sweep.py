"""One scene with many values of its parameters: a table with a row for each case."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pinflex.boundary import public
from pinflex.description.description import Description, read
from pinflex.description.overrides import assignments
from pinflex.errors import DescriptionError
from pinflex.mechanics.followed import share
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.results.columns import Columns, column
from pinflex.studies.batch import Interrupted, Record, keys, run
from pinflex.studies.cases import Case, combined, listed
from pinflex.studies.outputs import OUTPUTS, check_outputs, prismatic, scene_outputs, unit

_TRIED = 100  # cases, spread over all, before a sweep is refused because none can be read


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
    _check_keys(description, cases)
    named = keys(description, cases, level, groups)
    slides = prismatic(description)
    try:
        records = run(
            _Solved(description, level, groups), dict(zip(named, cases, strict=True)),
            jobs=jobs, scheduler=scheduler, journal=journal, fresh=fresh,
            progress=callback(progress),
        )  # fmt: skip
    except Interrupted as stop:
        stop.table = _table(named, cases, stop.records, slides)
        raise
    return _table(named, cases, records, slides)


class _Solved:
    """The outputs of one case after the other; what its rigid joints do alike is found once."""

    def __init__(self, description: Description, level: str | None, wanted: Sequence[str]) -> None:
        self._description, self._level, self._wanted = description, level, wanted
        self._last: Mechanism | None = None

    def __reduce__(self) -> tuple[type[_Solved], tuple[Any, ...]]:
        return _Solved, (self._description, self._level, self._wanted)

    def __call__(self, case: Case) -> dict[str, Any]:
        mechanism = load(self._description.with_overrides(assignments(case)))
        if self._last is not None:
            share(self._last, mechanism)
        self._last = mechanism
        return scene_outputs(mechanism, self._level, self._wanted)


def described(model: str | Path | Description | Mechanism) -> Description:
    """The description of a model, however it is given."""
    if isinstance(model, Mechanism):
        return model.description
    return model if isinstance(model, Description) else read(model)


def _check_keys(description: Description, cases: Sequence[Case]) -> None:
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


def _table(
    named: Sequence[str],
    cases: Sequence[Case],
    records: Mapping[str, Record],
    slides: frozenset[str],
) -> Columns:
    """Parameters, status, error and outputs of the cases that ended."""
    pairs = zip(named, cases, strict=True)
    ended = [(case, records[key]) for key, case in pairs if key in records]
    names = _keys(record.found for _, record in ended)
    arrays = {
        name: column([case[name] for case, _ in ended]) for name in _keys(case for case, _ in ended)
    }
    arrays["status"] = column(["failed" if record.error else "done" for _, record in ended])
    arrays["error"] = column([record.error for _, record in ended])
    arrays |= {name: column([record.found.get(name) for _, record in ended]) for name in names}
    return Columns(arrays, {name: unit(name, slides) for name in names if unit(name, slides)})


def _keys(mappings: Iterable[Mapping[str, object]]) -> list[str]:
    """Every key once, in the order of its first appearance."""
    return list(dict.fromkeys(key for mapping in mappings for key in mapping))
