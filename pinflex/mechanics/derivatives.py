"""Derivatives of the residual at one state, as weighted sums of M, C and K.

Pinocchio differentiates rnea on the expanded model with local forces held fixed; the map, the
closures and the loads add the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.coordinate_map import Configuration
from pinflex.mechanics.loads import LoadState

if TYPE_CHECKING:
    from pinflex.mechanics.system import System


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives at one state.

    Attributes:
        system: What was evaluated. here: Its configuration and map there.
        dQ, dV, M: Of rnea on the expanded model, shape (nV, nV).
        g: Expanded forces rnea - J_Q' lam, shape (nV,).
        v: Speeds (nv,). a_eta: Elastic accelerations.
        bent: Links whose energy is of fourth order: their eta, and their stiffness.
        follow: Part of d(J' lam)/dy that moves with the bodies, shape (nv, nv), or None.
        load: Loads there, or None. t: Time in s at which they act.
    """

    system: System
    here: Configuration
    dQ: Array
    dV: Array
    M: Array
    g: Array
    v: Array
    a_eta: Array
    bent: list[tuple[slice, Array]]
    follow: Array | None
    load: LoadState | None
    t: float

    def weighted(self, weights: Sequence[Sequence[float]] | Array, rates: bool) -> Array:
        """Sums w[0] dr/da + w[1] dr/dv + w[2] dr/dy, one for each w of weights, (k, nv, nv).

        Args:
            weights: Of M, C and K, shape (k, 3).
            rates: Whether with the rates of the second-order rows.
        """
        weights = np.asarray(weights, float)
        w_v, w_y = weights[:, 1, None, None], weights[:, 2, None, None]
        S = self._on_both_sides(self._expanded(weights))
        m = int(self.system.rigid.nv)
        if self.system.n_eta:
            if rates and weights[:, 1:].any():
                by_v, by_y = self._rates
                S[:, :, m:] += w_v * by_v + w_y * by_y
            if w_y.any():
                self._add_geometric(S[:, m:, m:], w_y)
        if self.follow is not None:
            S -= w_y * self.follow
        if self.load is not None:
            for of, (_, by_v, by_y) in zip(S, weights.tolist(), strict=True):
                if by_v or by_y:
                    of += self.load.tangent(self.here.times_map, self.t, by_v, by_y)
        S += w_v * self.system.D
        S += w_y * self.system.K
        s, rub = self.system.springs, self.system.friction
        if len(s.v_at):
            S[:, s.v_at, s.v_at] += w_y[:, 0] * s.stiffness
        if rub.present and w_v.any():
            S[:, rub.rows, rub.rows] += w_v[:, 0] * rub.slope(self.v)
        for at, stiffness in self.bent:
            S[:, m:, m:][:, at, at] += w_y * stiffness
        return S

    def _expanded(self, weights: Array) -> Array:
        """The weighted sums of Pinocchio's derivatives, shape (k, nV, nV)."""
        shape = len(weights), *self.M.shape
        parts = (self.M, self.dV, self.dQ)
        if len(weights) == 1:
            return np.asarray(
                sum(w * part for w, part in zip(weights[0], parts, strict=True) if w)
            ).reshape(shape)
        return weights.dot(np.array(parts).reshape(3, -1)).reshape(shape)

    def _on_both_sides(self, D: Array) -> Array:
        """X' D X, shape (k, nv, nv), for each of D (k, nV, nV)."""
        k, nV, _ = D.shape
        right = self.here.times_map(D.reshape(k * nV, nV)).reshape(k, nV, -1)
        return self._from_left(right.swapaxes(0, 1))

    def _from_left(self, B: Array) -> Array:
        """X' B, shape (k, nv, n), for B (nV, k, n)."""
        nV, k, n = B.shape
        found = self.here.from_left(B.reshape(nV, k * n))
        return np.ascontiguousarray(found.reshape(-1, k, n).swapaxes(0, 1))

    @property
    def _rates(self) -> Array:
        """What the changing second-order rows bring into elastic columns of C, K, (2, nv, n_eta).

        2 X' M Xdot, and X' (M (G a) + dV Xdot).
        """
        here, nV = self.here, len(self.M)
        both, extra = np.concatenate([self.M, self.dV]), np.zeros((nV, 2, self.system.n_eta))
        for k, (block, rate) in enumerate(here.blocks()):
            bodies, curved, n = rate.shape
            if curved:
                factors = np.concatenate([rate, here.bend(k, self.a_eta)], axis=2)
                found = here.times_curved(both, k, factors).reshape(2, nV, bodies, 2, n)
                extra[:, 0, block.eta] = 2.0 * found[0, :, :, 0].reshape(nV, -1)
                extra[:, 1, block.eta] = (found[0, :, :, 1] + found[1, :, :, 0]).reshape(nV, -1)
        return self._from_left(extra)

    def _add_geometric(self, S: Array, w_y: Array) -> None:
        """Geometric stiffness: sum of G_k weighted by the force g_k on each curved row."""
        for block, _ in self.here.blocks():
            bodies, curved, n = block.G.shape[:3]
            if not curved:
                continue
            weights = self.g[block.rows[:, :curved]]
            stiff = np.matmul(weights[:, None, :], block.G.reshape(bodies, curved, n * n))
            for k, part in enumerate(stiff.reshape(-1, n, n)):
                start = block.eta.start + k * n
                S[:, start : start + n, start : start + n] += w_y * part
