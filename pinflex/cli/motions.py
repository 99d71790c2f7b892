"""`pinflex command`, `move` and `export`: motions for controllers, and robots for their tests."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import pinflex as pf
from pinflex.cli.console import answer, check_files, load_model, working
from pinflex.cli.options import values
from pinflex.errors import DescriptionError
from pinflex.report import Report, Table, table
from pinflex.results.drives import drive_table, row_of
from pinflex.text import length
from pinflex.writing import writable

if TYPE_CHECKING:
    from pinflex.inversion.verify import Followed
    from pinflex.quickest.fastest import Fastest

_JOINT_TRAJECTORY = (".yaml", ".yml", ".json")


def run_command(args: argparse.Namespace) -> int:
    """Find a command, write it, hold it against a forward run."""
    from pinflex.inversion.verify import followed
    from pinflex.solver.solve import default_motion

    if (args.plot or args.view) and not args.verify:
        raise DescriptionError("--plot and --view show what --verify finds. Add --verify.")
    _rate_has_file(args)
    check_files(args.plot, args.output, args.view)
    mechanism = load_model(args)
    motion = default_motion(mechanism)
    with working("finding the motor motion"):
        made = pf.command(mechanism, motion, **values(args))
    runs, commands = {}, {made.level: made}
    if args.verify:
        with working("verifying by a forward run"):
            if made.level != "rigid":
                commands["rigid"] = pf.command(
                    mechanism, motion, "rigid", before=made.before, after=made.after,
                    coordinates=made.coordinates, instants=len(made.t), limited=False,
                )  # fmt: skip
            runs = {level: followed(mechanism, motion, x) for level, x in commands.items()}
    model = made.model_error, made.model_note
    if runs and not np.all(np.isfinite(model[0])):
        from pinflex.advice.error_bars import platform_bar

        model = platform_bar(mechanism, made.coordinates, made.motion, runs[made.level].run)
    files = [] if args.output is None else [_command_file(made, args.output, args.rate)]
    files += _command_views(args, commands, runs)
    data = _command_data(made, model, runs)
    text = f"{_command_report(data).text()}\n"
    if args.rate is not None:
        text += f"{Report('', (made.at_rate(args.rate).text(),)).text()}\n"
    if args.off:
        from pinflex.quickest.robustness import robustness
        from pinflex.quickest.text import robust_table

        end = float(made.t[-1])
        with working("running robots that are off"):
            off = robustness(mechanism, made.motion, end, end - made.after)
        data["off"] = {x.what: {"error": x.error, "shake": x.shake} for x in off}
        text += f"{robust_table(off)}\n\n"
    return answer(args, data, text, files, "-o FILE.csv saves it")


def _rate_has_file(args: argparse.Namespace) -> None:
    """Refuse a rate of no file."""
    if args.rate is not None and args.output is None:
        raise DescriptionError("--rate is of the file that is written. Add -o FILE.csv.")


def _command_file(made: pf.Command, path: str, rate: float | None) -> Path:
    """The command as a table, or as a JointTrajectory."""
    if Path(path).suffix.lower() in _JOINT_TRAJECTORY:
        made.to_joint_trajectory(path, rate)
        return Path(path)
    return made.to_csv(path, rate)


def _command_views(
    args: argparse.Namespace, commands: dict[str, pf.Command], runs: dict[str, Followed]
) -> list[Path]:
    """Write the figure and the page that are asked for."""
    files = []
    if args.plot is not None:
        from pinflex.viewer.plots.drawing import save
        from pinflex.viewer.plots.motions import command_figure as figure

        files.append(Path(args.plot))
        save(figure(commands, runs).axes, args.plot)
    if args.view is not None:
        from pinflex.viewer.view import write_html

        named = {f"coupled, {level} command": x for level, x in runs.items()}
        ideal = next(iter(runs.values())).ideal
        off_path = {words: x.off_path for words, x in named.items()}
        shown = {words: x.run for words, x in named.items()}
        files.append(write_html(shown, args.view, rigid=ideal, off_path=off_path))
    return files


def _command_data(
    made: pf.Command, model: tuple[Any, str], runs: dict[str, Followed]
) -> dict[str, Any]:
    known = [float(x) if math.isfinite(x) else None for x in model[0]]
    drives = [
        row_of(made.level, name, side, np.array(made.limit_curves[name]).reshape(-1, 2))
        for name, side in made.drives.items()
    ]
    return {
        "name": made.name,
        "level": made.level,
        "duration": float(made.t[-1]),
        "before": made.before,
        "after": made.after,
        "actuation": made.actuation,
        "instants": len(made.t),
        "error": dict(zip(made.coordinates, map(float, made.error), strict=True)),
        "cut_off": dict(zip(made.coordinates, map(float, made.cut_off), strict=True)),
        "model_error": dict(zip(made.coordinates, known, strict=True)),
        "model_note": model[1],
        "motors": {
            name: {
                "unit": unit,
                "torque": float(abs(made.torque[:, k]).max()),
                "rms": float((made.torque[:, k] ** 2).mean() ** 0.5),
                "speed": float(abs(made.velocity[:, k]).max()),
            }
            for k, (name, unit) in enumerate(zip(made.motors, made.units, strict=True))
        },
        "followed": {
            level: {
                "during": x.during, "after": x.after, "turned_during": x.turned_during,
                "turned_after": x.turned_after, "swing": x.swing, "stopped": x.stopped,
                "turned_stopped": x.turned_stopped,
            }
            for level, x in runs.items()
        },
        "drives": [asdict(row) for row in drives],
    }  # fmt: skip


def _worded(errors: dict[str, float | None]) -> str:
    return ", ".join(
        f"{name} {'?' if e is None else length(e) if len(name) == 1 else f'{1e3 * e:.2g} mrad'}"
        for name, e in errors.items()
    )


def _command_report(data: dict[str, Any]) -> Report:
    from pinflex.results.drives import DriveRow

    motors = [{"motor": name, **row} for name, row in data["motors"].items()]
    return Report(data["name"], (
        f"{data['name']}: the {data['level']} command takes {data['duration']:.4g} s, with "
        f"{data['before']:.3g} s of rest ahead and {data['after']:.3g} s after; "
        f"motors move from {data['actuation'][0]:.3g} s before the platform to "
        f"{data['actuation'][1]:.3g} s after it. "
        f"Estimated error of the platform: {_worded(data['error'])}, had the robot this model"
        f"{_once_stopped(data)}; by "
        f"what the model leaves out {_worded(data['model_error'])} ({data['model_note']}).",
        table(
            "Motors", motors, "motor", "unit", ("peak", "torque"), "rms",
            ("top speed [rad/s or m/s]", "speed"), names=(24, 4),
        ),
        drive_table([DriveRow(**row) for row in data["drives"]]),
        _path_table(data["followed"], list(data["error"])),
    ))  # fmt: skip


def _once_stopped(data: dict[str, Any]) -> str:
    """Where the estimate is of the time after the command, a word on that."""
    late = [x > 0.5 * data["error"][name] for name, x in data["cut_off"].items()]
    return ", most of it once the motors have stopped and the links swing on" * any(late)


def _path_table(runs: dict[str, dict[str, float]], imposed: list[str]) -> Table:
    """Of the coordinates that the command imposes: the others may be anywhere."""
    rows = [{"command": level, **row} for level, row in runs.items()]
    turns = (
        ("turn during [mrad]", "turned_during", "{:.2g}".format),
        ("turn after [mrad]", "turned_after", "{:.2g}".format),
        ("turn stopped [mrad]", "turned_stopped", "{:.2g}".format),
    )
    return table(
        f"Platform off its path in {', '.join(imposed)} in a coupled run", rows, "command",
        ("during", "during", length), ("after", "after", length), ("swing after", "swing", length),
        ("motors stopped", "stopped", length),
        *(turns if any(len(name) > 1 for name in imposed) else ()), names=(14,),
    )  # fmt: skip


# The fastest motion --------------------------------------------------------------------------


def _say(line: str) -> None:
    """A line over the last one, where a person sees it."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{line:<79}" + ("" if line else "\r"))
        sys.stderr.flush()


