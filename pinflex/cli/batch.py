"""Options and answer of a batch of cases, for `pinflex sweep` and `pinflex map`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.cli.cases_text import ranges
from pinflex.cli.console import print_json, say_written
from pinflex.errors import SceneError
from pinflex.progress import Bar
from pinflex.results.columns import Columns, check_suffix
from pinflex.text import paragraph, plural
from pinflex.writing import writable

_SHOWN = 5  # failures in the answer for people; the table has them all


class CaseBar(Bar):
    """A bar that knows how many cases a second have ended."""

    def __init__(self, label: str, options: Mapping[str, Any]) -> None:
        """`options`: of the batch, see `options`."""
        super().__init__(label)
        self.cases, self.seconds = 0, 0.0
        self.where = options["scheduler"] or plural(options["jobs"], "process")

    def __call__(self, step: int, steps: int) -> None:
        """Note the cases that have ended, and draw."""
        self.cases, self.seconds = step, time.monotonic() - self.began
        super().__call__(step, steps)

    @property
    def rate(self) -> float:
        """Cases a second, without those that the journal had."""
        return self.cases / self.seconds if self.seconds > 0 else 0.0

    def text(self) -> str:
        """The rate in words, "" where nothing was worked on."""
        return f"; {self.rate:.2g} a second in {self.where}" if self.cases else ""


def options(args: argparse.Namespace) -> tuple[Path | None, dict[str, Any]]:
    """The file of the table, checked, and what a batch takes: processes and journal."""
    from joblib import cpu_count

    out = None if args.out is None else check_suffix(args.out)
    writable(out)
    return out, {
        "jobs": cpu_count() if args.jobs is None else args.jobs,
        "scheduler": args.scheduler,
        "journal": None if out is None else journal(out),
        "fresh": args.fresh,
    }


def answer(
    args: argparse.Namespace,
    cases_table: Columns,
    out: Path | None,
    figures: list[Path],
    screen: str,
    bar: CaseBar,
    notes: Sequence[str] = (),
) -> int:
    """Write the table and say what is in it; an error where no case has an answer.

    The journal has done its work where every case has an answer, and goes.
    """
    files = [*([] if out is None else [cases_table.save(out)]), *figures]
    failed = np.flatnonzero(cases_table["status"] == "failed")
    errors = {int(k) + 1: str(cases_table["error"][k]) for k in failed}
    if out is not None and not errors:
        journal(out).unlink(missing_ok=True)
    if args.json:
        columns = {name: values.tolist() for name, values in cases_table.arrays.items()}
        print_json({
            "columns": columns, "units": cases_table.units, "files": files, "notes": notes,
            "cases_per_second": bar.rate,
        })  # fmt: skip
    else:
        print(screen)
        if args.verbose:
            print("\n" + ranges(cases_table))
        for note in notes:
            print(paragraph(note, "  ", "\n  "))
        done = len(cases_table) - len(failed)
        said = f"{plural(len(cases_table), 'case')}, {done} done, {len(failed)} failed"
        print(f"\n{said}{bar.text()}")
        for row, why in [*errors.items()][:_SHOWN]:
            print(paragraph(why, "    ", f"  case {row}: "))
        if len(failed) > _SHOWN:
            print(f"  and {len(failed) - _SHOWN} more")
        say_written(files, "--out FILE")
    if len(failed) == len(cases_table):
        raise SceneError(f"none of the cases has an answer: {errors[1]}")
    return 0


def journal(out: Path) -> Path:
    """File that keeps the cases of a table as they end."""
    return out.with_name(f"{out.name}.journal")
