"""One step towards the least time: a linear programme about a profile.

Unknown are changes of the profile's numbers (in shares of what they may be), of its duration, and
by how much residual and torques must be let exceed their limits, if they must:

    least dT/T + 0.3 sigma + 3 rho     within limits, rest to rest, within a radius
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.quickest.limits import Limits
from pinflex.quickest.profile import Profile, basis
from pinflex.quickest.rigid import RigidPath

SHAKE, PUSH = 0.3, 3.0  # what a band, and a torque limit, too much costs, in durations


_ALONG = 1.0 - 5e-4  # of the speed: it is highest between the places that are looked at
_NEAR = 0.4  # of a torque limit, below which a step does not reach it


@dataclass
class Rows:
    """Inequalities A x <= b as they come in; the last three columns are dT, sigma and rho."""

    numbers: int
    A: list[Array] = field(default_factory=list)
    b: list[Array] = field(default_factory=list)

    def both(self, by: Array, now: Array, most: Array | float, more: Array | None = None,
             slack: int | None = None, unit: float | None = None) -> None:  # fmt: skip
        """|now + by x| <= most + more dT (+ slack, in units or of most); by (k, numbers + 1)."""
        for sign in (1.0, -1.0):
            self.one(sign * by, sign * now, most, more, slack, unit)

    def one(self, by: Array, now: Array, most: Array | float, more: Array | None = None,
            slack: int | None = None, unit: float | None = None) -> None:  # fmt: skip
        """The same on one side."""
        some = np.broadcast_to(np.isfinite(most), now.shape)
        rows = np.zeros((len(now), self.numbers + 3))
        rows[:, : by.shape[1]] = by
        if more is not None:
            rows[:, self.numbers] -= more
        most = np.broadcast_to(most, now.shape)
        if slack is not None:
            rows[:, slack] = -most if unit is None else -unit
        self.A.append(rows[some])
        self.b.append((most - now)[some])


@cache
def _shape(n: int, jumps: bool) -> tuple[Array, Array, Array]:
    """s, v and a by the numbers at ends of intervals, either side, and at quarters of them."""
    beside = 1e-9
    ends = np.arange(n + 1) / n
    inside = [ends[:-1] + share / n for share in (0.25, 0.5, 0.75)]
    u = np.sort(np.concatenate([ends[1:] - beside, ends[:-1] + beside, *inside]))
    s, v, a = basis(n, jumps, u)
    return s, v, a


def of_path(rows: Rows, profile: Profile, limits: Limits, rigid: RigidPath) -> None:
    """Speed, acceleration and jerk along the path, speeds of the motors."""
    n, T, x = profile.n, profile.duration, profile.x
    s, v, a = _shape(n, profile.jumps)
    one = np.ones(len(v))
    rows.both(v, v @ x, _ALONG * limits.speed * T, limits.speed * one)
    rows.both(a, a @ x, limits.acceleration * T**2, 2.0 * limits.acceleration * T * one)
    if np.isfinite(limits.jerk):
        by = np.eye(n)
        rows.both(by, x[:n], limits.jerk * T**3, 3.0 * limits.jerk * T**2 * np.ones(n))
    if np.any(np.isfinite(limits.motor_speed)):
        gain, turn = rigid.motor_speed(s @ x), rigid(s @ x)[1][:, rigid.motors]
        for k, most in enumerate(limits.motor_speed):
            by = gain[:, k, None] * v + (turn[:, k] * (v @ x))[:, None] * s
            rows.both(by, gain[:, k] * (v @ x), _ALONG * most * T, most * one)


def solved(
    rows: Rows, profile: Profile, limits: Limits, radius: float, longest: float
) -> tuple[Profile, float]:
    """The next profile, and its cost as the programme sees it.

    Raises:
        ConvergenceError: There is none.
    """
    from scipy.optimize import linprog

    numbers, n, T = len(profile.x), profile.n, profile.duration
    scale = np.ones(numbers + 3)
    jerk = limits.jerk * T**3 if np.isfinite(limits.jerk) else np.abs(profile.x[:n]).max() + n
    scale[:n] = jerk
    scale[n:numbers] = np.abs(profile.x[n:]).max(initial=0.0)
    A = np.vstack(rows.A) * scale
    E = np.zeros((3, numbers + 3))
    E[:, :numbers] = basis(n, profile.jumps, np.array([1.0]))[:, 0]
    e = np.array([1.0, 0.0, 0.0]) - E[:, :numbers] @ profile.x
    cost = np.zeros(numbers + 3)
    cost[numbers:] = 1.0 / T, SHAKE, PUSH
    bounds = [(-radius, radius)] * numbers + [(-longest * T, longest * T), (0, None), (0, None)]
    found = linprog(cost, A_ub=A, b_ub=np.concatenate(rows.b), A_eq=E * scale, b_eq=e,
                    bounds=bounds, method="highs")  # fmt: skip
    if found.status != 0:
        raise ConvergenceError(f"fastest: the linear programme: {found.message}")
    x = scale * found.x
    after = Profile(n, profile.x + x[:numbers], T + x[numbers])
    return after, 1.0 + float(cost @ found.x)


def end_rows(
    rows: Rows, by: Array, place: Array, step: float, duration: float, box: tuple[float, float],
    unit: float,
) -> None:  # fmt: skip
    """Place and speed at the end within a box, of the first two instants after it."""
    at, rate = np.array([1.5, -0.5]), np.array([-1.0, 1.0]) / step
    for axis in range(3):
        now, speed = at @ place[:2, axis], rate @ place[:2, axis]
        by_speed = rate @ by[:2, axis]
        by_speed[-1] -= speed / duration  # the same places later are a slower speed
        for value, by_value, most in ((now, at @ by[:2, axis], box[0]), (speed, by_speed, box[1])):
            rows.both(by_value[None], value[None], 0.99 * most, slack=-2, unit=unit * most)


def shake_rows(rows: Rows, by: Array, place: Array, band: float, unit: float) -> None:
    """|place| <= band at instants, (k, 3), by the numbers, (k, 3, numbers + 1)."""
    size = np.linalg.norm(place, axis=1)
    toward = place / np.maximum(size, 1e-300)[:, None]
    for axis in range(3):
        if np.abs(place[:, axis]).max() > 1e-6 * size.max() or np.ptp(by[:, axis]) > 0.0:
            rows.both(by[:, axis], place[:, axis], band, slack=-2, unit=unit)
    rows.one(np.einsum("ki,kin->kn", toward, by), size, band, slack=-2, unit=unit)


def torque_rows(
    rows: Rows, by: Array, torque: Array, limits: Sequence[float], within: float = 1.0
) -> None:
    """|torque| <= its limit at instants, (k, nm), by the numbers, (k, nm, numbers + 1)."""
    for k, most in enumerate(limits):
        if np.isfinite(most):
            near = np.abs(torque[:, k]) > _NEAR * most
            rows.both(by[near, k], torque[near, k], within * most, slack=-1)
