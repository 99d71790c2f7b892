"""Polynomials piece by piece: the law of profiles and of interpolated waypoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.laws import SNAP, Kinematics


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
    """Coefficients of the polynomials that meet values and derivatives at both ends of each piece.

    Args:
        t: Times [s], shape (m + 1,).
        *derivatives: Position, then velocity and acceleration or fewer, each (m + 1, n).
    Returns:
        Shape (m, 2 k, n) for k derivatives: linear, cubic or quintic.
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