def _pairs(texts: list[str], option: str) -> dict[str, str]:
    """Texts by name, of NAME=VALUE,..."""
    parts = [text.partition("=") for text in (",".join(texts).split(",") if texts else ())]
    for name, sign, value in parts:
        if not sign:
            raise _no_pair(option, name + value)
    return {name.strip(): value.strip() for name, _, value in parts}


def _no_pair(option: str, text: str) -> DescriptionError:
    may = {"to": "number, 300mm where it slides or 50deg where it turns", "robust": "share, 20%"}
    return DescriptionError(f"--{option} {text}: write NAME=VALUE, VALUE a {may[option]}.")


def _displacements(mechanism: pf.Mechanism, texts: list[str]) -> dict[str, float]:
    """Displacements [m | rad] by name, of --to; a unit must suit the motor or coordinate."""
    from pinflex.description.motions.motion import without_units

    pairs = _pairs(texts, "to")
    target = "joints" if set(pairs) <= set(mechanism.motors) else "platform"
    types = {name: joint.type for name, joint in mechanism.description.tree().joints.items()}
    found: Any = without_units({target: pairs}, types)
    return {name: _float(x, "to", f"{name}={x}") for name, x in found[target].items()}


def _float(value: Any, option: str, text: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise _no_pair(option, text) from None


def _shares(texts: list[str]) -> dict[str, float]:
    """By name, of --robust: per cents or parts of one."""
    return {
        name: _float(x.removesuffix("%"), "robust", f"{name}={x}") / (100 if x[-1:] == "%" else 1)
        for name, x in _pairs(texts, "robust").items()
    }


def run_move(args: argparse.Namespace) -> int:
    """Find it, write it, put others beside it."""
    from pinflex.quickest.limits import of_motion
    from pinflex.quickest.text import text

    _rate_has_file(args)
    if args.robot:
        return _retimed(args)
    if args.shaper:
        raise DescriptionError("--shaper: it goes with --robot. --baselines has all shapers.")
    robust = _shares(args.robust)
    if not args.to:
        raise DescriptionError("--to: say what moves, such as --to x=0.3.")
    if "settle" not in values(args):
        raise DescriptionError("--settle: say within what the platform is still, such as 50um.")
    check_files(args.plot, args.output, args.page)
    mechanism = load_model(args)
    to, limits = _displacements(mechanism, args.to), dict[str, Any]()
    if args.like:
        joints = set(to) <= set(mechanism.motors)
        moved = pf.quintic(**({"joints": to} if joints else {"platform": to}), duration=args.like)
        limits = of_motion(mechanism, moved)
    for name in ("speed", "acceleration", "jerk", "torque", "stress", "path"):
        if getattr(args, name) is not None:
            limits[name] = getattr(args, name)
    made = pf.fastest(mechanism, to, **values(args), limits=limits, robust=robust, progress=_say)
    rows = made.baselines(_say) if args.baselines or args.page else ()
    off = made.robustness() if args.off else ()
    _say("")
    files = _move_files(args, mechanism, made, rows)
    data = _move_data(made, rows, off)
    return answer(args, data, text(made, rows, off), files, "-o FILE.csv saves it")


def _retimed(args: argparse.Namespace) -> int:
    """The same path in the least time that one factor on it allows."""
    typed = {"settle", "intervals"} & {*values(args)}
    for option in ("to", "like", "robust", "baselines", "off", "plot", "page", "stress", "path"):
        typed |= {option} if getattr(args, option) else set()
    for option in sorted(typed):
        raise DescriptionError(f"--{option}: not with --robot, which keeps the path as it is.")
    writable(args.output)
    path, args.model = args.model, args.robot
    mechanism = load_model(args)
    given = {"velocity": args.speed, "acceleration": args.acceleration, "jerk": args.jerk,
             "effort": args.torque}  # fmt: skip
    limits = {key: value for key, value in given.items() if value is not None}
    plan = pf.trajectory(path)
    made = pf.retime(mechanism, plan, limits or None, shaper=args.shaper)
    whole = made.motion.duration
    own = made.factor * plan.duration if args.shaper else whole
    head = (
        f"{mechanism.name}: {path} takes {whole:.4g} s; it had {plan.duration:.4g} s. "
        + (f"{args.shaper.upper()} takes {whole - own:.4g} s of it and leaves the path by "
           f"{made.off_path:.3g} rad or m. " if args.shaper else "")
        + f"Held there by the {made.held_by}. Torques are the rigid robot's; `pinflex solve` "
        "tells what links add."
    )  # fmt: skip
    rows = [
        (f"{quantity} of {name}", share)
        for quantity, by_motor in made.shares.items()
        for name, share in by_motor.items()
    ]
    most = table(
        "Largest use of each limit", rows, ("limit", itemgetter(0)),
        ("used [%]", itemgetter(1)), names=(36,),
    )  # fmt: skip
    data = {"name": mechanism.name, "duration": made.motion.duration, "given": plan.duration,
            "factor": made.factor, "shaper": whole - own, "held_by": made.held_by,
            "shares": made.shares, "off_path": made.off_path}  # fmt: skip
    files = _sent(args, mechanism, made.motion)
    return answer(args, data, Report("retimed", (head, most)).text(), files, "-o FILE.csv saves it")


def _sent(args: argparse.Namespace, mechanism: pf.Mechanism, motion: pf.Motion) -> list[str]:
    """The motion of the motors, as a controller takes it."""
    if not args.output:
        return []
    joint_trajectory = Path(args.output).suffix.lower() in _JOINT_TRAJECTORY
    write = motion.to_joint_trajectory if joint_trajectory else motion.to_csv
    write(args.output, robot=mechanism, rate=args.rate or 1000.0)
    return [args.output]


def _move_files(
    args: argparse.Namespace, mechanism: pf.Mechanism, made: Fastest, rows: Sequence[Any]
) -> list[str]:
    """Write the figure and the table that are asked for."""
    files = []
    if args.plot:
        from pinflex.viewer.plots.motions import plot_fastest

        files.append(args.plot)
        plot_fastest(made, rows, path=args.plot)
    if args.page:
        files.append(str(made.page(args.page, rows)))
    return files + _sent(args, mechanism, made.motion)


def _move_data(made: Fastest, rows: Sequence[Any], off: Sequence[Any]) -> dict[str, Any]:
    from pinflex.quickest.text import left_out

    keys = ("name", "moves", "duration", "settled", "band", "residual", "bar", "holds", "shares",
            "rigid", "steps")  # fmt: skip
    beside = {
        row.name: {
            "ends": row.ends, "settled": row.settled if row.settled < 1e300 else None,
            "residual": row.residual, "torque": row.push,
        }
        for row in rows
    }  # fmt: skip
    return {key: getattr(made, key) for key in keys} | {
        "robots": [*made.runs], "baselines": beside, "left_out": left_out(rows),
        "off": {x.what: {"error": x.error, "shake": x.shake} for x in off},
    }  # fmt: skip


# A robot for other programs ------------------------------------------------------------------


def run_export(args: argparse.Namespace) -> int:
    """Write an FMU, C sources or both."""
    if args.fmu is None and args.c is None:
        raise DescriptionError("export: give --fmu FILE.fmu or --c DIR.")
    writable(args.fmu)
    live = pf.Simulator(load_model(args), args.dt, every=args.every)
    if args.pose:
        live.reset(args.pose)
    files = [] if args.c is None else [pf.export_c(live, args.c, args.inputs)]
    if args.fmu is not None:
        files.append(pf.export_fmu(live, args.fmu, args.inputs, version=args.fmi, **values(args)))
    return answer(args, {}, "", files)
