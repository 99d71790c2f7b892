"""The linear system along a nominal motion: at every step, or interpolated where it is smooth.

    M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0

Evaluating M, C, K and J costs several times a step of the march. Between the corners of a motion
they are smooth functions of time: a few Chebyshev points of each piece, as many as its coefficients
ask for, serve any number of steps, and any number of marches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinflex.actuation.drive import Nominal, between, breaks, nominal, sample_times
from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.integrators.chebyshev import (
    NOISE,
    Interpolation,
    PiecewiseChebyshev,
    Varying,
)
from pinflex.integrators.collocation import Instant
from pinflex.kernel.evaluate import entries_of
from pinflex.linalg import saddle
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Loads

_NODES = 8  # intervals between the nodes of a piece to begin with, where nothing moves
_USUAL, _ROUGH, _CLOSE = 24, 16, 1e-5  # where something does: they serve most motions as they are,
# the second where `close` is no less than the last
_FEW = 4  # the same where a piece is one polynomial of the motion
_STEPS = 3  # at least so many for each node, or every step is evaluated
_PERHAPS = 0.25  # of round-off: what changes so much at the first nodes may pass it at others
_DEPENDENT = 1e-10  # of the largest singular value: closures that are no rows of their own
_CHUNK = 32  # steps that are interpolated at a time for a method in Python
_RESTING = 1e-12  # of the largest speed: round-off of a motion that has ended
_NATURAL = 1e-5  # of what is natural for a matrix: smaller ones, round-off alone perhaps, are
# followed to `close` of that


class Matrices(NamedTuple):
    """The linear system at one time, in some rows and columns of the coordinates.

    Attributes:
        M, C, K: Shape (rows, n); the first n rows are those of the columns, motors follow.
        J: Closures, shape (closures, rows).
        r: What the rigid motion leaves unbalanced, shape (rows,).
        base: Multipliers of the rigid motion, shape (closures,).
    """

    M: Array
    C: Array
    K: Array
    J: Array
    r: Array
    base: Array

    @property
    def free(self) -> Instant:
        """The system of the columns alone."""
        n = self.M.shape[1]
        return Instant(self.M[:n], self.C[:n], self.K[:n], self.r[:n], self.J[:, :n])

    def motor_forces(self, d: Array, v: Array, a: Array, lam: Array) -> Array:
        """What the motors give: balance in the rows below the columns."""
        M, C, K, J, r = (x[self.M.shape[1] :] for x in (*self[:3], self.J.T, self.r))
        return np.asarray(M @ a + C @ v + K @ d + r - J @ lam)


class LinearPath:
    """The linear system at every instant of a nominal motion.

    Attributes:
        dynamics: Workspace of the flexible mechanism.
        path: The nominal motion.
        structural: Whether what the motion and the loads add to C and K is left out.
        whole: Whether all coordinates are rows and columns; else the free ones, and motors as rows.
        v, a: Rates and accelerations of the motion, elastic ones zero, shape (nt, nv) each.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        path: Nominal,
        structural: bool = False,
        dynamics: Equations | None = None,
        whole: bool = False,
    ) -> None:
        """Nothing is evaluated yet."""
        self._mechanism, self.path = mechanism, path
        self.dynamics, self.structural = dynamics or Equations(mechanism.flexible), structural
        self.whole, system = whole, mechanism.flexible
        every = np.arange(system.nv)
        self._columns = every if whole else system.free
        self._rows = every if whole else np.concatenate([system.free, system.motors])
        still = np.zeros((len(path.t), system.nv - path.v.shape[1]))
        self.v, self.a = np.hstack([path.v, still]), np.hstack([path.a, still])

    def along(self, path: Nominal) -> LinearPath:
        """The same along other instants of the motion."""
        return LinearPath(self._mechanism, path, self.structural, self.dynamics, self.whole)

    @cached_property
    def _y(self) -> Array:
        return self.path.straight(self.dynamics.system.n_eta)

    @cached_property
    def _base(self) -> Array:
        """Closure forces of the rigid motion in the rows of the flexible mechanism.

        They bring the geometric stiffness of the joint forces; any split between them and the
        deviation's own multipliers balances the same forces. Shape (nt, closures).
        """
        dynamics, t, count = self.dynamics, self.path.t, self.dynamics.system.closed.n
        zero = np.zeros((len(t), count))
        if not count:
            return zero
        passive = self._mechanism.rigid.free
        r, _ = dynamics.residual(self._y, self.v, self.a, zero, t)
        J = dynamics.close(self._y).J
        U, sigma, Vt = np.linalg.svd(J[:, :, passive], full_matrices=False)
        share = np.where(sigma > _DEPENDENT * sigma[:, :1], sigma, np.inf)
        base = U @ ((Vt @ r[:, passive, None]) / share[:, :, None])
        untold = count - int(np.min(np.sum(np.isfinite(share), axis=1)))
        return base[:, :, 0] + (self._borne(base[:, :, 0], J) if untold else 0.0)

    def _borne(self, base: Array, J: Array) -> Array:
        """What links bear of closure forces that no rigid motion tells, shape (nt, closures).

        Where closures hold more than rigid links need (two columns below one table), the links'
        stiffness decides how they share a load, and so how far the load softens each.
        """
        dynamics, free, y = self.dynamics, self.dynamics.system.free, self._y
        r = dynamics.residual(y, self.v, self.a, base, self.path.t).r[:, free]
        K = (dynamics.structural_stiffness(one)[np.ix_(free, free)] for one in y)
        none, rows = np.zeros(J.shape[1]), J[:, :, free]
        each = zip(K, rows, r, strict=True)
        return np.array([saddle(one, j, j, -load, none)[1] for one, j, load in each])

    @cached_property
    def _load(self) -> Array:
        """What the rigid motion leaves unbalanced, shape (nt, nv)."""
        dynamics, t = self.dynamics, self.path.t
        return np.asarray(dynamics.residual(self._y, self.v, self.a, self._base, t).r)

    def at(self, k: int) -> Matrices:
        """The system at an instant."""
        dynamics, y, base = self.dynamics, self._y[k], self._base[k]
        M, C, K, J = dynamics.tangent(y, self.v[k], self.a[k], base, float(self.path.t[k]))
        alpha, beta = self._mechanism.description.system_damping
        if self.structural or alpha or beta:
            structure = dynamics.structural_stiffness(y)
            if self.structural:
                C, K = dynamics.system.D, structure
            C = C + alpha * M + beta * structure
        block, rows = np.ix_(self._rows, self._columns), self._rows
        return Matrices(M[block], C[block], K[block], J[:, rows], self._load[k, rows], base)

    def packed(self) -> Array:
        """The systems at all instants, every number of each in a row."""
        compiled = self.dynamics.compiled
        if compiled is None or self.structural or any(self._mechanism.description.system_damping):
            systems = (self.at(k) for k in range(len(self.path.t)))
            return np.array([np.concatenate([x.ravel() for x in system]) for system in systems])
        rows, size = self._rows, (self.dynamics.system.nv, self._base.shape[1])
        at = entries_of("MCKJ", *size, rows, self._columns)
        result = np.empty((len(self.path.t), len(at) + len(rows) + size[1]))
        states = self._y, self.v, self.a, self._base, self.path.t
        compiled.linear_systems(states, at, result)
        result[:, len(at) :] = np.hstack([self._load[:, rows], self._base])
        return result


