"""Pinocchio's algorithms on a whole model, at one state or at many: values go in and come out.

`pinflex.mechanics.subtrees.Subtrees` answers the same calls for models whose workspace is too large
to be made in one piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.mechanics.poses import JointPoses, columns


class Whole:
    """A model on one workspace.

    Attributes:
        model: The model. data: Its workspace, which every call overwrites.
    """

    def __init__(self, model: pin.Model, data: pin.Data) -> None:
        self.model, self.data = model, data
        self._joints, self._nV = int(model.njoints), int(model.nv)
        self._here = JointPoses(model, data)
        # Scratch of what takes wrenches: it writes whatever it then reads.
        self._pushed = pin.StdVec_Force([pin.Force.Zero() for _ in range(self._joints)])

    def poses(self, Q: Array) -> Array:
        """Poses of the joints, see `JointPoses`, shape (n, joints, 12), at Q (n, nQ)."""
        out = np.empty((len(Q), self._joints, 12))
        for k, q in enumerate(Q):
            pin.forwardKinematics(self.model, self.data, q)
            out[k] = self._here.current()
        return out

    def motions(
        self,
        Q: Array,
        V: Array,
        A: Array,
        joints: Sequence[int],
        energies: Array | None = None,
    ) -> tuple[Array, Array]:
        """Poses of all joints (n, joints, 12); of some, velocity and acceleration (n, k, 2, 6).

        Args:
            Q: Shape (n, nQ). V, A: Shape (n, nV).
            joints: The k joints whose spatial motion is wanted, in their own frames.
            energies: Filled with kinetic and potential energy [J], shape (2, n); None: not asked.
        """
        model, data, rotors = self.model, self.data, None if energies is None else self._rotors
        poses, rates = np.empty((len(Q), self._joints, 12)), np.empty((len(Q), len(joints), 2, 6))
        for k in range(len(Q)):
            pin.forwardKinematics(model, data, Q[k], V[k], A[k])
            poses[k] = self._here.current()
            for i, joint in enumerate(joints):
                rates[k, i] = data.v[joint].vector, data.a[joint].vector
            if energies is not None:
                energies[:, k] = energies_of(model, data, rotors, V[k])
        return poses, rates

    def jacobians(self, Q: Array, V: Array | None = None) -> tuple[Array, Array, Array]:
        """Poses (n, joints, 12), world Jacobians (n, 6, nV) and, with V, their rates.

        Args:
            Q, V: Coordinates and rates, shapes (n, nQ), (n, nV).
        """
        n, model, data = len(Q), self.model, self.data
        poses, J = np.empty((n, self._joints, 12)), np.empty((n, 6, self._nV))
        dJ = np.empty((0 if V is None else n, 6, self._nV))
        if V is not None:
            for k in range(n):
                pin.computeJointJacobiansTimeVariation(model, data, Q[k], V[k])
                J[k], dJ[k], poses[k] = columns(data.J), columns(data.dJ), self._here.current()
            return poses, J, dJ
        compute, here = pin.computeJointJacobians, self._here
        if not here.direct or data.J.flags.owndata:
            for k, q in enumerate(Q):
                compute(model, data, q)
                J[k], poses[k] = columns(data.J), here.current()
            return poses, J, dJ
        world, block = columns(data.J), here.block
        for k, q in enumerate(Q):  # in every iteration: as short as it can be
            compute(model, data, q)
            J[k], poses[k] = world, block  # views of what was found
        return poses, J, dJ

    def rnea(self, Q: Array, V: Array, A: Array) -> Array:
        """Generalised forces of motions, shape (n, nV).

        Args:
            Q, V, A: Coordinates, rates and accelerations, shapes (n, nQ), (n, nV), (n, nV).
        """
        model, data, rnea = self.model, self.data, pin.rnea
        g = np.empty((len(Q), self._nV))
        for k, (q, v, a) in enumerate(zip(Q, V, A, strict=True)):
            g[k] = rnea(model, data, q, v, a)
        return g

    def forces(
        self,
        Q: Array,
        V: Array,
        A: Array,
        acted: Sequence[int],
        wrenches: Array,
        joints: Sequence[int],
    ) -> tuple[Array, Array]:
        """Generalised forces (n, nV), and forces of joints in their own frames (n, k, 6).

        Args:
            Q: Shape (n, nQ). V, A: Shape (n, nV).
            acted: Joints that wrenches act on. wrenches: In their frames, shape (n, acted, 6).
            joints: The k joints whose forces are wanted.
        """
        model, data, pushed = self.model, self.data, self._pushed
        g, f = np.empty((len(Q), self._nV)), np.empty((len(Q), len(joints), 6))
        for k in range(len(Q)):
            self._push(acted, wrenches[k])
            g[k] = pin.rnea(model, data, Q[k], V[k], A[k], pushed)
            for i, joint in enumerate(joints):
                f[k, i] = data.f[joint].vector
        return g, f

    def mass(self, Q: Array) -> Array:
        """Mass matrix at one state Q (nQ,), shape (nV, nV)."""
        return np.asarray(pin.crba(self.model, self.data, Q))

    def derivatives(
        self, Q: Array, V: Array, A: Array, acted: Sequence[int], wrenches: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Of the forces by Q, V, A, shape (nV, nV) each, and the forces (nV,), at one state.

        Args:
            Q: Shape (nQ,). V, A: Shape (nV,).
            acted: Joints that wrenches act on. wrenches: In their frames, shape (acted, 6).
        """
        self._push(acted, wrenches)
        data = self.data
        found = pin.computeRNEADerivatives(self.model, data, Q, V, A, self._pushed)
        return (*found, np.array(data.tau))

    def energies(self, Q: Array, V: Array) -> tuple[Array, Array]:
        """Kinetic and potential energy, J, shape (n,).

        Args:
            Q, V: Coordinates and rates, shapes (n, nQ), (n, nV).
        """
        found = np.empty((2, len(Q)))
        model, data, rotors = self.model, self.data, self._rotors
        for k, (q, v) in enumerate(zip(Q, V, strict=True)):
            pin.forwardKinematics(model, data, q, v)
            found[:, k] = energies_of(model, data, rotors, v)
        return found[0], found[1]

    @cached_property
    def _rotors(self) -> Array:
        return rotor_energy_left_out(self.model, self.data)

    def from_ground(self, Q: Array, V: Array, A: Array) -> tuple[Array, Array]:
        """Force (3,) and moment (3,) about the origin that one motion needs, without rotors.

        Args:
            Q, V, A: Coordinates, rates and accelerations, shapes (nQ,), (nV,), (nV,).
        """
        model, data = self.model, self.data
        pin.computeCentroidalMomentumTimeVariation(model, data, Q, V, A)
        mass, center = float(pin.computeTotalMass(model)), data.com[0]
        force = data.dhg.linear - mass * model.gravity.linear
        return force, data.dhg.angular + np.cross(center, force)

    def falling(self, Q: Array) -> Array:
        """Generalised forces of a unit gravity along x, y, z, shape (3, nV), at one Q (nQ,)."""
        J = pin.jacobianCenterOfMass(self.model, self.data, Q)
        return np.asarray(sum(inertia.mass for inertia in self.model.inertias) * np.array(J))

    def _push(self, acted: Sequence[int], wrenches: Array) -> None:
        """Let wrenches (acted, 6) act in what Pinocchio evaluates next."""
        for joint, wrench in zip(acted, wrenches, strict=True):
            self._pushed[joint] = pin.Force(wrench)


