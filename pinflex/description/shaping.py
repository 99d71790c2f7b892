"""Input shapers: a motion convolved with a few impulses so that chosen vibrations cancel.

Source: Singer, Seering (1990), ZV and ZVD; Singhose, Seering, Singer (1994), EI with its fit for
damped systems; Singhose (2009) for all three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pinflex.arrays import Array
from pinflex.description.laws import Kinematics
from pinflex.description.motion import Motion
from pinflex.errors import DescriptionError, nearest

KINDS = ("zv", "zvd", "ei")
TOLERATED = 0.05  # residual vibration that EI leaves at the frequency it is made for


@dataclass(frozen=True)
class Shaper:
    """Impulses: times [s], shape (n,), the first 0; and their shares, shape (n,), of sum 1."""

    times: Array
    shares: Array

    @property
    def duration(self) -> float:
        """By how much a motion gets longer [s]."""
        return float(self.times[-1])

    def residual(self, frequency: Array | float, damping: float = 0.0) -> Array:
        """Vibration after the last impulse over that after one impulse, by frequency [Hz]."""
        omega = 2.0 * np.pi * np.atleast_1d(np.asarray(frequency, float))[:, None]
        damped = omega * np.sqrt(1.0 - damping**2)
        size = self.shares * np.exp(-damping * omega * (self.duration - self.times))
        phase = damped * self.times
        return np.asarray(np.hypot((size * np.cos(phase)).sum(1), (size * np.sin(phase)).sum(1)))


def shaper(kind: str, frequencies: Sequence[float] | float, damping: float = 0.0) -> Shaper:
    """The shaper that cancels vibrations at the frequencies [Hz] with a damping ratio [-].

    Args:
        kind: "zv": zero vibration; half a period longer for each frequency. "zvd": its derivative
            by frequency is zero too; a period longer. "ei": 5 % vibration at the frequency itself,
            and the widest range with less; a period longer.
        frequencies: One or more [Hz]; their shapers are convolved.
        damping: Ratio of all of them, 0 to below 1.
    Raises:
        DescriptionError: An unknown kind, a frequency or damping that makes no sense.
    """
    if kind not in KINDS:
        raise DescriptionError(f"shaper: {kind}.{nearest(kind, KINDS)}")
    every = np.atleast_1d(np.asarray(frequencies, float))
    if not len(every) or not np.all((every > 0.0) & np.isfinite(every)):
        raise DescriptionError(f"shaper: frequencies {every.tolist()}. Give numbers above 0 Hz.")
    if not 0.0 <= damping < 1.0:
        raise DescriptionError(f"shaper: damping {damping}. Give a ratio from 0 to below 1.")
    times, shares = np.zeros(1), np.ones(1)
    for frequency in every:
        t, part = _impulses(kind, float(frequency), damping)
        times = np.add.outer(times, t).ravel()
        shares = np.multiply.outer(shares, part).ravel()
    order = np.argsort(times, kind="stable")
    return Shaper(times[order], shares[order])


def _impulses(kind: str, frequency: float, zeta: float) -> tuple[Array, Array]:
    period = 1.0 / (frequency * np.sqrt(1.0 - zeta**2))
    K = np.exp(-zeta * np.pi / np.sqrt(1.0 - zeta**2))
    if kind == "zv":
        return period * np.array([0.0, 0.5]), np.array([1.0, K]) / (1.0 + K)
    if kind == "zvd":
        return period * np.array([0.0, 0.5, 1.0]), np.array([1.0, 2.0 * K, K**2]) / (1.0 + K) ** 2
    V, z = TOLERATED, zeta
    if z == 0.0:
        return period * np.array([0.0, 0.5, 1.0]), np.array([1 + V, 2 - 2 * V, 1 + V]) / 4.0
    first = 0.24968 + 0.24961 * V + 0.80008 * z + 1.23328 * V * z
    first += 0.49599 * z**2 + 3.17316 * V * z**2
    last = 0.25149 + 0.21474 * V - 0.83249 * z + 1.41498 * V * z
    last += 0.85181 * z**2 - 4.90094 * V * z**2
    middle = 0.49990 + 0.46159 * V * z + 4.26169 * V * z**2 + 1.75601 * V * z**3
    middle += V**2 * (8.57843 * z - 108.644 * z**2 + 336.989 * z**3)
    return period * np.array([0.0, middle, 1.0]), np.array([first, 1.0 - first - last, last])


def shaped(
    motion: Motion, kind: str, frequencies: Sequence[float] | float, damping: float = 0.0
) -> Motion:
    """The motion convolved with a shaper; it ends later by the shaper's duration.

    Args:
        motion: Of joints or of the platform: those coordinates are shaped.
        kind, frequencies, damping: As in `shaper`.
    """
    made = shaper(kind, frequencies, damping)
    law = partial(_convolved, motion, made)
    spec = dict(motion.spec) | {
        "shaper": {"kind": kind, "frequencies": np.atleast_1d(frequencies).tolist(),
                   "damping": damping}
    }  # fmt: skip
    return replace(motion, duration=motion.duration + made.duration, law=law, spec=spec)


def _convolved(motion: Motion, made: Shaper, t: Array) -> Kinematics:
    total = [np.zeros((len(t), len(motion.names))) for _ in range(3)]
    for late, share in zip(made.times, made.shares, strict=True):
        for sum_, part in zip(total, motion.evaluate(t - late), strict=True):
            sum_ += share * part
    return total[0], total[1], total[2]
