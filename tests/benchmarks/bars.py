"""What error bars tell beside the truth: `python -m tests.benchmarks.bars [--report F] [NAME ...]`.

Small scenes at `tol` 1e-3, those that a shorter run has left out named at the end. The true error
of time is against the same model at a thousandth of the tolerance (or the least that it keeps);
that of the model between that and links of four segments (fewer where there are many links) with
every deformation, second order, shear and rotary inertia, solids with more modes and shorter cells.
A ratio is told over true; none where the true error is below 1e-6 of the largest value.

With `--keep DIR` truths and rows are kept there, so that a table can be made in pieces. A truth
serves the code that made it only; scenes whose rows are of other code are named at the end.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import pinflex as pf
from pinflex.advice.error_bars import free
from pinflex.errors import PinflexError
from pinflex.levels.outputs import output_differences
from pinflex.results.error_bars import NONE
from tests.scenes import Body, load

TOL = 1e-3
FINE = (1e-6, 1e-5, 1e-4, 5e-4)  # of the truth: the first that is kept
KNOWN = 1e-6  # a smaller true error has no ratio
LOW, HIGH = 0.5, 10.0  # ratios aimed at
HEAD = """# What error bars tell, and what is true

Written by `python -m tests.benchmarks.bars --report FILE`.
"""
OWN = ("stress", "section forces", "platform acceleration")  # with columns of their own

ARM = """
actuated: [a_joint, b_joint]
platform: tool
flexible:
  a: {material: aluminium, section: {shape: circle, diameter: 0.03}}
  b: {end: tip, material: aluminium, section: {shape: circle, diameter: 0.02}}
motion: {kind: quintic, joints: {a_joint: 0.8, b_joint: -0.6}, duration: 0.4}
damping: {modal: 0.02}
solve: {until: 0.6}
"""
SPACE = ARM.replace("a_joint: 0.8, b_joint: -0.6", "a_joint: 1.0, b_joint: 0.7")
THIN = ("flexible.a.section.diameter=0.02", "flexible.b.section.diameter=0.012")
STIFF = ("flexible.a.section.diameter=0.05", "flexible.b.section.diameter=0.035")
FREE = ("damping=null",)  # of damping
STRAIGHT = ("solve.start=straight",)
PUSHED = ("solve.drive=torque", "solve.kp=800", "solve.kd=20")
PULLED = "forces={{pull: {{at: tool, {} }}}}"
RAMPS = "motion={kind: trapezoid, joints: {a_joint: 0.8, b_joint: -0.6}, speed: 3, ramp: 0.08}"
HELD = "motion={kind: hold, duration: 0.4}"
LOOSE = ("actuated=[]", "motion=null")
ROD = (
    "flexible.b={{end: tip, material: aluminium, "
    "basis: {{kind: mesh, modes: {}, rod: {{diameters: [{}]}}{} }}}}"
)
SLEEVED = "flexible.beam.basis={{kind: assumed, boundary: free_free, modes: {}}}"
RUBS = "joints={b_joint: {friction: {coulomb: 0.4}}}"


@dataclass(frozen=True)
class Scene:
    """A mechanism, what is changed of it, how it is solved, and what makes the model's truth."""

    of: str
    changes: tuple[str, ...] = ()
    keys: Mapping[str, Any] = field(default_factory=dict)
    truth: tuple[str, ...] | int = 4  # changes, or segments


