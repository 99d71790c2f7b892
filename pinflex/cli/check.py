"""`pinflex check`: what was understood of a model."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from pinflex.cli.console import load_model, print_json
from pinflex.studies import check_text
from pinflex.studies.check import check


def run(args: argparse.Namespace) -> int:
    """Say what was understood of a model."""
    report = check(load_model(args), args.count)
    if args.json:
        print_json(asdict(report))
    else:
        print(check_text.write(report), end="")
    return 0
