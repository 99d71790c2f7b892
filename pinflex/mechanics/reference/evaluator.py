"""The equations of motion, written to be read: Pinocchio and numpy, state after state.

    r = X' (rnea(Q, V, A) - J_F' F) - J' lam + K y + D v + friction + springs,      c(y) = 0

F: loads. M is Pinocchio's crba; the other derivatives of r are differences of what is neither
linear nor a joint's own. It is of second order in v, so that a central difference of any step is
exact; along y four points leave round-off.

States are stacked: Y (n, nq), V and A (n, nv), lam (n, rows) [N | N m], t (n,) [s].
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.kernel.evaluate import Closure, Energies, JointForces, Tangent
from pinflex.mechanics.evaluation.frames import Frame
from pinflex.mechanics.kinks import Pull, places_of, relative_motion
from pinflex.mechanics.manifold import pose_of, support, twists_of
from pinflex.mechanics.model.strain import Strain
from pinflex.mechanics.reference import closures
from pinflex.mechanics.reference.closures import LoadStates
from pinflex.rotations import cross

if TYPE_CHECKING:
    from pinflex.mechanics.closure import Closures
    from pinflex.mechanics.model.system import System


# Where joints are and how they move, at n configurations, by Pinocchio.
#
# Poses are [R | p] in the world; Jacobians give the twist of a body at the world's origin by the
# velocity rows that move it.

_LARGE = 31  # velocity rows from which a workspace (4 nV^3 numbers) is dear beside a few looks

Last = dict[tuple[bytes, int | None], tuple[Array, Array]]  # poses and Jacobian by Q and joint


class Placing:
    """The joints of one model."""

    def __init__(self, model: pin.Model, last: Last | None = None) -> None:
        """`last`: what the last dear look found, which those at the same model share."""
        self.model, self._last = model, {} if last is None else last

    @cached_property
    def data(self) -> pin.Data:
        """Pinocchio's workspace, made when first needed: a large one takes half a second."""
        return pin.Data(self.model)

    @property
    def _dear(self) -> bool:
        return self.model.nv > _LARGE and "data" not in self.__dict__

    def poses(self, Q: Array) -> Array:
        """Poses (n, joints, 3, 4) at Q (n, nQ)."""
        if self._dear:
            return self.jacobians(Q)[0]
        placed = []
        for q in Q:
            pin.forwardKinematics(self.model, self.data, q)
            placed.append([place.np for place in self.data.oMi])
        return _poses(placed)

    def jacobians(self, Q: Array, joint: int | None = None) -> tuple[Array, Array]:
        """Poses (n, joints, 3, 4) and world Jacobians (n, 6, nV) at Q (n, nQ).

        Of one joint alone both take a tenth of the time; those of others are not to be read.
        """
        if self._dear:
            looks = [self._look(q, joint) for q in Q]
            return np.array([x for x, _ in looks]), np.array([J for _, J in looks])
        placed, J = [], np.empty((len(Q), 6, self.model.nv))
        for k, q in enumerate(Q):
            J[k] = _matrix(pin.computeJointJacobians(self.model, self.data, q))
            every = self.data.oMi if joint is None else (self.data.oMi[joint],)
            placed.append([place.np for place in every])
        if joint is None:
            return _poses(placed), J
        poses = np.full((len(Q), self.model.njoints, 4, 3), np.nan).swapaxes(2, 3)
        poses[:, joint] = _poses(placed)[:, 0]
        return poses, J

    def _look(self, q: Array, joint: int | None) -> tuple[Array, Array]:
        """What a look at one configuration found, where it is known: all who load look at home."""
        if (key := (q.tobytes(), joint)) not in self._last:
            self._last.clear()
            self._last[key] = self._step_by_step(q, joint)
        return self._last[key]

    def _step_by_step(self, q: Array, joint: int | None) -> tuple[Array, Array]:
        """Poses (joints, 3, 4) and Jacobian (6, nV) at one configuration, without a workspace."""
        joints, above, places, first = self._tree
        some = range(1, len(joints)) if joint is None else self.model.supports[joint].tolist()[1:]
        placed, twists = [pin.SE3.Identity()] * len(joints), [np.zeros((6, 0))]
        rows, of = list[int](), list[int]()
        for j in some:
            own, axes = joints[j], twists_of(joints[j])
            here = q[own.idx_q : own.idx_q + own.nq]
            placed[j] = placed[above[j]] * (places[j] * pose_of(own, axes, here))
            twists.append(axes)
            rows += range(first[j], first[j] + axes.shape[1])
            of += [j] * axes.shape[1]
        poses, J = _poses([[place.np for place in placed]]), np.zeros((6, self.model.nv))
        R, p = np.split(poses[0, of], [3], 2)
        v, w = np.einsum("nxk,pkn->pnx", R, np.hstack(twists).reshape(2, 3, -1))
        J[:, rows] = np.concatenate([v + cross(p[:, :, 0], w), w], axis=1).T
        return poses[0], J

    @cached_property
    def _tree(self) -> tuple[list[Any], ...]:
        """Joints, their parents, places and first rows, as lists: found quickly."""
        m = self.model
        return tuple(of.tolist() for of in (m.joints, m.parents, m.jointPlacements, m.idx_vs))


