"""Internal dynamics: the vibration that is left when motors keep the platform where it is.

Its poles are the transmission zeros from motor torques to the platform. Those in the right half
plane (not minimum phase) ask for motor motion ahead of the platform's.

Source: Devasia, Chen, Paden (1996); Isidori (1995), Nonlinear Control Systems.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion, hold
from pinflex.inversion.instant import Balanced, Instant, balanced
from pinflex.inversion.on_grid import rigid_guess
from pinflex.inversion.target import Target, target
from pinflex.linalg import lapack, null_space
from pinflex.mechanics.mechanism import Mechanism

_FORGOTTEN = 1e-7  # share of a pre-actuation that is cut off
_MASSLESS = 1e-9  # a rate so far above the fastest one of the stiffness is that of no mass
_PERIODS = 1.0  # of the slowest vibration, after and before a motion
_POSES = 51  # along a motion: near enough for its branch to be kept


@dataclass(frozen=True)
class Poles:
    """Poles of the internal dynamics at rest [1/s], complex, slowest first.

    Attributes:
        first, last: Where a motion begins, and where it ends.
    """

    first: Array
    last: Array

    @property
    def ahead(self) -> float:
        """How long motors move before the motion begins [s], but for `_FORGOTTEN`."""
        return _lasting(self.first)

    @property
    def rests(self) -> tuple[float, float]:
        """Rest ahead of a motion and after it [s]: so long, and a period of the slowest."""
        slowest = [float(np.abs(x[0])) for x in (self.first, self.last) if len(x)]
        period = _PERIODS * 2.0 * np.pi / min(slowest) if slowest else 0.0
        return max(period, self.ahead), max(period, _lasting(-self.last))

    def cut_off(self, before: float) -> float:
        """Share of what motors do ahead of a motion that a rest of `before` [s] has no room for."""
        fast = _fast(self.first)
        return float(np.exp(-before * fast.min())) if len(fast) else 0.0


def internal_poles(
    mechanism: Mechanism, motion: Motion, coordinates: tuple[str, ...] = ()
) -> Poles:
    """Poles of the internal dynamics at rest where a motion begins and where it ends."""
    path = target(mechanism, motion, np.linspace(0.0, motion.duration, _POSES), 0.0, coordinates)
    return Poles(*_of(mechanism, path.at([0, -1])))


def zeros(mechanism: Mechanism, coordinates: tuple[str, ...] | None = None) -> Array:
    """Poles of the internal dynamics at home, at rest [1/s], complex, slowest first."""
    still = hold(duration=1.0)
    return _of(mechanism, target(mechanism, still, np.linspace(0.0, 1.0, 3), 0.0, coordinates))[0]


def _of(mechanism: Mechanism, poses: Target) -> tuple[Array, ...]:
    """Poles at each pose of a path, at rest."""
    instant = Instant(mechanism, poses, rubs=False)
    guess, v, a = rigid_guess(instant)
    rest = balanced(instant, guess, 0.0 * v, 0.0 * a)
    return tuple(_at(instant, k, rest) for k in range(len(poses.t)))


def _at(instant: Instant, k: int, rest: Balanced) -> Array:
    still = np.zeros(instant.system.nv)
    found = instant.tangents(k, rest.y[k], still, still, rest.lam[k])
    # y = N z on the closures and the platform's rows; L keeps what no multiplier reaches.
    N, L = null_space(found.J), null_space(found.lam.T)
    M, C, K = (L.T @ x @ N for x in (found.M, found.C, found.K))
    n, none = len(M), np.zeros_like(M)
    A = np.block([[none, np.eye(n)], [-K, -C]])
    E = np.block([[np.eye(n), none], [none, M]])
    real, imaginary, beta, *_, info = lapack().dggev(A, E, compute_vl=0, compute_vr=0)
    if info:
        raise np.linalg.LinAlgError(f"dggev: info {info}")
    alpha = real + 1j * imaginary
    finite = np.abs(beta) > _MASSLESS * np.abs(alpha) / max(float(np.max(np.abs(A))), 1e-300) ** 0.5
    poles = alpha[finite] / beta[finite]
    return np.asarray(poles[np.argsort(np.abs(poles))])


def _fast(poles: Array) -> Array:
    """Rates [1/s] of what grows fast; what swings, growing or fading slowly, asks for no rest."""
    growing = poles.real
    return np.asarray(growing[growing > 0.1 * np.abs(poles)])


def _lasting(poles: Array) -> float:
    """How long what grows fast takes from `_FORGOTTEN` to one [s]."""
    fast = _fast(poles)
    return -float(np.log(_FORGOTTEN)) / float(fast.min()) if len(fast) else 0.0
