"""`pinflex sweep`: many cases of a scene in one table."""

from __future__ import annotations

import argparse

from pinflex.cli import batch
from pinflex.cli.console import Progress
from pinflex.studies.batch import Interrupted
from pinflex.studies.cases import parsed
from pinflex.studies.outputs import OUTPUTS
from pinflex.studies.sweep import sweep


def run(args: argparse.Namespace) -> int:
    """Solve many cases and write their table."""
    out, options = batch.options(args)
    names = OUTPUTS if args.outputs is None else [n.strip() for n in args.outputs.split(",")]
    bar = Progress("sweep")
    try:
        found = sweep(
            args.model, parsed(args.set, "--set"), level=args.level, outputs=names,
            paired=args.zip, progress=bar, **options,
        )  # fmt: skip
    except Interrupted as stop:
        if out is not None and stop.table:  # any rows
            stop.table.save(out)
        raise
    finally:
        bar.close()
    return batch.answer(args, found, out, [])
