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

import numpy as np
import pinocchio as pin
from numpy.polynomial import chebyshev

from pinflex.actuation.drive import breaks, nominal
from pinflex.actuation.path import MotorAxes, motor_axes
from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.description.trajectories.profiles import hermite
from pinflex.errors import ConvergenceError
from pinflex.integrators.chebyshev import PiecewiseChebyshev
from pinflex.inversion.saddle import Saddle
from pinflex.inversion.target import Balanced, Instant, Target, delayed
from pinflex.levels.rigid import solve_rigid
from pinflex.linalg import lapack
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.text import plural

# Rates of poses on a uniform grid by central differences on the configuration manifold.
#
# With d_j the move from pose k to pose k + j, in exponential coordinates at pose k, the first
# derivative of those coordinates is v and the second is the rate of v, exactly: their bracket
# vanishes at the origin. The differences of order 4 and 8 are the usual ones.


@dataclass(frozen=True)
class Stencil:
    """Weights of the poses at -n ... n: `first` / h gives v, `second` / h^2 gives a."""

    first: Array
    second: Array

    @property
    def reach(self) -> int:
        """Number of poses on either side."""
        return len(self.first) // 2


FOURTH = Stencil(
    np.array([1, -8, 0, 8, -1]) / 12.0,
    np.array([-1, 16, -30, 16, -1]) / 12.0,
)
EIGHTH = Stencil(
    np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]),
    np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]),
)


def rates(dynamics: Equations, y: Array, h: float, stencil: Stencil) -> tuple[Array, Array]:
    """v and a, each (nt, nv), of poses y (nt + 2 reach, nq), a time h (s) apart."""
    n = stencil.reach
    manifold, middle = Manifold(dynamics), y[n : len(y) - n]
    v, a = (np.zeros((len(middle), dynamics.system.nv)) for _ in range(2))
    for j in range(-n, n + 1):
        if j:
            move = manifold.log(middle, y[n + j : len(y) - n + j])
            v += stencil.first[j + n] / h * move
            a += stencil.second[j + n] / h**2 * move
    return v, a


def padded(y: Array, n: int) -> Array:
    """Poses with n equal ones before the first and after the last: rest."""
    return np.concatenate([np.repeat(y[:1], n, 0), y, np.repeat(y[-1:], n, 0)])


def spline(t: Array, position: Array) -> Callable[..., Array]:
    """Quintic spline through positions (nt, n) at even times, from rest; it ends as the data do.

    A function of times and of an order of derivative. Unknown are velocities and accelerations at
    the nodes, by h and h^2: third and fourth derivatives go on from piece to piece, and vanish at
    the end. By numpy: scipy's splines take longer to import than a small run.

    Source: de Boor (2001), A Practical Guide to Splines, ch. 4 (piecewise Hermite interpolation).
    """
    h, n = float(t[-1] - t[0]) / (len(t) - 1), len(t)
    # by x, v, a at either end of a piece: its third and fourth derivative where it begins, and ends
    begins = np.array([[-60, -36, -9, 60, -24, 3], [360, 192, 36, -360, 168, -24]], float)
    ends = np.array([[-60, -24, -3, 60, -36, 9], [-360, -168, -24, 360, -192, 36]], float)
    rows, right = np.zeros((2 * n, 7)), np.zeros((2 * n, position.shape[1]))
    rows[:2, 3] = 1.0  # at rest; below: unknowns of the node before, its own, and of the next
    inner = rows[2:-2].reshape(n - 2, 2, 7)
    for k in range(2):  # row k of a node begins k unknowns further on in its band
        inner[:, k, 1 - k : 3 - k] = ends[k, 1:3]
        inner[:, k, 3 - k : 5 - k] = ends[k, 4:] - begins[k, 1:3]
        inner[:, k, 5 - k : 7 - k] = -begins[k, 4:]
        rows[2 * n - 2 + k, 1 - k : 3 - k], rows[2 * n - 2 + k, 3 - k : 5 - k] = (
            ends[k, 1:3], ends[k, 4:],
        )  # fmt: skip
    rise = np.diff(position, axis=0)
    for k in range(2):
        right[2 + k : -2 : 2] = begins[k, 3] * rise[1:] - ends[k, 3] * rise[:-1]
        right[2 * n - 2 + k] = -ends[k, 3] * rise[-1]
    # LAPACK's band: entry (i, j) at (6 + i - j, j), with three rows of room above
    band = np.zeros((10, 2 * n), order="F")
    for k in range(7):
        column = np.arange(2 * n) + k - 3
        inside = (column >= 0) & (column < 2 * n)
        band[9 - k, column[inside]] = rows[inside, k]
    _, _, found, info = lapack().dgbsv(3, 3, band, right, overwrite_ab=1, overwrite_b=1)
    if info:
        raise np.linalg.LinAlgError(f"dgbsv: info {info}")
    powers = hermite(t, position, found[0::2] / h, found[1::2] / h**2)

    def at(times: Array, order: int = 0) -> Array:
        left = np.clip(((times - t[0]) / h).astype(np.intp), 0, n - 2)
        since, value = (times - t[left])[:, None], np.zeros((len(times), position.shape[1]))
        for c in range(5, order - 1, -1):
            value = value * since + np.prod(np.arange(c, c - order, -1.0)) * powers[left, c]
        return value

    return at


