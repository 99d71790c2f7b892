"""Forces from outside at one configuration: loads at frames, springs and dampers between two."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.mechanics.kinks import Kinks, Pull
from pinflex.mechanics.poses import support

if TYPE_CHECKING:
    from pinflex.arrays import Array
    from pinflex.description.blocks.external import FrameForce
    from pinflex.mechanics.model.expanded import Attachment
    from pinflex.mechanics.model.loads import Loads, Touch


class LoadState:
    """Loads where joints are placed.

    Attributes:
        joints: That they act on.
    """

    def __init__(
        self, given: Loads, model: pin.Model, poses: Array, J: Array, kinks: Kinks
    ) -> None:
        """`poses`: of the joints, (joints, 12). `J`: their world Jacobian, (6, nV)."""
        self._given, self._J, self._kinks = given, J, kinks
        ends = [place for _, place in given.forces]
        ends += [place for _, a, b in given.springs for place in (a, b)]
        ends += [place for one in given.touches for place in (one.a, one.b)]
        self.joints = list(dict.fromkeys(place.joint for place in ends))
        self._jacobian = {joint: J * support(model, joint) for joint in self.joints}
        self._pose = {joint: poses[joint].reshape(4, 3) for joint in self.joints}

    def wrenches(self, V: Array, t: float) -> dict[int, Array]:
        """World wrench [force; moment about the origin] by joint, at time t (s)."""
        total = {joint: np.zeros(6) for joint in self.joints}
        for force, place in self._given.forces:
            p, F, M = self._load(force, place, t)
            total[place.joint] += np.concatenate([F, np.cross(p, F) + M])
        for k, (_, a, b) in enumerate(self._given.springs):
            p_a, d, length = self._line(a, b)
            u = d / max(length, 1e-300)
            pull = self._pull(k, length, self._rate(a, b, V)).force
            wrench = pull * np.concatenate([u, np.cross(p_a, u)])
            total[a.joint] += wrench
            total[b.joint] -= wrench
        for one in self._given.touches:
            R, motion = self._seen(one, V)
            found, p = one.force(motion, self._kinks), self._point(one.b)
            F, M = R @ found.force[0], R @ found.moment[0]
            wrench = np.concatenate([F, np.cross(p, F) + M])
            total[one.b.joint] += wrench
            total[one.a.joint] -= wrench
        return total

    def generalized(self, V: Array, t: float) -> Array:
        """Generalised forces J' W at time t (s), shape (nV,)."""
        each = (wrench @ self._jacobian[joint] for joint, wrench in self.wrenches(V, t).items())
        return np.asarray(sum(each, np.zeros(self._J.shape[1])))

    def energy(self, t: float) -> float:
        """Potential of springs and of constant forces at time t (s), J."""
        energy = 0.0
        for force, place in self._given.forces:
            if force.potential:
                p, F, _ = self._load(force, place, t)
                energy -= float(F @ p)
        for k, (_, a, b) in enumerate(self._given.springs):
            energy += float(self._pull(k, self._line(a, b)[2], 0.0).energy)
        still = np.zeros(self._J.shape[1])
        for one in self._given.touches:
            energy += float(one.force(self._seen(one, still)[1], self._kinks).energy[0])
        return energy

    def dissipation(self, V: Array) -> float:
        """Power that the dampers take, W."""
        dampers = ((k, a, b) for k, (s, a, b) in enumerate(self._given.springs) if s.damper)
        damped = sum(
            float(self._pull(k, self._line(a, b)[2], self._rate(a, b, V)).loss)
            for k, a, b in dampers
        )
        touched = (one.force(self._seen(one, V)[1], self._kinks) for one in self._given.touches)
        return damped + sum(float(found.loss[0]) for found in touched)

    def _pull(self, spring: int, length: float, rate: float) -> Pull:
        """Of a spring between frames, straight or of pieces."""
        law, kink = self._given.springs[spring][0], self._kinks.of_spring(spring)
        x = length - law.length
        if kink >= 0:
            return self._kinks.pull(kink, x, rate)
        k, c = law.stiffness, law.damper
        return Pull(*map(np.asarray, (k * x + c * rate, k, c, 0.5 * k * x**2, c * rate**2)))

    def stiffness(self, times_map: Callable[[Array], Array]) -> Array:
        """Stiffness of the springs along their lines, by the velocities of a map, (nv, nv)."""
        rows = []
        for spring, a, b in self._given.springs:
            _, d, length = self._line(a, b)
            # One of no length pulls by k d, as stiff across its line as along it.
            axes = (d / max(length, 1e-300))[None] if spring.length else np.eye(3)
            rows.append(np.sqrt(spring.stiffness) * axes @ (self._moves(b) - self._moves(a)))
        stretch = times_map(np.concatenate([np.zeros((0, self._J.shape[1])), *rows]))
        return np.asarray(stretch.T @ stretch)

    def _load(self, force: FrameForce, place: Attachment, t: float) -> tuple[Array, Array, Array]:
        """Point, force and moment in the world."""
        scale = force.scale(t)
        F, M = scale * np.array(force.force), scale * np.array(force.moment)
        if force.follower:
            R = self._pose[place.joint][:3].T @ place.placement.rotation
            F, M = R @ F, R @ M
        return self._point(place), F, M

    def _point(self, place: Attachment) -> Array:
        pose = self._pose[place.joint]
        return np.asarray(place.placement.translation @ pose[:3] + pose[3])

    def _moves(self, place: Attachment) -> Array:
        """Velocity of a point by the expanded velocities, shape (3, nV)."""
        J = self._jacobian[place.joint]
        return J[:3] + np.cross(J[3:], self._point(place)[:, None], axis=0)

    def _line(self, a: Attachment, b: Attachment) -> tuple[Array, Array, float]:
        """Point a, the way from a to b, and its length."""
        p_a = self._point(a)
        d = self._point(b) - p_a
        return p_a, d, float(np.linalg.norm(d))

    def outward(self) -> Array:
        """Rates at which contacts go towards their rims, by velocities, shape (touches, nV)."""
        rows = []
        for one in self._given.touches:
            R, seen = self._seen(one, np.zeros(self._J.shape[1]))
            u, d = R @ one.outward(seen[:, :3])[0][0], R @ seen[0, :3]
            moves = self._moves(one.b) - self._moves(one.a)
            rows.append(u @ moves - np.cross(d, u) @ self._jacobian[one.a.joint][3:])
        return np.array(rows)

    def _seen(self, one: Touch, V: Array) -> tuple[Array, Array]:
        """Axes of A, and the motion (1, 9) of B as A sees it."""
        R = self._pose[one.a.joint][:3].T
        d = self._point(one.b) - self._point(one.a)
        spin_a, spin_b = (self._jacobian[end.joint][3:] @ V for end in (one.a, one.b))
        way = (self._moves(one.b) - self._moves(one.a)) @ V - np.cross(spin_a, d)
        return R, np.concatenate([d @ R, way @ R, (spin_b - spin_a) @ R])[None]

    def _rate(self, a: Attachment, b: Attachment, V: Array) -> float:
        """Rate of the distance from a to b, m/s."""
        _, d, length = self._line(a, b)
        return float(d @ (self._moves(b) - self._moves(a)) @ V) / max(length, 1e-300)
