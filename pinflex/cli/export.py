"""`pinflex export`: a robot as an FMU, or as C sources."""

from __future__ import annotations

import argparse

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json
from pinflex.errors import DescriptionError
from pinflex.writing import writable


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "export",
        "the robot as an FMU, or as C sources",
        """
Writes the robot in equal steps, with its tables and its start, as an FMU (FMI 2.0 or 3.0,
co-simulation) or as C sources with a main: the steps are those of pf.Simulator, without Python.
What moves the motors comes from outside. Variables have the names and units of the table of a
run.""",
        "pinflex export ur5 --fmu ur5.fmu\n  pinflex export delta --c delta_c --inputs motion",
    )
    p.add_argument("--fmu", metavar="FILE.fmu", help="write an FMU")
    p.add_argument("--c", metavar="DIR", help="write C sources")
    p.add_argument("--dt", type=parser.positive, default=1e-3, metavar="S", help="step (1e-3 s)")
    p.add_argument(
        "--inputs",
        choices=("torque", "motion"),
        default="torque",
        help="what moves the motors: their torque (default), or position, speed and acceleration",
    )
    p.add_argument(
        "--every",
        type=parser.count,
        metavar="N",
        help="steps between two tangents at the most (default: one where iterations are slow)",
    )
    p.add_argument(
        "--platforms",
        type=parser.names,
        default=(),
        metavar="NAME,...",
        help="linux64, win64, darwin64, and with --fmi 3 linux-arm, darwin-arm: made by the pip "
        "package ziglang (default: this machine)",
    )
    p.add_argument(
        "--fmi", type=int, choices=(2, 3), default=2, help="version of the standard (default: 2)"
    )
    parser.pose_option(p)


def run(args: argparse.Namespace) -> int:
    """Write an FMU, C sources or both."""
    from pinflex.live.export import export_c, export_fmu
    from pinflex.live.simulator import Simulator

    if args.fmu is None and args.c is None:
        raise DescriptionError("export: give --fmu FILE.fmu or --c DIR.")
    writable(args.fmu)
    live = Simulator(load_model(args), args.dt, every=args.every)
    if args.pose:
        live.reset(args.pose)
    files = []
    if args.c is not None:
        files.append(export_c(live, args.c, args.inputs))
    if args.fmu is not None:
        files.append(export_fmu(live, args.fmu, args.inputs, args.platforms, args.fmi))
    if args.json:
        print_json({"files": [str(path) for path in files]})
    else:
        print("".join(f"wrote {path}\n" for path in files), end="")
    return 0
