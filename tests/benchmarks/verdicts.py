"""Do `compare` and `advise` agree: `python -m tests.benchmarks.verdicts [--report F] [NAME ...]`.

For shipped models, a UR10 with elastic gears, a Panda with its gripper and a five-bar of one's own,
each in a smooth move and in one whose acceleration jumps (where its motion is a move): the simplest
level that suffices by `compare`, the proposal of `advise`, its largest error bar and the error of a
run that follows it, both as shares of what is allowed; a bar above 1 is NOT REACHED on the screen
of `advise`. The error is measured against a run of `pinflex.advice.error_bars.finer_model` at a
twentieth of the tolerance. The last column says what is wrong:

- a level that `advise` lets pass misses in `compare`, or one that `compare` finds within a third of
  what is allowed is not let pass (bars are twice what was measured);
- a proposal is further off than allowed, or NOT REACHED is said although a level of the table keeps
  the tolerance.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pinflex as pf
from pinflex.advice.advise import advise
from pinflex.advice.error_bars import finer_model
from pinflex.advice.reduced_models import Advice
from pinflex.description.description import model_names
from pinflex.results.comparison import Comparison
from pinflex.results.verdict import allowed, simplest
from tests.scenes import Body, load
from tests.validation.test_advise import measured

HEAD = """# Whether compare and advise agree, and proposals keep their tolerance

Written by `python -m tests.benchmarks.verdicts --report FILE`; rows of scenes that a run was not
asked for stay as they are.
"""
COLUMNS = ("scene", "motion", "compare", "advise", "bar", "error", "CPU s", "wrong")
SHORT = {"prprp": ("solve.until=0.05",)}
JUMPS = ("motion.kind=trapezoid", "motion.ramp=0.05")
Rows = dict[tuple[str, str], tuple[str, ...]]  # cells by scene and motion
_NOTES = ("not judged", "no error measured")
_BOTH = ("torque", "motor force", "platform position")  # `compare` judges no rotation
_SURE = 3.0  # times as exact as asked: what `compare` finds so `advise` lets pass too
_UR10 = """urdf: example-robot-data:ur10
actuated: [shoulder_pan_joint, shoulder_lift_joint, elbow_joint, wrist_1_joint, wrist_2_joint,
           wrist_3_joint]
home: {shoulder_lift_joint: -1.2, elbow_joint: 1.6, wrist_1_joint: -1.9, wrist_2_joint: -1.57}
joints:
  shoulder_pan_joint: {drive: {gear: 101, motor_inertia: 2.0e-4, stiffness: 2.0e4, damping: 20}}
  shoulder_lift_joint: {drive: {gear: 101, motor_inertia: 2.0e-4, stiffness: 2.0e4, damping: 20}}
  elbow_joint: {drive: {gear: 101, motor_inertia: 1.0e-4, stiffness: 1.0e4, damping: 10}}
  wrist_1_joint: {drive: {gear: 101, motor_inertia: 3.0e-5, stiffness: 3.0e3, damping: 3}}
flexible:
  upper_arm_link: {material: aluminium, section: {shape: tube, diameter: 120 mm, wall: 4 mm}}
  forearm_link: {material: aluminium, section: {shape: tube, diameter: 90 mm, wall: 3 mm}}
damping: {modal: 0.01}
platform: tool0
motion: {kind: quintic, joints: {shoulder_pan_joint: 1.0, shoulder_lift_joint: 0.3}, duration: 0.8}
solve: {until: 1.6}
"""
_PANDA = """urdf: example-robot-data:panda
platform: panda_hand
flexible:
  panda_link4: {material: aluminium, section: {shape: tube, diameter: 0.112, wall: 0.0112}}
  panda_link2: {material: aluminium, section: {shape: tube, diameter: 0.105, wall: 0.0105}}