_HELD = 1e8  # weight of rest at the start over that of a deviation elsewhere
_SMALL = 1.0  # weight of rigid coordinates, free beyond the end alone, over the least stiffness
_DONE = 1e-10  # m or rad: the correction that would be next is round-off
_STALLED = 1e-7  # m or rad: corrections that no longer shrink from here on are round-off
_ASTRAY = 100.0  # m or rad: a first correction of 10 may still settle
_DEFERRED = 2  # corrections by differences of order 8: the first gains two orders, so the second
_MOST = 20
_BENT = 1e-4  # m or rad: the last correction, below which rows turn too little to matter
_OPPOSITE = -0.5  # of the last correction: beyond it corrections overshoot
_SLOW = 0.3  # contraction above which a new matrix pays: it costs as much as ten corrections
_PAD = FOURTH.reach
_WIDTH = 2 * _PAD + 1
_BESIDE = tuple(j for j in range(_WIDTH) if j != _PAD)


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


def invert(instant: Instant, reference: Balanced, start: Balanced | None = None) -> Inverted:
    """Solve for all instants at once.

    `reference`: the quasistatic motion. `start`: what to begin from; default: that.

    Raises:
        ConvergenceError: The iterations do not settle: the motion is too fast for the grid or
            for the mechanism.
    """
    inversion, new = _Inversion(instant, reference, start or reference), True
    before = size = np.inf
    for iteration in range(1, _MOST + 1):
        size = inversion.correct(new, before)
        if _settled(size, before):
            fourth = inversion.motors()
            inversion.refine()
            return Inverted(inversion.balanced(), inversion.motors() - fourth, iteration + 1)
        if not size < _ASTRAY:
            break
        new, before = size > _SLOW * before, size
    h, held = instant.target.t[1] - instant.target.t[0], instant.target.names
    nm = len(instant.axes.v_at)
    why = (
        "Slow the motion down, or take level quasistatic, which tells what it misses; more "
        "`instants` help where the motion is fast for them."
    )
    if len(held) < nm:
        why = (
            f"{plural(len(held), 'coordinate')} ({', '.join(held)}) for {nm} motors: in what is "
            "not named the links swing freely about the rigid motion, here too far. Name as many "
            "coordinates as there are motors, or slow the motion down."
        )
    raise ConvergenceError(
        f"command: the inversion over {len(reference.y)} instants of {h:.3g} s does not settle "
        f"(last change {size:.2g}). {why}"
    )


def _settled(size: float, before: float) -> bool:
    """Whether the next correction is round-off, by the last two."""
    rate = size / before
    following = size * rate if 0.0 < rate < _SLOW else size
    return following < _DONE or (size < _STALLED and rate > 0.5)


