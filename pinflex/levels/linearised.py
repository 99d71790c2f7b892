"""The linear system along a nominal motion, at every step, or interpolated where it is smooth.

Evaluating M, C, K and J costs several times a step of the march. Between the corners of a motion
they are smooth functions of time: evaluated at Chebyshev points, doubled until the new ones are met
by interpolation, they serve any number of steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.actuation.drive import breaks, sample_times
from pinflex.actuation.nominal import Nominal, between
from pinflex.arrays import Array, IntArray
from pinflex.description.motion import Motion
from pinflex.integrators.chebyshev import Pieces
from pinflex.integrators.linear import Instant
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.loads import Loads
from pinflex.mechanics.mechanism import Mechanism

_NODES = 8  # intervals between the nodes of a piece to begin with
_FEW = 4  # the same where a piece is one polynomial of the motion
_STEPS = 3  # at least so many for each node, or every step is evaluated
_TOGETHER = 32  # steps that are interpolated at a time
_LARGEST = 2e7  # numbers that the nodes may hold (160 MB)
_STILL = 1e-12  # of the largest entry of a matrix: round-off of what does not change


@dataclass(frozen=True)
class Here:
    """All rows of the system at one time, and the multipliers of the rigid motion."""

    instant: Instant
    base: Array


@dataclass(frozen=True)
class Linear:
    """One step: rows of the free coordinates and of the motors, by the free coordinates.

    Attributes:
        free, motors: Their parts of M, C, K, r and J (rows of a motor have J' as the others).
        base: Multipliers of the rigid motion, shape (rows,).
    """

    free: Instant
    motors: Instant
    base: Array


class Line:
    """The system at the instants of a nominal motion; v and a (nt, nv) are those of it."""

    def __init__(
        self,
        mechanism: Mechanism,
        path: Nominal,
        structural: bool = False,
        dynamics: Equations | None = None,
    ) -> None:
        """`dynamics`: a workspace of the flexible mechanism to work on; None: one of its own."""
        self.dynamics, self.path = dynamics or Equations(mechanism.flexible), path
        system, m = mechanism.flexible, int(mechanism.flexible.rigid.nv)
        self.v, self.a = (np.zeros((len(path.t), system.nv)) for _ in range(2))
        self.v[:, :m], self.a[:, :m] = path.v, path.a
        self._stiff = mechanism.rigid.free
        self._damping, self._structural = mechanism.description.system_damping, structural

    def flat(self, k: int) -> Array:
        """The undeformed pose of an instant."""
        return np.concatenate([self.path.q[k], np.zeros(self.dynamics.system.n_eta)])

    def full(self, k: int) -> Here:
        """The system in all coordinates."""
        dynamics, system = self.dynamics, self.dynamics.system
        y, v, a = self.flat(k), self.v[k], self.a[k]
        t = float(self.path.t[k])
        base = _rigid_multipliers(dynamics, self._stiff, y, v, a, t)
        r, _ = dynamics.residual(y, v, a, base, t)
        M, C, K, J = dynamics.tangent(y, v, a, base, t)
        alpha, beta = self._damping
        if self._structural or alpha or beta:
            structure = dynamics.structural_stiffness(y)
            if self._structural:
                C, K = system.D, structure
            C = C + alpha * M + beta * structure
        return Here(Instant(M, C, K, r, J), base)

    def at(self, k: int) -> Linear:
        """The rows that a march needs."""
        here, system = self.full(k), self.dynamics.system
        now, free = here.instant, system.free
        parts = []
        for rows in (free, system.motors):
            square = np.ix_(rows, free)
            parts.append(Instant(now.M[square], now.C[square], now.K[square], now.r[rows],
                                 now.J[:, rows]))  # fmt: skip
        return Linear(parts[0], parts[1], here.base)


def along(
    mechanism: Mechanism,
    motion: Motion,
    path: Nominal,
    structural: bool,
    close: float,
    dynamics: Equations | None = None,
) -> Callable[[int], Linear]:
    """The system at every step of a nominal motion.

    Args:
        mechanism: Mechanism. motion: Its motion. path: The nominal motion at the steps.
        structural: Leave out what the motion and the loads add to C and K.
        close: What interpolation may miss, of the largest entry of each matrix.
        dynamics: A workspace of the flexible mechanism; None: one of its own.
    """
    every, t = Line(mechanism, path, structural, dynamics), path.t
    pieces, n = _pieces(motion, mechanism.flexible.loads, t)
    values = np.empty((len(pieces), 0, 0))
    while len(pieces) * (n + 1) * _STEPS < len(t):
        new = slice(1, None, 2) if values.size else slice(None)
        times = pieces.nodes(n)[:, new].ravel()
        nodes = Line(mechanism, between(mechanism, motion, path, times), structural, every.dynamics)
        steps = [nodes.at(k) for k in range(len(times))]
        packed = np.array([_pack(step) for step in steps]).reshape(len(pieces), -1, _size(steps[0]))
        if not values.size:
            values = packed
        else:
            missed = pieces.between(values, times) - packed.reshape(len(times), -1)
            known, values = values, np.empty((len(pieces), n + 1, packed.shape[2]))
            values[:, ::2], values[:, 1::2] = known, packed
            if _settled(missed, values, pieces, steps[0], close):
                return _Between(every, pieces, values, steps[0]).at
        if 2 * values.size > _LARGEST:
            break
        n *= 2
    return _Kept(every.at).at


def _pieces(motion: Motion, loads: Loads, t: Array) -> tuple[Pieces, int]:
    """Time between the corners, and intervals between the nodes of a piece to begin with.

    A sampled motion is a polynomial between its samples and not smooth across them: it is cut at
    each, unless that makes too many pieces.
    """
    start, end, corners = float(t[0]), float(t[-1]), breaks(motion, loads)
    if motion.kind == "sampled":
        pieces = Pieces(start, end, [*corners, *sample_times(motion, end)])
        if len(pieces) * (_FEW + 1) * _STEPS < len(t):
            return pieces, _FEW
    return Pieces(start, end, corners), _NODES


def _settled(missed: Array, values: Array, pieces: Pieces, like: Linear, close: float) -> bool:
    """Whether the nodes are enough: half as many would be, or these lose little by their decay.

    Between corners the error falls like r^n: what half of the nodes miss is about the square root
    of what all miss. That alone is an estimate, so the last two polynomials have to be small too:
    what they hold is ten to a hundred times what is missed (measured).
    """
    half = _relative(missed, values, like)
    if half < close:
        return True
    if half > 0.1 * close**0.5:
        return False
    lost = values - pieces.coarser(values)
    return _relative(lost.reshape(-1, lost.shape[2]), values, like) < close


def _parts(step: Linear) -> list[Array]:
    return [x for s in (step.free, step.motors) for x in (s.M, s.C, s.K, s.r, s.J)] + [step.base]


def _pack(step: Linear) -> Array:
    return np.concatenate([x.ravel() for x in _parts(step)])


def _size(step: Linear) -> int:
    return sum(x.size for x in _parts(step))


def _cuts(step: Linear) -> list[int]:
    return [int(c) for c in np.cumsum([x.size for x in _parts(step)])[:-1]]


def _relative(missed: Array, values: Array, step: Linear) -> float:
    """Largest miss of each matrix over its largest entry; the worst of all."""
    pairs = zip(np.split(missed, _cuts(step), 1), np.split(values, _cuts(step), 2), strict=True)
    return max(
        float(np.max(np.abs(m), initial=0.0) / max(np.max(np.abs(v), initial=0.0), 1e-300))
        for m, v in pairs
    )


class _Kept:
    """The last few steps: mode superposition looks three steps around."""

    def __init__(self, evaluate: Callable[[int], Linear]) -> None:
        self._evaluate, self._kept = evaluate, dict[int, Linear]()

    def at(self, k: int) -> Linear:
        if k not in self._kept:
            while len(self._kept) > 5:
                self._kept.pop(min(self._kept, key=lambda j: -abs(j - k)))
            self._kept[k] = self._evaluate(k)
        return self._kept[k]


class _Between:
    """Steps off the polynomials; those at corners are evaluated.

    Steps of a piece in which nothing changes are one object: a march keeps its factors there.
    """

    def __init__(self, every: Line, pieces: Pieces, values: Array, like: Linear) -> None:
        self._line, self._pieces, self._t = every, pieces, every.path.t
        self._corners = set(np.flatnonzero(pieces.at_corner(self._t)).tolist())
        self._of = pieces.of(self._t).tolist()
        self._shapes, self._cuts = [x.shape for x in _parts(like)], _cuts(like)
        flat = values.reshape(-1, values.shape[2])
        size = [
            np.full(x.shape[1], np.max(np.abs(x), initial=0.0))
            for x in np.split(flat, self._cuts, 1)
        ]
        round_off = _STILL * np.concatenate(size)
        self._still = flat[0]
        self._moves = np.ptp(flat, axis=0) > round_off
        self._values = np.ascontiguousarray(values[:, :, self._moves])
        resting = np.all(np.ptp(self._values, axis=1) <= round_off[self._moves], axis=1)
        self._resting = {int(k): self._linear(values[k, 0]) for k in np.flatnonzero(resting)}
        self._chunks: dict[int, Array] = {}
        self._last: tuple[int, Linear] | None = None

    def at(self, k: int) -> Linear:
        """The step k; a march asks for one, and then who reads its forces for the same."""
        if self._last is None or self._last[0] != k:
            self._last = k, self._at(k)
        return self._last[1]

    def _at(self, k: int) -> Linear:
        if k in self._corners:
            return self._line.at(k)
        if self._of[k] in self._resting:
            return self._resting[self._of[k]]
        number = k // _TOGETHER
        if number not in self._chunks:
            if len(self._chunks) > 1:
                self._chunks.pop(min(self._chunks, key=lambda j: -abs(j - number)))
            t = self._t[number * _TOGETHER : (number + 1) * _TOGETHER]
            rows = np.tile(self._still, (len(t), 1))
            rows[:, self._moves] = self._pieces.between(self._values, t)
            self._chunks[number] = rows
        return self._linear(self._chunks[number][k % _TOGETHER])

    def _linear(self, row: Array) -> Linear:
        parts = np.split(row, self._cuts)
        x = [part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)]
        return Linear(Instant(*x[:5]), Instant(*x[5:10]), x[10])


def _rigid_multipliers(
    dynamics: Equations, passive: IntArray, y: Array, v: Array, a: Array, t: float
) -> Array:
    """Closure forces of the rigid motion in the rows of the flexible mechanism.

    They bring the geometric stiffness of the joint forces; any split between them and the
    deviation's own multipliers satisfies the same equations.
    """
    system = dynamics.system
    if not system.closed.n:
        return np.zeros(0)
    r, _ = dynamics.residual(y, v, a, np.zeros(system.closed.n), t)
    J = dynamics.close(y).J[:, passive]
    return np.asarray(np.linalg.lstsq(J.T, r[passive], rcond=1e-10)[0], dtype=float)
