"""What level ked costs beside level coupled: `python tests/benchmarks/ked.py [MODEL ...]`.

CPU of a whole `pf.solve` of a loaded model, one thread, the two in turn, the least of nine: ked in
its default steps, and coupled within a tolerance of 1e-2 by collocation (`--tol`). One of a linear
system should cost no more than twice the other.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pinflex as pf
from pinflex.description.description import model_names

TURNS = 9


def seconds(call: Callable[[], object]) -> float:
    """CPU of a call; nan where the scene has no answer at that level."""
    began = time.process_time()
    try:
        call()
    except pf.PinflexError:
        return float("nan")
    return time.process_time() - began


def row(name: str, tol: float) -> str:
    """The model, its coordinates, steps of ked, both costs [ms] and their ratio."""
    robot = pf.load(name)
    run = pf.solve(robot, level="ked")
    steps = int(run.meta["cost"]["steps"])
    calls = (
        lambda: pf.solve(robot, level="ked"),
        lambda: pf.solve(robot, level="coupled", tol=tol, integrator="radau"),
    )
    costs = [[1e3 * seconds(call) for call in calls] for _ in range(TURNS)]
    ked, coupled = (min(turn[k] for turn in costs) for k in range(2))
    size = f"{robot.flexible.nv} + {robot.flexible.closed.n}"
    return f"| {name} | {size} | {steps} | {ked:.1f} | {coupled:.1f} | {ked / coupled:.2f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", default=[n for n in model_names() if n != "prprp"])
    parser.add_argument("--tol", type=float, default=1e-2)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| model | coordinates + closures | steps | ked, ms | coupled by tol, ms | ratio |")
    print("|---|---|---|---|---|---|")
    for name in given.models:
        print(row(name, given.tol), flush=True)


if __name__ == "__main__":
    main()