def energies_of(
    model: pin.Model, data: pin.Data, rotors: Array | None, v: Array
) -> tuple[float, float]:
    """Kinetic and potential energy, J, of joints that are placed and move.

    Args:
        model: The model. data: Its workspace, after the forward kinematics of v (nV,).
        rotors: From `rotor_energy_left_out`. v: Rates.
    """
    left = 0.0 if rotors is None else float(rotors @ v**2)
    kinetic = float(pin.computeKineticEnergy(model, data))
    return kinetic + left, float(pin.computePotentialEnergy(model, data))


def rotor_energy_left_out(model: pin.Model, data: pin.Data) -> Array:
    """Half of the armature of each row that `pin.computeKineticEnergy` leaves out, shape (nv,).

    Pinocchio 4.1 does so for a revolute joint whose axis is none of x, y and z. Each row is asked
    for the energy of its unit speed, so that a Pinocchio that counts it is not counted twice.

    Args:
        model: Of the system.
        data: Its workspace, which is overwritten: another one of a large model takes a second.
    """
    found = np.zeros(model.nv)
    rows = np.flatnonzero(model.armature)
    if not len(rows):
        return found
    q = pin.neutral(model)
    whole = np.diag(pin.crba(model, data, q)) / 2
    for row in rows:
        found[row] = whole[row] - pin.computeKineticEnergy(model, data, q, np.eye(model.nv)[row])
    found[np.abs(found) < 1e-9 * whole] = 0.0  # round-off of the two sums
    return found
