"""Motor motion on the instants of a grid, by level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.inversion.after import swing_after
from pinflex.inversion.exact import invert
from pinflex.inversion.flat import flat
from pinflex.inversion.instant import Balanced, Instant
from pinflex.inversion.series import rigid_guess, series
from pinflex.inversion.target import delayed
from pinflex.levels.rigid import solve_rigid


@dataclass(frozen=True)
class Answer:
    """Motor motion on a grid.

    Attributes:
        found: Poses, multipliers and torques.
        error: Largest error of each platform coordinate [m | rad], shape (k,).
        missed: By how much the rigid command misses them, shape (k,).
        iterations: Of Newton, level exact.
        changes: Of the motors by each term of the series, level quasistatic.
        curve: Motor positions by time and order of derivative, where known in closed form.
        swing: Bar on the platform when motors stop at the end [m | rad], shape (k,).
    """

    found: Balanced
    error: Array
    missed: Array
    iterations: int = 0
    changes: tuple[float, ...] = ()
    curve: Callable[..., Array] | None = None
    swing: Array | None = None


def on_grid(instant: Instant, motion: Motion, level: str, kept: slice) -> Answer:
    """Find the motor motion at every instant."""
    wanted, slow = instant.target, series(instant, kept)
    apart = instant.axes.read(slow.found.y) - wanted.motors
    missed = _at_platform(wanted.gain[kept], apart[kept])
    if level == "quasistatic":
        return Answer(slow.found, slow.error, missed, changes=slow.changes)
    if level == "rigid":
        law = delayed(motion, wanted.before)
        torque = solve_rigid(instant.mechanism, law, wanted.t).torque
        return Answer(replace(rigid_guess(instant)[0], torque=torque), missed, missed)
    return _exact(instant, motion, slow.found, missed, kept)


def _exact(instant: Instant, motion: Motion, guess: Balanced, missed: Array, kept: slice) -> Answer:
    """Stable inversion, or its closed form where gears alone give way."""
    wanted = instant.target
    gain, t = wanted.gain[kept], wanted.t
    smooth = flat(instant.mechanism, motion, wanted)
    if smooth is None:
        exact = invert(instant, guess)
        error = _at_platform(gain, exact.error[kept])
        swing = swing_after(instant, exact.found, guess, len(gain))
        return Answer(exact.found, error, missed, iterations=exact.iterations, swing=swing)
    found = Balanced(smooth.poses(t), np.zeros((len(t), instant.rows)), smooth.torque(t))
    error = _at_platform(gain, np.tile(smooth.error, (len(gain), 1)))
    return Answer(found, error, missed, curve=smooth.position)


def _at_platform(gain: Array, moves: Array) -> Array:
    """Largest platform motion that moves of the motors (nt, nm) make, shape (k,)."""
    return np.asarray(np.max(np.abs(np.einsum("tkm,tm->tk", gain, moves)), axis=0))
