"""What a flexible mechanism does with a command: its vibration about the poses that were planned.

Poses y(t) that put the platform on its path leave forces e = r(y, v, a, lam) open in the rows that
no motor drives: the inertia of the last elastic change. With its motors on the command the
mechanism departs from y by d,

    M d'' + C d' + K d - J' dlam = -e,     J d = -c(y),     d = 0 at the motors and at the start

a linear system that changes along the motion; what it rings with is in the answer, damped or not.
One march of Newmark's rule finds d to first order. The rows of y + d, with differences of order 8,
hold what large departures, the steps and the interpolation of the matrices leave of them; a second
march tells what that is worth at the platform.

Source: Geradin, Cardona (2001), Flexible Multibody Dynamics, ch. 7 (Newmark's rule with closures);
Stetter (1978), Numer. Math. 29, 425 (the correction by a defect estimates the error).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.inversion.differences import EIGHTH, padded, rates, spline
from pinflex.inversion.instant import Balanced, Instant
from pinflex.linalg import lapack, saddle_matrix
from pinflex.mechanics.manifold import Manifold

_NODES = 16  # intervals over the motion in which matrices are straight lines: the defect tells


class _Matrices(NamedTuple):
    """M, C, K (free, free) and J (rows, free) of the coordinates that no motor drives."""

    M: Array
    C: Array
    K: Array
    J: Array


class Forward:
    """The forward equations, linearised along the motion of poses that balance a path.

    For any poses near those: the motors' motion is that of the poses that are asked about.
    """

    def __init__(self, instant: Instant, found: Balanced) -> None:
        """Evaluate and factorise the system along `found`."""
        self._instant, self._manifold = instant, Manifold(instant.dynamics)
        self._h = float(instant.target.t[1] - instant.target.t[0])
        v, a, _ = self._rates(found.y, instant.axes.read(found.y))
        at = _nodes(instant.target.path.v)
        every = [self._matrices(int(k), found, v, a) for k in at]
        self._from = every
        self._rise = [
            _Matrices(*(y - x for x, y in zip(*pair, strict=True)))
            for pair in zip(every, [*every[1:], every[-1]], strict=True)
        ]
        inside = np.clip(np.arange(len(found.y)), at[0], at[-1])
        self._node = np.searchsorted(at, inside, side="right") - 1
        width = np.append(np.diff(at), 1)
        self._part = (inside - at[self._node]) / width[self._node]
        self._factors: dict[tuple[int, float], tuple[Array, Array]] = {}

    def platform_error(self, found: Balanced, kept: slice = slice(None)) -> Array:
        """Bar on how far the platform is from its path [m | rad], shape (k,).

        The largest of what two marches find, and of what the second one changes.
        """
        motors = self._instant.axes.read(found.y)
        forces, gap, _ = self._open(found.y, found.lam, motors)
        d, lam = self._departure(forces, gap)
        y = self._manifold.retract(found.y, d)
        forces, gap, first = self._open(y, found.lam + lam, motors)
        d, _ = self._departure(forces, gap)
        platform, target = self._instant.platform, self._instant.target
        values = platform.values(self._instant.dynamics.joint_poses(self._manifold.retract(y, d)))
        error = platform.error(values, target.position)
        parts = (np.max(np.abs(x[kept]), axis=0) for x in (error, error - first))
        return np.asarray(np.nan_to_num(sum(parts), nan=np.inf))

    def _rates(self, y: Array, motors: Array) -> tuple[Array, Array, IntArray]:
        """v and a of poses, those of the motors as the spline of the command has them.

        And the instants that differ from the one before them: those of a rest are one.
        """
        instant, t = self._instant, self._instant.target.t
        v, a = rates(instant.dynamics, padded(y, EIGHTH.reach), self._h, EIGHTH)
        own = instant.changing(y, v, a)
        curve, rows = spline(t, np.unwrap(motors, axis=0)), instant.system.motors
        v[:, rows], a[:, rows] = curve(t, 1), curve(t, 2)
        return v, a, own

    def _matrices(self, k: int, found: Balanced, v: Array, a: Array) -> _Matrices:
        instant = self._instant
        free, t = instant.free, float(instant.target.t[k])
        M, C, K, J = instant.dynamics.tangent(found.y[k], v[k], a[k], found.lam[k], t)
        square = np.ix_(free, free)
        return _Matrices(M[square], C[square], K[square], J[:, free])

    def _open(self, y: Array, lam: Array, motors: Array) -> tuple[Array, Array, Array]:
        """Forces left open (nt, free), of closures (nt, rows), of the platform (nt, k)."""
        instant = self._instant
        v, a, own = self._rates(y, motors)
        some, _ = instant.residuals(own, y[own], v[own], a[own], lam[own])
        rows = some[np.searchsorted(own, np.arange(len(y)), side="right") - 1]
        n, m, k = len(instant.free), instant.rows, len(instant.target.names)
        return rows[:, :n], rows[:, n : n + m], rows[:, n + m : n + m + k]

    def _departure(self, forces: Array, gap: Array) -> tuple[Array, Array]:
        """d (nt, nv) and dlam (nt, rows) under open forces (nt, free) and gaps (nt, rows)."""
        dgetrs = lapack().dgetrs
        n, h, quarter = forces.shape[1], self._h, 0.25 * self._h**2
        out, lam = np.zeros((len(forces), self._instant.system.nv)), np.zeros_like(gap)
        d, v, a = np.zeros((3, n))
        right = np.empty(n + gap.shape[1])
        for k in range(1, len(forces)):
            node, part = int(self._node[k]), float(self._part[k])
            here, rise = self._from[node], self._rise[node]
            d, v = d + h * v + quarter * a, v + 0.5 * h * a
            right[:n] = -forces[k] - here.C @ v - here.K @ d
            right[n:] = gap[k] + here.J @ d
            if part:
                right[:n] -= part * (rise.C @ v + rise.K @ d)
                right[n:] += part * (rise.J @ d)
            right[n:] /= -quarter
            x, _ = dgetrs(*self._factorised(node, part), right)
            a, lam[k] = x[:n], x[n:]
            d, v = d + quarter * a, v + 0.5 * h * a
            out[k, self._instant.free] = d
        return out, lam

    def _factorised(self, node: int, part: float) -> tuple[Array, Array]:
        """LU factors of a step's saddle matrix; at rest all steps have one."""
        if (node, part) not in self._factors:
            here, rise, h = self._from[node], self._rise[node], self._h
            M, C, K, J = (x + part * y for x, y in zip(here, rise, strict=True))
            S = saddle_matrix(M + 0.5 * h * C + 0.25 * h * h * K, J)
            self._factors[node, part] = lapack().dgetrf(S)[:2]
        return self._factors[node, part]


def _nodes(v: Array) -> IntArray:
    """Instants at which matrices are evaluated: evenly over the time in which the path moves."""
    moving = np.flatnonzero(np.any(v != 0.0, axis=1))
    if not len(moving):
        return np.zeros(1, dtype=np.intp)
    first, last = max(int(moving[0]) - 1, 0), min(int(moving[-1]) + 1, len(v) - 1)
    return np.unique(np.linspace(first, last, _NODES + 1).round().astype(np.intp))
