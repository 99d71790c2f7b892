"""The parser of the command line: a command with the options that all share, values of options."""

from __future__ import annotations

import argparse
import difflib
import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from pinflex.errors import DescriptionError

_MOST_SAMPLES = 1_000_000  # of a run: 100 MB for each hundred columns

_LONGEST = 15  # characters of a command's name, indented by four

Commands = Any  # argparse's private _SubParsersAction


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line."""

    def error(self, message: str) -> NoReturn:
        """Raise what argparse prints with the usage."""
        typed = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        choices = typed[2].replace("'", "").split(", ") if typed else []
        close = difflib.get_close_matches(typed[1], choices, 1) if typed else []
        hint = f' Did you mean "{close[0]}"?' if close else ""
        raise DescriptionError(f"{message}.{hint} See `{self.prog} --help`.")

    def refuse(self, rest: Sequence[str]) -> NoReturn:
        """Raise what arguments the command does not know, with the closest option."""
        first = rest[0].partition("=")[0]
        options = [name for name in self._option_string_actions if name.startswith("--")]
        close = difflib.get_close_matches(first, options, 1) if first.startswith("-") else []
        hint = f". Did you mean {close[0]}?" if close else "."
        raise DescriptionError(
            f"unrecognized arguments: {' '.join(rest)}{hint} See `{self.prog} --help`."
        )


class Layout(argparse.RawDescriptionHelpFormatter):
    """Help texts of 96 columns, broken as written."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=96)


class Overview(Layout):
    """The same for the list of all commands: a line each."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = _LONGEST


def command(
    commands: Commands, name: str, summary: str, text: str, example: str, model: bool = True
) -> argparse.ArgumentParser:
    """Add a command with the options that all share."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n{text}",
        epilog=f"example:\n  {example}",
        formatter_class=Layout,
        allow_abbrev=False,
    )
    if model:
        parser.add_argument(
            "model", metavar="MODEL", help="YAML file, its folder, or a shipped name"
        )
        repeated(
            parser, "--set", "KEY=VALUE", "change the YAML, such as solve.dt=1e-4; may be repeated"
        )
        carried(parser)
        parser.add_argument(
            "--limit",
            type=positive,
            metavar="X",
            help="take X times the memory and steps that are taken without asking",
        )
    parser.set_defaults(command_parser=parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    return parser


# Options of several commands -----------------------------------------------------------------


def repeated(parser: argparse.ArgumentParser, option: str, metavar: str, text: str) -> None:
    """Add an option that may be given several times; a list of texts."""
    parser.add_argument(option, action="append", default=[], metavar=metavar, help=text)


def carried(parser: argparse.ArgumentParser) -> None:
    """Add --payload: changes of the YAML, as --set."""
    parser.add_argument(
        "--payload", dest="set", action=_Payload, type=payload, default=[],
        metavar="MASS@FRAME", help="carry a mass in kg (or g), such as 5kg@tool0",
    )  # fmt: skip


def preload(parser: argparse.ArgumentParser) -> None:
    """Add --preload: the state about which a command linearises."""
    parser.add_argument(
        "--preload",
        choices=("gravity", "none"),
        default="gravity",
        help="gravity: about the static equilibrium; none: about the undeformed pose",
    )


def pose_option(parser: argparse.ArgumentParser) -> None:
    """Add --pose: where the motors stand."""
    parser.add_argument(
        "--pose",
        type=pose,
        default={},
        metavar="MOTOR=VALUE,...",
        help="motor positions in rad or m; loops are closed on the way from home",
    )


def verbose(parser: argparse.ArgumentParser) -> None:
    """Add -v: the long tables too."""
    parser.add_argument("-v", "--verbose", action="store_true", help="print the long tables too")


def table(parser: argparse.ArgumentParser) -> None:
    """Add the options of a batch of cases that ends in a table."""
    parser.add_argument(
        "-o", "--out", "--output", metavar="FILE", help="write the table, .csv or .parquet"
    )
    parser.add_argument("--jobs", type=count, metavar="N", help="processes (default: one per core)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="work on this Dask cluster instead")
    verbose(parser)
    parser.add_argument("--fresh", action="store_true", help="forget FILE.journal and begin anew")


class _Payload(argparse.Action):
    """Appends the changes of the YAML that a payload is to those of --set."""

    def __call__(self, parser: Any, given: Any, values: Any, option: str | None = None) -> None:
        setattr(given, self.dest, [*getattr(given, self.dest), *values])


# Values of options ---------------------------------------------------------------------------


def positive(text: str) -> float:
    """Finite number above zero."""
    value = number(text)
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number above zero")
    return value


def number(text: str) -> float:
    """Any number."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def _whole(least: int, most: int, message: str) -> Callable[[str], int]:
    """Reader of whole numbers in a range."""

    def read(text: str) -> int:
        if not text.isdecimal() or len(text) > 9 or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is not {message}")
        return int(text)

    return read


count = _whole(1, 99999, "a whole number, 1 to 99999")
port = _whole(0, 65535, "a port, 0 to 65535")
samples = _whole(2, _MOST_SAMPLES, f"a whole number, 2 to {_MOST_SAMPLES}")


def names(text: str) -> tuple[str, ...]:
    """Words joined by commas."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def payload(text: str) -> list[str]:
    """Changes of the YAML, of MASS@FRAME."""
    mass, _, frame = text.partition("@")
    found = re.fullmatch(r"\s*(\S*?\d\.?)\s*(kg|g)?\s*", mass)
    if not found or not frame.strip():
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form MASS@FRAME, as 5kg@tool0")
    kilograms = number(found[1]) * (1e-3 if found[2] == "g" else 1.0)
    return [f"payload.at={frame.strip()}", f"payload.mass={kilograms!r}"]


def pose(text: str) -> dict[str, float]:
    """Positions by motor, of MOTOR=VALUE,..."""
    positions = {}
    for item in names(text):
        name, sign, value = item.partition("=")
        if not sign or not name.strip():
            raise argparse.ArgumentTypeError(f"{item!r} is not of the form MOTOR=VALUE")
        positions[name.strip()] = number(value)
    return positions
