"""`pinflex sensitivity`, `design` and `fit`: numbers of the YAML that matter, are best, explain."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import pinflex as pf
from pinflex.cli.console import answer, check_files, load_model, written
from pinflex.cli.options import values
from pinflex.errors import DescriptionError
from pinflex.progress import Bar
from pinflex.report import Table, table

_T = TypeVar("_T")


def run_sensitivity(args: argparse.Namespace) -> int:
    """Print the table of sensitivities and a sentence on each output."""
    check_files(args.plot)
    with Bar("sensitivity") as bar:
        study = pf.sensitivities(load_model(args), args.by, args.of, **values(args), progress=bar)
    text = study.text()
    if args.plot is not None:
        study.plot(args.plot)
        text += f"wrote {args.plot}\n"
    return answer(args, study.as_json(), text)


def run_design(args: argparse.Namespace) -> int:
    """Search, and say what was found and what limits it."""
    check_files(args.plot, args.output)
    vary, choose = _by_key(_bounds, args.vary), _by_key(_choices, args.choose)
    robot = load_model(args)
    with Bar("design") as bar:
        options = {"level": "quasistatic"} | values(args) | {
            "choose": choose, "progress": bar,
            "journal": f"{args.output}.journal" if args.output else None,
        }  # fmt: skip
        if args.against is not None:
            front = pf.pareto(robot, args.minimise, args.against, vary, args.keep, **options)
        else:
            front = [pf.design(robot, args.minimise, vary, args.keep, **options)]
    files = written(front[0], args)
    text = front[0].text()
    if args.against:
        text = f"{_front(front, args.minimise, args.against).text()}\n"
    data = {"designs": [design.as_json() for design in front]}
    return answer(args, data, text, files)


def run_fit(args: argparse.Namespace) -> int:
    """Fit, and say what was found and what the measurements leave open."""
    check_files(args.plot, args.output)
    vary, priors = _by_key(_parameter, args.vary), _by_key(_prior, args.prior)
    nodes = _by_key(_node, args.node)
    with Bar("fit") as bar:
        study = pf.fit(
            load_model(args), args.measured, vary, priors, **values(args), nodes=nodes,
            progress=bar,
        )  # fmt: skip
    return answer(args, study.as_json(), study.text(), written(study, args))


def _front(front: Sequence[pf.Design], minimise: str, against: str) -> Table:
    units, numbered = front[0].units, [*enumerate(front, 1)]
    aims = [
        (f"{name} [{units[name]}]", lambda row, name=name: row[1].after[name])
        for name in (minimise, against)
    ]
    numbers = [
        (name, lambda row, k=k: float(row[1].best[k])) for k, name in enumerate(front[0].parameters)
    ]
    title = "Designs of which none is better in both"
    return table(title, numbered, ("design", lambda row: row[0]), *aims, *numbers, names=(6,))


# Values of repeated options ------------------------------------------------------------------


def _by_key(read: Callable[[str], tuple[Any, _T]], texts: Sequence[str]) -> dict[Any, _T]:
    return dict(map(read, texts))


def _parts(text: str, sign: str) -> tuple[str, str, str]:
    key, typed, value = (part.strip() for part in text.partition(sign))
    return key, typed, value


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    key, _, value = _parts(text, "=")
    low, _, high = value.partition(":")
    try:
        return key, (float(low), float(high))
    except ValueError:
        raise DescriptionError(f"--vary {text}: not of the form KEY=LOW:HIGH. Write one.") from None


def _parameter(text: str) -> tuple[str, tuple[float, float] | None]:
    if not _parts(text, "=")[1]:
        return text.strip(), None
    try:
        return _bounds(text)
    except DescriptionError:
        raise DescriptionError(
            f"--vary {text}: not of the form KEY=LOW:HIGH. Write KEY alone, or one."
        ) from None


def _choices(text: str) -> tuple[str, list[dict[str, float] | float]]:
    key, _, value = _parts(text, "=")
    try:
        if not value.endswith(".csv"):
            return key, [float(part) for part in value.split(",")]
        with Path(value).open(newline="", encoding="utf-8") as stream:
            return key, [
                {name: float(x) for name, x in row.items()} for row in csv.DictReader(stream)
            ]
    except (ValueError, TypeError) as error:
        raise DescriptionError(
            f"--choose {text}: {error}. Give KEY=V,W,... or KEY=FILE.csv with numbers in columns."
        ) from None


def _prior(text: str) -> tuple[str, float]:
    key, _, value = _parts(text, "~")
    try:
        return key, float(value.removesuffix("%")) / (100.0 if value.endswith("%") else 1.0)
    except ValueError:
        raise DescriptionError(f"--prior {text}: not of the form KEY~5%. Write one.") from None


def _node(text: str) -> tuple[int, str]:
    number, _, frame = _parts(text, "=")
    if not number.isdigit() or not frame:
        raise DescriptionError(f"--node {text}: not of the form 3=FRAME. Write one.")
    return int(number), frame
