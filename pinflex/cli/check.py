"""`pinflex check`: what was understood of a model."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from pinflex.cli.console import load_model, print_json
from pinflex.studies import check_text
from pinflex.studies.check import check
from pinflex.studies.home import write_home


def run(args: argparse.Namespace) -> int:
    """Say what was understood of a model."""
    mechanism = load_model(args)
    if args.write_home:
        path = write_home(mechanism)
        mechanism = load_model(args)
    report = check(mechanism, args.count)
    if args.json:
        print_json(asdict(report))
    else:
        print(check_text.write(report), end="")
        if args.write_home:
            print(f"\nhome written to {path}")
    return 0
