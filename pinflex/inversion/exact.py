"""The exact command: stable inversion of the whole motion at once.

Unknown are the poses at the nodes of a uniform grid, two more at either end, and the multipliers at
every node; v and a are central differences of fourth order. The rows of every instant are
constraints, and of all that satisfy them the motion with the least elastic energy of
y - y_quasistatic is taken. That picks the bounded solution whether the internal dynamics is minimum
phase, rings or is not minimum phase (then motors move before the platform does). Rest is imposed at
the start, by a large weight; the end stays free.

The matrix leaves out how constraints curve. Where the links swing far beside the path (fewer
coordinates than motors) that can turn a correction into -1.1 of itself, without end; as soon as
two of them are opposite, the share is taken at which the next one vanishes (Irons, Tuck 1969).

Source: Devasia, Chen, Paden (1996), stable inversion; Bastos, Seifried, Bruels (2013), inverse
dynamics as an optimal control problem with the elastic energy as its cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.sparse import block_diag, csr_array, eye_array, hstack, vstack
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
_OPPOSITE = -0.5  # of the last correction: beyond it corrections overshoot
_SLOW = 0.3  # contraction above which a new matrix pays: it costs as much as ten corrections
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

    Raises:
        ConvergenceError: The iterations do not settle: the motion is too fast for the grid or
            for the mechanism.
    """
    inversion, new = _Inversion(instant, start), True
    before = size = np.inf
    for iteration in range(1, _MOST + 1):
        size = inversion.correct(new)
        if size < _DONE or (size < _STALLED and size > 0.5 * before):
            fourth = inversion.motors()
            inversion.refine()
            return Inverted(inversion.balanced(), inversion.motors() - fourth, iteration + 1)
        if not size < _ASTRAY:
            break
        new, before = size > _SLOW * before, size
    h, held = instant.target.t[1] - instant.target.t[0], instant.target.names
    nm = len(instant.axes.v_at)
    why = "Ask for more nodes, or slow the motion down."
    if len(held) < nm:
        why = (
            f"{len(held)} coordinate ({', '.join(held)}) for {nm} motors: in what is not named the "
            "links swing freely about the rigid motion, here too far. Name as many "
            "coordinates as there are motors, or slow the motion down."
        )
    raise ConvergenceError(
        f"command: the inversion over {len(start.y)} instants of {h:.3g} s does not settle (last "
        f"change {size:.2g}). {why}"
    )


