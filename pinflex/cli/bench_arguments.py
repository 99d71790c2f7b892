"""The arguments of `pinflex bench`."""

from __future__ import annotations

import argparse
from collections.abc import Callable


def add(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command; `command` makes a parser from name, summary, text and example."""
    p = command(
        "bench",
        "time against error on a scene",
        """
Solves the scene by every level, by more and fewer internal modes, by several integrators and steps,
and compares time and error with a converged solution that it refines until two runs agree.""",
        "pinflex bench 3rrs -o out",
        model=False,
    )
    p.add_argument("model", nargs="?", metavar="MODEL", help="YAML file, its folder, or a name")
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change the YAML; may be repeated",
    )
    p.add_argument("-o", "--output", metavar="DIR", help="write table, numbers and figure there")
    p.add_argument("--race", nargs="?", const="", help=argparse.SUPPRESS)
