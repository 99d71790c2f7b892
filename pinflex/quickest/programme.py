"""One step towards the least time: a linear programme about a profile.

Unknown are changes of the profile's numbers (in shares of what they may be), of its duration, and
by how much residual and torques must be let exceed their limits, if they must:

    least dT/T + 0.1 sigma + 3 rho     within limits, rest to rest, within a radius
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.quickest.limits import Limits, Profile, RigidPath, basis

SHAKE, PUSH = 0.1, 3.0  # what a band, and a rigid robot's torque, too much costs, in durations


_ALONG = 1.0 - 5e-4  # of the speed: it is highest between the places that are looked at
_BOX = 0.99  # of a box at the end that a step aims at
_BESIDE = 1e-7  # of an interval: how far inside its ends lie
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


def places(profile: Profile) -> Array:
    """u at both ends of every interval, just inside, and at quarters of it, rising."""
    ends, long = profile.ends[:-1], np.diff(profile.ends)
    inside = np.array([_BESIDE, 0.25, 0.5, 0.75, 1.0 - _BESIDE])
    return np.asarray((ends[:, None] + long[:, None] * inside).ravel())


def of_path(rows: Rows, profile: Profile, limits: Limits, rigid: RigidPath) -> None:
    """Speed, acceleration and jerk along the path, speeds of the motors."""
    n, T, x = profile.n, profile.duration, profile.x
    B = basis(profile.ends, profile.jumps, places(profile)).reshape(3, n, -1, len(x))
    a = B[2, :, [0, -1]].reshape(-1, len(x))  # linear inside
    s, v = B[:2, :, :-1].reshape(2, -1, len(x))  # the next interval begins as fast
    rows.both(v, v @ x, _ALONG * limits.speed * T, limits.speed * np.ones(len(v)))
    rows.both(a, a @ x, limits.acceleration * T**2, 2.0 * limits.acceleration * T * np.ones(2 * n))
    if np.isfinite(limits.jerk):
        by = np.eye(len(x))[:n]
        rows.both(by, x[:n], limits.jerk * T**3, 3.0 * limits.jerk * T**2 * np.ones(n))
    gain, turn = rigid.motor_speed(s @ x), rigid(s @ x)[1][:, rigid.motors]
    for k, (most, top) in enumerate(zip(limits.motor_speed, rigid.top, strict=True)):
        if np.isfinite(most) and top > most / limits.speed:  # else that along the path keeps it
            by = gain[:, k, None] * v + (turn[:, k] * (v @ x))[:, None] * s
            rows.both(by, gain[:, k] * (v @ x), _ALONG * most * T, most * np.ones(len(v)))


def solved(
    rows: Rows, profile: Profile, limits: Limits, radius: float, longest: float,
    push: float = PUSH,
) -> tuple[Profile, float, tuple[float, float]]:  # fmt: skip
    """The next profile, its cost as the programme sees it, and its sigma and rho.

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
    E[:, :numbers] = basis(profile.ends, profile.jumps, np.array([1.0]))[:, 0]
    e = np.array([1.0, 0.0, 0.0]) - E[:, :numbers] @ profile.x
    cost = np.zeros(numbers + 3)
    cost[numbers:] = 1.0 / T, SHAKE, push
    bounds = [(-radius, radius)] * numbers + [(-longest * T, longest * T), (0, None), (0, None)]
    # A presolve finds little in rows that are all full, and takes half of the time.
    found = linprog(cost, A_ub=A, b_ub=np.concatenate(rows.b), A_eq=E * scale, b_eq=e,
                    bounds=bounds, method="highs-ds", options={"presolve": False})  # fmt: skip
    if found.status != 0:
        raise ConvergenceError(
            f"fastest: with {n} intervals no motion nearby keeps the limits along the path "
            f"({found.message.partition('(')[0].strip(' .')}). Allow more intervals, or more jerk."
        )
    x = scale * found.x
    after = Profile(profile.ends, profile.x + x[:numbers], T + x[numbers])
    return after, 1.0 + float(cost @ found.x), (float(found.x[-2]), float(found.x[-1]))


def ends_by(by: Array, ends: Array, step: float, duration: float) -> Array:
    """Place and speed at the end, (axes, 2), by the numbers, (axes, 2, numbers + 1).

    `by`: places at the first three instants after it, which lie half a step, one and a half, and
    two and a half behind it: a parabola goes through.
    """
    extrapolated = np.array([[15.0, -10.0, 3.0], [-16.0 / step, 24.0 / step, -8.0 / step]]) / 8.0
    found: Array = np.einsum("ij,jan->ain", extrapolated, by[:3])
    found[:, 1, -1] -= ends[:, 1] / duration  # the same places later are a slower speed
    return found


def end_rows(rows: Rows, by: Array, ends: Array, box: tuple[float, float], unit: float) -> None:
    """Place and speed at the end, (axes, 2), within a box."""
    for now, by_number in zip(ends, by, strict=True):
        if np.any(by_number):  # what never moves along an axis has nothing to keep
            for value, by_value, most in zip(now, by_number, box, strict=True):
                rows.both(by_value[None], np.array([value]), _BOX * most, slack=-2,
                          unit=unit * most)  # fmt: skip


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
