"""`pinflex map`: frequencies and stiffness over a grid of poses."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.cli import parser
from pinflex.cli.cases_text import ranges
from pinflex.cli.console import load_model
from pinflex.results.columns import Columns
from pinflex.results.pose_map import AXES, free, held
from pinflex.text import number, paragraph
from pinflex.writing import writable

if TYPE_CHECKING:
    from pathlib import Path

    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.results.pose_map import PoseMap


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "map",
        "natural frequencies and platform stiffness over poses",
        """
Grids are displacements from home: of the platform's x, y, z [m], rz, ry, rx [rad], or of motors.
Coordinates that are not named stay as at home. A frequency's column follows one mode shape from
pose to pose. The 6x6 stiffness is that of the platform in world axes, motors
locked: K_xx (others held) and 1/C_xx (others free); rigid where nothing gives way.""",
        "pinflex map 3rrr --grid x=-.05:.05:9 --grid y=-.05:.05:9 --out map.csv --plot map.png",
    )
    parser.repeated(p, "--grid", "COORDINATE=A:B:N", "values of a coordinate; may be repeated")
    p.add_argument(
        "--instants",
        type=parser.count,
        metavar="N",
        help="poses of the motion of the YAML, evenly in time, instead of a grid",
    )
    p.add_argument(
        "--count", type=parser.count, default=6, metavar="N", help="frequencies (default 6)"
    )
    parser.preload(p)
    p.add_argument("--free-motors", action="store_true", help="frequencies with free motors")
    p.add_argument(
        "--play", nargs="?", const="", metavar="CLEARANCE",
        help="instead, where the platform can be without motors moving: the clearance of loops and "
        "the backlash of drives, or this clearance (50um) in every pin and ball",
    )  # fmt: skip
    p.add_argument("--plot", metavar="FILE.png", help="write a figure (.png, .pdf, .svg)")
    parser.table(p)


def run(args: argparse.Namespace) -> int:
    """Frequencies and stiffness over a grid of poses: table and figure."""
    from pinflex.cli import batch
    from pinflex.solver.solve import default_motion
    from pinflex.studies.pose_map import pose_map
    from pinflex.studies.sweep import parsed
    from pinflex.viewer.plots.drawing import check_figure
    from pinflex.viewer.plots.maps import save_map

    out, options = batch.options(args)
    if args.plot is not None:
        writable(check_figure(args.plot))
    mechanism = load_model(args)
    grid = parsed(args.grid, "--grid")
    where: dict[str, Any] = {"grid": grid}
    if args.instants is not None:
        where |= {"along": default_motion(mechanism), "instants": args.instants}
    if args.play is not None:
        return _play(args, mechanism, where, out, options)
    with batch.CaseBar("map", options) as bar:
        poses = pose_map(
            mechanism, **where, count=args.count, preload=args.preload,
            free_motors=args.free_motors, progress=bar, **options,
        )  # fmt: skip
    figures = [] if args.plot is None else [save_map(poses, args.plot)]
    notes = _notes(poses)
    if not grid and args.instants is None:
        notes.append(
            "No --grid and no --instants were given: this is home alone. Add, for instance, "
            "--grid x=-.05:.05:9, or --instants 41 for poses of the motion."
        )
    return batch.answer(args, poses.table, out, figures, _screen(poses), bar, notes)


def _play(
    args: argparse.Namespace,
    mechanism: Mechanism,
    where: dict[str, Any],
    out: Path | None,
    options: dict[str, Any],
) -> int:
    """The play of the platform over a grid of poses: table and figure."""
    from pinflex.cli import batch
    from pinflex.studies.play import play_map
    from pinflex.viewer.plots.play import save_plays

    with batch.CaseBar("map", {**options, "jobs": 1, "scheduler": None}) as bar:
        plays = play_map(mechanism, **where, clearance=args.play or None, progress=bar)
    figures = [] if args.plot is None else [save_plays(plays, args.plot)]
    poses = plays.plays.reshape(-1)
    screen = str(poses[0]) if len(poses) == 1 and poses[0] is not None else ranges(plays.table)
    notes = [
        "play is the longest way of the platform's origin to a side, play.x that along x with the "
        "other displacements free; links rigid, axes of pins parallel, to first order."
    ]
    return batch.answer(args, plays.table, out, figures, screen, bar, notes)


def _screen(poses: PoseMap) -> str:
    """Ranges of frequencies and of the stiffness along each axis, and a sentence on both."""
    table, compliance = poses.table, np.diagonal(poses.compliance, axis1=-2, axis2=-1)
    kept = [name for name in table if name.startswith("frequency.")]
    kept += [name for i, axis in enumerate(AXES) if axis not in poses.rigid
             for name in (free(i), held(i, i)) if name in table]  # fmt: skip
    shown = Columns({name: table[name] for name in (*poses.grid, *kept)}, table.units)
    said = []
    first = table["frequency.1"] if "frequency.1" in table else np.zeros(0)
    if np.isfinite(first).any():
        ends = number(float(np.nanmin(first))), number(float(np.nanmax(first)))
        span = ends[0] if ends[0] == ends[1] else " to ".join(ends)
        said.append(f"The first frequency is {span} Hz.")
    soft = compliance.reshape(-1, 6)[:, :3]
    if np.isfinite(soft).any() and np.nanmax(soft) > 0:
        pose, axis = np.unravel_index(int(np.nanargmax(soft)), soft.shape)
        said.append(
            f"The platform gives way most along {AXES[axis]} at pose {int(pose) + 1}: "
            f"{number(1.0 / float(soft[pose, axis]))} N/m."
        )
    return "\n\n".join(filter(None, [ranges(shown), paragraph(" ".join(said))]))


def _notes(poses: PoseMap) -> list[str]:
    """Notes on the words and the missing numbers of the table."""
    if not np.isfinite(poses.compliance).any():
        return []
    notes = [
        "K_xx (others held) is the force for a displacement along x with the other displacements "
        "zero; 1/C_xx (others free) that with the platform free to give way in them."
    ]
    if poses.rigid:
        notes.append(
            f"The platform is rigid along {', '.join(poses.rigid)}: no flexible link or spring "
            "gives way there, so there is no number."
        )
    return notes
