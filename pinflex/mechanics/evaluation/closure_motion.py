"""Closures in a motion, and their rates, of many states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinflex.mechanics.manifold import Manifold

if TYPE_CHECKING:
    from pinflex.arrays import Array, IntArray
    from pinflex.mechanics.evaluation.equations import Equations

_MOVE = 1e-7  # m or rad: of a difference


def closure_motion(dynamics: Equations, Y: Array, V: Array, A: Array) -> Array:
    """Closures, and their first and second time derivatives, shape (3, n, rows)."""
    if (compiled := dynamics.compiled) is not None:
        return compiled.evaluator.closure_motion(Y, V, A)
    c, J = dynamics.close(Y)
    return np.array([c, _times(J, V), _times(J, A) + dynamics.closure_bias(Y, V)])


class FrozenLinks:
    """A mechanism that moves with its links as they are bent, whichever joints its tree is made of.

    Motors move as they do in the rigid motion, and the closures of the pose at hold determine the
    passive joints. Where these cannot meet all rows (redundant ones that compliance takes up),
    links and elastic joints give way with the least elastic energy.

    With a sleeve on a bent beam rates stay those of the rigid motion: there v^2 times the curvature
    enters, which jumps between elements.
    """

    def __init__(self, dynamics: Equations, passive: IntArray, free: IntArray) -> None:
        """Nothing is evaluated yet."""
        system = dynamics.system
        self._dynamics, self._free, self._K = dynamics, passive, np.zeros((0, 0))
        if len(passive) != system.closed.n:
            self._free, springs, K = free, system.springs, system.K.copy()
            K[springs.v_at, springs.v_at] += springs.stiffness
            K[passive] = K[:, passive] = 0.0
            self._K = K[np.ix_(free, free)]

    def rates(self, Y: Array, V: Array, A: Array) -> tuple[Array, Array]:
        """Velocities and accelerations (n, nv) at poses Y (n, nq) that meet the closures there."""
        d = self._dynamics
        if not self._moving(V, A):
            return V, A
        J = d.close(Y).J
        inverse = self._inverse(J[:, :, self._free])
        V = V + self._moved(inverse, _times(J, V))
        return V, A + self._moved(inverse, _times(J, A) + d.closure_bias(Y, V))

    def stiffness(self, y: Array, v: Array, a: Array, M: Array, C: Array) -> float | Array:
        """What their change from pose to pose adds to the stiffness, shape (nv, nv).

        By differences, of round-off 1e-8: Newton asks for no more.
        """
        d, nv = self._dynamics, len(v)
        if not self._moving(v, a):
            return 0.0
        Y = Manifold(d).retract(y, _MOVE * np.eye(nv))
        V, A = np.tile(v, (nv, 1)), np.tile(a, (nv, 1))
        inverse = self._inverse(d.close(y[None]).J[:, :, self._free])
        dV = self._moved(inverse, closure_motion(d, Y, V, A)[1])
        dA = self._moved(inverse, closure_motion(d, Y, V + dV, A)[2])
        return np.asarray((C @ dV.T + M @ dA.T) / _MOVE)

    def _moving(self, v: Array, a: Array) -> bool:
        closed = self._dynamics.system.closed
        return closed.n > 0 and not closed.contacts and bool(v.any() or a.any())

    def _moved(self, inverse: Array, opening: Array) -> Array:
        """Rates of the free rows that close what opens, shape (n, nv)."""
        rates = np.zeros((len(opening), self._dynamics.system.nv))
        rates[:, self._free] = -_times(inverse, opening)
        return rates

    def _inverse(self, J: Array) -> Array:
        """Moves of the free rows that change each closure by one, shape (n, free, rows)."""
        n = len(self._K)
        if not n:
            return np.asarray(np.linalg.inv(J))
        S = np.zeros((len(J), n + J.shape[1], n + J.shape[1]))
        S[:, :n, :n], S[:, n:, :n], S[:, :n, n:] = self._K, J, J.swapaxes(1, 2)
        return np.asarray(np.linalg.inv(S)[:, :n, n:])


def _times(J: Array, V: Array) -> Array:
    """J (n, k, m) times vectors V (n, m), shape (n, k)."""
    return np.asarray((J @ V[:, :, None])[:, :, 0])
