"""Internal dynamics: the vibration that is left when motors keep the platform where it is.

Its poles are the transmission zeros from motor torques to the platform. Those in the right half
plane (not minimum phase) ask for motor motion ahead of the platform's.

Source: Devasia, Chen, Paden (1996); Isidori (1995), Nonlinear Control Systems.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eig

from pinflex.arrays import Array
from pinflex.description.motion import hold
from pinflex.inversion.instant import Instant, balanced
from pinflex.inversion.series import rigid_guess
from pinflex.inversion.target import target
from pinflex.linalg import null_space
from pinflex.mechanics.mechanism import Mechanism

_FORGOTTEN = 1e-7  # share of a pre-actuation that is cut off
_MASSLESS = 1e-9  # a rate so far above the fastest one of the stiffness is that of no mass
_PERIODS = 1.0  # of the slowest vibration, after and before a motion


def zeros(mechanism: Mechanism, coordinates: tuple[str, ...] | None = None) -> Array:
    """Poles of the internal dynamics at home, at rest [1/s], complex, slowest first.

    Args:
        mechanism: Flexible mechanism with a platform.
        coordinates: Platform coordinates that are held; default: as in `command`.
    """
    at = target(mechanism, hold(duration=1.0), np.linspace(0.0, 1.0, 3), 0.0, coordinates)
    instant = Instant(mechanism, at, rubs=False)
    guess, v, a = rigid_guess(instant)
    rest = balanced(instant, guess, 0.0 * v, 0.0 * a)
    found = instant.tangents(0, rest.y[0], 0.0 * v[0], 0.0 * a[0], rest.lam[0])
    # y = N z on the closures and the platform's rows; L keeps what no multiplier reaches.
    N, L = null_space(found.J), null_space(found.lam.T)
    M, C, K = (L.T @ x @ N for x in (found.M, found.C, found.K))
    n, none = len(M), np.zeros_like(M)
    A = np.block([[none, np.eye(n)], [-K, -C]])
    E = np.block([[np.eye(n), none], [none, M]])
    alpha, beta = eig(A, E, right=False, homogeneous_eigvals=True)
    finite = np.abs(beta) > _MASSLESS * np.abs(alpha) / max(float(np.max(np.abs(A))), 1e-300) ** 0.5
    poles = alpha[finite] / beta[finite]
    return np.asarray(poles[np.argsort(np.abs(poles))])


def rest_needed(mechanism: Mechanism) -> tuple[float, float]:
    """Rest ahead of a motion and after it [s] that the internal dynamics at home ask for."""
    poles = zeros(mechanism)
    if not len(poles):
        return 0.0, 0.0
    period = _PERIODS * 2.0 * np.pi / float(np.abs(poles[0]))
    ahead, behind = actuated_at_rest(poles)
    return max(period, ahead), max(period, behind)


def actuated_at_rest(poles: Array) -> tuple[float, float]:
    """How long motors move before the motion begins and after its end [s], but for `_FORGOTTEN`.

    Args:
        poles: Of the internal dynamics [1/s]; what swings, not growing or fading fast, asks for no
            motion at rest.
    """
    times = []
    for side in (1.0, -1.0):
        growing = side * poles.real
        fast = growing[growing > 0.1 * np.abs(poles)]
        times.append(-np.log(_FORGOTTEN) / float(fast.min()) if len(fast) else 0.0)
    return times[0], times[1]
