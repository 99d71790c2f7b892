"""Derivatives of the residual at one state, as a weighted sum of M, C and K.

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

    def weighted(self, weights: Sequence[float] | Array, rates: bool) -> Array:
        """weights[0] dr/da + weights[1] dr/dv + weights[2] dr/dy, shape (nv, nv).

        Args:
            weights: Of M, C and K. rates: Whether with the rates of the second-order rows.
        """
        w_a, w_v, w_y = (float(w) for w in weights)
        S = self.here.both_sides(self._expanded(w_a, w_v, w_y))
        m = int(self.system.rigid.nv)
        if self.system.n_eta:
            if rates and (w_v or w_y):
                self._add_rates(S[:, m:], w_v, w_y)
            if w_y:
                self._add_geometric(S[m:, m:], w_y)
        if self.follow is not None and w_y:
            S -= w_y * self.follow
        if self.load is not None and (w_v or w_y):
            S += self.load.tangent(self.here.times_map, self.t, w_v, w_y)
        S += w_v * self.system.D + w_y * self.system.K
        s, rub = self.system.springs, self.system.friction
        S[s.v_at, s.v_at] += w_y * s.stiffness
        if w_v and rub.present:
            S[rub.rows, rub.rows] += w_v * rub.slope(self.v)
        for at, stiffness in self.bent:
            S[m:, m:][at, at] += w_y * stiffness
        return S

    def _expanded(self, w_a: float, w_v: float, w_y: float) -> Array:
        """The weighted sum of Pinocchio's derivatives, shape (nV, nV)."""
        each = zip((w_a, w_v, w_y), (self.M, self.dV, self.dQ), strict=True)
        first, *others = (w * part for w, part in each if w)
        for part in others:
            first += part
        return np.asarray(first)

    def _add_rates(self, S: Array, w_v: float, w_y: float) -> None:
        """What the changing second-order rows bring into the elastic columns of C and K."""
        extra = np.zeros((len(self.M), S.shape[1]))
        for k, (block, rate) in enumerate(self.here.blocks()):
            if not block.G.shape[1]:
                continue
            inertial = 2.0 * w_v * rate + w_y * self.here.bend(k, self.a_eta)
            extra[:, block.eta] += self.here.times_curved(self.M, k, inertial)
            if w_y:
                extra[:, block.eta] += self.here.times_curved(self.dV, k, w_y * rate)
        S += self.here.from_left(extra)

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
