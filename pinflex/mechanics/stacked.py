"""The residual of several states at once: what numpy costs is paid once for all of them.

The same equations as `pinflex.mechanics.dynamics`, for the stages of a collocation step.
Pinocchio takes the states one after the other; everything around it runs on stacked arrays. Scenes
with loads, sleeves or feedback go through `Dynamics` state by state.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.closure import Closures
from pinflex.mechanics.closure_state import ClosureState
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.poses import columns


def spans(count: int, most: int) -> Iterator[slice]:
    """Slices of one length, `most` or less, that cover `count` states; the last may overlap."""
    size = min(count, most)
    for first in range(0, count, max(size, 1)):
        first = min(first, count - size)
        yield slice(first, first + size)


class Stacked:
    """Residuals of `size` states of one system, on the workspace of its Dynamics."""

    def __init__(self, dynamics: Dynamics, size: int) -> None:
        system = dynamics.system
        self.dynamics, self.size = dynamics, size
        self.plain = not (dynamics.loaded or system.closed.contacts)
        nV, rows = int(dynamics.model.nv), system.closed.n
        self._blocks = system.expansion.blocks
        self._rigid = int(system.rigid.nq), int(system.rigid.nv)
        self.Q = np.tile(dynamics.Q, (size, 1))
        self.V, self.A = np.zeros((size, nV)), np.zeros((size, nV))
        self.g = np.empty((size, nV))
        self.c = np.zeros((size, rows))
        if dynamics.looped:
            joints, loops = int(dynamics.model.njoints), len(system.closed.names)
            self._poses = np.empty((size, joints, 12))
            self._J = np.empty((size, 6, nV))
            stacked = stack(system.closed, size, joints, int(dynamics.model.nq))
            self.closed = ClosureState(
                stacked, dynamics.model, dynamics.data, dynamics.closed.poses
            )
            self._of_loop = (np.arange(loops)[:, None] == system.closed.loop_of).astype(float)
            self._mask = system.closed.support_b - system.closed.support_a

    def residual(self, Y: Array, V: Array, A: Array, lam: Array, t: Array) -> Array:
        """Residuals of the states; afterwards `c` holds their closure residuals.

        Args:
            Y: Shape (size, nq). V, A: Shape (size, nv). lam: Shape (size, rows).
            t: Times in s, shape (size,).
        Returns:
            Shape (size, nv).
        """
        if not self.plain:
            return self._one_by_one(Y, V, A, lam, t)
        d = self.dynamics
        Q, V_all, A_all, maps = self.expanded(Y, V, A)
        g, model, data = self.g, d.model, d.data
        jacobian = columns(data.J)
        for k in range(self.size):
            g[k] = pin.rnea(model, data, Q[k], V_all[k], A_all[k])
            if d.looped:
                pin.computeJointJacobians(model, data, Q[k])
                self._J[k] = jacobian
                d.closed.poses.refresh()
                self._poses[k] = d.closed.poses.block
        if d.looped:
            self.closed.Q = Q
            g -= self._closure_forces(lam)
        return self.projected(g, Y, V, maps)

    def expanded(self, Y: Array, V: Array, A: Array) -> tuple[Array, Array, Array, list[Array]]:
        """Q, V and A of the expanded model, (size, nQ) and (size, nV), and the blocks of X."""
        d, (nq, nv) = self.dynamics, self._rigid
        if not d.flexible:
            return Y, V, A, []
        maps = self._expand(np.stack([Y[:, nq:], V[:, nv:], A[:, nv:]]))
        expansion = d.system.expansion
        self.Q[:, expansion.q_at] = Y[:, :nq]
        self.V[:, expansion.v_at], self.A[:, expansion.v_at] = V[:, :nv], A[:, :nv]
        return self.Q, self.V, self.A, maps

    def projected(self, g: Array, Y: Array, V: Array, maps: list[Array]) -> Array:
        """X' g with the forces of stiffness, damping and springs, shape (size, nv)."""
        d, nq, nv = self.dynamics, *self._rigid
        if not d.flexible:
            R = g.copy()
        else:
            R = np.empty((self.size, d.system.nv))
            R[:, :nv] = g[:, d.system.expansion.v_at]
            for block, X in zip(self._blocks, maps, strict=True):
                bodies, rows, _ = block.Phi.shape
                force = g[:, block.rows.reshape(-1)].reshape(-1, bodies, 1, rows)
                R[:, nv:][:, block.eta] = np.matmul(force, X).reshape(self.size, -1)
            R[:, nv:] += d.elastic_forces(Y[:, nq:])
        if d.damped:
            R += V @ d.system.D
        if d.sprung:
            s = d.system.springs
            R[:, s.v_at] += s.stiffness * (np.array([d.spring_angles(y) for y in Y]) - s.rest)
        return R

    def _one_by_one(self, Y: Array, V: Array, A: Array, lam: Array, t: Array) -> Array:
        R = np.empty_like(V)
        for k in range(self.size):
            R[k] = self.dynamics.residual(Y[k], V[k], A[k], lam[k], float(t[k]))
            self.c[k] = self.dynamics.closed.c
        return R

    def _expand(self, states: Array) -> list[Array]:
        """Q, V, A of the elastic coordinates from theirs (3, size, n_eta).

        Returns:
            The blocks of X, (size, bodies, R, n).
        """
        size, maps = self.size, []
        for block in self._blocks:
            (bodies, rows, n), curved = block.Phi.shape, block.G.shape[1]
            xva = states[:, :, block.eta].reshape(3, size, bodies, n)
            X = np.empty((size, bodies, rows, n))
            X[:] = block.Phi
            if curved:
                # States side by side, so that each body is one product.
                G = block.G.reshape(bodies, curved * n, n)
                side = xva[:2].transpose(2, 3, 0, 1).reshape(bodies, n, 2 * size)
                bent = np.matmul(G, side).reshape(bodies, curved, n, 2, size)
                bend, rate = np.ascontiguousarray(bent.transpose(3, 4, 0, 1, 2))
                X[:, :, :curved] += bend
            moved = np.matmul(X, np.ascontiguousarray(xva.transpose(1, 2, 3, 0)))
            if curved:
                x, v = xva[0, ..., None], xva[1, ..., None]
                moved[:, :, :curved, :1] -= 0.5 * np.matmul(bend, x)
                moved[:, :, :curved, 2:] += np.matmul(rate, v)
            Q, V, A = moved.transpose(3, 0, 1, 2).reshape(3, size, -1)
            at = block.rows.reshape(-1)
            self.Q[:, block.q_rows], self.V[:, at], self.A[:, at] = Q, V, A
            maps.append(X)
        return maps

    def _closure_forces(self, lam: Array) -> Array:
        """J_Q' lam of all states, (size, nV); sets c."""
        closed, size = self.closed, self.size
        closed.rows_from(self._poses.reshape(-1, 12))
        self.c = closed.c.reshape(size, -1)
        on_loops = np.matmul(self._of_loop, (closed.W * lam.reshape(-1, 1)).reshape(size, -1, 6))
        force: Array = (np.matmul(on_loops, self._J) * self._mask).sum(axis=1)
        return force + self.coupling_forces(lam)

    def coupling_forces(self, lam: Array) -> Array | float:
        """What couplings of joints add to J_Q' lam (size, rows), shape (size, nV)."""
        coupled = self.dynamics.system.closed.coupled
        return lam[:, coupled.rows] @ coupled.J if len(coupled.rows) else 0.0


