"""The equations of motion of one system, evaluated on preallocated arrays.

    r(y, v, a, lam) = X' (rnea(Q, X v, X a + Xdot v) - J_Q' lam) + K y + D v,     c(y) = 0

With no flexible link X = I and this is Pinocchio itself. Here r leaves out the motor torques: the
rows of motors give the torque that the motion needs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.mechanics import workspace
from pinflex.mechanics.closure_state import ClosureState
from pinflex.mechanics.expanded_state import ExpandedState
from pinflex.mechanics.loads import LoadState
from pinflex.mechanics.system import System


class Dynamics(ExpandedState):
    """A run's own workspace on a system (it owns the pin.Data; make one per run)."""

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self.data: pin.Data = workspace.acquire(self.model)
        self.damped = bool(np.any(system.D))
        self.sprung = len(system.springs.v_at) > 0
        self.closed = ClosureState(system.closed, self.model, self.data)
        self.looped = system.closed.n > 0
        self.loaded = system.loads.present
        self.loads = LoadState(system.loads, self.model, self.data)
        self.slides = self.flexible and len(system.closed.contacts) > 0
        bodies = [(slot.eta, slot.body.curvature) for slot in system.expansion.slots]
        self._curved = [(at, bent) for at, bent in bodies if bent is not None]
        self.stiffness = np.ascontiguousarray(system.K[self.n_rigid :, self.n_rigid :])
        self._loads = pin.StdVec_Force([pin.Force.Zero() for _ in range(self.model.njoints)])
        self.g = np.zeros(int(self.model.nv))

    def __del__(self) -> None:
        if hasattr(self, "data"):
            workspace.release(self.model, self.data)

    def place(self, y: Array) -> None:
        """Q = T(y) and the blocks of X = dQ/dy."""
        super().place(y)
        self.closed.Q = self.Q
        if self.flexible:
            self.closed.eta = y[self.nq_rigid :]

    # Forces --------------------------------------------------------------------------------

    def residual(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: float,
        control_force: Array | None = None,
    ) -> Array:
        """Forces that the motion (y, v, a) with multipliers lam leaves to the motors.

        r = X' (rnea - J_Q' lam) + K y + D v. Afterwards c and J are current.

        Args:
            y: [q; eta], shape (nq,). v, a: Shape (nv,). lam: Shape (rows,), N | N m.
            t: Time in s, at which the loads are taken.
            control_force: Generalised forces of a feedback, shape (nv,), N | N m; None: none.
        Returns:
            Generalised forces, shape (nv,): zero in the rows of everything that is not driven.
        """
        self.place(y)
        V, A = self.expand_motion(v, a)
        g = pin.rnea(self.model, self.data, self.Q, V, A)
        if self.looped or self.loaded:
            pin.computeJointJacobians(self.model, self.data, self.Q)
        if self.looped:
            self.closed.evaluate()
            g = g - self.closed.J.T @ lam
        if self.loaded:
            g = g - self.loads.generalized(V, t)
        self.g = g
        return self._add_elastic(self.project(g), y, v, lam, control_force)

    def _add_elastic(
        self, r: Array, y: Array, v: Array, lam: Array, control_force: Array | None
    ) -> Array:
        if self.flexible:
            r[self.n_rigid :] += self.elastic_forces(y[self.nq_rigid :])
        if self.damped:
            r += self.system.D @ v
        if self.sprung:
            s = self.system.springs
            r[s.v_at] += s.stiffness * (self.spring_angles(y) - s.rest)
        if self.slides:
            r[self.n_rigid :] -= self.closed.J_eta.T @ lam
        if control_force is not None:
            r -= control_force
        return r

    def elastic_forces(self, eta: Array) -> Array:
        """What deformed links resist with, for elastic coordinates (..., n_eta), the same shape."""
        force = eta @ self.stiffness
        for at, bent in self._curved:
            force[..., at] += bent.force(eta[..., at])
        return np.asarray(force)

    def elastic_energy(self, eta: Array) -> Array:
        """Strain energy of the links (J) for elastic coordinates (..., n_eta), shape (...)."""
        energy = 0.5 * np.sum(eta @ self.stiffness * eta, axis=-1)
        for at, bent in self._curved:
            energy = energy + bent.energy(eta[..., at])
        return np.asarray(energy)

    def spring_angles(self, y: Array) -> Array:
        """Positions (rad | m) of the joints with springs."""
        s = self.system.springs
        angle = y[s.q_at].copy()
        for k in np.flatnonzero(s.paired):
            angle[k] = np.arctan2(y[s.q_at[k] + 1], y[s.q_at[k]])
        return angle

    # Closures ------------------------------------------------------------------------------

    def close(self, y: Array) -> tuple[Array, Array]:
        """Closure residual c (rows,) and Jacobian J = J_Q X (rows, nv) at y."""
        self.place(y)
        pin.computeJointJacobians(self.model, self.data, self.Q)
        self.closed.evaluate()
        return self.closed.c, self.jacobian()

    def jacobian(self) -> Array:
        """J = J_Q X of the last evaluation."""
        J = self.times_map(self.closed.J)
        if self.slides:
            J[:, self.n_rigid :] += self.closed.J_eta
        return J

    def closure_bias(self, y: Array, v: Array) -> Array:
        """gamma in cdd = J a + gamma, shape (rows,)."""
        self.place(y)
        V, A = self.expand_motion(v, np.zeros_like(v))
        pin.computeJointJacobiansTimeVariation(self.model, self.data, self.Q, V)
        self.closed.evaluate()
        self.closed.eta_rate = v[self.n_rigid :]
        gamma = self.closed.bias(V)
        return gamma + self.closed.J @ A if self.flexible else gamma

    # Matrices ------------------------------------------------------------------------------

    def mass(self, y: Array) -> Array:
        """M = X' crba(Q) X, shape (nv, nv)."""
        self.place(y)
        return self.both_sides(pin.crba(self.model, self.data, self.Q))

    def tangent(
        self, y: Array, v: Array, a: Array, lam: Array, t: float
    ) -> tuple[Array, Array, Array]:
        """M, C, K: exact derivatives of the residual at t (s) by a, v and y, each (nv, nv)."""
        found = self._derivatives(y, v, a, lam, t, True)
        M, C, K = (self._weighted(found, a, t, weights, True) for weights in np.eye(3))
        return M, C, K

    def iteration_matrix(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: float,
        weights: Sequence[float],
        rates: bool = False,
    ) -> Array:
        """weights[0] dr/da + weights[1] dr/dv + weights[2] dr/dy for Newton, shape (nv, nv).

        The rates of the second-order rows are left out unless asked for: they are of the order of
        the step times the elastic rates, and Newton does not miss them in a smooth motion.

        Args:
            y: Shape (nq,). v, a: Shape (nv,). lam: Shape (rows,). t: Time in s.
            weights: Of M, C and K.
            rates: Exact, also where links accelerate wildly.
        """
        found = self._derivatives(y, v, a, lam, t, weights[2] != 0.0)
        return self._weighted(found, a, t, weights, rates)

    def _derivatives(
        self, y: Array, v: Array, a: Array, lam: Array, t: float, follow_closures: bool
    ) -> tuple[Array, Array, Array, Array | None]:
        """Pinocchio's dQ, dV, M on the expanded model, and what closure forces add to K."""
        self.place(y)
        V, A = self.expand_motion(v, a)
        follow = None
        if self.looped or self.loaded:
            pin.computeJointJacobians(self.model, self.data, self.Q)
        if self.looped:
            self.closed.evaluate()
            if follow_closures:
                follow = self.closed.force_tangent(lam, self.times_map)
        self._load(lam, V, t)
        dQ, dV, M = pin.computeRNEADerivatives(self.model, self.data, self.Q, V, A, self._loads)
        return dQ, dV, M, follow

    def _weighted(
        self,
        found: tuple[Array, Array, Array, Array | None],
        a: Array,
        t: float,
        weights: Sequence[float] | Array,
        rates: bool,
    ) -> Array:
        dQ, dV, M, follow = found
        w_a, w_v, w_y = (float(w) for w in weights)
        parts = [w * part for w, part in zip((w_a, w_v, w_y), (M, dV, dQ), strict=True) if w]
        D = parts[0]
        for part in parts[1:]:
            D += part
        S = self.both_sides(D)
        if rates and (w_v or w_y):
            self._add_rates(S, M, dV, a[self.n_rigid :], w_v, w_y)
        if w_y:
            self._add_geometric(S, w_y)
        if follow is not None and w_y:
            S -= w_y * follow
        if self.loaded and (w_v or w_y):
            S += self.loads.tangent(self.times_map, t, w_v, w_y)
        S += w_v * self.system.D + w_y * self.system.K
        s = self.system.springs
        S[s.v_at, s.v_at] += w_y * s.stiffness
        if w_y:
            self._add_bent(S, w_y)
        return S

    def _add_bent(self, S: Array, w_y: float) -> None:
        """Stiffness of links whose energy is of fourth order."""
        for at, bent in self._curved:
            rows = slice(self.n_rigid + at.start, self.n_rigid + at.stop)
            S[rows, rows] += w_y * bent.stiffness(self.closed.eta[at])

    def _add_rates(
        self, S: Array, M: Array, dV: Array, a_eta: Array, w_v: float, w_y: float
    ) -> None:
        """What the changing second-order rows bring into C and K."""
        if not self.flexible:
            return
        extra = np.zeros((int(self.model.nv), self.system.n_eta))
        for one in self._maps:
            if not one.curved:
                continue
            rows = slice(0, one.curved)
            inertial = 2.0 * w_v * one.rate + w_y * one.bend(a_eta[one.block.eta])
            self.block_product(M, one, inertial, rows, extra, add=True)
            if w_y:
                self.block_product(dV, one, w_y * one.rate, rows, extra, add=True)
        S[:, self.n_rigid :] += self.from_left(extra)

    def _add_geometric(self, S: Array, w_y: float) -> None:
        """Geometric stiffness: sum of G_k weighted by the force g_k on each curved row."""
        if not self.flexible:
            return
        m, g = self.n_rigid, self._row_forces()
        for one in self._maps:
            if not one.curved:
                continue
            n = one.shape[1]
            weights = g[one.block.rows[:, : one.curved]]
            stiff = np.matmul(
                weights[:, None, :], one.block.G.reshape(len(weights), one.curved, n * n)
            ).reshape(-1, n, n)
            for k, part in enumerate(stiff):
                start = m + one.block.eta.start + k * n
                S[start : start + n, start : start + n] += w_y * part

    def _row_forces(self) -> Array:
        """Expanded forces rnea - J_Q' lam of the last tangent (Pinocchio keeps them in tau)."""
        return np.array(self.data.tau)

    def _load(self, lam: Array, V: Array, t: float) -> None:
        """Closure and load wrenches as external forces in the frames of the joints they act on."""
        if not (self.looped or self.loaded):
            return
        total: dict[int, Array] = {}
        if self.looped:
            total = self.closed.body_wrenches(lam)
        if self.loaded:
            for body, wrench in self.loads.wrenches(V, t).items():
                total[body] = total.get(body, np.zeros(6)) + wrench
        for body, wrench in total.items():
            self._loads[body] = self.data.oMi[body].actInv(pin.Force(wrench))

    def joint_forces(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: float,
        control_force: Array | None = None,
    ) -> Array:
        """r as `residual`, and data.f with closure forces and loads in it (for reactions)."""
        self.place(y)
        V, A = self.expand_motion(v, a)
        if self.looped or self.loaded:
            pin.computeJointJacobians(self.model, self.data, self.Q)
        if self.looped:
            self.closed.evaluate()
        self._load(lam, V, t)
        self.g = np.array(pin.rnea(self.model, self.data, self.Q, V, A, self._loads))
        coupled = self.system.closed.coupled
        self.g -= lam[coupled.rows] @ coupled.J if len(coupled.rows) else 0.0
        return self._add_elastic(self.project(self.g), y, v, lam, control_force)

    # Energies ------------------------------------------------------------------------------

    def energies(self, y: Array, v: Array, t: float) -> tuple[float, float, float, float]:
        """Kinetic, gravity, elastic, and spring energy (with that of dead loads at t in s), J."""
        self.place(y)
        V, _ = self.expand_motion(v, np.zeros_like(v))
        kinetic = 0.5 * float(V @ pin.crba(self.model, self.data, self.Q) @ V)
        gravity = float(pin.computePotentialEnergy(self.model, self.data, self.Q))
        eta = y[self.nq_rigid :]
        elastic = float(self.elastic_energy(eta))
        s = self.system.springs
        stretch = self.spring_angles(y) - s.rest
        spring = 0.5 * float(stretch @ (s.stiffness * stretch))
        if self.loaded:
            pin.computeJointJacobians(self.model, self.data, self.Q)
            spring += self.loads.energy(t)
        return kinetic, gravity, elastic, spring

    def losses(self, v: Array) -> float:
        """Power that damping takes in the current state, W."""
        power = float(v @ self.system.D @ v) if self.damped else 0.0
        if self.loaded:
            power += self.loads.dissipation(self._V if self.flexible else v)
        return power