def _poses(placed: list[list[Array]]) -> Array:
    """Poses (n, k, 3, 4) of n times k homogeneous matrices, one axis after the other in memory."""
    columns = np.array(placed).reshape(len(placed), -1, 4, 4).swapaxes(2, 3)
    return np.ascontiguousarray(columns[..., :3]).swapaxes(2, 3)


def _matrix(J: Array) -> Array:
    """A (6, nV) matrix, also where Pinocchio hands a single column over as a vector."""
    return J if J.ndim == 2 else J.reshape(6, 1)


def falling(model: pin.Model, poses: Array, J: Array) -> Array:
    """Generalised forces of a unit gravity along x, y, z, shape (3, nV).

    Of each row the mass beyond it, times how it moves its centre.
    """
    joints, own = int(model.njoints), model.inertias.tolist()
    mass, lever = (np.array([getattr(x, of) for x in own]) for of in ("mass", "lever"))
    centre = (poses[:, :, :3] @ lever[:, :, None])[:, :, 0] + poses[:, :, 3]
    first = mass[:, None] * centre
    for j, above in reversed([*enumerate(model.parents.tolist())][1:]):
        mass[above] += mass[j]
        first[above] += first[j]
    of = np.repeat(np.arange(joints), model.nvs.tolist())
    return np.asarray(mass[of] * J[:3] + cross(J[3:].T, first[of]).T)


# The coordinate map: Q = T(y), V = X v, A = X a + Xdot v, with X = dQ/dy.
#
# X is the identity on the rigid rows and Phi + G eta on the rows of each flexible body.


@dataclass(frozen=True, eq=False)
class Configuration:
    """The expanded configurations of n states.

    Attributes:
        Q: Shape (n, nQ). V, A: Shape (n, nV), of speeds and accelerations zero where none were
            given.
        X: Shape (n, nV, nv); None: the identity, where no link bends.
    """

    Q: Array
    V: Array
    A: Array
    X: Array | None

    def project(self, g: Array) -> Array:
        """X' g, shape (n, nv), of expanded forces g (n, nV)."""
        return g if self.X is None else (g[:, None] @ self.X)[:, 0]

    def times_map(self, D: Array) -> Array:
        """D X, shape (..., k, nv), of D (k, nV) of one state or (n, k, nV) of all."""
        return D if self.X is None else (D @ self.X).reshape(*D.shape[:-1], -1)


class Kinematics(NamedTuple):
    """Joints at n states.

    Attributes:
        here: Expanded configurations and map.
        poses: Of joints, [R | p] in the world, shape (n, joints, 3, 4).
        J: World Jacobians of the joints, shape (n, 6, nV).
    """

    here: Configuration
    poses: Array
    J: Array


