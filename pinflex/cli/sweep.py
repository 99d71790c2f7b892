"""`pinflex sweep`: many cases of a scene in one table."""

from __future__ import annotations

import argparse

from pinflex.cli import parser
from pinflex.cli.console import Progress


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "sweep",
        "many cases of a scene in one table",
        """
Solves the scene for every combination of the values given. Values are a:b:n (n from a to b),
a:b:n:log (by equal factors) or v,w,... A case that fails gets a row that says why. Each case is
kept as it ends, in FILE.journal: stopped or killed, the same command goes on from there.""",
        "pinflex sweep ur5 --set flexible.*.section.wall=2e-3:5e-3:7 \\\n"
        "      --set motion.duration=0.4,0.6 --level quasistatic --out sweep.csv",
        model=False,
    )
    p.add_argument("model", metavar="MODEL", help="YAML file, its folder, or a shipped name")
    parser.repeated(
        p, "--set", "KEY=VALUES",
        "values of a key of the YAML, which may have globs; may be repeated",
    )  # fmt: skip
    p.add_argument(
        "--zip", action="store_true", help="pair the values instead of combining them all"
    )
    p.add_argument("--level", help="rigid, quasistatic, ked or coupled (default: the YAML's)")
    p.add_argument(
        "--outputs",
        metavar="A,B,...",
        help="torque, deviation, stress, frequency, cost, validity (default all)",
    )
    parser.table(p)


def run(args: argparse.Namespace) -> int:
    """Solve many cases and write their table."""
    from pinflex.cli import batch
    from pinflex.studies.batch import Interrupted
    from pinflex.studies.cases import parsed
    from pinflex.studies.outputs import OUTPUTS
    from pinflex.studies.sweep import sweep

    out, options = batch.options(args)
    outputs = OUTPUTS if args.outputs is None else parser.names(args.outputs)
    bar = Progress("sweep")
    try:
        columns = sweep(
            args.model, parsed(args.set, "--set"), level=args.level, outputs=outputs,
            paired=args.zip, progress=bar, **options,
        )  # fmt: skip
    except Interrupted as stop:
        if out is not None and stop.table:  # any rows
            stop.table.save(out)
        raise
    finally:
        bar.close()
    return batch.answer(args, columns, out, [])
