"""`pinflex compare`: the main job, rigid against flexible."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from textwrap import fill

from pinflex.cli import parser
from pinflex.cli.console import Progress, load_model, print_json
from pinflex.errors import SceneError
from pinflex.results.result import Result
from pinflex.text import COLUMNS
from pinflex.writing import writable


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "compare",
        "the main job: rigid against flexible",
        """
Solves the scene rigid and flexible and says what shakes by how much, how far the torques are off,
what the links bear and which level suffices; writes tables, figures, the runs and an animation. A
level that cannot be solved does not stop the others.""",
        "pinflex compare delta\n  pinflex compare arm.yaml -o out --levels ked,coupled --band 1e-5",
    )
    p.add_argument("-o", "--output", metavar="DIR", help="folder (default NAME-compare)")
    p.add_argument(
        "--levels",
        type=parser.names,
        metavar="A,B,...",
        help="beside rigid: quasistatic, ked, coupled (default all)",
    )
    p.add_argument(
        "--band",
        type=parser.positive,
        default=50e-6,
        metavar="M",
        help="platform deviation in m that does no harm: settling time, verdict (default 50e-6)",
    )
    p.add_argument(
        "--errors", action="store_true", help="error bars also of large models (some seconds)"
    )
    p.add_argument("-v", "--verbose", action="store_true", help="print the long tables too")


def run(args: argparse.Namespace) -> int:
    """Compare rigid and flexible; write tables, figures, runs and the page."""
    from pinflex.description.solve import LEVELS
    from pinflex.studies.study import file_name, study, write

    bars: list[Progress] = []

    def tell(text: str) -> None:
        _close(bars)
        bars.append(Progress(text))
        bars[-1].say()

    tell(f"loading {args.model}")
    try:
        mechanism = load_model(args)
    finally:
        _close(bars)
    folder = Path(args.output or f"{mechanism.name}-compare")
    writable(folder / "comparison.txt")
    runs: list[Path] = []

    def progress(level: str) -> Progress:
        tell(level)
        return bars[-1]

    def keep(level: str, run: Result, complete: bool) -> None:
        tell(f"saving {level}")
        runs.append(run.save(folder / file_name(run, complete)))
        # what an earlier comparison left of this level would contradict the table
        (folder / file_name(run, not complete)).unlink(missing_ok=True)

    try:
        done = study(mechanism, args.levels or LEVELS, progress, keep, args.band, tell, args.errors)
        files = write(done, folder, tell)
    finally:
        _close(bars)
    if args.json:
        written = {"folder": folder, "files": [path.name for path in (*files, *runs)]}
        print_json(json.loads(done.table.to_json()) | written)
    else:
        print(done.table.text() if args.verbose else done.table.brief())
        _list(folder, files, runs)
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


def _list(folder: Path, files: list[Path], runs: list[Path]) -> None:
    """Print the address of the page and the files written."""
    for page in (path for path in files if path.suffix == ".html"):
        print(f"Watch it in a browser: {page.resolve().as_uri()}")
    names = ", ".join(path.name for path in (*files, *runs))
    text = f"In {folder}{'' if str(folder).endswith('/') else '/'}: {names}"
    print(fill(text, COLUMNS, subsequent_indent="  ", break_on_hyphens=False))
    if any(path.name == "comparison.txt" for path in files):
        print("comparison.txt has every motor, link and mode (here with -v).")