def stack(closed: Closures, size: int, joints: int, width: int) -> Closures:
    """The loops of `size` copies of a model whose joint poses lie one after the other.

    Args:
        closed: Of one model. size: Number of copies. joints: Of one, the world included.
        width: Length of one configuration.
    """
    loops, rows = len(closed.names), closed.n
    copies = np.arange(size)[:, None]
    sides = (closed.bodies.reshape(2, 1, loops) + joints * copies).reshape(-1)
    local = np.tile(closed.local.reshape(2, 1, loops, 3, 4), (1, size, 1, 1, 1))

    def shifted(at: IntArray, step: int) -> IntArray:
        return np.asarray((at + step * copies).reshape(-1), dtype=np.intp)

    none = np.zeros((0, 0))
    return replace(
        closed,
        names=closed.names * size,
        kinds=closed.kinds * size,
        labels=closed.labels * size,
        loop_of=shifted(closed.loop_of, loops),
        bodies=sides,
        local=local.reshape(-1, 3, 4),
        point_rows=shifted(closed.point_rows, rows),
        point_axes=np.tile(closed.point_axes, size),
        dot_rows=shifted(closed.dot_rows, rows),
        dot_a=np.tile(closed.dot_a, size),
        dot_b=np.tile(closed.dot_b, size),
        distance_rows=shifted(closed.distance_rows, rows),
        lengths=np.tile(closed.lengths, size),
        support_a=none,
        support_b=none,
        row_mask=none,
        contacts=(),
        coupled=closed.coupled.copies(size, rows, width),
    )
