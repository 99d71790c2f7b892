"""Cost against the number of flexible links: `python tests/benchmarks/growth.py [MOST]`.

A tree: chains of two links in a row on one base. Loops: four-bars side by side, three links each.
All links bend in the plane. Prints coordinates, microseconds of a residual, of a tangent and of a
step of the coupled level, milliseconds of a whole `solve` of one step, and gigabytes of Pinocchio's
workspace. One thread.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
import time

import numpy as np

import pinflex as pf
from pinflex.actuation.drive import motor_path
from pinflex.integrators.equal_steps import integrate
from pinflex.lab.scene import Body, scene
from pinflex.levels.start import straight_start
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.workspace import size
from pinflex.solver.solve import default_motion

FLEXIBLE = """
flexible:
  "l*":
    material: {{E: 7.0e10, nu: 0.3, rho: 2700}}
    section: {{shape: rectangle, width: 0.02, thickness: 0.004}}
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
    return scene("tree", bodies, FLEXIBLE.format(moves=moves))


def loops(links: int) -> Mechanism:
    """Four-bars of three links, a crank of each a motor."""
    bodies, names, closures, motors = [], [], [], []
    for k in range(max(links // 3, 1)):
        y = 0.5 * k
        bodies += [
            Body(f"a{k}", "base", "revolute", xyz=(0, y, 0), rpy=(0, 0, 1.2)),
            Body(f"b{k}", f"a{k}", "revolute", xyz=(0.2, 0, 0), rpy=(0, 0, -1.2)),
            Body(f"e{k}", f"b{k}", xyz=(0.3, 0, 0)),
            Body(f"c{k}", "base", "revolute", xyz=(0.3, y, 0), rpy=(0, 0, 1.2)),
            Body(f"f{k}", f"c{k}", xyz=(0.2, 0, 0)),
        ]
        names += [f"{one}{k}" for one in "abc"]
        closures.append(f"  pin{k}: {{kind: planar, between: [e{k}, f{k}]}}")
        motors.append(f"a{k}_joint")
    yaml = f"actuated: [{', '.join(motors)}]\nloops:\n" + "\n".join(closures)
    moves = ", ".join(f"{name}: 0.3" for name in motors)
    return scene("loops", bodies, yaml + FLEXIBLE.format(moves=moves))


def best(call: object, repeats: int) -> float:
    """Microseconds of the fastest call."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()  # type: ignore[operator]
        times.append(time.perf_counter() - began)
    return 1e6 * min(times)


def row(kind: str, m: Mechanism) -> str:
    residual, tangent, step = parts(m)
    began = time.perf_counter()
    pf.solve(m, level="coupled", until=1e-3, dt=1e-3, samples=2)
    whole = 1e3 * (time.perf_counter() - began)
    counts = f"{len(m.parts)} | {m.flexible.nv} | {m.flexible.expansion.model.nv}"
    memory = size(m.flexible.expansion.model) / 1e9
    cells = f"{residual:.0f} | {tangent:.0f} | {step:.0f} | {whole:.0f} | {memory:.2f}"
    return f"| {kind} | {counts} | {cells} |"


def parts(m: Mechanism) -> tuple[float, float, float]:
    """Microseconds of a residual, a tangent and a step; its workspace then serves the next run."""
    d = Equations(m.flexible)
    y, v = m.undeformed(), np.zeros(m.flexible.nv)
    lam = np.zeros(m.flexible.closed.n)
    repeats = max(40, 20000 // m.flexible.nv)
    return (
        best(lambda: d.residual(y, v, v, lam, 0.0).r, repeats),
        best(lambda: d.iteration_matrix(y, v, v, lam, 0.0, (1.0, 0.0, 1.0)), repeats // 20),
        1e6 * march(m, d, 500) / 500,
    )


def march(m: Mechanism, d: Equations, steps: int) -> float:
    """Seconds of steps of 0.2 ms."""
    motion = default_motion(m)
    path = motor_path(m, motion, 2e-4 * np.arange(steps + 1))
    start = straight_start(m, motion, path, d)
    began = time.perf_counter()
    integrate(m, d, start, path, pf.generalized_alpha())
    return time.perf_counter() - began


def main() -> None:
    most = int(sys.argv[1]) if len(sys.argv) > 1 else 24
    print(
        "| | links | coordinates | expanded | residual us | tangent us | step us | solve ms | GB |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for links in (1, 2, 4, 8, 16, 24, 32, 64):
        if links <= most:
            print(row("tree", tree(links)), flush=True)
    for links in (3, 6, 12, 24, 48):
        if links <= most:
            print(row("loops", loops(links)), flush=True)


if __name__ == "__main__":
    main()
