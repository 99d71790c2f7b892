"""Residual vibration after a motion: amplitude about the rest, and settling time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.results.result import Result

BAND = 50e-6  # [m] a usual demand on the repeatability of handling robots
_LEAST = 8  # instants after the stop that a vibration can be read from
_STILL = 1e-9  # a rigid frame that moves by less of its way after the stop is at rest


@dataclass(frozen=True)
class Residual:
    """Vibration of a frame after the rigid motion has stopped.

    Attributes:
        amplitude: Largest distance of the frame from where it comes to rest [m].
        settling: Time after the stop from which on it stays within the band [s]; None: not
            within this run.
    """

    amplitude: float
    settling: float | None


def stops(rigid: Result, frame: str, stop: float) -> bool:
    """True if the rigid frame rests from the instant `stop` [s] to the end, long enough to read."""
    after = rigid.t >= stop * (1 - 1e-9)
    place = rigid.frame(frame).position
    way = float(np.ptp(place, axis=0).max(initial=0.0))
    moved = float(np.ptp(place[after], axis=0).max(initial=0.0)) if after.any() else 0.0
    return bool(np.count_nonzero(after) >= _LEAST and moved <= _STILL * way)


def residual(
    t: Array,
    away: Array,
    stop: float,
    band: float,
    rest: Array | None = None,
    period: float = 0.0,
) -> Residual:
    """Amplitude about the rest and settling time of a deviation."""
    after = t >= stop * (1 - 1e-9)
    t, away = t[after], away[after]
    if rest is None:
        weights = np.hanning(len(t) + 2)[1:-1]
        rest = weights @ away / weights.sum()
    distance = np.linalg.norm(away - rest, axis=1)
    amplitude, beyond = float(distance.max()), np.flatnonzero(distance > band)
    if not len(beyond):
        return Residual(amplitude, 0.0)
    k = int(beyond[-1])
    if k == len(t) - 1 or t[-1] - t[k] < period / 2:
        return Residual(amplitude, None)
    share = (distance[k] - band) / (distance[k] - distance[k + 1])
    return Residual(amplitude, float(t[k] + share * (t[k + 1] - t[k]) - stop))
