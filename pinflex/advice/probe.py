"""A cheap look at the flexible motion: linear vibration on interpolated matrices, and its defect.

    M(t) dd + C(t) d + K(t) d - J(t)' lam = -r(t),     J(t) d = 0

as level ked, but the matrices are evaluated at knots that resolve the nominal motion and are
interpolated in between, where the vibration is. Put into the full equations, the answer leaves a
defect; the same march with the defect as load is one step of Newton's method on the whole motion,
so its size is the error of ked. In a subspace of shapes it is what fewer modes would give.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinflex.actuation.drive import breaks
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.integrators.linear import Instant, alpha
from pinflex.integrators.run import Run
from pinflex.integrators.schemes import generalized_alpha
from pinflex.levels.linearised import Line
from pinflex.levels.modes import modes
from pinflex.linalg import independent_rows, saddle
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.geometry import spans
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.parts import FlexiblePart
from pinflex.mechanics.system import System

_KNOTS = 80  # intervals to begin with: cubics follow an eightieth of a cycloid to 1e-5
_MOST_KNOTS = 640
_ROUGH = 1e-2  # of the largest acceleration: where interpolation is off by more, more knots
_PERIOD = 20  # steps for each period of the third mode: amplitudes within 1 %
_MOST = 640  # steps: more would cost as much as the run that is to be saved


@dataclass(frozen=True)
class Loaded:
    """The linear system at the knots.

    Attributes:
        packed: Entries of M, C, K, r and J, one instant in one row, shape (knots, size).
        n, rows: Coordinates and closure rows.
    """

    packed: Array
    n: int
    rows: int

    @staticmethod
    def of(M: Array, C: Array, K: Array, r: Array, J: Array) -> Loaded:
        """From stacks: M, C, K (knots, n, n), r (knots, n), J (knots, rows, n)."""
        parts = [x.reshape(len(M), -1) for x in (M, C, K, r, J)]
        return Loaded(np.hstack(parts), M.shape[1], J.shape[1])

    def at(self, index: int, weights: Array) -> Instant:
        """The system from four knots onward, weighted."""
        n, rows = self.n, self.rows
        flat = weights @ self.packed[index : index + 4]
        M, C, K, r, J = np.split(flat, np.cumsum([n * n, n * n, n * n, n]))
        square = (n, n)
        return Instant(
            M.reshape(square), C.reshape(square), K.reshape(square), r, J.reshape(rows, n)
        )


@dataclass(frozen=True)
class Deviation:
    """d, v, a (nt, nv) from the nominal motion and the multipliers (nt, rows) beyond the rigid."""

    d: Array
    v: Array
    a: Array
    lam: Array


class Probe:
    """One scene: its nominal motion, the linear system along it, and marches of it."""

    def __init__(
        self,
        mechanism: Mechanism,
        motion: Motion,
        end: float,
        static: bool,
        steps: int | None = None,
    ) -> None:
        """`steps`: of the marches; None: by the third mode of the mechanism."""
        self.mechanism, self.system, self.static = mechanism, mechanism.flexible, static
        self.end = end
        wanted, self.third = _steps(mechanism, end)
        steps = wanted if steps is None else steps
        self.knots = _KNOTS
        while True:
            self.stride = -(-steps // self.knots)
            self.t = np.linspace(0.0, end, self.knots * self.stride + 1)
            self.path = nominal(mechanism, motion, self.t)
            inside = [b for b in breaks(motion, self.system.loads) if b < end]
            self.corners = np.array([0.0, *inside, end]) / end * self.knots
            around = [self._around(k) for k in range(self.steps)]
            self._first = np.array([i for i, _ in around], dtype=np.intp)
            self._weights = np.array([w for _, w in around])
            self.rough = self._roughness()
            if self.rough < _ROUGH or self.knots >= _MOST_KNOTS:
                break
            self.knots *= 2
        self.h = float(self.t[1])
        self.dynamics = Equations(self.system)
        line = Line(mechanism, self.path, dynamics=self.dynamics)
        self.v0, self.a0 = line.v, line.a
        here = [line.full(k) for k in range(0, len(self.t), self.stride)]
        self.base = np.array([x.base for x in here])
        stack = {x: np.array([getattr(h.instant, x) for h in here]) for x in "MCKrJ"}
        self.full = Loaded.of(*(stack[x] for x in "MCKrJ"))
        self.stack = stack

    def _roughness(self) -> float:
        """How far the nominal acceleration is from its interpolation, of its largest value."""
        a = self.path.a
        scale = np.max(np.abs(a), initial=0.0)
        return float(np.max(np.abs(self.between(a[:: self.stride]) - a)) / scale) if scale else 0.0

    @property
    def steps(self) -> int:
        """Number of instants of a march."""
        return len(self.t)

    def weights(self, k: int) -> tuple[int, Array]:
        """First of four knots around a step, and their weights."""
        return int(self._first[k]), self._weights[k]

    def _around(self, k: int) -> tuple[int, Array]:
        """Those of cubic interpolation.

        Where a piece of the motion or of a load ends, the four are of one side of it.
        """
        x = k / self.stride
        here = int(np.searchsorted(self.corners, x - 1e-9))
        low, high = self.corners[max(here - 1, 0)], self.corners[max(here, 1)]
        i = int(np.floor(x)) - 1
        if np.floor(high + 1e-9) - np.ceil(low - 1e-9) >= 3:
            i = int(min(max(i, np.ceil(low - 1e-9)), np.floor(high + 1e-9) - 3))
        i = min(max(i, 0), self.knots - 3)
        s = x - i
        w = np.array([
            -(s - 1) * (s - 2) * (s - 3) / 6, s * (s - 2) * (s - 3) / 2,
            -s * (s - 1) * (s - 3) / 2, s * (s - 1) * (s - 2) / 6,
        ])  # fmt: skip
        return i, w

    def between(self, values: Array) -> Array:
        """Values at the knots (knots, ...), interpolated to every step."""
        flat = values.reshape(len(values), -1)
        found = np.zeros((self.steps, flat.shape[1]))
        for j, weight in enumerate(self._weights.T):
            found += weight[:, None] * flat[self._first + j]
        return found.reshape(self.steps, *values.shape[1:])

    # Marches -------------------------------------------------------------------------------

    def march(self, shapes: Array | None = None) -> Deviation:
        """The linear deviation, in all shapes or in the columns of `shapes` (nv, k).

        Raises:
            ConvergenceError: It grows without bound.
        """
        return self._march(self._shapes(shapes), None)

    def _shapes(self, shapes: Array | None) -> Array:
        return np.eye(self.system.nv)[:, self.system.free] if shapes is None else shapes

    def _march(self, B: Array, load: Array | None) -> Deviation:
        """March in the columns of B under what the rigid motion leaves, or `load` at every step."""
        s, Bt = self.stack, B.T
        J = s["J"] @ B
        rows = np.sort(independent_rows(J[0], 1e-9))
        system = Loaded.of(
            Bt @ s["M"] @ B, Bt @ s["C"] @ B, Bt @ s["K"] @ B, s["r"] @ B, J[:, rows]
        )
        reduced = None if load is None else load @ B

        def at(k: int) -> Instant:
            now = system.at(*self.weights(k))
            return now if reduced is None else replace(now, r=reduced[k])

        start = np.zeros(B.shape[1])
        if self.static:
            now = at(0)
            start, _ = saddle(now.K, now.J, now.J, -now.r, np.zeros(len(now.J)))
        nv, count = self.system.nv, self.steps
        found = Deviation(*(np.zeros((count, n)) for n in (nv, nv, nv, self.system.closed.n)))
        for k, state in enumerate(alpha(generalized_alpha(0.8), at, count, self.h, start)):
            if not np.all(np.isfinite(state.d)) or np.max(np.abs(state.d), initial=0.0) > 1e6:
                raise ConvergenceError(
                    f"{self.mechanism.name}: t = {self.t[k]:.6g} s: the linear vibration grows "
                    "without bound.",
                    time=float(self.t[k]),
                )
            found.d[k], found.v[k], found.a[k] = B @ state.d, B @ state.v, B @ state.a
            found.lam[k][rows] = state.lam
        return found

    def corrected(self, found: Deviation, shapes: Array | None = None) -> Deviation:
        """A deviation and the answer to its defect in the full equations.

        The closures are off by c, with exact rates; a part p of the answer closes them with the
        least elastic energy, and the march finds the rest.

        Args:
            found: From `march`, or from here. shapes: Those in which it was found.
        """
        B = self._shapes(shapes)
        load, p = self._defect(found, self._closers(B))
        for k in range(self.steps):
            now = self.full.at(*self.weights(k))
            load[k] += now.K @ p[0, k] + now.C @ p[1, k] + now.M @ p[2, k]
        fix = self._march(B, load)
        return Deviation(
            found.d + fix.d + p[0], found.v + fix.v + p[1], found.a + fix.a + p[2],
            found.lam + fix.lam,
        )  # fmt: skip

    def _defect(self, found: Deviation, close: Array) -> tuple[Array, Array]:
        """Forces left (nt, nv), and the p (3, nt, nv) with its rates that closes the loops."""
        dynamics, base, Y = self.dynamics, self.between(self.base), self._poses(found)
        p = np.zeros((3, *self.v0.shape))
        V, A = self.v0 + found.v, self.a0 + found.a
        left, c = dynamics.residual(Y, V, A, base + found.lam, self.t)
        for s in spans(self.steps if dynamics.looped else 0):
            J, gamma = dynamics.close(Y[s]).J, dynamics.closure_bias(Y[s], V[s])
            v_gap, a_gap = ((J @ x[s][:, :, None])[:, :, 0] for x in (V, A))
            for k, gaps in enumerate(np.stack([c[s], v_gap, a_gap + gamma], 1), start=s.start):
                i, w = self.weights(k)
                p[:, k] = -gaps @ np.tensordot(w, close[i : i + 4], 1).T
        return left, p

    def _closers(self, B: Array) -> Array:
        """P (knots, nv, rows) with J P = 1, of least elastic (and some kinetic) energy."""
        s, slow = self.stack, (2 * np.pi / float(self.t[-1])) ** 2
        J = s["J"] @ B
        A_J = np.linalg.solve(B.T @ (s["K"] + slow * s["M"]) @ B, J.transpose(0, 2, 1))
        return np.asarray(B @ A_J @ np.linalg.pinv(J @ A_J, rcond=1e-10))

    # Runs ----------------------------------------------------------------------------------

    def _poses(self, found: Deviation) -> Array:
        """Shape (nt, nq)."""
        return Manifold(self.dynamics).retract(self.path.straight(self.system.n_eta), found.d)

    def linear(self, found: Deviation) -> Run:
        """The states and the linear torques of a deviation."""
        motors = self.system.motors
        torque = np.empty((self.steps, len(motors)))
        for k in range(self.steps):
            now = self.full.at(*self.weights(k))
            left = now.r + now.M @ found.a[k] + now.C @ found.v[k] + now.K @ found.d[k]
            torque[k] = (left - now.J.T @ found.lam[k])[motors]
        return self._run(found, torque)

    def nonlinear(self, found: Deviation) -> Run:
        """The states and the torques of the full equations."""
        lam, motors = self.between(self.base) + found.lam, self.system.motors
        run = self._run(found, np.empty((self.steps, len(motors))))
        run.torque[:] = self.dynamics.residual(run.y, run.v, run.a, lam, self.t).r[:, motors]
        return run

    def rigid(self) -> Run:
        """The undeformed motion and its torques."""
        none = np.zeros((self.steps, self.system.nv))
        still = Deviation(none, none, none, np.zeros((self.steps, self.system.closed.n)))
        s, motors = self.stack, self.system.motors
        return self._run(still, self.between(s["r"][:, motors]))

    def _run(self, found: Deviation, torque: Array) -> Run:
        v, a = self.v0 + found.v, self.a0 + found.a
        return Run(self.system, self.t, self._poses(found), v, a, found.lam, torque, {})


def _steps(mechanism: Mechanism, end: float) -> tuple[int, float]:
    """Steps of a march, a twentieth of the third mode's period each, and that mode in Hz."""
    found = modes(mechanism, count=9, preload="none").frequencies
    alive = found[found > 0]
    third = float(alive[min(2, len(alive) - 1)]) if len(alive) else 0.0
    return int(np.clip(np.ceil(_PERIOD * third * end), 4 * _KNOTS, _MOST)), third


def subspace(system: System, parts: Mapping[str, FlexiblePart]) -> Array:
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
                known[pair] = np.asarray(np.linalg.lstsq(large, small, rcond=None)[0])
            T = known[pair]
        part = np.zeros((system.nv, T.shape[1]))
        part[m:][slot.eta] = T
        columns.append(part)
    return np.hstack(columns)
