"""The coordinate map of a system at one state or at many: Q = T(y), V = X v, A = X a + Xdot v.

X = dQ/dy is the identity on the rigid rows and Phi + G eta on the rows of each flexible body.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray

if TYPE_CHECKING:
    from pinflex.mechanics.expanded import Block, Expansion

_SIZES = 8  # numbers of states whose arrays are kept


class CoordinateMap:
    """The map of one expansion: constants, and the indices of n states side by side.

    Attributes:
        n_rigid, nq_rigid: Rigid velocities and coordinates. nv: Length of v.
        flexible: Whether any link bends.
    """

    def __init__(self, rigid: pin.Model, expansion: Expansion) -> None:
        self.expansion, self.blocks = expansion, expansion.blocks
        self.n_rigid, self.nq_rigid = int(rigid.nv), int(rigid.nq)
        self.nv = self.n_rigid + expansion.n_eta
        self.flexible = expansion.n_eta > 0
        self.rows = [block.rows.reshape(-1) for block in self.blocks]
        # Turned once: G eta of all states of a body is one product.
        self.G = [
            block.G.reshape(len(block.G), -1, block.G.shape[-1]).transpose(0, 2, 1).copy()
            for block in self.blocks
        ]
        self._rooms: dict[tuple[int, int], _Room] = {}

    def at(
        self, Y: Array, V: Array | None = None, A: Array | None = None, passing: bool = False
    ) -> Configuration:
        """The map at n states.

        Args:
            Y: Shape (n, nq). V, A: Rates, shape (n, nv), both or neither.
            passing: The next such call may overwrite the answer. For a caller that hands nothing of
                it on: a step is spared a dozen new arrays in every iteration.
        """
        if not self.flexible:
            return Configuration(self, Y, [] if V is None or A is None else [V, A], [], [])
        size = 1 if V is None or A is None else 3, len(Y)
        room = self._rooms.get(size) if passing else _Room(self, *size)
        if room is None:
            if len(self._rooms) > _SIZES:
                self._rooms.clear()
            room = self._rooms[size] = _Room(self, *size)
        q, v = self.nq_rigid, self.n_rigid
        every, eta = room.every, room.eta
        eta[0] = Y[:, q:]
        if V is None or A is None:
            every[room.rigid] = Y[:, :q].ravel()
        else:
            eta[1], eta[2] = V[:, v:], A[:, v:]
            every[room.rigid] = np.concatenate((Y[:, :q], V[:, :v], A[:, :v]), axis=None)
        for block in room.blocks:
            block.evaluate()
            every[block.at] = block.rows
        return Configuration(self, room.Q, room.rates, room.X, room.rate)


class _Room:
    """Arrays that n states are evaluated in: poses alone (m = 1) or with rates (m = 3).

    Attributes:
        every: Q, V and A of all states, flat, one after the other. Q, rates: Views of it.
        eta: Elastic coordinates and their rates, shape (m, n, n_eta). X, rate: As in the answer.
        rigid: Places of the rigid ones in `every`.
    """

    def __init__(self, of: CoordinateMap, m: int, n: int) -> None:
        nQ, nV = int(of.expansion.model.nq), int(of.expansion.model.nv)
        Q_end, V_end = n * nQ, n * (nQ + nV)
        self.every = np.zeros(Q_end + (m - 1) * n * nV)
        self.Q = self.every[:Q_end].reshape(n, nQ)
        self.Q[:] = pin.neutral(of.expansion.model)  # for joints that neither side moves
        halves = self.every[Q_end:V_end], self.every[V_end:]
        self.rates = [half.reshape(n, nV) for half in halves if m > 1]

        def flat(q_at: IntArray, v_at: IntArray) -> IntArray:
            Q = (q_at + nQ * np.arange(n)[:, None]).reshape(-1)
            rates = Q_end + (v_at + nV * np.arange((m - 1) * n)[:, None]).reshape(-1)
            return np.concatenate([Q, rates])

        self.rigid = flat(of.expansion.q_at, of.expansion.v_at)
        self.eta = np.empty((m, n, of.expansion.n_eta))
        each = zip(of.blocks, of.G, of.rows, strict=True)
        self.blocks = [
            _BlockRoom(block, G, self.eta, flat(block.q_rows, rows)) for block, G, rows in each
        ]
        self.X, self.rate = [b.X for b in self.blocks], [b.bent[-1] for b in self.blocks]


class _BlockRoom:
    """One block of the map at n states, evaluated in place; all is written anew each time.

    Attributes:
        at: Places of its rows among the coordinates of all states. rows: Q, V and A of them, flat.
        X: Shape (n, bodies, R, width). bent: G eta, then its rate, (1 or 2, n, bodies, Rc, width).
    """

    def __init__(self, block: Block, G: Array, eta: Array, at: IntArray) -> None:
        m, n = eta.shape[:2]
        (bodies, R, width), self._curved = block.Phi.shape, block.G.shape[1]
        kinds, Rc = min(m, 2), self._curved
        self.at, self._G, self._Phi = at, G, block.Phi[:, :Rc]
        self._eta = eta[:, :, block.eta].reshape(m, n, bodies, width, 1)
        self._bending = self._eta[:2]
        self._side = self._bending.reshape(kinds * n, bodies, width).transpose(1, 0, 2)
        self._product = np.empty((bodies, kinds * n, Rc * width))
        self.bent = self._product.transpose(1, 0, 2).reshape(kinds, n, bodies, Rc, width)
        self.X = np.empty((n, bodies, R, width))
        self.X[:] = block.Phi
        self._X_curved = self.X[:, :, :Rc]
        self._moved = np.empty((m, n, bodies, R, 1))
        self._lifted = self._moved[::2, :, :, :Rc]  # Q and A
        self._lift = np.empty((kinds, n, bodies, Rc, 1))
        self.rows = self._moved.reshape(-1)

    def evaluate(self) -> None:
        """X = Phi + G eta; Q = X eta - 1/2 (G eta) eta, V = X v, A = X a + (G v) v."""
        if self._curved:
            np.matmul(self._side, self._G, out=self._product)
            np.add(self._Phi, self.bent[0], out=self._X_curved)
        np.matmul(self.X, self._eta, out=self._moved)
        if self._curved:
            np.matmul(self.bent, self._bending, out=self._lift)
            self._lift[0] *= -0.5
            self._lifted += self._lift


class Configuration:
    """The expanded configuration of n states and the blocks of X there.

    Attributes:
        Q: Shape (n, nQ). V, A: Rates, shape (n, nV), those of no state where none were given.
        X: By block, shape (n, bodies, R, width). rate: Xdot of its curved rows.
    """

    __slots__ = ("A", "Q", "V", "X", "_map", "rate")

    def __init__(
        self,
        of: CoordinateMap,
        Q: Array,
        rates: Sequence[Array],
        X: list[Array],
        rate: list[Array],
    ) -> None:
        self._map, self.Q, self.X, self.rate = of, Q, X, rate
        none = np.empty((0, 0))
        self.V, self.A = rates if rates else (none, none)

    def project(self, G: Array) -> Array:
        """X' g, shape (n, nv), for expanded forces g (n, nV)."""
        of = self._map
        if not of.flexible:
            return G.copy()
        n, first = len(G), of.n_rigid
        out = np.empty((n, of.nv))
        out[:, :first] = G.take(of.expansion.v_at, axis=1)
        for rows, X, block in zip(of.rows, self.X, of.blocks, strict=True):
            force = G.take(rows, axis=1).reshape(n, X.shape[1], 1, -1)
            out[:, first:][:, block.eta] = np.matmul(force, X).reshape(n, -1)
        return out

    def times_map(self, D: Array) -> Array:
        """D X, shape (..., k, nv), for D (k, nV) of one state or (n, k, nV) of all."""
        of = self._map
        if not of.flexible:
            return D.copy()
        each = D if D.ndim == 3 else D[None]
        out = np.empty((*each.shape[:2], of.nv))
        out[:, :, : of.n_rigid] = each[:, :, of.expansion.v_at]
        for k, X in enumerate(self.X):
            out[:, :, of.n_rigid :][:, :, of.blocks[k].eta] = self._columns(each, k, X)
        return np.asarray(out.reshape(*D.shape[:-1], of.nv))

    def _columns(self, D: Array, k: int, factor: Array) -> Array:
        """Columns of D (n, m, nV) at the first rows of block k's bodies, times their factors."""
        n, m = D.shape[:2]
        bodies, rows = factor.shape[1:3]
        at = self._map.blocks[k].rows[:, :rows].reshape(-1)
        columns = D[:, :, at].reshape(n, m, bodies, rows).transpose(0, 2, 1, 3)
        found: Array = np.matmul(columns, factor).transpose(0, 2, 1, 3).reshape(n, m, -1)
        return found

    def blocks(self) -> Iterator[tuple[Block, Array]]:
        """Blocks of the map, with Xdot of their curved rows at one state, (bodies, Rc, width)."""
        for block, rate in zip(self._map.blocks, self.rate, strict=True):
            yield block, rate[0]

    def bend(self, k: int, eta: Array) -> Array:
        """G eta of the curved rows of block k, (bodies, Rc, width), for one eta (n_eta,).

        Args:
            k: Number of the block.
            eta: Elastic coordinates of one state, shape (n_eta,).
        """
        bodies, _, width = self._map.blocks[k].Phi.shape
        side = eta[self._map.blocks[k].eta].reshape(bodies, 1, width)
        return np.asarray(np.matmul(side, self._map.G[k]).reshape(bodies, -1, width))

    def times_curved(self, D: Array, k: int, factor: Array) -> Array:
        """Columns of D (m, nV) at the curved rows of block k, times (bodies, Rc, width).

        Args:
            D: Rows by expanded velocities, shape (m, nV).
            k: Number of the block.
            factor: One matrix for each body of the block, shape (bodies, Rc, width).
        """
        found: Array = self._columns(D[None], k, factor[None])[0]
        return found

    def both_sides(self, D: Array) -> Array:
        """X' D X, shape (nv, nv), for D (nV, nV) of one state."""
        return D.copy() if not self._map.flexible else self.from_left(self.times_map(D))

    def from_left(self, B: Array) -> Array:
        """X' B, shape (nv, k), for B (nV, k) of one state."""
        of = self._map
        if not of.flexible:
            return B.copy()
        out = np.empty((of.nv, B.shape[1]))
        out[: of.n_rigid] = B[of.expansion.v_at]
        for block, rows, X in zip(of.blocks, of.rows, self.X, strict=True):
            part = B[rows].reshape(X.shape[1], X.shape[2], -1)
            turned = X[0].transpose(0, 2, 1)
            out[of.n_rigid :][block.eta] = np.matmul(turned, part).reshape(-1, B.shape[1])
        return out
