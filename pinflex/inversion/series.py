"""The quasistatic command: an asymptotic series in (elastic period / time of the motion)^2.

The pose that balances the rigid motion's inertia forces is differentiated in time, and balanced
again with its own rates; every pass gains that factor until the series diverges. It is stopped at
its smallest change, which is its error.

Source: Seifried (2014), ch. 6 (quasi-static approximation), taken further by iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.inversion.differences import EIGHTH, padded, rates
from pinflex.inversion.instant import Balanced, Instant, balanced

_PASSES = 8
_ENOUGH = 1e-9  # m or rad: a smaller change is below what the differences resolve


@dataclass(frozen=True)
class Series:
    """The passes of a quasistatic command.

    Attributes:
        found: The pass before the smallest change. guess: The rigid motion, undeformed.
        changes: Largest change of a motor position from pass to pass [m | rad].
        error: Motor positions of the next pass minus those of `found`, shape (nt, nm).
    """

    found: Balanced
    changes: tuple[float, ...]
    error: Array


def rigid_guess(instant: Instant) -> tuple[Balanced, Array, Array]:
    """The undeformed mechanism on the path, and its v and a."""
    path, system = instant.target.path, instant.system
    nt, n = len(path.t), path.v.shape[1]
    v, a = np.zeros((nt, system.nv)), np.zeros((nt, system.nv))
    v[:, :n], a[:, :n] = path.v, path.a
    lam = np.zeros((nt, instant.rows))
    torque = np.zeros((nt, len(system.motors)))
    return Balanced(path.straight(system.n_eta), lam, torque), v, a


def series(instant: Instant, most: int = _PASSES) -> Series:
    """Balance along the path, again and again, until the change grows."""
    guess, v, a = rigid_guess(instant)
    h = float(instant.target.t[1] - instant.target.t[0])
    passes = [balanced(instant, guess, v, a)]
    changes: list[float] = []
    errors: list[Array] = []
    while len(passes) < most + 1:
        last = passes[-1]
        v, a = rates(instant.dynamics, padded(last.y, EIGHTH.reach), h, EIGHTH)
        try:
            following = balanced(instant, last, v, a)
        except ConvergenceError:
            break
        errors.append(instant.axes.read(following.y) - instant.axes.read(last.y))
        changes.append(float(np.max(np.abs(errors[-1]))))
        passes.append(following)
        if changes[-1] < _ENOUGH or (len(changes) > 1 and changes[-1] > changes[-2]):
            break
    if not changes:  # the second pass has no balance: the first correction itself is the error
        rigid = instant.axes.read(guess.y)
        return Series(passes[0], (), instant.axes.read(passes[0].y) - rigid)
    best = int(np.argmin(changes))
    return Series(passes[best], tuple(changes), errors[best])
