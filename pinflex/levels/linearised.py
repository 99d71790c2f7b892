"""The linear system along a nominal motion: at every step, or interpolated where it is smooth.

Evaluating M, C, K and J costs several times a step of the march. Between the corners of a motion
they are smooth functions of time: evaluated at Chebyshev points, doubled until the new ones are met
by interpolation, they serve any number of steps, and any number of marches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from pinflex.actuation.drive import breaks, sample_times
from pinflex.actuation.nominal import Nominal, between, nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.integrators.chebyshev import Interpolation, PiecewiseChebyshev
from pinflex.integrators.linear import Instant
from pinflex.levels.interpolated import InterpolatedPath, LinearStep, pack
from pinflex.levels.varying import STILL, Varying
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.loads import Loads
from pinflex.mechanics.mechanism import Mechanism

_NODES = 8  # intervals between the nodes of a piece to begin with
_FEW = 4  # the same where a piece is one polynomial of the motion
_STEPS = 3  # at least so many for each node, or every step is evaluated
_LARGEST = 2e7  # numbers that the nodes may hold (160 MB)
_KINDS = "MCKrJ"  # of each choice of rows, in the order of `LinearStep.packed`
_ROUND_OFF = 1e-5  # of what is natural for a matrix: smaller ones, round-off alone perhaps, are
# followed to `close` of that, 1e-14 of what is natural


class LinearPath:
    """The system at every instant of a nominal motion.

    Attributes:
        dynamics: Workspace of the flexible mechanism.
        path: The nominal motion.
        structural: Whether what the motion and the loads add to C and K is left out.
        v, a: Its rates and accelerations, elastic ones zero, shape (nt, nv) each.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        path: Nominal,
        structural: bool = False,
        dynamics: Equations | None = None,
    ) -> None:
        """Nothing is evaluated yet.

        Args:
            mechanism: Mechanism.
            path: Its nominal motion.
            structural: Leave out what the motion and the loads add to C and K.
            dynamics: A workspace of the flexible mechanism; None: one of its own.
        """
        self.dynamics, self.path = dynamics or Equations(mechanism.flexible), path
        system, m = mechanism.flexible, int(mechanism.flexible.rigid.nv)
        self.v, self.a = (np.zeros((len(path.t), system.nv)) for _ in range(2))
        self.v[:, :m], self.a[:, :m] = path.v, path.a
        self._passive, self._bases = mechanism.rigid.free, np.zeros((0, 0))
        self._damping, self.structural = mechanism.description.system_damping, structural

    def full(self, k: int) -> LinearStep:
        """The system in all coordinates."""
        dynamics, system = self.dynamics, self.dynamics.system
        y = np.concatenate([self.path.q[k], np.zeros(system.n_eta)])
        v, a, t = self.v[k], self.a[k], float(self.path.t[k])
        base = self._base(k)
        r, _ = dynamics.residual(y, v, a, base, t)
        M, C, K, J = dynamics.tangent(y, v, a, base, t)
        alpha, beta = self._damping
        if self.structural or alpha or beta:
            structure = dynamics.structural_stiffness(y)
            if self.structural:
                C, K = system.D, structure
            C = C + alpha * M + beta * structure
        return LinearStep((Instant(M, C, K, r, J),), base)

    def together(self) -> None:
        """Evaluate what all instants have in common at once: all of them are wanted."""
        self._bases = self._multipliers(slice(None))

    def _base(self, k: int) -> Array:
        found = self._bases if len(self._bases) else self._multipliers(slice(k, k + 1))
        return np.asarray(found[k if len(self._bases) else 0])

    def _multipliers(self, s: slice) -> Array:
        """Closure forces of the rigid motion in the rows of the flexible mechanism, (k, rows).

        They bring the geometric stiffness of the joint forces; any split between them and the
        deviation's own multipliers satisfies the same equations.
        """
        dynamics, rows = self.dynamics, self.dynamics.system.closed.n
        v, t = self.v[s], self.path.t[s]
        if not rows:
            return np.zeros((len(t), 0))
        y = np.hstack([self.path.q[s], np.zeros((len(t), dynamics.system.n_eta))])
        r, _ = dynamics.residual(y, v, self.a[s], np.zeros((len(t), rows)), t)
        J = dynamics.close(y).J[:, :, self._passive]
        back = np.linalg.pinv(J.swapaxes(1, 2), rcond=1e-10)
        return np.asarray((back @ r[:, self._passive, None])[:, :, 0])

    def at(self, k: int) -> LinearStep:
        """The rows that a march needs: `free` and `motors`."""
        step, system = self.full(k), self.dynamics.system
        now, free = step.parts[0], system.free
        parts = []
        for rows in (free, system.motors):
            square = np.ix_(rows, free)
            parts.append(Instant(now.M[square], now.C[square], now.K[square], now.r[rows],
                                 now.J[:, rows]))  # fmt: skip
        return LinearStep(tuple(parts), step.base)


