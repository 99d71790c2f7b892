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

    @property
    def each(self) -> tuple[Array, Array, Array]:
        """M, C and K, shape (nv, nv) each, with the rates of the second-order rows."""
        M, C, K = self.weighted(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), True)
        return M, C, K

    def weighted(self, weights: Sequence[Sequence[float]], rates: bool) -> Array:
        """Sums w[0] dr/da + w[1] dr/dv + w[2] dr/dy, one for each w of weights, (k, nv, nv).

        Args:
            weights: Of M, C and K, shape (k, 3).
            rates: Whether with the rates of the second-order rows.
        """
        S = self._on_both_sides(self._expanded(weights))
        elastic, bends = slice(int(self.system.rigid.nv), None), self.system.n_eta > 0
        turning = self._rates if bends and rates and any(v or y for _, v, y in weights) else None
        for each, (_, w_v, w_y) in zip(S, weights, strict=True):
            if turning is not None and (w_v or w_y):
                each[:, elastic] += w_v * turning[0] + w_y * turning[1]
            if self.load is not None and (w_v or w_y):
                each += self.load.tangent(self.here.times_map, self.t, w_v, w_y)
            if w_v:
                self._add_damping(each, w_v)
            if w_y:
                self._add_stiffness(each, w_y)
                if bends:
                    self._add_geometric(each[elastic, elastic], w_y)
        return S

    def _add_damping(self, S: Array, w_v: float) -> None:
        """Dampers and friction."""
        S += w_v * self.system.D
        if (rub := self.system.friction).present:
            S[rub.rows, rub.rows] += w_v * rub.slope(self.v)

    def _add_stiffness(self, S: Array, w_y: float) -> None:
        """Links, springs, and what closures' forces do that move with the bodies."""
        S += w_y * self.system.K
        if self.follow is not None:
            S -= w_y * self.follow
        springs, m = self.system.springs, int(self.system.rigid.nv)
        if len(springs.v_at):
            S[springs.v_at, springs.v_at] += w_y * springs.stiffness
        for at, stiffness in self.bent:
            S[m:, m:][at, at] += w_y * stiffness

    def _expanded(self, weights: Sequence[Sequence[float]]) -> Array:
        """The weighted sums of Pinocchio's derivatives, shape (k, nV, nV)."""
        found = np.zeros((len(weights), *self.M.shape))
        for S, row in zip(found, weights, strict=True):
            for w, part in zip(row, (self.M, self.dV, self.dQ), strict=True):
                if w:
                    S += part if w == 1.0 else w * part
        return found

    def _on_both_sides(self, D: Array) -> Array:
        """X' D X, shape (k, nv, nv), for each of D (k, nV, nV)."""
        k, nV, _ = D.shape
        right = self.here.times_map(D.reshape(k * nV, nV)).reshape(k, nV, self.system.nv)
        return self._from_left(right.swapaxes(0, 1))

    def _from_left(self, B: Array) -> Array:
        """X' B, shape (k, nv, n), for B (nV, k, n)."""
        nV, k, n = B.shape
        found = self.here.from_left(B.reshape(nV, k * n))
        return np.ascontiguousarray(found.reshape(self.system.nv, k, n).swapaxes(0, 1))

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

    def _add_geometric(self, S: Array, w_y: float) -> None:
        """Geometric stiffness: sum of G_k weighted by the force g_k on each curved row."""
        for block, _ in self.here.blocks():
            bodies, curved, n = block.G.shape[:3]
            if not curved:
                continue
            weights = self.g[block.rows[:, :curved]]
            stiff = np.matmul(weights[:, None, :], block.G.reshape(bodies, curved, n * n))
            for k, part in enumerate(stiff.reshape(-1, n, n)):
                start = block.eta.start + k * n
                S[start : start + n, start : start + n] += w_y * part