class EveryStep:
    """Every step evaluated; the last few are kept: mode superposition looks three steps around.

    Attributes:
        count: Number of steps.
    """

    def __init__(self, line: LinearPath) -> None:
        self._line, self._recent, self.count = line, dict[int, Matrices](), len(line.path.t)

    def at(self, k: int) -> Matrices:
        """The step k."""
        if k not in self._recent:
            while len(self._recent) > 5:
                self._recent.pop(min(self._recent, key=lambda j: -abs(j - k)))
            self._recent[k] = self._line.at(k)
        return self._recent[k]


class InterpolatedPath:
    """The system off polynomials, at any step.

    Attributes:
        grid: Times of the values, and how they serve the steps.
        parts: M, C, K, J, r and base, in the order of `Matrices`.
        missed: Estimate of what interpolation misses, of the largest entry of each matrix.
    """

    def __init__(self, grid: Interpolation, parts: Sequence[Varying], missed: float = 0.0) -> None:
        self.grid, self.parts, self.missed = grid, tuple(parts), missed
        self._chunk: tuple[int, list[Array]] = -1, []

    @property
    def count(self) -> int:
        """Number of steps."""
        return len(self.grid.t)

    def at(self, k: int) -> Matrices:
        """The step k, out of a chunk: methods in Python ask for one after the other."""
        number = k // _CHUNK
        if self._chunk[0] != number:
            steps = slice(number * _CHUNK, (number + 1) * _CHUNK)
            self._chunk = number, [x.along(self.grid, steps) for x in self.parts]
        return Matrices(*(x[k % _CHUNK] for x in self._chunk[1]))


