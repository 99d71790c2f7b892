"""Many cases, some of which may fail, worked on in parallel and kept one by one as they end.

The journal has one JSON object a line; a case counts as done when its line is on the disk. A line
is found again by its key, which names the case and everything that its numbers follow from.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import yaml

from pinflex.description.description import Description
from pinflex.errors import DescriptionError, PinflexError
from pinflex.recovery.meta import version
from pinflex.results.columns import Columns
from pinflex.studies.pool import Lost, answers
from pinflex.studies.study import reason
from pinflex.writing import lock, plain, writable

Work = Callable[[Any], dict[str, Any]]


@dataclass(frozen=True)
class Record:
    """Outcome of a case: numbers and texts by name, or one line on why there are none.

    Numbers that are not finite are None.
    """

    found: Mapping[str, Any]
    error: str = ""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C: `records` has the cases that ended, `table` what the caller makes of them."""

    def __init__(self, records: Mapping[str, Record], message: str) -> None:
        super().__init__(message)
        self.records = records
        self.table: Columns | None = None


def run(
    work: Work,
    cases: Mapping[str, Any],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    journal: str | Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    pickles: bool = True,
) -> dict[str, Record]:
    """The record of every case, by its key; `pickles`: whether cases may travel to processes.

    Raises:
        DescriptionError: The journal cannot be written or is in use; no such scheduler.
        Interrupted: On Ctrl-C.
    """
    if jobs < 1:
        raise DescriptionError(f"jobs: {jobs}. Give 1 or more.")
    with _opened(journal) as stream:
        if fresh and stream is not None:
            stream.truncate(0)
        records = _kept(stream, cases)
        left = [key for key in cases if key not in records]
        todo = [cases[key] for key in left]
        ready = answers(partial(_outcome, work), todo, jobs, scheduler, pickles)
        try:
            for ended, (number, answer) in enumerate(ready, 1):
                record = Record({}, answer.reason) if isinstance(answer, Lost) else answer
                if stream is not None:
                    _write(stream, left[number], record)
                records[left[number]] = record
                if progress is not None:
                    progress(ended, len(left))
        except KeyboardInterrupt:
            records |= _kept(stream, cases)  # it may come between a line and its record
            said = f"interrupted: {len(records)} of {len(cases)} cases are done"
            if journal is not None:
                said += f" and kept in {journal}; the same command goes on from there"
            raise Interrupted(records, said) from None
    return records


def _outcome(work: Work, case: Any) -> Record:
    """Outcome of a case; an error in one does not stop the others."""
    try:
        return Record(plain(work(case)))
    except PinflexError as error:
        why = reason(error)
    except MemoryError:
        why = "not enough memory"
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
    return Record({}, " ".join(why.split()))


# Keys ------------------------------------------------------------------------------------------


def keys(description: Description, cases: Iterable[Any], *about: Any) -> list[str]:
    """A key for each case, which changes with whatever changes the numbers of the case.

    These are the version, the texts of the model, the contents of the files that it or a case
    names, the case itself and `about` (plain JSON values: level, outputs, ...).
    """
    cases = list(cases)
    model = hashlib.sha256(version().encode())
    for text in (description.urdf_text, description.yaml_text):
        model.update(b"\0" + text.encode())
    folder = Path() if description.path is None else description.path.parent
    for name in sorted({*_texts([yaml.safe_load(description.yaml_text), cases])}):
        with_it = folder / name
        if len(name) < 256 and "\0" not in name and with_it.is_file():
            model.update(b"\0" + with_it.read_bytes())
    return [
        hashlib.sha256(
            json.dumps([model.hexdigest(), case, about], sort_keys=True).encode()
        ).hexdigest()[:32]
        for case in cases
    ]


def _texts(value: Any) -> Iterator[str]:
    """Every text in nested lists and mappings."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from _texts([*value.values()])
    elif isinstance(value, Sequence):
        for item in value:
            yield from _texts(item)


# The journal -----------------------------------------------------------------------------------


@contextmanager
def _opened(path: str | Path | None) -> Iterator[IO[bytes] | None]:
    """The journal, for this process alone until it ends, however it ends."""
    if path is None:
        yield None
        return
    writable(path)
    with Path(path).open("a+b") as stream:
        if not lock(stream):
            raise DescriptionError(
                f"{path}: another process is writing it. Wait for that one, or choose another "
                "output file."
            )
        yield stream


def _kept(stream: IO[bytes] | None, cases: Iterable[str]) -> dict[str, Record]:
    """The records of these cases; a last line that a kill left unfinished is cut off."""
    if stream is None:
        return {}
    stream.seek(0)
    lines = stream.read().split(b"\n")
    stream.truncate(stream.tell() - len(lines[-1]))
    found = {}
    for line in lines[:-1]:
        try:
            entry = json.loads(line)
            record = Record(entry["found"], entry["error"])
            if isinstance(record.found, dict) and isinstance(record.error, str):
                found[entry["key"]] = record
        except (ValueError, TypeError, KeyError):
            continue  # a line of something else: the case is worked on again
    return {key: found[key] for key in cases if key in found}


def _write(stream: IO[bytes], key: str, record: Record) -> None:
    stream.write(json.dumps({"key": key, **asdict(record)}).encode() + b"\n")
    stream.flush()
    os.fsync(stream.fileno())
