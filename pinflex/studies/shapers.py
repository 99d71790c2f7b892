"""Input shapers side by side: the time that each costs, and what a wrong frequency leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.actuation.motors import plain_motion
from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.description.motions.shaping import KINDS, MODES, TOLERATED, Shaper, shaper
from pinflex.levels.modes import Ringing, ringing
from pinflex.mechanics.mechanism import Mechanism
from pinflex.text import brief

ERRORS = (-0.2, -0.1, -0.05, 0.0, 0.05, 0.1, 0.2)  # of the frequency [-]
_FINE = np.linspace(-0.5, 0.5, 10001)


@dataclass(frozen=True)
class ShaperRow:
    """One shaper for the vibrations of a motion.

    Attributes:
        kind: zv, zvd or ei.
        time: By how much the motion gets longer [s].
        residual: Largest vibration left of a mode whose frequency is off by `ERRORS`, over that
            without a shaper [-], shape (errors,).
        along: The same where the frequency moves along the motion [-].
        width: Range of the frequency error in which at most 5 % is left [-].
    """

    __repr__ = brief

    kind: str
    time: float
    residual: Array
    along: float
    width: float


def shapers(
    mechanism: Mechanism, motion: Motion | None = None, modes: int = MODES
) -> tuple[Ringing, tuple[ShaperRow, ...]]:
    """What ZV, ZVD and EI would do for the vibrations that a motion excites."""
    found = ringing(mechanism, plain_motion(mechanism) if motion is None else motion, modes)
    return found, tuple(_row(kind, found) for kind in KINDS)


def _row(kind: str, found: Ringing) -> ShaperRow:
    made = shaper(kind, found.frequencies.tolist(), found.damping.tolist())
    left = _left(made, found, np.array(ERRORS))
    low, high = found.low / found.frequencies - 1.0, found.high / found.frequencies - 1.0
    ends = [_left(made, found, np.array([e]), k)[0] for k, x in enumerate(zip(low, high,
            strict=True)) for e in x]  # fmt: skip
    good = _left(made, found, _FINE) <= TOLERATED + 1e-9
    return ShaperRow(kind, made.duration, left, max(ends), float(np.mean(good)))


def _left(made: Shaper, found: Ringing, errors: Array, only: int | None = None) -> Array:
    """Largest residual of the modes (or of one) with their frequencies off, shape (errors,)."""
    each = [
        made.residual(f * (1.0 + errors), float(z))
        for k, (f, z) in enumerate(zip(found.frequencies, found.damping, strict=True))
        if only in (None, k)
    ]
    return np.asarray(np.max(each, axis=0))
