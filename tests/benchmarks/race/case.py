"""One pinflex run of a race scene, timed: `python -m tests.benchmarks.race.case MODEL OUT.npz
METHOD VALUE ASKED [KEY=VALUE ...]`.

METHOD is tol, radau (VALUE: its resolution) or alpha (VALUE: its step in s); ASKED: what tol is
about, such as torque,platform. Prints one JSON
object: wall and CPU seconds of the march, its set-up included, but neither loading nor recovery,
and the share of it that the compiled kernel takes.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from pinflex.actuation.drive import nominal
from pinflex.arrays import Array
from pinflex.integrators.problem import Run
from pinflex.kernel import library
from pinflex.kernel.library import kernel
from pinflex.levels.outputs import platform_poses
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.recovery.recover import recover
from pinflex.solver.scene import Scene
from pinflex.solver.solve import default_motion
from pinflex.solver.tolerance import solve_to_tolerance
from pinflex.threads import one_blas_thread

SAMPLES = 401
_PILOT = 1e-3
Arrays = dict[str, Array]


@dataclass(frozen=True)
class Timed:
    """A run and what it took.

    Attributes:
        run: States. wall, cpu: Seconds of the march.
    """

    run: Run
    wall: float
    cpu: float


def scene(model: str | Mechanism, asked: tuple[str, ...] = ()) -> Scene:
    """The coupled level of a model, its motion and what a tolerance is about."""
    m = load(model) if isinstance(model, str) else model
    spec = replace(m.description.solve, level="coupled", tol=None, dt=None, asked=asked)
    return Scene(m, default_motion(m), spec, m.description.control)


def march(scene: Scene, method: str, value: float, samples: int = SAMPLES) -> Timed:
    """Solve by tol, radau, careful (radau that resolves its start too) or alpha, and time it."""
    end = scene.spec.until or scene.motion.duration
    t = np.linspace(0.0, end, samples)
    ways: dict[str, Callable[[], Run]] = {
        "tol": lambda: solve_to_tolerance(scene, t, value),
        "radau": lambda: scene.resolved(t, value, pilot=True),
        "careful": lambda: _careful(scene, t, value),
        "alpha": lambda: scene.stepped(t, value),
    }
    solve = ways[method]
    wall, cpu = time.perf_counter(), time.process_time()
    run = solve()
    return Timed(run, time.perf_counter() - wall, time.process_time() - cpu)


def _careful(scene: Scene, t: Array, resolution: float) -> Run:
    """After a pilot, which tells the scale: a run that knows it begins with short steps."""
    pilot = scene.resolved(t, max(_PILOT, resolution), pilot=True)
    return scene.resolved(t, resolution, coarser=pilot)


def kernel_share(scene: Scene, method: str, value: float) -> float:
    """Share of the CPU time of a march that the functions of the kernel take."""
    with _timed_kernel() as spent:
        cpu = march(scene, method, value).cpu
    return sum(spent) / cpu


@contextmanager
def _timed_kernel() -> Iterator[list[float]]:
    """CPU seconds of each call of the kernel, while it lasts."""
    spent: list[float] = []
    functions = kernel().functions
    plain = (
        {name: getattr(functions, name) for name in library.header_functions()} if functions else {}
    )

    def timed(function: Callable[..., object]) -> Callable[..., object]:
        def call(*args: object) -> object:
            start = time.thread_time()
            try:
                return function(*args)
            finally:
                spent.append(time.thread_time() - start)

        return call

    try:
        for name, function in plain.items():
            setattr(functions, name, timed(function))
        yield spent
    finally:
        for name, function in plain.items():
            setattr(functions, name, function)


def outputs(scene: Scene, run: Run) -> Arrays:
    """Torques, platform pose and the rigid one; if asked for deflection, that of the links."""
    m = scene.mechanism
    position, rotation = platform_poses(m, Equations(run.system), run.y)
    rigid = platform_poses(m, Equations(m.rigid), nominal(m, scene.motion, run.t).q)
    found = {
        "torque": run.torque,
        "position": position,
        "rotation": rotation,
        "rigid_position": rigid[0],
        "rigid_rotation": rigid[1],
    }
    if "deflection" in scene.spec.asked:
        found["middle"] = _middles(m, run)
    return found


def _middles(m: Mechanism, run: Run) -> Array:
    """Distance (m) of the middle of every flexible link from its chord, in the plane z = 0."""
    arrays = recover(m, run, None)
    away = []
    for name in m.parts:
        x, line = arrays[f"link/{name}/x"], arrays[f"link/{name}/centreline"]
        chord = line[:, -1] - line[:, 0]
        middle = line[:, np.argmin(np.abs(x - 0.5 * x[-1]))] - line[:, 0]
        across = np.cross(chord, middle)[:, 2]
        away.append(across / np.linalg.norm(chord, axis=1))
    return np.stack(away, axis=1)


def main(argv: Sequence[str]) -> None:
    """Run twice: the first also pays for imports that only it needs."""
    model, out, method, value, asked, *overrides = argv
    given = scene(load(model, overrides), tuple(asked.split(",")))
    with one_blas_thread():
        first = march(given, method, float(value))
        best = march(given, method, float(value))
        share = kernel_share(given, method, float(value))
    np.savez(out, **outputs(given, best.run))  # type: ignore[arg-type]
    cost = {"wall": best.wall, "cpu": best.cpu, "steps": best.run.cost["steps"], "kernel": share}
    print(json.dumps({**cost, "first_wall": first.wall, "first_cpu": first.cpu}))


if __name__ == "__main__":
    main(sys.argv[1:])
