"""The run that a page is to make, by the native kernel: the same steps, each corrected twice."""

from __future__ import annotations

import numpy as np

from pinflex.actuation.drive import breaks
from pinflex.arrays import Array
from pinflex.browser.recipe import GRAIN, SLOW, TOGETHER, live_scene
from pinflex.integrators import march
from pinflex.integrators.problem import Run
from pinflex.levels.outputs import Outputs
from pinflex.mechanics.mechanism import Mechanism
from pinflex.solver.judge import Expected, Judge

PART = 0.5  # of the tolerance: the resolution of the steps of a page


class OfPage(Judge):
    def _slowest(self, h: float) -> float:
        return min(SLOW, super()._slowest(h))


def native_run(mechanism: Mechanism, t: Array) -> Run:
    """The run at samples t (s), in steps of the page's resolution, none of them sent back."""
    return _judged(mechanism, t)[0]


def corrections(mechanism: Mechanism, t: Array) -> tuple[Run, Run]:
    """The same run with its steps corrected once, and twice."""
    return _judged(mechanism, t)[1].runs()


def inside(mechanism: Mechanism, t: Array) -> Run:
    """The same run with accelerations that solve the equations at samples inside steps."""
    run, judge = _judged(mechanism, t)
    scene = live_scene(mechanism)
    return judge.inside(breaks(scene.motion, scene.equations().system.loads), run)(run)


def _judged(mechanism: Mechanism, t: Array) -> tuple[Run, Judge]:
    scene = live_scene(mechanism)
    tol, dynamics = scene.spec.tol or 1e-3, scene.equations()
    asked = Outputs(mechanism, scene.motion, t, ("torque", "deflection", "platform"), dynamics)
    judges = list[Judge]()

    def keeper(steps: march.Radau) -> Judge:
        steps.grain, steps.slow = GRAIN, SLOW
        judges.append(OfPage(steps, t, asked, Expected(0.0, {}), tol, PART * tol, True, False))
        return judges[-1]

    before = march.TOGETHER, march.MOST
    march.TOGETHER = march.MOST = TOGETHER
    try:
        run = scene.kept(t, PART * tol, keeper, march.SHORT, 0.0, None, judge=dynamics)
    finally:
        march.TOGETHER, march.MOST = before
    return run, judges[-1]


def apart(found: object, wanted: Array) -> float:
    """Largest difference of two histories over the largest value of the second."""
    wanted = np.asarray(wanted, float)
    away = np.abs(np.asarray(found, float).reshape(wanted.shape) - wanted)
    return float(away.max() / np.abs(wanted).max())