class CoordinateMap:
    """The map of one system."""

    def __init__(self, system: System) -> None:
        self._system, on, n = system, system.expansion, int(system.rigid.nv)
        self._neutral = pin.neutral(on.model)
        self._X = np.zeros((int(on.model.nv), system.nv))
        self._X[on.v_at, np.arange(len(on.v_at))] = 1.0
        for block in on.blocks:
            self._X[block.rows, n + block.eta.start : n + block.eta.stop] = block.Phi

    def at(self, Y: Array, V: Array | None = None, A: Array | None = None) -> Configuration:
        """The map at n states."""
        none = np.zeros((len(Y), self._system.nv))
        V, A = none if V is None else V, none if A is None else A
        on, n = self._system.expansion, int(self._system.rigid.nv)
        if not on.blocks:
            return Configuration(Y, V, A, None)
        every, rates = Y[:, int(self._system.rigid.nq) :], V[:, n:]
        Q = np.tile(self._neutral, (len(Y), 1))
        Q[:, on.q_at] = Y[:, : len(on.q_at)]
        X = np.tile(self._X, (len(Y), 1, 1))
        swept = np.zeros((len(Y), len(self._X)))  # Xdot v
        for block in on.blocks:
            G, eta, rate = block.G, every[:, block.eta], rates[:, block.eta]
            bent, columns = block.rows[: len(G)], slice(n + block.eta.start, n + block.eta.stop)
            turned = np.einsum("rij,nj->nri", G, eta)
            Q[:, block.q_rows] = eta @ block.Phi.T
            Q[:, block.q_rows[: len(G)]] += 0.5 * np.einsum("nri,ni->nr", turned, eta)
            X[:, bent, columns] += turned
            swept[:, bent] = np.einsum("rij,ni,nj->nr", G, rate, rate)
        return Configuration(
            Q, (X @ V[:, :, None])[:, :, 0], (X @ A[:, :, None])[:, :, 0] + swept, X
        )


# Of the differences along y [rad | m]: the fourth order leaves 1e-13 of a force, as does round-off.
# A sleeve may stand beside a border of elements, beyond which its rows are other polynomials.
_STEP, _BESIDE, _ROUND_OFF = 1e-3, 2e-5, 4e-15
_POINTS, _WEIGHTS = np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0])