class _Inversion:
    """Poses (padded) and multipliers of one inversion, and the last factorised saddle matrix.

        [ H  G' ] [  dx ]     [ W (y - y_quasistatic) + G' mu ]
        [ G  0  ] [ dmu ] = - [              e                ]

    On the left stands the matrix that was factorised, with the rows e and their G as they are now
    on the right: what an old matrix misses, also of the least energy, the next correction has.
    """

    def __init__(self, instant: Instant, reference: Balanced, start: Balanced) -> None:
        self.instant, self._manifold = instant, Manifold(instant.dynamics)
        self.h = float(instant.target.t[1] - instant.target.t[0])
        self.reference = padded(reference.y, _PAD)
        self.y, self.lam = padded(start.y, _PAD), start.lam.copy()
        free, held = _weights(instant)
        self.weights = np.stack([held if k <= _PAD else free for k in range(len(self.y))])
        nv, nt, per = instant.system.nv, len(self.lam), instant.system.nv + instant.rows
        self._wide = np.zeros((nt, per, _WIDTH * nv + instant.rows))  # G, instant by instant
        self._scale, self._mu = np.ones((nt, per)), np.zeros((nt, per))
        self._last, self._share = np.zeros((len(self.y), nv)), 1.0
        self._saddle: Saddle | None = None

    def correct(self, new: bool, last: float) -> float:
        """One linear system for all instants; returns the largest correction of a pose on the grid.

        Those beyond the end, which are free, move a thousand times as far and matter to nothing.
        `new`: with a matrix of its own. `last`: the correction before.
        """
        v, a = rates(self.instant.dynamics, self.y, self.h, FOURTH)
        e = self._rows(v, a)
        if new or last > _BENT:
            if not new:
                self._wide = self._wide.copy()  # the saddle has the other
            self._differentiate(v, a, new)
        if new:
            self._saddle = None  # its memory first
            self._saddle = Saddle(self.weights, self._wide, len(self.instant.free))
        return self._move(e)

    def refine(self) -> None:
        """Differences of order 8 in the rows, of order 4 in their tangent: deferred correction.

        As long as corrections shrink: where they grow they are round-off, which a fine grid raises.
        """
        self._last[:], size = 0.0, np.inf
        for _ in range(_DEFERRED):
            y, lam, mu, before = self.y, self.lam, self._mu.copy(), size
            v, a = rates(self.instant.dynamics, self.y, self.h, FOURTH)
            wider = padded(self.y, EIGHTH.reach - _PAD)
            v8, a8 = rates(self.instant.dynamics, wider, self.h, EIGHTH)
            v[:-_PAD], a[:-_PAD] = v8[:-_PAD], a8[:-_PAD]  # beyond the end nothing is known
            size = self._move(self._rows(v, a))
            if size > before:
                self.y, self.lam, self._mu = y, lam, mu
                break

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
        assert self._saddle is not None
        poses = self._wide.shape[2] - self.instant.rows
        away = self._manifold.log(self.reference, self.y)
        pushed = (self._mu[:, None] @ self._wide)[:, 0]
        pull = (self.weights @ away[:, :, None])[:, :, 0] + self._saddle.spread(pushed[:, :poses])
        found = self._saddle.solve(-pull, -pushed[:, poses:], -e * self._scale)
        moves, more, mu = (self._shared(found[0]) * x for x in found)
        self.y = self._manifold.retract(self.y, moves)
        self.lam = self.lam + more
        self._mu += mu
        return float(np.max(np.abs(moves[_PAD:-_PAD])))

    def _shared(self, moves: Array) -> float:
        """The share of a correction at which, where it turns back the last one, none is left."""
        last = self._last
        along = float(np.vdot(moves, last)) / max(float(np.vdot(last, last)), 1e-300)
        self._share = self._share / (1.0 - along) if along < _OPPOSITE else 1.0
        self._last = moves
        return self._share

    def _differentiate(self, v: Array, a: Array, new: bool) -> None:
        """Jacobian of the rows of each instant by the poses about it and its multipliers.

        `new`: rows get a scale that makes their largest entry one.
        """
        instant, nv, wide = self.instant, self.instant.system.nv, self._wide
        free, poses = len(instant.free), self.y[_PAD:-_PAD]
        first, second = FOURTH.first[:, None] / self.h, FOURTH.second[:, None] / self.h**2
        every = instant.every_tangent(range(len(wide)), poses, v, a, self.lam)
        for k, found in enumerate(every):
            rows = wide[k]
            blocks = rows[:free, : _WIDTH * nv].reshape(free, _WIDTH, nv)
            blocks[...] = first * found.C[:, None] + second * found.M[:, None]
            blocks[:, _PAD] += found.K
            if not instant.dynamics.vector_space:
                self._turned(blocks, found.K, k)
            rows[:free, _WIDTH * nv :] = found.lam
            rows[free:, _PAD * nv : (_PAD + 1) * nv] = found.J
            if new:
                old, scale = self._scale[k], 1.0 / np.maximum(np.abs(rows).max(axis=1), 1e-300)
                self._mu[k] *= old / scale
                self._scale[k] = scale
            rows *= self._scale[k][:, None]

    def _turned(self, blocks: Array, K: Array, k: int) -> None:
        """Blocks (free, poses, nv) of instant k, where moves of rigid coordinates do not add."""
        model, n = self.instant.system.rigid, self.instant.dynamics.nq_rigid
        m, (pose, *others) = model.nv, (self.y[k + j, :n] for j in (_PAD, *_BESIDE))
        blocks[:, _PAD, :m] = K[:, :m]
        for j, other in zip(_BESIDE, others, strict=True):
            block = blocks[:, j, :m].copy()
            blocks[:, _PAD, :m] += block @ pin.dDifference(model, pose, other, pin.ARG0)
            blocks[:, j, :m] = block @ pin.dDifference(model, pose, other, pin.ARG1)


