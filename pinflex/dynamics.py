"""The equations of motion of one system, evaluated on preallocated arrays.

    r(y, v, a, lam) = X' (rnea(Q, X v, X a + Xdot v) - J_Q' lam) + K y + D v,     c(y) = 0

With no flexible link X = I and this is Pinocchio itself. Here r leaves out the motor torques: the
rows of motors give the torque that the motion needs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.closure import Closures, ClosureState
from pinflex.expansion import Expansion


@dataclass(frozen=True)
class Springs:
    """Springs on single-axis joints: torque -k (q - rest).

    Attributes:
        v_at: Velocity rows. q_at: Position of the coordinate in q (its cosine if it has two).
        paired: True where q holds (cos, sin). stiffness: N m/rad | N/m. rest: rad | m.
    """

    v_at: IntArray
    q_at: IntArray
    paired: IntArray
    stiffness: Array
    rest: Array


@dataclass(frozen=True)
class System:
    """A rigid or flexible mechanism as equations: model, map, closures, stiffness, damping.

    Attributes:
        rigid: Pinocchio model whose coordinates q and v are kept.
        expansion: Expanded model and map.
        closed: Independent closure rows.
        K, D: Stiffness and damping, shape (nv, nv), N m/rad | N/m and N m s/rad | N s/m.
        springs: Joint springs (their stiffness is not in K).
        motors: Velocity rows of the actuated joints.
    """

    rigid: pin.Model
    expansion: Expansion
    closed: Closures
    K: Array
    D: Array
    springs: Springs
    motors: IntArray

    @property
    def nq(self) -> int:
        """Length of y: rigid configuration and eta."""
        return int(self.rigid.nq) + self.expansion.n_eta

    @property
    def nv(self) -> int:
        """Length of v: rigid velocities and deta/dt."""
        return int(self.rigid.nv) + self.expansion.n_eta

    @property
    def n_eta(self) -> int:
        """Number of elastic coordinates."""
        return self.expansion.n_eta

    @property
    def free(self) -> IntArray:
        """Velocity rows that are not motors."""
        return np.setdiff1d(np.arange(self.nv), self.motors).astype(np.intp)


class Dynamics:
    """A run's own workspace on a system (it owns the pin.Data; make one per run)."""

    def __init__(self, system: System) -> None:
        self.system = system
        expansion = system.expansion
        self.model: pin.Model = expansion.model
        self.data: pin.Data = self.model.createData()
        self.n_rigid = int(system.rigid.nv)
        self.nq_rigid = int(system.rigid.nq)
        self.vector_space = self.nq_rigid == self.n_rigid
        self.flexible = system.n_eta > 0
        self.damped = bool(np.any(system.D))
        self.sprung = len(system.springs.v_at) > 0
        self.closed = ClosureState(system.closed, self.model, self.data)
        self.looped = system.closed.n > 0
        nV, nv = self.model.nv, system.nv
        self.Q = pin.neutral(self.model)
        self.X = np.zeros((nV, nv))
        self.X[expansion.v_at, np.arange(self.n_rigid)] = 1.0
        self.X[:, self.n_rigid :] = expansion.Phi
        self._Xdot = np.zeros((nV, nv))
        self._K_eta = np.ascontiguousarray(system.K[self.n_rigid :, self.n_rigid :])
        self._lift = np.zeros(nV)
        self._eta_pair = np.zeros((system.n_eta, 2))
        self._loads = pin.StdVec_Force([pin.Force.Zero() for _ in range(self.model.njoints)])
        self.g = np.zeros(nV)

    # Configuration -------------------------------------------------------------------------

    def integrate(self, y: Array, dy: Array) -> Array:
        """y moved by dy on the configuration manifold (right-trivialised), shape (nq,)."""
        if self.vector_space:
            return y + dy
        moved = np.empty_like(y)
        n, m = self.nq_rigid, self.n_rigid
        moved[:n] = pin.integrate(self.system.rigid, y[:n], dy[:m])
        moved[n:] = y[n:] + dy[m:]
        return moved

    def difference(self, y0: Array, y1: Array) -> Array:
        """dy that takes y0 to y1, shape (nv,)."""
        if self.vector_space:
            return y1 - y0
        n, m = self.nq_rigid, self.n_rigid
        dy = np.empty(self.system.nv)
        dy[:m] = pin.difference(self.system.rigid, y0[:n], y1[:n])
        dy[m:] = y1[n:] - y0[n:]
        return dy

    def place(self, y: Array) -> None:
        """Q = T(y) and X = dQ/dy."""
        n = self.nq_rigid
        if not self.flexible:
            self.Q = y
            return
        expansion, m = self.system.expansion, self.n_rigid
        eta = y[n:]
        self.Q[expansion.q_at] = y[:n]
        lift = self._lift
        np.matmul(expansion.Phi, eta, out=lift)
        if expansion.curved:
            flat = self.X.reshape(-1)
            for curved in expansion.curved:
                flat[curved.flat] = curved.Phi + _bend(curved.G, eta[curved.eta])
            lift += self.X[:, m:] @ eta
            lift *= 0.5
        self.Q[expansion.station_q] = lift[expansion.station_v]

    def expand_motion(self, v: Array, a: Array) -> tuple[Array, Array]:
        """V = X v and A = X a + Xdot v at the placed configuration."""
        if not self.flexible:
            return v, a
        expansion, m = self.system.expansion, self.n_rigid
        V, A = self.X @ v, self.X @ a
        if expansion.curved:
            self._rates(v)
            A += self._Xdot[:, m:] @ v[m:]
        return V, A

    def _rates(self, v: Array) -> None:
        flat, m = self._Xdot.reshape(-1), self.n_rigid
        for curved in self.system.expansion.curved:
            flat[curved.flat] = _bend(curved.G, v[m:][curved.eta])

    # Forces --------------------------------------------------------------------------------

    def residual(self, y: Array, v: Array, a: Array, lam: Array) -> Array:
        """Forces that the motion (y, v, a) with multipliers lam leaves to the motors.

        r = X' (rnea - J_Q' lam) + K y + D v. Afterwards c and J are current.

        Args:
            y: [q; eta], shape (nq,). v, a: Shape (nv,). lam: Shape (rows,), N | N m.
        Returns:
            Generalised forces, shape (nv,): zero in the rows of everything that is not driven.
        """
        self.place(y)
        V, A = self.expand_motion(v, a)
        g = pin.rnea(self.model, self.data, self.Q, V, A)
        if self.looped:
            pin.computeJointJacobians(self.model, self.data, self.Q)
            self.closed.evaluate()
            g = g - self.closed.J.T @ lam
        self.g = g
        r = self.X.T @ g if self.flexible else np.array(g)
        return self._add_elastic(r, y, v)

    def _add_elastic(self, r: Array, y: Array, v: Array) -> Array:
        if self.flexible:
            r[self.n_rigid :] += self._K_eta @ y[self.nq_rigid :]
        if self.damped:
            r += self.system.D @ v
        if self.sprung:
            s = self.system.springs
            r[s.v_at] += s.stiffness * (self._spring_angles(y) - s.rest)
        return r

    def _spring_angles(self, y: Array) -> Array:
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
        J = self.closed.J
        return J @ self.X if self.flexible else J.copy()

    def closure_bias(self, y: Array, v: Array) -> Array:
        """gamma in cdd = J a + gamma, shape (rows,)."""
        self.place(y)
        V, A = self.expand_motion(v, np.zeros_like(v))
        pin.computeJointJacobiansTimeVariation(self.model, self.data, self.Q, V)
        self.closed.evaluate()
        gamma = self.closed.bias(V)
        return gamma + self.closed.J @ A if self.flexible else gamma

    # Matrices ------------------------------------------------------------------------------

    def mass(self, y: Array) -> Array:
        """M = X' crba(Q) X, shape (nv, nv)."""
        self.place(y)
        M = _symmetric(pin.crba(self.model, self.data, self.Q))
        return self.X.T @ M @ self.X if self.flexible else M

    def tangent(self, y: Array, v: Array, a: Array, lam: Array) -> tuple[Array, Array, Array]:
        """M, C, K: exact derivatives of the residual by a, v and y, each (nv, nv)."""
        self.place(y)
        V, A = self.expand_motion(v, a)
        extra = None
        if self.looped:
            pin.computeJointJacobians(self.model, self.data, self.Q)
            self.closed.evaluate()
            extra = self.closed.force_tangent(lam)
            self._load(lam)
        dQ, dV, M = (
            np.array(part)
            for part in pin.computeRNEADerivatives(
                self.model, self.data, self.Q, V, A, self._loads
            )
        )
        M = _symmetric(M)
        if extra is not None:
            dQ -= extra
        if not self.flexible:
            K, C = dQ, dV
        else:
            X, m = self.X, self.n_rigid
            XM, XC = X.T @ M, X.T @ dV
            K, C = X.T @ (dQ @ X), XC @ X
            if self.system.expansion.curved:
                moving = self._Xdot[:, m:]
                C[:, m:] += 2.0 * (XM @ moving)
                K[:, m:] += XC @ moving
                K[:, m:] += XM @ self._bent(a[m:])
                self._add_geometric(K)
            M = XM @ X
        K = K + self.system.K
        s = self.system.springs
        K[s.v_at, s.v_at] += s.stiffness
        return M, C + self.system.D, K

    def _bent(self, a_eta: Array) -> Array:
        """dX/deta contracted with eta's acceleration: rows G a, shape (nV, n_eta)."""
        bent = np.zeros((self.model.nv, self.system.nv))
        flat = bent.reshape(-1)
        for curved in self.system.expansion.curved:
            flat[curved.flat] = _bend(curved.G, a_eta[curved.eta])
        return bent[:, self.n_rigid :]

    def _add_geometric(self, K: Array) -> None:
        """Geometric stiffness: sum of G_k weighted by the force g_k on each curved row."""
        g = self._row_forces()
        for curved in self.system.expansion.curved:
            bodies, _, n, _ = curved.G.shape
            stiff = np.einsum("br,brij->bij", g[curved.rows], curved.G, optimize=True)
            for k in range(bodies):
                at = slice(
                    self.n_rigid + curved.eta.start + k * n,
                    self.n_rigid + curved.eta.start + (k + 1) * n,
                )
                K[at, at] += stiff[k]

    def _row_forces(self) -> Array:
        """Expanded forces rnea - J_Q' lam of the last tangent (Pinocchio keeps them in tau)."""
        return np.array(self.data.tau)

    def _load(self, lam: Array) -> None:
        """Closure wrenches as external forces in the frames of the joints they act on."""
        cl = self.system.closed
        loops = len(cl.names)
        total: dict[int, pin.Force] = {int(body): pin.Force.Zero() for body in cl.bodies}
        for k, wrench in enumerate(self.closed.wrenches(lam)):
            total[int(cl.bodies[loops + k])] += pin.Force(wrench)
            total[int(cl.bodies[k])] -= pin.Force(wrench)
        for body, world in total.items():
            self._loads[body] = self.data.oMi[body].actInv(world)

    def joint_forces(self, y: Array, v: Array, a: Array, lam: Array) -> Array:
        """r as `residual`, and data.f with the closure forces in it (for reactions)."""
        self.place(y)
        V, A = self.expand_motion(v, a)
        if self.looped:
            pin.computeJointJacobians(self.model, self.data, self.Q)
            self.closed.evaluate()
            self._load(lam)
        self.g = np.array(pin.rnea(self.model, self.data, self.Q, V, A, self._loads))
        r = self.X.T @ self.g if self.flexible else self.g.copy()
        return self._add_elastic(r, y, v)

    # Energies ------------------------------------------------------------------------------

    def energies(self, y: Array, v: Array) -> tuple[float, float, float, float]:
        """Kinetic, gravity, elastic and spring energy, J."""
        self.place(y)
        V, _ = self.expand_motion(v, np.zeros_like(v))
        kinetic = 0.5 * float(V @ _symmetric(pin.crba(self.model, self.data, self.Q)) @ V)
        gravity = float(pin.computePotentialEnergy(self.model, self.data, self.Q))
        eta = y[self.nq_rigid :]
        elastic = 0.5 * float(eta @ self._K_eta @ eta)
        s = self.system.springs
        stretch = self._spring_angles(y) - s.rest
        return kinetic, gravity, elastic, 0.5 * float(stretch @ (s.stiffness * stretch))


def _bend(G: Array, eta: Array) -> Array:
    """G eta of stacked bodies, flat: (b, r, n, n) with eta (b n,) gives (b r n,)."""
    bodies, rows, n, _ = G.shape
    return np.matmul(G.reshape(bodies, rows * n, n), eta.reshape(bodies, n, 1)).reshape(-1)


def _symmetric(M: Array) -> Array:
    """Full matrix from Pinocchio's upper triangle."""
    upper = np.triu(M)
    return upper + np.triu(M, 1).T