SCENES = {
    "arm_gravity": Scene("arm"),
    "arm_soft": Scene("arm", THIN),
    "arm_undamped": Scene("arm", FREE),
    "arm_straight": Scene("arm", STRAIGHT),
    "arm_stiff": Scene("arm", STIFF),
    "arm_stiff_undamped": Scene("arm", STIFF + FREE, {"until": 0.3}),
    "arm_ramps": Scene("arm", (RAMPS,)),
    "arm_hold": Scene("arm", (HELD,)),
    "arm_push": Scene("arm", PUSHED),
    "arm_push_hard": Scene("arm", ("solve.drive=torque", "solve.kp=2e4", "solve.kd=200")),
    "arm_payload": Scene("arm", ("added_masses={load: {at: tool, mass: [3, 3, 3]}}",)),
    "arm_side_force": Scene("arm", (PULLED.format("force: [0, 5, 0]"),), {"until": 0.2}),
    "arm_side_only": Scene("arm", (HELD, "gravity=[0,0,0]", PULLED.format("force: [0, 5, 0]"))),
    "arm_twist_moment": Scene("arm", (PULLED.format("moment: [1, 0, 0]"),), {"until": 0.2}),
    "arm_step_force": Scene("arm", (HELD, PULLED.format("force: [0, 0, -20], start: 0.1"))),
    "arm_long": Scene("arm", ("gravity=[0,0,0]", "damping={modal: 0.001}"), {"until": 8.0}),
    "arm_falls": Scene("arm", LOOSE, {"until": 0.4}),
    "arm_one_motor": Scene("arm", ("actuated=[a_joint]", "motion.joints={a_joint: 0.8}")),
    "arm_two_segments": Scene("arm", ("flexible.*.segments=2",), truth=5),
    "arm_short": Scene("arm", ("flexible.*.section.diameter=0.12",)),
    "arm_solid": Scene("arm", (ROD.format(4, 0.06, ""),), truth=(
        ROD.format(14, 0.06, ", size: 0.03"), "flexible.a.segments=4", "flexible.a.shear=true",
        "flexible.a.rotary_inertia=true", "flexible.a.second_order=true")),
    "arm_b_rigid": Scene("arm", ("flexible.b=null",)),
    "arm_friction": Scene("arm", (RUBS, *PUSHED), {"until": 0.3}),
    "arm_still": Scene("arm", (), {"level": "quasistatic"}),
    "arm_ked": Scene("arm", (), {"level": "ked"}),
    "space_gravity": Scene("space"),
    "space_soft": Scene("space", THIN),
    "space_push": Scene("space", PUSHED),
    "space_falls": Scene("space", LOOSE, {"until": 0.3}),
    "space_straight": Scene("space", STRAIGHT),
    "ur5": Scene("ur5", truth=3),
    "3rrr": Scene("3rrr", (), {"until": 0.1}, 3),
    "3rrr_straight": Scene("3rrr", STRAIGHT, {"until": 0.05}, 3),
    "3rrs": Scene("3rrs", (), {"until": 0.1}, 2),
    "delta": Scene("delta", (), {"until": 0.08}, 3),
    "race_r1": Scene("race_r1", (), {"until": 0.05}, 3),
    "race_r2": Scene("race_r2", (), {}, 2),
    "race_r3": Scene("race_r3", ("flexible.rod.basis={kind: craig_bampton, internal: 2}",)),
    "spinning_beam": Scene("spinning_beam", (), {"until": 15.0}),
    "cantilever": Scene("cantilever", (), {"until": 0.4}),
    "prprp": Scene("prprp", (SLEEVED.format(8), "flexible.beam.damping={rayleigh: [0, 5e-5]}"),
        {"until": 0.2}, (SLEEVED.format(24),
        "flexible.beam.second_order=true", "flexible.beam.axial=true")),
}  # fmt: skip


def mechanism(scene: Scene, folder: Path, more: tuple[str, ...] = ()) -> pf.Mechanism:
    """The mechanism of a scene, with more changes."""
    changes = [*scene.changes, *more]
    if scene.of not in ("arm", "space"):
        return pf.load(scene.of, changes)
    upright = scene.of == "space"
    bodies = (
        Body("a", "base", "revolute", axis=(0, 0, 1) if upright else (0, 1, 0)),
        Body("b", "a", "revolute", axis=(0, 1, 0), xyz=(0.5, 0, 0)),
        Body("tip", "b", xyz=(0.4, 0, 0)),
        Body("tool", "tip", mass=0.3, inertia=(1e-4, 1e-4, 1e-4)),
    )
    return load(folder, bodies, SPACE if upright else ARM, changes)