class _Inversion:
    """Poses (padded) and multipliers of one inversion, and the last factorised saddle matrix.

        [ H  G' ] [  dx ]     [ W (y - y_quasistatic) + G' mu ]
        [ G  0  ] [ dmu ] = - [              e                ]

    On the left stands the matrix that was factorised, with the rows e and their G as they are now
    on the right: what an old matrix misses, also of the least energy, the next correction has.
    """

    def __init__(self, instant: Instant, start: Balanced) -> None:
        self.instant = instant
        self.h = float(instant.target.t[1] - instant.target.t[0])
        self.reference = padded(start.y, _PAD)
        self.y, self.lam = self.reference.copy(), start.lam.copy()
        free, held = _weights(instant)
        self.weights = [held if k <= _PAD else free for k in range(len(self.y))]
        self._solve: Callable[[Array], Array] = np.asarray
        nv, nt, per = instant.system.nv, len(self.lam), instant.system.nv + instant.rows
        self._wide = np.zeros((nt, per, _WIDTH * nv + instant.rows))  # G, instant by instant
        self._scale, self._mu = np.ones((nt, per)), np.zeros((nt, per))
        self._last, self._share = np.zeros(self.y.shape[0] * nv), 1.0

    def correct(self, new: bool) -> float:
        """One linear system for all instants; returns the largest correction of a pose."""
        v, a = rates(self.instant.dynamics, self.y, self.h, FOURTH)
        e = self._rows(v, a)
        self._differentiate(v, a)
        if new:
            last, self._scale = self._scale, 1.0 / np.maximum(np.abs(self._wide).max(2), 1e-300)
            self._mu *= last / self._scale
        self._wide *= self._scale[:, :, None]
        if new:
            self._solve = splu(self._saddle()).solve
        return self._move(e)

    def refine(self) -> None:
        """Differences of order 8 in the rows, of order 4 in their tangent: deferred correction."""
        self._last[:] = 0.0
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
        pull = np.array([W @ x for W, x in zip(self.weights, away, strict=True)])
        pushed, (nt, nv) = (self._mu[:, None] @ self._wide)[:, 0], (len(e), away.shape[1])
        for j in range(_WIDTH):
            pull[j : j + nt] += pushed[:, j * nv : (j + 1) * nv]
        shared = pushed[:, _WIDTH * nv :]
        left = np.concatenate([x.ravel() for x in (pull, shared, e * self._scale)])
        step = self._solve(-left)
        step = self._shared(step, away.size)
        moves, more, mu = np.split(step, [away.size, away.size + self.lam.size])
        moves = moves.reshape(away.shape)
        self.y = np.array([d.integrate(*pair) for pair in zip(self.y, moves, strict=True)])
        self.lam = self.lam + more.reshape(self.lam.shape)
        self._mu += mu.reshape(self._mu.shape)
        return float(np.max(np.abs(moves)))

    def _shared(self, step: Array, poses: int) -> Array:
        """The share of a correction at which, where it turns back the last one, none is left."""
        moves, last = step[:poses], self._last
        along = float(moves @ last) / max(float(last @ last), 1e-300)
        self._share = self._share / (1.0 - along) if along < _OPPOSITE else 1.0
        self._last = moves.copy()
        return self._share * step

    def _differentiate(self, v: Array, a: Array) -> None:
        """Jacobian of the rows of each instant by the poses about it and its multipliers."""
        instant, nv, wide = self.instant, self.instant.system.nv, self._wide
        free, poses = len(instant.free), self.y[_PAD:-_PAD]
        every = instant.every_tangent(range(len(wide)), poses, v, a, self.lam)
        for k, found in enumerate(every):
            pose = poses[k]
            here = found.K.copy()
            for j in (j for j in range(_WIDTH) if j != _PAD):
                block = FOURTH.first[j] / self.h * found.C + FOURTH.second[j] / self.h**2 * found.M
                own, other = self._of_difference(pose, self.y[k + j])
                m = len(own)
                wide[k, :free, j * nv : (j + 1) * nv] = block
                wide[k, :free, j * nv : j * nv + m] = block[:, :m] @ other
                here[:, :m] += block[:, :m] @ own
                here[:, m:] -= block[:, m:]
            wide[k, :free, _PAD * nv : (_PAD + 1) * nv] = here
            wide[k, :free, _WIDTH * nv :] = found.lam
            wide[k, free:, _PAD * nv : (_PAD + 1) * nv] = found.J
            wide[k, free:, : _PAD * nv] = wide[k, free:, (_PAD + 1) * nv :] = 0.0

    def _of_difference(self, pose: Array, other: Array) -> tuple[Array, Array]:
        """Derivatives of the move from `pose` to `other` by either, of the rows that do not add."""
        d = self.instant.dynamics
        if d.vector_space:
            return np.zeros((0, 0)), np.zeros((0, 0))
        q0, q1, model = pose[: d.nq_rigid], other[: d.nq_rigid], self.instant.system.rigid
        by = (pin.ARG0, pin.ARG1)
        own, neighbour = (pin.dDifference(model, q0, q1, argument) for argument in by)
        return own, neighbour

    def _saddle(self) -> Any:
        """[H G'; G 0] by poses, multipliers and rows; G from the rows of each instant."""
        nv, (nt, per, _), rows = self.instant.system.nv, self._wide.shape, self.instant.rows
        poses, unknown = len(self.y) * nv, len(self.y) * nv + nt * rows
        at_k, row, column = np.nonzero(self._wide)  # row by row, as csr wants them
        shared, at = column - _WIDTH * nv, at_k * nv + column
        at = np.where(shared < 0, at, poses + at_k * rows + shared)
        count = np.bincount(at_k * per + row, minlength=nt * per)
        entries = self._wide[at_k, row, column], at, np.append(0, np.cumsum(count))
        G = csr_array(entries, shape=(nt * per, unknown))
        H = block_diag([*self.weights, csr_array((nt * rows, nt * rows))], format="csr")
        above = hstack([H, G.T.tocsr()], format="csr")
        below = hstack([G, -_REGULAR * eye_array(nt * per, format="csr")], format="csr")
        return vstack([above, below], format="csr").T  # symmetric, and csc for splu


def _weights(instant: Instant) -> tuple[Array, Array]:
    """Weights of a deviation at a free node and at one held at rest, each (nv, nv), of order 1."""
    K = instant.dynamics.structural_stiffness(instant.target.path.straight(instant.system.n_eta)[0])
    sizes = np.diag(K)
    least = float(np.min(sizes[sizes > 0.0], initial=1.0))
    free = K + np.diag(np.where(sizes > 0.0, 0.0, _SMALL * least))
    free /= float(np.max(np.diag(free)))
    return free, free + _HELD * np.eye(len(free))
