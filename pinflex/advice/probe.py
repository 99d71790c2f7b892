"""A cheap look at the flexible motion: linear vibration on interpolated matrices, and its defect.

    M(t) dd + C(t) d + K(t) d - J(t)' lam = -r(t),     J(t) d = 0

as level ked, with matrices interpolated between instants that resolve the nominal motion. Put into
the full equations, the answer leaves a defect; the same march with the defect as load is one step
of Newton's method on the whole motion, so its size is the error of ked. In a subspace of shapes it
is what fewer modes would give.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinflex.actuation.drive import between, nominal
from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.integrators.chebyshev import Interpolation, Varying, varying
from pinflex.integrators.collocation import generalized_alpha
from pinflex.integrators.problem import Run
from pinflex.levels.ked import LinearMarch, Response, RunningMarch, Workspace, forces_along
from pinflex.levels.linearised import LinearPath, full_path
from pinflex.levels.modes import modes
from pinflex.levels.start import lasting
from pinflex.linalg import independent_rows, saddle
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import closure_motion
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.system import System

# The linear system along a motion in fewer shapes: other bodies' shapes in those of a system.

_DEPENDENT = 1e-6  # of the largest: singular values below it close nothing
_ROUND_OFF = 1e-11  # of combinations of functions; seen: 1e-13


class Subspace:
    """The system in the columns of B.

    Attributes:
        B: Shape (nv, k).
        rows: Closures that are independent there.
    """

    def __init__(
        self,
        grid: Interpolation,
        parts: Sequence[Varying],
        B: Array,
        h: float,
        workspace: Workspace,
    ) -> None:
        """Matrices in the columns of B."""
        self.B, self._grid = B, grid
        self._row, self._still = _picked(B), np.zeros(B.shape[1])
        J = _in_columns(parts[3], B, False)
        self.rows = np.sort(independent_rows(J.constant, 1e-9))
        M, C, K = (_in_columns(x, B, True) for x in parts[:3])
        self._M, self._K, self._J = M, K, J
        every = np.arange(len(M.constant))
        system = M, C, K, J.picked(self.rows, every)
        self._march = LinearMarch(generalized_alpha(0.8), grid, system, h, workspace)

    def begin(self) -> RunningMarch:
        """One of some marches that go on side by side."""
        return self._march.begin()

    def windows(self) -> Iterator[slice]:
        """Steps that are taken at a time."""
        return self._march.windows()

    def go(self, march: RunningMarch, s: slice, load: Array, rest: Array | None = None) -> Response:
        """What a march finds in a window, in all coordinates and rows of J."""
        start = self._still
        if rest is not None and s.start == 0:
            now = self._march.instant(0, self._still)
            start, _ = saddle(now.K, now.J, now.J, -self._narrow(rest), np.zeros(len(now.J)))
        march.go(s, self._narrow(load), start)
        d, v, a, lam = (x[s] for x in march.response)
        every = np.zeros((len(lam), self._J.shape[0]))
        every[:, self.rows] = lam
        return Response(self._wide(d), self._wide(v), self._wide(a), every)

    def _narrow(self, load: Array) -> Array:
        """In the columns of B, shape (..., k)."""
        return np.asarray(load @ self.B if self._row is None else load[..., self._row])

    def _wide(self, x: Array) -> Array:
        """In all coordinates, shape (..., nv)."""
        if self._row is None:
            return np.asarray(x @ self.B.T)
        found = np.zeros((*x.shape[:-1], len(self.B)))
        found[..., self._row] = x
        return found

    def balanced(self, at: IntArray, load: Array) -> tuple[Array, Array]:
        """Equilibria K d - J' lam = -r, J d = 0 at steps: d in all coordinates, lam in all rows."""
        grid, n = self._grid, self.B.shape[1]
        J = self._J.along(grid, at)[:, self.rows]
        A = np.zeros((len(at), n + len(self.rows), n + len(self.rows)))
        A[:, :n, :n], A[:, n:, :n] = self._K.along(grid, at), J
        A[:, :n, n:] = -J.swapaxes(1, 2)
        b = np.zeros((*A.shape[:2], 1))
        b[:, :n, 0] = -self._narrow(load)
        found = np.linalg.solve(A, b)[:, :, 0]
        lam = np.zeros((len(at), self._J.shape[0]))
        lam[:, self.rows] = found[:, n:]
        return self._wide(found[:, :n]), lam

    def closing(self, gaps: Array, s: slice, straight: Array | None) -> Array:
        """What closes loops, and its rates, shape (3, steps, nv)."""
        P = self._grid.between(self._closers, s) if straight is None else straight[s]
        moved = (P @ -gaps.transpose(1, 2, 0)).transpose(2, 0, 1)
        return np.asarray(moved @ self.B[:, : P.shape[1]].T)

    @cached_property
    def _closers(self) -> Array:
        """P with J P = 1, of least elastic (and some kinetic) energy, shape (size, k, rows)."""
        M, K, J = (x.whole() for x in (self._M, self._K, self._J))
        slow = (2 * np.pi / float(self._grid.t[-1])) ** 2
        A_J = np.linalg.solve(K + slow * M, J.transpose(0, 2, 1))
        return np.asarray(A_J @ np.linalg.pinv(J @ A_J, rcond=1e-10))