def along(
    mechanism: Mechanism,
    motion: Motion,
    path: Nominal,
    structural: bool,
    close: float,
    dynamics: Equations | None = None,
    steps: Array | None = None,
) -> InterpolatedPath | Kept:
    """The system at every step of a nominal motion: its free coordinates and motors.

    Args:
        mechanism: Mechanism.
        motion: Its motion.
        path: The nominal motion at the steps, or at some of them, the first and the last included.
        structural: Leave out what the motion and the loads add to C and K.
        close: What interpolation may miss, of the largest entry of each matrix.
        dynamics: A workspace of the flexible mechanism; None: one of its own.
        steps: Times of the steps, shape (nt,); None: those of the path.
    """
    every = LinearPath(mechanism, path, structural, dynamics)
    t = path.t if steps is None else steps
    pieces, n = _pieces(motion, mechanism.flexible.loads, t, _STEPS)
    if len(pieces) * (2 * n + 1) * _STEPS < len(t):
        found = _interpolated(every, mechanism, motion, t, LinearPath.at, pieces, n, close, _STEPS)
        if found.missed < close:
            return found
    if len(t) > len(path.t):
        every = LinearPath(mechanism, nominal(mechanism, motion, t), structural, every.dynamics)
    return Kept(every.at, len(t))


def full_path(
    every: LinearPath, mechanism: Mechanism, motion: Motion, close: float
) -> InterpolatedPath:
    """The system in all coordinates, interpolated whether or not that is `close`.

    Args:
        every: The system at the steps.
        mechanism: Mechanism.
        motion: Its motion.
        close: What interpolation may miss, of the largest entry of each matrix. There are hardly
            more nodes than steps, so `missed` may be larger.
    """
    t = every.path.t
    pieces, n = _pieces(motion, mechanism.flexible.loads, t, 1)
    if len(pieces) * (n + 1) > len(t):
        n = _FEW
    if len(pieces) * (n + 1) > len(t):
        pieces, n = PiecewiseChebyshev(float(t[0]), float(t[-1]), []), _NODES
    return _interpolated(every, mechanism, motion, t, LinearPath.full, pieces, n, close, 1)


def _interpolated(
    every: LinearPath,
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    system: Callable[[LinearPath, int], LinearStep],
    pieces: PiecewiseChebyshev,
    n: int,
    close: float,
    steps: int,
) -> InterpolatedPath:
    """Polynomials through twice the nodes until they are `close`, or nodes are one in `steps`."""
    like = system(every, 0)
    matrices = _Matrices([x.size for x in like.packed()])

    def packed(times: Array) -> Iterator[Array]:
        known = every.path
        at = np.searchsorted(known.t, times).clip(max=len(known.t) - 1)
        same = np.array_equal(known.t[at], times)
        path = known.at(at) if same else between(mechanism, motion, known, times)
        line = LinearPath(mechanism, path, every.structural, every.dynamics)
        line.together()
        for k in range(len(times)):
            yield pack(system(line, k))

    for whole in (False, True):
        moving = _Moving(packed, pieces.nodes(n).ravel(), matrices, whole)
        most = _LARGEST * moving.share
        values, missed = pieces.refined(moving, moving.relative, n, close, len(t) / steps, most)
        grid = Interpolation(pieces, values.shape[1] - 1, t)
        corners = moving.of(packed(t[grid.corners]))
        if not moving.late:
            break
    flat = np.concatenate([values.reshape(grid.nodes, -1), corners])
    return InterpolatedPath(grid, moving.parts(flat, [x.shape for x in like.packed()]), missed)


class _Matrices:
    """Where the matrices of a packed system are, and how large each of them naturally is.

    A matrix that cancels (C of a beam that turns in its plane) holds round-off, which no polynomial
    follows: its size is not its largest entry, but what its terms are made of.

    Attributes:
        of: Number of the matrix of each column, shape (width,).
    """

    def __init__(self, widths: Sequence[int]) -> None:
        """`widths`: Numbers in each matrix, those of `LinearStep.packed`."""
        self.of = np.repeat(np.arange(len(widths)), widths)
        self._kinds = [_KINDS[k % len(_KINDS)] for k in range(len(widths) - 1)] + ["r"]

    def largest(self, x: Array) -> Array:
        """Largest entry of each matrix over rows x (k, width), shape (matrices,)."""
        found = np.zeros(len(self._kinds))
        np.maximum.at(found, self.of, _ends(x))
        return found

    def natural(self, sizes: Array) -> Array:
        """The natural size of each, from their largest entries, shape (matrices,).

        It is that of the same matrix in all rows, of C that of critical damping, sqrt(M K); of
        loads and closures their own.
        """
        of = dict.fromkeys("MCK", 0.0)
        for kind, size in zip(self._kinds, sizes.tolist(), strict=True):
            of[kind] = max(of.get(kind, 0.0), size)
        of["C"] = max(of["C"], float(np.sqrt(of["M"] * of["K"])))
        pairs = zip(self._kinds, sizes.tolist(), strict=True)
        return np.array([of[kind] if kind in "MCK" else size for kind, size in pairs])


