"""The main job: one scene at several levels against its rigid run, and the files that show it."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import LEVELS, SolveSpec
from pinflex.errors import (
    ConvergenceError,
    DescriptionError,
    PinflexError,
    SceneError,
    nearest,
    reason,
)
from pinflex.integrators.march import MOST
from pinflex.levels.modes import default_step
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.progress import Callback, Progress, Stages
from pinflex.results import archive
from pinflex.results.comparison import Comparison, comparison
from pinflex.results.lazy import Late
from pinflex.results.result import Result, peak
from pinflex.results.verdict import BAND, TOL
from pinflex.solver.solve import default_motion
from pinflex.studies.checking.check import first_frequencies
from pinflex.studies.checking.doubts import beyond_on_the_way, slips
from pinflex.studies.outputs import yield_strengths
from pinflex.text import frozen, number
from pinflex.viewer.curves import with_rigid_torque
from pinflex.writing import write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Steps of level coupled where the scene names none: by a tolerance, unless that is too expensive.
#
# A comparison should be true to the digits that it shows. A tolerance ensures that, mostly at less
# cost than equal steps of unknown error; where something undamped rings all the time it can cost
# far more.

OPEN_TOL = 1e-3  # a tenth of it is reached mostly, and a table shows three digits


class _TooDear(Exception):
    """Collocation needs more steps than equal steps would be."""


def steps_are_open(mechanism: Mechanism) -> bool:
    """Whether a scene leaves the steps of level coupled open, and collocation serves it.

    Collocation then takes half the time of equal steps, at a twentieth of their error or less.
    """
    spec, controlled = mechanism.description.solve, mechanism.description.control is not None
    said = (spec.dt, spec.tol, spec.integrator, spec.rho_inf, spec.newmark)
    sticks = mechanism.flexible.sticks(spec.drive == "prescribed")
    return not (controlled or sticks) and all(x is None for x in said)


def solved(
    mechanism: Mechanism, motion: Motion | None, level: str, progress: Callback | None
) -> Result:
    """The run of a level; coupled within a tolerance where that is open and can be reached."""
    if level == "coupled" and steps_are_open(mechanism):
        with suppress(ConvergenceError, _TooDear):
            within = _limited(mechanism, motion, progress)
            return solve(mechanism, motion, level=level, tol=OPEN_TOL, progress=within)
    return solve(mechanism, motion, level=level, progress=progress)


def _limited(mechanism: Mechanism, motion: Motion | None, progress: Callback | None) -> Callback:
    """A progress that ends a run once it has taken more steps than equal steps would."""
    end = mechanism.description.solve.until or (motion or default_motion(mechanism)).duration
    left = int(end / default_step(mechanism, end)) // MOST  # steps of one report, at the most

    def report(done: int, of: int) -> None:
        nonlocal left
        left -= 1
        if left < 0 and done < of:
            raise _TooDear
        if progress is not None:
            progress(done, of)

    return report


# What a comparison says beside its numbers: why a level is missing, what weakens the others.

Say = Callable[[str], Callback | None]  # from what comes next to its progress
_RESTS = 1e-6  # of the largest speed of a motor: at the end it stands


@dataclass
class Outcomes:
    """Runs of the levels so far, and the errors of those that stopped.

    Attributes:
        files: Of the runs. drawn: The runs as these files have them, by level.
    """

    runs: dict[str, Result] = field(default_factory=dict)
    partial: dict[str, Result] = field(default_factory=dict)
    unsolved: dict[str, PinflexError] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)
    drawn: dict[str, Result] = field(default_factory=dict)

    def keep(self, run: Result, complete: bool, folder: Path | None, say: Say) -> None:
        """Write a run to its file, if there is a folder for it."""
        if folder is None:
            return
        say(f"saving {run.level}")
        self.files.append(folder / file_name(run, complete))
        read: dict[str, Array] = {}
        members = archive.contents(run.t, run.arrays, run.meta, compact=True, read=read)
        archive.write(self.files[-1], members)
        self.drawn[run.level] = Result(run.t, Late(read, {}), Late(archive.meta_of(members), {}))
        # what an earlier comparison left of this level would contradict the table
        (folder / file_name(run, not complete)).unlink(missing_ok=True)


def file_name(run: Result, complete: bool = True) -> str:
    """Name of the file of a run: NAME-LEVEL.npz, or NAME-LEVEL-partial.npz."""
    return f"{run.meta['name']}-{run.level}{'' if complete else '-partial'}.npz"


def falls(record: Outcomes) -> float | None:
    """Last instant at which the quasistatic level found a balance, if it lost it on the way."""
    partial, error = record.partial.get("quasistatic"), record.unsolved.get("quasistatic")
    lost = isinstance(error, ConvergenceError) and "no equilibrium" in str(error)
    return float(partial.t[-1]) if partial is not None and lost and len(partial.t) else None


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
    notes += [*slips(mechanism), *_beyond_limits(mechanism, record.runs)]
    notes += _run_warnings(record.runs) + ending(record.runs)
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
        if name in run.links and peak(run.link(name).von_mises) > strength
    }
    if not beyond:
        return []
    return [
        f"stress beyond the yield strength in {', '.join(sorted(beyond))}: the material would "
        "deform for good, which is not modelled."
    ]


def _beyond_limits(mechanism: Mechanism, runs: Mapping[str, Result]) -> list[str]:
    """Limits of the URDF that the run of the level that leaves out least goes beyond."""
    if not runs:
        return []
    level, run = [*runs.items()][-1]
    at, turning = (
        {m: getattr(run.joint(m), key) for m in run.motors} for key in ("position", "velocity")
    )
    torque = dict(zip(run.motors, run.torque.T, strict=True))
    found = beyond_on_the_way(mechanism.description, at, turning, torque)
    return [f"{level}: {text}" for text in found]


def starting(mechanism: Mechanism, spec: SolveSpec, runs: Mapping[str, Result]) -> list[str]:
    """Sentence on a start that rings, if it does."""
    shaken = [level for level in ("ked", "coupled") if level in runs]
    if spec.start != "straight" or not any(mechanism.description.gravity) or not shaken:
        return []
    return [
        f"{' and '.join(shaken)} start with undeformed links on which gravity acts at once (solve."
        "start: straight), so they ring from t = 0. Add --set solve.start=static to start at rest."
    ]


def ending(runs: Mapping[str, Result]) -> list[str]:
    """Sentence on runs that end as the motion stops, just before shaking would be seen."""
    run, shaken = runs.get("rigid"), [level for level in ("ked", "coupled") if level in runs]
    if run is None or not shaken or not run.motors:
        return []
    speed = np.max([np.abs(run.joint(name).velocity) for name in run.motors], axis=0)
    if speed[-1] > _RESTS * speed.max() or speed[-2] <= _RESTS * speed.max():
        return []
    return [
        f"the runs end as the motion stops: --set solve.until={number(2 * float(run.t[-1]))} also "
        "shows how the robot comes to rest."
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


_FREQUENCIES = 6
_QUICK = 40  # elastic coordinates up to which error bars cost a fraction of the runs


@frozen
class Study:
    """Runs of one scene.

    Attributes:
        mechanism: The scene.
        runs: Complete results by level; "rigid" among them if it could be solved.
        partial: Results up to the last good step, of levels that stopped.
        unsolved: The error that stopped a level.
        table: The comparison.
        files: What was written.
    """

    mechanism: Mechanism
    runs: Mapping[str, Result]
    partial: Mapping[str, Result]
    unsolved: Mapping[str, PinflexError]
    table: Comparison
    files: tuple[Path, ...] = ()

    def __getitem__(self, level: str) -> Result:
        """The run of a level."""
        if level not in self.runs:
            raise DescriptionError(f"study: {level}: no such run.{nearest(level, self.runs)}")
        return self.runs[level]

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.runs)

    def __str__(self) -> str:
        return self.table.brief()

    def _repr_html_(self) -> str:
        return self.table._repr_html_()

    @property
    def figures(self) -> dict[str, Callable[[], Figure]]:
        """Functions that draw each figure, by name: torques, deviation_coupled, ..."""
        from pinflex.viewer.plots.axes import figures_of

        rigid = self.runs.get("rigid")
        return {} if rigid is None else figures_of(rigid, self.flexible, self.table.frequencies)

    def plot(self, name: str = "torques", ax: Axes | None = None) -> Any:
        """Draw one of the figures; returns the matplotlib axes.

        Args:
            name: Of `figures`, or how it begins: torques, deviation, stress, spectrum.
            ax: Where to draw the spectrum, whose figure is of one panel; default: a new figure.
        """
        from pinflex.viewer.plots.drawing import Drawing

        known = self.figures
        found = next((key for key in known if key.startswith(name)), None)
        if found is None:
            raise DescriptionError(f"plot: {name}: no such figure.{nearest(name, known)}")
        one: Any = known[found]  # its function takes `ax` where it has one panel
        panels = {name: lambda on: one(ax=on)} if found.startswith("spectrum") else {}
        return Drawing(one, panels).axes(None, ax)

    @property
    def flexible(self) -> dict[str, Result]:
        """Complete flexible runs, least to most faithful."""
        return {level: run for level, run in self.runs.items() if level != "rigid"}


@public
@takes_model
def compare(
    mechanism: Mechanism,
    motion: Motion | None = None,
    levels: Sequence[str] = LEVELS,
    *,
    band: float = BAND,
    tol: float = TOL,
    errors: bool = False,
    folder: str | Path | None = None,
    progress: Progress | Stages = None,
) -> Study:
    """Solve a scene rigid and flexible, and say what shakes, how much, and which level suffices.

        done = pf.compare(robot, progress=True)
        print(done)                 # the answer on one screen; done.table.text() is all of it
        done["coupled"].torque      # the runs, by level
        done.plot("deviation")      # its figures

    Level coupled is solved to `tol` 1e-3 where the scene names no step, tolerance or integrator,
    unless that takes more steps than equal ones would.

    Args:
        mechanism: From `load`, with at least one flexible link.
        motion: Default: the motion of the YAML.
        levels: Levels beside rigid, which is always solved first as the reference; one that fails
            does not stop the others.
        band: Deviation of the platform that does no harm [m]: settling time, verdict.
        tol: Share of torques and deviations by which a level that suffices may differ.
        errors: Error bars also of large models (some seconds).
        folder: Write runs (compact, see `Result.save`), tables, figures and the page there.
        progress: True: a bar for each stage; or a function called with (step, steps).
    Returns:
        Runs, table and figures.
    Raises:
        DescriptionError: An unknown level, nothing flexible, or input that no level can take.
    """
    if not mechanism.compliant:
        raise DescriptionError(
            f"{mechanism.name}: nothing is flexible, no link and no joint, so there is nothing to "
            "compare with rigid. Write some under `flexible`, or use `pinflex solve`."
        )
    ordered, into = _ordered(levels), None if folder is None else Path(folder)
    stages = progress if isinstance(progress, Stages) else Stages() if progress is True else None
    steps = None if isinstance(progress, Stages | bool) else progress
    say: Say = (lambda text: steps) if stages is None else stages
    try:
        record = _solved_levels(mechanism, motion, ordered, errors, into, say)
        say("frequencies")
        end = (motion or default_motion(mechanism)).duration
        table = _table(mechanism, record, band, end, tol)
        done = Study(mechanism, record.runs, record.partial, record.unsolved, table)
        return done if into is None else replace(done, files=_written(done, record, into, say))
    finally:
        if stages is not None:
            stages.close()


def _solved_levels(
    mechanism: Mechanism,
    motion: Motion | None,
    levels: Sequence[str],
    errors: bool,
    folder: Path | None,
    say: Say,
) -> Outcomes:
    """Runs of the levels, each kept in the folder as it ends; one that fails stops no other."""
    record = Outcomes()

    def beside(run: Result) -> Result:  # so that its file alone gives the same page
        rigid, said = record.runs.get("rigid"), remark(mechanism, record, run)
        run = run if rigid is None else with_rigid_torque(run, rigid)
        return replace(run, meta={**run.meta, "remark": said}) if said else run

    for level in levels:
        began = time.process_time()
        try:
            run = solved(mechanism, motion, level, say(level))
            record.cpu[level] = time.process_time() - began
            if level == levels[-1] and (errors or mechanism.flexible.n_eta <= _QUICK):
                say("error bars")
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
                record.keep(record.partial[level], False, folder, say)
        else:
            record.runs[level] = run
            record.keep(run, True, folder, say)
    if not record.runs and all(isinstance(e, DescriptionError) for e in record.unsolved.values()):
        raise next(iter(record.unsolved.values()))
    return record


def _written(done: Study, record: Outcomes, folder: Path, say: Say) -> tuple[Path, ...]:
    """Table, figures and page beside the runs; all files.

    The page is drawn from what the files of its runs hold: they alone give the same page.
    """
    from pinflex.viewer.plots.drawing import save
    from pinflex.viewer.view import write_html

    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / "comparison.txt", folder / "comparison.json"]
    write_text(files[0], done.table.text())
    write_text(files[1], done.table.to_json() + "\n")
    figures = done.figures
    for k, (name, figure) in enumerate(figures.items(), 1):
        say(f"drawing {k} of {len(figures)}")
        files.append(save(figure().axes, folder / f"{name}.png"))
    if done.flexible:
        say("writing the page")
        about = done.mechanism.description
        page = write_html(
            {level: record.drawn[level] for level in LEVELS if level in record.drawn},
            folder / "animation.html",
            rigid=record.drawn["rigid"] if "rigid" in done.runs else None,
            meshes=[*about.package_dirs, *([about.path.parent] if about.path else [])],
            first=list(done.flexible)[-1],
        )
        files.append(page)
    return (*files, *record.files)


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


def _table(
    mechanism: Mechanism, record: Outcomes, band: float, stop: float, tol: float
) -> Comparison:
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
        notes=notes_of(mechanism, record, frequencies),
        unsolved={level: why_missing(record, level) for level in record.unsolved},
        stop=stop,
        band=band,
        tol=tol,
        cpu=record.cpu,
        falls=falls(record),
        start=" ".join(starting(mechanism, mechanism.description.solve, runs)),
        name=mechanism.name,
    )
