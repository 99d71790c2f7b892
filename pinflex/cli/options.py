"""Options of the commands: those of a function of `pf` from its signature and docstring, and more.

A name in the options of a command is a parameter of its function: type and default are those of
the signature, the help is the first sentence on it under `Args:`. Both are read from the source,
as importing the function would load its libraries.
"""

from __future__ import annotations

import argparse
import ast
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pinflex

_ROOT = Path(__file__).parents[2]
_MOST_SAMPLES = 1_000_000  # of a run: 100 MB for each hundred columns


@dataclass(frozen=True)
class Option:
    """An option of the command line.

    Attributes:
        parameter: Of the function whose parameter it is, "" for an option of the command alone.
        flags: As typed; of a parameter without any: --its-name.
        settings: Of argparse, over those that the signature and the docstring give.
    """

    parameter: str = ""
    flags: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def option(*flags: str, **settings: Any) -> Option:
    """An option of the command alone."""
    return Option("", flags, settings)


def parameter(name: str, *flags: str, **settings: Any) -> Option:
    """A parameter of the command's function, with what differs from it."""
    return Option(name, flags, settings)


def flag(name: str, text: str, *more: str) -> Option:
    """An option that is there or not."""
    return option(*more, name, action="store_true", help=text)


def repeated(name: str, metavar: str, text: str) -> Option:
    """An option that may be given several times; a list of texts."""
    return option(name, action="append", default=[], metavar=metavar, help=text)


Options = Sequence["str | Option | tuple[str | Option, ...]"]  # a tuple: one of them at most


def add(parser: argparse.ArgumentParser, options: Options, function: str = "") -> None:
    """Add options to a parser, those of parameters as its function has them."""
    known = parameters(function) if function else {}
    names: list[str] = []
    for group in options:
        place: Any = parser
        if isinstance(group, tuple):
            place = parser.add_mutually_exclusive_group()
        for each in group if isinstance(group, tuple) else (group,):
            one = parameter(each) if isinstance(each, str) else each
            if not one.parameter:
                place.add_argument(*one.flags, **one.settings)
                continue
            names.append(one.parameter)
            flags = one.flags or (f"--{one.parameter.replace('_', '-')}",)
            settings = known[one.parameter].settings() | dict(one.settings)
            if settings.get("action"):
                settings = {k: x for k, x in settings.items() if k not in ("type", "metavar")}
            place.add_argument(*flags, dest=one.parameter, default=argparse.SUPPRESS, **settings)
    parser.set_defaults(parameters=tuple(names))


