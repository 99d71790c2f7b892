"""The coordinate map of one system, evaluated: Q = T(y), V = X v, and products with X = dQ/dy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.mechanics.coordinate_map import CoordinateMap
from pinflex.mechanics.system import System


class ExpandedState:
    """Configuration and map of a system at one state, on preallocated arrays.

    Attributes:
        system: What is evaluated. model: Its expanded model.
        n_rigid, nq_rigid: Rigid velocities and coordinates. flexible: Whether any link bends.
        vector_space: Whether y moves by plain addition.
        Q: Expanded configuration of the last `place`, shape (nQ,).
    """

    def __init__(self, system: System) -> None:
        self.system = system
        expansion = system.expansion
        self.model: pin.Model = expansion.model
        self.n_rigid = int(system.rigid.nv)
        self.nq_rigid = int(system.rigid.nq)
        self.vector_space = self.nq_rigid == self.n_rigid
        self.flexible = system.n_eta > 0
        self.Q = pin.neutral(self.model)
        self._maps = [CoordinateMap(block) for block in expansion.blocks]
        nV = int(self.model.nv)
        self._V, self._A = np.zeros(nV), np.zeros(nV)

    def integrate(self, y: Array, dy: Array) -> Array:
        """y moved by dy on the configuration manifold (right-trivialised), shape (nq,)."""
        if self.vector_space:
            return y + dy
        moved = np.empty_like(y)
        n, m = self.nq_rigid, self.n_rigid
        moved[:n] = pin.integrate(self.system.rigid, y[:n], dy[:m])
        moved[n:] = y[n:] + dy[m:]
        return moved

    def difference(self, y0: Array, y1: Array) -> Array:
        """dy that takes y0 to y1, shape (nv,)."""
        if self.vector_space:
            return y1 - y0
        n, m = self.nq_rigid, self.n_rigid
        dy = np.empty(self.system.nv)
        dy[:m] = pin.difference(self.system.rigid, y0[:n], y1[:n])
        dy[m:] = y1[n:] - y0[n:]
        return dy

    def place(self, y: Array) -> None:
        """Q = T(y) and the blocks of X = dQ/dy."""
        if not self.flexible:
            self.Q = y
            return
        n = self.nq_rigid
        self.Q[self.system.expansion.q_at] = y[:n]
        eta = y[n:]
        for one in self._maps:
            self.Q[one.block.q_rows] = one.place(eta[one.block.eta])

    def expand_motion(self, v: Array, a: Array) -> tuple[Array, Array]:
        """V = X v and A = X a + Xdot v at the placed configuration."""
        if not self.flexible:
            return v, a
        V, A, m, at = self._V, self._A, self.n_rigid, self.system.expansion.v_at
        V[at], A[at] = v[:m], a[:m]
        v_eta, a_eta = v[m:], a[m:]
        for one in self._maps:
            rate = v_eta[one.block.eta]
            column = rate.reshape(one.shape)
            V[one.force_rows] = np.matmul(one.X, column).reshape(-1)
            gain = np.matmul(one.X, a_eta[one.block.eta].reshape(one.shape))
            if one.curved:
                one.rate = one.bend(rate)
                gain[:, : one.curved] += np.matmul(one.rate, column)
            A[one.force_rows] = gain.reshape(-1)
        return V, A

    def project(self, g: Array) -> Array:
        """X' g, shape (nv,), for expanded forces g (nV,)."""
        if not self.flexible:
            return np.array(g)
        m = self.n_rigid
        r = np.empty(self.system.nv)
        r[:m] = g[self.system.expansion.v_at]
        for one in self._maps:
            bodies, rows, _ = one.X.shape
            force = g[one.force_rows].reshape(bodies, rows, 1)
            r[m:][one.block.eta] = np.matmul(one.X_turned, force).reshape(-1)
        return r

    def times_map(self, D: Array) -> Array:
        """D X, shape (k, nv), for D of shape (k, nV)."""
        if not self.flexible:
            return D.copy()
        m = self.n_rigid
        out = np.empty((len(D), self.system.nv))
        out[:, :m] = D[:, self.system.expansion.v_at]
        for one in self._maps:
            self.block_product(D, one, one.X, slice(None), out[:, m:])
        return out

    def block_product(
        self,
        D: Array,
        one: CoordinateMap,
        factor: Array,
        rows: slice,
        out: Array,
        add: bool = False,
    ) -> None:
        """Columns D[:, rows of the bodies] times stacked factors, into the bodies' columns."""
        at = one.block.rows[:, rows]
        bodies, count = at.shape
        columns = D[:, at.reshape(-1)].reshape(len(D), bodies, count).transpose(1, 0, 2)
        product = np.matmul(columns, factor).transpose(1, 0, 2)
        product = product.reshape(len(D), product.shape[1] * product.shape[2])
        if add:
            out[:, one.block.eta] += product
        else:
            out[:, one.block.eta] = product

    @property
    def X(self) -> Array:
        """dQ/dy as one dense matrix, shape (nV, nv) (for tests and reports)."""
        return self.times_map(np.eye(int(self.model.nv)))

    def both_sides(self, D: Array) -> Array:
        """X' D X."""
        if not self.flexible:
            return np.array(D)
        right = self.times_map(D)
        return self.from_left(right)

    def from_left(self, right: Array) -> Array:
        """X' B for B of shape (nV, k)."""
        m = self.n_rigid
        out = np.empty((self.system.nv, right.shape[1]))
        out[:m] = right[self.system.expansion.v_at]
        for one in self._maps:
            bodies, rows, _ = one.X.shape
            part = right[one.force_rows].reshape(bodies, rows, -1)
            out[m:][one.block.eta] = np.matmul(one.X_turned, part).reshape(-1, right.shape[1])
        return out