def richest(scene: Scene, robot: pf.Mechanism) -> list[tuple[str, ...]]:
    """Changes that make the truth of the model, the fullest first."""
    if not isinstance(scene.truth, int):
        return [scene.truth]
    n, links = scene.truth, list(robot.parts)
    keys = ("bending_y", "bending_z", "axial", "torsion", "second_order")
    full = tuple(f"flexible.{x}.{key}=true" for x in links for key in keys)
    thick = tuple(f"flexible.{x}.{key}=true" for x in links for key in ("shear", "rotary_inertia"))
    cut = tuple(f"flexible.{x}.segments={n}" for x in links)
    more = tuple(f"flexible.{x}.basis.internal=4" for x in links)
    return [full + thick + cut, full + cut, full + thick + more, cut]


@dataclass(frozen=True)
class Row:
    """One scene.

    Attributes:
        steps: Of the run. notes: How errors were found, or why not.
        told, true, notes: By "time" and "model", the first two then by output.
        cpu: Seconds of all.
        code: Stamp of the package that made it.
    """

    scene: str
    steps: float
    told: dict[str, dict[str, float]]
    true: dict[str, dict[str, float]]
    notes: dict[str, str]
    cpu: float
    code: str

    def measured(self, of: str) -> bool:
        """Whether an error is told, be it that there is none."""
        return bool(self.told[of]) or self.notes[of].startswith(NONE)

    def ratios(self, of: str) -> dict[str, float]:
        """Told over true by output, where the true error is known."""
        told, true = self.told[of], self.true[of]
        return {k: told[k] / true[k] for k in told if k in true and true[k] > KNOWN}


def row(name: str, keep: Path | None = None) -> Row:
    """Solve a scene, ask for its bars, and find the true errors.

    Args:
        name: Of the scene. keep: Folder with truths; None: they are not kept.
    """
    scene, began, code = SCENES[name], time.process_time(), stamp(name)
    with tempfile.TemporaryDirectory() as at:
        robot = mechanism(scene, Path(at))
        keys = {"level": "coupled", "samples": 61, "tol": TOL, **scene.keys}
        integrated = keys["level"] in ("coupled", "ked")
        if not integrated:
            keys.pop("tol")
        run = pf.solve(robot, **keys)
        bars = run.errors
        true: dict[str, dict[str, float]] = {"time": {}, "model": {}}
        exact = run  # of its model
        if integrated:
            exact = kept(keep, f"{name}.time", lambda: first(robot, keys))
            true["time"] = output_differences(run, exact, free(robot))
        if robot.parts:
            start = run.meta["settings"].get("start", "static")
            full = {**keys, "level": "coupled", "start": start, "tol": TOL}
            rich = kept(keep, f"{name}.model", lambda: richer(scene, robot, Path(at), full))
            true["model"] = output_differences(exact, rich, free(robot))
        told = {"time": dict(bars.time), "model": dict(bars.model)}
        cost = float(run.meta["cost"].get("steps", 0))
        notes = {"time": bars.time_note, "model": bars.model_note}
        return Row(name, cost, told, true, notes, time.process_time() - began, code)


def stamp(name: str) -> str:
    """Of all that a row depends on: sources and models of the package, and the scene."""
    return hashlib.sha256(repr((SCENES[name], ARM, _package())).encode()).hexdigest()[:8]


@functools.cache
def _package() -> str:
    root, found = Path(pf.__file__).parents[1], hashlib.sha256()
    for file in (x for at in ("pinflex", "models") for x in sorted((root / at).rglob("*"))):
        if file.suffix in (".py", ".c", ".h", ".yaml", ".urdf"):
            found.update(file.read_bytes())
    return found.hexdigest()


def kept(keep: Path | None, name: str, find: Callable[[], pf.Result]) -> pf.Result:
    """A truth, from a folder where it is kept."""
    if keep is None:
        return find()
    file = keep / f"{name}.{stamp(name.partition('.')[0])}.npz"
    if not file.exists():
        find().save(file)
    return pf.Result.load(file)


def richer(scene: Scene, robot: pf.Mechanism, at: Path, keys: Mapping[str, Any]) -> pf.Result:
    """The run of the fullest model that comes to its end."""
    failed: PinflexError | None = None
    for changes in richest(scene, robot):
        try:
            return first(mechanism(scene, at, changes), keys, FINE[1:])
        except PinflexError as error:
            failed = error
    assert failed is not None
    raise failed


