"""What each level costs: `python tests/benchmarks/levels.py`. One thread, CPU seconds.

A whole `pf.solve` at 401 instants (3rrr: 201), the shortest of three: states and torques, and with
every pose, force, stress and warning read too. Scenes as in `validation/test_advise.py`.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pinflex as pf
from tests.validation.test_advise import STATIC, STIFFENED

SCENES: dict[str, tuple[tuple[str, ...], int]] = {
    "3rrr": (STIFFENED, 201),
    "ur5": (STATIC, 401),
    "race_r1": ((), 401),
    "race_r2": ((), 401),
    "3rrs": ((), 401),
}
LEVELS: dict[str, dict[str, Any]] = {
    "rigid": {"level": "rigid"},
    "quasistatic, every sample": {"level": "quasistatic"},
    "quasistatic within 1e-2": {"level": "quasistatic", "tol": 1e-2},
    "ked, default step": {"level": "ked"},
    "ked within 1e-2": {"level": "ked", "tol": 1e-2},
    "coupled within 1e-2": {"level": "coupled", "tol": 1e-2},
}


def seconds(robot: pf.Mechanism, samples: int, options: dict[str, Any]) -> str:
    states, read = [], []
    for _ in range(3):
        began = time.process_time()
        try:
            run = pf.solve(robot, samples=samples, **options)
        except pf.ConvergenceError:
            return "-"  # no equilibrium somewhere
        states.append(time.process_time() - began)
        dict(run.arrays), dict(run.meta)
        read.append(time.process_time() - began)
    return f"{min(states):.2g}, {min(read):.2g}"


def main() -> None:
    warnings.simplefilter("ignore")
    robots = {name: pf.load(name, list(changes)) for name, (changes, _) in SCENES.items()}
    print("| level | " + " | ".join(SCENES) + " |")
    print("|---" * (len(SCENES) + 1) + "|")
    for level, options in LEVELS.items():
        cells = [seconds(robots[name], count, options) for name, (_, count) in SCENES.items()]
        print(f"| {level} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
