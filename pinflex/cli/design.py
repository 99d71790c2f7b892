"""`pinflex design`: the numbers that make an output least while others keep their limits."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, say_written, written
from pinflex.errors import DescriptionError
from pinflex.progress import Bar


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "design",
        "the numbers that make an output least while others keep their limits",
        """
Varies numbers of the YAML between bounds. Limits are OUTPUT < NUMBER or OUTPUT > NUMBER, where
NUMBER*base is a share of the first design and NUMBER*yield one of the strength. With -o every
design is kept in FILE.journal: stopped or killed, the same command goes on from there.""",
        "pinflex design delta --minimise mass --vary 'flexible.*.section.wall=0.6e-3:4e-3' \\\n"
        "      --keep 'frequency.1 > base' --keep 'deviation.peak < base' -o lighter.yaml",
    )
    p.add_argument("--minimise", "--minimize", required=True, metavar="OUTPUT", help="such as mass")
    p.add_argument("--against", metavar="OUTPUT", help="a second aim: designs between the two")
    parser.repeated(p, "--vary", "KEY=LOW:HIGH", "number of the YAML, may have globs; repeatable")
    parser.repeated(p, "--keep", "LIMIT", "such as 'frequency.1 > 12'; may be repeated")
    parser.repeated(
        p, "--choose", "KEY=V,W,...|FILE.csv",
        "values to choose from, or rows of a catalogue whose columns are keys below KEY",
    )  # fmt: skip
    p.add_argument(
        "--level", default="quasistatic", help="of the runs outputs need (default quasistatic)"
    )
    p.add_argument("--starts", type=parser.count, default=2, metavar="N", help="searches (2)")
    p.add_argument("--jobs", type=parser.count, default=1, metavar="N", help="processes (1)")
    p.add_argument("-o", "--output", metavar="FILE", help="write the YAML of the best design")
    p.add_argument("--plot", metavar="FILE", help="write how the search went, .png or .pdf")


def run(args: argparse.Namespace) -> int:
    """Search, and say what was found and what limits it."""
    from pinflex.variation.optimise import design, pareto
    from pinflex.writing import writable

    for path in (args.output, args.plot):
        writable(path)
    vary = dict(_bounds(text) for text in args.vary)
    choose = dict(_choice(text) for text in args.choose)
    robot = load_model(args)
    with Bar("design") as bar:
        options = {
            "choose": choose, "level": args.level, "starts": args.starts, "jobs": args.jobs,
            "journal": f"{args.output}.journal" if args.output else None, "progress": bar,
        }  # fmt: skip
        if args.against is not None:
            front = pareto(robot, args.minimise, args.against, vary, args.keep, **options)
        else:
            front = [design(robot, args.minimise, vary, args.keep, **options)]
    files = written(front[0], args)
    if args.json:
        print_json({"designs": [found.as_json() for found in front], "files": files})
        return 0
    print(_front(front, args.minimise, args.against) if args.against else front[0].text())
    say_written(files)
    return 0


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    key, _, value = (part.strip() for part in text.partition("="))
    low, _, high = value.partition(":")
    try:
        return key, (float(low), float(high))
    except ValueError:
        raise DescriptionError(f"--vary {text}: not of the form KEY=LOW:HIGH. Write one.") from None


def _choice(text: str) -> tuple[str, list[dict[str, float] | float]]:
    key, _, value = (part.strip() for part in text.partition("="))
    try:
        if not value.endswith(".csv"):
            return key, [float(part) for part in value.split(",")]
        with Path(value).open(newline="", encoding="utf-8") as stream:
            return key, [
                {name: float(x) for name, x in row.items()} for row in csv.DictReader(stream)
            ]
    except (ValueError, TypeError) as error:
        raise DescriptionError(
            f"--choose {text}: {error}. Give KEY=V,W,... or KEY=FILE.csv with numbers in columns."
        ) from None


def _front(front: list, minimise: str, against: str) -> str:  # type: ignore[type-arg]
    from pinflex.text import number, table

    heads = [f"{name} [{front[0].units[name]}]" for name in (minimise, against)]
    rows = [
        [str(k), number(d.after[minimise]), number(d.after[against]), *map(number, d.best.tolist())]
        for k, d in enumerate(front, 1)
    ]
    header = "|".join(("design", *heads, *front[0].parameters))
    return table("Designs of which none is better in both", header, rows, (6,))
