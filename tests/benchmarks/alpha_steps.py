"""Steps of the alpha family that follow the motion, against equal ones that are halved.

`python tests/benchmarks/alpha_steps.py`: whole scenes at 401 samples, each within a tolerance by
both; errors against Radau at 1e-5. CPU seconds of the march, one thread, the shorter of two.
"""

from __future__ import annotations

import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import pinflex as pf
from pinflex.errors import ConvergenceError
from pinflex.levels.outputs import Outputs
from pinflex.solver.scene import Scene
from pinflex.solver.solve import SAMPLES, _spec, default_motion
from pinflex.solver.tolerance import by_error_control, by_step_halving, solve_to_tolerance

# Overrides and end in s of each; None: the scene's own.
SCENES: dict[str, tuple[list[str], float | None]] = {
    "race_r1": ([], None),
    "race_r2": ([], None),
    "spinning_beam": ([], None),
    "3rrs": ([], None),
    "ur5": (["damping={rayleigh: [0, 1.0e-3]}", "solve.start=straight"], 3.0),
}


def main() -> None:
    print(
        "| scene | integrator | tol | steps that follow: error / tol | steps, last | CPU s ", end=""
    )
    print("| halved: error / tol | steps, last | CPU s |")
    print("|" + "---|" * 9)
    for name, (overrides, until) in SCENES.items():
        m = pf.load(name, overrides)
        motion = default_motion(m)
        t = np.linspace(0.0, until or m.description.solve.until or motion.duration, SAMPLES)

        def scene(m=m, motion=motion, until=until, **keys: object) -> Scene:
            return Scene(m, motion, _spec(m, {"level": "coupled", "until": until, **keys}))

        exact = solve_to_tolerance(scene(integrator="radau", tol=1e-5), t, 1e-5)
        outputs = Outputs(m, motion, t)
        for integrator in ("newmark", "hht", "generalized_alpha"):
            # 3rrs names coefficients of first order.
            plain = {"newmark": (0.5, 0.25)} if integrator == "newmark" else {}
            for tol in (1e-2, 1e-3):
                if (name, integrator, tol) == ("race_r1", "newmark", 1e-3):
                    continue  # neither gets there: multipliers ring, in minutes
                cells = []
                for method in (by_error_control, by_step_halving):
                    cpu = np.inf
                    try:
                        for _ in range(2):
                            start = time.process_time()
                            run = method(scene(integrator=integrator, tol=tol, **plain), t, tol)
                            cpu = min(cpu, time.process_time() - start)
                    except ConvergenceError:
                        cells.append("- | - | -")
                        continue
                    error = max(outputs.differences(run, exact).values()) / tol
                    steps, last = run.cost["steps"], run.cost["last_steps"]
                    cells.append(f"{error:.2f} | {steps:.0f}, {last:.0f} | {cpu:.2f}")
                print(f"| {name} | {integrator} | {tol:.0e} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
