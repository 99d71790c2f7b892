"""`pinflex view`: the page that plays a run, pictures and films of it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pinflex.cli import parser
from pinflex.cli.console import print_json, working
from pinflex.errors import DescriptionError

if TYPE_CHECKING:
    from pinflex.results.result import Result
    from pinflex.viewer.export.pictures import Picture

_MISFITS = (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError)


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "view",
        "an animation of a saved run",
        """
Writes one page that plays in any browser, offline, and opens it. Several runs of one robot share
the page, which switches, overlays and subtracts them; the last is shown first.

With --live-page and a model in place of runs the page has sliders (payload, speed of the move,
damping) and solves the scene again in the browser at every move of one.""",
        "pinflex view run.npz --field bending --scale 20\n"
        "  pinflex view run.npz --png worst --gif\n"
        "  pinflex view delta-compare/*.npz\n"
        "  pinflex view delta --live-page delta.html",
        model=False,
    )
    p.add_argument(
        "runs", metavar="RUN.npz", nargs="+",
        help="from `pinflex solve -o` or `pinflex compare`; with --live-page a MODEL",
    )  # fmt: skip
    p.add_argument("-o", "--output", metavar="FILE.html", help="default: beside the run")
    p.add_argument(
        "--field",
        default="von_mises",
        metavar="NAME",
        help="colour: von_mises, bending, axial, shear or displacement",
    )
    p.add_argument("--scale", default="auto", metavar="X", help="magnification (default auto)")
    p.add_argument(
        "--limit", type=parser.positive, metavar="X", help="read runs of up to X times 2 GB"
    )
    p.add_argument("--rigid", metavar="RUN.npz", help="rigid run to compare with")
    parser.repeated(p, "--meshes", "DIR", "folder with the URDF's meshes; may be repeated")
    p.add_argument(
        "--live-page",
        metavar="FILE.html",
        help="write a page that solves MODEL again as sliders move (pip install 'pinflex[page]')",
    )
    parser.repeated(p, "--set", "KEY=VALUE", "with --live-page: change the YAML; may be repeated")
    p.add_argument("--no-open", action="store_true", help="only write the page")
    p.add_argument("--png", metavar="T", help="also a picture at T s, or at the worst instant")
    p.add_argument("--gif", action="store_true", help="also a film as .gif")
    p.add_argument("--mp4", action="store_true", help="also a film as .mp4 (needs ffmpeg)")
    p.add_argument(
        "--serve",
        nargs="?",
        const=0,
        type=parser.port,
        metavar="PORT",
        help="serve the page to this machine only, until Ctrl-C (default: a free port)",
    )
    p.add_argument(
        "--live",
        action="store_true",
        help="play in meshcat, this machine only, until Ctrl-C",
    )


def run(args: argparse.Namespace) -> int:
    """Write the page that plays a run, and the pictures and films asked for."""
    try:
        return _run(args)
    except _MISFITS as error:
        if args.debug:
            raise
        raise DescriptionError(
            f"{', '.join(args.runs)}: what it holds does not fit together "
            f"({type(error).__name__}: {error}). The file was changed, or an older pinflex wrote "
            "it: repeat the run."
        ) from error


def _live_page(args: argparse.Namespace) -> int:
    from pinflex.browser.page import live_page

    if len(args.runs) != 1:
        raise DescriptionError("view: --live-page takes one model. Name its YAML or folder.")
    with working("preparing the page"):
        page = live_page(
            args.runs[0], args.live_page, args.set, field=args.field, scale=args.scale,
            meshes=args.meshes,
        )  # fmt: skip
    if args.json:
        print_json({"file": page.path})
    else:
        print(page)
    if not args.no_open:
        page.open()
    return 0


def _run(args: argparse.Namespace) -> int:
    if args.live_page is not None:
        return _live_page(args)
    if args.set:
        raise DescriptionError("view: --set changes a model: it goes with --live-page.")
    from pinflex.results import archive
    from pinflex.results.result import Result
    from pinflex.viewer import live
    from pinflex.viewer.export import pictures
    from pinflex.viewer.view import view

    if args.live:
        from pinflex.viewer.live import require_meshcat

        require_meshcat()
    most = archive.MOST * (args.limit or 1.0)
    runs = [Result.load(file, most) for file in args.runs]
    result = runs[-1]
    rigid = None if args.rigid is None else Result.load(args.rigid, most)
    path = Path(args.output or Path(args.runs[-1]).with_suffix(".html"))
    instant = None if args.png is None else pictures.instant(result, args.png)
    with working("writing the page"):
        page = view(
            result if len(runs) == 1 else _named(runs, args.runs),
            path,
            open_browser=_opens(args),
            field=args.field,
            scale=args.scale,
            rigid=rigid,
            meshes=args.meshes,
        ).path
    written = _pictures(args, result, page, instant)
    if args.json:
        files = {"file": page, "pictures": [p.path for p in written]}
        print_json({**files, "name": result.meta.get("name"), "level": result.level})
    else:
        print(page)
        print("".join(f"{p.path}{f' ({p.note})' if p.note else ''}\n" for p in written), end="")
    if args.serve is not None:
        live.page_until_interrupted(page, args.serve)
    elif args.live:
        live.live_until_interrupted(result, args.field, args.scale, args.meshes)
    return 0


def _named(runs: Sequence[Result], files: Sequence[str]) -> dict[str, Result]:
    """Runs by level, or by file where two have the same one, least to most faithful."""
    from pinflex.description.solve import LEVELS

    levels = [run.level for run in runs]
    if len({*levels}) < len(levels):
        stems = [Path(file).stem for file in files]
        names = stems if len({*stems}) == len(stems) else [str(file) for file in files]
        return dict(zip(names, runs, strict=True))
    found = dict(zip(levels, runs, strict=True))
    return {k: found[k] for k in sorted(found, key=lambda k: LEVELS.index(k) if k in LEVELS else 9)}


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
