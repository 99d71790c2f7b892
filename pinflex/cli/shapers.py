"""`pinflex shapers`: input shapers for the vibrations that a motion excites."""

from __future__ import annotations

import argparse
from typing import Any

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, working
from pinflex.text import number, paragraph, table

_ROUND_OFF = 1e-12  # of a vibration: a sum of impulses that cancels leaves 6e-17


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "shapers",
        "input shapers for the motion: time they cost, ringing they leave",
        """
Finds the modes (motors locked) into which the motion of the YAML puts energy, and tells for
ZV, ZVD and EI shapers of their frequencies how much longer the motion gets, and which share of the
vibration is left where frequencies are up to 20 % off. `shaper: zvd` in the motion applies one.""",
        "pinflex shapers delta\n  pinflex solve delta --set motion.shaper=zvd",
    )
    p.add_argument("--modes", type=parser.count, default=3, metavar="N",
                   help="how many modes to cancel at most (default 3)")  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Frequencies that ring, and a table of shapers."""
    from pinflex.studies.shapers import ERRORS, shapers

    mechanism = load_model(args)
    with working("finding what rings"):
        found, rows = shapers(mechanism, modes=args.modes)
    data: dict[str, Any] = {
        "name": mechanism.name,
        "modes": [
            {"frequency": float(f), "low": float(a), "high": float(b), "damping": float(z)}
            for f, a, b, z in zip(
                found.frequencies, found.low, found.high, found.damping, strict=True
            )
        ],
        "errors": list(ERRORS),
        "shapers": {
            row.kind: {
                "time": row.time, "residual": row.residual.tolist(), "along": row.along,
                "width": row.width,
            }
            for row in rows
        },
    }  # fmt: skip
    if args.json:
        print_json(data)
    else:
        print(_text(data))
    return 0


def _left(share: float) -> str:
    """Per cent; what is round-off of a sum of impulses is nothing."""
    return f"{100 * share:.2g}" if share > _ROUND_OFF else "0"


def _text(data: dict[str, Any]) -> str:
    modes = [
        [str(k), number(m["frequency"]), f"{m['low']:.4g} to {m['high']:.4g}", number(m["damping"])]
        for k, m in enumerate(data["modes"], 1)
    ]
    shown = [f"{100 * e:+.0f} %" if e else "0" for e in data["errors"]]
    rows = [
        [kind.upper(), number(x["time"]), *(_left(r) for r in x["residual"]),
         _left(x["along"]), f"{100 * x['width']:.0f}"]
        for kind, x in data["shapers"].items()
    ]  # fmt: skip
    heads = "shaper|longer by [s]|" + "|".join(shown) + "|along the motion|width at 5 % [%]"
    blocks = [
        table("Vibrations that the motion excites, motors locked",
              "mode|frequency [Hz]|along the motion [Hz]|damping [-]", modes, (4,)),
        table("Vibration left [%] where the frequency is off by", heads, rows, (6,)),
        paragraph("`shaper: zvd` in the motion of the YAML (or --set motion.shaper=zvd) applies "
                  "one; pinflex command finds a motion that leaves none."),
    ]  # fmt: skip
    return "\n\n".join(blocks) + "\n"
