"""The coordinate map of a system at one state or at many: Q = T(y), V = X v, A = X a + Xdot v.

X = dQ/dy is the identity on the rigid rows and Phi + G eta on the rows of each flexible body.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.expanded import Block, Expansion

_SIZES = 8  # numbers of states whose index tables are kept


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
        self._neutral, self._nV = pin.neutral(expansion.model), int(expansion.model.nv)
        self.no_rates = np.empty((0, self._nV))
        self.rows = [block.rows.reshape(-1) for block in self.blocks]
        # Turned once: G eta of all states of a body is one product.
        self._G = [
            block.G.reshape(len(block.G), -1, block.G.shape[-1]).transpose(0, 2, 1).copy()
            for block in self.blocks
        ]
        written = sum(len(rows) for rows in self.rows)
        self._whole = self.n_rigid + written == self._nV
        self._flat: dict[int, _Flat] = {}

    def at(self, Y: Array, V: Array | None = None, A: Array | None = None) -> Configuration:
        """The map at n states.

        Args:
            Y: Shape (n, nq). V, A: Rates, shape (n, nv), both or neither.
        """
        rates = [] if V is None or A is None else [V, A]
        if not self.flexible:
            return Configuration(self, Y, rates, [], [])
        n, q, v = len(Y), self.nq_rigid, self.n_rigid
        at = self._flat.get(n)
        if at is None:
            if len(self._flat) > _SIZES:
                self._flat.clear()
            at = self._flat[n] = _Flat(self, n)
        if self._whole:
            every = np.empty(at.ends[-1])
        else:  # joints that neither side moves
            every = np.concatenate([np.tile(self._neutral, n), np.zeros(at.ends[-1] - at.ends[0])])
        rigid = [Y[:, :q], *(x[:, :v] for x in rates)]
        every[at.rigid[len(rates)]] = np.concatenate(rigid, axis=None)
        elastic = np.array([Y[:, q:], *(x[:, v:] for x in rates)])
        X, turning = [], []
        for k, block in enumerate(self.blocks):
            X_k, rate, rows = self._block(k, block, elastic)
            X.append(X_k)
            turning.append(rate)
            moved = rows.reshape(-1)
            every[at.rows[k][: len(moved)]] = moved
        Q, V, A = (
            every[first:last].reshape(n, -1)
            for first, last in zip((0, *at.ends), at.ends, strict=False)
        )
        return Configuration(self, Q, (V, A) if rates else (), X, turning)

    def _block(self, k: int, block: Block, states: Array) -> tuple[Array, Array, Array]:
        """X (n, bodies, R, k) and its rate's curved rows; coordinates and rates of the rows.

        Args:
            k: Number of the block. block: It. states: eta, or eta and its rates, (m, n, n_eta).
        Returns:
            X; Xdot of the curved rows (n, bodies, Rc, k), empty without rates; Q, V, A of the
            rows, shape (m, n, bodies, R, 1).
        """
        m, n = states.shape[:2]
        (bodies, rows, width), curved = block.Phi.shape, block.G.shape[1]
        mine = states[:, :, block.eta].reshape(m, n, bodies, width, 1)
        X = np.empty((n, bodies, rows, width))
        X[:] = block.Phi
        if not curved:
            return X, np.zeros((n, bodies, 0, width)), np.matmul(X, mine)
        bent = self.bend(k, mine[:2])
        X[:, :, :curved] += bent[0]
        moved: Array = np.matmul(X, mine)
        lift = np.matmul(bent, mine[:2])
        lift[0] *= -0.5
        moved[::2, :, :, :curved] += lift
        return X, bent[-1], moved

    def bend(self, k: int, eta: Array) -> Array:
        """G eta of the curved rows of block k.

        Args:
            k: Number of the block. eta: Of its bodies, shape (m, n, bodies, width, 1).
        Returns:
            Shape (m, n, bodies, Rc, width).
        """
        m, n, bodies, width, _ = eta.shape
        side = eta.reshape(m * n, bodies, width).transpose(1, 0, 2)
        bent: Array = np.matmul(side, self._G[k]).transpose(1, 0, 2)
        return bent.reshape(m, n, bodies, -1, width)


class _Flat:
    """Places of Q, V and A of n states in one flat array, one after the other.

    Attributes:
        ends: Where Q, V and A end. rigid: Rigid coordinates, with 0 or 2 rates. rows: Of blocks.
    """

    def __init__(self, of: CoordinateMap, n: int) -> None:
        nQ, nV = int(of.expansion.model.nq), int(of.expansion.model.nv)
        self.ends = n * nQ, n * (nQ + nV), n * (nQ + 2 * nV)

        def flat(q_at: IntArray, v_at: IntArray) -> IntArray:
            Q = (q_at + nQ * np.arange(n)[:, None]).reshape(-1)
            rates = n * nQ + (v_at + nV * np.arange(2 * n)[:, None]).reshape(-1)
            return np.concatenate([Q, rates])

        rigid = flat(of.expansion.q_at, of.expansion.v_at)
        self.rigid = {0: rigid[: n * of.nq_rigid], 2: rigid}
        both = zip(of.blocks, of.rows, strict=True)
        self.rows = [flat(block.q_rows, rows) for block, rows in both]


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
        self.V: Array = rates[0] if rates else of.no_rates
        self.A: Array = rates[1] if rates else of.no_rates

    def project(self, G: Array) -> Array:
        """X' g, shape (n, nv), for expanded forces g (n, nV)."""
        of = self._map
        if not of.flexible:
            return G.copy()
        n, parts = len(G), [G.take(of.expansion.v_at, axis=1)]
        for rows, X in zip(of.rows, self.X, strict=True):
            force = G.take(rows, axis=1).reshape(n, X.shape[1], 1, -1)
            parts.append(np.matmul(force, X).reshape(n, -1))
        return np.concatenate(parts, axis=1)  # blocks are in the order of eta

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
        """G eta of the curved rows of block k, (bodies, Rc, width), for one eta (n_eta,)."""
        bodies, _, width = self._map.blocks[k].Phi.shape
        mine = eta[self._map.blocks[k].eta].reshape(1, 1, bodies, width, 1)
        bent: Array = self._map.bend(k, mine)[0, 0]
        return bent

    def times_curved(self, D: Array, k: int, factor: Array) -> Array:
        """Columns of D (m, nV) at the curved rows of block k, times (bodies, Rc, width)."""
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
