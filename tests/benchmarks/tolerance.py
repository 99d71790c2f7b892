"""What `tol` gives and costs: `python -m tests.benchmarks.tolerance [SCENE ...]`.

The scenes of tests/verification/test_tolerance.py, which holds them against generalized-alpha, the
race scenes as they are raced, and a delta. Errors here are against Radau IIA at a resolution of
1e-9: generalized-alpha is good to 3e-5 only. CPU seconds of the call, one thread.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from pinflex.description.solve import ASKED
from pinflex.errors import ConvergenceError
from pinflex.levels.outputs import Outputs
from pinflex.mechanics.mechanism import load
from pinflex.solver.scene import Scene
from pinflex.solver.tolerance import solve_to_tolerance
from pinflex.threads import one_blas_thread
from tests.benchmarks.race.case import scene
from tests.benchmarks.race.scenes import RACES
from tests.verification.test_tolerance import SCENES

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
FINEST = 1e-9
# The models of the race that RACE.md found cheapest.
RACED = {
    "R1": ("flexible.*.basis.internal=1",),
    "R2": ("flexible.*.basis.internal=0",),
    "R3": ("flexible.rod.basis={kind: craig_bampton, internal: 2}", "flexible.rod.segments=2"),
    "R4": ("flexible.*.axial=true", "flexible.*.segments=3", "flexible.*.basis.internal=0"),
}


def named(name: str) -> tuple[Scene, int]:
    """A scene and its number of samples."""
    if name in RACED:
        race = RACES[name]
        return scene(load(race.model, [*race.always, *RACED[name]]), race.asked), 401
    overrides, asked, end, _ = SCENES.get(name, ((), ASKED, None, 0.0))
    given = scene(load(name, list(overrides)), asked)
    return replace(given, spec=replace(given.spec, until=end, integrator="radau")), 51


def main() -> None:
    print("| scene | tol | error / tol | told / error, by output | steps, last | CPU s |")
    print("|---|---|---|---|---|---|")
    for name in sys.argv[1:] or [*RACED, *SCENES, "delta"]:
        given, samples = named(name)
        t = np.linspace(0.0, given.spec.until or given.motion.duration, samples)
        outputs = Outputs(given.mechanism, given.motion, t, given.spec.asked or ASKED)
        with one_blas_thread():
            exact = given.resolved(t, FINEST, coarser=given.resolved(t, 1e-3, pilot=True))
            for tol in TOLERANCES:
                start = time.process_time()
                try:
                    found = solve_to_tolerance(given, t, tol)
                except ConvergenceError as refused:
                    print(f"| {name} | {tol:.0e} | {str(refused)[:120]} | | | |", flush=True)
                    continue
                spent = time.process_time() - start
                error = outputs.differences(found, exact)
                told: dict[str, float] = found.settings["error"]  # type: ignore[assignment]
                ratio = [told[key] / max(error[key], 1e-300) for key in told if key in error]
                print(
                    f"| {name} | {tol:.0e} | {max(error.values()) / tol:.2f} "
                    f"| {min(ratio):.1f} to {max(ratio):.1f} "
                    f"| {found.cost['steps']:.0f}, {found.cost['last_steps']:.0f} "
                    f"| {spent:.3f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
