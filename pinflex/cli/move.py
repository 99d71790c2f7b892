"""`pinflex move`: the shortest motion that keeps limits and does not shake."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, say_written
from pinflex.errors import DescriptionError
from pinflex.writing import writable

_LENGTHS = {"": 1.0, "m": 1.0, "mm": 1e-3, "um": 1e-6}


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "move",
        "the shortest motion that keeps limits and leaves the platform still",
        """
Finds the shortest motion, from rest to rest, that keeps speed, acceleration, jerk and torque
limits (of the URDF, or as said here) and from whose end on the platform stays within a distance of
where it comes to rest: linear programmes about coupled runs of the flexible robot, until the runs
themselves keep all. --like takes the limits of a quintic of that duration (six times its jerk);
--robust asks that the same motion leaves a heavier and a lighter robot as still; --baselines puts
the usual profiles and shapers beside it; --off tells what payload, stiffness and friction 5 % off
do. With --robot, MODEL is a trajectory instead (CSV, or a JointTrajectory as YAML or JSON): the
same path as fast as the limits of the rigid robot allow, shaped if --shaper says so.""",
        "pinflex move delta --to x=0.305 --to y=0 --to z=0 --like 0.3 --settle 50um",
    )
    parser.repeated(p, "--to", "NAME=VALUE", "displacement of a motor or platform coordinate, SI")
    p.add_argument("--robot", metavar="ROBOT", help="retime the trajectory MODEL for this robot")
    p.add_argument("--shaper", choices=("zv", "zvd", "ei"), help="shape what --robot retimes")
    p.add_argument("--settle", type=_length, metavar="X",
                   help="distance from rest that is still, such as 50um")  # fmt: skip
    for name, text in (
        ("speed", "speed of what moves, m/s or rad/s"), ("acceleration", "its acceleration, SI"),
        ("jerk", "its jerk, SI (default: six times a quintic's)"),
        ("torque", "torque of every motor, N m or N (default: the URDF's)"),
    ):  # fmt: skip
        p.add_argument(f"--{name}", type=parser.positive, metavar="X", help=text)
    p.add_argument("--like", type=parser.positive, metavar="S",
                   help="limits of a quintic of so many seconds")  # fmt: skip
    parser.repeated(p, "--robust", "NAME=SHARE", "payload=20%%, stiffness=10%% or friction=20%%")
    p.add_argument("--baselines", action="store_true", help="the usual motions beside it")
    p.add_argument("--off", action="store_true", help="a table of what robots 5 %% off do")
    p.add_argument("--plot", metavar="FILE", help="a figure (.png, .pdf, .svg)")
    p.add_argument("-o", "--output", metavar="FILE",
                   help="write motor positions, velocities, accelerations at 1 kHz; "
                        ".yaml or .json: a JointTrajectory")  # fmt: skip


def _tell(line: str) -> None:
    """A line over the last one, where a person sees it."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{line:<79}" + ("" if line else "\r"))
        sys.stderr.flush()


def _length(text: str) -> float:
    found = re.fullmatch(r"([0-9.eE+-]+)\s*(um|mm|m|)", text.strip())
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no length, such as 50um")
    return parser.positive(found[1]) * _LENGTHS[found[2]]


def _pairs(texts: list[str], option: str) -> dict[str, float]:
    """Numbers by name, of NAME=VALUE; a per cent sign is a hundredth."""
    pairs = {}
    for text in texts:
        name, sign, value = text.partition("=")
        try:
            number = float(value.strip().removesuffix("%"))
        except ValueError:
            sign = ""
        if not sign:
            raise DescriptionError(f"--{option} {text}: write NAME=VALUE.")
        pairs[name.strip()] = number / (100.0 if value.strip().endswith("%") else 1.0)
    return pairs


