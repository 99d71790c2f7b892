"""Estimated errors of runs within a tolerance, and the least that can be told."""

from __future__ import annotations

import numpy as np

from pinflex.errors import ConvergenceError
from pinflex.integrators.run import Run
from pinflex.solver.scene import Scene


def errors(run: Run) -> dict[str, float]:
    """Estimated error by output of a run within a tolerance."""
    found = run.settings["error"]
    assert isinstance(found, dict)
    return found


def floor(scene: Scene, tol: float, last: Run, worst: float | None = None) -> ConvergenceError:
    """The error of a tolerance below what round-off lets a run tell."""
    told = 2.0 * (max(errors(last).values(), default=0.0) if worst is None else worst)
    least = f"{10.0 ** (np.ceil(10.0 * np.log10(max(told, 1e-300))) / 10.0):.2g}"
    failed = ConvergenceError(
        f"{scene.mechanism.name}: tol = {tol:g} is below what can be told here: shorter steps show "
        f"only round-off. The floor of this scene is about tol = {least}: give that or more. "
        "error.result holds the best run."
    )
    failed.result = last
    return failed
