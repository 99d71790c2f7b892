"""A profile along a path, s(u) from 0 to 1 over u = t/T, as a few numbers that it is linear in.

Jerk is constant in each of n equal intervals; where jerk has no limit, acceleration may jump at
their ends too. The numbers x are jerks d^3s/du^3, shape (n,), then jumps of d^2s/du^2, (n + 1,).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.motion import Motion


def basis(n: int, jumps: bool, u: Array) -> Array:
    """s, ds/du and d^2s/du^2 of each number at u, shape (3, len(u), numbers).

    Beyond u = 1 each goes on with its last acceleration: those of a profile that ends cancel.
    """
    since = u[:, None] - np.arange(n) / n  # the start of each interval
    first, then = np.clip(since, 0.0, 1.0 / n), np.maximum(since - 1.0 / n, 0.0)
    a, v = first, 0.5 * first**2 + first * then
    s = first**3 / 6.0 + 0.5 * first**2 * then + 0.5 * first * then**2
    if not jumps:
        return np.stack([s, v, a])
    late = np.maximum(u[:, None] - np.arange(n + 1) / n, 0.0)
    on = (u[:, None] >= np.arange(n + 1) / n).astype(float)
    return np.stack([np.hstack(x) for x in ((s, 0.5 * late**2), (v, late), (a, on))])


@dataclass(frozen=True)
class Profile:
    """One profile.

    Attributes:
        n: Intervals. x: Its numbers, shape (n,) or (2 n + 1,).
        duration: Of the motion [s].
    """

    n: int
    x: Array = field(repr=False)
    duration: float

    @property
    def jumps(self) -> bool:
        """Whether acceleration may jump."""
        return len(self.x) > self.n

    @property
    def nodes(self) -> Array:
        """Times at which jerk or acceleration jumps [s], shape (n + 1,)."""
        return np.asarray(self.duration * np.arange(self.n + 1) / self.n)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration along the path at times t [s], (nt,) each."""
        s, v, a = basis(self.n, self.jumps, np.clip(t / self.duration, 0.0, 1.0)) @ self.x
        rest = t >= self.duration
        s, v, a = np.where(rest, 1.0, s), np.where(rest, 0.0, v), np.where(rest, 0.0, a)
        return s, v / self.duration, a / self.duration**2

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
    u = (np.arange(8 * n) + 0.5) / (8 * n)
    at = int(np.argmax(np.abs(far)))
    p, v, _ = (x[:, at] / far[at] for x in motion.evaluate(u * motion.duration))
    B = basis(n, jumps, u)
    ends = basis(n, jumps, np.array([1.0]))[:, 0]
    A, b = np.vstack([B[0], B[1], 1e4 * ends]), np.concatenate([p, v * motion.duration])
    x = np.linalg.lstsq(A, np.concatenate([b, 1e4 * np.array([1.0, 0.0, 0.0])]), rcond=None)[0]
    return Profile(n, x, motion.duration)
