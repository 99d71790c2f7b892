"""What a second core brings to a sweep: `python tests/benchmarks/sweep.py`. 64 cases of the 3-RRR.

Times include the start of the processes, as a user waits for it. The load of the machine by others
before each run is printed with it: on two cores a ratio above 1.8 needs a load below about 0.1.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

import pinflex as pf
from pinflex.columns import Columns

CASES = {"flexible.*.section.thickness": np.linspace(1.5e-3, 3e-3, 64)}
ROUNDS = 2


def measured(jobs: int) -> tuple[float, Columns]:
    """Seconds of the sweep in so many processes, and its table."""
    load = os.getloadavg()[0]
    began = time.perf_counter()
    table = pf.sweep("3rrr", CASES, level="quasistatic", jobs=jobs)
    seconds = time.perf_counter() - began
    inside = float(np.sum(table["cost.seconds"]))
    print(f"{jobs} process{'es' if jobs > 1 else '  '}  {seconds:7.2f} s   "
          f"solving {inside:7.2f} s, load before {load:.2f}", flush=True)  # fmt: skip
    return seconds, table


def main() -> None:
    print(f"{len(next(iter(CASES.values())))} cases, {os.cpu_count()} cores")
    best = {1: np.inf, 2: np.inf}
    for _ in range(ROUNDS):
        tables = {}
        for jobs in best:
            seconds, tables[jobs] = measured(jobs)
            best[jobs] = min(best[jobs], seconds)
        same = np.array_equal(tables[1]["stress.peak"], tables[2]["stress.peak"])
        assert same and np.all(tables[1]["status"] == "done")
    print(f"best of {ROUNDS}: {best[1] / best[2]:.2f} times as fast with 2 processes (limit 1.8)")


if __name__ == "__main__":
    main()
