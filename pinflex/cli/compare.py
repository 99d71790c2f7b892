"""`pinflex compare`: the main job, rigid against flexible."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json
from pinflex.errors import SceneError
from pinflex.progress import Bar, Stages
from pinflex.text import COLUMNS
from pinflex.writing import writable

if TYPE_CHECKING:
    from pinflex.studies.study import Study


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "compare",
        "rigid against flexible: what shakes, torques, stress, the level that suffices",
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
        "--tol",
        type=parser.positive,
        default=0.05,
        metavar="X",
        help="share of torques and deviations that a level may miss and suffice (default 0.05)",
    )
    p.add_argument(
        "--errors", action="store_true", help="error bars also of large models (some seconds)"
    )
    p.add_argument(
        "--interactive",
        action="store_true",
        help="sliders in the animation: level coupled runs anew in the browser, offline",
    )
    parser.verbose(p)


def run(args: argparse.Namespace) -> int:
    """Compare rigid and flexible; write tables, figures, runs and the page."""
    from pinflex.description.solve import LEVELS
    from pinflex.studies.study import compare

    mechanism = load_model(args)
    folder = Path(args.output or f"{mechanism.name}-compare")
    writable(folder / "comparison.txt")
    given = {"band": args.band, "tol": args.tol, "errors": args.errors, "folder": folder}
    done = compare(mechanism, None, args.levels or LEVELS, **given, progress=Stages(Bar))
    if args.interactive:
        _interactive(args, done, folder)
    if args.json:
        written = {"folder": folder, "files": [path.name for path in done.files]}
        print_json(json.loads(done.table.to_json()) | written)
    else:
        print(done.table.text() if args.verbose else done.table.brief())
        _list(folder, done.files)
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
    live_comparison(
        done.mechanism, done.runs, folder / "animation.html", " ".join([args.model, *changes])
    )


def _list(folder: Path, files: Sequence[Path]) -> None:
    """Print the address of the page and the files written."""
    for page in (path for path in files if path.suffix == ".html"):
        print(f"Watch it in a browser: {page.resolve().as_uri()}")
    names = ", ".join(path.name for path in files)
    text = f"In {folder}{'' if str(folder).endswith('/') else '/'}: {names}"
    print(fill(text, COLUMNS, subsequent_indent="  ", break_on_hyphens=False))
    if any(path.name == "comparison.txt" for path in files):
        print("comparison.txt has every motor, link and mode (here with -v).")
