"""`pinflex advise`: what a scene needs."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json
from pinflex.progress import Bar


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "advise",
        "what a scene needs: level, links, planes, modes, tolerance",
        """
Measures along the motion, by cheap linear runs of a richer model (every plane, stretch, twist, one
more mode), what each level and each thing left out costs, and proposes the least that keeps the
errors within a tolerance, with an error bar on each output. Errors are relative to the largest
value; of the platform, to its largest deviation from the rigid motion. A short coupled run holds
them to the full equations. A torque alone often needs no flexible link: ask for what you need. The
last lines say what weakens the advice. `pinflex solve MODEL --level auto` follows it as far as the
level and the step.""",
        "pinflex advise race_r1 --asked torque --tol 0.03\n  pinflex advise 3rrs --tol 1e-2 --json",
    )
    p.add_argument(
        "--tol", type=parser.positive, default=0.05, metavar="X",
        help="relative error that may be, 1e-6 to 0.1 (default 0.05, as of compare)",
    )  # fmt: skip
    p.add_argument(
        "--band", type=parser.positive, default=50e-6, metavar="M",
        help="error of the platform in m that does no harm (default 50e-6, as of compare)",
    )  # fmt: skip
    p.add_argument(
        "--asked", type=parser.names, default=(), metavar="A,B,...",
        help="torque, deflection, platform (default: the YAML's solve.asked, or torque, platform)",
    )  # fmt: skip
    parser.verbose(p)
    p.add_argument("--until", type=parser.positive, metavar="S", help="end time in s")


def run(args: argparse.Namespace) -> int:
    """Say what a scene needs."""
    from pinflex.advice import proposal as advise_text
    from pinflex.advice.advise import advise

    mechanism = load_model(args)
    with Bar("looking") as bar:
        bar.say()
        options = {"tol": args.tol, "band": args.band, "asked": args.asked, "until": args.until}
        advice = advise(mechanism, **options, progress=bar)
    if args.json:
        print_json(asdict(advice))
    else:
        print(advise_text.write(advice, args.model, args.verbose), end="")
    return 0