motion: {kind: quintic, joints: {panda_joint1: 0.1}, duration: 0.5}
"""
_FIVE_BAR = """actuated: [crank_l_joint, crank_r_joint]
loops: {tip: {kind: revolute, between: [tip_l, tip_r], axis: z}}
flexible:
  "crank_?, coupler_?": {material: aluminium, section: {shape: rectangle, width: 20 mm,
                         thickness: 4 mm}}
platform: tip_l
motion: {kind: quintic, joints: {crank_l_joint: 0.5}, duration: 0.2}
"""


def five_bar(folder: Path) -> pf.Mechanism:
    """Two cranks and two couplers of 20 x 4 mm aluminium, 0.15 kg where they meet."""

    def bar(name: str, parent: str, length: float, x: float) -> Body:
        mass = 2700 * length * 0.02 * 0.004
        inertia = (1e-6, mass * length**2 / 12, mass * length**2 / 12)
        return Body(name, parent, "revolute", xyz=(x, 0, 0), axis=(0, 0, 1), mass=mass,
                    com=(length / 2, 0, 0), inertia=inertia)  # fmt: skip

    bodies = [
        bar("crank_l", "base", 0.117, -0.09), bar("coupler_l", "crank_l", 0.214, 0.117),
        Body("tip_l", "coupler_l", "fixed", xyz=(0.214, 0, 0), mass=0.15, inertia=(1e-5,) * 3),
        bar("crank_r", "base", 0.093, 0.09), bar("coupler_r", "crank_r", 0.187, 0.093),
        Body("tip_r", "coupler_r", "fixed", xyz=(0.187, 0, 0)),
    ]  # fmt: skip
    return load(folder, bodies, _FIVE_BAR, inertia="urdf")


def written(folder: Path, text: str) -> pf.Mechanism:
    """A scene of one text."""
    (folder / "scene.yaml").write_text(text)
    return pf.load(folder / "scene.yaml")


OWN = {
    "ur10": lambda folder: written(folder, _UR10),
    "panda": lambda folder: written(folder, _PANDA),
    "five-bar": five_bar,
}


@dataclass(frozen=True)
class Verdict:
    """What the two say of a scene.

    Attributes:
        compared: The simplest level that suffices. proposed: The level of the proposal.
        bar, error: Of the proposal, as shares of what is allowed; nan: not measured.
        wrong: What contradicts what, in words; empty: nothing.
        note: Why the error was not measured.
    """

    compared: str
    proposed: str
    bar: float
    error: float
    wrong: tuple[str, ...]
    note: str = ""


def judge(robot: pf.Mechanism) -> Verdict:
    """Compare and advise on a scene, follow the proposal, and hold all against each other."""
    table, advice = pf.compare(robot).table, advise(robot)
    first, best = simplest(table.levels), table.levels[-1].level
    bar = advice.used(advice.error)
    error, note = followed(robot, advice)
    wrong = list(contradictions(table, advice))
    if bar <= 1.0 < error:
        wrong.append(f"the proposal is off by {error:.2g} of what is allowed")
    kept = [x for x, e in advice.levels.items() if advice.used(e) <= 1.0]
    if bar > 1.0 and kept:
        wrong.append(f"NOT REACHED, but {kept[0]} keeps it")
    compared = first.level if first else best
    return Verdict(compared, advice.level, bar, error, tuple(wrong), note)


def contradictions(table: Comparison, advice: Advice) -> Iterator[str]:
    """Levels of which `compare` and `advise` say the opposite."""
    for row in table.levels[:-1]:
        far = max((row.torque_off or 0.0) / table.tol, (row.platform_off or 0.0) / allowed(table))
        error = {k: e for k, e in advice.levels.get(row.level, {}).items() if k in _BOTH}
        bar = advice.used(error) if error else math.nan
        if bar <= 1.0 < far:
            yield f"{row.level} passes ({bar:.2g}) and misses ({far:.2g})"
        if bar > 1.0 and far * _SURE < 1.0 and math.isfinite(bar):
            yield f"{row.level} suffices ({far:.2g}) and does not pass ({bar:.2g})"


def followed(robot: pf.Mechanism, advice: Advice) -> tuple[float, str]:
    """Error of a run that follows an advice, as a share of what is allowed; nan, and why."""
    try:
        model = pf.load(robot.description, list(advice.overrides))
        options = {} if advice.run_tol is None else {"tol": advice.run_tol}
        run = pf.solve(model, level=advice.level, samples=201, **options)
        tol = advice.tol / 20
        fine = pf.solve(finer_model(robot)[0], level="coupled", samples=201, tol=tol)
    except pf.PinflexError as failed:
        return math.nan, f"no error measured: {_line(failed)}"
    rigid = pf.solve(robot, level="rigid", samples=201)
    return advice.used(measured(run, fine, rigid, advice.asked)), ""


def scenes(names: list[str], folder: Path) -> Iterator[tuple[str, str, pf.Mechanism]]:
    """Name, motion and mechanism of each scene that can do it."""
    for name in names or [*model_names(), *OWN]:
        robot = OWN[name](folder) if name in OWN else pf.load(name, list(SHORT.get(name, ())))
        yield name, "smooth", robot
        try:
            yield name, "jumps", pf.load(robot.description, list(JUMPS))
        except pf.PinflexError:
            continue  # a motion of another kind has no ramp


def row(name: str, motion: str, robot: pf.Mechanism) -> tuple[str, ...]:
    """The cells of a scene."""
    began = time.process_time()
    try:
        v = judge(robot)
    except pf.PinflexError as failed:
        cells = ("-",) * 4
        said = f"not judged: {_line(failed)}"
    else:
        bar = f"{v.bar:.2g}" + (" (NOT REACHED)" if v.bar > 1.0 else "")
        cells = (v.compared, v.proposed, bar, f"{v.error:.2g}")
        said = "; ".join(filter(None, (*v.wrong, v.note)))
    return (name, motion, *cells, f"{time.process_time() - began:.0f}", said)


def _line(error: Exception) -> str:
    """A message as one cell."""
    return " ".join(str(error).split()).replace("|", "/")


def written_rows(report: Path) -> Rows:
    """Rows of a report that is there, by scene and motion."""
    lines = report.read_text().splitlines() if report.exists() else []
    cells = [tuple(x.strip() for x in line.strip("|").split("|")) for line in lines]
    names = (*model_names(), *OWN)
    return {(c[0], c[1]): c for c in cells if len(c) == len(COLUMNS) and c[0] in names}


def report_of(rows: Rows) -> str:
    """The table, with what it shows and what is missing in it."""
    every = [*model_names(), *OWN]
    order = sorted(rows, key=lambda key: (every.index(key[0]), key[1] != "smooth"))
    wrong = [k for k in order if rows[k][-1] and not rows[k][-1].startswith(_NOTES)]
    missing = ", ".join(x for x in every if not any(k[0] == x for k in order)) or "none"
    short = "; ".join(f"{name}: {', '.join(changes)}" for name, changes in SHORT.items())
    lines = [f"| {' | '.join(cells)} |" for cells in (COLUMNS, *(rows[key] for key in order))]
    return "\n".join(
        [
            HEAD,
            str(__doc__).split("\n\n", 1)[1],
            f"{len(order)} rows, {len(wrong)} with something wrong. Not run: {missing}. "
            f"Shortened: {short}.",
            "",
            lines[0],
            "|---" * len(COLUMNS) + "|",
            *lines[1:],
            "",
        ]
    )


def main() -> int:
    """Rows as they come, and the report; 1 where something contradicts something."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--report", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = written_rows(given.report) if given.report else {}
    failed = 0
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, motion, robot in scenes(given.names, Path(folder)):
            found = row(name, motion, robot)
            rows[name, motion] = found
            failed += bool(found[-1]) and not found[-1].startswith(_NOTES)
            print(f"| {' | '.join(found)} |", flush=True)
            if given.report:  # so far: whoever stops it has what is there
                given.report.write_text(report_of(rows))
    return min(failed, 1)


if __name__ == "__main__":
    raise SystemExit(main())
