"""`pinflex modes`: natural frequencies and mode shapes."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from pinflex.cli.console import load_model, print_json
from pinflex.errors import DescriptionError
from pinflex.levels.modes import modes
from pinflex.studies.check import is_loaded
from pinflex.studies.mode_shapes import first_modes, mode_runs, rigid_body
from pinflex.studies.pose import pose
from pinflex.text import number, table


def run(args: argparse.Namespace) -> int:
    """Natural frequencies and mode shapes at a pose."""
    mechanism = load_model(args)
    if not mechanism.flexible.n_eta and not len(mechanism.flexible.springs.v_at):
        raise DescriptionError(
            f"{mechanism.name}: no flexible link and no spring, so nothing vibrates. Write some "
            "under `flexible`."
        )
    motors = dict(args.pose or {})
    # without a load the equilibrium is the undeformed pose, which also exists where motors are free
    preload = args.preload if is_loaded(mechanism) else "none"
    found = first_modes(
        modes(
            mechanism,
            pose(mechanism, motors),
            count=mechanism.flexible.nv,
            preload=preload,
            free_motors=args.free_motors,
        ),
        args.count,
    )
    page = figure = None
    if args.view is not None:
        from pinflex.viewer.view import write_modes_html

        page = write_modes_html(mode_runs(mechanism, found), args.view)
    if args.map is not None:
        from pinflex.studies.frequency_map import frequency_map, save_frequency_map

        along = frequency_map(mechanism, count=min(args.count, 8), preload=preload)
        figure = save_frequency_map(along, args.map)
    shares = [dict(zip(found.links, map(float, row), strict=True)) for row in found.share]
    if args.json:
        print_json(
            {
                "name": mechanism.name,
                "preload": found.preload,
                "free_motors": found.free_motors,
                "rigid_body_modes": found.rigid_body,
                "pose": motors,
                "modes": [
                    {"frequency": f, "period": 1 / f if f > 0 else None, "share": share}
                    for f, share in zip(map(float, found.frequencies), shares, strict=True)
                ],
                "view": page,
                "map": figure,
            }
        )
        return 0
    where = ", ".join(f"{k} = {v:g}" for k, v in motors.items()) or "home"
    state = "free" if args.free_motors else "locked"
    about = "the static equilibrium" if preload == "gravity" else "the undeformed pose"
    print(f"{mechanism.name} at {where}, motors {state}, linearised about {about}\n")
    rows = [
        [str(i), number(f), _period(f), _who(share, f)]
        for i, (f, share) in enumerate(zip(map(float, found.frequencies), shares, strict=True), 1)
    ]
    header = "mode|frequency [Hz]|period [s]|share of the elastic energy"
    print(table("Natural frequencies", header, rows, (4,), last_is_text=True))
    if found.rigid_body:
        print(rigid_body(found))
    files = [f"wrote {path}" for path in (page, figure) if path is not None]
    if files:
        print("\n" + "\n".join(files))
    return 0


def _period(f: float) -> str:
    return number(1 / f) if f > 0 else "-"


def _who(share: Mapping[str, float], f: float) -> str:
    """Which links bend, largest first; what has no frequency is named."""
    if f == 0:
        return "free motion, no stiffness"
    ranked = sorted(share.items(), key=lambda item: -item[1])
    parts = [f"{name} {100 * x:.0f} %" for name, x in ranked if x > 0.05][:4]
    rest = 1.0 - sum(x for name, x in ranked if x > 0.05) if len(parts) < 4 else 0.0
    words = ", ".join(parts) + (", others" if rest > 0.05 else "")
    return f"UNSTABLE: grows instead of oscillating; {words}" if f < 0 else words
