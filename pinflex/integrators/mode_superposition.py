"""Mode superposition of a linear, time-varying system: modes of every interval, exact in time.

The closures are removed by d = Z(t) z, z a fixed choice of the coordinates, so that

    Z'M Z zdd + Z'(C Z + 2 M Zd) zd + Z'(K Z + C Zd + M Zdd) z = -Z' r.

On an interval the matrices are those of its middle; the lowest modes of (Z'K Z, Z'M Z) are kept,
with whatever couples them, and the load is linear in time: the matrix exponential is exact. What
the other modes carry follows statically.

Where stiff directions turn with the mechanism, a matrix that stands still over an interval lets
them turn in jumps: a small error stays however short the step (on the 3-RRS 7e-4 of the largest
platform error, on its smaller components). The direct methods have none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.integrators.linear import At, Instant, State, with_multipliers
from pinflex.linalg import lapack


@dataclass(frozen=True)
class _Reduced:
    """The system in z at one time; Z, Zd, Zdd bring z back to d."""

    Z: Array
    Zd: Array
    Zdd: Array
    M: Array
    C: Array
    K: Array
    f: Array


class _Choice:
    """z: coordinates that stay when the closures are solved for the others."""

    def __init__(self, at: At, count: int, h: float) -> None:
        self.at, self.count, self.h = at, count, h
        J = at(0).J
        rows, n = J.shape
        order = lapack().dgeqp3(J)[1] - 1 if rows else np.arange(n)
        self.solved: IntArray = np.sort(order[:rows])
        self.kept: IntArray = np.sort(order[rows:])

    def Z(self, J: Array) -> Array:
        Z = np.zeros((J.shape[1], len(self.kept)))
        Z[self.kept, np.arange(len(self.kept))] = 1.0
        if len(J):
            Z[self.solved] = -np.linalg.solve(J[:, self.solved], J[:, self.kept])
        return Z

    def reduced(self, k: int) -> _Reduced:
        """By central differences of Z inside, by one-sided ones of second order at the ends."""
        h, last = self.h, self.count - 1
        now, Z = self.at(k), self.Z(self.at(k).J)
        if last < 3 or not len(now.J):
            Zd = Zdd = np.zeros_like(Z)
        elif 0 < k < last:
            before, after = self.Z(self.at(k - 1).J), self.Z(self.at(k + 1).J)
            Zd, Zdd = (after - before) / (2 * h), (after - 2 * Z + before) / h**2
        else:
            way = 1 if k == 0 else -1
            Z1, Z2, Z3 = (self.Z(self.at(k + way * j).J) for j in (1, 2, 3))
            Zd = way * (-3 * Z + 4 * Z1 - Z2) / (2 * h)
            Zdd = (2 * Z - 5 * Z1 + 4 * Z2 - Z3) / h**2
        M, C, K = now.M, now.C, now.K
        return _Reduced(
            Z, Zd, Zdd, Z.T @ M @ Z, Z.T @ (C @ Z + 2 * M @ Zd),
            Z.T @ (K @ Z + C @ Zd + M @ Zdd), -Z.T @ now.r,
        )  # fmt: skip


def mode_superposition(at: At, count: int, h: float, d: Array, modes: int = 12) -> Iterator[State]:
    """March by modes.

    Args:
        at: The system at step k. count: Number of steps. h: Step, s.
        d: Start, at rest, on the closures.
        modes: Number of modes, the lowest of each interval; more than there are: all.
    """
    choice = _Choice(at, count, h)
    n = len(choice.kept)
    keep = min(n, modes)
    left = choice.reduced(0)
    z, zd = d[choice.kept], np.zeros(n)
    for k in range(count):
        if k:
            right = choice.reduced(k)
            z, zd = _interval(left, right, z, zd, h, keep)
            left = right
        yield _state(at(k), left, z, zd, keep)


def _modes(K: Array, M: Array, keep: int) -> tuple[Array, Array, Array]:
    """Squared frequencies (m,), modes V (n, m) and the V^+ (m, n) that gives back V^+ V = 1.

    The modes of a mass matrix of condition 1e12 (curvatures beside displacements) are orthogonal to
    1e-4 only: V' M is not good enough.
    """
    from scipy.linalg import eigh

    last = min(keep, len(K)) - 1
    squares, V = eigh(0.5 * (K + K.T), 0.5 * (M + M.T), subset_by_index=[0, last])
    return squares, V, np.linalg.solve(V.T @ M @ V, V.T)


def _interval(
    left: _Reduced, right: _Reduced, z: Array, zd: Array, h: float, keep: int
) -> tuple[Array, Array]:
    """z and its rate at the end of an interval: modes of its middle, linear load."""
    from scipy.linalg import expm

    M, C, K = (0.5 * (getattr(left, x) + getattr(right, x)) for x in "MCK")
    squares, V, onto = _modes(K, M, keep)
    m = V.shape[1]
    # Rates in units of omega keep the exponent's entries of one size.
    unit = np.sqrt(np.maximum(np.abs(squares), h**-2))
    back = onto @ M
    A = np.zeros((2 * m + 2, 2 * m + 2))
    A[:m, m : 2 * m] = h * np.diag(unit)
    A[m : 2 * m, :m] = -h * (onto @ K @ V) / unit[:, None]
    A[m : 2 * m, m : 2 * m] = -h * (onto @ C @ V) * unit / unit[:, None]
    A[m : 2 * m, -2] = h * onto @ (right.f - left.f) / unit
    A[m : 2 * m, -1] = h * onto @ left.f / unit
    A[-2, -1] = 1.0
    x = expm(A) @ np.concatenate([back @ z, back @ zd / unit, [0.0, 1.0]])
    return V @ x[:m], V @ (unit * x[m : 2 * m])


def _state(now: Instant, here: _Reduced, z: Array, zd: Array, keep: int) -> State:
    """d, v, a and multipliers of z, with the static part of the modes left out."""
    if keep < len(z):
        _, V, onto = _modes(here.K, here.M, keep)
        zdd = V @ (onto @ (here.f - here.C @ zd - here.K @ z))
        # The part of the load that the kept modes do not take, and none of their own motion.
        rest = np.linalg.solve(here.K, here.f - here.M @ (V @ (onto @ here.f)))
        z = z + rest - V @ (onto @ (here.M @ rest))
    else:
        zdd = np.asarray(np.linalg.solve(here.M, here.f - here.C @ zd - here.K @ z))
    d, v = here.Z @ z, here.Z @ zd + here.Zd @ z
    a = here.Z @ zdd + 2 * here.Zd @ zd + here.Zdd @ z
    return with_multipliers(now, d, v, a)
