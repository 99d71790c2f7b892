"""The exact command: stable inversion of the whole motion at once.

Unknown are the poses at the nodes of a uniform grid, two more at either end, and the multipliers at
every node; v and a are central differences of fourth order. The rows of every instant are
constraints, and of all that satisfy them the motion with the least elastic energy of
y - y_quasistatic is taken. That picks the bounded solution whether the internal dynamics is minimum
phase, rings or is not minimum phase (then motors move before the platform does). Rest is imposed at
the start, by a large weight; the end stays free.

Source: Devasia, Chen, Paden (1996), stable inversion; Bastos, Seifried, Bruels (2013), inverse
dynamics as an optimal control problem with the elastic energy as its cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.sparse import block_diag, bmat, coo_matrix, csc_matrix, identity
from scipy.sparse.linalg import splu

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.inversion.differences import EIGHTH, FOURTH, padded, rates
from pinflex.inversion.instant import Balanced, Instant

_HELD = 1e8  # weight of rest at the start over that of a deviation elsewhere
_SMALL = 1e-6  # weight of the rigid coordinates over the smallest stiffness
_REGULAR = 1e-13  # keeps the saddle matrix regular where constraints depend on each other
_DONE = 1e-10  # m or rad: the last correction; the one after it is round-off
_STALLED = 1e-7  # m or rad: corrections that no longer shrink from here on are round-off
_ASTRAY = 10.0  # m or rad
_DEFERRED = 2  # corrections by differences of order 8: the first gains two orders, so the second
_MOST = 20
_PAD = FOURTH.reach
_WIDTH = 2 * _PAD + 1


@dataclass(frozen=True)
class Inverted:
    """The motion of least deviation.

    Attributes:
        found: Poses, multipliers, torques with differences of order 8.
        error: What order 4 misses of the motor positions [m | rad], shape (nt, nm); that is more
            than what order 8 misses.
        iterations: Linear systems solved.
    """

    found: Balanced
    error: Array
    iterations: int


def invert(instant: Instant, start: Balanced) -> Inverted:
    """Solve for all instants at once, from the quasistatic motion.

    Args:
        instant: Equations along the path.
        start: The quasistatic motion.
    Raises:
        ConvergenceError: The iterations do not settle: the motion is too fast for the grid or
            for the mechanism.
    """
    inversion = _Inversion(instant, start)
    before = size = np.inf
    for iteration in range(1, _MOST + 1):
        size = inversion.correct()
        if size < _DONE or (size < _STALLED and size > 0.5 * before):
            fourth = inversion.motors()
            inversion.refine()
            return Inverted(inversion.balanced(), inversion.motors() - fourth, iteration + 1)
        if not size < _ASTRAY:
            break
        before = size
    h = instant.target.t[1] - instant.target.t[0]
    raise ConvergenceError(
        f"command: the inversion over {len(start.y)} instants of {h:.3g} s does not settle (last "
        f"change {size:.2g}). Ask for more nodes, or slow the motion down."
    )


class _Inversion:
    """Poses (padded) and multipliers of one inversion, and the last factorised saddle matrix."""

    def __init__(self, instant: Instant, start: Balanced) -> None:
        self.instant = instant
        self.h = float(instant.target.t[1] - instant.target.t[0])
        self.reference = padded(start.y, _PAD)
        self.y, self.lam = self.reference.copy(), start.lam.copy()
        free, held = _weights(instant)
        self.weights = [held if k <= _PAD else free for k in range(len(self.y))]
        self._solve: Callable[[Array], Array] = np.asarray
        self._scale = np.ones(0)

    def correct(self) -> float:
        """One linear system for all instants; returns the largest correction of a pose."""
        v, a = rates(self.instant.dynamics, self.y, self.h, FOURTH)
        e = self._rows(v, a)
        G, self._scale = self._constraints(v, a)
        H = block_diag([*self.weights, csc_matrix((self.lam.size, self.lam.size))], format="csc")
        rows = identity(len(self._scale), format="csc")
        self._solve = splu(bmat([[H, G.T], [G, -_REGULAR * rows]], format="csc")).solve
        return self._move(e)

    def refine(self) -> None:
        """Differences of order 8 in the rows, of order 4 in their tangent: deferred correction."""
        for _ in range(_DEFERRED):
            v, a = rates(self.instant.dynamics, self.y, self.h, FOURTH)
            wider = padded(self.y, EIGHTH.reach - _PAD)
            v8, a8 = rates(self.instant.dynamics, wider, self.h, EIGHTH)
            v[:-_PAD], a[:-_PAD] = v8[:-_PAD], a8[:-_PAD]  # beyond the end nothing is known
            self._move(self._rows(v, a))

    def motors(self) -> Array:
        """Motor positions, shape (nt, nm)."""
        return self.instant.axes.read(self.y[_PAD:-_PAD])

    def balanced(self) -> Balanced:
        """Poses, multipliers and torques at the nodes."""
        d, y = self.instant.dynamics, self.y[_PAD:-_PAD]
        v, a = rates(d, padded(self.y, EIGHTH.reach - _PAD), self.h, EIGHTH)
        torque = self.instant.residuals(slice(len(y)), y, v, a, self.lam)[1]
        return Balanced(y, self.lam, torque)

    def _rows(self, v: Array, a: Array) -> Array:
        return self.instant.residuals(slice(len(self.lam)), self.y[_PAD:-_PAD], v, a, self.lam)[0]

    def _move(self, e: Array) -> float:
        """Correct poses and multipliers by the factorised system for open rows e (nt, rows)."""
        d = self.instant.dynamics
        away = np.array([d.difference(*pair) for pair in zip(self.reference, self.y, strict=True)])
        pull = np.concatenate([W @ x for W, x in zip(self.weights, away, strict=True)])
        none = np.zeros(self.lam.size)
        step = self._solve(np.concatenate([-pull, none, -e.ravel() * self._scale]))
        moves = step[: away.size].reshape(away.shape)
        self.y = np.array([d.integrate(*pair) for pair in zip(self.y, moves, strict=True)])
        self.lam = self.lam + step[away.size : away.size + self.lam.size].reshape(self.lam.shape)
        return float(np.max(np.abs(moves)))

    def _constraints(self, v: Array, a: Array) -> tuple[Any, Array]:
        """Jacobian of all rows by (poses, multipliers), rows scaled to one; and the scales."""
        instant, nv, rows = self.instant, self.instant.system.nv, self.instant.rows
        nt, free, per = len(self.lam), len(instant.free), nv + rows
        wide = np.zeros((nt, per, _WIDTH * nv + rows))
        for k in range(nt):
            pose = self.y[k + _PAD]
            found = instant.tangents(k, pose, v[k], a[k], self.lam[k])
            here = found.K.copy()
            for j in (j for j in range(_WIDTH) if j != _PAD):
                block = FOURTH.first[j] / self.h * found.C + FOURTH.second[j] / self.h**2 * found.M
                own, other = _of_difference(instant, pose, self.y[k + j])
                here += block @ own
                wide[k, :free, j * nv : (j + 1) * nv] = block @ other
            wide[k, :free, _PAD * nv : (_PAD + 1) * nv] = here
            wide[k, :free, _WIDTH * nv :] = found.lam
            wide[k, free:, _PAD * nv : (_PAD + 1) * nv] = found.J
        scale = 1.0 / np.maximum(np.max(np.abs(wide), axis=2), 1e-300)
        wide *= scale[:, :, None]
        at_k, row, column = np.nonzero(wide)
        poses = len(self.y) * nv
        shared = column - _WIDTH * nv
        at = np.where(shared < 0, at_k * nv + column, poses + at_k * rows + shared)
        shape = (nt * per, poses + nt * rows)
        G = coo_matrix((wide[at_k, row, column], (at_k * per + row, at)), shape=shape)
        return G.tocsc(), scale.ravel()


def _weights(instant: Instant) -> tuple[Array, Array]:
    """Weights of a deviation at a free node and at one held at rest, each (nv, nv), of order 1."""
    K = instant.dynamics.structural_stiffness(instant.target.path.straight(instant.system.n_eta)[0])
    sizes = np.diag(K)
    least = float(np.min(sizes[sizes > 0.0], initial=1.0))
    free = K + np.diag(np.where(sizes > 0.0, 0.0, _SMALL * least))
    free /= float(np.max(np.diag(free)))
    return free, free + _HELD * np.eye(len(free))


def _of_difference(instant: Instant, pose: Array, other: Array) -> tuple[Array, Array]:
    """Derivatives of the move from `pose` to `other` by either, each (nv, nv)."""
    d, nv = instant.dynamics, instant.system.nv
    own, neighbour = -np.eye(nv), np.eye(nv)
    if not d.vector_space:
        n, m = d.nq_rigid, d.n_rigid
        q0, q1, model = pose[:n], other[:n], instant.system.rigid
        own[:m, :m] = pin.dDifference(model, q0, q1, pin.ARG0)
        neighbour[:m, :m] = pin.dDifference(model, q0, q1, pin.ARG1)
    return own, neighbour
