"""`pinflex bench` and `verify`: work and precision on a scene, published cases on this machine."""

from __future__ import annotations

import argparse
import json
from collections.abc import Container, Sequence
from dataclasses import asdict
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pinflex as pf
from pinflex.cli.console import answer, load_model
from pinflex.errors import DescriptionError
from pinflex.progress import Bar, Stages
from pinflex.report import Report, Table, lines, table
from pinflex.text import number
from pinflex.writing import plain, writable, write_text

if TYPE_CHECKING:
    from pinflex.studies.bench import Bench, Point

_ERRORS = (1e-1, 1e-2, 1e-3)  # that the advice is about


def run_bench(args: argparse.Namespace) -> int:
    """Solve the scene in many ways; print time against error."""
    from pinflex.studies.bench import bench

    if args.model is None:
        raise DescriptionError("bench: no model. Name one.")
    if not args.worst and (args.steps is not None or args.dt is not None):
        raise DescriptionError("bench: --steps and --dt are those of --worst. Add it.")
    mechanism = load_model(args)
    if args.worst:
        return _worst(mechanism, args)
    folder = None if args.output is None else Path(args.output)
    if folder is not None:
        writable(folder / "bench.png")
    with Bar("bench") as bar:
        study = bench(mechanism, bar)
    data = _data(study)
    files = [] if folder is None else _save(study, folder, report(study, whole=True).text(), data)
    written = "".join(f"wrote {path}\n" for path in files)
    return answer(args, data, report(study, args.verbose).text() + written)


def _worst(mechanism: pf.Mechanism, args: argparse.Namespace) -> int:
    """Print what single steps cost."""
    from pinflex.live.cost import step_cost

    steps = 1_000_000 if args.steps is None else args.steps
    cost = step_cost(mechanism, steps, 1e-3 if args.dt is None else args.dt)
    rows = [(f"{share:g} %", x, cost.same[share]) for share, x in cost.percentiles.items()]
    rows.append(("largest", cost.largest, cost.same_largest))
    mean, most = cost.iterations
    words = (
        f"Newton iterations of a step: {mean:.1f}, {most} at the most; {cost.tangents[0]} new "
        f"tangents, {cost.tangents[1]} of a step at the most. Largest of an empty call: "
        f"{number(1e6 * cost.empty)} us."
    )
    if cost.left_alone is not None:
        words += (
            f" The system took the processor away in {cost.preempted} steps; largest of the "
            f"others: {number(1e6 * cost.left_alone)} us. Page faults in steps: {cost.faults}."
        )
    text = Report(cost.name, (
        table(
            f"{cost.name}: {cost.steps} steps of {cost.dt:g} s, thread CPU time", rows,
            ("share", itemgetter(0)), ("step us", lambda row: 1e6 * row[1]),
            ("same arithmetic us", lambda row: 1e6 * row[2]), names=(12, 10),
        ),
        words,
    )).text()  # fmt: skip
    return answer(args, asdict(cost), text)


def report(study: Bench, whole: bool = False) -> Report:
    """Table, fastest first, and advice; points that others beat in everything are counted."""
    best = {id(p) for p in study.pareto()}
    points = sorted((p for p in study.points if not p.failed), key=lambda p: p.cpu)
    shown = points if whole else [p for p in points if id(p) in best]
    failures = [p for p in study.points if p.failed]
    own = ", ".join(f"{name} {error:.1e}" for name, error in study.own_error.items())
    reasons = lines(
        *(f"{p.case.method}, {p.case.setting}: {p.failed}" for p in failures), indent="  "
    )
    last = reasons if whole else _hidden(len(points) - len(shown), len(failures))
    return Report(study.name, (
        _points(study, shown, best),
        advice(study),
        (f"Reference: {study.reference}. Its own error: {own}.", last),
    ))  # fmt: skip


def _points(study: Bench, points: Sequence[Point], best: Container[int]) -> Table:
    """A row for each point; a star for those that no other beats in everything, by their id."""
    errors = [
        (name.replace("platform ", ""), lambda p, name=name: p.errors[name], "{:.1e}".format)
        for name in study.own_error
    ]
    return table(
        f"{study.name}: time and relative error", points, ("method", lambda p: p.case.method),
        ("setting", lambda p: p.case.setting), (study.key or "modes", lambda p: p.case.modes),
        ("wall s", "wall"), ("CPU s", "cpu"), *errors,
        ("Pareto", lambda p: "*" if id(p) in best else ""), names=(12, 20),
    )  # fmt: skip


def _hidden(worse: int, failed: int) -> str:
    """How many points are not shown, by what they are."""
    counts = ((worse, "slower and worse than one of these"), (failed, "failed"))
    some = [f"{n} {what}" for n, what in counts if n]
    return f"{'; '.join(some)}: -v shows them." if some else ""


def advice(study: Bench) -> str:
    """Cheapest method for each error, in one sentence."""
    parts: list[str] = []
    last: Point | None = None
    for error in _ERRORS:
        point = next((p for p in study.pareto() if p.worst <= error), None)
        if point is not None and point is not last:
            c = point.case
            modes = "" if c.modes is None else f", {study.key} {c.modes}"
            setting = "" if not c.value else f" ({c.setting}{modes})"
            parts.append(f"{error:g} costs {number(point.cpu)} s by {c.method}{setting}")
            last = point
    if not parts:
        return "No case keeps every output within 0.1: refine the model, or look at the errors."
    return f"An error of every output within {'; within '.join(parts)}."


def _data(study: Bench) -> dict[str, Any]:
    best = {id(p) for p in study.pareto()}
    points = [{**asdict(p), "pareto": id(p) in best} for p in study.points]
    return {
        "name": study.name, "reference": study.reference, "reference_error": study.own_error,
        "points": points, "advice": advice(study),
    }  # fmt: skip


def _save(study: Bench, folder: Path, text: str, data: dict[str, object]) -> list[Path]:
    from pinflex.studies.bench import figure

    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"bench.{kind}" for kind in ("txt", "json", "png")]
    write_text(paths[0], text)
    write_text(paths[1], json.dumps(plain(data), indent=2))
    figure(study).savefig(paths[2])
    return paths


def run_verify(args: argparse.Namespace) -> int:
    """Print the table or JSON, write the page; 1 if something fails."""
    from pinflex.lab.verify import verdict, verify, write_page

    writable(args.output)
    stages = Stages(Bar)

    def show(table: str) -> None:  # case by case: all of them take minutes
        stages.close()
        print(f"{table}\n", flush=True)

    def next_case(name: str, k: int, n: int) -> None:
        stages(f"{name} ({k + 1} of {n})")

    try:
        outcome = verify(args.cases, next_case, args.long, None if args.json else show)
    finally:
        stages.close()
    page = None if args.output is None else write_page(outcome, args.output)
    data = {"passed": outcome.passed, "records": outcome.to_json(), "page": page}
    written = "" if page is None else f"\nwrote {page}\n"
    answer(args, data, f"{verdict(outcome)}\n{written}")
    return 0 if outcome.passed else 1
