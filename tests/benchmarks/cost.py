"""What pinflex costs on this machine: `python tests/benchmarks/cost.py`. One thread, best of five.

Prints import time, rigid inverse dynamics against bare Pinocchio, loading, the browser's page, and
one step of the coupled level on the race scenes, with the limits the project holds itself to on a
2-core machine.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import pinocchio as pin

import pinflex as pf
from pinflex.actuation.drive import motor_path
from pinflex.description.motions.motion import from_spec
from pinflex.integrators.equal_steps import integrate
from pinflex.levels.start import straight_start
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.viewer.view import write_html


def best(call: Callable[[], object], repeats: int = 5) -> float:
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return min(times)


def import_time() -> float:
    """Seconds of `import pinflex` in a fresh interpreter."""
    code = "import time; t = time.perf_counter(); import pinflex; print(time.perf_counter() - t)"
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
            for _ in range(5)]  # fmt: skip
    return min(float(run.stdout) for run in runs)


def rigid_ratio(instants: int = 5000) -> tuple[float, float]:
    """Microseconds an instant of bare Pinocchio, and of `pinflex.inverse_dynamics`."""
    robot = pf.load("ur5", ["solve.start=straight"])
    model, data = robot.rigid.rigid, robot.rigid.rigid.createData()
    rng = np.random.default_rng(0)
    q, v, a = (rng.normal(size=(instants, model.nv)) for _ in range(3))

    def bare() -> None:
        for k in range(instants):
            pin.rnea(model, data, q[k], v[k], a[k])

    ours = best(lambda: pf.inverse_dynamics(robot, q, v, a))
    return 1e6 * best(bare) / instants, 1e6 * ours / instants


def coupled_step(name: str, steps: int) -> tuple[float, dict[str, float], int]:
    """Microseconds a step of the coupled level, its counts, and its number of coordinates."""
    robot = pf.load(name)
    motion = from_spec(robot.description.motion, name)
    t = np.linspace(0.0, robot.description.solve.until, steps + 1)
    dynamics, path = Equations(robot.flexible), motor_path(robot, motion, t)
    start = straight_start(robot, motion, path, dynamics)
    scheme = pf.generalized_alpha()
    run = integrate(robot, dynamics, start, path, scheme)
    seconds = best(lambda: integrate(robot, dynamics, start, path, scheme))
    return 1e6 * seconds / steps, run.cost, robot.flexible.nv


def page_time(instants: int = 1200) -> float:
    """Seconds to write the page of a run."""
    run = pf.solve(pf.load("race_r2"), level="quasistatic", samples=instants)
    with tempfile.TemporaryDirectory() as folder:
        return best(lambda: write_html(run, Path(folder) / "run.html"))


def load_time(name: str) -> float:
    """Seconds to read a model and build its flexible links."""
    return best(lambda: pf.load(name))


def main() -> None:
    print(f"{'what':46s} {'measured':>12s} {'limit':>10s}")
    print(f"{'import pinflex':46s} {import_time():10.2f} s {'0.5 s':>10s}")
    bare, ours = rigid_ratio()
    print(f"{'rigid inverse dynamics, Pinocchio alone (UR5)':46s} {bare:9.2f} us")
    print(f"{'rigid inverse dynamics, pinflex (UR5)':46s} {ours:9.2f} us {1.5 * bare:7.2f} us")
    print(f"{'load 3rrs, six flexible links':46s} {load_time('3rrs'):10.2f} s {'0.5 s':>10s}")
    print(f"{'page of race_r2, 1200 instants':46s} {page_time():10.2f} s {'1 s':>10s}")
    for name, steps, limit in (("race_r1", 2000, 150), ("race_r2", 1600, 250)):
        step, counts, n = coupled_step(name, steps)
        what = f"coupled step of {name}, {n} coordinates"
        print(f"{what:46s} {step:9.0f} us {limit:7d} us   "
              f"({counts['newton'] / steps:.2f} Newton iterations, "
              f"{counts['tangents']:.0f} tangents in {steps} steps)")  # fmt: skip


if __name__ == "__main__":
    main()