def first(
    robot: pf.Mechanism, keys: Mapping[str, Any], tols: tuple[float, ...] = FINE
) -> pf.Result:
    """The run at the least tolerance that is kept."""
    failed: PinflexError | None = None
    for tol in tols:
        try:
            return pf.solve(robot, **{**keys, "tol": tol})
        except PinflexError as error:
            failed = error
    assert failed is not None
    raise failed


def half(found: Row, of: str) -> str:
    """Columns of one of the two errors."""
    told, true, ratios = found.told[of], found.true[of], found.ratios(of)
    if not told:
        word = NONE if found.measured(of) else "not measured"
        worst = f"{max(true.values()):.1e}" if true else "-"
        return f"{word} | {worst} | - | - | - | -"
    main = [k for k in told if k not in OWN]
    cells = [f"{max((told[k] for k in main), default=float('nan')):.1e}"]
    cells.append(f"{max((true[k] for k in main if k in true), default=float('nan')):.1e}")
    own = [ratios[k] for k in main if k in ratios]
    cells.append(f"{min(own):.2f} .. {max(own):.2f}" if own else "-")
    for key in OWN:
        both = f"{told[key]:.1e} / {true[key]:.1e}" if key in told and key in true else "-"
        cells.append(both + (f" = {ratios[key]:.2f}" if key in ratios else ""))
    return " | ".join(cells)


def report(found: list[Row]) -> str:
    """Both tables, with what is outside of what is aimed at."""
    text = [str(__doc__).split("\n\n")[1], ""]
    head = "| scene | steps | told | true | told / true | stress | section forces | acceleration |"
    for of in ("time", "model"):
        pairs = [r for x in found for r in x.ratios(of).values()]
        inside = sum(LOW <= r <= HIGH for r in pairs)
        silent = [x.scene for x in found if not x.measured(of)]
        small = [x.told[of][k] for x in found for k, e in x.true[of].items()
                 if e <= KNOWN and k in x.told[of]]  # fmt: skip
        text += [
            f"## {of.capitalize()}",
            "",
            f"{inside} of {len(pairs)} ratios between {LOW:g} and {HIGH:g}; least "
            f"{min(pairs, default=0):.2g}, largest {max(pairs, default=0):.3g}. Told where the "
            f"true error is below {KNOWN:g}: at most {max(small, default=0):.1e}. "
            f"Not measured: {', '.join(silent) or 'none'}.",
            "",
            head,
            "|---" * 8 + "|",
            *(f"| {x.scene} | {x.steps:g} | {half(x, of)} |" for x in found),
            "",
        ]
    notes = [f"- {x.scene}, {of}: {x.notes[of]}." for of in ("time", "model")
             for x in found if not x.told[of]]  # fmt: skip
    left = ", ".join(name for name in SCENES if name not in {x.scene for x in found}) or "none"
    old = ", ".join(x.scene for x in found if x.code != stamp(x.scene)) or "none"
    cpu = sum(x.cpu for x in found)
    end = f"Not run: {left}. Run with other code: {old}. CPU: {cpu:.0f} s."
    return "\n".join([*text, *notes, "", end]) + "\n"


def main() -> None:
    """Rows as they come, and the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--report", type=Path)
    parser.add_argument("--keep", type=Path, metavar="DIR")
    given = parser.parse_args()
    found: dict[str, Row] = {}
    if given.keep:
        given.keep.mkdir(parents=True, exist_ok=True)
        rows = (Row(**json.loads(file.read_text())) for file in given.keep.glob("*.json"))
        found = {row.scene: row for row in rows}
    for name in given.names or SCENES:
        try:
            one = found[name] = row(name, given.keep)
        except PinflexError as failed:
            print(f"{name}: {failed}", file=sys.stderr, flush=True)
            continue
        if given.keep:
            (given.keep / f"{name}.json").write_text(json.dumps(asdict(one)))
        both = f"{half(one, 'time')} || {half(one, 'model')}"
        print(f"{name:18s} {one.cpu:5.1f} s | {both}", flush=True)
        if given.report:  # so far: whoever stops it has what is there
            given.report.write_text(HEAD + report([found[x] for x in SCENES if x in found]))
    if not given.report:
        print(report([found[x] for x in SCENES if x in found]))


if __name__ == "__main__":
    main()
