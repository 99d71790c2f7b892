"""`pinflex bench`: work and precision on a scene."""

from __future__ import annotations

import argparse
import json
from collections.abc import Container, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json
from pinflex.errors import DescriptionError
from pinflex.progress import Bar
from pinflex.text import number, paragraph, table
from pinflex.writing import plain, writable, write_text

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.studies.bench import Bench, Point

_ERRORS = (1e-1, 1e-2, 1e-3)  # that the advice is about


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "bench",
        "time against error on a scene",
        """
Solves the scene by every level, by more and fewer internal modes, by several integrators and steps,
and compares time and error with a converged solution that it refines until two runs agree.
With --worst it takes single steps of the robot in the loop (pf.Simulator) along its motion and
back, and tells what they cost: median, rare ones and the largest, in thread CPU time.""",
        "pinflex bench 3rrs -o out\n  pinflex bench ur5 --worst --dt 2.5e-4",
        model=False,
    )
    p.add_argument("model", nargs="?", metavar="MODEL", help="YAML file, its folder, or a name")
    parser.repeated(p, "--set", "KEY=VALUE", "change the YAML; may be repeated")
    p.add_argument("-o", "--output", metavar="DIR", help="write table, numbers and figure there")
    parser.verbose(p)
    p.add_argument("--worst", action="store_true", help="the cost of single steps in the loop")
    p.add_argument(
        "--steps", type=int, metavar="N", help="number of steps of --worst (default: 1000000)"
    )
    p.add_argument(
        "--dt", type=parser.positive, metavar="S", help="step of --worst in s (default: 1e-3)"
    )
    p.add_argument("--race", nargs="?", const="", help=argparse.SUPPRESS)


def run(args: argparse.Namespace) -> int:
    """Solve the scene in many ways; print time against error."""
    from pinflex.studies.bench import bench

    if args.race is not None:
        raise DescriptionError(
            "bench --race: the race beside Exudyn is part of the source, not of the package. In a "
            "checkout: python -m tests.benchmarks.race [R1,...] [--report FILE.md]."
        )
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
    data = _json(study)
    text = write(study, whole=True)
    files = [] if folder is None else _save(study, folder, text, data)
    if args.json:
        print_json(data)
    else:
        print(write(study, args.verbose), end="")
        print("".join(f"wrote {path}\n" for path in files), end="")
    return 0


def _worst(mechanism: Mechanism, args: argparse.Namespace) -> int:
    """Print what single steps cost."""
    from pinflex.live.cost import step_cost

    steps = 1_000_000 if args.steps is None else args.steps
    found = step_cost(mechanism, steps, 1e-3 if args.dt is None else args.dt)
    if args.json:
        print_json(plain(asdict(found)))
        return 0
    rows = [
        [f"{share:g} %", number(1e6 * x), number(1e6 * found.same[share])]
        for share, x in found.percentiles.items()
    ]
    rows += [["largest", number(1e6 * found.largest), number(1e6 * found.same_largest)]]
    title = f"{found.name}: {found.steps} steps of {found.dt:g} s, thread CPU time"
    mean, most = found.iterations
    told = (
        f"Newton iterations of a step: {mean:.1f}, {most} at the most; {found.tangents[0]} new "
        f"tangents, {found.tangents[1]} of a step at the most. Largest of an empty call: "
        f"{number(1e6 * found.empty)} us."
    )
    if found.left_alone is not None:
        told += (
            f" The system took the processor away in {found.preempted} steps; largest of the "
            f"others: {number(1e6 * found.left_alone)} us. Page faults in steps: {found.faults}."
        )
    print(
        table(title, "share|step us|same arithmetic us", rows, (12, 10)),
        paragraph(told),
        sep="\n\n",
    )
    return 0


def write(study: Bench, whole: bool = False) -> str:
    """Table, fastest first, and advice; points that others beat in everything are counted."""
    best = {id(p) for p in study.pareto()}
    points = sorted((p for p in study.points if not p.failed), key=lambda p: p.cpu)
    shown = points if whole else [p for p in points if id(p) in best]
    failures = [p for p in study.points if p.failed]
    own = ", ".join(f"{name} {error:.1e}" for name, error in study.own_error.items())
    last = paragraph(f"Reference: {study.reference}. Its own error: {own}.") + "\n"
    rest = _reasons(failures) if whole else _hidden(len(points) - len(shown), len(failures))
    return "\n\n".join([_points(study, shown, best), paragraph(advice(study)), last + rest])


def _points(study: Bench, points: Sequence[Point], best: Container[int]) -> str:
    """A row for each point; a star for those that no other beats in everything, by their id."""
    outputs = list(study.own_error)
    header = ["method", "setting", study.key or "modes", "wall s", "CPU s"]
    header += [name.replace("platform ", "") for name in outputs] + ["Pareto"]
    rows = [
        [p.case.method, p.case.setting, str(p.case.modes if p.case.modes is not None else "-"),
         number(p.wall), number(p.cpu), *(f"{p.errors[name]:.1e}" for name in outputs),
         "*" if id(p) in best else ""]
        for p in points
    ]  # fmt: skip
    return table(f"{study.name}: time and relative error", "|".join(header), rows, (12, 20))


def _reasons(failures: Sequence[Point]) -> str:
    """Why each of them failed, a paragraph each."""
    texts = (f"{p.case.method}, {p.case.setting}: {p.failed}" for p in failures)
    return "".join(paragraph(text, indent="  ") + "\n" for text in texts)


def _hidden(worse: int, failed: int) -> str:
    """How many points are not shown, by what they are."""
    counts = ((worse, "slower and worse than one of these"), (failed, "failed"))
    some = [f"{n} {what}" for n, what in counts if n]
    return paragraph(f"{'; '.join(some)}: -v shows them.") + "\n" if some else ""


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


def _json(study: Bench) -> dict[str, object]:
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
