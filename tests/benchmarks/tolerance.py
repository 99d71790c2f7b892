"""What `tol` gives, tells and costs: `python -m tests.benchmarks.tolerance [--report F] [NAME]`.

The race scenes as they are raced, those of tests/verification/test_tolerance.py (which holds them
against generalized-alpha, good to 3e-5 only), and a delta. Errors here are against the corrected
runs of five and seven stages at the least tol that each can keep: the one that tells less is the
reference, what they differ by is its own error. CPU seconds of the call, one thread.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from pinflex.arrays import Array
from pinflex.description.solve import ASKED
from pinflex.errors import ConvergenceError
from pinflex.integrators.collocation import radau
from pinflex.integrators.problem import Run
from pinflex.levels.outputs import Outputs
from pinflex.mechanics.mechanism import load
from pinflex.solver.scene import Scene
from pinflex.solver.tolerance import in_one_run, solve_to_tolerance
from pinflex.threads import one_blas_thread
from tests.benchmarks.race.case import scene
from tests.benchmarks.race.report import machine
from tests.benchmarks.race.scenes import RACES
from tests.verification.test_tolerance import SCENES

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
REFERENCES = (1e-9, 3e-9, 1e-8, 3e-8, 1e-7, 3e-7, 1e-6, 1e-5)  # the least that can be kept
KNOWN = 3.0  # times the error of the reference: a smaller error is not known
# The models of the race that RACE.md found cheapest.
RACED = {
    "R1": ("flexible.*.basis.internal=1",),
    "R2": ("flexible.*.basis.internal=0",),
    "R3": ("flexible.rod.basis={kind: craig_bampton, internal: 2}", "flexible.rod.segments=2"),
    "R4": ("flexible.*.axial=true", "flexible.*.segments=3", "flexible.*.basis.internal=0"),
}
NAMES = (*RACED, "3rrs", "3rrr", "ur5", "delta", "race_r1", "race_r2", "race_r3", "spinning_beam")


@dataclass(frozen=True)
class Row:
    """One call.

    Attributes:
        scene, tol: What was asked for.
        told, error: By output, relative; `noise`: the error of the reference.
        steps, kept: Steps taken, and those of them that the answer is made of.
        cpu: Seconds. refused: What was said instead of an answer.
    """

    scene: str
    tol: float
    told: dict[str, float]
    error: dict[str, float]
    noise: dict[str, float]
    steps: float = 0.0
    kept: float = 0.0
    cpu: float = 0.0
    refused: str = ""

    @property
    def ratios(self) -> dict[str, float]:
        """Told over true, where the true error is known."""
        known = (key for key in self.told if self.error[key] > KNOWN * self.noise.get(key, 0.0))
        return {key: self.told[key] / self.error[key] for key in known}

    @property
    def within(self) -> float:
        """Largest error over tol."""
        return max(self.error.values(), default=0.0) / self.tol


def named(name: str) -> tuple[Scene, int]:
    """A scene and its number of samples."""
    if name in RACED:
        race = RACES[name]
        return scene(load(race.model, [*race.always, *RACED[name]]), race.asked), 401
    overrides, asked, end, _ = SCENES.get(name, ((), ASKED, None, 0.0))
    given = scene(load(name, list(overrides)), asked)
    return replace(given, spec=replace(given.spec, until=end, integrator="radau")), 51


def reference(given: Scene, t: Array, outputs: Outputs) -> tuple[Run, dict[str, float]]:
    """The run that errors are told against, and its own error by output."""
    found = []
    for stages in (5, 7):
        other = replace(given, spec=replace(given.spec, integrator=radau(stages)))
        for tol in REFERENCES:
            try:
                found.append(in_one_run(other, t, tol))
                break
            except ConvergenceError:
                continue
    best, second = sorted(found, key=lambda run: max(run.settings["error"].values()))
    return best, outputs.differences(second, best)


def rows(name: str) -> Iterator[Row]:
    """A scene at every tolerance."""
    given, samples = named(name)
    t = np.linspace(0.0, given.spec.until or given.motion.duration, samples)
    outputs = Outputs(given.mechanism, given.motion, t, given.spec.asked or ASKED)
    with one_blas_thread():
        exact, noise = reference(given, t, outputs)
        for tol in TOLERANCES:
            start = time.process_time()
            try:
                found = solve_to_tolerance(given, t, tol)
            except ConvergenceError as refused:
                spent = time.process_time() - start
                yield Row(name, tol, {}, {}, noise, cpu=spent, refused=str(refused))
                continue
            spent = time.process_time() - start
            error, cost = outputs.differences(found, exact), found.cost
            told = {key: e for key, e in found.settings["error"].items() if key in error}
            yield Row(name, tol, told, error, noise, cost["steps"], cost["last_steps"], spent)


HEAD = """\
| scene | tol | error / tol | told / error, by output | steps, kept | CPU s |
|---|---|---|---|---|---|"""


def line(row: Row) -> str:
    """A row of the table."""
    start = f"| {row.scene} | {row.tol:.0e} |"
    if row.refused:
        return f"{start} refused: {row.refused.split(': ', 1)[-1][:90]} | | | {row.cpu:.3f} |"
    ratios = ", ".join(
        f"{key.split()[-1]} {row.ratios[key]:.2g}" if key in row.ratios else f"{key.split()[-1]} ?"
        for key in row.told
    )
    return (
        f"{start} {row.within:.3f} | {ratios} | {row.steps:.0f}, {row.kept:.0f} | {row.cpu:.3f} |"
    )


def order(found: list[Row]) -> str:
    """Steps kept and CPU time against tol, and what ten times the accuracy costs."""
    text = ["| scene | " + " | ".join(f"{tol:.0e}" for tol in TOLERANCES) + " | a tenth: steps x |"]
    text.append("|---" * (len(TOLERANCES) + 2) + "|")
    for name in dict.fromkeys(row.scene for row in found):
        here = [row for row in found if row.scene == name]
        cells = ["-" if row.refused else f"{row.kept:.0f} ({1e3 * row.cpu:.0f} ms)" for row in here]
        passed = [row for row in here if not row.refused]
        decades = np.log10(passed[0].tol / passed[-1].tol) if len(passed) > 1 else 1.0
        grown = (passed[-1].kept / passed[0].kept) ** (1.0 / decades)
        text.append(f"| {name} | " + " | ".join(cells) + f" | {grown:.2f} |")
    return "\n".join(text)


def summary(found: list[Row]) -> str:
    """How many are as they should be."""
    passed = [row for row in found if not row.refused]
    ratios = [r for row in passed for r in row.ratios.values()]
    inside = sum(0.3 <= r <= 10.0 for r in ratios)
    unknown = sum(len(row.told) - len(row.ratios) for row in passed)
    return (
        f"Largest error over tol: {max(row.within for row in passed):.2f}. Told over true error: "
        f"{min(ratios):.2f} to {max(ratios):.3g}; {inside} of {len(ratios)} between 0.3 and 10, "
        f"{sum(r < 0.3 for r in ratios)} below. {unknown} errors are too small to be known (`?`: "
        f"less than {KNOWN:g} times what the two references differ by). "
        f"Refused: {len(found) - len(passed)} of {len(found)}."
    )


def report(found: list[Row]) -> str:
    """The whole report."""
    here = machine()
    about = " ".join((__doc__ or "").split("\n\n", 1)[1].split("\n"))
    return "\n".join(
        [
            "# What a tolerance gives, tells and costs\n",
            "Written by `python -m tests.benchmarks.tolerance --report FILE`.",
            f"{about.strip()}\n",
            f"{here['processor']}, {here['cores']} cores, Python {here['python']}; "
            f"{here['versions']}; kernel: {here['kernel']}. Load (1, 5, 15 min): "
            + ", ".join(f"{x:.2f}" for x in os.getloadavg())
            + ".\n",
            summary(found) + "\n",
            HEAD,
            *map(line, found),
            "\n## Cost against tol\n",
            "Steps kept, CPU milliseconds of the call (with its restarts), and the factor on steps "
            "for each tenth of tol. A method of order 11 asks for 1.23; more is asked for by "
            "vibrations that a coarser run damps and a finer one has to follow.\n",
            order(found),
            "",
        ]
    )


def main() -> None:
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks.tolerance")
    options.add_argument("scenes", nargs="*", metavar="SCENE")
    options.add_argument("--report", metavar="FILE")
    given = options.parse_args()
    found: list[Row] = []
    print(HEAD)
    for name in given.scenes or NAMES:
        for row in rows(name):
            found.append(row)
            print(line(row), flush=True)
    print(summary(found), file=sys.stderr)
    if given.report:
        with open(given.report, "w", encoding="utf-8") as file:
            file.write(report(found))


if __name__ == "__main__":
    main()
