"""What a mechanism does when the motors of a command stop at its end: free vibration about rest.

Motors that stop with a way to go, or at speed, leave the mechanism off its equilibrium. Where they
stop at once they give it a blow that keeps the momenta of everything else,

    N' M_ff N z' = N' (M_ff v_f + M_fm v_m),      J_f N = 0

where they stop softly the elastic speeds stay, N z' = v_f: the larger one counts. Each mode swings
on with the energy that it then has. Damping is left out: a bar.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.inversion.differences import EIGHTH, rates
from pinflex.inversion.instant import Balanced, Instant
from pinflex.linalg import eigh, null_space, saddle

_SAFETY = 2.0  # to first order, and of loops neither a blow nor soft: seen up to 1.7
_STILL = 1e-6  # of the fastest rate, below which nothing holds a mode: it goes on, and is left out


def swing_after(instant: Instant, found: Balanced, rest: Balanced, n: int) -> Array:
    """Bar on the platform's error [m | rad] after the motors have stopped, shape (k,)."""
    d, motors, free = instant.dynamics, instant.system.motors, instant.free
    around = found.y[n - 1 - EIGHTH.reach : n + EIGHTH.reach]
    v = rates(d, around, float(instant.target.t[1]), EIGHTH)[0][0]
    y, still = rest.y[n - 1], np.zeros(instant.system.nv)
    M, _, K, J = d.tangent(y, still, still, rest.lam[n - 1], float(instant.target.t[n - 1]))
    P = instant.platform.at(d.kinematics(y[None]))[1][0]
    off = d.difference(y, found.y[n - 1])
    # the equilibrium of where the motors stop, and the way and speed from there
    J_f, stop = J[:, free], off[motors]
    balance, _ = saddle(
        K[np.ix_(free, free)], J_f, J_f, -K[np.ix_(free, motors)] @ stop, -J[:, motors] @ stop
    )
    N = null_space(J_f)
    m, k = (N.T @ x[np.ix_(free, free)] @ N for x in (M, K))
    squares, Z = eigh(0.5 * (k + k.T), 0.5 * (m + m.T))
    way = Z.T @ m @ N.T @ (off[free] - balance)
    blow, soft = Z.T @ N.T @ M[free] @ v, Z.T @ m @ N.T @ v[free]
    speed = np.maximum(np.abs(blow), np.abs(soft))
    rate = np.sqrt(np.maximum(squares, 0.0))
    held = rate > _STILL * np.max(rate, initial=0.0)
    swing = np.hypot(way[held], speed[held] / rate[held])
    shapes = np.abs(P[:, free] @ N @ Z[:, held])
    stays = np.abs(P[:, motors] @ stop + P[:, free] @ balance)
    return np.asarray(_SAFETY * (stays + shapes @ swing))