def _weights(instant: Instant) -> tuple[Array, Array]:
    """Weights of a deviation at a free node and at one held at rest, each (nv, nv), of order 1."""
    K = instant.dynamics.structural_stiffness(instant.target.path.straight(instant.system.n_eta)[0])
    sizes = np.diag(K)
    least = float(np.min(sizes[sizes > 0.0], initial=1.0))
    free = K + np.diag(np.where(sizes > 0.0, 0.0, _SMALL * least))
    free /= float(np.max(np.diag(free)))
    return free, free + _HELD * np.eye(len(free))


# The exact command where elastic drives are all that gives way: no grid, no iteration.
#
# With undamped gears the robot is flat: the path gives the motion of the links, the rigid inverse
# dynamics the torque T on each gear, its stiffness the motor's angle, and that the motor's torque:
#
#     q_m = q + T(q, q', q'') / K,     tau = T + I q_m'' + F(q_m')
#
# T is smooth between the corners of a motion; its rates are those of its Chebyshev polynomial.
# Source: Spong (1987), J. Dyn. Syst. Meas. Control 109; De Luca & Book, Handbook of Robotics, ch.
# 11.

_FIRST, _HIGHEST = 16, 128  # degree of the polynomials
_SETTLED = 1e-13  # of the largest coefficient, for the last two: round-off
_ENOUGH = 1e-9  # the same where more would not help


@dataclass(frozen=True)
class Flat:
    """Deflections T / K of the motors' gears as polynomials, over the rigid motion.

    Attributes:
        mechanism, motion: The motion delayed. pieces: Of time. axes: Of the motors.
        rows: Velocity rows of the motors. error: Of motor positions [m | rad], shape (nm,).
        coefficients: Chebyshev, shape (pieces, degree + 1, nm).
    """

    mechanism: Mechanism
    motion: Motion
    pieces: PiecewiseChebyshev
    axes: MotorAxes
    rows: IntArray
    coefficients: Array
    error: Array

    def twist(self, t: Array, order: int) -> Array:
        """Rates of T / K at times, of order 0 to 2, shape (nt, nm)."""
        found, of, ends = (
            np.zeros((len(t), len(self.rows))),
            self.pieces.of(t),
            self.pieces.nodes(1),
        )
        for k, (a, b) in enumerate(ends):
            here = of == k
            c = chebyshev.chebder(self.coefficients[k], order) * (2.0 / (b - a)) ** order
            x = np.clip((2.0 * t[here] - a - b) / (b - a), -1.0, 1.0)
            found[here] = chebyshev.chebval(x, c).T.reshape(-1, len(self.rows))
        return found

    def position(self, t: Array, order: int = 0) -> Array:
        """Rates of the motor positions at times, of order 0 to 2, shape (nt, nm)."""
        path = nominal(self.mechanism, self.motion, t)
        rigid = (self.axes.read(path.q), path.v[:, self.rows], path.a[:, self.rows])[order]
        if order == 0 and len(self.axes.paired):
            rigid = np.unwrap(rigid, axis=0)
        return np.asarray(rigid + self.twist(t, order))

    def poses(self, t: Array) -> Array:
        """Poses [q; eta], shape (nt, nq)."""
        system = self.mechanism.flexible
        y = nominal(self.mechanism, self.motion, t).straight(system.n_eta)
        self.axes.write(y, self.position(t))
        twist, names = self.twist(t, 0), self.mechanism.motors
        for gear in system.expansion.drives:
            y[:, int(system.rigid.nq) + gear.eta] = -twist[:, names.index(gear.joint)]
        return y

    def torque(self, t: Array) -> Array:
        """Motor torques in the joints' coordinates [N m | N], shape (nt, nm)."""
        T = _on_gears(self.mechanism, self.motion, t)
        return T + _at_motors(self.mechanism, self.position(t, 1), self.position(t, 2))


