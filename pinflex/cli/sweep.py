"""`pinflex sweep`: many cases of a scene in one table."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from pinflex.cli import parser
from pinflex.errors import DescriptionError
from pinflex.text import paragraph

if TYPE_CHECKING:
    from pinflex.results.columns import Columns

_KINDS = ("normal", "uniform")


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "sweep",
        "many cases of a scene in one table",
        """
Solves the scene for every combination of the values given. Values are a:b:n (n from a to b),
a:b:n:log (by equal factors) or v,w,... A case that fails gets a row that says why. Each case is
kept as it ends, in FILE.journal: stopped or killed, the same command goes on from there; when all
have an answer the journal goes.""",
        "pinflex sweep ur5 --set flexible.*.section.wall=2e-3:5e-3:7 \\\n"
        "      --set motion.duration=0.4,0.6 --level quasistatic --out sweep.csv",
        model=False,
    )
    p.add_argument("model", metavar="MODEL", help="YAML file, its folder, or a shipped name")
    parser.repeated(
        p, "--set", "KEY=VALUES",
        "values of a key of the YAML, which may have globs; may be repeated",
    )  # fmt: skip
    parser.carried(p)
    p.add_argument(
        "--zip", action="store_true", help="pair the values instead of combining them all"
    )
    p.add_argument("--level", help="rigid, quasistatic, ked or coupled (default: the YAML's)")
    p.add_argument(
        "--outputs",
        metavar="A,B,...",
        help="torque, deviation, stress, frequency, cost, validity (default all)",
    )
    p.add_argument(
        "--random", type=parser.count, metavar="N",
        help="random designs instead of combinations, at most N: quantiles and Sobol indices",
    )  # fmt: skip
    parser.repeated(
        p, "--normal", "KEY=MEAN:STD", "with --random: normal; or KEY=2%% about its value"
    )
    parser.repeated(p, "--uniform", "KEY=A:B", "with --random: between A and B; or KEY=2%%")
    p.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    p.add_argument("--plot", metavar="FILE", help="with --random: histograms and shares, .png")
    parser.table(p)


def run(args: argparse.Namespace) -> int:
    """Solve many cases and write their table."""
    from pinflex.cli import batch
    from pinflex.studies.batch import Interrupted
    from pinflex.studies.outputs import OUTPUTS
    from pinflex.studies.sweep import parsed, sweep

    if args.random is not None:
        return _random(args)
    for option in ("normal", "uniform", "plot"):
        if getattr(args, option):
            raise DescriptionError(f"--{option} belongs to random designs. Add --random N.")
    out, options = batch.options(args)
    outputs = OUTPUTS if args.outputs is None else parser.names(args.outputs)
    with batch.CaseBar("sweep", options) as bar:
        try:
            columns = sweep(
                args.model, parsed(args.set, "--set"), level=args.level, outputs=outputs,
                paired=args.zip, progress=bar, **options,
            )  # fmt: skip
        except Interrupted as stop:
            if out is not None and stop.table:  # any rows
                stop.table.save(out)
            raise
    return batch.answer(args, columns, out, [], _screen(columns, args.set), bar, _notes(args.set))


def _screen(columns: Columns, given: list[str]) -> str:
    """The table of cases, and a sentence on what varies."""
    from pinflex.cli.cases_text import case_table, main_columns, sentence

    parameters = [x for x in (text.partition("=")[0].strip() for text in given) if x in columns]
    names = main_columns(columns, list(dict.fromkeys(parameters)))
    said = sentence(columns, names[len(set(parameters)) :])
    return "\n\n".join(filter(None, [case_table(columns, names), paragraph(said)]))


def _notes(given: list[str]) -> list[str]:
    if given:
        return []
    return [
        "No --set was given: this is the one case that the YAML has. Give values of a key, such as "
        "--set flexible.*.section.thickness=1e-3:3e-3:5."
    ]


def _random(args: argparse.Namespace) -> int:
    """Solve random designs; their table, quantiles and indices."""
    from pinflex.cli import batch
    from pinflex.cli.console import print_json, say_written
    from pinflex.description.description import read
    from pinflex.variation.scatter import OUTPUTS, scatter
    from pinflex.writing import writable

    out, options = batch.options(args)
    writable(args.plot)
    normal, uniform = (dict(_pair(x, kind) for x in getattr(args, kind)) for kind in _KINDS)
    with batch.CaseBar("sweep", options) as bar:
        found = scatter(
            read(args.model).with_overrides(args.set), args.random, seed=args.seed,
            normal=normal, uniform=uniform, level=args.level, progress=bar,
            outputs=OUTPUTS if args.outputs is None else parser.names(args.outputs), **options,
        )  # fmt: skip
    files = [] if out is None else [found.table.save(out)]
    if out is not None and not np.any(found.table["status"] == "failed"):
        batch.journal(out).unlink(missing_ok=True)
    if args.plot is not None:
        found.plot(args.plot)
        files.append(args.plot)
    if args.json:
        print_json(found.as_json() | {"files": files, "cases_per_second": bar.rate})
        return 0
    print(found.text())
    failed = int((found.table["status"] == "failed").sum())
    print(f"\n{len(found.table)} designs, {failed} failed{bar.text()}")
    say_written(files, "--out FILE")
    return 0


def _pair(text: str, kind: str) -> tuple[str, str]:
    key, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not key:
        raise DescriptionError(f"--{kind} {text}: not of the form KEY=VALUES. Write one.")
    return key, value
