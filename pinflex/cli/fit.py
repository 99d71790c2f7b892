"""`pinflex fit`: the numbers of a scene that explain what was measured."""

from __future__ import annotations

import argparse

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, say_written, written
from pinflex.errors import DescriptionError
from pinflex.progress import Bar


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "fit",
        "the numbers that explain measured frequencies, responses or histories",
        """
MEASURED is a CSV with a line of column names:
  frequency, std, mode, FRAME.x ...                natural frequencies [Hz] at home, motors locked;
                                                   shapes say which mode is which
  frequency, OUTPUT/INPUT.real, OUTPUT/INPUT.imag  frequency responses
  t, joint.NAME, torque.NAME, FRAME.x ...          time histories
or a universal file (.uff, .unv) of frequency responses. NAME.std is a standard deviation.""",
        "pinflex fit ur5 hammer.csv --vary 'flexible.*.material.E' -o fitted.yaml --plot fit.png",
    )
    p.add_argument("measured", metavar="MEASURED", help="CSV or universal file")
    parser.repeated(
        p, "--vary", "KEY[=LOW:HIGH]", "number of the YAML, may have globs; repeatable (bounds: "
        "a tenth to ten times)",
    )  # fmt: skip
    parser.repeated(
        p, "--prior", "KEY~SHARE", "how well the number is known as given, such as 5%%; repeatable"
    )
    p.add_argument(
        "--shape-std", type=float, metavar="X",
        help="fit shapes too: standard deviation of a component of a shape of length one",
    )  # fmt: skip
    p.add_argument("--level", help="of runs for time histories (default: the YAML's)")
    p.add_argument("--dt", type=float, metavar="S", help="step of these runs")
    p.add_argument(
        "--simultaneous", action="store_true",
        help="intervals that hold all at once with 95 %% confidence (default: each alone)",
    )  # fmt: skip
    parser.repeated(p, "--node", "N=FRAME", "frame of a node of a universal file; repeatable")
    p.add_argument("-o", "--output", metavar="FILE", help="write the fitted YAML")
    p.add_argument("--plot", metavar="FILE", help="write measured against fitted, .png or .pdf")


def run(args: argparse.Namespace) -> int:
    """Fit, and say what was found and what was not told."""
    from pinflex.variation.fit import fit
    from pinflex.writing import writable

    for path in (args.output, args.plot):
        writable(path)
    vary = dict(_vary(text) for text in args.vary)
    priors = dict(_prior(text) for text in args.prior)
    nodes = dict(_node(text) for text in args.node)
    with Bar("fit") as bar:
        found = fit(
            load_model(args), args.measured, vary, priors, shape_std=args.shape_std,
            level=args.level, dt=args.dt, nodes=nodes, simultaneous=args.simultaneous,
            progress=bar,
        )  # fmt: skip
    files = written(found, args)
    if args.json:
        print_json(found.as_json() | {"files": files})
        return 0
    print(found.text())
    say_written(files)
    return 0


def _vary(text: str) -> tuple[str, tuple[float, float] | None]:
    key, equals, value = (part.strip() for part in text.partition("="))
    if not equals:
        return key, None
    low, _, high = value.partition(":")
    try:
        return key, (float(low), float(high))
    except ValueError:
        raise DescriptionError(
            f"--vary {text}: not of the form KEY=LOW:HIGH. Write KEY alone, or one."
        ) from None


def _prior(text: str) -> tuple[str, float]:
    key, _, value = (part.strip() for part in text.partition("~"))
    try:
        return key, float(value.removesuffix("%")) / (100.0 if value.endswith("%") else 1.0)
    except ValueError:
        raise DescriptionError(f"--prior {text}: not of the form KEY~5%. Write one.") from None


def _node(text: str) -> tuple[int, str]:
    number, _, frame = (part.strip() for part in text.partition("="))
    if not number.isdigit() or not frame:
        raise DescriptionError(f"--node {text}: not of the form 3=FRAME. Write one.")
    return int(number), frame
