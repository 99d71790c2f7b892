"""The main job: one scene at several levels against its rigid run, and the files that show it."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pinflex.advice.solve import solve
from pinflex.description.solve import LEVELS, SolveSpec
from pinflex.errors import ConvergenceError, DescriptionError, PinflexError, SceneError, nearest
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.comparison import Comparison, comparison
from pinflex.results.residual import BAND
from pinflex.results.result import Result, peak
from pinflex.solver.solve import Progress, default_motion
from pinflex.studies.check import first_frequencies
from pinflex.text import brief
from pinflex.viewer.curves import with_rigid_torque
from pinflex.writing import write_text

_BEYOND_YIELD = 1.0
_FREQUENCIES = 6
_QUICK = 40  # elastic coordinates up to which error bars cost a fraction of the runs


@dataclass(frozen=True)
class Study:
    """Runs of one scene.

    Attributes:
        mechanism: The scene.
        runs: Complete results by level; "rigid" among them if it could be solved.
        partial: Results up to the last good step, of levels that stopped.
        unsolved: The error that stopped a level.
        table: The comparison.
    """

    __repr__ = brief

    mechanism: Mechanism
    runs: Mapping[str, Result]
    partial: Mapping[str, Result]
    unsolved: Mapping[str, PinflexError]
    table: Comparison

    @property
    def flexible(self) -> dict[str, Result]:
        """Complete flexible runs, least to most faithful."""
        return {level: run for level, run in self.runs.items() if level != "rigid"}


@dataclass
class _Record:
    runs: dict[str, Result] = field(default_factory=dict)
    partial: dict[str, Result] = field(default_factory=dict)
    unsolved: dict[str, PinflexError] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)


def study(
    mechanism: Mechanism,
    levels: Sequence[str] = LEVELS,
    progress: Callable[[str], Progress | None] = lambda level: None,
    keep: Callable[[str, Result, bool], None] = lambda level, run, complete: None,
    band: float = BAND,
    tell: Callable[[str], None] = lambda text: None,
    errors: bool = False,
) -> Study:
    """Solve a scene at several levels and compare; a level that fails does not stop the others.

    Args:
        mechanism: From `load`, with at least one flexible link.
        levels: Levels beside rigid, which is always solved first as the reference.
        progress: Makes the progress callback of a level.
        keep: Called with (level, result, whether it is complete) as soon as a level has ended.
        band: Deviation of the platform that does no harm [m]: it has settled when it stays within.
        tell: Called with the name of each stage that is no level.
        errors: Error bars also of a scene for which they are expensive.

    Returns:
        The study.

    Raises:
        DescriptionError: An unknown level, nothing flexible, or input that no level can take.
    """
    if not mechanism.compliant:
        raise DescriptionError(
            f"{mechanism.name}: nothing is flexible, no link and no joint, so there is nothing to "
            "compare with rigid. Write some under `flexible`, or use `pinflex solve`."
        )
    record = _Record()

    def beside(run: Result) -> Result:  # so that its file alone gives the same page
        rigid, remark = record.runs.get("rigid"), _remark(mechanism, record, run)
        run = run if rigid is None else with_rigid_torque(run, rigid)
        return replace(run, meta={**run.meta, "remark": remark}) if remark else run

    ordered = _ordered(levels)
    for level in ordered:
        began = time.process_time()
        try:
            run = solve(mechanism, level=level, progress=progress(level))
            record.cpu[level] = time.process_time() - began
            if level == ordered[-1] and (errors or mechanism.flexible.n_eta <= _QUICK):
                tell("error bars")
                run = run.with_errors()
            run = beside(run)
        except np.linalg.LinAlgError as error:
            record.unsolved[level] = ConvergenceError(
                f"{mechanism.name}: the equations broke down ({error}). Make the step smaller, or "
                "the links stiffer."
            )
        except PinflexError as error:
            record.unsolved[level] = error
            if isinstance(error, SceneError) and isinstance(error.result, Result):
                record.partial[level] = beside(error.result)
                keep(level, record.partial[level], False)
        else:
            record.runs[level] = run
            keep(level, run, True)
    if not record.runs and all(isinstance(e, DescriptionError) for e in record.unsolved.values()):
        raise next(iter(record.unsolved.values()))
    tell("frequencies")
    return Study(
        mechanism, record.runs, record.partial, record.unsolved, _table(mechanism, record, band)
    )


def write(done: Study, folder: Path, tell: Callable[[str], None] = lambda text: None) -> list[Path]:
    """Write table, figures and animation; returns the files. The runs are written by `keep`.

    `tell` is called with what is done next.
    """
    from pinflex.viewer.plot import save_all
    from pinflex.viewer.view import write_runs_html

    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / "comparison.txt", folder / "comparison.json"]
    write_text(files[0], done.table.text())
    write_text(files[1], done.table.to_json() + "\n")
    rigid, flexible = done.runs.get("rigid"), done.flexible
    if rigid is not None:
        files += save_all(rigid, flexible, folder, done.table.frequencies, tell)
    if flexible:
        tell("writing the page")
        about = done.mechanism.description
        folders: list[str | Path] = [
            *about.package_dirs,
            *([about.path.parent] if about.path else []),
        ]
        shown = {**done.runs, **done.partial}
        levels = {level: shown[level] for level in LEVELS if level in shown}
        files.append(
            write_runs_html(
                levels,
                folder / "animation.html",
                rigid=rigid,
                meshes=folders,
                first=list(flexible)[-1],
            )
        )
    return files


def file_name(run: Result, complete: bool = True) -> str:
    """Name of the file of a run: NAME-LEVEL.npz, or NAME-LEVEL-partial.npz.

    Args:
        run: Of one level.
        complete: Whether it reached its end.
    """
    return f"{run.meta['name']}-{run.level}{'' if complete else '-partial'}.npz"


def yield_strengths(mechanism: Mechanism) -> dict[str, float]:
    """Strength [Pa] of the links whose material has one."""
    return {
        name: part.spec.material.yield_strength
        for name, part in mechanism.parts.items()
        if part.spec.material.yield_strength is not None
    }


def _ordered(levels: Sequence[str]) -> list[str]:
    for level in levels:
        if level not in LEVELS:
            raise DescriptionError(f"levels: {level}: no such level.{nearest(level, LEVELS)}")
    wanted = [level for level in LEVELS if level in levels and level != "rigid"]
    if not wanted:
        raise DescriptionError(
            "levels: rigid alone has nothing to be compared with. Add quasistatic, ked or coupled."
        )
    return ["rigid", *wanted]


def _table(mechanism: Mechanism, record: _Record, band: float) -> Comparison:
    runs = record.runs
    flexible = {level: run for level, run in runs.items() if level != "rigid"}
    try:
        frequencies, note = first_frequencies(mechanism, _FREQUENCIES)
    except (SceneError, np.linalg.LinAlgError) as error:
        frequencies, note = (), f"not found: {error}"
    return comparison(
        runs.get("rigid"),
        flexible,
        frequencies,
        _FREQUENCIES,
        frequency_note=note,
        yield_strengths=yield_strengths(mechanism),
        notes=_notes(mechanism, record, frequencies),
        unsolved={level: _reason(record, level) for level in record.unsolved},
        stop=default_motion(mechanism).duration,
        band=band,
        cpu=record.cpu,
        falls=_falls(record),
        start=" ".join(_starting(mechanism, mechanism.description.solve, runs)),
    )


def _falls(record: _Record) -> float | None:
    """Last instant at which the quasistatic level found a balance, if it lost it on the way."""
    partial, error = record.partial.get("quasistatic"), record.unsolved.get("quasistatic")
    lost = isinstance(error, ConvergenceError) and "no equilibrium" in str(error)
    return float(partial.t[-1]) if partial is not None and lost and len(partial.t) else None


def reason(error: PinflexError) -> str:
    """Why a run stopped, without what only a Python caller can use."""
    return str(error).replace(" error.result holds the run so far.", "")


def _reason(record: _Record, level: str) -> str:
    """Why a level is missing, and the file that holds what there is of it."""
    partial = record.partial.get(level)
    text = reason(record.unsolved[level])
    if partial is not None:
        text += f" The run up to t = {partial.t[-1]:.4g} s is in {file_name(partial, False)}."
    return text


def _notes(mechanism: Mechanism, record: _Record, frequencies: Sequence[float]) -> list[str]:
    notes: list[str] = []
    beyond = {
        name
        for run in record.runs.values()
        for name, strength in yield_strengths(mechanism).items()
        if name in run.links and peak(run.link(name).von_mises) > _BEYOND_YIELD * strength
    }
    if beyond:
        notes.append(
            f"stress beyond the yield strength in {', '.join(sorted(beyond))}: the material would "
            "deform for good, which is not modelled."
        )
    if frequencies and min(frequencies) < 0:
        notes.append("a negative frequency is an unstable direction: the static pose buckles.")
    notes += _run_warnings(record.runs)
    for level, run in record.runs.items():
        if run.meta.get("errors"):
            notes += [f"{level}, error of {line}" for line in run.errors.lines()]
    if record.runs and not any(run.meta.get("errors") for run in record.runs.values()):
        notes.append("error bars take some seconds more here: add --errors.")
    return notes


def _starting(mechanism: Mechanism, spec: SolveSpec, runs: Mapping[str, Result]) -> list[str]:
    shaken = [level for level in ("ked", "coupled") if level in runs]
    if spec.start != "straight" or not any(mechanism.description.gravity) or not shaken:
        return []
    return [
        f"{' and '.join(shaken)} start with undeformed links on which gravity acts at once (solve."
        "start: straight), so they ring from t = 0. Add --set solve.start=static to start at rest."
    ]


def _remark(mechanism: Mechanism, record: _Record, run: Result) -> str:
    """Remark for a reader of the run alone, in a line."""
    said = []
    falls = _falls(record)
    if falls is not None and run.level != "quasistatic":
        said.append(f"no equilibrium beyond {falls:.4g} s: it buckles or falls there")
    if _starting(mechanism, mechanism.description.solve, {run.level: run}):
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
