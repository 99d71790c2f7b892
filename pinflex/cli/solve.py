"""`pinflex solve`: one level, saved."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, say_written
from pinflex.errors import DescriptionError, RunInterrupted, SceneError
from pinflex.progress import Bar
from pinflex.text import length, number, paragraph, table
from pinflex.writing import writable

_WHOLE = 1e-9  # of a number of ticks: round-off

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.results.result import Result


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "solve",
        "one run at one level",
        """
Levels, from cheap to faithful: rigid, quasistatic, ked (linear vibration), coupled (everything). A
run that stops early is saved up to its last good step.""",
        "pinflex solve 3rrr --level coupled --dt 1e-4 -o run.npz\n"
        "  pinflex solve arm.yaml --set flexible.*.section.thickness=1e-3 --csv run.csv",
    )
    p.add_argument("--level", help="rigid, quasistatic, ked, coupled or auto (default: the YAML's)")
    p.add_argument("--until", type=parser.positive, metavar="S", help="end time in s")
    step = p.add_mutually_exclusive_group()
    step.add_argument("--dt", type=parser.positive, metavar="S", help="largest step in s")
    step.add_argument(
        "--tol",
        type=parser.positive,
        metavar="E",
        help="relative error of time integration instead of a step, such as 1e-3",
    )
    grid = p.add_mutually_exclusive_group()
    grid.add_argument(
        "--samples", type=parser.samples, metavar="N", help="instants to keep (default 401)"
    )
    grid.add_argument(
        "--rate", type=parser.positive, metavar="HZ", help="the same by their rate, such as 1000"
    )
    p.add_argument(
        "--resume", metavar="RUN.npz", help="go on with a stopped or shorter run, to --until"
    )
    p.add_argument("-o", "--output", metavar="RUN.npz", help="save the run")
    p.add_argument(
        "--checkpoint",
        type=parser.positive,
        metavar="S",
        help="save the run to -o every S seconds; --resume goes on with it",
    )
    p.add_argument("--csv", metavar="FILE.csv", help="save the main columns as a table")


def run(args: argparse.Namespace) -> int:
    """Solve one level and save it."""
    mechanism = load_model(args)
    for path in (args.output, args.csv):
        writable(path)
    try:
        with Bar(args.level or mechanism.description.solve.level) as bar:
            result = _solve(args, mechanism, bar)
    except RunInterrupted as stop:
        _interrupted(args, stop)
    except SceneError as error:
        _stopped(args, error)
    if result.meta["settings"].get("tol") is not None:  # who asks for one wants both errors
        result = result.with_errors()
    files = _save(args, result)
    numbers = _numbers(result)
    if args.json:
        print_json(numbers | {"files": files})
        return 0
    print(result.summary())
    print("".join(f"\n{block}\n" for block in _tables(numbers)), end="")
    print()
    if args.rate is not None:
        from pinflex.solver.solve import default_motion

        rows = default_motion(mechanism).at_rate(args.rate, mechanism)
        print(paragraph(rows.text()) + "\n")
    say_written(files, "-o run.npz")
    return 0


def _solve(args: argparse.Namespace, mechanism: Mechanism, bar: Bar) -> Result:
    from pinflex.advice.solve import solve

    level = args.level or mechanism.description.solve.level
    options = {key: getattr(args, key) for key in ("until", "dt", "tol", "samples", "resume")}
    options |= {"level": level, "progress": bar}
    if args.rate is not None:
        options["samples"] = _samples(args, mechanism)
    if args.checkpoint is None:
        return solve(mechanism, **options)
    from pinflex.cli.checkpoint import saved_meanwhile

    return saved_meanwhile(mechanism, args.output, args.checkpoint, options)


def _samples(args: argparse.Namespace, mechanism: Mechanism) -> int:
    """Instants of a whole number of ticks of --rate."""
    from pinflex.solver.solve import default_motion

    until = args.until or mechanism.description.solve.until or default_motion(mechanism).duration
    count = until * args.rate
    if abs(count - round(count)) > _WHOLE * count or round(count) < 1:
        more = max(math.ceil(count), 1) / args.rate
        raise DescriptionError(
            f"--rate {args.rate:g}: {until:g} s is no whole number of 1/{args.rate:g} s. "
            f"Give --until {more:g}."
        )
    return parser.samples(str(round(count) + 1))


def _save(args: argparse.Namespace, result: Result) -> list[Path]:
    """Write the run and its table where they are asked for."""
    files = []
    if args.output is not None:
        files.append(result.save(args.output))
    if args.csv is not None:
        files.append(result.to_csv(args.csv))
    return files


def _interrupted(args: argparse.Namespace, stop: RunInterrupted) -> NoReturn:
    """Save the run so far and say how it goes on."""
    from pinflex.results.result import Result

    if args.output is None or not isinstance(stop.result, Result):
        raise stop
    stop.result.save(args.output)
    by_steps = stop.result.meta["settings"].get("integrator") != "radau"
    how = f", --resume {args.output} goes on" if by_steps else ""
    raise KeyboardInterrupt(
        f"interrupted; the run up to t = {stop.result.t[-1]:.6g} s was saved{how}"
    ) from None


def _stopped(args: argparse.Namespace, error: SceneError) -> NoReturn:
    """Save the run up to its last good step and say where it is."""
    from pinflex.results.result import Result
    from pinflex.studies.study import reason

    if not isinstance(error.result, Result):
        raise error
    _save(args, error.result)
    until = f"t = {error.result.t[-1]:.6g} s"
    note = f"-o RUN.npz saves the run up to {until}."
    if args.output is not None:
        note = f"The run up to {until} was saved to {args.output}."
    raise type(error)(f"{reason(error)} {note}", **error.data) from error


def _tables(data: dict[str, Any]) -> list[str]:
    """Motors, drives and links of `_numbers`."""
    from pinflex.results.drives import DriveRow, drive_table

    motors = [
        [name, m["unit"], number(m["peak"]), number(m["rms"])] for name, m in data["motors"].items()
    ]
    links = [
        [
            name,
            length(x["deflection"]),
            number(x["von_mises"] / 1e6),
            number(1e3 * x["x"]),
            f"{x['time']:.4f}",
        ]
        for name, x in data["links"].items()
    ]
    blocks = [
        table("Motors", "motor|unit|peak|rms", motors, (24, 4)),
        drive_table([DriveRow(**row) for row in data["drives"]]),
        table(
            "Flexible links, largest values",
            "link|off the root tangent|von Mises [MPa]|at x [mm]|at [s]",
            links,
            (24,),
        ),
    ]
    return [block for block in blocks if block]


def _numbers(result: Result) -> dict[str, Any]:
    """A run in few numbers, SI units."""
    from dataclasses import asdict

    from pinflex.results.drives import drive_row
    from pinflex.results.views import peak, rms

    links: dict[str, Any] = {}
    for name in result.links:
        link = result.link(name)
        when, where = np.unravel_index(int(np.argmax(link.von_mises)), link.von_mises.shape)
        links[name] = {
            "deflection": float(np.max(np.linalg.norm(link.deflection[:, :, :3], axis=2))),
            "von_mises": float(link.von_mises[when, where]),
            "x": float(link.x[where]),
            "time": float(result.t[when]),
        }
    return {
        "name": result.meta.get("name"),
        "level": result.level,
        "status": result.meta.get("status"),
        "message": result.meta.get("message"),
        "until": float(result.t[-1]),
        "instants": len(result.t),
        "motors": {
            name: {
                "unit": result.unit(f"torque/{name}"),
                "peak": peak(result.torque[:, i]),
                "rms": rms(result.torque[:, i]),
            }
            for i, name in enumerate(result.motors)
        },
        "drives": [asdict(drive_row(result.level, result, name)) for name in result.drives],
        "links": links,
        "closure": result.worst_closure,
        "energy_balance": result.meta.get("energy_balance"),
        "settings": result.meta.get("settings"),
        "errors": result.meta.get("errors"),
        "cost": result.meta.get("cost"),
        "warnings": result.meta.get("warnings"),
    }
