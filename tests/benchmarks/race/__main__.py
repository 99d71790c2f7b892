"""The race: `python -m tests.benchmarks.race [R1,...] [--report FILE.md] [--json]`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from pinflex.writing import plain, writable
from tests.benchmarks.race.contest import run
from tests.benchmarks.race.report import as_json, write_report
from tests.benchmarks.race.scenes import RACES


def main() -> None:
    """Race on the scenes named and write the report."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.race", description=__doc__)
    parser.add_argument("scenes", nargs="?", default=",".join(RACES), metavar="R1,...")
    parser.add_argument("--report", metavar="FILE.md", help="write the report there")
    parser.add_argument("--json", action="store_true", help="numbers for machines")
    args = parser.parse_args()
    writable(args.report)
    names = [name.strip() for name in args.scenes.split(",")]
    outcomes = run(names, lambda text: print(text, file=sys.stderr))
    text = write_report(outcomes)
    if args.report is not None:
        Path(args.report).write_text(text)
    print(json.dumps(plain(as_json(outcomes)), indent=2) if args.json else text)


if __name__ == "__main__":
    main()
