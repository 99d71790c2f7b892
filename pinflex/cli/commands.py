"""The commands: each takes the parsed arguments, prints, and returns the exit code."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.cli.console import Progress, load_model, print_json
from pinflex.errors import DescriptionError, RunInterrupted, SceneError
from pinflex.results.result import Result, peak, rms
from pinflex.text import length, number, table
from pinflex.writing import writable


def check(args: argparse.Namespace) -> int:
    """Say what was understood of a model."""
    from pinflex.studies import check_text
    from pinflex.studies.check import check as look

    report = look(load_model(args), args.count)
    if args.json:
        print_json(asdict(report))
    else:
        print(check_text.write(report), end="")
    return 0


def modes(args: argparse.Namespace) -> int:
    """Natural frequencies and mode shapes at a pose."""
    from pinflex.levels.modes import modes as find
    from pinflex.studies.check import is_loaded
    from pinflex.studies.mode_shapes import first_modes, mode_runs
    from pinflex.studies.pose import pose

    mechanism = load_model(args)
    if not mechanism.flexible.n_eta and not len(mechanism.flexible.springs.v_at):
        raise DescriptionError(
            f"{mechanism.name}: no flexible link and no spring, so nothing vibrates. Write some "
            "under `flexible`."
        )
    motors = dict(args.pose or {})
    # without a load the equilibrium is the undeformed pose, which also exists where motors are free
    preload = args.preload if is_loaded(mechanism) else "none"
    found = first_modes(
        find(
            mechanism,
            pose(mechanism, motors),
            count=mechanism.flexible.nv,
            preload=preload,
            free_motors=args.free_motors,
        ),
        args.count,
    )
    page = figure = None
    if args.view is not None:
        from pinflex.viewer.view import write_modes_html

        page = write_modes_html(mode_runs(mechanism, found), args.view)
    if args.map is not None:
        from pinflex.studies.frequency_map import frequency_map, save_frequency_map

        along = frequency_map(mechanism, count=min(args.count, 8), preload=preload)
        figure = save_frequency_map(along, args.map)
    shares = [dict(zip(found.links, map(float, row), strict=True)) for row in found.share]
    if args.json:
        print_json(
            {
                "name": mechanism.name,
                "preload": found.preload,
                "free_motors": found.free_motors,
                "pose": motors,
                "modes": [
                    {"frequency": f, "period": 1 / f if f > 0 else None, "share": share}
                    for f, share in zip(map(float, found.frequencies), shares, strict=True)
                ],
                "view": page,
                "map": figure,
            }
        )
        return 0
    where = ", ".join(f"{k} = {v:g}" for k, v in motors.items()) or "home"
    state = "free" if args.free_motors else "locked"
    about = "the static equilibrium" if preload == "gravity" else "the undeformed pose"
    print(f"{mechanism.name} at {where}, motors {state}, linearised about {about}\n")
    rows = [
        [str(i), number(f), _period(f), _who(share, f)]
        for i, (f, share) in enumerate(zip(map(float, found.frequencies), shares, strict=True), 1)
    ]
    header = "mode|frequency [Hz]|period [s]|share of the elastic energy"
    print(table("Natural frequencies", header, rows, (4,), last_is_text=True))
    files = [f"wrote {path}" for path in (page, figure) if path is not None]
    if files:
        print("\n" + "\n".join(files))
    return 0


def solve(args: argparse.Namespace) -> int:
    """Solve one level and save it."""
    from pinflex.solver.solve import solve as run_level
    from pinflex.studies.study import reason

    mechanism = load_model(args)
    for path in (args.output, args.csv):
        writable(path)
    level = args.level or mechanism.description.solve.level
    bar = Progress(level)
    try:
        result = run_level(
            mechanism,
            level=args.level,
            until=args.until,
            dt=args.dt,
            tol=args.tol,
            samples=args.samples,
            progress=bar,
            resume=args.resume,
        )
    except RunInterrupted as stop:
        if args.output is None or not isinstance(stop.result, Result):
            raise
        stop.result.save(args.output)
        at = f"t = {stop.result.t[-1]:.6g} s"
        raise KeyboardInterrupt(
            f"interrupted; the run up to {at} was saved, --resume {args.output} goes on"
        ) from None
    except SceneError as error:
        if not isinstance(error.result, Result):
            raise
        kept = f"-o RUN.npz saves the run up to t = {error.result.t[-1]:.6g} s."
        if args.output is not None:
            kept = f"The run up to t = {error.result.t[-1]:.6g} s was saved to {args.output}."
            error.result.save(args.output)
        if args.csv is not None:
            error.result.to_csv(args.csv)
        raise type(error)(f"{reason(error)} {kept}", **error.data) from error
    finally:
        bar.close()
    files = []
    if args.output is not None:
        files.append(result.save(args.output))
    if args.csv is not None:
        files.append(result.to_csv(args.csv))
    if args.json:
        print_json(_result_json(result) | {"files": files})
        return 0
    print(result.summary())
    print("".join(f"\n{block}\n" for block in _result_tables(result)), end="")
    print("".join(f"\nwrote {path}" for path in files) or "\nnothing saved (-o run.npz saves it)")
    return 0


def compare(args: argparse.Namespace) -> int:
    """The main job: rigid against flexible."""
    from pinflex.solver.solve import LEVELS
    from pinflex.studies.study import file_name, study, write

    mechanism = load_model(args)
    folder = Path(args.output or f"{mechanism.name}-compare")
    writable(folder / "comparison.txt")
    bars: list[Progress] = []
    runs: list[Path] = []

    def progress(level: str) -> Progress:
        _close(bars)
        bars.append(Progress(level))
        return bars[-1]

    def keep(level: str, run: Result, complete: bool) -> None:
        runs.append(run.save(folder / file_name(run, complete)))
        # what an earlier comparison left of this level would contradict the table
        (folder / file_name(run, not complete)).unlink(missing_ok=True)

    try:
        done = study(mechanism, args.levels or LEVELS, progress, keep)
        _close(bars)
        files = write(done, folder)
    finally:
        _close(bars)
    if args.json:
        written = {"folder": folder, "files": [path.name for path in (*files, *runs)]}
        print_json(json.loads(done.table.to_json()) | written)
    else:
        print(done.table.text())
        print(f"wrote {folder}{'' if str(folder).endswith('/') else '/'}")
        names = [path.name for path in (*files, *runs)]
        width = max(map(len, names))
        for name in names:
            print(f"  {name:<{width}}  {_meaning(name)}".rstrip())
    if not done.flexible:
        sys.stdout.flush()
        raise SceneError(
            f"{mechanism.name}: none of the levels {', '.join(done.unsolved)} could be solved; "
            f"the reasons are in {folder / 'comparison.txt'}."
        )
    return 0


def view(args: argparse.Namespace) -> int:
    """Write the page that plays a run, and what else was asked for."""
    from pinflex.viewer import pictures, serve
    from pinflex.viewer.view import view as show

    result = Result.load(args.run)
    rigid = None if args.rigid is None else Result.load(args.rigid)
    path = Path(args.output) if args.output is not None else Path(args.run).with_suffix(".html")
    at = None if args.png is None else pictures.instant(result, args.png)
    stays = args.serve is not None or args.live
    page = show(
        result,
        path,
        open_browser=not (args.no_open or stays or args.png or args.gif or args.mp4),
        field=args.field,
        scale=args.scale,
        rigid=rigid,
        meshes=args.meshes,
    ).path
    made = []
    if at is not None:
        to = page.with_suffix(".png")
        made.append(pictures.still(result, page, to, at, args.field, args.scale))
    for wanted, suffix in ((args.gif, ".gif"), (args.mp4, ".mp4")):
        if wanted:
            to = page.with_suffix(suffix)
            made.append(pictures.film(result, page, to, args.field, args.scale))
    if args.json:
        files = {"file": page, "pictures": [p.path for p in made]}
        print_json({**files, "name": result.meta.get("name"), "level": result.level})
    else:
        print(page)
        print("".join(f"{p.path}{f' ({p.note})' if p.note else ''}\n" for p in made), end="")
    if args.serve is not None:
        serve.page_until_interrupted(page, args.serve)
    elif args.live:
        serve.live_until_interrupted(result, args.field, args.scale, args.meshes)
    return 0


def sweep(args: argparse.Namespace) -> int:
    """Many cases of a scene in one table."""
    from pinflex.cli import batch_commands

    return batch_commands.sweep(args)


def map_poses(args: argparse.Namespace) -> int:
    """Frequencies and stiffness over a grid of poses."""
    from pinflex.cli import batch_commands

    return batch_commands.map_poses(args)


def advise(args: argparse.Namespace) -> int:
    """What a scene needs for a tolerance."""
    from pinflex.cli import advise_command

    return advise_command.run(args)


def bench(args: argparse.Namespace) -> int:
    """Work and precision on a scene, or on the race scenes."""
    from pinflex.cli.bench_command import command

    return command(args)


def verify(args: argparse.Namespace) -> int:
    """Published benchmarks on this machine."""
    from pinflex.cli.verify_command import command

    return command(args)


def _close(bars: list[Progress]) -> None:
    for bar in bars:
        bar.close()


# Words -----------------------------------------------------------------------------------------

_MEANINGS = (
    ("comparison.txt", "this table"),
    ("comparison.json", "the same for machines, SI units"),
    ("torques", "motor torques, rigid and flexible, and their difference"),
    ("deviation_", "platform against rigid"),
    ("stress_", "von Mises stress along each link over time"),
    ("spectrum_", "spectrum of the largest deflection"),
    ("animation.html", "the motion in a browser, stress in colour: open it"),
)


def _meaning(name: str) -> str:
    if name.endswith("-partial.npz"):
        return "what there is of a run that stopped: pinflex view plays it"
    if name.endswith(".npz"):
        return "the run: pinflex view plays it, pinflex.Result.load reads it"
    return next((words for start, words in _MEANINGS if name.startswith(start)), "")


def _period(f: float) -> str:
    return number(1 / f) if f > 0 else "-"


def _who(share: Mapping[str, float], f: float) -> str:
    """Which links bend, largest first; what has no frequency is named."""
    if f == 0:
        return "free motion, no stiffness"
    ranked = sorted(share.items(), key=lambda item: -item[1])
    parts = [f"{name} {100 * x:.0f} %" for name, x in ranked if x > 0.05][:4]
    rest = 1.0 - sum(x for name, x in ranked if x > 0.05) if len(parts) < 4 else 0.0
    words = ", ".join(parts) + (", others" if rest > 0.05 else "")
    return f"UNSTABLE: grows instead of oscillating; {words}" if f < 0 else words


def _result_tables(result: Result) -> list[str]:
    data = _result_json(result)
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
        table(
            "Flexible links, largest values",
            "link|off the root tangent|von Mises [MPa]|at x [mm]|at [s]",
            links,
            (24,),
        ),
    ]
    return [block for block in blocks if block]


# Numbers for machines ----------------------------------------------------------------------------


def _result_json(result: Result) -> dict[str, Any]:
    """A run in few numbers, SI units."""
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
        "links": links,
        "closure": result.worst_closure,
        "energy_balance": result.meta.get("energy_balance"),
        "settings": result.meta.get("settings"),
        "cost": result.meta.get("cost"),
        "warnings": result.meta.get("warnings"),
    }
