"""What a user of a race scene waits for: `python -m tests.benchmarks.race.user MODEL TOL ASKED
[KEY=VALUE ...]`.

The process begins with nothing imported, loads, solves by tol and reads the torques: its whole CPU
time is `process`. Then, now that all is imported, the same once more on a new mechanism: CPU
seconds of load, of solve (march, set-up and the record of what was asked) and of every output.
Prints one JSON object.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from itertools import pairwise

import pinflex as pf


def main(argv: Sequence[str]) -> None:
    """Run twice: cold, then warm."""
    model, tol, asked, *overrides = argv
    about = tuple(asked.split(","))

    def solved() -> tuple[pf.Result, list[float]]:
        times = [time.process_time()]
        robot = pf.load(model, overrides)
        times.append(time.process_time())
        run = pf.solve(robot, level="coupled", tol=float(tol), asked=about)
        times.append(time.process_time())
        assert len(run.torque)
        return run, times

    solved()
    process = time.process_time()
    run, times = solved()
    run.load_all()
    load, solve = (b - a for a, b in pairwise(times))
    every = time.process_time() - times[-1]
    print(json.dumps({"process": process, "load": load, "solve": solve, "every": every}))


if __name__ == "__main__":
    main(sys.argv[1:])
