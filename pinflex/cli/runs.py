"""`pinflex solve`, `compare` and `view`: one run, all levels of a scene, and the page of runs."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

import pinflex as pf
from pinflex.cli.console import answer, load_model, print_json, working
from pinflex.cli.options import samples, values
from pinflex.description.solve import LEVELS
from pinflex.errors import DescriptionError, RunInterrupted, SceneError, reason
from pinflex.progress import Bar, Stages
from pinflex.report import Report, Words, table
from pinflex.text import COLUMNS, length, paragraph
from pinflex.writing import writable

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.results.result import Result
    from pinflex.studies.study import Study
    from pinflex.viewer.export.pictures import Picture

_WHOLE = 1e-9  # of a number of ticks: round-off
_MISFITS = (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError)


def run_solve(args: argparse.Namespace) -> int:
    """Solve one level and save it."""
    mechanism = load_model(args)
    for path in (args.output, args.csv):
        writable(path)
    options = {"level": mechanism.description.solve.level} | values(args)
    try:
        with Bar(options["level"]) as bar:
            result = _solve(args, mechanism, options | {"progress": bar})
    except RunInterrupted as stop:
        _interrupted(args, stop)
    except SceneError as error:
        _stopped(args, error)
    if result.meta["settings"].get("tol") is not None:  # who asks for one wants both errors
        result = result.with_errors()
    files, data = _solve_files(args, result), _solve_data(result)
    text = f"{_solve_report(result.summary(), data).text()}\n"
    if args.rate is not None:
        from pinflex.solver.solve import default_motion

        rows = default_motion(mechanism).at_rate(args.rate, mechanism)
        text += paragraph(rows.text()) + "\n\n"
    return answer(args, data, text, files, "-o run.npz saves it")


def _solve(args: argparse.Namespace, mechanism: Mechanism, options: dict[str, Any]) -> Result:
    if args.rate is not None:
        options["samples"] = _samples(args.rate, options.get("until"), mechanism)
    if args.checkpoint is None:
        return pf.solve(mechanism, **options)
    return with_checkpoints(mechanism, args.output, args.checkpoint, options)


def _samples(rate: float, until: float | None, mechanism: Mechanism) -> int:
    """Instants of a whole number of ticks of --rate."""
    from pinflex.solver.solve import default_motion

    until = until or mechanism.description.solve.until or default_motion(mechanism).duration
    count = until * rate
    if abs(count - round(count)) > _WHOLE * count or round(count) < 1:
        more = max(math.ceil(count), 1) / rate
        raise DescriptionError(
            f"--rate {rate:g}: {until:g} s is no whole number of 1/{rate:g} s. "
            f"Give --until {more:g}."
        )
    return samples(str(round(count) + 1))


def with_checkpoints(
    mechanism: Mechanism, output: str | None, seconds: float, options: Mapping[str, Any]
) -> Result:
    """The run of `solve(mechanism, **options)`, interrupted to be saved and gone on with."""
    from pinflex.results.result import Result

    options = dict(options)
    _require_resumable(mechanism, output, options)
    assert output is not None
    spec, tell = mechanism.description.solve, options["progress"]
    reached, due, rung = -1.0, 0.0, False

    def step(done: int, steps: int) -> None:
        nonlocal rung
        tell(done, steps)
        if done < steps and time.monotonic() > due:
            rung = True
            raise KeyboardInterrupt

    options["progress"] = step
    while True:
        due, rung = time.monotonic() + seconds, False
        try:
            return pf.solve(mechanism, **options)
        except RunInterrupted as stop:
            if not rung:  # by somebody else
                raise
            part = stop.result
        if isinstance(part, Result) and len(part.t) > 1 and part.t[-1] > reached:
            part.save(output)
            options["resume"], reached = part, float(part.t[-1])
            options["until"] = options.get("until") or spec.until or mechanism.motion.duration
            options["samples"] = None
        else:
            seconds *= 2.0  # not one sample further: what is between samples would be done again


def _require_resumable(
    mechanism: Mechanism, output: str | None, options: Mapping[str, Any]
) -> None:
    """Raise where a run has no state that it can go on from."""
    if output is None:
        raise DescriptionError("--checkpoint: where to? Give -o RUN.npz.")
    spec = mechanism.description.solve
    by_tol = options.get("tol") or (spec.tol if options.get("dt") is None else None)
    if (options.get("level") or spec.level) != "coupled" or by_tol or spec.only == "coupled":
        raise DescriptionError(
            f"{mechanism.name}: --checkpoint: only level coupled in steps (dt) can go on from a "
            "saved state. Leave it out, or give --level coupled --dt."
        )
    if mechanism.description.control is not None:
        raise DescriptionError(
            f"{mechanism.name}: --checkpoint: a run with a control cannot go on. Leave it out."
        )


def _solve_files(args: argparse.Namespace, result: Result) -> list[Path]:
    """Write the run and its table where they are asked for."""
    files = [] if args.output is None else [result.save(args.output)]
    return files if args.csv is None else [*files, result.to_csv(args.csv)]


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

    if not isinstance(error.result, Result):
        raise error
    _solve_files(args, error.result)
    until = f"t = {error.result.t[-1]:.6g} s"
    note = f"-o RUN.npz saves the run up to {until}."
    if args.output is not None:
        note = f"The run up to {until} was saved to {args.output}."
    raise type(error)(f"{reason(error)} {note}", **error.data) from error


def _solve_report(summary: str, data: dict[str, Any]) -> Report:
    """Motors, drives and links of `_solve_data`, after the summary."""
    from pinflex.results.drives import DriveRow, drive_table

    motors = [{"motor": name, **row} for name, row in data["motors"].items()]
    links = [{"link": name, **row} for name, row in data["links"].items()]
    return Report(data["name"], (
        Words(summary),
        table("Motors", motors, "motor", "unit", "peak", "rms", names=(24, 4)),
        drive_table([DriveRow(**row) for row in data["drives"]]),
        table(
            "Flexible links, largest values", links, "link",
            ("off the root tangent", "deflection", length), ("von Mises [MPa]", "von_mises"),
            ("at x [mm]", "x"), ("at [s]", "time", "{:.4f}".format), names=(24,),
        ),
    ))  # fmt: skip


def _solve_data(result: Result) -> dict[str, Any]:
    """A run in few numbers, SI units."""
    from pinflex.results.drives import drive_row
    from pinflex.results.views import peak, rms

    links: dict[str, Any] = {}
    for name in result.links:
        worst, moved = result.worst_stress(link=name), result.link(name).deflection[:, :, :3]
        far = float(np.max(np.linalg.norm(moved, axis=2)))
        links[name] = {
            "deflection": far, "von_mises": worst.value, "x": worst.x, "time": worst.t
        }  # fmt: skip
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
        **{
            key: result.meta.get(key)
            for key in ("energy_balance", "settings", "errors", "cost", "warnings")
        },
    }


# Rigid against flexible ----------------------------------------------------------------------


def run_compare(args: argparse.Namespace) -> int:
    """Compare rigid and flexible; write tables, figures, runs and the page."""
    mechanism, options = load_model(args), values(args)
    folder = Path(options.pop("folder", None) or f"{mechanism.name}-compare")
    writable(folder / "comparison.txt")
    options["levels"] = options.get("levels") or LEVELS
    done = pf.compare(mechanism, **options, folder=folder, progress=Stages(Bar))
    if args.interactive:
        _interactive(args, done, folder)
    if args.json:
        written = {"folder": folder, "files": [path.name for path in done.files]}
        print_json(json.loads(done.table.to_json()) | written)
    else:
        print(done.table.text() if args.verbose else done.table.brief())
        _say_folder(folder, done.files)
    if not done.flexible:
        sys.stdout.flush()
        raise SceneError(
            f"{mechanism.name}: none of the levels {', '.join(done.unsolved)} could be solved; "
            f"the reasons are in {folder / 'comparison.txt'}."
        )
    return 0


def _interactive(args: argparse.Namespace, done: Study, folder: Path) -> None:
    """The animation with sliders in place of the one that plays."""
    from pinflex.browser.page import live_comparison

    changes = [f"--set '{change}'" for change in args.set]
    page = folder / "animation.html"
    live_comparison(done.mechanism, done.runs, page, " ".join([args.model, *changes]))


def _say_folder(folder: Path, files: Sequence[Path]) -> None:
    """Print the address of the page and the files written."""
    for page in (path for path in files if path.suffix == ".html"):
        print(f"Watch it in a browser: {page.resolve().as_uri()}")
    names = ", ".join(path.name for path in files)
    text = f"In {folder}{'' if str(folder).endswith('/') else '/'}: {names}"
    print(fill(text, COLUMNS, subsequent_indent="  ", break_on_hyphens=False))
    if any(path.name == "comparison.txt" for path in files):
        print("comparison.txt has every motor, link and mode (here with -v).")


# The page of saved runs ----------------------------------------------------------------------


def run_view(args: argparse.Namespace) -> int:
    """Write the page that plays a run, and the pictures and films asked for."""
    try:
        return _view(args)
    except _MISFITS as error:
        if args.debug:
            raise
        raise DescriptionError(
            f"{', '.join(args.runs)}: what it holds does not fit together "
            f"({type(error).__name__}: {error}). The file was changed, or an older pinflex wrote "
            "it: repeat the run."
        ) from error


def _live_page(args: argparse.Namespace) -> int:
    if len(args.runs) != 1:
        raise DescriptionError("view: --live-page takes one model. Name its YAML or folder.")
    with working("preparing the page"):
        page = pf.live_page(
            args.runs[0], args.live_page, args.set, field=args.field, scale=args.scale,
            meshes=args.meshes,
        )  # fmt: skip
    answer(args, {"file": page.path}, f"{page}\n")
    if not args.no_open:
        page.open()
    return 0


def _view(args: argparse.Namespace) -> int:
    if args.live_page is not None:
        return _live_page(args)
    if args.set:
        raise DescriptionError("view: --set changes a model: it goes with --live-page.")
    from pinflex.results import archive
    from pinflex.results.result import Result
    from pinflex.viewer import live
    from pinflex.viewer.export import pictures

    if args.live:
        live.require_meshcat()
    most = archive.MOST * (args.limit or 1.0)
    runs = [Result.load(file, most) for file in args.runs]
    result = runs[-1]
    rigid = None if args.rigid is None else Result.load(args.rigid, most)
    path = Path(args.output or Path(args.runs[-1]).with_suffix(".html"))
    instant = None if args.png is None else pictures.instant(result, args.png)
    with working("writing the page"):
        page = pf.view(
            result if len(runs) == 1 else _named(runs, args.runs),
            path,
            open_browser=_opens(args),
            field=args.field,
            scale=args.scale,
            rigid=rigid,
            meshes=args.meshes,
        ).path
    written = _pictures(args, result, page, instant)
    files = {"file": page, "pictures": [p.path for p in written]}
    text = "".join(f"{p.path}{f' ({p.note})' if p.note else ''}\n" for p in written)
    about = {"name": result.meta.get("name"), "level": result.level}
    answer(args, files | about, f"{page}\n{text}")
    if args.serve is not None:
        live.page_until_interrupted(page, args.serve)
    elif args.live:
        live.live_until_interrupted(result, args.field, args.scale, args.meshes)
    return 0


def _named(runs: Sequence[Result], files: Sequence[str]) -> dict[str, Result]:
    """Runs by level, or by file where two have the same one, least to most faithful."""
    levels = [run.level for run in runs]
    if len({*levels}) < len(levels):
        stems = [Path(file).stem for file in files]
        names = stems if len({*stems}) == len(stems) else [str(file) for file in files]
        return dict(zip(names, runs, strict=True))
    rank = {level: k for k, level in enumerate(LEVELS)}
    return dict(sorted(zip(levels, runs, strict=True), key=lambda x: rank.get(x[0], len(rank))))


def _opens(args: argparse.Namespace) -> bool:
    """True if a browser shows the page: not where something else was asked for."""
    served = args.serve is not None or args.live
    return not (args.no_open or served or args.png or args.gif or args.mp4)


def _pictures(
    args: argparse.Namespace, result: Result, page: Path, instant: float | None
) -> list[Picture]:
    """Still and films beside the page."""
    from pinflex.viewer.export import pictures

    written = []
    if instant is not None:
        to = page.with_suffix(".png")
        written.append(pictures.still(result, page, to, instant, args.field, args.scale))
    for wanted, suffix in ((args.gif, ".gif"), (args.mp4, ".mp4")):
        if wanted:
            to = page.with_suffix(suffix)
            written.append(pictures.film(result, page, to, args.field, args.scale))
    return written
