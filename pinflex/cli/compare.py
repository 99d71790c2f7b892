"""`pinflex compare`: the main job, rigid against flexible."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from pinflex.cli.console import Progress, load_model, print_json
from pinflex.errors import SceneError
from pinflex.results.result import Result
from pinflex.solver.solve import LEVELS
from pinflex.studies.study import file_name, study, write
from pinflex.writing import writable

_MEANINGS = (
    ("comparison.txt", "this table"),
    ("comparison.json", "the same for machines, SI units"),
    ("torques", "motor torques, rigid and flexible, and their difference"),
    ("deviation_", "platform against rigid"),
    ("stress_", "von Mises stress along each link over time"),
    ("spectrum_", "spectrum of the largest deflection"),
    ("animation.html", "the motion in a browser, stress in colour: open it"),
)


def run(args: argparse.Namespace) -> int:
    """The main job: rigid against flexible."""
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


def _close(bars: list[Progress]) -> None:
    for bar in bars:
        bar.close()


def _meaning(name: str) -> str:
    if name.endswith("-partial.npz"):
        return "what there is of a run that stopped: pinflex view plays it"
    if name.endswith(".npz"):
        return "the run: pinflex view plays it, pinflex.Result.load reads it"
    return next((words for start, words in _MEANINGS if name.startswith(start)), "")
