"""Options and answer of a batch of cases, for `pinflex sweep` and `pinflex map`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.cli.console import print_json
from pinflex.errors import SceneError
from pinflex.results.columns import Columns, check_suffix
from pinflex.text import number, paragraph, plural, table
from pinflex.writing import writable

_SHOWN = 5  # failures in the answer for people; the table has them all


def options(args: argparse.Namespace) -> tuple[Path | None, dict[str, Any]]:
    """The file of the table, checked, and what a batch takes: processes and journal."""
    from joblib import cpu_count

    out = None if args.out is None else check_suffix(args.out)
    writable(out)
    return out, {
        "jobs": cpu_count() if args.jobs is None else args.jobs,
        "scheduler": args.scheduler,
        "journal": None if out is None else out.with_name(f"{out.name}.journal"),
        "fresh": args.fresh,
    }


def answer(
    args: argparse.Namespace,
    cases_table: Columns,
    out: Path | None,
    figures: list[Path],
    notes: Sequence[str] = (),
) -> int:
    """Write the table and say what is in it; an error where no case has an answer.

    Args:
        args: Of the command.
        cases_table: Table of all cases.
        out: File of the table, or None.
        figures: Files written besides.
        notes: Paragraphs below the table.
    """
    files = [*([] if out is None else [cases_table.save(out)]), *figures]
    failed = np.flatnonzero(cases_table["status"] == "failed")
    errors = {int(k) + 1: str(cases_table["error"][k]) for k in failed}
    if args.json:
        columns = {name: values.tolist() for name, values in cases_table.arrays.items()}
        print_json({"columns": columns, "units": cases_table.units, "files": files, "notes": notes})
    else:
        print(_ranges(cases_table))
        for note in notes:
            print(paragraph(note, "  ", "\n  "))
        done = len(cases_table) - len(failed)
        print(f"\n{plural(len(cases_table), 'case')}, {done} done, {len(failed)} failed")
        for row, why in [*errors.items()][:_SHOWN]:
            print(paragraph(why, "    ", f"  case {row}: "))
        if len(failed) > _SHOWN:
            print(f"  and {len(failed) - _SHOWN} more")
        print("\n".join(f"wrote {path}" for path in files) or "nothing saved (--out FILE saves it)")
    if len(failed) == len(cases_table):
        raise SceneError(f"none of the cases has an answer: {errors[1]}")
    return 0


def _ranges(cases_table: Columns) -> str:
    """Least and largest value of every column that has any but zero, and their rows."""
    rows = []
    for name, values in cases_table.arrays.items():
        if values.dtype.kind != "f" or not np.any(values[~np.isnan(values)]):
            continue
        low, high = int(np.nanargmin(values)), int(np.nanargmax(values))
        ends = ["rigid" if np.isinf(x) else number(float(x)) for x in values[[low, high]]]
        unit = cases_table.units.get(name, "")
        rows.append([name, unit, ends[0], str(low + 1), ends[1], str(high + 1)])
    return table("Range of every number", "column|unit|least|in row|largest|in row", rows, (44, 8))
