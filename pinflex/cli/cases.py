"""`pinflex sweep` and `pinflex map`: many cases or poses of a scene in one table."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

import pinflex as pf
from pinflex.cli.console import answer, check_files, load_model, say_written
from pinflex.cli.options import values
from pinflex.errors import DescriptionError, SceneError
from pinflex.progress import Bar
from pinflex.report import Column, Report, Table, lines, table
from pinflex.results.pose_map import AXES, Columns, PoseMap, check_suffix, free, held
from pinflex.text import COLUMNS, number, plural
from pinflex.writing import writable

_FAILURES = 5  # in the answer for people; the table has them all
_ROWS = 20  # of cases on one screen
_MAIN = ("deviation.position", "stress.peak", "frequency.1", "torque.peak", "stress.yield")
_SAID = 3  # of them in the sentence
_IN = {"Pa": ("MPa", 1e-6), "m": ("mm", 1e3)}  # outputs as a person says them
_ENDS = 2  # last words of a key path that name a parameter
_KINDS = ("normal", "uniform")
_SAVES = "--out FILE saves it"


def run_sweep(args: argparse.Namespace) -> int:
    """Solve many cases and write their table."""
    from pinflex.studies.batch import Interrupted
    from pinflex.studies.sweep import parsed

    if args.random is not None:
        return _random(args)
    for option in (*_KINDS, "plot"):
        if getattr(args, option):
            raise DescriptionError(f"--{option} belongs to random designs. Add --random N.")
    out, options = _batch(args)
    with CaseBar("sweep", options) as bar:
        try:
            cases = pf.sweep(
                args.model, parsed(args.set, "--set"), **values(args), **options, progress=bar
            )
        except Interrupted as stop:
            if out is not None and stop.table:  # any rows
                stop.table.save(out)
            raise
    notes = () if args.set else (
        "No --set was given: this is the one case that the YAML has. Give values of a key, such as "
        "--set flexible.*.section.thickness=1e-3:3e-3:5.",
    )  # fmt: skip
    return _answer(args, cases, _sweep_report(cases, args.set), bar, notes, out)


def run_map(args: argparse.Namespace) -> int:
    """Frequencies and stiffness over a grid of poses: table and figure."""
    from pinflex.solver.solve import default_motion
    from pinflex.studies.sweep import parsed
    from pinflex.viewer.plots.maps import axes_of_map

    out, options = _batch(args)
    check_files(args.plot)
    mechanism = load_model(args)
    grid, where = parsed(args.grid, "--grid"), values(args)
    if "instants" in where:
        where["along"] = default_motion(mechanism)
    if args.play is not None:
        return _play(args, mechanism, {"grid": grid} | where, out, options)
    with CaseBar("map", options) as bar:
        poses = pf.pose_map(mechanism, grid=grid, **where, **options, progress=bar)
    if args.plot is not None:
        axes_of_map(poses, path=args.plot)
    notes = _map_notes(poses)
    if not grid and "instants" not in where:
        notes.append(
            "No --grid and no --instants were given: this is home alone. Add, for instance, "
            "--grid x=-.05:.05:9, or --instants 41 for poses of the motion."
        )
    return _answer(args, poses.table, _map_report(poses), bar, notes, out)


def _play(
    args: argparse.Namespace,
    mechanism: pf.Mechanism,
    where: Mapping[str, Any],
    out: Path | None,
    options: Mapping[str, Any],
) -> int:
    """The play of the platform over a grid of poses: table and figure."""
    from pinflex.viewer.plots.maps import axes_of_plays

    poses = {key: where[key] for key in ("grid", "along", "instants") if key in where}
    with CaseBar("map", {**options, "jobs": 1, "scheduler": None}) as bar:
        plays = pf.play_map(mechanism, **poses, clearance=args.play or None, progress=bar)
    if args.plot is not None:
        axes_of_plays(plays, path=args.plot)
    found = plays.plays.reshape(-1)
    alone = len(found) == 1 and found[0] is not None
    screen = Report("play", (found[0].as_table() if alone else ranges(plays.table),))
    notes = [
        "play is the longest way of the platform's origin to a side, play.x that along x with the "
        "other displacements free; links rigid, axes of pins parallel, to first order."
    ]
    return _answer(args, plays.table, screen, bar, notes, out)


def _random(args: argparse.Namespace) -> int:
    """Solve random designs; their table, quantiles and indices."""
    from pinflex.description.description import read

    out, options = _batch(args)
    writable(args.plot)
    given: dict[str, Any] = {name: x for name, x in values(args).items() if name != "paired"}
    given |= {kind: dict(_pair(x, kind) for x in getattr(args, kind)) for kind in _KINDS}
    with CaseBar("sweep", options) as bar:
        study = pf.scatter(
            read(args.model).with_overrides(args.set), args.random, seed=args.seed,
            **given, **options, progress=bar,
        )  # fmt: skip
    failed = int((study.table["status"] == "failed").sum())
    files: list[Any] = [] if out is None else [study.table.save(out)]
    if out is not None and not failed:
        _journal(out).unlink(missing_ok=True)
    if args.plot is not None:
        study.plot(args.plot)
        files.append(args.plot)
    text = f"{study.text()}\n{len(study.table)} designs, {failed} failed{bar.text()}\n"
    data = study.as_json() | {"cases_per_second": bar.rate}
    return answer(args, data, text, files, _SAVES)


def _pair(text: str, kind: str) -> tuple[str, str]:
    key, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not key:
        raise DescriptionError(f"--{kind} {text}: not of the form KEY=VALUES. Write one.")
    return key, value


# A batch and its answer ----------------------------------------------------------------------


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


def _batch(args: argparse.Namespace) -> tuple[Path | None, dict[str, Any]]:
    """The file of the table, checked, and what a batch takes: processes and journal."""
    from joblib import cpu_count

    out = None if args.out is None else check_suffix(args.out)
    writable(out)
    return out, {
        "jobs": cpu_count() if args.jobs is None else args.jobs,
        "scheduler": args.scheduler,
        "journal": None if out is None else _journal(out),
        "fresh": args.fresh,
    }


def _journal(out: Path) -> Path:
    """File that keeps the cases of a table as they end."""
    return out.with_name(f"{out.name}.journal")


def _answer(
    args: argparse.Namespace,
    cases: Columns,
    screen: Report,
    bar: CaseBar,
    notes: Sequence[str],
    out: Path | None,
) -> int:
    """Write the table and say what is in it; an error where no case has an answer.

    The journal has done its work where every case has an answer, and goes.
    """
    files = [] if out is None else [cases.save(out)]
    files += [Path(args.plot)] if args.plot else []
    errors = {
        k: str(why)
        for k, (status, why) in enumerate(zip(cases["status"], cases["error"], strict=True), 1)
        if status == "failed"
    }
    if out is not None and not errors:
        _journal(out).unlink(missing_ok=True)
    data = {
        "columns": {name: column.tolist() for name, column in cases.arrays.items()},
        "units": cases.units, "files": files, "notes": notes, "cases_per_second": bar.rate,
    }  # fmt: skip
    count = f"{plural(len(cases), 'case')}, {len(cases) - len(errors)} done, {len(errors)} failed"
    more = len(errors) - _FAILURES
    report = Report(screen.title, (
        *screen.blocks,
        ranges(cases) if args.verbose else "",
        *(lines(note, indent="  ") for note in notes),
        (
            f"{count}{bar.text()}",
            *(
                lines(why, indent="    ", first=f"  case {row}: ")
                for row, why in [*errors.items()][:_FAILURES]
            ),
            lines(f"and {more} more", indent="  ") if more > 0 else "",
        ),
    ))  # fmt: skip
    answer(args, data, report.text())
    if not args.json:
        say_written(files, _SAVES)
    if len(errors) == len(cases):
        raise SceneError(f"none of the cases has an answer: {errors[1]}")
    return 0


# Screens -------------------------------------------------------------------------------------


def _sweep_report(cases: Columns, given: Sequence[str]) -> Report:
    """The table of cases, and a sentence on what varies."""
    parameters = [x for x in (text.partition("=")[0].strip() for text in given) if x in cases]
    shown = main_columns(cases, list(dict.fromkeys(parameters)))
    varying = sentence(cases, shown[len(set(parameters)) :])
    return Report("cases", (case_table(cases, shown), varying))


_SINGULAR = 4  # places that are named


def _map_report(poses: PoseMap) -> Report:
    """Ranges of frequencies and of the stiffness along each axis, and a sentence on both."""
    every, compliance = poses.table, np.diagonal(poses.compliance, axis1=-2, axis2=-1)
    main = [name for name in every if name.startswith("frequency.")]
    main += [name for i, axis in enumerate(AXES) if axis not in poses.rigid
             for name in (free(i), held(i, i)) if name in every]  # fmt: skip
    shown = Columns({name: every[name] for name in (*poses.grid, *main)}, every.units)
    said = []
    modes = [every[name] for name in every if name.startswith("frequency.")]
    lowest = np.fmin.reduce(modes) if modes else np.zeros(0)  # modes are followed, and may cross
    if np.isfinite(lowest).any():
        ends = number(float(np.nanmin(lowest))), number(float(np.nanmax(lowest)))
        span = ends[0] if ends[0] == ends[1] else " to ".join(ends)
        said.append(f"The lowest frequency is {span} Hz.")
    soft = compliance.reshape(-1, 6)[:, :3]
    if np.isfinite(soft).any() and np.nanmax(soft) > 0:
        pose, axis = np.unravel_index(int(np.nanargmax(soft)), soft.shape)
        said.append(
            f"The platform gives way most along {AXES[axis]} at pose {int(pose) + 1}: "
            f"{number(1.0 / float(soft[pose, axis]))} N/m."
        )
    return Report("poses", (ranges(shown), " ".join(said)))


def _map_notes(poses: PoseMap) -> list[str]:
    """Notes on the words and the missing numbers of the table."""
    passed = [
        f"A singular pose lies between {'; '.join(poses.passed[:_SINGULAR])}"
        f"{' ...' * (len(poses.passed) > _SINGULAR)}: there the motors do not hold the platform, "
        "stiffness falls to nothing, and no motion passes it under control."
    ] * bool(poses.passed)
    if not np.isfinite(poses.compliance).any():
        return passed
    notes = [
        *passed,
        "K_xx (others held) is the force for a displacement along x with the other displacements "
        "zero; 1/C_xx (others free) that with the platform free to give way in them.",
    ]
    if poses.rigid:
        notes.append(
            f"The platform is rigid along {', '.join(poses.rigid)}: no flexible link or spring "
            "gives way there, so there is no number."
        )
    return notes


def main_columns(cases: Columns, parameters: Sequence[str]) -> list[str]:
    """Parameters, then the most important numbers that the cases have."""
    shown = [*parameters]
    for head in _MAIN:
        named = [n for n in cases if n == head or n.startswith(f"{head}.")]
        shown += [n for n in named if n not in shown and _known(cases, n)][:3]
    return shown


def case_table(cases: Columns, shown: Sequence[str]) -> Table:
    """One row for each case, the first ones where there are many."""
    count = min(len(cases), _ROWS)
    more, every = len(cases) - count, [Column("case", lambda k: k + 1)]
    wide = 6
    for name in shown:
        unit, _ = _person(cases, name)
        head = short_key(name) + (f" [{unit}]" if unit else "")
        column = Column(head, cases[name].item, _cell)
        wide += 2 + max(len(head), *(len(column.cell(k)) for k in range(count)))
        if wide > COLUMNS:
            break
        every.append(column)
    title = "Cases" + (f", the first {_ROWS} ({more} more in the table: --out)" if more else "")
    return Table(title, tuple(every), tuple(range(count)), (6,))


def sentence(cases: Columns, shown: Sequence[str]) -> str:
    """Range of each number, and the cases of its extremes."""
    said = []
    for name in [*shown][:_SAID]:
        column = cases[name]
        some = np.isfinite(column) if column.dtype.kind == "f" else np.zeros(len(column), bool)
        if np.count_nonzero(some) < 2:
            continue
        low, high = (int(f(np.where(some, column, g))) for f, g in
                     ((np.argmin, np.inf), (np.argmax, -np.inf)))  # fmt: skip
        unit, factor = _person(cases, name)
        ends = [number(factor * float(column[k])) for k in (low, high)]
        if ends[0] == ends[1]:
            said.append(f"{short_key(name)} stays at {ends[0]} {unit}".rstrip())
        else:
            largest = f"{ends[1]} {unit}".rstrip()
            said.append(
                f"{short_key(name)} goes from {ends[0]} (case {low + 1}) to {largest} "
                f"(case {high + 1})"
            )
    return f"{'; '.join(said)}." if said else ""


def _person(cases: Columns, name: str) -> tuple[str, float]:
    """Unit in which a person says a column, and the factor to it."""
    unit = cases.units.get(name, "")
    return _IN.get(unit, (unit, 1.0))


def ranges(cases: Columns) -> Table:
    """Least and largest value of every column that has any but zero, and their rows."""
    rows = []
    for name, column in cases.arrays.items():
        if column.dtype.kind != "f" or not np.any(column[~np.isnan(column)]):
            continue
        low, high = int(np.nanargmin(column)), int(np.nanargmax(column))
        ends = float(column[low]), low + 1, float(column[high]), high + 1
        rows.append((name, cases.units.get(name, ""), *ends))
    heads = ("column", "unit", "least", "in row", "largest", "in row")
    columns = [(head, itemgetter(k), str if k == 1 else _cell) for k, head in enumerate(heads)]
    return table("Range of every number", rows, *columns, names=(44, 8))


def short_key(name: str) -> str:
    """The last words of a key path; an output as it is."""
    parts = name.split(".")
    return ".".join(parts[-_ENDS:]) if len(parts) > 3 else name


def _known(cases: Columns, name: str) -> bool:
    values = cases[name]
    return values.dtype.kind == "f" and bool(np.isfinite(values).any())


def _cell(value: Any) -> str:
    """A number, or a word where the value is one."""
    if not isinstance(value, float):
        return str(value) or "-"
    if not np.isfinite(value):
        return "-" if np.isnan(value) else "rigid"
    return number(value)
