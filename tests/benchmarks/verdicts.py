"""Whether `compare` and `advise` agree: `python -m tests.benchmarks.verdicts [SCENE ...]`.

For shipped models, a UR10 with elastic gears, a Panda with its gripper and a five-bar of one's own,
each in a smooth move and in one whose acceleration jumps: the simplest level that suffices by
`compare`, the proposal of `advise`, its largest error bar and the error of a run that follows it,
both as shares of what is allowed. The error is measured against a run of the finer model of
`pinflex.advice.finer` at a twentieth of the tolerance. The last column says what is wrong:

- a level that `advise` lets pass misses in `compare`, or one that `compare` finds within a third of
  what is allowed is not let pass (bars are twice what was measured);
- a proposal is further off than allowed, or NOT REACHED is said although a level of the table keeps
  the tolerance.
"""

from __future__ import annotations

import math
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pinflex as pf
from pinflex.advice.advise import advise
from pinflex.advice.finer import finer_model
from pinflex.advice.proposal import Advice
from pinflex.description.description import model_names
from pinflex.results.comparison import Comparison
from pinflex.results.verdict import allowed, simplest
from tests.scenes import Body, load
from tests.validation.test_advise import measured

JUMPS = ("motion.kind=trapezoid", "motion.ramp=0.05")
_BOTH = ("torque", "platform position")  # `compare` judges no rotation
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
    """

    compared: str
    proposed: str
    bar: float
    error: float
    wrong: tuple[str, ...]


def judge(robot: pf.Mechanism) -> Verdict:
    """Compare and advise on a scene, follow the proposal, and hold all against each other."""
    table, advice = pf.compare(robot).table, advise(robot)
    first, best = simplest(table.levels), table.levels[-1].level
    bar = advice.used(advice.error)
    error = followed(robot, advice)
    wrong = list(contradictions(table, advice))
    if bar <= 1.0 < error:
        wrong.append(f"the proposal is off by {error:.2g} of what is allowed")
    kept = [x for x, e in advice.levels.items() if advice.used(e) <= 1.0]
    if bar > 1.0 and kept:
        wrong.append(f"NOT REACHED, but {kept[0]} keeps it")
    return Verdict(first.level if first else best, advice.level, bar, error, tuple(wrong))


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


def followed(robot: pf.Mechanism, advice: Advice) -> float:
    """Error of a run that follows an advice, as a share of what is allowed; nan: no reference."""
    try:
        model = pf.load(robot.description, list(advice.overrides))
        options = {} if advice.run_tol is None else {"tol": advice.run_tol}
        run = pf.solve(model, level=advice.level, samples=201, **options)
        tol = advice.tol / 20
        fine = pf.solve(finer_model(robot)[0], level="coupled", samples=201, tol=tol)
    except pf.PinflexError:
        return math.nan
    rigid = pf.solve(robot, level="rigid", samples=201)
    return advice.used(measured(run, fine, rigid, advice.asked))


def scenes(names: list[str], folder: Path) -> Iterator[tuple[str, str, pf.Mechanism]]:
    """Name, motion and mechanism of each scene that can do it."""
    for name in names or [*model_names(), *OWN]:
        robot = OWN[name](folder) if name in OWN else pf.load(name)
        yield name, "smooth", robot
        try:
            yield name, "jumps", pf.load(robot.description, list(JUMPS))
        except pf.PinflexError:
            continue  # a motion of another kind has no ramp


def main(names: list[str]) -> int:
    """Print the table; 1 where something contradicts something."""
    warnings.simplefilter("ignore")
    failed = 0
    print("| scene | motion | compare | advise | bar | error | wrong |")
    print("|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, motion, robot in scenes(names, Path(folder)):
            try:
                v = judge(robot)
            except pf.PinflexError as error:
                print(f"| {name} | {motion} | - | - | - | - | not judged: {str(error)[:90]} |")
                continue
            failed += len(v.wrong)
            cells = f"{v.compared} | {v.proposed} | {v.bar:.2g} | {v.error:.2g}"
            print(f"| {name} | {motion} | {cells} | {'; '.join(v.wrong)} |", flush=True)
    return min(failed, 1)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
