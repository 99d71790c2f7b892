"""`pinflex map`: frequencies and stiffness over a grid of poses."""

from __future__ import annotations

import argparse

from pinflex.cli import batch
from pinflex.cli.console import Progress, load_model
from pinflex.studies.cases import parsed
from pinflex.studies.frequency_map import check_figure
from pinflex.studies.plot_pose_map import save_pose_map
from pinflex.studies.pose_map import pose_map
from pinflex.writing import writable


def run(args: argparse.Namespace) -> int:
    """Frequencies and stiffness over a grid of poses: table and figure."""
    out, options = batch.options(args)
    if args.plot is not None:
        writable(check_figure(args.plot))
    mechanism = load_model(args)
    bar = Progress("map")
    try:
        found = pose_map(
            mechanism, parsed(args.grid, "--grid"), count=args.count, preload=args.preload,
            free_motors=args.free_motors, progress=bar, **options,
        )  # fmt: skip
    finally:
        bar.close()
    figures = [] if args.plot is None else [save_pose_map(found, args.plot)]
    return batch.answer(args, found.table, out, figures)