def pseudo_inverse(J: Array) -> tuple[Array, IntArray]:
    """Pseudo-inverses of Jacobians (size, rows, n), shape (size, n, rows), and their ranks."""
    U, sigma, V = np.linalg.svd(J, full_matrices=False)
    large = sigma > _DEPENDENT * np.max(sigma, axis=1, keepdims=True, initial=0.0)
    inverse = np.where(large, 1.0 / np.where(large, sigma, 1.0), 0.0)
    found = V.swapaxes(1, 2) @ (inverse[:, :, None] * U.swapaxes(1, 2))
    return found, np.count_nonzero(large, axis=1)


def _picked(B: Array) -> IntArray | None:
    """The coordinates that the columns of B are, as they mostly are; None: combinations."""
    row = np.argmax(B, axis=0)
    alone = np.count_nonzero(B) == B.shape[1] and np.all(B[row, np.arange(B.shape[1])] == 1.0)
    return row if alone else None


def _in_columns(x: Varying, B: Array, both: bool) -> Varying:
    """x B, or B' x B, of a matrix x with rows or columns of all coordinates."""
    row = _picked(B)
    if row is None:
        return varying(B.T @ x.whole() @ B if both else x.whole() @ B)
    return x.picked(row if both else np.arange(x.shape[0]), row)


def shapes_of(system: System, parts: Mapping[str, FlexiblePart]) -> Array:
    """Shapes of other bodies as columns in the coordinates of a system, shape (nv, k).

    Free rigid coordinates and elastic drives stay; a link that is not in `parts` is rigid. The
    functions of a smaller basis are combinations of those of a larger one: found by least squares
    at sections.
    """
    m = int(system.rigid.nv)
    kept = [*system.free[system.free < m], *(m + gear.eta for gear in system.expansion.drives)]
    columns = [np.eye(system.nv)[:, kept]]
    seen, known = dict[str, int](), dict[tuple[int, int], Array]()
    for slot in system.expansion.slots:
        place = seen.setdefault(slot.link, 0)
        seen[slot.link] += 1
        if slot.link not in parts:
            continue
        body = parts[slot.link].bodies[place]
        if body.solid is not None:
            T = np.eye(slot.body.n)
        else:
            pair = id(slot.body), id(body)  # links alike share theirs
            if pair not in known:
                x = np.linspace(0.0, body.length, 4 * slot.body.n + 2)[1:]
                large, small = (
                    b.fields(x)["deflection"].reshape(-1, b.n) for b in (slot.body, body)
                )
                known[pair] = _tidy(np.linalg.lstsq(large, small, rcond=None)[0])
            T = known[pair]
        part = np.zeros((system.nv, T.shape[1]))
        part[m:][slot.eta] = T
        columns.append(part)
    return np.hstack(columns)


def _tidy(T: npt.NDArray[np.floating]) -> Array:
    """Without the round-off of zeros and ones: most functions of a smaller basis are of both."""
    whole = np.rint(T)
    return np.asarray(np.where(np.abs(T - whole) < _ROUND_OFF, whole, T), dtype=float)


_PARTS = 80  # of the time, each with a whole number of steps
_CLOSE = 1e-3  # of the largest entry of a matrix: what interpolation may miss
_JUMP = 0.1  # of the largest acceleration between two steps: they are too long for the motion
_PERIOD = 20  # steps for each period of the third mode: amplitudes within 1 %
_APART = 0.01  # modes nearer to each other count as one: those of links that are alike
_BOUND = 1e6  # m or rad: a deviation beyond it grows without bound
_MOST = 640  # steps: more would cost as much as the run that is to be saved
RESOLVED = 8  # steps in the third mode's period; with fewer its amplitude is a guess


