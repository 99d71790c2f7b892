"""`pinflex check` and `pinflex advise`: what was understood of a model, and what it needs."""

from __future__ import annotations

import argparse
from dataclasses import asdict

import pinflex as pf
from pinflex.cli.console import answer, load_model, working
from pinflex.cli.options import values
from pinflex.progress import Bar


def run_check(args: argparse.Namespace) -> int:
    """Say what was understood of a model."""
    mechanism, said = load_model(args), ""
    if args.write_home:
        from pinflex.studies.scenes.new_scene import write_home

        said = f"\nhome written to {write_home(mechanism)}\n"
        mechanism = load_model(args)
    with working("checking"):
        found = pf.check(mechanism, **values(args))
    return answer(args, asdict(found), found.text() + said)


def run_advise(args: argparse.Namespace) -> int:
    """Say what a scene needs."""
    from pinflex.advice.reduced_models import report

    mechanism = load_model(args)
    with Bar("looking") as bar:
        bar.say()
        advice = pf.advise(mechanism, **values(args), progress=bar)
    return answer(args, asdict(advice), report(advice, args.model, args.verbose).text())
