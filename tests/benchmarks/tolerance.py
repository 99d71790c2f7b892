"""What `tol` gives and costs: `python tests/benchmarks/tolerance.py`.

The scenes, their outputs and references are those of tests/verification/test_tolerance.py: errors
are against generalized-alpha with steps that leave 3e-5. CPU seconds of the call, one thread.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "verification"))

from test_tolerance import SCENES, mechanism, reference, run

from pinflex.levels.outputs import Outputs
from pinflex.solver.solve import default_motion

TOLERANCES = (1e-2, 1e-3, 1e-4)


def main() -> None:
    print("| scene | tol | worst error | estimate | runs' steps, last | CPU s |")
    print("|---|---|---|---|---|---|")
    for name, (_, asked, _, _) in SCENES.items():
        m, exact = mechanism(name), reference(name)
        outputs = Outputs(m, default_motion(m), exact.t, asked)
        for tol in TOLERANCES:
            start = time.process_time()
            found = run(name, integrator="radau", tol=tol, asked=asked)
            spent = time.process_time() - start
            error = max(outputs.differences(found, exact).values())
            estimate = max(found.settings["error"].values())  # type: ignore[attr-defined]
            steps, last = found.cost["steps"], found.cost["last_steps"]
            row = f"| {name} | {tol:.0e} | {error:.1e} | {estimate:.1e} "
            print(f"{row}| {steps:.0f}, {last:.0f} | {spent:.3f} |", flush=True)


if __name__ == "__main__":
    main()
