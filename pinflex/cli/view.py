"""`pinflex view`: the page that plays a run, pictures and films of it."""

from __future__ import annotations

import argparse
from pathlib import Path

from pinflex.cli.console import print_json
from pinflex.errors import DescriptionError
from pinflex.results import checked
from pinflex.results.result import Result
from pinflex.viewer import pictures, serve
from pinflex.viewer.view import view

_AMISS = (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError)


def run(args: argparse.Namespace) -> int:
    """Write the page that plays a run, and what else was asked for."""
    try:
        return _run(args)
    except _AMISS as error:
        if args.debug:
            raise
        raise DescriptionError(
            f"{args.run}: what it holds does not fit together ({type(error).__name__}: {error}). "
            "The file was changed, or an older pinflex wrote it: repeat the run."
        ) from error


def _run(args: argparse.Namespace) -> int:
    most = checked.MOST * (args.limit or 1.0)
    result = Result.load(args.run, most)
    rigid = None if args.rigid is None else Result.load(args.rigid, most)
    path = Path(args.output) if args.output is not None else Path(args.run).with_suffix(".html")
    at = None if args.png is None else pictures.instant(result, args.png)
    stays = args.serve is not None or args.live
    page = view(
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