def along(
    mechanism: Mechanism,
    motion: Motion,
    path: Nominal,
    structural: bool,
    close: float,
    dynamics: Equations | None = None,
    steps: Array | None = None,
) -> InterpolatedPath | EveryStep:
    """The system at every step of a nominal motion: its free coordinates and motors."""
    line = LinearPath(mechanism, path, structural, dynamics)
    t = path.t if steps is None else steps
    pieces, n = _pieces(motion, mechanism.flexible.loads, path, t, _STEPS, close)
    if (2 * min(n) + 1) * len(pieces) * _STEPS < len(t):
        result = _interpolated(line, mechanism, motion, t, pieces, n, close, len(t) / _STEPS)
        if result.missed < close:
            return result
    if len(t) > len(path.t):
        line = line.along(nominal(mechanism, motion, t))
    return EveryStep(line)


def full_path(
    line: LinearPath, mechanism: Mechanism, motion: Motion, close: float
) -> InterpolatedPath:
    """The system along a path, interpolated whether or not that is `close`.

    Its r and base are rough: with that base, r is cheap to evaluate at every step.
    """
    t = line.path.t
    pieces, n = _pieces(motion, mechanism.flexible.loads, line.path, t, 1, close)
    if sum(n) + len(n) > len(t):
        n = [_FEW] * len(pieces)
    if sum(n) + len(n) > len(t):
        pieces, n = PiecewiseChebyshev(float(t[0]), float(t[-1]), []), [_NODES]
    return _interpolated(line, mechanism, motion, t, pieces, n, close, len(t), "MCKJ")


def _interpolated(
    line: LinearPath,
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    pieces: PiecewiseChebyshev,
    n: Sequence[int],
    close: float,
    most: float,
    judged: str = "MCKJrb",
) -> InterpolatedPath:
    """Polynomials through n + 1 nodes a piece; through more until `close`, or `most` in all.

    `judged`: matrices that are to be close, by the first letters of their names.
    """
    known = line.path

    def packed(times: Array) -> Array:
        at = np.searchsorted(known.t, times).clip(max=len(known.t) - 1)
        same = np.array_equal(known.t[at], times)
        here = known.at(at) if same else between(mechanism, motion, known, times)
        return line.along(here).packed()

    like, corners = line.along(known.at(slice(0, 1))).at(0), t[pieces.at_corner(t)]
    first, at_corners = np.split(
        packed(np.concatenate([pieces.times(n), corners])), [sum(n) + len(n)]
    )
    resting = set(range(len(pieces))) - _moving(pieces, known)
    also: BoolArray | None = None
    while True:
        entries = VaryingEntries(packed, first, like, also, judged)
        begin = np.split(entries.picked(first), np.cumsum(np.array(n) + 1)[:-1])
        values, missed = pieces.refined(begin, entries.at, entries.relative, close, most, resting)
        values.append(entries.picked(at_corners))
        if not np.any(entries.late):
            break
        also = entries.varies | entries.late
    grid = Interpolation(pieces, [len(x) - 1 for x in values[:-1]], t)
    return InterpolatedPath(grid, entries.parts(np.concatenate(values)), missed)


def _moving(pieces: PiecewiseChebyshev, path: Nominal) -> set[int]:
    """Pieces in which the mechanism moves."""
    fast = np.max(np.abs(path.v), axis=1, initial=0.0)
    return set(pieces.of(path.t[fast > _RESTING * np.max(fast, initial=0.0)]).tolist())


