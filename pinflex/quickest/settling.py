"""How long a platform shakes after a motion, by a coupled run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.error_bars import time_error
from pinflex.results.result import Result, peak

_EQUAL = 16000, 32000
_WATCHED = 6.0  # longest periods after the end
_SAMPLES = 24  # a period: what lies between is 1 % higher at the most


@dataclass(frozen=True)
class Settled:
    """A run, and when it is still.

    Attributes:
        time: From which the platform stays within the band, of what the run shows [s].
        residual: Largest distance from rest after the end [m]. bar: What that may be wrong by.
        run: It.
    """

    time: float
    residual: float
    bar: float
    run: Result


def settled(
    mechanism: Mechanism, motion: Motion, rest: Array, band: float, end: float, period: float,
    tol: float, until: float | None = None, how: Mapping[str, Any] | None = None,
) -> Settled:  # fmt: skip
    """Run a motion that ends at `end` [s], `how` as `solve` takes it, and watch the platform."""
    until = until or end + _WATCHED * period
    samples = int(np.clip(_SAMPLES * until / period, 1200, 6000)) + 1
    told: dict[str, Any] = {"until": until, "samples": samples, "level": "coupled"}
    told |= how or {}
    try:
        run = solve(mechanism, motion, tol=tol, **told)
        wrong, half = time_error(run.meta.get("settings", {}), run.level)[0], None
    except ConvergenceError:  # jumps of an acceleration: steps that end there, and twice as many
        half, run = (solve(mechanism, motion, dt=end / steps, **told) for steps in _EQUAL)
        wrong = {}
    frame = str(mechanism.description.platform)
    away = np.linalg.norm(run.frame(frame).position - rest, axis=1)
    out = np.flatnonzero(away > band)
    last = int(out[-1]) + 1 if len(out) else 0
    time = float(run.t[last]) if last < len(run.t) else np.inf
    after = away[run.t >= end * (1.0 - 1e-12)]
    if half is None:
        rigid = solve(mechanism, motion, level="rigid", until=until, samples=samples)
        bar = wrong.get("platform position", 0.0) * peak(run.deviation_from(rigid, frame).norm)
    else:
        bar = peak(run.deviation_from(half, frame).norm)
    return Settled(time, float(after.max(initial=0.0)), float(bar), run)
