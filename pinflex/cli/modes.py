"""`pinflex modes`: natural frequencies and mode shapes."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, working
from pinflex.errors import DescriptionError
from pinflex.text import number, table

_STILL = 1e-9  # of the fastest mode: growth that is round-off

if TYPE_CHECKING:
    from pinflex.levels.modes import Modes
    from pinflex.mechanics.mechanism import Mechanism


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "modes",
        "natural frequencies and mode shapes at a pose",
        """
Linearises about the static equilibrium under gravity with the motors locked, unless told
otherwise.""",
        "pinflex modes 3rrs --preload none\n"
        "  pinflex modes 3rrr --pose motor_1=1.7,motor_2=3.5 --view modes.html",
    )
    p.add_argument(
        "--count", type=parser.count, default=12, metavar="N", help="how many (default 12)"
    )
    parser.preload(p)
    p.add_argument("--free-motors", action="store_true", help="let the motors swing")
    parser.pose_option(p)
    p.add_argument(
        "--spin",
        type=parser.pose,
        default={},
        metavar="MOTOR=SPEED,...",
        help="about a steady motion from home: speeds of motors in rad/s or m/s, the others rest",
    )
    p.add_argument(
        "--at",
        type=parser.number,
        metavar="TIME",
        help="about the motion of the YAML at a time in s, as if it stayed as it is then",
    )
    p.add_argument("--view", metavar="FILE.html", help="write the shapes as a page for a browser")
    p.add_argument(
        "--map",
        metavar="FILE.png",
        help="write a figure of the frequencies along the motion (.png, .pdf, .svg)",
    )


def run(args: argparse.Namespace) -> int:
    """Natural frequencies and mode shapes at a pose."""
    from pinflex.levels.modes import base_state, first_modes, modes
    from pinflex.studies.checking.check import is_loaded, require_vibrating
    from pinflex.studies.pose import pose

    mechanism = load_model(args)
    require_vibrating(mechanism)
    # without a load the equilibrium is the undeformed pose, which also exists where motors are free
    if args.spin or args.at is not None:
        return _moving(args, mechanism)
    preload = args.preload if is_loaded(mechanism) else "none"
    with working("finding the modes"):
        every = modes(
            mechanism,
            pose(mechanism, args.pose),
            count=mechanism.flexible.nv,
            preload=preload,
            free_motors=args.free_motors,
        )
        first = first_modes(every, args.count)
        page, figure = _write(args, mechanism, first, preload)
    if args.json:
        print_json(_json(mechanism.name, first, args.pose) | {"view": page, "map": figure})
        return 0
    where = ", ".join(f"{k} = {v:g}" for k, v in args.pose.items()) or "home"
    base = "" if args.free_motors else base_state(mechanism)
    state = "free" if args.free_motors else "locked" + f", base {base}" * bool(base)
    about = "the static equilibrium" if preload == "gravity" else "the undeformed pose"
    print(f"{mechanism.name} at {where}, motors {state}, linearised about {about}\n")
    print(_text(first))
    if page or figure:
        print("".join(f"\nwrote {path}" for path in (page, figure) if path is not None))
    return 0


def _moving(args: argparse.Namespace, mechanism: Mechanism) -> int:
    """Modes about a motion: with stiffening and gyroscopic terms, and the rate of growth."""
    from pinflex.levels.modes import modes

    own = "spin" if args.spin else "at"
    beside = [name for name in ("pose", "view", "map") if getattr(args, name)]
    beside = ["at"] if args.spin and args.at is not None else beside
    if beside:
        raise DescriptionError(f"--{beside[0]}: has no meaning beside --{own}. Give one of them.")
    at = args.spin or args.at
    found = modes(mechanism, at=at, count=args.count, free_motors=args.free_motors)
    if args.json:
        print_json(_json(mechanism.name, found, args.pose))
        return 0
    state = "free" if args.free_motors else "as the motion has them"
    print(f"{mechanism.name}, motors {state}, linearised about {found.about}\n")
    print(_text(found))
    return 0


def _write(
    args: argparse.Namespace, mechanism: Mechanism, first: Modes, preload: str
) -> tuple[Path | None, Path | None]:
    """Write page and figure where they are asked for."""
    page = figure = None
    if args.view is not None:
        from pinflex.studies.mode_shapes import mode_runs
        from pinflex.viewer.view import write_modes_html

        page = write_modes_html(mode_runs(mechanism, first), args.view)
    if args.map is not None:
        from pinflex.solver.solve import default_motion
        from pinflex.studies.pose_map import pose_map
        from pinflex.viewer.plots.maps import save_map

        along, count = default_motion(mechanism), min(args.count, 8)
        poses = pose_map(mechanism, along=along, count=count, preload=preload, stiffness=False)
        figure = save_map(poses, args.map)
    return page, figure


def _shares(modes: Modes) -> list[tuple[float, dict[str, float]]]:
    """Frequency [Hz] and share of the elastic energy by link, of every mode."""
    return [
        (float(f), dict(zip(modes.links, map(float, row), strict=True)))
        for f, row in zip(modes.frequencies, modes.share, strict=True)
    ]


def _json(name: str, modes: Modes, motors: Mapping[str, float]) -> dict[str, object]:
    rows: list[dict[str, object]] = [
        {"frequency": f, "period": 1 / f if f > 0 else None, "share": share}
        for f, share in _shares(modes)
    ]
    for row, rate in zip(rows, () if modes.growth is None else modes.growth, strict=False):
        row["growth"] = float(rate)
    return {
        "name": name,
        "preload": modes.preload,
        "free_motors": modes.free_motors,
        "rigid_body_modes": modes.rigid_body,
        "pose": motors,
        **({"about": modes.about} if modes.about else {}),
        "modes": rows,
    }


def _text(modes: Modes) -> str:
    from pinflex.levels.modes import rigid_body

    rows = [
        [str(i), number(f), number(1 / f if f > 0 else None), _who(share, f)]
        for i, (f, share) in enumerate(_shares(modes), 1)
    ]
    header = "mode|frequency [Hz]|period [s]|share of the elastic energy"
    if modes.growth is not None:
        fastest = 2 * math.pi * float(abs(modes.frequencies).max(initial=0.0))
        header = header.replace("|share", "|growth [1/s]|share")
        for row, rate in zip(rows, modes.growth, strict=True):
            row.insert(3, number(0.0 if abs(rate) < _STILL * fastest else float(rate)))
    text = table("Natural frequencies", header, rows, (4,), last_is_text=True)
    return f"{text}\n{rigid_body(modes)}" if modes.rigid_body else text


def _who(share: Mapping[str, float], f: float) -> str:
    """Links by their share of the elastic energy, largest first; or a name for no frequency."""
    if f == 0:
        return "free motion, no stiffness"
    ranked = sorted(share.items(), key=lambda item: -item[1])
    parts = [f"{name} {100 * x:.0f} %" for name, x in ranked if x > 0.05][:4]
    rest = 1.0 - sum(x for name, x in ranked if x > 0.05) if len(parts) < 4 else 0.0
    words = ", ".join(parts) + (", others" if rest > 0.05 else "")
    return f"UNSTABLE: grows instead of oscillating; {words}" if f < 0 else words
