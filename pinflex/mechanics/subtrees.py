"""Pinocchio's algorithms on a large model, subtree by subtree: the calls of `Whole`.

What hangs on a cut rides on a free joint, which is given the pose, velocity and acceleration of the
joint that it hangs on; the wrench that it needs there acts on that joint. Subtrees of equal joints
share a workspace: every call copies what it has found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics import workspace
from pinflex.mechanics.one_by_one import falling
from pinflex.mechanics.poses import JointPoses, columns
from pinflex.mechanics.split import Rows, Subtree
from pinflex.mechanics.whole import Whole, energies_of, rotor_energy_left_out

_FREE = 6, 7  # velocities and coordinates of a free joint
_NONE = pin.Force.Zero()


@dataclass
class _Carried:
    """A joint that a subtree hangs on, at n states: what the free joint there is given."""

    n: int
    q: Array = field(init=False)
    v: Array = field(init=False)
    a: Array = field(init=False)

    def __post_init__(self) -> None:
        self.q, self.v, self.a = (np.zeros((self.n, width)) for width in (_FREE[1], *_FREE[:1] * 2))

    def keep(self, k: int, data: pin.Data, joint: int, rates: bool) -> None:
        self.q[k] = pin.SE3ToXYZQUAT(data.oMi[joint])
        if rates:
            self.v[k], self.a[k] = data.v[joint].vector, data.a[joint].vector


# A subtree at one state: its workspace, the number of the state, and q, v, a.
_Visit = tuple[Subtree, pin.Data, int, Array, Array, Array]


class Subtrees:
    """A model in parts; the calls are those of `Whole`.

    Attributes:
        model: The whole model. cut: Whether parts hang on others: then mass and derivatives, which
            couple them, are left to a workspace of the whole, where those are asked for.
    """

    def __init__(self, model: pin.Model, parts: Sequence[Subtree]) -> None:
        self.model, self._parts = model, parts
        self.cut = any(part.cut for part in parts)
        self._owned = {
            part.number: (part.model, workspace.acquire(part.model))
            for part in parts
            if part.like == part.number
        }
        self._data = [self._owned[part.like][1] for part in parts]
        self._here = {number: JointPoses(*owned) for number, owned in self._owned.items()}
        # Scratch of what takes wrenches: it writes whatever it then reads.
        self._pushed = {
            number: pin.StdVec_Force([pin.Force.Zero() for _ in range(int(owner.njoints))])
            for number, (owner, _) in self._owned.items()
        }
        self._touched: dict[int, Sequence[int]] = {}  # joints that have one there
        self._joints, self._nV = int(model.njoints), int(model.nv)
        self._at: dict[int, tuple[int, int]] = {}  # part and number there of each joint
        for part in parts:
            for here, joint in enumerate(part.joints.tolist(), start=1 + part.cut):
                self._at[joint] = part.number, here

    def __del__(self) -> None:
        for model, data in getattr(self, "_owned", {}).values():
            workspace.release(model, data)

    def _outward(
        self, Q: Array, V: Array | None = None, A: Array | None = None, rates: bool = False
    ) -> Iterator[_Visit]:
        """Every part at every state; with `rates`, what is evaluated there has velocities."""
        carried: dict[int, _Carried] = {}
        V = np.zeros((len(Q), self._nV)) if V is None else V
        A = np.zeros((len(Q), self._nV)) if A is None else A
        for part, data in zip(self._parts, self._data, strict=True):
            for _, joint in part.carriers:
                carried[joint] = _Carried(len(Q))
            q, v, a = Q[:, part.q], V[:, part.v], A[:, part.v]
            if part.cut:
                base = carried[part.parent]
                q, v, a = np.hstack([base.q, q]), np.hstack([base.v, v]), np.hstack([base.a, a])
            for k in range(len(Q)):
                yield part, data, k, q[k], v[k], a[k]
                for here, joint in part.carriers:
                    carried[joint].keep(k, data, here, rates)

    def _copy_poses(self, part: Subtree, out: Array) -> None:
        """Poses of the joints of a part into those of all, shape (joints, 12)."""
        out[part.joints] = self._here[part.like].current()[1 + part.cut :]

    def _no_poses(self, n: int) -> Array:
        out = np.zeros((n, self._joints, 12))
        out[:, 0, :9:4] = 1.0  # of the base
        return out

    def poses(self, Q: Array) -> Array:
        """Poses of the joints, see `JointPoses`, shape (n, joints, 12), at Q (n, nQ)."""
        out = self._no_poses(len(Q))
        for part, data, k, q, _, _ in self._outward(Q):
            pin.forwardKinematics(part.model, data, q)
            self._copy_poses(part, out[k])
        return out

    def motions(
        self,
        Q: Array,
        V: Array,
        A: Array,
        joints: Sequence[int],
        energies: Array | None = None,
    ) -> tuple[Array, Array]:
        """Motions of joints.

        Args:
            As `Whole.motions`.
        """
        out, rates = self._no_poses(len(Q)), np.zeros((len(Q), len(joints), 2, 6))
        wanted, rotors = self._by_part(joints), self._rotors if energies is not None else []
        if energies is not None:
            energies[:] = 0.0
        for part, data, k, q, v, a in self._outward(Q, V, A, True):
            pin.forwardKinematics(part.model, data, q, v, a)
            self._copy_poses(part, out[k])
            for i, here in wanted.get(part.number, ()):
                rates[k, i] = data.v[here].vector, data.a[here].vector
            if energies is not None:
                energies[:, k] += energies_of(part.model, data, rotors[part.number], v)
        return out, rates

    def _by_part(self, joints: Sequence[int]) -> dict[int, list[tuple[int, int]]]:
        """Place in the list and number there of each joint, by part."""
        found: dict[int, list[tuple[int, int]]] = {}
        for i, joint in enumerate(joints):
            if joint:
                number, here = self._at[int(joint)]
                found.setdefault(number, []).append((i, here))
        return found

    def jacobians(self, Q: Array, V: Array | None = None) -> tuple[Array, Array, Array]:
        """Poses, Jacobians and their rates.

        Args:
            As `Whole.jacobians`.
        """
        n, poses = len(Q), self._no_poses(len(Q))
        J, dJ = np.empty((n, 6, self._nV)), np.empty((0 if V is None else n, 6, self._nV))
        for part, data, k, q, v, _ in self._outward(Q, V, None, V is not None):
            own = _FREE[0] * part.cut
            if V is None:
                pin.computeJointJacobians(part.model, data, q)
            else:
                pin.computeJointJacobiansTimeVariation(part.model, data, q, v)
                dJ[k][:, part.v] = columns(data.dJ)[:, own:]
            J[k][:, part.v] = columns(data.J)[:, own:]
            self._copy_poses(part, poses[k])
        return poses, J, dJ

    def rnea(self, Q: Array, V: Array, A: Array) -> Array:
        """Generalised forces of motions, shape (n, nV).

        Args:
            As `Whole.rnea`.
        """
        return self.forces(Q, V, A, (), np.zeros((len(Q), 0, 6)), ())[0]

    def forces(
        self,
        Q: Array,
        V: Array,
        A: Array,
        acted: Sequence[int],
        wrenches: Array,
        joints: Sequence[int],
    ) -> tuple[Array, Array]:
        """Motions outward, then forces inward.

        Args:
            As `Whole.forces`.
        """
        visits = []
        for part, data, k, q, v, a in self._outward(Q, V, A, True):
            if part.carriers:
                pin.forwardKinematics(part.model, data, q, v, a)
            visits.append((part, data, k, q, v, a))
        n, every = len(Q), [joint for part in self._parts for _, joint in part.carriers]
        g, f = np.empty((n, self._nV)), np.zeros((n, len(joints), 6))
        pulled = {joint: np.zeros((n, 6)) for joint in every}
        pushed, wanted = self._by_part(acted), self._by_part(joints)
        for part, data, k, q, v, a in reversed(visits):
            own = _FREE[0] * part.cut
            given = [(here, wrenches[k, i]) for i, here in pushed.get(part.number, ())]
            given += [(here, -pulled[joint][k]) for here, joint in part.carriers]
            tau = pin.rnea(part.model, data, q, v, a, self._acting(part, given))
            g[k][part.v] = tau[own:]
            if part.cut:
                pulled[part.parent][k] += tau[:own]
            for i, here in wanted.get(part.number, ()):
                f[k, i] = data.f[here].vector
        return g, f

    def _acting(self, part: Subtree, given: Sequence[tuple[int, Array]]) -> pin.StdVec_Force:
        """Wrenches on joints of a part, in their frames, until the next call."""
        pushed, before = self._pushed[part.like], self._touched.get(part.like, ())
        joints = [joint for joint, _ in given]
        for joint in before:
            if joint not in joints:
                pushed[joint] = _NONE
        for k, (joint, wrench) in enumerate(given):
            if joint in joints[:k]:
                pushed[joint] += pin.Force(wrench)
            else:
                pushed[joint] = pin.Force(wrench)
        self._touched[part.like] = joints
        return pushed

    def mass(self, Q: Array) -> Array:
        """As `Whole.mass`, where nothing is cut."""
        M = np.zeros((self._nV, self._nV))
        for part, data, _, q, _, _ in self._outward(Q[None]):
            M[_block(part.v)] = pin.crba(part.model, data, q)
        return M

    def derivatives(
        self, Q: Array, V: Array, A: Array, acted: Sequence[int], wrenches: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Derivatives of the forces, where nothing is cut.

        Args:
            As `Whole.derivatives`.
        """
        found, tau = np.zeros((3, self._nV, self._nV)), np.empty(self._nV)
        pushed = self._by_part(acted)
        for part, data, _, q, v, a in self._outward(Q[None], V[None], A[None]):
            given = [(here, wrenches[i]) for i, here in pushed.get(part.number, ())]
            acting = self._acting(part, given)
            each = pin.computeRNEADerivatives(part.model, data, q, v, a, acting)
            for whole, one in zip(found, each, strict=True):
                whole[_block(part.v)] = one
            tau[part.v] = data.tau
        return found[0], found[1], found[2], tau

    def energies(self, Q: Array, V: Array) -> tuple[Array, Array]:
        """Kinetic and potential energy, J, shape (n,).

        Args:
            As `Whole.energies`.
        """
        found, rotors = np.zeros((2, len(Q))), self._rotors
        for part, data, k, q, v, _ in self._outward(Q, V, None, True):
            pin.forwardKinematics(part.model, data, q, v)
            found[:, k] += energies_of(part.model, data, rotors[part.number], v)
        return found[0], found[1]

    @cached_property
    def _rotors(self) -> list[Array]:
        pairs = zip(self._parts, self._data, strict=True)
        return [rotor_energy_left_out(part.model, data) for part, data in pairs]

    def from_ground(self, Q: Array, V: Array, A: Array) -> tuple[Array, Array]:
        """Force and moment about the origin that one motion needs.

        Args:
            As `Whole.from_ground`.
        """
        force, moment = np.zeros(3), np.zeros(3)
        for part, data, _, q, v, a in self._outward(Q[None], V[None], A[None], True):
            if part.carriers:  # what is carried wants the accelerations too
                pin.forwardKinematics(part.model, data, q, v, a)
            pin.computeCentroidalMomentumTimeVariation(part.model, data, q, v, a)
            mass = float(pin.computeTotalMass(part.model))
            push = data.dhg.linear - mass * part.model.gravity.linear
            force += push
            moment += data.dhg.angular + np.cross(data.com[0], push)
        return force, moment

    def falling(self, Q: Array) -> Array:
        """As `Whole.falling`."""
        poses, J = (x[0] for x in self.jacobians(Q[None])[:2])
        return falling(self.model, poses, J)


def _block(rows: Rows) -> tuple[Rows, Rows] | tuple[IntArray, ...]:
    """Rows and columns of a square block."""
    return (rows, rows) if isinstance(rows, slice) else np.ix_(rows, rows)


def on_model(model: pin.Model, parts: Sequence[Subtree]) -> Whole | Subtrees:
    """Pinocchio on a model, for one use: in parts, or whole where there are none.

    Args:
        model: Of the whole mechanism.
        parts: Its subtrees.
    """
    return Subtrees(model, parts) if parts else Whole(model, pin.Data(model))
