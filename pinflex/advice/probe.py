"""A cheap look at the flexible motion: linear vibration on interpolated matrices, and its defect.

    M(t) dd + C(t) d + K(t) d - J(t)' lam = -r(t),     J(t) d = 0

as level ked, with matrices interpolated between instants that resolve the nominal motion. Put into
the full equations, the answer leaves a defect; the same march with the defect as load is one step
of Newton's method on the whole motion, so its size is the error of ked. In a subspace of shapes it
is what fewer modes would give.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.actuation.nominal import Nominal, nominal
from pinflex.advice.subspace import Subspace, pseudo_inverse
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.integrators.run import Run
from pinflex.levels.linear_march import Marched, Room, forces_along
from pinflex.levels.linearised import LinearPath, full_path
from pinflex.levels.modes import modes
from pinflex.mechanics.closure_motion import closure_motion
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism

_PARTS = 80  # of the time, each with a whole number of steps
_CLOSE = 1e-5  # of the largest entry of a matrix: what interpolation may miss
_JUMP = 0.1  # of the largest acceleration between two steps: they are too long for the motion
_PERIOD = 20  # steps for each period of the third mode: amplitudes within 1 %
_BOUND = 1e6  # m or rad: a deviation beyond it grows without bound
_MOST = 640  # steps: more would cost as much as the run that is to be saved


@dataclass(frozen=True)
class Deviation:
    """d, v, a (nt, nv) from the nominal motion and the multipliers (nt, rows) beyond the rigid."""

    d: Array
    v: Array
    a: Array
    lam: Array

    def moved(self, d: Array, v: Array, a: Array) -> Deviation:
        """With so much more of d, v and a (nt, nv)."""
        return Deviation(self.d + d, self.v + v, self.a + a, self.lam)

    def plus(self, other: Deviation) -> Deviation:
        """The sum of two."""
        moved = self.moved(other.d, other.v, other.a)
        return Deviation(moved.d, moved.v, moved.a, self.lam + other.lam)


class Probe:
    """One scene: its nominal motion, the linear system along it, and marches of it."""

    def __init__(
        self,
        mechanism: Mechanism,
        motion: Motion,
        end: float,
        static: bool,
        steps: int | None = None,
        like: Probe | None = None,
    ) -> None:
        """Its nominal motion, and the system along it.

        Args:
            mechanism: Mechanism.
            motion: What it is to do.
            end: Last time [s].
            static: Whether it starts in equilibrium.
            steps: Of the marches; None: by the third mode of the mechanism.
            like: A probe of the same motion and rigid mechanism, that has marched: what they have
                in common is taken from there.
        """
        self.mechanism, self.system, self.static = mechanism, mechanism.flexible, static
        self.end, self.third, self._like = end, 0.0, like
        if steps is None:
            steps, self.third = _steps(mechanism, end)
            self.path = self._nominal(motion, _instants(end, steps))
            if _jumps(self.path.a):
                self.path = self._nominal(motion, _instants(end, _MOST))
        else:
            self.path = self._nominal(motion, _instants(end, steps))
        self.t, self._like = self.path.t, None
        self.h = float(self.t[1])
        self.dynamics = Equations(self.system)
        line = LinearPath(mechanism, self.path, dynamics=self.dynamics)
        self.v0, self.a0 = line.v, line.a
        self.full = full_path(line, mechanism, motion, _CLOSE)
        self._parts = self.full.parts
        self._room: Room = like._room if like is not None else Room()
        self._last: tuple[Array, Subspace] | None = None
        self.rough = self.full.missed

    def _nominal(self, motion: Motion, t: Array) -> Nominal:
        if self._like is not None and np.array_equal(self._like.t, t):
            return self._like.path
        return nominal(self.mechanism, motion, t)

    @property
    def steps(self) -> int:
        """Number of instants of a march."""
        return len(self.t)

    @cached_property
    def base(self) -> Array:
        """Multipliers of the rigid motion at every step, shape (nt, rows)."""
        return self._parts[5].along(self.full.grid)

    # Marches -------------------------------------------------------------------------------

    def march(self, shapes: Array | None = None) -> Deviation:
        """The linear deviation, in all shapes or in the columns of `shapes` (nv, k).

        Raises:
            ConvergenceError: It grows without bound.
        """
        within = self._within(shapes)
        return self._deviation(within, within.march(within.load))

    def corrected(self, found: Deviation, shapes: Array | None = None) -> Deviation:
        """A deviation and the answer to its defect in the full equations.

        The closures are off by c, with exact rates; a part p of the answer closes them, and the
        march finds what the forces then left ask for.

        Args:
            found: From `march`, or from here. shapes: Those in which it was found.
        """
        within = self._within(shapes)
        if self.dynamics.looped:
            found = found.moved(*within.closing(self._gaps(found), self._straight))
        left = self.dynamics.residual(*self._state(found), self.t).r
        return found.plus(self._deviation(within, within.march(left @ within.B)))

    @cached_property
    def _straight(self) -> Array | None:
        """P with J P = 1 that moves rigid joints alone, (nt, passive, rows); None: they cannot.

        Joints that are not driven close all loops of most mechanisms, whatever links do.
        """
        J, passive = self._parts[4], self.mechanism.rigid.free
        P, rank = pseudo_inverse(J.picked(np.arange(J.shape[0]), passive).whole())
        if not self.dynamics.looped or np.any(rank < len(self._whole.rows)):
            return None
        return self.full.grid.between(P)

    def _within(self, shapes: Array | None) -> Subspace:
        """The system in some shapes: that in all, and the last one, are kept."""
        if shapes is None:
            return self._whole
        if self._last is None or self._last[0] is not shapes:
            self._last = shapes, self._subspace(shapes)
        return self._last[1]

    @cached_property
    def _whole(self) -> Subspace:
        return self._subspace(np.eye(self.system.nv)[:, self.system.free])

    def _subspace(self, B: Array) -> Subspace:
        return Subspace(self.full.grid, self._parts, B, self.h, self.static, self._room)

    def _deviation(self, within: Subspace, found: Marched) -> Deviation:
        with np.errstate(invalid="ignore"):
            far = ~(np.max(np.abs(found.d), axis=1, initial=0.0) <= _BOUND)
        if np.any(far):
            k = int(np.argmax(far))
            raise ConvergenceError(
                f"{self.mechanism.name}: t = {self.t[k]:.6g} s: the linear vibration grows "
                "without bound.",
                time=float(self.t[k]),
            )
        lam = np.zeros((self.steps, self.system.closed.n))
        lam[:, within.rows] = found.lam
        d, v, a = (x @ within.B.T for x in found[:3])
        return Deviation(d, v, a, lam)

    def _gaps(self, found: Deviation) -> Array:
        """What closures are open by, with rates, shape (3, nt, rows)."""
        return closure_motion(self.dynamics, *self._state(found)[:3])

    def _state(self, found: Deviation) -> tuple[Array, Array, Array, Array]:
        """y, v, a and multipliers."""
        lam = self.base + found.lam
        return self._poses(found), self.v0 + found.v, self.a0 + found.a, lam

    # Runs ----------------------------------------------------------------------------------

    def _poses(self, found: Deviation) -> Array:
        """Shape (nt, nq)."""
        return Manifold(self.dynamics).retract(self.path.straight(self.system.n_eta), found.d)

    def linear(self, found: Deviation) -> Run:
        """The states and the linear torques of a deviation."""
        motors = self.system.motors
        M, C, K, r, J, _ = self._parts
        every, rows = (np.arange(n) for n in J.shape[::-1])
        squares = [x.picked(motors, every) for x in (M, C, K)]
        of_motors = *squares, r.picked(motors), J.picked(rows, motors)
        states = Marched(found.d, found.v, found.a, found.lam)
        return self._run(found, forces_along(self.full.grid, of_motors, states))

    def nonlinear(self, found: Deviation) -> Run:
        """The states and the torques of the full equations."""
        torque = self.dynamics.residual(*self._state(found), self.t).r[:, self.system.motors]
        return self._run(found, torque)

    def rigid(self) -> Run:
        """The undeformed motion and its torques."""
        none = np.zeros((self.steps, self.system.nv))
        still = Deviation(none, none, none, np.zeros((self.steps, self.system.closed.n)))
        torque = self._parts[3].picked(self.system.motors)
        return self._run(still, torque.along(self.full.grid))

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
