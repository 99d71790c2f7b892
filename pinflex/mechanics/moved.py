"""Many poses moved at once, and the rates of their exponential coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.dynamics import Dynamics


class Moved:
    """Poses y (+) move of a mechanism: joints that turn on a circle and plain ones side by side.

    Attributes:
        turning: Whether some joint turns in space, so that its rates are not those of its move.
    """

    def __init__(self, dynamics: Dynamics, told: Sequence[int] | IntArray = ()) -> None:
        """`told`: rows of single-axis joints whose coordinates the caller writes."""
        self._dynamics = dynamics
        joints = [j for j in dynamics.system.rigid.joints[1:] if j.nv]
        plain = [j for j in joints if j.nq == j.nv]
        circles = [j for j in joints if j.nq == 2 > j.nv]
        self._easy = len(plain) + len(circles) == len(joints)
        circles = [j for j in circles if j.idx_v not in told]
        self.turning = not self._easy
        self._q = np.array([j.idx_q + k for j in plain for k in range(j.nv)], dtype=np.intp)
        self._v = np.array([j.idx_v + k for j in plain for k in range(j.nv)], dtype=np.intp)
        self._circle_q = np.array([j.idx_q for j in circles], dtype=np.intp)
        self._circle_v = np.array([j.idx_v for j in circles], dtype=np.intp)

    def poses(self, y: Array, moves: Array) -> Array:
        """Shape (k, nq), for moves (k, nv) from one pose y (nq,) or from each of (k, nq)."""
        d = self._dynamics
        if d.vector_space:
            return y + moves
        if not self._easy:
            pairs = zip(np.broadcast_to(y, (len(moves), y.shape[-1])), moves, strict=True)
            return np.array([d.integrate(*pair) for pair in pairs]).reshape(-1, y.shape[-1])
        n, m = d.nq_rigid, d.n_rigid
        out = np.empty((len(moves), y.shape[-1]))
        out[:, self._q] = y[..., self._q] + moves[:, self._v]
        if len(self._circle_q):
            angle, at = moves[:, self._circle_v], self._circle_q
            c, s = y[..., at], y[..., at + 1]
            grown = 0.5 * (3.0 - c * c - s * s)  # keeps (cos, sin) on the circle
            c, s, cos, sin = grown * c, grown * s, np.cos(angle), np.sin(angle)
            out[:, at], out[:, at + 1] = c * cos - s * sin, s * cos + c * sin
        out[:, n:] = y[..., n:] + moves[:, m:]
        return out

    def turn(self, y: Array, moves: Array, v: Array) -> Array:
        """What the rates of the exponential coordinates of moves differ from v by, (k, nv)."""
        d, turn = self._dynamics, np.zeros_like(v)
        n, model, q = d.n_rigid, d.system.rigid, y[: d.nq_rigid]
        rates = np.array([pin.dIntegrate(model, q, one[:n], pin.ARG1) for one in moves])
        turn[:, :n] = np.linalg.solve(rates, v[:, :n, None])[:, :, 0] - v[:, :n]
        return turn
