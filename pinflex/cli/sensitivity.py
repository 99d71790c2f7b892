"""`pinflex sensitivity`: what to change."""

from __future__ import annotations

import argparse

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json
from pinflex.progress import Bar


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "sensitivity",
        "what to change: per cent of an output for one per cent of a parameter",
        """
Differentiates outputs by numbers of the YAML: frequencies, mass, sag, stiffness, and the peaks of a
run. Links that the YAML writes in one block are one parameter.""",
        "pinflex sensitivity delta --by 'flexible.*.section.*' --of frequency.1 --of mass",
    )
    parser.repeated(p, "--by", "KEY", "key of a number in the YAML, may have globs; repeatable")
    parser.repeated(
        p, "--of", "OUTPUT",
        "frequency.N, mass, sag, stiffness.AXIS, deviation.peak, torque.peak|rms[.MOTOR], "
        "stress.peak, stress.yield; may be repeated",
    )  # fmt: skip
    p.add_argument("--level", help="of the runs that an output needs (default: the YAML's)")
    p.add_argument("--plot", metavar="FILE", help="write a tornado chart, .png or .pdf")


def run(args: argparse.Namespace) -> int:
    """Print the table of sensitivities and a sentence on each output."""
    from pinflex.variation.sensitivity import sensitivities
    from pinflex.writing import writable

    writable(args.plot)
    with Bar("sensitivity") as bar:
        found = sensitivities(load_model(args), args.by, args.of, args.level, bar)
    if args.plot is not None:
        found.plot(args.plot)
    if args.json:
        print_json(found.as_json())
    else:
        print(found.text())
        if args.plot is not None:
            print(f"wrote {args.plot}")
    return 0
