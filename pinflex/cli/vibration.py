"""`pinflex check`, `advise`, `modes`, `shapers` and `frf`: to be asked before a run."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import pinflex as pf
from pinflex.cli.console import answer, check_files, load_model, working
from pinflex.cli.options import values
from pinflex.description.motions.trajectory import KINDS, most_modes
from pinflex.errors import DescriptionError
from pinflex.progress import Bar
from pinflex.report import Report, Table, table
from pinflex.text import number
from pinflex.writing import write_csv

if TYPE_CHECKING:
    from pinflex.arrays import Array
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.studies.frequency_response import FrequencyResponse

_NO_GROWTH = 1e-9  # of the fastest mode: growth that is round-off
_ROUND_OFF = 1e-12  # of a vibration: a sum of impulses that cancels leaves 6e-17
_SHOWN = 5  # zeros in the table
# Of the fastest natural frequency in the headline: a zero below is round-off (a double one has half
# the digits), and one that is slow beside the vibrations of the links.
_ZERO, _SLOW = 1e-6, 1e-3


def run_check(args: argparse.Namespace) -> int:
    """Say what was understood of a model."""
    mechanism, said = load_model(args), ""
    if args.write_home:
        from pinflex.studies.scenes.home import write_home

        said = f"\nhome written to {write_home(mechanism)}\n"
        mechanism = load_model(args)
    with working("checking"):
        found = pf.check(mechanism, **values(args))
    return answer(args, asdict(found), found.text() + said)


def run_advise(args: argparse.Namespace) -> int:
    """Say what a scene needs."""
    from pinflex.advice.reduced_models import report

    mechanism = load_model(args)
    with Bar("looking") as bar:
        bar.say()
        advice = pf.advise(mechanism, **values(args), progress=bar)
    return answer(args, asdict(advice), report(advice, args.model, args.verbose).text())


def run_modes(args: argparse.Namespace) -> int:
    """Natural frequencies and mode shapes at a pose."""
    from pinflex.levels.modes import base_state, first_modes
    from pinflex.studies.checking.check import is_loaded, require_vibrating
    from pinflex.studies.pose import pose

    mechanism, options = load_model(args), values(args)
    require_vibrating(mechanism)
    # without a load the equilibrium is the undeformed pose, which also exists where motors are free
    if args.spin or args.at is not None:
        return _moving(args, mechanism)
    free, count = options.get("free_motors", False), options.get("count", 12)
    preload = options.get("preload", "gravity") if is_loaded(mechanism) else "none"
    with working("finding the modes"):
        every = pf.modes(mechanism, pose(mechanism, args.pose), **options | {
            "count": mechanism.flexible.nv, "preload": preload,
        })  # fmt: skip
        first = first_modes(every, count)
        page, figure = _modes_files(args, mechanism, first, count, preload)
    where = ", ".join(f"{k} = {v:g}" for k, v in args.pose.items()) or "home"
    base = "" if free else base_state(mechanism)
    state = "free" if free else "locked" + f", base {base}" * bool(base)
    about = "the static equilibrium" if preload == "gravity" else "the undeformed pose"
    head = f"{mechanism.name} at {where}, motors {state}, linearised about {about}"
    data = _modes_data(mechanism.name, first, args.pose) | {"view": page, "map": figure}
    written = "".join(f"\nwrote {path}\n" for path in (page, figure) if path is not None)
    return answer(args, data, f"{head}\n\n{_modes_text(first)}{written}")


def _moving(args: argparse.Namespace, mechanism: Mechanism) -> int:
    """Modes about a motion: with stiffening and gyroscopic terms, and the rate of growth."""
    own = "spin" if args.spin else "at"
    beside = [name for name in ("pose", "view", "map") if getattr(args, name)]
    beside = ["at"] if args.spin and args.at is not None else beside
    if beside:
        raise DescriptionError(f"--{beside[0]}: has no meaning beside --{own}. Give one of them.")
    options = {name: x for name, x in values(args).items() if name != "preload"}
    about = pf.modes(mechanism, at=args.spin or args.at, **options)
    state = "free" if options.get("free_motors") else "as the motion has them"
    head = f"{mechanism.name}, motors {state}, linearised about {about.about}"
    data = _modes_data(mechanism.name, about, args.pose)
    return answer(args, data, f"{head}\n\n{_modes_text(about)}")


def _modes_files(
    args: argparse.Namespace, mechanism: Mechanism, first: pf.Modes, count: int, preload: str
) -> tuple[Path | None, Path | None]:
    """Write page and figure where they are asked for."""
    page = figure = None
    if args.view is not None:
        from pinflex.studies.pose import mode_runs
        from pinflex.viewer.view import write_modes_html

        page = write_modes_html(mode_runs(mechanism, first), args.view)
    if args.map is not None:
        from pinflex.solver.solve import default_motion
        from pinflex.viewer.plots.maps import axes_of_map

        along = default_motion(mechanism)
        options: dict[str, Any] = {"count": min(count, 8), "preload": preload, "stiffness": False}
        figure = Path(args.map)
        axes_of_map(pf.pose_map(mechanism, along=along, **options), path=figure)
    return page, figure


def _modes_data(name: str, modes: pf.Modes, motors: Mapping[str, float]) -> dict[str, Any]:
    rows: list[dict[str, Any]] = [
        {
            "frequency": float(f), "period": 1 / float(f) if f > 0 else None,
            "share": dict(zip(modes.links, map(float, share), strict=True)),
        }
        for f, share in zip(modes.frequencies, modes.share, strict=True)
    ]  # fmt: skip
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


def _modes_text(modes: pf.Modes) -> str:
    from pinflex.levels.modes import rigid_body

    rows = _modes_data("", modes, {})["modes"]
    small = _NO_GROWTH * 2 * math.pi * float(abs(modes.frequencies).max(initial=0.0))
    growth: list[Any] = []
    if modes.growth is not None:
        growth = [("growth [1/s]", lambda x: x["growth"] if abs(x["growth"]) >= small else 0.0)]
    numbered = [{"mode": k, **row} for k, row in enumerate(rows, 1)]
    listed = table(
        "Natural frequencies", numbered, "mode", ("frequency [Hz]", "frequency"),
        ("period [s]", "period"), *growth, ("share of the energy", _who),
        names=(4,), prose=True,
    )  # fmt: skip
    return f"{listed.text()}\n{rigid_body(modes)}\n" if modes.rigid_body else f"{listed.text()}\n"


def _who(mode: Mapping[str, Any]) -> str:
    """Links by their share of the energy, largest first; or why there is no oscillation."""
    share, f = mode["share"], mode["frequency"]
    if f == 0:
        return "free motion, no stiffness"
    ranked = sorted(share.items(), key=lambda item: -item[1])
    parts = [f"{name} {100 * x:.0f} %" for name, x in ranked if x > 0.05][:4]
    rest = 1.0 - sum(x for name, x in ranked if x > 0.05) if len(parts) < 4 else 0.0
    words = ", ".join(parts) + (", others" if rest > 0.05 else "")
    return f"UNSTABLE: grows instead of oscillating; {words}" if f < 0 else words


# Shapers -------------------------------------------------------------------------------------


def run_shapers(args: argparse.Namespace) -> int:
    """Frequencies that ring, and a table of shapers."""
    from pinflex.studies.frequency_response import ERRORS, shapers

    mechanism = load_model(args)
    with working("finding what rings"):
        ringing, rows = shapers(mechanism, modes=args.modes)
    keys = "frequency", "low", "high", "damping", "share"
    columns = (
        ringing.frequencies, ringing.low, ringing.high, ringing.damping, ringing.share
    )  # fmt: skip
    data: dict[str, Any] = {
        "name": mechanism.name,
        "modes": [
            {"mode": int(k), **dict(zip(keys, map(float, mode), strict=True))}
            for k, *mode in zip(ringing.number, *columns, strict=True)
        ],
        "others": ringing.others,
        "errors": list(ERRORS),
        "shapers": {
            row.kind: {
                "time": row.time, "residual": row.residual.tolist(), "along": row.along,
                "width": row.width,
            }
            for row in rows
        },
    }  # fmt: skip
    return answer(args, data, f"{_shapers_report(data, args.modes or 0).text()}\n")


def _left(share: float) -> str:
    """Per cent; what is round-off of a sum of impulses is nothing."""
    return f"{100 * share:.2g}" if share > _ROUND_OFF else "0"


def _shapers_report(data: dict[str, Any], asked: int) -> Report:
    few = "" if len(data["modes"]) >= asked else (
        f" There are no {asked}: the others of the first nine lie within 5 % of those listed, or "
        "nothing excites them."
    )  # fmt: skip
    shapers = [{"shaper": kind.upper(), **row} for kind, row in data["shapers"].items()]
    out = [kind for kind in KINDS if kind not in data["shapers"]]
    names = " and ".join(kind.upper() for kind in out)
    many = f"{names}: at most {most_modes(out[0])} modes. Ask for fewer (--modes)." if out else ""
    errors = [
        (f"{100 * e:+.0f} %" if e else "0", lambda row, k=k: row["residual"][k], _left)
        for k, e in enumerate(data["errors"])
    ]
    return Report(data["name"], (
        table(
            "Vibrations that the motion excites, motors locked", data["modes"], "mode",
            ("frequency [Hz]", "frequency"),
            ("along the motion [Hz]", lambda mode: f"{mode['low']:.4g} to {mode['high']:.4g}"),
            ("damping [-]", "damping"),
            ("left at the platform [%]", "share"), names=(4,),
        ),
        "Left at the platform: of what all modes shake it by after the motion without a shaper, if "
        f"their frequencies are up to 20 % off. Modes not listed: {_left(data['others'])} %.{few}",
        table(
            "Vibration left of the worst mode listed [% of its own] where its frequency is off by",
            shapers, "shaper",
            ("longer by [s]", "time"), *errors, ("along the motion", "along", _left),
            ("width at 5 % [%]", "width", lambda x: f"{x:.0f}"), names=(6,),
        ),
        *([many] if many else []),
        "Not in this table: modes that are not listed, and what grows with the square of the speed "
        "(centrifugal forces, poses that change the modes); `pinflex compare` has both.",
        "`shaper: zvd` in the motion of the YAML (or --set motion.shaper=zvd) applies one; "
        "pinflex command finds a motion that leaves none.",
    ))  # fmt: skip


# Frequency responses -------------------------------------------------------------------------


def run_frf(args: argparse.Namespace) -> int:
    """Frequency response of one input."""
    from pinflex.studies.pose import pose

    mechanism = load_model(args)
    as_csv = str(args.output).lower().endswith(".csv")
    check_files(None if as_csv else args.output, args.output)
    with working("finding the response"):
        study = pf.frequency_response(
            mechanism,
            pose(mechanism, args.pose),
            span=(args.first_frequency, args.last_frequency),
            **values(args),
        )
    written = [] if args.output is None else [_frf_file(study, Path(args.output))]
    return answer(
        args, _frf_data(study), f"{_frf_report(study).text()}\n", written, "-o FILE.png draws it"
    )


def _frf_file(study: FrequencyResponse, path: Path) -> Path:
    if path.suffix.lower() != ".csv":
        from pinflex.studies.frequency_response import figure
        from pinflex.viewer.plots.drawing import save

        return save(figure(study).axes, path)
    names = [name.split(" [")[0] for name in study.outputs]
    header = ["frequency", *(f"{n}.{part}" for n in names for part in ("magnitude", "phase"))]
    H = study.response
    columns = np.stack([np.abs(H), np.rad2deg(np.angle(H))], axis=2).reshape(len(H), -1)
    rows = np.column_stack([study.frequencies, columns])
    return write_csv(path, header, ([f"{x:.12g}" for x in row] for row in rows))


def _frf_data(study: FrequencyResponse) -> dict[str, Any]:
    from pinflex.studies.frequency_response import slowest_right

    slowest = float(study.natural[0]) if len(study.natural) else 0.0

    def half_plane(zeros: Array) -> dict[str, Any]:
        both = [[float(z.real), float(z.imag)] for z in zeros]
        return {"zeros": both, "right_half_plane": slowest_right(zeros, slowest)}

    pairs = zip(study.outputs, study.collocated, study.zeros, strict=True)
    return {
        "name": study.name,
        "input": study.input,
        "natural": study.natural.tolist(),
        "outputs": {
            name: {"collocated": collocated, **half_plane(zeros)}
            for name, collocated, zeros in pairs
        },
        "platform": None if study.platform_zeros is None else half_plane(study.platform_zeros),
        "measured": {
            each.output: {
                "agreement": each.agreement,
                "coherence": None if each.coherence is None else float(np.mean(each.coherence)),
            }
            for each in study.measured
        },
    }


def _frf_report(study: FrequencyResponse) -> Report:
    data, fastest = _frf_data(study), float(max(study.natural[:6], default=1.0))
    rows = [{"output": name.split(" [")[0], **pair} for name, pair in data["outputs"].items()]
    if data["platform"] is not None:
        rows.append({"output": "platform, of all motors", "collocated": False, **data["platform"]})
    sizes = np.array([np.hypot(*z) for row in rows for z in row["zeros"]]) / (2.0 * np.pi)
    slow = np.any((sizes > _ZERO * fastest) & (sizes < _SLOW * fastest))
    modes = ", ".join(number(f) for f in study.natural[:6])
    return Report(f"{study.name}: frequency response", (
        f"{study.name}: response to {study.input}, natural frequencies {modes} Hz",
        _zero_table(rows, _ZERO * fastest),
        f"Zeros below {number(_SLOW * fastest)} Hz are those of joints that are free to move, "
        "other motors among them: weight, and how the sag changes with the pose, hold them, not "
        "the links. `--motors acceleration` prescribes the motors instead." if slow else "",
        *(
            f"measured {name}: agreement {x['agreement']:.4f}"
            + ("" if x["coherence"] is None else f", mean coherence {x['coherence']:.3f}")
            for name, x in data["measured"].items()
        ),
    ))  # fmt: skip


def _zero_table(rows: list[dict[str, Any]], least: float) -> Table:
    """Whether each pair is minimum phase, and its slowest zeros [Hz], signed on the real axis."""

    def phase(row: dict[str, Any]) -> str:
        right = row["right_half_plane"]
        return "yes" if right is None else f"no: from {number(right)} Hz on"

    def slowest(row: dict[str, Any]) -> str:
        sizes = [(re, im, float(np.hypot(re, im)) / (2.0 * np.pi)) for re, im in row["zeros"]]
        words = dict.fromkeys(
            number(f) if im > abs(re) * 1e-9 else f"{'+' if re > 0 else '-'}{number(f)}"
            for re, im, f in sizes
            if im >= 0.0 and f > least
        )
        return ", ".join([*words][:_SHOWN]) + (", ..." if len(words) > _SHOWN else "") or "none"

    return table(
        "Zeros", rows, "output", ("collocated", lambda x: "yes" if x["collocated"] else "no"),
        ("minimum phase", phase), ("zeros [Hz]", slowest), names=(24, 10, 24), prose=True,
    )  # fmt: skip