def run(args: argparse.Namespace) -> int:
    """Find it, write it, put others beside it."""
    from pinflex.description.motions.motion import quintic
    from pinflex.quickest.fastest import fastest
    from pinflex.quickest.limits import of_motion
    from pinflex.quickest.text import text

    if args.robot:
        return _retimed(args)
    if args.shaper:
        raise DescriptionError("--shaper: it goes with --robot. --baselines has all shapers.")
    to, robust = _pairs(args.to, "to"), _pairs(args.robust, "robust")
    if not to:
        raise DescriptionError("--to: say what moves, such as --to x=0.3.")
    if args.settle is None:
        raise DescriptionError("--settle: say within what the platform is still, such as 50um.")
    if args.plot:
        from pinflex.viewer.plots.drawing import check_figure

        check_figure(args.plot)
    for path in (args.output, args.plot):
        writable(path)
    mechanism = load_model(args)
    limits: dict[str, Any] = {}
    if args.like:
        joints = set(to) <= set(mechanism.motors)
        moved = quintic(**({"joints": to} if joints else {"platform": to}), duration=args.like)
        limits = of_motion(mechanism, moved)
    for name in ("speed", "acceleration", "jerk", "torque"):
        if getattr(args, name) is not None:
            limits[name] = getattr(args, name)
    found = fastest(mechanism, to, settle=args.settle, limits=limits, robust=robust, progress=_tell)
    rows = found.baselines(_tell) if args.baselines else ()
    off = found.robustness() if args.off else ()
    _tell("")
    files = _written(args, mechanism, found, rows)
    if args.json:
        print_json(_numbers(found, rows, off) | {"files": [str(x) for x in files]})
    else:
        print(text(found, rows, off), end="")
        say_written(files, "-o FILE.csv")
    return 0


def _retimed(args: argparse.Namespace) -> int:
    """The same path in the least time that one factor on it allows."""
    from pinflex.inversion.retime import retime
    from pinflex.text import number, paragraph, report, table

    for option in ("to", "settle", "like", "robust", "baselines", "off", "plot"):
        if getattr(args, option):
            raise DescriptionError(f"--{option}: not with --robot, which keeps the path as it is.")
    writable(args.output)
    path, args.model = args.model, args.robot
    mechanism = load_model(args)
    given = {"velocity": args.speed, "acceleration": args.acceleration, "jerk": args.jerk,
             "effort": args.torque}  # fmt: skip
    limits = {key: value for key, value in given.items() if value is not None}
    found = retime(mechanism, path, limits or None, shaper=args.shaper)
    files = _sent(args, mechanism, found.motion)
    if args.json:
        print_json({"name": mechanism.name, "duration": found.motion.duration,
                    "factor": found.factor, "held_by": found.held_by, "shares": found.shares,
                    "off_path": found.off_path, "files": [str(x) for x in files]})  # fmt: skip
        return 0
    bent = f" It leaves the path by {found.off_path:.3g} rad or m." if args.shaper else ""
    head = (
        f"{mechanism.name}: {path} takes {found.motion.duration:.4g} s, {found.factor:.4g} of the "
        f"time that it had. Held there by the {found.held_by}.{bent} Torques are the rigid "
        "robot's; `pinflex solve` tells what links add."
    )
    rows = [[f"{quantity} of {name}", number(100 * share)]
            for quantity, by_motor in found.shares.items()
            for name, share in by_motor.items()]  # fmt: skip
    most = table("Largest use of each limit", "limit|used [%]", rows, (36,))
    print(report(paragraph(head), most), end="")
    say_written(files, "-o FILE.csv")
    return 0


def _sent(args: argparse.Namespace, mechanism: Any, motion: Any) -> list[Path]:
    """The motion of the motors, as a controller takes it."""
    if not args.output:
        return []
    path = Path(args.output)
    if path.suffix.lower() in (".yaml", ".yml", ".json"):
        motion.to_joint_trajectory(path, robot=mechanism)
    else:
        motion.to_csv(path, robot=mechanism)
    return [path]


def _written(
    args: argparse.Namespace, mechanism: Any, found: Any, rows: tuple[Any, ...]
) -> list[Path]:
    """The figure and the table that are asked for."""
    files: list[Path] = []
    if args.plot:
        from pinflex.studies.figures.plot_fastest import figure
        from pinflex.viewer.plots.drawing import save

        files.append(Path(args.plot))
        save(figure(found, rows).axes, args.plot)
    return files + _sent(args, mechanism, found.motion)


def _numbers(found: Any, rows: tuple[Any, ...], off: tuple[Any, ...]) -> dict[str, Any]:
    keys = ("name", "moves", "duration", "settled", "band", "residual", "bar", "holds", "shares",
            "rigid", "steps")  # fmt: skip
    beside = {
        row.name: {
            "ends": row.ends, "settled": row.settled if row.settled < 1e300 else None,
            "residual": row.residual, "torque": row.push,
        }
        for row in rows
    }  # fmt: skip
    return {key: getattr(found, key) for key in keys} | {
        "robots": [*found.runs], "baselines": beside,
        "off": {x.what: {"error": x.error, "shake": x.shake} for x in off},
    }  # fmt: skip
