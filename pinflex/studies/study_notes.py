"""What a comparison says beside its numbers: why a level is missing, what weakens the others."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pinflex.description.solve import SolveSpec
from pinflex.errors import ConvergenceError, PinflexError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result, peak

_BEYOND_YIELD = 1.0


@dataclass
class Outcomes:
    """Runs of the levels so far, and the errors of those that stopped."""

    runs: dict[str, Result] = field(default_factory=dict)
    partial: dict[str, Result] = field(default_factory=dict)
    unsolved: dict[str, PinflexError] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)


def file_name(run: Result, complete: bool = True) -> str:
    """Name of the file of a run: NAME-LEVEL.npz, or NAME-LEVEL-partial.npz."""
    return f"{run.meta['name']}-{run.level}{'' if complete else '-partial'}.npz"


def yield_strengths(mechanism: Mechanism) -> dict[str, float]:
    """Strength [Pa] of the links whose material has one."""
    return {
        name: part.spec.material.yield_strength
        for name, part in mechanism.parts.items()
        if part.spec.material.yield_strength is not None
    }


def falls(record: Outcomes) -> float | None:
    """Last instant at which the quasistatic level found a balance, if it lost it on the way."""
    partial, error = record.partial.get("quasistatic"), record.unsolved.get("quasistatic")
    lost = isinstance(error, ConvergenceError) and "no equilibrium" in str(error)
    return float(partial.t[-1]) if partial is not None and lost and len(partial.t) else None


def reason(error: PinflexError) -> str:
    """Why a run stopped, without what only a Python caller can use."""
    return str(error).replace(" error.result holds the run so far.", "")


def why_missing(record: Outcomes, level: str) -> str:
    """Why a level is missing, and the file that holds what there is of it."""
    partial = record.partial.get(level)
    text = reason(record.unsolved[level])
    if partial is not None:
        text += f" The run up to t = {partial.t[-1]:.4g} s is in {file_name(partial, False)}."
    return text


def notes_of(mechanism: Mechanism, record: Outcomes, frequencies: Sequence[float]) -> list[str]:
    """Sentences that a reader should know before trusting the numbers."""
    notes = _yielding(mechanism, record.runs)
    if min(frequencies, default=0.0) < 0:
        notes.append("a negative frequency is an unstable direction: the static pose buckles.")
    notes += _run_warnings(record.runs)
    for level, run in record.runs.items():
        if run.meta.get("errors"):
            notes += [f"{level}, error of {line}" for line in run.errors.lines()]
    if record.runs and not any(run.meta.get("errors") for run in record.runs.values()):
        notes.append("error bars take some seconds more here: add --errors.")
    return notes


def _yielding(mechanism: Mechanism, runs: Mapping[str, Result]) -> list[str]:
    beyond = {
        name
        for run in runs.values()
        for name, strength in yield_strengths(mechanism).items()
        if name in run.links and peak(run.link(name).von_mises) > _BEYOND_YIELD * strength
    }
    if not beyond:
        return []
    return [
        f"stress beyond the yield strength in {', '.join(sorted(beyond))}: the material would "
        "deform for good, which is not modelled."
    ]


def starting(mechanism: Mechanism, spec: SolveSpec, runs: Mapping[str, Result]) -> list[str]:
    """Sentence on a start that rings, if it does."""
    shaken = [level for level in ("ked", "coupled") if level in runs]
    if spec.start != "straight" or not any(mechanism.description.gravity) or not shaken:
        return []
    return [
        f"{' and '.join(shaken)} start with undeformed links on which gravity acts at once (solve."
        "start: straight), so they ring from t = 0. Add --set solve.start=static to start at rest."
    ]


def remark(mechanism: Mechanism, record: Outcomes, run: Result) -> str:
    """Remark for a reader of the run alone, in a line."""
    said = []
    lost = falls(record)
    if lost is not None and run.level != "quasistatic":
        said.append(f"no equilibrium beyond {lost:.4g} s: it buckles or falls there")
    if starting(mechanism, mechanism.description.solve, {run.level: run}):
        said.append("started straight under gravity")
    return "; ".join(said)


def _run_warnings(runs: Mapping[str, Result]) -> list[str]:
    """Warnings of the runs, each once, with the levels that gave it and the last one's numbers."""
    who: dict[str, list[str]] = {}
    said: dict[str, str] = {}
    for level, run in runs.items():
        for text in run.meta.get("warnings", ()):
            key = re.sub(r"\b\d[\d.e+-]*", "#", text)
            who.setdefault(key, []).append(level)
            said[key] = text
    return [f"{', '.join(levels)}: {said[key]}" for key, levels in who.items()]