class Reference:
    """The equations of one system (one for each thread).

    Attributes:
        system: What is evaluated. model: Its expanded model. map: Its coordinates in that.
        placing: Its joints. strain: Its links.
    """

    def __init__(self, system: System) -> None:
        self.system, self.model = system, system.expansion.model
        self.map = CoordinateMap(system)
        self.placing = Placing(self.model, system.expansion.last)
        self.strain = Strain(system)
        self._q, self._v = int(system.rigid.nq), int(system.rigid.nv)

    # Forces ----------------------------------------------------------------------------------

    def forces(self, Y: Array, V: Array, A: Array, t: Array) -> Array:
        """r without closures, shape (n, nv)."""
        return self._moving(Y, V, A, t) + self._resting(Y, V)

    def residual(self, Y: Array, V: Array, A: Array, lam: Array, t: Array) -> tuple[Array, Array]:
        """r (n, nv) and c (n, rows)."""
        c, J = self.close(Y)
        return self.forces(Y, V, A, t) - (lam[:, None] @ J)[:, 0], c

    def _moving(self, Y: Array, V: Array, A: Array, t: Array) -> Array:
        """X' (rnea - J_F' F), what varies with pose and speed together, shape (n, nv)."""
        acting, here = self._acting(Y, V, t), self.map.at(Y, V, A)
        if not acting and not self.system.added.joints:
            model, data = self.model, self.placing.data
            forces = [pin.rnea(model, data, *state) for state in _states(here)]
        else:
            forces = [
                self._rnea(*state, {joint: x[k] for joint, x in acting.items()}, float(t[k]))
                for k, state in enumerate(_states(here))
            ]
        return here.project(np.array(forces).reshape(here.V.shape))

    def _acting(self, Y: Array, V: Array, t: Array) -> Mapping[int, Array]:
        """Wrenches from outside on joints, in their frames, (n, 6) each."""
        return self._loads(Y, V).wrenches(t) if self.system.loads.present else {}

    def _loads(self, Y: Array, V: Array) -> LoadStates:
        places = places_of(self, Y, V, 0.0 * V)
        return LoadStates(self.system.loads, self.system.kinks, places)

    def _resting(self, Y: Array, V: Array) -> Array:
        """K y + D v, with friction and springs of joints, shape (n, nv)."""
        s, r = self.system, V @ self.system.D
        r[:, self._v :] += self.strain.force(Y[:, self._q :])
        r[:, s.friction.rows] += s.friction.force(V)
        r[:, s.springs.v_at] += s.springs.stiffness * (s.springs.angles(Y) - s.springs.rest)
        for row, pull in self._kinks(Y, V):
            r[:, row] += pull.force
        return r

    def _kinks(self, Y: Array, V: Array) -> Iterator[tuple[int, Pull]]:
        """Laws of pieces over coordinates, with their rows."""
        s = self.system.kinks
        for k in s.of_coordinates:
            yield s.rows[k].v, s.pull(k, s.position(k, Y), V[:, s.rows[k].v])

    def _rnea(self, q: Array, v: Array, a: Array, acting: Mapping[int, Array], t: float) -> Array:
        """Pinocchio's, with added masses and wrenches (6,) that act in joints' frames, (nV,)."""
        model, data, push = self.model, self.placing.data, dict(acting)
        for joint, wrench in self._added(q, v, a, t):
            push[joint] = push.get(joint, np.zeros(6)) - wrench
        outside = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
        for joint, wrench in push.items():
            if joint:
                outside[joint] = pin.Force(wrench)
        return np.array(pin.rnea(model, data, q, v, a, outside))

    def _added(self, q: Array, v: Array, a: Array, t: float) -> Iterator[tuple[int, Array]]:
        """M a + v x* (M v) of added masses, in the frames of their joints, (6,)."""
        added, data = self.system.added.at(t), self.placing.data
        if added:
            pin.forwardKinematics(self.model, data, q, v, a)
        for joint, M in added:
            speed = data.v[joint]
            turning = speed.cross(pin.Force(M @ speed.vector)).vector
            yield joint, M @ data.a[joint].vector + turning

    # Closures --------------------------------------------------------------------------------

    def close(self, Y: Array) -> Closure:
        """c (n, rows) and J = dc/dy (n, rows, nv) at Y (n, nq)."""
        if not self.system.closed.n:
            return Closure(np.zeros((len(Y), 0)), np.zeros((len(Y), 0, self.system.nv)))
        here = self.map.at(Y)
        poses, J = self.placing.jacobians(here.Q)

        def some(on: Closures, s: slice) -> tuple[Array, Array]:
            X = None if here.X is None else here.X[s]
            return closures.by_velocities(on, poses[s], J[s], X, here.Q[s], Y[s, self._q :])

        return Closure(*self._on_segments(poses, some))

    def closure_bias(self, Y: Array, V: Array) -> Array:
        """gamma in cdd = J a + gamma, shape (n, rows), at Y (n, nq) and V (n, nv)."""
        if not self.system.closed.n:  # spared: Pinocchio's workspace of a large model
            return np.zeros((len(Y), 0))
        here, none = self.map.at(Y, V), np.zeros_like(V)
        poses = self.placing.poses(here.Q)

        def some(on: Closures, s: slice) -> tuple[Array]:
            places, rates = self.motions(Y[s], V[s], none[s], on.bodies.tolist())
            R, p = places[..., None, :, :3], places[..., None, :, 3]
            v, w = ((R @ x[..., None])[..., 0] for x in (rates[..., :3], rates[..., 3:]))
            motion = np.concatenate([v + np.cross(p, w), w], axis=-1)  # (2 loops, s, 2, 6)
            twists = motion[:, :, 0].swapaxes(0, 1), motion[:, :, 1].swapaxes(0, 1)
            eta = Y[s, self._q :], V[s, self._v :]
            return (closures.by_time(on, poses[s], twists, here.Q[s], eta, here.A[s]),)

        return self._on_segments(poses, some)[0]

    def _on_segments(
        self, poses: Array, some: Callable[[Closures, slice], tuple[Array, ...]]
    ) -> list[Array]:
        """Answers of n states: at once, but that every sleeve is on a segment of its own."""
        closed, n = self.system.closed, len(poses)
        if not any(contact.sleeve.segments for contact in closed.contacts):
            return [*some(closed, slice(0, n))]
        each = (some(closures.on_segments(closed, poses[k]), slice(k, k + 1)) for k in range(n))
        return [np.concatenate(x) for x in zip(*each, strict=True)]

    def sleeve_places(self, Y: Array) -> Array:
        """Where the sleeves are on their links (m) at Y (n, nq), shape (n, sleeves)."""
        out = np.empty((len(Y), len(self.system.closed.contacts)))
        for k, (y, poses) in enumerate(zip(Y, self.placing.poses(self.map.at(Y).Q), strict=True)):
            on = closures.on_segments(self.system.closed, poses)
            out[k] = [place.at for place in closures.sleeves_at(on, poses, y[self._q :])]
        return out

    # Derivatives -----------------------------------------------------------------------------

    def mass(self, y: Array, t: float) -> Array:
        """M = X' crba(Q) X, shape (nv, nv), at y (nq,) and a time t (s)."""
        here = self.map.at(y[None])
        M = self._expanded_mass(here.Q[0], t)
        return M if here.X is None else here.X[0].T @ M @ here.X[0]

    def _expanded_mass(self, q: Array, t: float) -> Array:
        """Pinocchio's crba with added masses, shape (nV, nV)."""
        M, added = np.array(pin.crba(self.model, self.placing.data, q)), self.system.added.at(t)
        if added:
            poses, J = (x[0] for x in self.placing.jacobians(q[None]))
        for joint, inertia in added:
            own = _place(poses[joint]).toActionMatrixInverse() @ (J * support(self.model, joint))
            M += own.T @ inertia @ own
        return M

    def tangent(self, y: Array, v: Array, a: Array, lam: Array, t: float) -> Tangent:
        """Derivatives of r by a, v and y, and J."""
        s, nv, fixed = self.system, self.system.nv, np.full(4, t)
        C, K = s.D.copy(), s.K.copy()
        C[s.friction.rows, s.friction.rows] += s.friction.slope(v)
        K[s.springs.v_at, s.springs.v_at] += s.springs.stiffness
        for row, pull in self._kinks(y[None], v[None]):
            C[row, row] += pull.damping[0]
            K[row, row] += pull.slope[0]
        for at, stiffness in self.strain.bent(y[self._q :]):
            K[self._v :, self._v :][at, at] += stiffness
        X, most = self.map.at(y[None]).X, _BESIDE if s.closed.contacts else _STEP
        step = np.full(nv, most) if X is None else most / np.abs(X[0]).max(axis=0)
        for k, e in enumerate(np.eye(nv)):
            both = self._moving(
                np.tile(y, (2, 1)), v + np.outer([1.0, -1.0], e), np.tile(a, (2, 1)), fixed[:2]
            )
            C[:, k] += _slope(both, np.array([0.5, -0.5]), 1.0)
            Y = np.array([s.integrate(y, h * e) for h in step[k] * _POINTS])
            r = (
                self._moving(Y, np.tile(v, (4, 1)), np.tile(a, (4, 1)), fixed)
                - lam @ self.close(Y).J
            )
            K[:, k] += _slope(r, _WEIGHTS / 12.0, step[k])
        return Tangent(self.mass(y, t), C, K, self.close(y[None]).J[0])

    # Motions, forces, energies ---------------------------------------------------------------

    def kinematics(self, Y: Array, joint: int | None = None) -> Kinematics:
        """Joints, or one of them, at Y (n, nq)."""
        here = self.map.at(Y)
        return Kinematics(here, *self.placing.jacobians(here.Q, joint))

    def motions(self, Y: Array, V: Array, A: Array, joints: Sequence[int]) -> tuple[Array, Array]:
        """Poses of joints (k, n, 3, 4); velocity and acceleration in their frames (k, n, 2, 6)."""
        here, data, (n, k) = self.map.at(Y, V, A), self.placing.data, (len(Y), len(joints))
        poses, rates = np.empty((k, n, 3, 4)), np.empty((k, n, 2, 6))
        for at, state in enumerate(_states(here)):
            pin.forwardKinematics(self.model, data, *state)
            for i, joint in enumerate(joints):
                poses[i, at] = data.oMi[joint].np[:3]
                rates[i, at] = data.v[joint].vector, data.a[joint].vector
        return poses, rates

    def joint_forces(
        self, Y: Array, V: Array, A: Array, lam: Array, t: Array, joints: Sequence[int]
    ) -> JointForces:
        """Forces of joints, loops and sleeves at n states."""
        here, closed = self.map.at(Y, V, A), self.system.closed
        poses, _ = self.placing.jacobians(here.Q)
        n, loops = len(Y), len(closed.names)
        g, f = np.empty(here.V.shape), np.empty((n, len(joints), 6))
        wrenches, sleeves = np.empty((n, loops, 6)), np.empty((n, len(closed.contacts), 3, 8))
        acting = self._acting(Y, V, t)
        for k, state in enumerate(_states(here)):
            push = {joint: x[k] for joint, x in acting.items()}
            on = closures.on_segments(closed, poses[k])
            wrenches[k], ends = closures.wrenches(on, poses[k], here.Q[k], Y[k, self._q :], lam[k])
            for joint, wrench in ends:
                own = _place(poses[k, joint]).actInv(pin.Force(wrench)).vector
                push[joint] = push.get(joint, 0.0) + own
            g[k] = self._rnea(*state, push, float(t[k]))
            for i, joint in enumerate(joints):
                f[k, i] = self.placing.data.f[joint].vector
            places = closures.sleeves_at(on, poses[k], Y[k, self._q :])
            pushed = zip(places, closed.contacts, strict=True)
            sleeves[k] = np.array(
                [place.forces(lam[k, one.rows]) for place, one in pushed]
            ).reshape(-1, 3, 8)
        if len((coupled := closed.coupled).rows):  # torques in joints, no wrenches on bodies
            g -= lam[:, coupled.rows] @ coupled.J
        r, c = self.residual(Y, V, A, lam, t)
        return JointForces(r, c, g, f, wrenches, sleeves)

    def energies(self, Y: Array, V: Array, t: Array) -> Energies:
        """Kinetic energy, and potentials of weight, links, and of springs and loads, J, (n,)."""
        here, s = self.map.at(Y, V), self.system.springs
        each = zip(_states(here), t, strict=True)
        kinetic = [0.5 * v @ self._expanded_mass(q, float(at)) @ v for (q, v, _), at in each]
        weight = [pin.computePotentialEnergy(self.model, self.placing.data, q) for q in here.Q]
        spring = 0.5 * (s.angles(Y) - s.rest) ** 2 @ s.stiffness
        if self.system.loads.present:
            spring = spring + self._loads(Y, V).energy(t)
        elastic = self.strain.energy(Y[:, self._q :])
        for row, pull in self._kinks(Y, V):
            if row < self._v:
                spring = spring + pull.energy
            else:
                elastic = elastic + pull.energy
        return Energies(np.array(kinetic), np.array(weight), elastic, spring)

    def losses(self, Y: Array, V: Array) -> Array:
        """Power that damping, friction and dampers between frames take, shape (n,), W."""
        power = self.system.dissipation(V)
        for _, pull in self._kinks(Y, V):
            power = power + pull.loss
        return power + self._loads(Y, V).dissipation() if self.system.loads.present else power

    def outward(self, y: Array) -> Array:
        """Rates at which contacts go to their rims, by velocities, (touches, nv), at y (nq,)."""
        found, at = [], self.kinematics(y[None])
        places = places_of(self, y[None], *np.zeros((2, 1, self.system.nv)))
        for one in self.system.loads.touches:
            (R,), (motion,), _ = relative_motion(one, places)
            u, d = R @ one.outward(motion[None, :3])[0][0], R @ motion[:3]
            a, b = (Frame(self.model, end).jacobian(at)[0] for end in (one.a, one.b))
            found.append(u @ (b - a)[:3] - np.cross(d, u) @ a[3:])
        return np.array(found)

    def spring_stiffness(self, y: Array) -> Array:
        """Stiffness of springs between frames along their lines, shape (nv, nv), at y (nq,)."""
        at, K = self.kinematics(y[None]), np.zeros((self.system.nv, self.system.nv))
        for spring, *ends in self.system.loads.springs:
            frames = [Frame(self.model, end) for end in ends]
            a, b = (frame.jacobian(at)[0, :3] for frame in frames)
            d = frames[1].pose(at.poses)[1][0] - frames[0].pose(at.poses)[1][0]
            # One of no length pulls by k d, as stiff across its line as along it.
            axes = d[None] / max(float(np.linalg.norm(d)), 1e-300) if spring.length else np.eye(3)
            stretch = axes @ (b - a)
            K += spring.stiffness * stretch.T @ stretch
        return K


def _slope(r: Array, weights: Array, step: float) -> Array:
    """A difference of forces (points, nv) over a step; what is round-off of them is none."""
    found = weights @ r
    found[np.abs(found) < _ROUND_OFF * np.max(np.abs(r), initial=0.0)] = 0.0
    return np.asarray(found / step)


def _states(here: Configuration) -> Iterator[tuple[Array, Array, Array]]:
    return zip(here.Q, here.V, here.A, strict=True)


def _place(pose: Array) -> pin.SE3:
    return pin.SE3(pose[:, :3], pose[:, 3])