def flat(mechanism: Mechanism, motion: Motion, wanted: Target) -> Flat | None:
    """The command, or None where something else gives way, rubs unsmoothly or is damped."""
    if not _is_flat(mechanism, wanted):
        return None
    later, rows = delayed(motion, wanted.before), mechanism.rigid.motors
    none = mechanism.rigid.loads
    corners = [wanted.before, *(wanted.before + t for t in breaks(motion, none))]
    pieces = PiecewiseChebyshev(0.0, float(wanted.t[-1]), corners)
    system, names = mechanism.flexible, mechanism.motors
    compliance = np.zeros(len(rows))
    for gear in system.expansion.drives:
        k = int(system.rigid.nv) + gear.eta
        compliance[names.index(gear.joint)] = 1.0 / system.K[k, k]
    n = _FIRST
    while True:
        nodes, x = pieces.nodes(n), -np.cos(np.pi * np.arange(n + 1) / n)
        T = _on_gears(mechanism, later, nodes.ravel()).reshape(*nodes.shape, -1)
        c = np.linalg.inv(chebyshev.chebvander(x, n)) @ (T * compliance)
        last = np.max(np.abs(c[:, -2:]), axis=(0, 1))
        lost = float(np.max(last / np.maximum(np.max(np.abs(c), axis=(0, 1)), 1e-300)))
        if lost < _SETTLED or 2 * n > _HIGHEST:
            break
        n *= 2
    if lost > _ENOUGH:
        return None
    return Flat(mechanism, later, pieces, motor_axes(mechanism), rows, c, last)


def _is_flat(mechanism: Mechanism, wanted: Target) -> bool:
    """Whether undamped gears are all that gives way, and the path all that moves."""
    system = mechanism.flexible
    gears = [int(system.rigid.nv) + gear.eta for gear in system.expansion.drives]
    only = bool(gears) and not system.expansion.slots and not mechanism.elastic_joints
    motors = len(mechanism.rigid.motors)
    determined = len(wanted.names) == motors == mechanism.report.mobility
    timed = any(force.timed for force, _ in system.loads.forces)
    return only and determined and not timed and not np.any(np.diag(system.D)[gears])


def _on_gears(mechanism: Mechanism, motion: Motion, t: Array) -> Array:
    """Torques that the gears give out when the links follow the rigid motion, (nt, nm)."""
    run, rows = solve_rigid(mechanism, motion, t), mechanism.rigid.motors
    return run.torque - _at_motors(mechanism, run.v[:, rows], run.a[:, rows])


def _at_motors(mechanism: Mechanism, v: Array, a: Array) -> Array:
    """Torques of rotors, dampers and friction at motor speeds and accelerations (nt, nm)."""
    system, rows = mechanism.rigid, mechanism.rigid.motors
    every = np.zeros((len(v), system.nv))
    every[:, rows] = v
    force = every * np.diag(system.D)
    force[:, system.friction.rows] += system.friction.force(every)
    return np.asarray(force[:, rows] + system.rigid.armature[rows] * a)