def values(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments for the function of a command: those that were typed."""
    return {name: getattr(args, name) for name in args.parameters if hasattr(args, name)}


# Parameters of a function, from its source ---------------------------------------------------


@dataclass(frozen=True)
class Parameter:
    """A parameter as signature and docstring have it.

    Attributes:
        name: In Python. kind: Its annotation without None. default: Or None where it has no value.
        text: The first sentence on it.
    """

    name: str
    kind: str
    default: Any
    text: str

    def settings(self) -> dict[str, Any]:
        """Keyword arguments of `argparse.add_argument`."""
        if self.kind == "bool":
            return {"action": "store_true", "help": self.help()}
        return {"type": _TYPES.get(self.kind), "metavar": self.metavar(), "help": self.help()}

    def metavar(self) -> str:
        """The unit, or the sort of value."""
        unit = re.search(r"\[(s|m|Hz)\]", self.text)
        if unit:
            return unit[1].upper()
        return {"int": "N", "float": "X", **_SEVERAL}.get(self.kind, self.name.upper())

    def help(self) -> str:
        """The sentence in the manner of a help, with the default where it does not say it."""
        text = self.text.rstrip(".").replace("%", "%%")
        if text[1:2].islower():
            text = text[0].lower() + text[1:]
        if isinstance(self.default, bool | None) or "default" in text:
            return text
        if isinstance(self.default, int | float):
            return f"{text} (default {self.default:g})".replace("e-0", "e-")
        return f"{text} (default {self.default})" if isinstance(self.default, str) else text


@cache
def parameters(function: str) -> dict[str, Parameter]:
    """Parameters of a function of `pf`, by name."""
    source = _source(pinflex._MODULE[function])
    begin = re.search(rf"(?m)^def {function}\(", source)
    assert begin is not None
    text = re.split(r"(?m)^(?=\S)(?![)\]])", source[begin.start() :], maxsplit=2)[1]
    node = ast.parse(text).body[0]
    assert isinstance(node, ast.FunctionDef)
    said = _arguments(ast.get_docstring(node) or "")
    every = [*node.args.args, *node.args.kwonlyargs]
    missing = [None] * (len(node.args.args) - len(node.args.defaults))
    defaults = [*missing, *node.args.defaults, *node.args.kw_defaults]
    return {
        one.arg: Parameter(
            one.arg, ast.unparse(one.annotation or ast.Constant("")).removesuffix(" | None"),
            None if default is None else _value(default, source), said.get(one.arg, ""),
        )
        for one, default in zip(every, defaults, strict=True)
    }  # fmt: skip


def _source(module: str) -> str:
    return _ROOT.joinpath(*module.split(".")).with_suffix(".py").read_text("utf-8")


def _arguments(doc: str) -> dict[str, str]:
    """The first sentence on each parameter of a docstring."""
    block = re.split(r"(?m)^(?:Returns|Raises|Source)\b", doc.partition("Args:\n")[2])[0]
    found = re.findall(r"(?m)^    (\w[\w, ]*): (.*(?:\n {5,}.*)*)", block)
    return {
        name: re.split(r"(?<!\.)\. (?=[A-Z])", " ".join(text.split()))[0]
        for names, text in found
        for name in names.split(", ")
    }


def _value(node: ast.expr, source: str) -> Any:
    """A default, also of a constant of this module or of another; None for one that is no word."""
    if not isinstance(node, ast.Name):
        try:
            return ast.literal_eval(node)
        except ValueError:
            return None
    here = re.search(rf"(?m)^{node.id}(?:: [^=]*)? = ([^#\n]+)", source)
    if here:
        try:
            return ast.literal_eval(here[1].strip())
        except (ValueError, SyntaxError):
            return None
    imported = rf"(?m)^from pinflex\.([\w.]+) import (?:\([^)]*|[^\n(]*)\b{node.id}\b"
    there = re.search(imported, source)
    return None if there is None else _value(node, _source(f"pinflex.{there[1]}"))


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


def _with_unit(what: str, units: dict[str, float]) -> Callable[[str], float]:
    """A positive number with or without a unit, in SI."""

    def read(text: str) -> float:
        typed = re.fullmatch(rf"([0-9.eE+-]+)\s*({'|'.join(units)}|)", text.strip())
        if typed is None:
            raise argparse.ArgumentTypeError(f"{text!r} is no {what}")
        return positive(typed[1]) * units.get(typed[2], 1.0)

    return read


small_length = _with_unit("length, such as 50um", {"m": 1.0, "mm": 1e-3, "um": 1e-6})
stress = _with_unit("stress, such as 120MPa", {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9})


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


_SEVERAL = dict.fromkeys(("Sequence[str]", "Iterable[str]"), "A,B,...")
_TYPES: dict[str, Callable[[str], Any]] = {
    "int": count, "float": positive, **dict.fromkeys(_SEVERAL, names),
}  # fmt: skip


class _Payload(argparse.Action):
    """Appends the changes of the YAML that a payload is to those of --set."""

    def __call__(self, parser: Any, given: Any, values: Any, option: str | None = None) -> None:
        setattr(given, self.dest, [*getattr(given, self.dest), *values])


# Options of several commands -----------------------------------------------------------------

MODEL = option("model", metavar="MODEL", help="YAML file, its folder, or a shipped name")
PAYLOAD = option(
    "--payload", dest="set", action=_Payload, type=payload, default=[],
    metavar="MASS@FRAME", help="carry a mass in kg (or g), such as 5kg@tool0",
)  # fmt: skip
PRELOAD = parameter(
    "preload", choices=("gravity", "none"), metavar=None,
    help="gravity: about the static equilibrium; none: about the undeformed pose",
)  # fmt: skip
POSE = option(
    "--pose", type=pose, default={}, metavar="MOTOR=VALUE,...",
    help="motor positions in rad or m; loops are closed on the way from home",
)  # fmt: skip
VERBOSE = flag("--verbose", "print the long tables too", "-v")
TABLE = (
    option("-o", "--out", "--output", metavar="FILE", help="write the table, .csv or .parquet"),
    option("--jobs", type=count, metavar="N", help="processes (default: one per core)"),
    option("--scheduler", metavar="ADDRESS", help="work on this Dask cluster instead"),
    VERBOSE,
    flag("--fresh", "forget FILE.journal and begin anew"),
)
SHARED: Options = (
    flag("--json", "print one JSON object, SI units"),
    flag("--debug", "show the traceback of an error"),
)
SCENE: Options = (
    MODEL,
    repeated("--set", "KEY=VALUE", "change the YAML, such as solve.dt=1e-4; may be repeated"),
    PAYLOAD,
    option("--limit", type=positive, metavar="X",
           help="allow X times the usual limits of memory and steps"),
)  # fmt: skip


@dataclass(frozen=True)
class Command:
    """A command.

    Attributes:
        run: Module of this package and the function there that is given the arguments.
        text: After the summary in its help. example: A line or more.
        options: After the shared ones.
        function: Of `pf`, whose parameters are options.
        shared: Options of the commands of its sort.
    """

    run: tuple[str, str]
    text: str
    example: str
    options: Options = ()
    function: str = ""
    shared: Options = SCENE
