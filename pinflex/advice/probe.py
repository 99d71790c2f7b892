"""A cheap look at the flexible motion: linear vibration on interpolated matrices, and its defect.

    M(t) dd + C(t) d + K(t) d - J(t)' lam = -r(t),     J(t) d = 0

as level ked, with matrices interpolated between instants that resolve the nominal motion. Put into
the full equations, the answer leaves a defect; the same march with the defect as load is one step
of Newton's method on the whole motion, so its size is the error of ked. In a subspace of shapes it
is what fewer modes would give.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.integrators.linear import Instant, alpha
from pinflex.integrators.run import Run
from pinflex.integrators.schemes import generalized_alpha
from pinflex.levels.linearised import LinearPath, full_path, stacked_path
from pinflex.levels.modes import modes
from pinflex.linalg import independent_rows, saddle
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.geometry import spans
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.parts import FlexiblePart
from pinflex.mechanics.system import System

_PARTS = 80  # of the time, each with a whole number of steps
_CLOSE = 1e-5  # of the largest entry of a matrix: what interpolation may miss
_JUMP = 0.1  # of the largest acceleration between two steps: they are too long for the motion
_PERIOD = 20  # steps for each period of the third mode: amplitudes within 1 %
_MOST = 640  # steps: more would cost as much as the run that is to be saved


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
        self.t = _instants(end, wanted if steps is None else steps)
        self.path = nominal(mechanism, motion, self.t)
        if steps is None and _jumps(self.path.a):
            self.t = _instants(end, _MOST)
            self.path = nominal(mechanism, motion, self.t)
        self.h = float(self.t[1])
        self.dynamics = Equations(self.system)
        line = LinearPath(mechanism, self.path, dynamics=self.dynamics)
        self.v0, self.a0 = line.v, line.a
        self.full = full_path(line, mechanism, motion, _CLOSE)
        self._parts = self.full.parts()
        self.rough = self.full.missed

    @property
    def steps(self) -> int:
        """Number of instants of a march."""
        return len(self.t)

    @property
    def base(self) -> Array:
        """Multipliers of the rigid motion at every step, shape (nt, rows)."""
        return self.full.grid.between(self._parts[5])

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
        (M, C, K, r, J, _), Bt = self._parts, B.T
        J = J @ B
        rows = np.sort(independent_rows(J[0], 1e-9))
        none = np.zeros((len(r), 0))
        system = stacked_path(
            self.full.grid, (Bt @ M @ B, Bt @ C @ B, Bt @ K @ B, r @ B, J[:, rows], none)
        )
        reduced = None if load is None else load @ B

        def at(k: int) -> Instant:
            now = system.at(k).free
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
            now = self.full.at(k).free
            load[k] += now.K @ p[0, k] + now.C @ p[1, k] + now.M @ p[2, k]
        fix = self._march(B, load)
        return Deviation(
            found.d + fix.d + p[0], found.v + fix.v + p[1], found.a + fix.a + p[2],
            found.lam + fix.lam,
        )  # fmt: skip

    def _defect(self, found: Deviation, close: Array) -> tuple[Array, Array]:
        """Forces left (nt, nv), and the p (3, nt, nv) with its rates that closes the loops."""
        dynamics, base, Y = self.dynamics, self.base, self._poses(found)
        p = np.zeros((3, *self.v0.shape))
        V, A = self.v0 + found.v, self.a0 + found.a
        left, c = dynamics.residual(Y, V, A, base + found.lam, self.t)
        for s in spans(self.steps if dynamics.looped else 0):
            J, gamma = dynamics.close(Y[s]).J, dynamics.closure_bias(Y[s], V[s])
            v_gap, a_gap = ((J @ x[s][:, :, None])[:, :, 0] for x in (V, A))
            gaps = np.stack([c[s], v_gap, a_gap + gamma])[..., None]
            p[:, s] = -(close[s] @ gaps)[..., 0]
        return left, p

    def _closers(self, B: Array) -> Array:
        """P (nt, nv, rows) with J P = 1, of least elastic (and some kinetic) energy."""
        (M, _, K, _, J, _), slow = self._parts, (2 * np.pi / float(self.t[-1])) ** 2
        J = J @ B
        A_J = np.linalg.solve(B.T @ (K + slow * M) @ B, J.transpose(0, 2, 1))
        P = B @ A_J @ np.linalg.pinv(J @ A_J, rcond=1e-10)
        return self.full.grid.between(P)

    # Runs ----------------------------------------------------------------------------------

    def _poses(self, found: Deviation) -> Array:
        """Shape (nt, nq)."""
        return Manifold(self.dynamics).retract(self.path.straight(self.system.n_eta), found.d)

    def linear(self, found: Deviation) -> Run:
        """The states and the linear torques of a deviation."""
        motors = self.system.motors
        torque = np.empty((self.steps, len(motors)))
        for k in range(self.steps):
            now = self.full.at(k).free
            left = now.r + now.M @ found.a[k] + now.C @ found.v[k] + now.K @ found.d[k]
            torque[k] = (left - now.J.T @ found.lam[k])[motors]
        return self._run(found, torque)

    def nonlinear(self, found: Deviation) -> Run:
        """The states and the torques of the full equations."""
        lam, motors = self.base + found.lam, self.system.motors
        run = self._run(found, np.empty((self.steps, len(motors))))
        run.torque[:] = self.dynamics.residual(run.y, run.v, run.a, lam, self.t).r[:, motors]
        return run

    def rigid(self) -> Run:
        """The undeformed motion and its torques."""
        none = np.zeros((self.steps, self.system.nv))
        still = Deviation(none, none, none, np.zeros((self.steps, self.system.closed.n)))
        torque = self._parts[3][:, self.system.motors]
        return self._run(still, self.full.grid.between(torque))

    def _run(self, found: Deviation, torque: Array) -> Run:
        v, a = self.v0 + found.v, self.a0 + found.a
        return Run(self.system, self.t, self._poses(found), v, a, found.lam, torque, {})


def _instants(end: float, steps: int) -> Array:
    return np.linspace(0.0, end, _PARTS * -(-steps // _PARTS) + 1)


def _jumps(a: Array) -> bool:
    """Whether accelerations (nt, nv) at equal steps are off the line through their neighbours."""
    off = np.max(np.abs(a[1:-1] - 0.5 * (a[:-2] + a[2:])), initial=0.0)
    return bool(off > _JUMP * np.max(np.abs(a), initial=0.0))


def _steps(mechanism: Mechanism, end: float) -> tuple[int, float]:
    """Steps of a march, a twentieth of the third mode's period each, and that mode in Hz."""
    found = modes(mechanism, count=9, preload="none").frequencies
    alive = found[found > 0]
    third = float(alive[min(2, len(alive) - 1)]) if len(alive) else 0.0
    return int(np.clip(np.ceil(_PERIOD * third * end), 4 * _PARTS, _MOST)), third


def subspace(system: System, parts: Mapping[str, FlexiblePart]) -> Array:
    """Shapes of other bodies as columns in the coordinates of a system, shape (nv, k).

    Free rigid coordinates and elastic drives stay; a link that is not in `parts` is rigid. The
    functions of a smaller basis are combinations of those of a larger one: found by least squares
    at sections.

    Args:
        system: A flexible system.
        parts: Other bodies for its links, by name.
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
