"""How many instants an exact command needs: from the modes that ring after the motion.

Where the fifth derivative of a motion jumps, as at the ends of a nonic, a mode of frequency f is
left with a swing like f^-5. Differences of order 8 that are h apart see its inertia with a relative
error e(2 pi f h), and a command leaves that share of its swing. Each of n modes may leave an n-th
part of the share wanted of what the first one swings with the rigid command:

    e(2 pi f h) (f_1 / f)^5 <= 1e-4 / n
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.inversion.differences import EIGHTH
from pinflex.levels.modes import modes
from pinflex.mechanics.mechanism import Mechanism

_SHARE = 1e-4  # of the rigid command's swing
_CORNER = 5  # power of the frequency: the derivative of the motion that jumps
_FAST = 70.0  # periods in the motion, beyond which its ends leave 1e-9 of the way: none to lower
_LEAST = 150  # instants over the motion


def instants_over(mechanism: Mechanism, duration: float) -> int:
    """Instants over a motion of some duration [s]."""
    found = modes(mechanism, count=mechanism.flexible.nv).frequencies
    f = found[(found > 0.0) & (found * duration < _FAST)]
    if not len(f):
        return _LEAST
    share = (f[0] / f) ** _CORNER
    allowed = _SHARE / np.sum(share > _SHARE) / share
    phase = np.linspace(0.0, np.pi, 721)[1:]
    missed = np.abs(_second(phase) / phase**2 - 1.0)  # grows with the phase
    longest = np.interp(allowed, missed, phase, right=np.inf) / (2.0 * np.pi * f)
    return max(_LEAST, int(np.ceil(duration / float(np.min(longest)))))


def _second(phase: Array) -> Array:
    """Square of a rate (phase per instant) as differences of order 8 see it."""
    reach = np.arange(-EIGHTH.reach, EIGHTH.reach + 1)
    return np.asarray(-np.cos(np.outer(phase, reach)) @ EIGHTH.second)