class Probe:
    """One scene: its nominal motion, the linear system along it, and marches of it."""

    def __init__(
        self,
        mechanism: Mechanism,
        motion: Motion,
        end: float,
        static: bool,
        like: Probe | None = None,
        finer: float = 1.0,
    ) -> None:
        """Its nominal motion, which may be that of another probe, and the system along it.

        `finer`: times as many steps as the other has.
        """
        self.mechanism, self.system, self.static = mechanism, mechanism.flexible, static
        self.end = end
        if like is None:
            steps, self.third, self.first = _steps(mechanism, end)
            self.path = nominal(mechanism, motion, _instants(end, steps))
            if _jumps(self.path.a):
                self.path = between(mechanism, motion, self.path, _instants(end, _MOST))
        else:
            self.third, self.first = like.third, like.first
            self.path = like.path
            if finer != 1.0:
                steps = round(finer * (like.steps - 1))
                self.path = between(mechanism, motion, like.path, np.linspace(0.0, end, steps + 1))
        self.t = self.path.t
        self.h = float(self.t[1])
        self.dynamics = Equations(self.system)
        line = LinearPath(mechanism, self.path, dynamics=self.dynamics, whole=True)
        self.v0, self.a0 = line.v, line.a
        self.full = full_path(line, mechanism, motion, _CLOSE)
        self._parts = self.full.parts
        self._workspace: Workspace = like._workspace if like is not None else Workspace()
        self.rough = self.full.missed

    @property
    def steps(self) -> int:
        """Number of instants of a march."""
        return len(self.t)

    @property
    def steps_a_period(self) -> float:
        """Steps in a period of the third mode."""
        return 1.0 / max(self.third * self.h, 1e-300)

    @cached_property
    def base(self) -> Array:
        """Multipliers of the rigid motion at every step, interpolated, shape (nt, rows).

        The load is evaluated with them: what they miss, the multipliers of the deviation have.
        """
        return self._parts[5].along(self.full.grid)

    # Marches -------------------------------------------------------------------------------

    def march(self, shapes: Array | None = None) -> Response:
        """The linear deviation, in all shapes or in the columns of `shapes` (nv, k)."""
        return self.marched(0, shapes)[0]

    def marched(self, times: int, shapes: Array | None = None) -> list[Response]:
        """The linear deviation, and that corrected once and so on, up to so many times.

        A correction is the answer to what a deviation leaves in the full equations. The closures
        are off by c, with exact rates; a part p of the answer closes them, and the march finds what
        the forces then left ask for. All go on side by side, so that factors serve them in turn.

        Raises:
            ConvergenceError: One grows without bound.
        """
        within = self._within(shapes)
        size = self.system.nv, self.system.closed.n
        every = [Response.empty(self.steps, *size) for _ in range(times + 1)]
        going = [within.begin() for _ in every]
        for s in within.windows():
            rest = self._at_rest(self._none(1), s)
            found = self._bounded(within.go(going[0], s, self._load[s], rest), s)
            every[0].put(s, found)
            for one, history in zip(going[1:], every[1:], strict=True):
                if self.dynamics.looped:
                    gaps = closure_motion(self.dynamics, *self._state(found, s)[:3])
                    found = found.plus(*within.closing(gaps, s, self._straight))
                left = self.dynamics.residual(*self._state(found, s), self.t[s]).r
                rest = self._at_rest(found, s)
                found = found.plus(*self._bounded(within.go(one, s, left, rest), s))
                history.put(s, found)
        return every

    def _at_rest(self, found: Response, s: slice) -> Array | None:
        """What a deviation leaves of the forces before the motion begins, shape (nv,).

        A motion from rest may begin with an acceleration, which the start knows nothing of.
        """
        if not self.static or s.start > 0:
            return None
        y, v, a, lam = (x[:1] for x in self._state(found, slice(0, 1)))
        moving = 1.0 if np.any(self.v0[0]) else 0.0
        return np.asarray(self._before.residual(y, v * moving, a * moving, lam, self.t[:1]).r[0])

    @cached_property
    def _before(self) -> Equations:
        """With the loads that a start in equilibrium knows."""
        system = self.system
        if self.mechanism.description.solve.start == "auto":
            system = lasting(system)
        return self.dynamics if system is self.system else Equations(system)

    @cached_property
    def _load(self) -> Array:
        """What the rigid motion leaves at every step, shape (nt, nv)."""
        return self.dynamics.residual(self._flat, self.v0, self.a0, self.base, self.t).r

    @cached_property
    def _straight(self) -> Array | None:
        """P with J P = 1 that moves rigid joints alone, (nt, passive, rows); None: they cannot.

        Joints that are not driven close all loops of most mechanisms, whatever links do.
        """
        J, passive = self._parts[3], self.mechanism.rigid.free
        P, rank = pseudo_inverse(J.picked(np.arange(J.shape[0]), passive).whole())
        if not self.dynamics.looped or np.any(rank < len(self._whole.rows)):
            return None
        return self.full.grid.between(P)

    def _within(self, shapes: Array | None) -> Subspace:
        """The system in some shapes: that in all is kept."""
        return self._whole if shapes is None else self._subspace(shapes)

    @cached_property
    def _whole(self) -> Subspace:
        return self._subspace(np.eye(self.system.nv)[:, self.system.free])

    def _subspace(self, B: Array) -> Subspace:
        return Subspace(self.full.grid, self._parts, B, self.h, self._workspace)

    def _bounded(self, found: Response, s: slice) -> Response:
        """What a march found in a window; raises a ConvergenceError where it has no bound."""
        with np.errstate(invalid="ignore"):
            far = ~(np.max(np.abs(found.d), axis=1, initial=0.0) <= _BOUND)
        if np.any(far):
            k = s.start + int(np.argmax(far))
            raise ConvergenceError(
                f"{self.mechanism.name}: t = {self.t[k]:.6g} s: the linear vibration grows "
                "without bound.",
                time=float(self.t[k]),
            )
        return found

    def _state(self, found: Response, s: slice = slice(None)) -> tuple[Array, Array, Array, Array]:
        """y, v, a and multipliers in a window."""
        lam = self.base[s] + found.lam
        return self._poses(found, s), self.v0[s] + found.v, self.a0[s] + found.a, lam

    # Runs ----------------------------------------------------------------------------------

    def _poses(self, found: Response, s: slice = slice(None)) -> Array:
        """Shape (steps, nq)."""
        return self._manifold.retract(self._flat[s], found.d)

    @cached_property
    def _manifold(self) -> Manifold:
        return Manifold(self.dynamics)

    @cached_property
    def _flat(self) -> Array:
        return self.path.straight(self.system.n_eta)

    def linear(self, found: Response) -> Run:
        """The states and the linear torques of a deviation."""
        forces = forces_along(self.full.grid, self._of_motors, found)
        return self._run(found, self._load[:, self.system.motors] + forces)

    @cached_property
    def _of_motors(self) -> tuple[Varying, ...]:
        """M, C and K in the rows of the motors, J in their columns."""
        motors, (*square, J) = self.system.motors, self._parts[:4]
        every, rows = (np.arange(n) for n in J.shape[::-1])
        return *(x.picked(motors, every) for x in square), J.picked(rows, motors)

    def still(self, at: IntArray, shapes: Array | None = None) -> Run:
        """Where links would be without vibration, at some steps; in the columns of `shapes`.

        Raises:
            LinAlgError: Nothing holds them there.
        """
        d, lam = self._within(shapes).balanced(at, self._load[at])
        K, J = (x.along(self.full.grid, at) for x in self._of_motors[2:])
        forces = K @ d[:, :, None] - J.swapaxes(1, 2) @ lam[:, :, None]
        torque = self._load[at][:, self.system.motors] + forces[:, :, 0]
        y = self._manifold.retract(self._flat[at], d)
        v, a, lam = self.v0[at], self.a0[at], self.base[at] + lam
        return Run(self.system, self.t[at], y, v, a, lam, torque, {})

    def nonlinear(self, found: Response) -> Run:
        """The states and the torques of the full equations."""
        torque = self.dynamics.residual(*self._state(found), self.t).r[:, self.system.motors]
        return self._run(found, torque)

    def motion(self, times: int, shapes: Array | None = None) -> Run:
        """The run of a deviation that is corrected so many times, as in `marched`."""
        found = self.marched(times, shapes)[-1]
        return self.nonlinear(found) if times else self.linear(found)

    def rigid(self) -> Run:
        """The undeformed motion and its torques."""
        return self._run(self._none(self.steps), self._load[:, self.system.motors])

    def _none(self, steps: int) -> Response:
        none = np.zeros((steps, self.system.nv))
        return Response(none, none, none, np.zeros((steps, self.system.closed.n)))

    def _run(self, found: Response, torque: Array) -> Run:
        v, a = self.v0 + found.v, self.a0 + found.a
        lam = self.base + found.lam  # forces that hold loops closed load the sections of links
        return Run(self.system, self.t, self._poses(found), v, a, lam, torque, {})


def _instants(end: float, steps: int) -> Array:
    return np.linspace(0.0, end, _PARTS * -(-steps // _PARTS) + 1)


def _jumps(a: Array) -> bool:
    """Whether accelerations (nt, nv) at equal steps are off the line through their neighbours."""
    off = np.max(np.abs(a[1:-1] - 0.5 * (a[:-2] + a[2:])), initial=0.0)
    return bool(off > _JUMP * np.max(np.abs(a), initial=0.0))


def _steps(mechanism: Mechanism, end: float) -> tuple[int, float, float]:
    """Steps of a march, a twentieth of the third mode's period each; it and the first, in Hz."""
    found = modes(mechanism, count=9, preload="none").frequencies
    alive = found[(found > 0) & (np.diff(found, prepend=0.0) > _APART * found)]
    third = float(alive[min(2, len(alive) - 1)]) if len(alive) else 0.0
    first = float(alive[0]) if len(alive) else 0.0
    return int(np.clip(np.ceil(_PERIOD * third * end), 4 * _PARTS, _MOST)), third, first
