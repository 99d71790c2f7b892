"""Profiles by limits: the shortest straight move within speed, acceleration and jerk.

All that moves is in step: one profile s(t) from 0 to 1, times the displacement of each. A limit on
a name is one on s divided by its displacement, and the least of each kind counts, so that the path
is straight and no shorter time is possible along it.

Source: Biagiotti, Melchiorri (2008), sections 3.2 (trapezoid) and 3.4 (double S), here from rest to
rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from math import cbrt, sqrt
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions import laws as keys
from pinflex.description.motions.laws import SNAP, Kinematics, Moves
from pinflex.description.motions.trajectory import Motion
from pinflex.doors import library

# Polynomials piece by piece: the law of profiles and of interpolated waypoints.


@dataclass(frozen=True)
class Pieces:
    """Positions of n names in m pieces, at rest after the last; a law of `Motion`.

    At a knot the piece behind it holds, so that accelerations are those from the right.

    Attributes:
        knots: Where pieces begin and the last one ends [s], shape (m + 1,), the first 0.
        powers: Coefficients of the time since the piece began, rising, shape (m, degree + 1, n).
        final: Positions of the end, shape (n,): exactly what was asked for.
    """

    knots: Array
    powers: Array
    final: Array

    def __call__(self, t: Array) -> Kinematics:
        """Position, velocity, acceleration at times t >= 0 (nt,), each (nt, n)."""
        end = self.knots[-1]
        past = t + SNAP * end
        piece = np.clip(
            np.searchsorted(self.knots, past, side="right") - 1, 0, len(self.powers) - 1
        )
        on = (past < end)[:, None]
        u = (t - self.knots[piece])[:, None]
        values = [np.zeros((len(t), self.powers.shape[2])) for _ in range(3)]
        p, v, a = values
        for coefficient in self.powers[piece].swapaxes(0, 1)[::-1]:  # Horner, with derivatives
            a *= u
            a += 2.0 * v
            v *= u
            v += p
            p *= u
            p += coefficient
        return np.where(on, p, self.final), np.where(on, v, 0.0), np.where(on, a, 0.0)

    def corners(self, least: float) -> tuple[float, ...]:
        """Knots at which an acceleration jumps by more than `least` of its largest value [s]."""
        span = np.diff(self.knots)[:, None]
        c = self.powers
        first = 2.0 * c[:, 2] if c.shape[1] > 2 else np.zeros(c[:, 0].shape)
        last = first.copy()
        for k in range(3, c.shape[1]):
            last += k * (k - 1) * c[:, k] * span ** (k - 2)
        largest = np.maximum(np.abs(first), np.abs(last)).max(axis=0)
        jumps = np.abs(first[1:] - last[:-1]) > least * np.maximum(largest, 1e-300)
        return tuple(self.knots[1:-1][np.any(jumps, axis=1)].tolist())


def hermite(t: Array, *derivatives: Array) -> Array:
    """Coefficients of polynomials by values and derivatives at the ends t (m + 1,) of each piece.

    Of position, then velocity and acceleration or fewer, k in all, each (m + 1, n): linear, cubic
    or quintic, shape (m, 2 k, n).
    """
    k, h = len(derivatives), np.diff(t)[:, None]
    orders, powers = np.arange(k), np.arange(2 * k)
    # d^j/du^j of u^i at u = time / h = 1, and of the first k at u = 0: their factorials.
    at_end = np.array([[np.prod(i - np.arange(j)) for i in powers] for j in orders], float)
    factorial = np.array([1.0, 1.0, 2.0])[:k]
    begin = np.stack([d[:-1] * h**j for j, d in enumerate(derivatives)])
    end = np.stack([d[1:] * h**j for j, d in enumerate(derivatives)])
    low = begin / factorial[:, None, None]
    missing = end - np.einsum("ji,imn->jmn", at_end[:, :k], low)
    high = np.einsum("ij,jmn->imn", np.linalg.inv(at_end[:, k:]), missing)
    unit = np.concatenate([low, high]).swapaxes(0, 1)
    return np.asarray(unit / (h**powers)[:, :, None])


Limit = float | Mapping[str, float] | None
UNITS = {
    "velocity": "rad/s or m/s",
    "acceleration": "rad/s^2 or m/s^2",
    "jerk": "rad/s^3 or m/s^3",
    "effort": "N m or N",
}
KINDS = {  # motions that keep limits, with those that they need
    "trapezoid": ("velocity", "acceleration"),
    "scurve": ("velocity", "acceleration", "jerk"),
    "ruckig": ("velocity", "acceleration", "jerk"),
}


def by_name(value: Limit, names: Any, where: str, quantity: str) -> dict[str, float]:
    """A limit of each name, from one number or a mapping, which may know more names."""
    unit = UNITS[quantity]
    found = {}
    for name in names:
        one = value.get(name) if isinstance(value, Mapping) else value
        place = f"{where}.{quantity}" + (f".{name}" if isinstance(value, Mapping) else "")
        if one is None:
            raise keys.bad(place, f"missing. Give a number in {unit}, or {{name: number}}.")
        found[name] = keys.number(one, place, unit, "speed")
        if found[name] <= 0.0:
            raise keys.bad(place, f"{found[name]:g} {unit} is out of range. It must be above 0.")
    return found


def ramps(velocity: float, acceleration: float, jerk: float = np.inf) -> tuple[float, float, float]:
    """Times of the shortest profile of one unit [s]: of a jerk, of a ramp, of constant speed.

    A ramp of speed begins and ends with a jerk; what is short never reaches the acceleration, the
    speed, or either.
    """
    v, a, j = velocity, acceleration, jerk
    rise = a / j if v * j >= a**2 else sqrt(v / j)  # until the acceleration, or half of the speed
    ramp = rise + v / a if v * j >= a**2 else 2.0 * rise
    cruise = 1.0 / v - ramp
    if cruise >= 0.0:
        return rise, ramp, cruise
    if 2.0 * a**3 <= j**2:  # the acceleration is reached, the speed is not
        rise = a / j
        return rise, 0.5 * rise + sqrt(0.25 * rise**2 + 1.0 / a), 0.0
    rise = cbrt(0.5 / j)
    return rise, 2.0 * rise, 0.0


def least_of(moves: Mapping[str, float], limits: Mapping[str, float]) -> float:
    """The limit on s that the limits on displaced names come to."""
    return min(limits[name] / abs(way) for name, way in moves.items() if way != 0.0)


def trapezoid_times(
    moves: Mapping[str, float], velocity: Limit, acceleration: Limit
) -> tuple[float, float]:
    """Ramp and duration [s] of the shortest trapezoid within limits."""
    given = {"velocity": velocity, "acceleration": acceleration}
    v, a = (least_of(moves, x) for x in _limits("trapezoid", moves, given).values())
    _, ramp, cruise = ramps(v, a)
    return ramp, 2.0 * ramp + cruise


def double_s(velocity: float, acceleration: float, jerk: float, delta: Array) -> Pieces:
    """The shortest profile of one unit in pieces of constant jerk, times displacements (n,).

    Limits of speed and acceleration may be infinite, that of jerk not.
    """
    rise, ramp, cruise = ramps(velocity, acceleration, jerk)
    flat = ramp - 2.0 * rise
    times = np.array([rise, flat, rise, cruise, rise, flat, rise])
    long = times > 0.0
    powers = _powers(times[long], np.array([jerk, 0.0, -jerk, 0.0, -jerk, 0.0, jerk])[long])
    knots = np.array([*accumulate(times[long], initial=0.0)])
    return Pieces(knots, np.multiply.outer(powers, delta), delta)


@public
def scurve(
    *,
    joints: Moves = None,
    platform: Moves = None,
    velocity: Limit = None,
    acceleration: Limit = None,
    jerk: Limit = None,
) -> Motion:
    """The shortest displacements in step within limits of speed, acceleration and jerk; then rest.

    Seven pieces of constant jerk or fewer. In a YAML a limit that is not written is that of the
    URDF's `<limit velocity= acceleration= jerk=>`; here `robot.limits` has them.

    Args:
        joints, platform: As of `cycloid`.
        velocity: Limit [rad/s | m/s], of all or {name: limit}.
        acceleration: [rad/s^2 | m/s^2]. jerk: [rad/s^3 | m/s^3].
    Source: Biagiotti, Melchiorri (2008), section 3.4.
    """
    target, moves, delta = keys.moves_of(joints, platform, "scurve")
    given = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
    limits = _limits("scurve", moves, given)
    v, a, j = (least_of(moves, limit) for limit in limits.values())
    return _motion_along("scurve", target, moves, limits, double_s(v, a, j, delta))


@public
def ruckig(
    *,
    joints: Moves = None,
    platform: Moves = None,
    velocity: Limit = None,
    acceleration: Limit = None,
    jerk: Limit = None,
) -> Motion:
    """Displacements within limits that end together, each along its own profile; then rest.

    Where limits differ this is shorter than `scurve`, whose path is straight. Needs ruckig
    (`pip install "pinflex[ruckig]"`).

    Args: As of `scurve`.
    Source: Berscheid, Kroeger (2021), time-synchronised.
    """
    target, moves, delta = keys.moves_of(joints, platform, "ruckig")
    given = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
    limits = _limits("ruckig", moves, given)
    solver = library("ruckig", "motion ruckig")
    asked, found = solver.InputParameter(len(moves)), solver.Trajectory(len(moves))
    asked.current_position, asked.target_position = [0.0] * len(moves), delta.tolist()
    for quantity, limit in limits.items():
        setattr(asked, f"max_{quantity}", [*limit.values()])
    if solver.Ruckig(len(moves)).calculate(asked, found) != solver.Result.Working:
        raise keys.bad("ruckig", "no profile was found within these limits. Take scurve.")
    law = _together(found.profiles[0], delta, float(found.duration))
    return _motion_along("ruckig", target, moves, limits, law)


def _limits(
    kind: str, moves: Mapping[str, float], given: Mapping[str, Limit]
) -> dict[str, dict[str, float]]:
    """Limits of each name by quantity, of a motion that moves something."""
    found = {quantity: by_name(value, moves, kind, quantity) for quantity, value in given.items()}
    if not any(moves.values()):
        raise keys.bad(kind, "every displacement is 0. Give one that is not, or take hold.")
    return found


def _motion_along(kind: str, target: str, moves: Any, limits: Any, law: Pieces) -> Motion:
    spec = {"kind": kind, target: moves, **limits}
    *knots, end = law.knots.tolist()
    return Motion(kind, target, tuple(moves), end, law, False, spec, tuple(knots[1:]))


def _powers(times: Any, jerks: Any) -> Array:
    """Coefficients of pieces of constant jerk, from rest, shape (m, 4)."""
    p = v = a = 0.0
    powers = []
    for h, j in zip(times, jerks, strict=True):
        powers.append([p, v, 0.5 * a, j / 6.0])
        p += h * (v + h * (0.5 * a + h * j / 6.0))
        v += h * (a + h * 0.5 * j)
        a += h * j
    return np.array(powers)


def _together(profiles: Any, delta: Array, end: float) -> Pieces:
    """Profiles of constant jerks of each name on the knots of all."""
    own = []
    for one in profiles:
        times = np.concatenate([one.brake.t, one.t])
        starts = np.concatenate([[0.0], np.cumsum(times)[:-1]])
        jerk = np.concatenate([one.brake.j, one.j])
        keep = times > 0.0
        own.append((starts[keep], jerk[keep]))
    every = np.unique(np.round(np.concatenate([starts for starts, _ in own]), 12))
    knots = np.append(every[every < end - 1e-12], end)
    lengths = np.diff(knots)
    powers = np.zeros((len(lengths), 4, len(own)))
    for k, (starts, jerk) in enumerate(own):
        there = np.searchsorted(starts, knots[:-1] + 1e-11, side="right") - 1
        powers[:, :, k] = _powers(lengths, jerk[there])
    return Pieces(knots, powers, delta)
