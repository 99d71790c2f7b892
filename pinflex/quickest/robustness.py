"""What a motion does where payload, stiffness or friction are not those that it was made for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.advice.solve import solve
from pinflex.description.motions.motion import Motion
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.quickest.variants import KINDS, varied

_SHARE = 0.05
_TOL = 1e-4  # of the runs
_SAMPLES = 801


@dataclass(frozen=True)
class Off:
    """One robot that is off.

    Attributes:
        what: In words, such as "payload +5 %".
        error: Largest distance of its platform from that of the nominal robot, at any time [m].
        shake: Largest peak-to-peak motion of it along an axis after the end [m].
    """

    what: str
    error: float
    shake: float


def robustness(
    mechanism: Mechanism, motion: Motion, until: float, end: float, share: float = _SHARE
) -> tuple[Off, ...]:
    """Runs of the nominal robot and of those that are off by a share, both ways.

    Quantities that the model does not have are left out.
    """
    frame = str(mechanism.description.platform)

    def place(model: Mechanism) -> tuple[np.ndarray, np.ndarray]:
        run = solve(model, motion, level="coupled", start="static", tol=_TOL, until=until,
                    samples=_SAMPLES)  # fmt: skip
        return run.frame(frame).position, run.t >= end

    nominal, after = place(mechanism)
    rows = [Off("nothing", 0.0, float(np.ptp(nominal[after], axis=0).max()))]
    for kind in KINDS:
        for sign in (-1.0, 1.0):
            try:
                model = varied(mechanism, kind, 1.0 + sign * share)
            except DescriptionError:
                continue  # the model says no such number
            found, _ = place(model)
            error = float(np.linalg.norm(found - nominal, axis=1).max())
            what = f"{kind} {100 * sign * share:+.0f} %"
            rows.append(Off(what, error, float(np.ptp(found[after], axis=0).max())))
    return tuple(rows)
