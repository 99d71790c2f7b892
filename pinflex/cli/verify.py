"""`pinflex verify`: published benchmarks on this machine, as a table, JSON or a page."""

from __future__ import annotations

import argparse

from pinflex.cli import parser
from pinflex.cli.console import print_json
from pinflex.progress import Bar, Stages
from pinflex.writing import writable


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "verify",
        "published benchmarks on this machine",
        """
Runs beams, rotating beams, closed loops and large deflection against published or exact references
and prints measured, reference, error and limit; takes about two minutes, with --long more.""",
        "pinflex verify\n  pinflex verify A02 Princeton -o verify.html",
        model=False,
    )
    p.add_argument("cases", nargs="*", metavar="CASE", help="parts of case names (default all)")
    p.add_argument("--long", action="store_true", help="also cases that take minutes")
    p.add_argument("-o", "--output", metavar="FILE.html", help="write a page with plots")


def run(args: argparse.Namespace) -> int:
    """Print the table or JSON, write the page; 1 if something fails."""
    from pinflex.lab.verify import verdict, verify, write_page

    writable(args.output)
    stages = Stages(Bar)

    def show(table: str) -> None:  # case by case: all of them take minutes
        stages.close()
        print(f"{table}\n", flush=True)

    def next_case(name: str, k: int, n: int) -> None:
        stages(f"{name} ({k + 1} of {n})")

    try:
        outcome = verify(args.cases, next_case, args.long, None if args.json else show)
    finally:
        stages.close()
    page = None if args.output is None else write_page(outcome, args.output)
    if args.json:
        print_json({"passed": outcome.passed, "records": outcome.to_json(), "page": page})
    else:
        print(verdict(outcome))
        if page is not None:
            print(f"\nwrote {page}")
    return 0 if outcome.passed else 1