class _Moving:
    """Packed systems less the entries that stand still: six sevenths of a typical one.

    Attributes:
        share: Of the entries that move.
        late: Whether others did after all, at times that were asked for later.
    """

    def __init__(
        self,
        packed: Callable[[Array], Iterator[Array]],
        first: Array,
        matrices: _Matrices,
        whole: bool,
    ) -> None:
        """Find out what moves.

        Args:
            packed: Systems at times (k,), a row each.
            first: The times that are asked for first: what stands still at all of them does.
            matrices: Those in a row.
            whole: Take every entry for moving.
        """
        self._packed, self._times = packed, first
        rows = np.array(list(packed(first)))
        sizes = matrices.largest(rows)
        self._sizes = np.maximum(sizes, _ROUND_OFF * matrices.natural(sizes))
        self._still, self._small = rows[0].copy(), (STILL * self._sizes)[matrices.of]
        self._moves = (np.ptp(rows, axis=0) > self._small) | whole
        self._moves[:1] |= not np.any(self._moves)  # arrays without columns keep no shape
        self._rests = ~self._moves
        self._rows, self._matrix = rows[:, self._moves], matrices.of[self._moves]
        self.share, self.late = max(float(np.mean(self._moves)), 1e-3), False

    def __call__(self, times: Array) -> Array:
        """The moving entries at times (k,), shape (k, moving)."""
        if np.array_equal(times, self._times):
            return self._rows
        return self.of(self._packed(times))

    def of(self, rows: Iterable[Array]) -> Array:
        """Those of systems, shape (k, moving)."""
        found = []
        for row in rows:
            self.late |= bool(np.any((np.abs(row - self._still) > self._small) & self._rests))
            found.append(row[self._moves])
        return np.array(found).reshape(-1, len(self._matrix))

    def relative(self, missed: Array, values: Array) -> float:
        """Largest miss of each matrix over its largest entry; the worst of all.

        Args:
            missed, values: Of moving entries, shape (..., moving).
        """
        sizes = self._sizes.copy()
        far = np.zeros(len(sizes))
        for x, found in ((missed, far), (values, sizes)):
            np.maximum.at(found, self._matrix, _ends(x.reshape(-1, len(self._matrix))))
        return float(np.max(far / np.maximum(sizes, 1e-300), initial=0.0))

    def parts(self, values: Array, shapes: Sequence[tuple[int, ...]]) -> list[Varying]:
        """The matrices, of shapes, from their moving entries (size, moving)."""
        found, entries = [], np.flatnonzero(self._moves)
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        for shape, end in zip(shapes, ends.tolist(), strict=True):
            start = end - int(np.prod(shape))
            a, b = np.searchsorted(entries, (start, end))
            still = self._still[start:end].reshape(shape)
            found.append(Varying(still, entries[a:b] - start, values[:, a:b]))
        return found


def _pieces(motion: Motion, loads: Loads, t: Array, steps: int) -> tuple[PiecewiseChebyshev, int]:
    """Time between the corners, and intervals between the nodes of a piece to begin with.

    A sampled motion is a polynomial between its samples and not smooth across them: it is cut at
    each, unless that makes more nodes than one in `steps`.
    """
    start, end, corners = float(t[0]), float(t[-1]), breaks(motion, loads)
    if motion.kind == "sampled":
        pieces = PiecewiseChebyshev(start, end, [*corners, *sample_times(motion, end)])
        if len(pieces) * (_FEW + 1) * steps < len(t):
            return pieces, _FEW
    return PiecewiseChebyshev(start, end, corners), _NODES


class Kept:
    """Every step evaluated, and the last few kept: mode superposition looks three steps around.

    Attributes:
        count: Number of steps.
    """

    def __init__(self, evaluate: Callable[[int], LinearStep], count: int) -> None:
        self._evaluate, self._kept, self.count = evaluate, dict[int, LinearStep](), count

    def at(self, k: int) -> LinearStep:
        """The step k."""
        if k not in self._kept:
            while len(self._kept) > 5:
                self._kept.pop(min(self._kept, key=lambda j: -abs(j - k)))
            self._kept[k] = self._evaluate(k)
        return self._kept[k]


def _ends(x: Array) -> Array:
    """Largest entry of each column, shape (width,), of x (k, width)."""
    return np.asarray(np.maximum(np.max(x, axis=0, initial=0.0), -np.min(x, axis=0, initial=0.0)))
