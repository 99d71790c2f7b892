"""What a second core brings to a sweep: `python tests/benchmarks/sweep.py`. 64 cases of race_r2.

Times include the start of the processes, as a user waits for it. What others kept busy meanwhile
is printed with each: the ratio means something only where that is small in both. Core seconds,
which others change less, say what two processes cost more than one.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
from joblib.externals.loky import get_reusable_executor

import pinflex as pf
from pinflex.results.pose_map import Columns

CASES = {"flexible.*.section.thickness": np.linspace(2.5e-3, 4e-3, 64), "solve.dt": [1.25e-4]}
ROUNDS = 2


def machine_busy() -> float:
    """Core seconds that the whole machine has worked since it started (Linux)."""
    user, nice, system, _, _, irq, soft, steal = (
        int(x) for x in Path("/proc/stat").read_text().split()[1:9]
    )
    return (user + nice + system + irq + soft + steal) / os.sysconf("SC_CLK_TCK")


def own_busy() -> float:
    """Core seconds of this process and of those it started, once they have ended."""
    get_reusable_executor().shutdown(wait=True)
    return sum(os.times()[:4])


def measured(jobs: int) -> tuple[float, Columns]:
    """Seconds of the sweep in so many processes, and its table."""
    own, all_of_it, began = own_busy(), machine_busy(), time.perf_counter()
    table = pf.sweep("race_r2", CASES, level="coupled", jobs=jobs)
    seconds = time.perf_counter() - began
    worked = own_busy() - own
    others = (machine_busy() - all_of_it - worked) / seconds
    print(f"{jobs} process{'es' if jobs > 1 else '  '} {seconds:7.2f} s, {worked:7.2f} core s, "
          f"others kept {max(others, 0.0):.2f} cores busy", flush=True)  # fmt: skip
    return seconds, table


def main() -> None:
    print(f"{len(next(iter(CASES.values())))} cases, {os.cpu_count()} cores, load "
          f"{os.getloadavg()[0]:.2f}")  # fmt: skip
    for _ in range(ROUNDS):
        (one, alone), (two, shared) = measured(1), measured(2)
        assert np.array_equal(alone["stress.peak"], shared["stress.peak"])
        assert np.all(alone["status"] == "done")
        print(f"{one / two:.2f} times as fast with 2 processes (limit 1.8)", flush=True)


if __name__ == "__main__":
    main()
