"""The report of `python -m tests.benchmarks.race`: Markdown, and numbers for machines."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version

from pinflex.kernel.library import kernel
from tests.benchmarks.race.contest import REPEATS, Outcome
from tests.benchmarks.race.scenes import Race

_ABOUT = f"""\
# The race scenes: time to reach an error

Written by `python -m tests.benchmarks.race --report FILE`.
Error of an output: max_t |x - ref| / max_t |ref| at 401 samples.
Time is that of the solver call alone: for pinflex the march with its set-up, but neither
loading nor recovery; for the peer, Exudyn, its solver. One thread; the best of {REPEATS}
fresh processes, the two sides in turn; in a process of pinflex the second call (the first, with the
imports it needs, is the column `first`). CPU seconds are what is compared: wall time on a busy
machine says who else was there.

`tol` is `solve(..., tol=)` with the largest tol that meets the error; `radau` and `alpha` are
tuned by hand, as the peer is, by one rule for all: from coarse to fine, a setting counts if it and
the next finer one meet the error. `in the kernel` is the least share of CPU time that a process
spent in compiled code of pinflex.
The peer's refined run against the reference says how far both models are the same physics;
where that is above the error asked for, 1.2 times it is the limit.

A user waits for more than the march: the second table has whole processes (imports, model, run by
tol, torques) of both sides, and what load, solve and every output take once all is imported.
"""


def _versions() -> str:
    found = []
    for name in ("pinflex", "pin", "numpy", "scipy", "exudyn"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} {'(checkout)' if name == 'pinflex' else 'absent'}")
    return ", ".join(found)


def machine() -> dict[str, object]:
    """Where and beside what it was measured."""
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": _versions(),
        "load": os.getloadavg(),
        "kernel": kernel().said,
    }


def write_report(outcomes: Sequence[Outcome]) -> str:
    """The whole report."""
    here = machine()
    load = ", ".join(f"{x:.2f}" for x in os.getloadavg())
    blocks = [
        _ABOUT,
        f"{here['processor']}, {here['cores']} cores, Python {here['python']}; {here['versions']}; "
        f"kernel: {here['kernel']}. "
        f"Load average at the end (1, 5, 15 min): {load}.\n",
        _summary(outcomes),
        _around(outcomes),
        *(_scene(o) for o in outcomes),
    ]
    return "\n".join(blocks)


def _summary(outcomes: Sequence[Outcome]) -> str:
    rows = ["| scene | tuned by hand | by tol | tol / tuned | aim: tuned, tol |", "|---" * 5 + "|"]
    for o in outcomes:
        hand = "radau", "alpha"
        ratios = [o.ratio(hand), o.ratio(("tol",)), o.ratio(hand, "tol")]
        aim = ", ".join(
            f"{aimed:g} {'reached' if found[0] >= aimed else 'not reached'}"
            for aimed, found in zip(o.race.target, ratios, strict=False)
        )
        cells = [_ratio(ratio) for ratio in ratios]
        rows.append(
            f"| {o.race.key} | {' | '.join(cells)} | {aim if 'peer' in o.entries else '-'} |"
        )
    said = "CPU time of the peer over pinflex, and of pinflex by tol over pinflex tuned by hand: "
    return (
        f"{said}of the best processes (least to largest of {REPEATS} in turn).\n\n"
        + "\n".join(rows)
        + "\n"
    )


def _around(outcomes: Sequence[Outcome]) -> str:
    """Whole processes of both sides, and the parts of a warm one of pinflex."""
    rows = [
        "| scene | process, Exudyn | process, pinflex by tol | ratio | warm: load | solve | "
        "every output |",
        "|---" * 7 + "|",
    ]
    for o in outcomes:
        ours, peer = (o.entries[key].around if key in o.entries else {} for key in ("tol", "peer"))
        theirs, own = (x.get("process", float("nan")) for x in (peer, ours))
        parts = [f"{ours[key]:.3f}" if key in ours else "-" for key in ("load", "solve", "every")]
        cells = [f"{theirs:.2f}", f"{own:.2f}", f"{theirs / own:.2f}", *parts]
        rows.append(f"| {o.race.key} | {' | '.join(cells)} |")
    return f"CPU seconds, the least of {REPEATS}.\n\n" + "\n".join(rows) + "\n"


def _ratio(found: tuple[float, float, float]) -> str:
    best, least, most = found
    return "-" if best != best else f"{best:.3g} ({least:.3g} to {most:.3g})"


def _scene(o: Outcome) -> str:
    limits = ", ".join(f"{name} {limit:.2g}" for name, limit in o.limits.items())
    asked = ", ".join(f"{name} {limit:.2g}" for name, limit in o.race.limits.items())
    above = "" if o.limits == o.race.limits else f" (asked for: {asked}; the floor is higher)"
    lines = [
        f"## {o.race.key}: {o.race.about}",
        *_always(o.race),
        "",
        f"Error to reach: {limits}{above}.",
    ]
    lines += ["", "The reference against other methods and models:", ""]
    checks = dict(o.checks) | ({"the refined peer": o.peer_floor} if o.peer_floor else {})
    lines += [f"- {name}: {_errors(found)}" for name, found in checks.items()]
    lines += [
        "",
        "| | setting | errors | CPU s | wall s | first, CPU s | in the kernel |",
        "|---|---|---|---|---|---|---|",
    ]
    for key, e in o.entries.items():
        first = "-" if e.first != e.first else f"{e.first:.3f}"
        share = f"{e.kernel:.0%}" if e.kernel > 0.0 else "-"
        times = [f"{e.cpu:.4f}", f"{e.wall:.4f}", first, share]
        cells = [key, e.label, _errors(e.errors), *times]
        lines.append(f"| {' | '.join(cells)} |")
    missing = [key for key in ("tol", "radau", "alpha") if key not in o.entries]
    if missing:
        lines += ["", f"Not reached by {', '.join(missing)} within the settings tried."]
    goal = min(o.race.limits.values())
    model = " ".join(o.race.models[-1]) or "the model as shipped"
    lines += ["", f"`tol={goal:g}` as asked, on {model}: {_errors(o.at_tol)}."]
    return "\n".join(lines) + "\n"


def _always(race: Race) -> list[str]:
    overrides = ", ".join(f"`{change}`" for change in race.always)
    return ["", f"The shipped `{race.model}` with {overrides}."] if overrides else []


def _errors(found: dict[str, float]) -> str:
    return ", ".join(f"{name} {error:.1e}" for name, error in found.items())


def as_json(outcomes: Sequence[Outcome]) -> dict[str, object]:
    """The same in numbers."""
    scenes = {
        o.race.key: {
            "limits": o.limits, "reference": o.checks, "peer_floor": o.peer_floor,
            "target": o.race.target, "ratio": o.ratio(("radau", "alpha")),
            "ratio_tol": o.ratio(("tol",)), "at_tol": o.at_tol,
            "entries": {key: asdict(e) for key, e in o.entries.items()},
        }
        for o in outcomes
    }  # fmt: skip
    return {"machine": machine(), "scenes": scenes}
