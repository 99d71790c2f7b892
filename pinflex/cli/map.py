"""`pinflex map`: frequencies and stiffness over a grid of poses."""

from __future__ import annotations

import argparse

import numpy as np

from pinflex.cli import batch
from pinflex.cli.console import Progress, load_model
from pinflex.studies.cases import parsed
from pinflex.studies.frequency_map import check_figure
from pinflex.studies.plot_pose_map import save_pose_map
from pinflex.studies.pose_map import PoseMap, pose_map
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
    return batch.answer(args, found.table, out, figures, _notes(found))


def _notes(found: PoseMap) -> list[str]:
    """What the words and the missing numbers of the table mean."""
    if not np.isfinite(found.compliance).any():
        return []
    notes = [
        "K_xx (others held) is the force for a displacement along x with the other displacements "
        "zero; 1/C_xx (others free) that with the platform free to give way in them."
    ]
    if found.rigid:
        notes.append(
            f"The platform is rigid along {', '.join(found.rigid)}: no flexible link or spring "
            "gives way there, so there is no number (null in JSON, inf in tables)."
        )
    return notes
