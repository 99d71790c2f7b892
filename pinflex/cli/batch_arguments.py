"""The arguments of `pinflex sweep` and `pinflex map`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

Command = Callable[..., argparse.ArgumentParser]


def add(command: Command, count: Callable[[str], int]) -> None:
    """Add both commands.

    Args:
        command: Makes the parser of a command from its name, summary, text and example.
        count: Reads a whole number above zero.
    """
    p = command(
        "sweep",
        "many cases of a scene in one table",
        """
Solves the scene for every combination of the values given. Values are a:b:n (n from a to b),
a:b:n:log (by equal factors) or v,w,... A case that fails gets a row that says why. Each case is
kept as it ends, in FILE.journal: stopped or killed, the same command goes on from there.""",
        "pinflex sweep ur5 --set flexible.*.section.wall=2e-3:5e-3:7 \\\n"
        "      --set motion.duration=0.4,0.6 --level quasistatic --out sweep.csv",
        model=False,
    )
    p.add_argument("model", metavar="MODEL", help="YAML file, its folder, or a shipped name")
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUES",
        help="values of a key of the YAML, which may have globs; may be repeated",
    )
    p.add_argument(
        "--zip", action="store_true", help="pair the values instead of combining them all"
    )
    p.add_argument("--level", help="rigid, quasistatic, ked or coupled (default: the YAML's)")
    p.add_argument(
        "--outputs",
        metavar="A,B,...",
        help="torque, deviation, stress, frequency, cost, validity (default all)",
    )
    _shared(p, count)

    p = command(
        "map",
        "natural frequencies and platform stiffness over a grid of poses",
        """
Grids are displacements from home: of the platform's x, y, z [m], rz, ry, rx [rad], or of motors.
Coordinates that are not named stay as at home. A frequency's column follows one mode shape from
pose to pose. The 6x6 stiffness is that of the platform in world axes, motors
locked: K_xx (others held) and 1/C_xx (others free); rigid where nothing gives way.""",
        "pinflex map 3rrr --grid x=-.05:.05:9 --grid y=-.05:.05:9 --out map.csv --plot map.png",
    )
    p.add_argument(
        "--grid",
        action="append",
        default=[],
        metavar="COORDINATE=A:B:N",
        help="values of a coordinate; may be repeated",
    )
    p.add_argument("--count", type=count, default=6, metavar="N", help="frequencies (default 6)")
    preload(p)
    p.add_argument("--free-motors", action="store_true", help="frequencies with free motors")
    p.add_argument("--plot", metavar="FILE.png", help="write a figure (.png, .pdf, .svg)")
    _shared(p, count)


def preload(p: argparse.ArgumentParser) -> None:
    """Add --preload, of all that linearises."""
    p.add_argument(
        "--preload",
        choices=("gravity", "none"),
        default="gravity",
        help="gravity: about the static equilibrium; none: about the undeformed pose",
    )


def _shared(p: argparse.ArgumentParser, count: Callable[[str], int]) -> None:
    p.add_argument(
        "-o", "--out", "--output", metavar="FILE", help="write the table, .csv or .parquet"
    )
    p.add_argument("--jobs", type=count, metavar="N", help="processes (default: one per core)")
    p.add_argument("--scheduler", metavar="ADDRESS", help="work on this Dask cluster instead")
    p.add_argument("--fresh", action="store_true", help="forget FILE.journal and begin anew")