class VaryingEntries:
    """Which entries of packed systems vary, and how large those of each matrix naturally are.

    Some six sevenths are constant. A matrix that cancels (C of a beam that turns in its plane)
    holds round-off, which no polynomial follows: its size is not its largest entry, but what its
    terms are made of.

    Attributes:
        varies: Which do, shape (width,).
        late: Which others varied after all, at times that were asked for later.
    """

    def __init__(
        self,
        packed: Callable[[Array], Array],
        first: Array,
        like: Matrices,
        also: BoolArray | None = None,
        judged: str = "MCKJrb",
    ) -> None:
        """Find out which vary at the first nodes, beside those that are known to."""
        self._packed, self._constant = packed, first[0].copy()
        self._judged = np.repeat([name[0] in judged for name in like._fields], 2)
        self._shapes = [x.shape for x in like]
        self._block, n = _blocks(like), 2 * len(like)
        low, high = _ends(first)
        sizes = _largest(low, high, self._block, n)
        natural = sizes.reshape(-1, 2).max(axis=1)  # of the same matrix in all rows
        M, C, K = natural[:3]
        natural = np.array([M, max(C, float(np.sqrt(M * K))), K, 0.0, 0.0, 0.0])  # others: own
        self._sizes = np.maximum(sizes, _NATURAL * np.repeat(natural, 2))
        self._noise = (NOISE * self._sizes)[self._block]
        self.varies = high - low > _PERHAPS * self._noise
        if also is not None:
            self.varies |= also
        self.varies[:1] |= not np.any(self.varies)  # arrays without columns have no length
        self.late = np.zeros_like(self.varies)
        self._entries = np.flatnonzero(self.varies)

    def at(self, times: Array) -> Array:
        """The varying entries at times, shape (k, varying)."""
        return self.picked(self._packed(times))

    def picked(self, systems: Array) -> Array:
        """The varying entries of packed systems, shape (k, varying)."""
        if len(systems):
            low, high = _ends(systems)
            differs = np.maximum(high - self._constant, self._constant - low) > self._noise
            self.late |= differs & ~self.varies
            now = _largest(low, high, self._block, len(self._sizes))
            self._sizes = np.maximum(self._sizes, now)
        return systems.take(self._entries, axis=1)

    def relative(self, missed: Array) -> float:
        """Largest miss of each matrix that is judged over its size; the worst of all."""
        far = _largest(*_ends(missed), self._block[self._entries], len(self._sizes))
        return float(np.max((far / np.maximum(self._sizes, 1e-300))[self._judged], initial=0.0))

    def parts(self, values: Array) -> list[Varying]:
        """Each matrix from the varying entries at all times, shape (size, varying)."""
        parts, start, entries = [], 0, self._entries
        for shape in self._shapes:
            end = start + int(np.prod(shape))
            a, b = np.searchsorted(entries, (start, end))
            constant = self._constant[start:end].reshape(shape)
            parts.append(Varying(constant, entries[a:b] - start, values[:, a:b]))
            start = end
        return parts


def _blocks(like: Matrices) -> IntArray:
    """Number of the block of each entry of a packed system: two a matrix, the second of motors."""
    rows, n = like.M.shape
    motor = np.arange(rows) >= n
    square, closures = np.repeat(motor, n), np.tile(motor, len(like.J))
    of = square, square, square, closures, motor, np.zeros(len(like.base), bool)
    return np.concatenate([2 * kind + x for kind, x in enumerate(of)])


def _ends(x: Array) -> tuple[Array, Array]:
    """Least and largest of each column of rows x (k, width), shape (width,) each."""
    return np.asarray(x.min(axis=0)), np.asarray(x.max(axis=0))


def _largest(low: Array, high: Array, block: IntArray, count: int) -> Array:
    """Largest size in each block of columns between `low` and `high`, shape (count,)."""
    largest = np.zeros(count)
    np.maximum.at(largest, block, np.maximum(high, -low))
    return largest


def _pieces(
    motion: Motion, loads: Loads, path: Nominal, t: Array, steps: int, close: float
) -> tuple[PiecewiseChebyshev, list[int]]:
    """Time between the corners, and intervals between the nodes of each piece to begin with.

    A sampled motion is a polynomial between its samples and not smooth across them: it is cut at
    each, unless that makes more nodes than one in `steps`.
    """
    start, end, corners = float(t[0]), float(t[-1]), breaks(motion, loads)
    if motion.kind == "sampled":
        pieces = PiecewiseChebyshev(start, end, [*corners, *sample_times(motion, end)])
        if len(pieces) * (_FEW + 1) * steps < len(t):
            return pieces, [_FEW] * len(pieces)
    pieces = PiecewiseChebyshev(start, end, corners)
    enough = _USUAL if close < _CLOSE else _ROUGH
    n = [enough if k in _moving(pieces, path) else _NODES for k in range(len(pieces))]
    few = (sum(n) + len(n)) * steps > len(t)
    return pieces, [_NODES] * len(pieces) if few else n
