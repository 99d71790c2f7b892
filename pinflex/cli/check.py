"""`pinflex check`: what was understood of a model."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, working


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "check",
        "what was understood of a model, before anything is solved",
        """
Mobility, loops with their rank and redundant rows, sigma_min, beam against URDF masses, the planes
in which links bend and why, static sag of the platform, holding torques, first natural frequencies,
and warnings.""",
        "pinflex check 3rrs\n  pinflex check arm/arm.yaml --set gravity.2=-1.62",
    )
    p.add_argument(
        "--count", type=parser.count, default=6, metavar="N", help="frequencies (default 6)"
    )
    p.add_argument(
        "--write-home",
        action="store_true",
        help="write the closed pose into the YAML as `home`; all other lines stay",
    )


def run(args: argparse.Namespace) -> int:
    """Say what was understood of a model."""
    from pinflex.studies.checking.check import check
    from pinflex.studies.scenes.new_scene import write_home

    mechanism = load_model(args)
    if args.write_home:
        path = write_home(mechanism)
        mechanism = load_model(args)
    with working("checking"):
        report = check(mechanism, args.count)
    if args.json:
        print_json(asdict(report))
    else:
        print(report.text(), end="")
        if args.write_home:
            print(f"\nhome written to {path}")
    return 0
