"""Cost against the number of flexible links: `python -m tests.benchmarks.growth [MOST]`.

Planar links in chains of two on one base (tree), and one chain of segments that is clamped to one
motor (serial). Each size runs in a process of its own, for its memory: CPU seconds to load and to
simulate a second (256: 0.02 s) by `tol`, those of everything that the result holds, microseconds of
a residual and of a tangent, and the most memory taken, before and after the result was read.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import pinflex as pf
from pinflex.lab.scene import Body, scene
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism

SIZES = (1, 4, 16, 64, 256)
FLEXIBLE = """
flexible:
  "l*":
    material: {{E: 7.0e10, nu: 0.3, rho: 2700}}
    section: {{shape: rectangle, width: 0.02, thickness: 0.004}}
    segments: {segments}
    basis: {{kind: craig_bampton, internal: 0}}
    up: [0, 0, 1]
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
damping: {{rayleigh: [0, 1.0e-4]}}
motion: {{kind: cycloid, joints: {{{moves}}}, duration: 0.2}}
"""


def tree(links: int) -> Mechanism:
    """Chains of two links, every joint a motor."""
    bodies, names = [], []
    for k in range(max(links // 2, 1)):
        parent = "base"
        for j in range(min(2, links)):
            name = f"l{k}_{j}"
            bodies.append(Body(name, parent, "revolute", xyz=(0.3, 0, 0) if j else (0, 0.1 * k, 0)))
            parent, _ = name, names.append(name)
        bodies.append(Body(f"t{k}", parent, xyz=(0.3, 0, 0), mass=0.1, inertia=(1e-5,) * 3))
    moves = ", ".join(f"{name}_joint: 0.3" for name in names)
    motors = ", ".join(f"{name}_joint" for name in names)
    yaml = FLEXIBLE.format(moves=moves, segments=1)
    return scene("tree", bodies, yaml, (0, 0, -9.81), motors)


def serial(segments: int) -> Mechanism:
    """One link of 1 m in segments, turned by a motor."""
    bodies = [Body("l", "base", "revolute"), Body("tip", "l", xyz=(1.0, 0, 0))]
    yaml = FLEXIBLE.format(moves="l_joint: 0.3", segments=segments)
    return scene("serial", bodies, yaml, (0, 0, -9.81), "l_joint")


def best(call: Callable[[], object], repeats: int) -> float:
    """CPU microseconds of the fastest call."""
    times = []
    for _ in range(repeats):
        began = time.thread_time()
        call()
        times.append(time.thread_time() - began)
    return 1e6 * min(times)


def memory() -> float:
    """Most memory that this process has had, MB (Linux)."""
    lines = Path("/proc/self/status").read_text("utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1e3


def row(kind: str, size: int) -> str:
    """One size: its numbers as a row of the table."""
    began = time.process_time()
    m = tree(size) if kind == "tree" else serial(size)
    load, began = time.process_time() - began, time.process_time()
    run = pf.solve(m, level="coupled", until=0.02 if size > 64 else 1.0, tol=1e-2)
    solve, lean, began = time.process_time() - began, memory(), time.process_time()
    dict(run.arrays)
    read = time.process_time() - began
    d, still = Equations(m.flexible), np.zeros(m.flexible.nv)
    state = m.undeformed(), still, still, np.zeros(m.flexible.closed.n), 0.0
    residual, tangent = best(lambda: d.residual(*state), 50), best(lambda: d.tangent(*state), 10)
    counts = f"{kind} | {size} | {m.flexible.nv} | {m.flexible.expansion.model.nv}"
    times = f"{load:.2f} | {solve:.2f} | {read:.2f} | {residual:.0f} | {tangent:.0f}"
    return f"| {counts} | {times} | {lean:.0f} | {memory():.0f} |"


def main() -> None:
    most = int(sys.argv[1]) if len(sys.argv) > 1 else SIZES[-1]
    print("| | links | coordinates | expanded | load s | solve s | all arrays s | residual us "
          "| tangent us | MB solved | MB read |")  # fmt: skip
    print("|---" * 11 + "|", flush=True)
    sizes = [size for size in SIZES if size <= most]
    for kind, size in [*(("tree", n) for n in sizes), *(("serial", n) for n in sizes)]:
        subprocess.run(
            [sys.executable, "-m", "tests.benchmarks.growth", kind, str(size)], check=True
        )


if __name__ == "__main__":
    if len(sys.argv) == 3:
        print(row(sys.argv[1], int(sys.argv[2])), flush=True)
    else:
        main()
