"""What following an advice saves: `python tests/benchmarks/advice.py`. One thread, CPU seconds.

For scenes of six natures: the advice, its error bar, the error measured against eight segments in
each link with every deformation on (`test_advise.truth`; a fiftieth of the tolerance), the CPU time
of the run that it proposes, and that of the run without advice: level coupled by `tol`, every
link in every plane with stretch and twist, at the fewest internal modes (from two on) and then the
loosest tolerance that reach the error of the advised run, within a quarter of it. "In steps" is the
same model by generalized-alpha, with the longest of ten halved steps that does (nan: none). What is
timed is `pf.solve`, the shortest of five: states and torques at 401 instants. "All read" is the
ratio with every pose, force, stress and warning asked for too, which costs the same at all levels
with links that bend. Figures are printed and not asserted.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import itertools
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pinflex as pf
from pinflex.advice.advise import advise
from pinflex.solver.solve import default_motion
from tests.validation.test_advise import ALL, SLOW, STATIC, STIFFENED, measured, truth

QUIET = (*STATIC, "motion.duration=1", "solve.until=1")
# nature: model, changes, tolerance, outputs asked for
SCENES: dict[str, tuple[str, Sequence[str], float, Sequence[str]]] = {
    "stiff: ur5, torque": ("ur5", STATIC, 0.1, ("torque",)),
    "stiff: ur5, all": ("ur5", STATIC, 0.1, ALL),
    "slow: ur5 in 1 s, all": ("ur5", QUIET, 0.05, ALL),
    "slow: race_r2 in 4 s, all": ("race_r2", SLOW, 0.02, ALL),
    "fast: race_r1, torque": ("race_r1", (), 0.03, ("torque",)),
    "fast: race_r1, all": ("race_r1", (), 0.02, ALL),
    "spinning: beam, torque": ("spinning_beam", (), 0.03, ("torque",)),
    "spinning: beam, all": ("spinning_beam", (), 0.05, ALL),
    "planar: 3rrr, torque": ("3rrr", STIFFENED, 0.1, ("torque",)),
    "spatial: race_r2, all": ("race_r2", (), 0.02, ALL),
}
_TOLERANCES = (0.1, 0.03, 0.01, 3e-3)


def timed(robot: pf.Mechanism, **options: Any) -> tuple[float, float, pf.Result]:
    """CPU seconds, those with everything read, the shortest of five, and the result."""
    times, read = [], []
    for _ in range(5):
        began = time.process_time()
        run = pf.solve(robot, samples=401, **options)
        times.append(time.process_time() - began)
        dict(run.arrays), dict(run.meta)
        read.append(time.process_time() - began)
    return min(times), min(read), run


def everything(robot: pf.Mechanism, modes: int) -> pf.Mechanism:
    """The scene as one writes it who leaves nothing out."""
    changes = [f"flexible.*.{key}=true" for key in ("axial", "torsion", "bending_y", "bending_z")]
    changes.append(f"flexible.*.basis.internal={modes}")
    return pf.load(robot.description.with_overrides(changes))


def row(name: str) -> str:
    model, changes, tol, asked = SCENES[name]
    robot = pf.load(model, list(changes))
    advice = advise(robot, tol=tol, band=0.0, asked=asked)
    options = {} if advice.run_tol is None else {"tol": advice.run_tol, "asked": asked}
    advised = pf.load(robot.description, list(advice.overrides))
    cheap, cheap_read, run = timed(advised, level=advice.level, **options)
    reference = pf.solve(truth(robot), level="coupled", samples=401, tol=tol / 50, asked=asked)
    rigid = pf.solve(robot, level="rigid", samples=401)

    def worst(result: pf.Result) -> float:
        return max(measured(result, reference, rigid, asked).values())

    error = worst(run)
    for modes, loosest in itertools.product((2, 3, 4), _TOLERANCES):
        full = everything(robot, modes)
        found = pf.solve(full, level="coupled", samples=401, tol=loosest, asked=asked)
        if (reached := worst(found)) <= 1.25 * error:
            break
    dear, dear_read, _ = timed(full, level="coupled", tol=loosest, asked=asked)
    stepped = in_steps(full, lambda result: worst(result) <= 1.25 * error)
    return (
        f"| {name}, {tol:g} | {advice.level}, {advice.coordinates[2]} "
        f"| {max(advice.error.values()):.2g} | {error:.2g} | {cheap:.4f} "
        f"| {full.flexible.n_eta}, {loosest:g} | {reached:.2g} | {dear:.4f} | {dear / cheap:.1f} "
        f"| {dear_read / cheap_read:.1f} | {stepped:.2f} | {stepped / cheap:.1f} |"
    )


def in_steps(full: pf.Mechanism, reached: Callable[[pf.Result], bool]) -> float:
    """CPU seconds of generalized-alpha with the longest step that is good enough."""
    dt = float(full.description.solve.until or default_motion(full).duration) / 400
    for _ in range(10):
        options = {"level": "coupled", "integrator": "generalized_alpha", "dt": dt}
        try:
            good = reached(pf.solve(full, samples=401, **options))
        except pf.SceneError:
            good = False
        if good:
            return timed(full, **options)[0]
        dt /= 2
    return float("nan")


def main() -> None:
    warnings.simplefilter("ignore")
    print(
        "| scene, asked, tol | advice, coordinates | bar | measured | CPU s "
        "| full: coordinates, tol | measured | CPU s | ratio | all read | in steps, CPU s | ratio |"
    )
    print("|---" * 12 + "|")
    for name in SCENES:
        print(row(name), flush=True)


if __name__ == "__main__":
    main()
