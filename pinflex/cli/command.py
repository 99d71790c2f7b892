"""`pinflex command`: motor motions that the flexible robot's platform follows."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, say_written, working
from pinflex.errors import DescriptionError
from pinflex.text import length, number, paragraph, table
from pinflex.writing import writable

if TYPE_CHECKING:
    from pinflex.inversion.command import Command


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "command",
        "the motor motion with which the platform follows its path",
        """
Finds the motor motion that makes the platform, not the motors, follow the motion of the YAML
although links and joints deform, and writes it for a controller. Level exact inverts the whole
motion at once; quasistatic is cheaper and enough where the motion is slow beside the vibrations.
With --verify a forward run of level coupled tells what is left, beside the rigid command.""",
        "pinflex command delta -o command.csv --verify",
    )
    p.add_argument(
        "-o", "--output", metavar="FILE",
        help="write t, motor motion and torques: .csv, or a JointTrajectory: .yaml, .json",
    )  # fmt: skip
    p.add_argument(
        "--rate", type=parser.positive, metavar="HZ",
        help="of the rows of -o, such as 1000 (default: the instants that were found)",
    )  # fmt: skip
    p.add_argument(
        "--level", choices=("rigid", "quasistatic", "exact"), default="exact", metavar="LEVEL",
        help="rigid, quasistatic or exact (default)",
    )  # fmt: skip
    p.add_argument(
        "--tol", type=parser.positive, metavar="X",
        help="platform error wanted, over that of the rigid command (level exact)",
    )  # fmt: skip
    for name, text in (("before", "rest ahead of the motion"), ("after", "rest after it")):
        p.add_argument(
            f"--{name}", type=parser.positive, metavar="S",
            help=f"{text} in s (default: from the internal dynamics)",
        )  # fmt: skip
    p.add_argument("--instants", type=int, metavar="N", help="grid points (default 150 a motion)")
    p.add_argument(
        "--beyond-limits", action="store_true", help="do not refuse what the URDF limits forbid"
    )
    p.add_argument(
        "--verify", action="store_true", help="run level coupled with it and with the rigid one"
    )
    p.add_argument(
        "--plot", metavar="FILE", help="with --verify: a figure of both (.png, .pdf, .svg)"
    )
    p.add_argument(
        "--off", action="store_true",
        help="runs with payload, stiffness and friction 5 %% off: platform error, residual swing",
    )  # fmt: skip
    p.add_argument("--view", metavar="FILE.html", help="with --verify: a page that plays both")


def run(args: argparse.Namespace) -> int:
    """Find a command, write it, hold it against a forward run."""
    import numpy as np

    from pinflex.advice.error_bars import platform_bar
    from pinflex.inversion.command import command
    from pinflex.inversion.verify import followed
    from pinflex.quickest.text import robust_table
    from pinflex.results.drives import drive_table, row_of
    from pinflex.solver.solve import default_motion

    if (args.plot or args.view) and not args.verify:
        raise DescriptionError("--plot and --view show what --verify finds. Add --verify.")
    if args.rate is not None and args.output is None:
        raise DescriptionError("--rate is of the file that is written. Add -o FILE.csv.")
    if args.plot:
        from pinflex.viewer.plots.drawing import check_figure

        check_figure(args.plot)
    mechanism = load_model(args)
    for path in (args.output, args.plot, args.view):
        writable(path)
    motion = default_motion(mechanism)
    with working("finding the motor motion"):
        found = command(
            mechanism, motion, args.level, tol=args.tol, before=args.before, after=args.after,
            instants=args.instants, limited=not args.beyond_limits,
        )  # fmt: skip
    runs, commands = {}, {args.level: found}
    if args.verify:
        with working("verifying by a forward run"):
            if args.level != "rigid":
                commands["rigid"] = command(
                    mechanism, motion, "rigid", before=found.before, after=found.after,
                    coordinates=found.coordinates, instants=len(found.t), limited=False,
                )  # fmt: skip
            runs = {level: followed(mechanism, motion, x) for level, x in commands.items()}
    model = found.model_error, found.model_note
    if runs and not np.all(np.isfinite(model[0])):
        model = platform_bar(mechanism, found.coordinates, found.motion, runs[found.level].run)
    files = [] if args.output is None else [_written(found, args.output, args.rate)]
    files += _shown(args, commands, runs)
    rows = [
        row_of(found.level, name, side, np.array(found.limit_curves[name]).reshape(-1, 2))
        for name, side in found.drives.items()
    ]
    data = _numbers(found, model, runs) | {"drives": [asdict(row) for row in rows], "files": files}
    off = _off(mechanism, found) if args.off else ()
    if off:
        data["off"] = {x.what: {"error": x.error, "shake": x.shake} for x in off}
    if args.json:
        print_json(data)
    else:
        print(_text(data, drive_table(rows)))
        if args.rate is not None:
            print(paragraph(found.at_rate(args.rate).text()) + "\n")
        if off:
            print(robust_table(off) + "\n")
        say_written(files, "-o FILE.csv")
    return 0


def _written(found: Command, path: str, rate: float | None) -> Path:
    """The command as a table, or as a JointTrajectory."""
    if Path(path).suffix.lower() in (".yaml", ".yml", ".json"):
        found.to_joint_trajectory(path, rate)
        return Path(path)
    return found.to_csv(path, rate)


def _off(mechanism: Any, found: Any) -> Any:
    """What robots that are 5 % off do with the command."""
    from pinflex.quickest.robustness import robustness

    end = float(found.t[-1])
    with working("running robots that are off"):
        return robustness(mechanism, found.motion, end, end - found.after)


def _shown(args: argparse.Namespace, commands: dict[str, Any], runs: dict[str, Any]) -> list[Path]:
    """Write the figure and the page that are asked for."""
    files = []
    if args.plot is not None:
        from pinflex.studies.figures.plot_command import figure
        from pinflex.viewer.plots.drawing import save

        files.append(Path(args.plot))
        save(figure(commands, runs).axes, args.plot)
    if args.view is not None:
        from pinflex.viewer.view import write_runs_html

        named = {f"coupled, {level} command": x for level, x in runs.items()}
        ideal = next(iter(runs.values())).ideal
        off_path = {words: x.off_path for words, x in named.items()}
        shown = {words: x.run for words, x in named.items()}
        files.append(write_runs_html(shown, args.view, rigid=ideal, off_path=off_path))
    return files


def _numbers(found: Any, model: tuple[Any, str], runs: dict[str, Any]) -> dict[str, Any]:
    known = [float(x) if math.isfinite(x) else None for x in model[0]]
    return {
        "name": found.name,
        "level": found.level,
        "duration": float(found.t[-1]),
        "before": found.before,
        "after": found.after,
        "actuation": found.actuation,
        "instants": len(found.t),
        "error": dict(zip(found.coordinates, map(float, found.error), strict=True)),
        "model_error": dict(zip(found.coordinates, known, strict=True)),
        "model_note": model[1],
        "motors": {
            name: {
                "unit": unit,
                "torque": float(abs(found.torque[:, k]).max()),
                "rms": float((found.torque[:, k] ** 2).mean() ** 0.5),
                "speed": float(abs(found.velocity[:, k]).max()),
            }
            for k, (name, unit) in enumerate(zip(found.motors, found.units, strict=True))
        },
        "followed": {
            level: {
                "during": x.during, "after": x.after, "turned_during": x.turned_during,
                "turned_after": x.turned_after, "swing": x.swing,
            }
            for level, x in runs.items()
        },
    }  # fmt: skip


def _bars(errors: dict[str, float | None]) -> str:
    return ", ".join(
        f"{name} {'?' if e is None else length(e) if len(name) == 1 else f'{1e3 * e:.2g} mrad'}"
        for name, e in errors.items()
    )


def _text(data: dict[str, Any], drives: str) -> str:
    rest = f"{data['before']:.3g} s of rest ahead and {data['after']:.3g} s after"
    head = (
        f"{data['name']}: the {data['level']} command takes {data['duration']:.4g} s, with {rest}; "
        f"motors move from {data['actuation'][0]:.3g} s before the platform to "
        f"{data['actuation'][1]:.3g} s after it. "
        f"Estimated error of the platform: {_bars(data['error'])}, had the robot this model; by "
        f"what the model leaves out {_bars(data['model_error'])} ({data['model_note']})."
    )
    motors = [
        [name, m["unit"], number(m["torque"]), number(m["rms"]), number(m["speed"])]
        for name, m in data["motors"].items()
    ]
    blocks = [
        paragraph(head),
        table("Motors", "motor|unit|peak|rms|top speed [rad/s or m/s]", motors, (24, 4)),
    ]
    rows = [
        [level, length(x["during"]), length(x["after"]), length(x["swing"]),
         f"{1e3 * x['turned_during']:.2g}", f"{1e3 * x['turned_after']:.2g}"]
        for level, x in data["followed"].items()
    ]  # fmt: skip
    if drives:
        blocks.append(drives)
    if rows:
        heads = "command|during|after|swing after|turn during [mrad]|turn after [mrad]"
        blocks.append(table("Platform off its path in a coupled run", heads, rows, (14,)))
    return "\n\n".join(blocks) + "\n"
