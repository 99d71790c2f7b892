"""The quasistatic command: an asymptotic series in (elastic period / time of the motion)^2.

The pose that balances the rigid motion's inertia forces is differentiated in time, and balanced
again with its own rates; every pass gains that factor until the series diverges. Of its passes the
one with the smallest error of the platform is taken, which is what the forces that it leaves open
do to the mechanism (`pinflex.inversion.forward`), vibration included.

Source: Seifried (2014), ch. 6 (quasi-static approximation), taken further by iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.inversion.differences import EIGHTH, padded, rates
from pinflex.inversion.forward import Forward
from pinflex.inversion.instant import Balanced, Instant, balanced

_PASSES = 8
_ENOUGH = 1e-9  # m or rad: a smaller error is below what the differences resolve


@dataclass(frozen=True)
class Series:
    """The passes of a quasistatic command.

    Attributes:
        found: The pass with the smallest error.
        error: Bar on its platform coordinates [m | rad], shape (k,).
        changes: Largest change of a motor position from pass to pass [m | rad].
    """

    found: Balanced
    error: Array
    changes: tuple[float, ...]


def rigid_guess(instant: Instant) -> tuple[Balanced, Array, Array]:
    """The undeformed mechanism on the path, and its v and a."""
    path, system = instant.target.path, instant.system
    nt, n = len(path.t), path.v.shape[1]
    v, a = np.zeros((nt, system.nv)), np.zeros((nt, system.nv))
    v[:, :n], a[:, :n] = path.v, path.a
    lam = np.zeros((nt, instant.rows))
    torque = np.zeros((nt, len(system.motors)))
    return Balanced(path.straight(system.n_eta), lam, torque), v, a


def series(instant: Instant, kept: slice = slice(None)) -> Series:
    """Balance along the path, again and again, until the platform's error grows."""
    guess, v, a = rigid_guess(instant)
    h = float(instant.target.t[1] - instant.target.t[0])
    last = balanced(instant, guess, v, a)
    forward, by_platform = Forward(instant, last), np.linalg.pinv(instant.target.gain[0])
    best, smallest, changes = last, np.inf, list[float]()
    bar = np.full(len(instant.target.names), np.inf)
    for _ in range(_PASSES):
        error = forward.platform_error(last, kept)
        size = float(np.max(np.abs(by_platform) @ error))  # in the motors' units: one for all
        if size < smallest:
            best, bar = last, error
        if not _ENOUGH < size < smallest:
            break
        smallest = size
        v, a = rates(instant.dynamics, padded(last.y, EIGHTH.reach), h, EIGHTH)
        try:
            following = balanced(instant, last, v, a)
        except ConvergenceError:
            break
        moved = instant.axes.read(following.y) - instant.axes.read(last.y)
        changes.append(float(np.max(np.abs(moved))))
        last = following
    return Series(best, bar, tuple(changes))
