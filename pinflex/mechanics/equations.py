"""The equations of motion of one system, at one state or at many.

    r(y, v, a, lam) = X' (rnea(Q, X v, X a + Xdot v) - J_Q' lam) + K y + D v,     c(y) = 0

With no flexible link X = I and this is Pinocchio itself. Here r leaves out the motor torques: the
rows of motors give the torque that the motion needs.

Every call is a value: states and time go in, arrays that nothing overwrites come out, by name.
States are time-first, y (n, nq); one state y (nq,) is a batch of one, and answers lose the axis.
Pinocchio takes the states one after the other; everything around it runs on stacked arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.added_mass import AddedInertia
from pinflex.mechanics.closure_state import ClosureState
from pinflex.mechanics.compiled import Compiled, serves
from pinflex.mechanics.coordinate_map import Configuration
from pinflex.mechanics.derivatives import Derivatives
from pinflex.mechanics.evaluated import Energies, IterationMatrix, JointForces, Residual, Tangent
from pinflex.mechanics.geometry import TOGETHER, Geometry, spans
from pinflex.mechanics.loads import LoadRows
from pinflex.mechanics.poses import as_matrices, local_wrench
from pinflex.mechanics.strain import Strain
from pinflex.mechanics.subtrees import Subtrees
from pinflex.mechanics.system import System
from pinflex.mechanics.whole import Whole


class Equations(Geometry):
    """The equations of a system (make one per run).

    Attributes:
        strain: Elastic potential of the links.
        added: Inertia that differs with the direction, or None.
        damped, rubbed, sprung, loaded: Whether there are dampers, dry friction, springs, loads.
    """

    def __init__(self, system: System, often: bool = True, marched: bool = False) -> None:
        """`marched`: in steps, where the kernel serves rigid systems too."""
        super().__init__(system, often)
        self._marched = marched
        self.damped, self.rubbed = bool(np.any(system.D)), system.friction.present
        self.sprung, self.loaded = len(system.springs.v_at) > 0, system.loads.present
        self.strain = Strain(system)
        self._loads = LoadRows(system.loads, self.model)
        added = system.added  # and the joints that it, closures and loads act on:
        self._acted = sorted({*system.closed.joints, *self._loads.support, *added.joints})
        self.added = AddedInertia(added, self.model, self.data) if added.joints else None

    @cached_property
    def compiled(self) -> Compiled | None:
        """The compiled equations, where they serve."""
        return Compiled(self.system) if self.on_kernel else None

    @property
    def on_kernel(self) -> bool:
        """Whether the compiled equations serve."""
        return bool(self._often or self.system.parts) and serves(self.system, self._marched)

    @property
    def _coupled(self) -> Whole | Subtrees:
        """Pinocchio where mass and derivatives couple all rows of a child of the base."""
        return self._whole if any(part.cut for part in self.system.parts) else self.pinocchio

    def rnea(self, Q: Array, V: Array, A: Array) -> Array:
        """Forces of inertia and weight, shape (n, nV).

        Args:
            Q: Expanded configurations, shape (n, nQ). V, A: Their rates, shape (n, nV).
        """
        if (added := self.added) is None:
            return self.pinocchio.rnea(Q, V, A)
        return np.array([added.rnea(*at) for at in zip(Q, V, A, strict=True)]).reshape(-1, self._nV)

    def residual(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: float | Array,
        control_force: Array | None = None,
    ) -> Residual:
        """Forces that the motion (y, v, a) with multipliers lam leaves to the motors.

        r = X' (rnea - J_Q' lam) + K y + D v, zero in the rows of everything that is not driven.

        Args:
            y: [q; eta], shape (nq,) or (n, nq). v, a: Shape (nv,) or (n, nv).
            lam: Shape (rows,) or (n, rows), N | N m.
            t: Time in s, at which the loads are taken; shape (n,) for n states.
            control_force: Generalised forces of a feedback, as v, N | N m; None: none.
        """
        if y.ndim == 1:
            r, c = self._residuals(y[None], v[None], a[None], lam[None], (t,))
            if control_force is not None:
                r -= control_force
            return Residual(r[0], c[0])
        times = np.full(len(y), t) if np.ndim(t) == 0 else np.asarray(t)
        if 0 < len(y) <= TOGETHER:
            r, c = self._residuals(y, v, a, lam, times)
        else:
            r, c = np.empty((len(y), self.system.nv)), np.empty((len(y), self.system.closed.n))
            for s in spans(len(y)):
                r[s], c[s] = self._residuals(y[s], v[s], a[s], lam[s], times[s])
        return Residual(r if control_force is None else r - control_force, c)

    def _residuals(
        self, Y: Array, V: Array, A: Array, lam: Array, t: Array | tuple[float | Array, ...]
    ) -> tuple[Array, Array]:
        if (compiled := self.compiled) is not None:
            return compiled.residual(Y, V, A, lam, t)
        here, closed = self.map.at(Y, V, A, True), None
        g = self.rnea(here.Q, here.V, here.A)
        if self.looped or self.loaded:
            poses, J, _ = self._placed(here)
        if self.looped:
            closed = self._closed(poses, here, Y)
            g -= closed.forces(lam, J)
        c = np.zeros((len(Y), 0)) if closed is None else closed.c
        if self.loaded:
            for k, load in enumerate(map(self._loads.at, poses, J)):
                g[k] -= load.generalized(here.V[k], float(t[k]))
        return self._projected(here, g, Y, V, closed, lam), c

    def _projected(
        self,
        here: Configuration,
        g: Array,
        Y: Array,
        V: Array,
        closed: ClosureState | None,
        lam: Array,
    ) -> Array:
        """X' g with the forces of stiffness, damping, springs and sleeves, shape (n, nv)."""
        r, m = here.project(g), self.n_rigid
        if self.flexible:
            r[:, m:] += self.strain.force(Y[:, self.nq_rigid :])
        if self.damped:
            r += V @ self.system.D
        if self.rubbed:
            r[:, self.system.friction.rows] += self.system.friction.force(V)
        if self.sprung:
            s = self.system.springs
            r[:, s.v_at] += s.stiffness * (s.angles(Y) - s.rest)
        if self.slides and closed is not None:
            r[:, m:] -= (lam[:, None] @ closed.by_eta(self.system.n_eta))[:, 0]
        return r

    # Matrices, at one state ----------------------------------------------------------------

    def mass(self, y: Array) -> Array:
        """M = X' crba(Q) X, shape (nv, nv)."""
        if self.system.parts and self.compiled is not None:
            still, lam = np.zeros(self.system.nv), np.zeros(self.system.closed.n)
            return self.compiled.tangent(y, still, still, lam, 0.0, False)[0]
        here = self.map.at(y[None], passing=True)
        M = self._coupled.mass(here.Q[0])
        return here.both_sides(M if self.added is None else M + self.added.mass(here.Q[0]))

    def tangent(self, y: Array, v: Array, a: Array, lam: Array, t: float) -> Tangent:
        """Exact derivatives by y, v and a, and the closure Jacobian.

        Args:
            y: Shape (nq,). v, a: Shape (nv,). lam: Shape (rows,), N | N m. t: Time in s.
        """
        if (compiled := self.compiled) is not None:
            return Tangent(*compiled.tangent(y, v, a, lam, t))
        found, J = self._derivatives(y, v, a, lam, t, True)
        return Tangent(*found.each, J)

    def iteration_matrix(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: float,
        weights: Sequence[float],
        rates: bool = False,
    ) -> IterationMatrix:
        """weights[0] dr/da + weights[1] dr/dv + weights[2] dr/dy for Newton.

        The rates of the second-order rows are left out unless asked for: they are of the order of
        the step times the elastic rates, and Newton does not miss them in a smooth motion.

        Args:
            y: Shape (nq,). v, a: Shape (nv,). lam: Shape (rows,). t: Time in s.
            weights: Of M, C and K.
            rates: Exact, also where links accelerate wildly.
        """
        if (compiled := self.compiled) is not None:
            *parts, J = compiled.tangent(y, v, a, lam, t, rates)
            S = sum(w * part for w, part in zip(weights, parts, strict=True) if w)
            return IterationMatrix(np.asarray(S), J)
        found, J = self._derivatives(y, v, a, lam, t, weights[2] != 0.0)
        return IterationMatrix(found.weighted([weights], rates)[0], J)

    def _derivatives(
        self, y: Array, v: Array, a: Array, lam: Array, t: float, follow_closures: bool
    ) -> tuple[Derivatives, Array]:
        """Derivatives of the expanded model with what closures and loads add, and J (rows, nv)."""
        Y = y[None]
        here = self.map.at(Y, v[None], a[None], True)
        follow, load, J_c = None, None, np.zeros((0, self.system.nv))
        acting = np.zeros((len(self._acted), 6))
        if self._acted:
            poses, J, _ = self._placed(here)
            closed = self._closed(poses, here, Y) if self.looped else None
            if closed is not None:
                J_c = self._jacobian(here, closed, J)[0]
                if follow_closures:
                    follow = closed.force_tangent(lam, J[0], here.times_map)
            if self.loaded:
                load = self._loads.at(poses[0], J[0])
            acting = self._wrenches(here, poses, J, closed, lam[None], (t,))[0]
        Q, V, A = here.Q[0], here.V[0], here.A[0]
        dQ, dV, M, tau = self._coupled.derivatives(Q, V, A, self._acted, acting)
        if self.added is not None:
            dQ, dV, M = self.added.add_derivatives(dQ, dV, M, Q, V, A)
        found = Derivatives(
            self.system, here, dQ, dV, M, tau, v, a[self.n_rigid :],
            self.strain.bent(y[self.nq_rigid :]),
            follow, load, t,
        )  # fmt: skip
        return found, J_c

    def joint_forces(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: Array,
        joints: Sequence[int],
        control_force: Array | None = None,
    ) -> JointForces:
        """Forces of joints, loops and sleeves at n states.

        Args:
            y: Shape (n, nq). v, a: Shape (n, nv). lam: Shape (n, rows). t: Times in s, (n,).
            joints: Numbers of the joints whose forces are wanted.
            control_force: Generalised forces of a feedback, shape (n, nv), N | N m; None: none.
        """
        if (compiled := self.compiled) is not None:
            every = compiled.joint_forces(y, v, a, lam, t, joints)
        else:
            found = [
                self._joint_forces(y[s], v[s], a[s], lam[s], t[s], joints) for s in spans(len(y))
            ]
            every = JointForces(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
        return every if control_force is None else every._replace(r=every.r - control_force)

    def _joint_forces(
        self, Y: Array, V: Array, A: Array, lam: Array, t: Array, joints: Sequence[int]
    ) -> JointForces:
        here, n, closed = self.map.at(Y, V, A, True), len(Y), None
        total = np.zeros((n, len(self._acted), 6))
        if self._acted:
            poses, J, _ = self._placed(here)
            closed = self._closed(poses, here, Y) if self.looped else None
            total = self._wrenches(here, poses, J, closed, lam, t)
        g, f = self.pinocchio.forces(here.Q, here.V, here.A, self._acted, total, joints)
        coupled = self.system.closed.coupled
        if len(coupled.rows):  # torques in joints, no wrenches on bodies
            g -= lam[:, coupled.rows] @ coupled.J
        r = self._projected(here, g, Y, V, closed, lam)
        if closed is None:
            none = np.zeros((n, 0))
            return JointForces(r, none, g, f, none.reshape(n, 0, 6), none.reshape(n, 0, 3, 8))
        return JointForces(r, closed.c, g, f, closed.loop_wrenches(lam), closed.sleeves(lam))

    def _wrenches(
        self,
        here: Configuration,
        poses: Array,
        J: Array,
        closed: ClosureState | None,
        lam: Array,
        t: Array | tuple[float, ...],
    ) -> Array:
        """Wrenches of closures and loads in the frames of the joints acted on, (n, joints, 6)."""
        total = np.zeros((len(poses), len(self._acted), 6))
        if closed is not None:
            total += closed.on_joints(lam, self._acted)
        if self.loaded:
            for k, whole in enumerate(total):
                load = self._loads.at(poses[k], J[k])
                for joint, wrench in load.wrenches(here.V[k], float(t[k])).items():
                    whole[self._acted.index(joint)] += wrench
        local = local_wrench(poses[:, self._acted], total)
        if self.added is not None:
            self.added.take(local, self._acted, here)
        return local

    def motions(self, y: Array, v: Array, a: Array, joints: Sequence[int]) -> tuple[Array, Array]:
        """Poses of joints in the world (k, n, 3, 4), and their spatial motion (k, n, 2, 6).

        Args:
            y: Shape (n, nq). v, a: Shape (n, nv).
            joints: The k joints, whose velocity and acceleration are in their own frames.
        """
        if (compiled := self.compiled) is not None:
            return compiled.motions(y, v, a, joints)
        poses, rates = np.empty((len(joints), len(y), 3, 4)), np.empty((len(joints), len(y), 2, 6))
        for s in spans(len(y)):
            at = self.at(y[s], v[s], a[s])
            placed, moved = self.pinocchio.motions(at.Q, at.V, at.A, joints)
            poses[:, s] = as_matrices(placed[:, joints]).swapaxes(0, 1)
            rates[:, s] = moved.swapaxes(0, 1)
        return poses, rates

    def energies(self, y: Array, v: Array, t: float | Array) -> Energies:
        """Kinetic energy, and potentials of weight, links, and of springs and loads, J.

        Args:
            y: Shape (nq,) or (n, nq). v: Shape (nv,) or (n, nv). t: Time in s, one or shape (n,).
        """
        Y, V = np.atleast_2d(y), np.atleast_2d(v)
        found, times = np.zeros((4, len(Y))), np.broadcast_to(t, len(Y))
        if (compiled := self.compiled) is not None:
            found = np.array(compiled.energies(Y, V, times))
        else:
            for s in spans(len(Y)):
                self._energies(found[:, s], Y[s], V[s], times[s])
        return Energies(*(found[:, 0] if y.ndim == 1 else found))

    def _energies(self, found: Array, Y: Array, V: Array, t: Array) -> None:
        here = self.map.at(Y, V, np.zeros_like(V), True)
        found[:2] = self.pinocchio.energies(here.Q, here.V)
        if self.added is not None:
            found[0] += [self.added.kinetic(*at) for at in zip(here.Q, here.V, strict=True)]
        found[2] = self.strain.energy(Y[:, self.nq_rigid :])
        if self.sprung:
            s = self.system.springs
            found[3] = 0.5 * (s.angles(Y) - s.rest) ** 2 @ s.stiffness
        if self.loaded:
            poses, J, _ = self._placed(here)
            found[3] += [self._loads.at(*at).energy(float(when))
                         for *at, when in zip(poses, J, t, strict=True)]  # fmt: skip

    def losses(self, y: Array, v: Array) -> Array:
        """Power that damping, friction and dampers between frames take, shape (n,), W.

        Args:
            y: Shape (n, nq). v: Shape (n, nv).
        """
        power = np.zeros(len(y))
        if self.damped or self.rubbed:
            power += self.system.dissipation(v)
        if any(spring.damper for spring, _, _ in self.system.loads.springs):
            if (compiled := self.compiled) is not None:
                return compiled.evaluator.losses(y, v)
            at = self.kinematics(y, v)
            each = zip(at.poses, at.J, at.here.V, strict=True)
            power += [self._loads.at(poses, J).dissipation(V) for poses, J, V in each]
        return power

    def structural_stiffness(self, y: Array) -> Array:
        """K of links and springs alone, without the stiffness that loads bring, shape (nv, nv).

        Springs between frames resist along their line at the pose y; what their pull adds across
        it is a load's.
        """
        K = self.system.K.copy()
        springs = self.system.springs
        K[springs.v_at, springs.v_at] += springs.stiffness
        if self.system.loads.springs:
            at = self.kinematics(y)
            K += self._loads.at(at.poses[0], at.J[0]).stiffness(at.here.times_map)
        return K
