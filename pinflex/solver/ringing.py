"""What holds a run by tolerance up: vibration far above the first modes that nothing damps."""

from __future__ import annotations

import numpy as np

from pinflex.integrators.run import Run
from pinflex.levels.modes import modes
from pinflex.solver.scene import Scene

_MANY = 500  # steps of a run that nobody wonders at
_ABOVE = 5.0  # times the third mode: what users mean by the vibration of their robot lies below
_RESOLVED = 2.5  # steps in the period of a vibration that collocation of six stages follows
_MODES = 200


def ringing(scene: Scene, run: Run) -> tuple[str, ...]:
    """A sentence where a run has taken many steps to follow undamped vibration, or nothing."""
    steps, span = run.cost.get("steps", 0.0), float(run.t[-1] - run.t[0])
    if steps < _MANY or not run.system.n_eta or np.any(run.system.D):
        return ()
    found = modes(scene.mechanism, count=_MODES, preload="none").frequencies
    alive = np.sort(found[found > 1.0 / span])
    followed = alive[alive < steps / (_RESOLVED * span)]
    if len(alive) < 3 or not len(followed) or followed[-1] < _ABOVE * alive[2]:
        return ()
    spared = "" if "torque" not in (scene.spec.asked or ("torque",)) else (
        " `solve.asked: [deflection, platform]` spares those steps that only torques need;"
    )  # fmt: skip
    woken = "" if run.settings.get("start") == "static" else " `solve.start: static` or"
    return (
        f"{steps:.0f} steps of {span / steps:.2g} s follow vibration up to about "
        f"{followed[-1]:.4g} Hz, which nothing damps (third mode: {alive[2]:.4g} Hz). If you do "
        "not need it, write `damping: {modal: 0.01}`, which lets it die (for one run: --set "
        f"'damping={{modal: 0.01}}');{spared}{woken} a smoother motion does not wake it.",
    )
