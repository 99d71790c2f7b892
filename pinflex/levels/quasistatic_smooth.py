"""Level quasistatic: equilibria along a motion, many at a time.

Instants do not depend on each other, and what they have in common is used: one tangent serves a
neighbourhood, Newton's residuals are evaluated together, and between the corners of the motion the
deviation is a smooth function of time, so that it is found at a few Chebyshev points and
interpolated. With a tolerance that is all; without one the interpolated poses are where Newton
starts at every sample. Where this does not go straight, `pinflex.levels.quasistatic` goes from
instant to instant and finds out what is the matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pinflex.actuation.drive import Nominal, between, breaks, nominal_and_more
from pinflex.arrays import Array, IntArray, distinct
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import ASKED
from pinflex.errors import ConvergenceError
from pinflex.integrators.chebyshev import PiecewiseChebyshev
from pinflex.integrators.problem import Run
from pinflex.levels.outputs import ROUND_OFF, Outputs, relative
from pinflex.levels.quasistatic import (
    STABILITY_SAMPLES,
    solve_quasistatic,
    unstable_directions,
    unstable_text,
)
from pinflex.linalg import lapack, negative_directions, saddle_matrix
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import FrozenLinks
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism

_NODES = 12  # intervals between the nodes of a piece to begin with
_NOMINAL_ERROR = 0.1  # of the largest nominal acceleration: nodes that miss so much are too few
_APART = 6  # nodes from one with a tangent to the next
_MOST = 15  # iterations
_STRIDE = 0.3  # m or rad: of a first approach, as in pinflex.levels.quasistatic
_FAR = 0.5  # of the largest deviation: where a prediction is so far off, it is not smooth
_SLOW = 0.3  # contraction above which an instant gets a tangent of its own,
_ROUND_OFF = 1e-11  # m or rad: unless it is round-off that does not contract
_CLOSE = 1e-3  # of the tolerance: forces and gaps that Newton may leave, of the largest ones
_EXACT = 1e-13  # the same at samples without a tolerance: what round-off leaves
_CLOSED = 1e-12  # m or rad, as in pinflex.mechanics.assembly


class _Unclear(Exception):
    """Newton did not go straight to an equilibrium."""


class Equilibria:
    """The equilibria of one run, and what is known between them.

    They are packed: deviation from the nominal pose (nv), multipliers (rows), torques (nm); then
    the nominal accelerations, which tell whether the nodes follow the motion.
    """

    def __init__(self, mechanism: Mechanism, motion: Motion, t: Array, close: float) -> None:
        """`close`: the forces and gaps that Newton may leave at nodes, of the largest ones."""
        self._lapack, self._mechanism, self._motion = lapack(), mechanism, motion
        self._system, self._close = mechanism.flexible, close
        self.dynamics = Equations(self._system)
        self._manifold = Manifold(self.dynamics)
        self._links = FrozenLinks(self.dynamics, mechanism, self._system.free)
        corners = breaks(motion, self._system.loads)
        self._pieces = PiecewiseChebyshev(float(t[0]), float(t[-1]), corners)
        first = self._pieces.nodes(_NODES).ravel()
        self._path, self._first = nominal_and_more(mechanism, motion, t, first)
        widths = self._system.nv, self._system.closed.n, len(self._system.motors)
        self._ends = np.cumsum(widths)
        width = int(self._ends[-1] + self._system.rigid.nv)
        self._values = np.empty((len(self._pieces), 0, width))
        self._factors: list[tuple[float, Array, Array]] = []  # time, LU, pivots
        self._reach, self._force = np.inf, 0.0  # largest deviation and force, once known
        self._doubtful = False  # whether some tangent gives way
        self._counts = {"steps": 0.0, "newton": 0.0, "tangents": 0.0}

    @property
    def nodes(self) -> int:
        """Number of instants that are interpolated between."""
        return len(self._pieces) * self._values.shape[1]

    def begin(self) -> None:
        """Balance the first nodes, from straight links."""
        path, guess = self._first, np.zeros((len(self._first.t), self._values.shape[2]))
        self._prepare(path, guess)
        guess = self._solve(path, guess, far=True, rounds=1)
        self._factors, self._doubtful = [], False  # now with what the loads stiffen
        self._prepare(path, guess)
        found = self._solve(path, guess, far=True)
        self._values = found.reshape(len(self._pieces), _NODES + 1, -1)
        moved, lam, torque, _ = np.split(found, self._ends, axis=1)
        self._reach, self._force = _largest(moved), max(_largest(lam), _largest(torque))

    def refine(self) -> None:
        """Balance the middles between the nodes too."""
        known, n = self._values, 2 * (self._values.shape[1] - 1)
        times = self._pieces.nodes(n)[:, 1::2].ravel()
        found = self._solve(self._nominal(times), self._pieces.between(known, times))
        self._values = np.empty((len(known), n + 1, known.shape[2]))
        self._values[:, ::2], self._values[:, 1::2] = known, found.reshape(len(known), n // 2, -1)

    def interpolated(self) -> tuple[Run, Run, float]:
        """The run off the polynomials; off coarser ones; by how much nominal accelerations are off.

        Samples at corners are balanced themselves.
        """
        path, pieces = self._path, self._pieces
        # What a smooth function loses without its last two polynomials is more than it misses.
        coarser = self._values - pieces.last_two(self._values)
        both = np.concatenate([self._values, coarser], axis=2)
        fine, coarse = np.split(pieces.between(both, path.t), 2, axis=1)
        at = pieces.at_corner(path.t)
        fine[at] = coarse[at] = self._solve(path.at(at), fine[at])
        run = self._run(fine)  # whose rates serve both: they follow the rigid motion
        less = replace(run, y=self._poses(path, coarse), torque=self._torque(coarse))
        return run, less, relative(fine[:, self._ends[-1] :], path.a)

    def exact(self) -> Run:
        """The run with every sample balanced, from the polynomials and with tangents there."""
        times = self._pieces.nodes(self._values.shape[1] - 1).ravel()
        self._factors = []
        self._prepare(self._nominal(times), self._values.reshape(len(times), -1), 1)
        guess = self._pieces.between(self._values, self._path.t)
        return self._run(self._solve(self._path, guess, close=_EXACT))

    def _prepare(self, path: Nominal, values: Array, every: int = _APART) -> None:
        """Tangents at every so manyth of packed states."""
        states = (x[::every] for x in (*self._states(path, values), path.t))
        for y, v, a, lam, t in zip(*states, strict=True):
            self._tangent(y, v, a, lam, float(t))

    def _nominal(self, t: Array) -> Nominal:
        return between(self._mechanism, self._motion, self._path, t)

    def _states(self, path: Nominal, values: Array) -> tuple[Array, Array, Array, Array]:
        """y, v, a and lam of packed equilibria."""
        d, system, n = self.dynamics, self._system, len(path.t)
        v, a = np.zeros((n, system.nv)), np.zeros((n, system.nv))
        v[:, : d.n_rigid], a[:, : d.n_rigid] = path.v, path.a
        y = self._poses(path, values)
        return y, *self._links.rates(y, v, a), values[:, self._ends[0] : self._ends[1]]

    def _poses(self, path: Nominal, values: Array) -> Array:
        """y of packed equilibria."""
        moved = values[:, : self._ends[0]].copy()
        moved[:, self._system.motors] = 0.0
        return self._manifold.retract(path.straight(self._system.n_eta), moved)

    def _torque(self, values: Array) -> Array:
        return values[:, self._ends[1] : self._ends[2]]

    def _run(self, values: Array) -> Run:
        system, t = self._system, self._path.t
        y, v, a, lam = self._states(self._path, values)
        return Run(system, t, y, v, a, lam, self._torque(values), dict(self._counts))

    def with_stability_warning(self, run: Run) -> Run:
        """The run with a warning where an equilibrium gives way."""
        if not self._doubtful:
            return run
        for k in np.linspace(0, len(run.t) - 1, STABILITY_SAMPLES).astype(int):
            state = run.y[k], run.v[k], run.a[k], run.lam[k], float(run.t[k])
            if unstable_directions(self.dynamics, *state, run.system.free):
                said = unstable_text(f"t = {run.t[k]:.6g} s: equilibrium")
                return replace(run, warnings=(said,))
        return run

    # Newton --------------------------------------------------------------------------------

    def _solve(
        self,
        path: Nominal,
        guess: Array,
        close: float | None = None,
        far: bool = False,
        rounds: int | None = None,
    ) -> Array:
        """Packed equilibria, shape (n, width); `_Unclear` where one needs closer attention."""
        system, n = self._system, len(path.t)
        free, close = system.free, close or self._close
        gap = max(_CLOSED, close * _largest(guess[:, : system.nv]))
        Y, V, A, lam = self._states(path, guess)
        use, previous = self._nearest(path.t), np.full(n, np.inf)
        for _ in range(rounds or _MOST):
            R, C = self.dynamics.residual(Y, V, A, lam, path.t)
            force = max(self._force, _largest(R[:, system.motors]), _largest(lam))
            if _largest(R[:, free]) <= close * force and _largest(C) < gap:
                break
            right, x = np.hstack([R[:, free], C]), np.empty((n, len(free) + system.closed.n))
            for one in distinct(use):
                _, lu, pivots = self._factors[one]
                x[use == one] = self._lapack.dgetrs(lu, pivots, -right[use == one].T)[0].T
            size = np.max(np.abs(x[:, : len(free)]), axis=1, initial=0.0)
            if not np.all(size <= _FAR * self._reach + _ROUND_OFF):
                raise _Unclear
            if far:
                x *= np.minimum(1.0, _STRIDE / np.maximum(size, _STRIDE))[:, None]
            step = np.zeros((n, system.nv))
            step[:, free] = x[:, : len(free)]
            Y, lam = self._manifold.retract(Y, step), lam + x[:, len(free) :]
            V, A = self._links.rates(Y, V, A)
            self._counts["newton"] += n
            for k in np.flatnonzero((size > _SLOW * previous) & (size > _ROUND_OFF)):
                use[k] = self._tangent(Y[k], V[k], A[k], lam[k], float(path.t[k]), exact=True)
            previous = size
        else:
            if rounds is None:
                raise _Unclear
        self._counts["steps"] += 0 if rounds else n
        moved = self._manifold.log(path.straight(system.n_eta), Y)
        return np.hstack([moved, lam, R[:, system.motors], path.a])

    def _tangent(
        self, y: Array, v: Array, a: Array, lam: Array, t: float, exact: bool = False
    ) -> int:
        """Factors of the tangent at a state, `exact` with what changes v and a; their number."""
        d, free = self.dynamics, self._system.free
        M, C, K, J = d.tangent(y, v, a, lam, t)
        square = np.ix_(free, free)
        self._doubtful |= negative_directions(K[square], J[:, free]) > 0
        if exact:
            K = K + self._links.stiffness(y, v, a, M, C)
        lu, pivots, info = self._lapack.dgetrf(saddle_matrix(K[square], J[:, free]))
        if info != 0 or not np.all(np.isfinite(lu)):
            raise _Unclear
        self._factors.append((t, lu, pivots))
        self._counts["tangents"] += 1
        return len(self._factors) - 1

    def _nearest(self, t: Array) -> IntArray:
        apart = np.abs(t[:, None] - np.array([at for at, _, _ in self._factors]))
        return np.asarray(np.argmin(apart, axis=1), dtype=np.intp)


def _largest(x: Array) -> float:
    return float(np.max(np.abs(x), initial=0.0))


def solve_equilibria(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    tol: float | None = None,
    asked: Sequence[str] = ASKED,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Level quasistatic at samples t (s), as `solve_quasistatic` has it."""
    if motion.kind == "hold" and tol is None and not mechanism.flexible.loads.timed:
        once = solve_quasistatic(mechanism, motion, t[:1])  # nothing differs between instants
        return replace(once.at(np.zeros(len(t), dtype=np.intp)), t=np.asarray(t, float))
    try:
        smooth = mechanism.standing is mechanism.flexible and len(mechanism.flexible.free)
        if len(t) > 2 * _NODES and smooth:
            return _smooth(mechanism, motion, t, tol, asked)
    except (_Unclear, ConvergenceError):
        pass  # from instant to instant it is found, or found out what is the matter
    return solve_quasistatic(mechanism, motion, t, progress)


def _smooth(
    mechanism: Mechanism, motion: Motion, t: Array, tol: float | None, asked: Sequence[str]
) -> Run:
    """Refined until the last polynomials matter less than tol, or balanced at every sample."""
    found = Equilibria(mechanism, motion, t, _CLOSE * (1e-2 if tol is None else tol))
    found.begin()
    if tol is None:
        found.refine()
        return found.with_stability_warning(found.exact())
    compare = Outputs(mechanism, motion, t, asked, found.dynamics)
    while True:
        fine, coarse, astray = found.interpolated()
        differ = compare.differences(coarse, fine)
        error = {key: max(e, ROUND_OFF) for key, e in differ.items()}
        if max(error.values(), default=0.0) <= 0.5 * tol and astray < _NOMINAL_ERROR:
            break
        if 2 * found.nodes >= len(t):
            fine, error = found.exact(), dict.fromkeys(error, ROUND_OFF)
            break
        found.refine()
    return replace(found.with_stability_warning(fine), settings={"tol": tol, "error": error})
