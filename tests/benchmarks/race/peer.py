"""One race scene in Exudyn, in a process of its own: `python peer.py r2 OUT.npz links=2 steps=800`.

Writes the outputs at 401 equal samples and prints one JSON object: wall and CPU seconds of the
solver call alone, CPU seconds of the process, steps and Newton iterations. One thread.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
import warnings
from dataclasses import dataclass, fields
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.exudynFast = True  # type: ignore[attr-defined]  # its build without range checks
warnings.simplefilter("ignore")

import exudyn as exu  # noqa: E402
import numpy as np  # noqa: E402

SAMPLES = 400  # intervals; steps have to be a multiple of it
exu.SetWriteToConsole(False)


@dataclass(frozen=True)
class Settings:
    """What is tuned by hand, scene by scene.

    Attributes:
        elements: Elements, or modal bodies, of a link.
        steps: Number of steps.
        atol, rtol: Absolute and relative tolerance of Newton.
        full: Newton with a tangent in every iteration, dense, in place of modified Newton, sparse.
        stretch: Modal bodies stretch (R2).
    """

    elements: int = 4
    steps: int = 2000
    atol: float = 1e-5
    rtol: float = 1e-8
    full: bool = False
    stretch: bool = True


def cycloid(t: Any, duration: float, sin: Any, least: Any) -> Any:
    """s(t) of the race scenes, for numpy and for Exudyn's symbolic functions."""
    u = least(t * (1.0 / duration), 1.0)
    return u - sin(2 * np.pi * u) * (1.0 / (2 * np.pi))


def drive(mbs: Any, constraint: int, law: Any) -> None:
    """Let a coordinate constraint follow law(t, offset), evaluated in C++."""

    def offset(mbs: Any, t: Any, itemNumber: Any, lOffset: Any) -> Any:
        return law(t, lOffset)

    from exudyn.utilities import CreateSymbolicUserFunction

    symbolic = CreateSymbolicUserFunction(mbs, offset, "offsetUserFunction", constraint)
    mbs.SetObjectParameter(constraint, "offsetUserFunction", symbolic)


def march(mbs: Any, end: float, settings: Settings) -> dict[str, float]:
    """Assemble and solve by generalized-alpha (rho 0.9); times the solver call only."""
    mbs.Assemble()
    s = exu.SimulationSettings()
    march = s.timeIntegration
    march.endTime, march.numberOfSteps, march.verboseMode = end, settings.steps, 0
    march.generalizedAlpha.spectralRadius = 0.9
    march.generalizedAlpha.computeInitialAccelerations = True
    newton = march.newton
    newton.useModifiedNewton = not settings.full
    newton.relativeTolerance, newton.absoluteTolerance = settings.rtol, settings.atol
    march.adaptiveStep = False
    solver = exu.LinearSolverType.EigenDense if settings.full else exu.LinearSolverType.EigenSparse
    s.linearSolverType = solver
    s.parallel.numberOfThreads = 1
    s.solutionSettings.writeSolutionToFile = False
    s.solutionSettings.sensorsWritePeriod = end / SAMPLES
    wall, cpu = time.perf_counter(), time.process_time()
    mbs.SolveDynamic(s, storeSolver=True)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    done = mbs.sys["dynamicSolver"].it
    return {"wall": wall, "cpu": cpu, "newton": int(done.newtonStepsCount)}


def samples(mbs: Any, sensor: int, end: float) -> np.ndarray:
    """What a sensor stored at the common samples, shape (401, n)."""
    stored = np.asarray(mbs.GetSensorStoredData(sensor))
    t = np.linspace(0.0, end, SAMPLES + 1)
    at = np.clip(np.searchsorted(stored[:, 0], t - 1e-9 * end), 0, len(stored) - 1)
    if np.abs(stored[at, 0] - t).max() > 1e-6 * end:
        raise SystemExit("peer: the samples are not among the steps: take a multiple of 400 steps")
    return stored[at, 1:]


def main() -> None:
    scene, out, *changes = sys.argv[1:]
    kinds = {f.name: type(f.default) for f in fields(Settings)}
    pairs = [change.split("=") for change in changes]
    given = {k: v == "True" if kinds[k] is bool else kinds[k](v) for k, v in pairs}
    settings = Settings(**given)
    arrays, cost = importlib.import_module(f"peer_{scene}").run(settings)
    np.savez(out, **arrays)
    cost["process"] = time.process_time()
    print(json.dumps({**cost, "steps": settings.steps, "version": exu.__version__}))


if __name__ == "__main__":
    main()
