"""Motions whose speed jumps inside a run: an impulse that no motor gives.

In level coupled and ked motors are where their motion says; a jump of their speed strikes the links
with the impulse that keeps all other momenta, M_ff dv_f = -M_fm dv_m, which the marches do not
know. At the start of a run it is made (`pinflex.levels.given_start`).
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import MotionError

_GRID = 2001  # instants at which a jump is looked for beside the motion's own corners
_SEEN = 1e-3  # of the top speed: a jump from here on is said (samples end at rest to about that)
_STRIKES = 1e-2  # of the top speed: a jump from here on is refused; links err by that share of it
_TABLES = (
    "sampled",
    "command",
)  # what is read off a table may end before motors rest: that is said
_BESIDE = 1e-7  # of the run: just before a corner
_HALVINGS = 40  # of the time between two instants, to the jump between them
_WAY_OUT = (
    "No motor does that, and the blow that it gives the links is not in this run. Take a motion "
    "without the jump (from rest to rest, or `until` where it ends), or solve up to there and "
    "give that run as `start` of a motion that begins there: a start makes the blow."
)


def blows(motion: Motion, until: float) -> list[str]:
    """A sentence where the speed of a motion jumps a little inside a run, else none.

    Raises:
        MotionError: It jumps by more than a hundredth of the top speed, and is no table of samples.
    """
    if not motion.names:
        return []
    ends = np.array([t for t in motion.switches if 0.0 < t < until])
    t = np.unique(np.concatenate([np.linspace(0.0, until, _GRID), ends - _BESIDE * until, ends]))
    t = t[(t >= 0.0) & (t < until)]
    v, a = motion.evaluate(t)[1:]
    top = np.maximum(np.max(np.abs(v), axis=0), 1e-300)
    # what accelerations do not explain; where these jump it is of the order of the step
    left = np.abs(np.diff(v, axis=0) - 0.5 * np.diff(t)[:, None] * (a[1:] + a[:-1])) / top
    said = []
    for k in np.flatnonzero(np.max(left, axis=1, initial=0.0) > 0.5 * _SEEN):
        at, jump = _jump(motion, float(t[k]), float(t[k + 1]))
        j = int(np.argmax(np.abs(jump) / top))
        share = abs(jump[j]) / top[j]
        if share < _SEEN:
            continue
        words = (
            f"the speed of {motion.names[j]} jumps by {abs(jump[j]):.3g} (rad/s or m/s), "
            f"{100 * share:.2g} % of its top speed, at t = {at:.6g} s. {_WAY_OUT}"
        )
        if share > _STRIKES and motion.kind not in _TABLES:
            raise MotionError(words, time=at)
        said.append(words)
    return said


def _jump(motion: Motion, low: float, high: float) -> tuple[float, Array]:
    """Where speeds change most between two times, and by how much in no time at all."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        v = motion.evaluate(np.array([low, middle, high]))[1]
        first, second = np.abs(v[1] - v[0]).max(), np.abs(v[2] - v[1]).max()
        low, high = (low, middle) if first > second else (middle, high)
    v = motion.evaluate(np.array([low, high]))[1]
    return high, v[1] - v[0]
