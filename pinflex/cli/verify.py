"""The command `verify`: published benchmarks on this machine, as a table, JSON or a page."""

from __future__ import annotations

import argparse

from pinflex.cli.console import Progress, print_json
from pinflex.lab.verify import verdict, verify, write_page
from pinflex.writing import writable


def run(args: argparse.Namespace) -> int:
    """`pinflex verify`: print the table or JSON, write the page; 1 if something fails."""
    writable(args.output)
    bar = Progress("verify")

    def tell(table: str) -> None:  # case by case: the whole takes minutes
        bar.close()
        print(f"{table}\n", flush=True)

    ended = None if args.json else tell
    try:
        found = verify(args.cases, lambda _, k, n: bar(k, n), args.long, ended)
    finally:
        bar.close()
    page = None if args.output is None else write_page(found, args.output)
    if args.json:
        print_json({"passed": found.passed, "records": found.to_json(), "page": page})
    else:
        print(verdict(found))
        if page is not None:
            print(f"\nwrote {page}")
    return 0 if found.passed else 1
