"""Masses that differ with the direction: what a fluid, or a guide, adds to the inertia of a frame.

With the twist v of a frame in its own axes and the diagonal M of added masses and moments, the
kinetic energy is v' M v / 2, and the body needs

    f = M a + v x* (M v)

a the spatial acceleration in the frame's axes. The second term has Munk's moment, by which a body
with two unlike masses turns broadside on. Nothing here has weight.

Source: Kirchhoff's equations of a body in an ideal fluid: Lamb, Hydrodynamics, art. 124.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.external import AddedMass
from pinflex.mechanics.expanded import Attachment
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.mechanics.coordinate_map import Configuration


@dataclass(frozen=True)
class AddedMasses:
    """Added inertias of one model.

    Attributes:
        joints: That carry them. inertia: Of each, about the joint's origin in its axes, shape
            (joints, 6, 6).
    """

    __repr__ = brief

    joints: tuple[int, ...] = ()
    inertia: Array = field(default_factory=lambda: np.zeros((0, 6, 6)))


def added_masses(given: Sequence[AddedMass], frames: Mapping[str, Attachment]) -> AddedMasses:
    """Place the described masses on a model.

    Args:
        given: From the description.
        frames: Where they are, by name.
    """
    found: dict[int, Array] = {}
    for one in given:
        at = frames[one.frame]
        back = at.placement.toActionMatrixInverse()
        own = back.T @ np.diag([*one.mass, *one.inertia]) @ back
        found[at.joint] = found.get(at.joint, np.zeros((6, 6))) + own
    return AddedMasses(tuple(found), np.array([*found.values()]).reshape(-1, 6, 6))


class AddedInertia:
    """Added inertias of one model on a workspace of Pinocchio, which every call overwrites."""

    def __init__(self, given: AddedMasses, model: pin.Model, data: pin.Data) -> None:
        self.joints = given.joints
        self._inertia, self._model, self._data = given.inertia, model, data
        self._pushed = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])

    def wrenches(self, Q: Array, V: Array, A: Array) -> Array:
        """What each needs, in its joint's frame, shape (joints, 6), N and N m.

        Args:
            Q, V, A: Coordinates, rates and accelerations, shapes (nQ,), (nV,), (nV,).
        """
        pin.forwardKinematics(self._model, self._data, Q, V, A)
        out = np.empty((len(self.joints), 6))
        for k, (joint, M) in enumerate(zip(self.joints, self._inertia, strict=True)):
            v = self._data.v[joint]
            out[k] = M @ self._data.a[joint].vector + _dual_cross(v.vector) @ (M @ v.vector)
        return out

    def take(self, local: Array, joints: Sequence[int], here: Configuration) -> None:
        """Take what they need from wrenches in the frames of some joints.

        Args:
            local: Shape (n, joints, 6). joints: Theirs among them. here: The n states.
        """
        at = [joints.index(joint) for joint in self.joints]
        states = zip(here.Q, here.V, here.A, strict=True)
        local[:, at] -= np.array([self.wrenches(*state) for state in states])

    def rnea(self, Q: Array, V: Array, A: Array) -> Array:
        """Forces of inertia and weight with those of the added masses, shape (nV,).

        Args:
            Q, V, A: Coordinates, rates and accelerations, shapes (nQ,), (nV,), (nV,).
        """
        for joint, wrench in zip(self.joints, self.wrenches(Q, V, A), strict=True):
            self._pushed[joint] = pin.Force(-wrench)
        return np.array(pin.rnea(self._model, self._data, Q, V, A, self._pushed))

    def mass(self, Q: Array) -> Array:
        """What they add to the mass matrix, shape (nV, nV)."""
        pin.computeJointJacobians(self._model, self._data, Q)
        return np.asarray(sum(J.T @ M @ J for J, M in zip(self._jacobians(), self._inertia)))  # noqa: B905

    def kinetic(self, Q: Array, V: Array) -> float:
        """Their kinetic energy, J.

        Args:
            Q, V: Coordinates and rates, shapes (nQ,), (nV,).
        """
        pin.forwardKinematics(self._model, self._data, Q, V)
        speeds = [self._data.v[joint].vector for joint in self.joints]
        return 0.5 * float(sum(v @ M @ v for v, M in zip(speeds, self._inertia, strict=True)))

    def add_derivatives(
        self, dQ: Array, dV: Array, M: Array, Q: Array, V: Array, A: Array
    ) -> tuple[Array, Array, Array]:
        """Derivatives of rnea with those of the added forces, which it takes for fixed.

        Args:
            dQ, dV, M: Of Pinocchio, shape (nV, nV) each. Q, V, A: The state.
        """
        model, data = self._model, self._data
        dQ, dV, M = np.array(dQ), np.array(dV), np.array(M)
        pin.computeForwardKinematicsDerivatives(model, data, Q, V, A)
        for joint, own in zip(self.joints, self._inertia, strict=True):
            found = pin.getJointAccelerationDerivatives(
                model, data, joint, pin.ReferenceFrame.LOCAL
            )
            v_q, a_q, a_v, J = (np.asarray(part).reshape(6, -1) for part in found)
            v = data.v[joint].vector
            swing = _dual_cross(v) @ own + _of_momentum(own @ v)
            dQ += J.T @ (own @ a_q + swing @ v_q)
            dV += J.T @ (own @ a_v + swing @ J)
            M += J.T @ own @ J
        return dQ, dV, M

    def from_ground(self, Q: Array, V: Array, A: Array) -> Array:
        """What all of them need, as a wrench about the world's origin, shape (6,).

        Args:
            Q, V, A: Coordinates, rates and accelerations, shapes (nQ,), (nV,), (nV,).
        """
        pairs = zip(self.joints, self.wrenches(Q, V, A), strict=True)
        placed = [self._data.oMi[joint].act(pin.Force(wrench)).vector for joint, wrench in pairs]
        return np.asarray(sum(placed))

    def _jacobians(self) -> list[Array]:
        local = pin.ReferenceFrame.LOCAL
        found = [pin.getJointJacobian(self._model, self._data, k, local) for k in self.joints]
        return [np.asarray(J).reshape(6, -1) for J in found]


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _dual_cross(v: Array) -> Array:
    """Matrix of v x* (.) on wrenches [f; m], shape (6, 6)."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = _skew(v[3:])
    out[3:, :3] = _skew(v[:3])
    return out


def _of_momentum(h: Array) -> Array:
    """Matrix of (.) x* h on twists [v; w], shape (6, 6)."""
    out = np.zeros((6, 6))
    out[:3, 3:] = out[3:, :3] = -_skew(h[:3])
    out[3:, 3:] = -_skew(h[3:])
    return out
