"""The coordinate map: Q = T(y), V = X v, A = X a + Xdot v, with X = dQ/dy.

X is the identity on the rigid rows and Phi + G eta on the rows of each flexible body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    from pinflex.arrays import Array, IntArray
    from pinflex.mechanics.model.system import System


@dataclass(frozen=True, eq=False)
class Configuration:
    """The expanded configurations of n states.

    Attributes:
        Q: Shape (n, nQ). V, A: Shape (n, nV), of speeds and accelerations zero where none were
            given.
        X: Shape (n, nV, nv); None: the identity, where no link bends.
    """

    Q: Array
    V: Array
    A: Array
    X: Array | None

    def project(self, g: Array) -> Array:
        """X' g, shape (n, nv), of expanded forces g (n, nV)."""
        return g if self.X is None else (g[:, None] @ self.X)[:, 0]

    def times_map(self, D: Array) -> Array:
        """D X, shape (..., k, nv), of D (k, nV) of one state or (n, k, nV) of all."""
        return D if self.X is None else (D @ self.X).reshape(*D.shape[:-1], -1)


@dataclass(frozen=True, eq=False)
class _Body:
    """Rows in V and in Q of one body, its columns of X, Phi (R, n), and G (Rc, n, n)."""

    rows: IntArray
    q_rows: IntArray
    columns: slice
    Phi: Array
    G: Array


class CoordinateMap:
    """The map of one system."""

    def __init__(self, system: System) -> None:
        self._system, self._bodies = system, [*_bodies(system)]
        on = system.expansion
        self._neutral = pin.neutral(on.model)
        self._X = np.zeros((int(on.model.nv), system.nv))
        self._X[on.v_at, np.arange(len(on.v_at))] = 1.0
        for body in self._bodies:
            self._X[body.rows, body.columns] = body.Phi

    def at(self, Y: Array, V: Array | None = None, A: Array | None = None) -> Configuration:
        """The map at n states."""
        none = np.zeros((len(Y), self._system.nv))
        V, A = none if V is None else V, none if A is None else A
        if not self._bodies:
            return Configuration(Y, V, A, None)
        on, shift = self._system.expansion, int(self._system.rigid.nq - self._system.rigid.nv)
        Q = np.tile(self._neutral, (len(Y), 1))
        Q[:, on.q_at] = Y[:, : len(on.q_at)]
        X = np.tile(self._X, (len(Y), 1, 1))
        swept = np.zeros((len(Y), len(self._X)))  # Xdot v
        for body in self._bodies:
            eta = Y[:, body.columns.start + shift : body.columns.stop + shift]
            rate, bent = V[:, body.columns], body.rows[: len(body.G)]
            turned = np.einsum("rij,nj->nri", body.G, eta)
            Q[:, body.q_rows] = eta @ body.Phi.T
            Q[:, body.q_rows[: len(body.G)]] += 0.5 * np.einsum("nri,ni->nr", turned, eta)
            X[:, bent, body.columns] += turned
            swept[:, bent] = np.einsum("rij,ni,nj->nr", body.G, rate, rate)
        return Configuration(
            Q, (X @ V[:, :, None])[:, :, 0], (X @ A[:, :, None])[:, :, 0] + swept, X
        )


def _bodies(system: System) -> list[_Body]:
    first, found = int(system.rigid.nv), []
    for block in system.expansion.blocks:
        bodies, count, n = block.Phi.shape
        q_rows = block.q_rows.reshape(bodies, count)
        for k in range(bodies):
            start = first + block.eta.start + k * n
            columns = slice(start, start + n)
            found.append(_Body(block.rows[k], q_rows[k], columns, block.Phi[k], block.G[k]))
    return found
