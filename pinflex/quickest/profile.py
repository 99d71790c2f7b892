"""A profile along a path, s(u) from 0 to 1 over u = t/T, as a few numbers that it is linear in.

Jerk is constant in each of n intervals; where jerk has no limit, acceleration may jump at
their ends too. The numbers x are jerks d^3s/du^3, shape (n,), then jumps of d^2s/du^2, (n + 1,).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pinflex.arrays import Array, BoolArray
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.motion import Motion


def even(n: int) -> Array:
    """Ends of n equal intervals of u, shape (n + 1,)."""
    return np.asarray(np.arange(n + 1) / n)


def basis(ends: Array, jumps: bool, u: Array) -> Array:
    """s, ds/du and d^2s/du^2 of each number at u, shape (3, len(u), numbers).

    Beyond u = 1 each goes on with its last acceleration: those of a profile that ends cancel.
    """
    since, long = u[:, None] - ends[:-1], np.diff(ends)
    first, then = np.clip(since, 0.0, long), np.maximum(since - long, 0.0)
    a, v = first, 0.5 * first**2 + first * then
    s = first**3 / 6.0 + 0.5 * first**2 * then + 0.5 * first * then**2
    if not jumps:
        return np.stack([s, v, a])
    late = np.maximum(u[:, None] - ends, 0.0)
    on = (u[:, None] >= ends).astype(float)
    return np.stack([np.hstack(x) for x in ((s, 0.5 * late**2), (v, late), (a, on))])


@dataclass(frozen=True)
class Profile:
    """One profile.

    Attributes:
        ends: Of its intervals, shape (n + 1,). x: Its numbers, shape (n,) or (2 n + 1,).
        duration: Of the motion [s].
    """

    ends: Array = field(repr=False)
    x: Array = field(repr=False)
    duration: float

    @property
    def n(self) -> int:
        """Intervals."""
        return len(self.ends) - 1

    @property
    def jumps(self) -> bool:
        """Whether acceleration may jump."""
        return len(self.x) > self.n

    @property
    def nodes(self) -> Array:
        """Times at which jerk or acceleration jumps [s], shape (n + 1,)."""
        return np.asarray(self.duration * self.ends)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration along the path at times t [s], (nt,) each."""
        s, v, a = basis(self.ends, self.jumps, np.clip(t / self.duration, 0.0, 1.0)) @ self.x
        rest = t >= self.duration
        s, v, a = np.where(rest, 1.0, s), np.where(rest, 0.0, v), np.where(rest, 0.0, a)
        return s, v / self.duration, a / self.duration**2

    def split(self, some: BoolArray, parts: int) -> Profile:
        """The same profile with some of its intervals in equal parts."""
        n, k = self.n, np.where(some, parts, 1)
        inside = np.concatenate([np.arange(x) for x in k]) / np.repeat(k, k)
        ends = np.append(
            np.repeat(self.ends[:-1], k) + inside * np.repeat(np.diff(self.ends), k), 1
        )
        jumps = np.zeros(len(ends) if self.jumps else 0)
        if self.jumps:
            jumps[np.append(0, np.cumsum(k))] = self.x[n:]
        return Profile(ends, np.concatenate([np.repeat(self.x[:n], k), jumps]), self.duration)

    def motion(self, target: str, moves: Mapping[str, float]) -> Motion:
        """The motion of displacements by name along it."""
        names, far = tuple(moves), np.array([*moves.values()], float)
        law = partial(_law, self, far)
        corners = tuple(self.nodes[1:-1].tolist())
        return Motion("fastest", target, names, self.duration, law, corners=corners)


def _law(profile: Profile, far: Array, t: Array) -> Kinematics:
    s, v, a = (x[:, None] * far for x in profile.at(t))
    return s, v, a


def fitted(motion: Motion, far: Array, n: int, jumps: bool) -> Profile:
    """The profile nearest to a motion of displacements `far` from rest to rest."""
    u, parts = (np.arange(8 * n) + 0.5) / (8 * n), even(n)
    at = int(np.argmax(np.abs(far)))
    p, v, _ = (x[:, at] / far[at] for x in motion.evaluate(u * motion.duration))
    B = basis(parts, jumps, u)
    ends = basis(parts, jumps, np.array([1.0]))[:, 0]
    A, b = np.vstack([B[0], B[1], 1e4 * ends]), np.concatenate([p, v * motion.duration])
    x = np.linalg.lstsq(A, np.concatenate([b, 1e4 * np.array([1.0, 0.0, 0.0])]), rcond=None)[0]
    return Profile(parts, x, motion.duration)
