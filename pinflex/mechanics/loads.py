"""Forces from outside: dead or following loads at a frame, springs and dampers between two frames.

Present only where a scene has them. A load is a world wrench W on a body; the residual gets -J' W,
and the tangent what Pinocchio's derivatives with fixed local forces do not see of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.external import FrameForce, FrameSpring
from pinflex.description.frames import WORLD
from pinflex.errors import AssemblyError
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.poses import skew, support

Times = Callable[[Array], Array]

_MEET = 1e-9  # [m], far below what a drawing says


@dataclass(frozen=True)
class Loads:
    """Loads and springs of one model, with the frames they act on.

    Attributes:
        forces: Loads with their frame. springs: Springs with both frames.
    """

    forces: tuple[tuple[FrameForce, Attachment], ...]
    springs: tuple[tuple[FrameSpring, Attachment, Attachment], ...]

    @property
    def present(self) -> bool:
        """Whether there is anything."""
        return bool(self.forces or self.springs)

    @property
    def timed(self) -> bool:
        """Whether a load starts, ends or ramps in time."""
        return any(f.timed for f, _ in self.forces)


def loads(
    forces: Sequence[FrameForce], springs: Sequence[FrameSpring], frames: Mapping[str, Attachment]
) -> Loads:
    """Place the described loads and springs on a model.

    Args:
        forces: Forces and moments at frames.
        springs: Springs and dampers between frames.
        frames: Where each frame sits in the model.
    """
    return Loads(
        tuple((f, frames[f.frame]) for f in forces),
        tuple((s, _end(s, s.frame_a, frames), _end(s, s.frame_b, frames)) for s in springs),
    )


def _end(spring: FrameSpring, name: str, frames: Mapping[str, Attachment]) -> Attachment:
    """Where a spring is held: a frame, or a point of the ground."""
    if spring.at is None or name != WORLD:
        return frames[name]
    return Attachment(0, pin.SE3(np.eye(3), np.array(spring.at)))


def require_apart(given: Loads, model: pin.Model, home: Array, where: str) -> None:
    """Refuse a spring whose ends meet at home and that has a length or a damper: along which line?

    Raises:
        AssemblyError: Such a spring, with the way out.
    """
    if not given.springs:
        return
    data = model.createData()
    pin.forwardKinematics(model, data, home)
    for spring, a, b in given.springs:
        ends = [data.oMi[x.joint].act(x.placement.translation) for x in (a, b)]
        if np.linalg.norm(ends[1] - ends[0]) > _MEET or not (spring.length or spring.damper):
            continue
        key = "length" if spring.length else "damper"
        raise AssemblyError(
            f"{where}: springs.{spring.name}: its ends {spring.frame_a} and {spring.frame_b} meet "
            f"at home, so its {key} has no direction. Leave out {key} (a spring of length 0 pulls "
            "its ends together), or move one end."
        )


class LoadRows:
    """Loads of one model, ready to be evaluated: with the velocity rows that move their joints."""

    def __init__(self, given: Loads, model: pin.Model) -> None:
        self.given = given
        self.support = {
            place.joint: support(model, place.joint)
            for places in [(p,) for _, p in given.forces] + [(a, b) for _, a, b in given.springs]
            for place in places
        }

    def at(self, poses: Array, J: Array) -> LoadState:
        """The loads at joint poses (joints, 12), see `JointPoses`, and world Jacobians (6, nV).

        Args:
            poses: Joint poses, shape (joints, 12), see `JointPoses`.
            J: World Jacobian, shape (6, nV).
        """
        return LoadState(self, poses, J)


class LoadState:
    """Loads at one configuration: a value, made by `LoadRows.at`."""

    def __init__(self, rows: LoadRows, poses: Array, J: Array) -> None:
        self._given, self._support, self._J = rows.given, rows.support, J
        self._pose = {
            joint: (poses[joint, :9].reshape(3, 3).T, poses[joint, 9:]) for joint in rows.support
        }

    def wrenches(self, V: Array, t: float) -> dict[int, Array]:
        """World wrench [force; moment about the origin] by joint, at time t (s).

        Args:
            V: Expanded velocity, shape (nV,): dampers act against it.
            t: Time [s].
        """
        total = {joint: np.zeros(6) for joint in self._support}
        for force, place in self._given.forces:
            p, F, M = self._load(force, place, t)
            total[place.joint][:3] += F
            total[place.joint][3:] += np.cross(p, F) + M
        for spring, a, b in self._given.springs:
            p_a, p_b = self._point(a), self._point(b)
            _, u, pull, _ = self._tension(spring, a, b, p_a, p_b, V)
            wrench = pull * np.concatenate([u, np.cross(p_a, u)])
            total[a.joint] += wrench
            total[b.joint] -= wrench
        return total

    def generalized(self, V: Array, t: float) -> Array:
        """Generalised forces J' W at time t (s), shape (nV,).

        Args:
            V: Expanded velocity, shape (nV,).
            t: Time [s].
        """
        f = np.zeros(self._J.shape[1])
        for joint, wrench in self.wrenches(V, t).items():
            f += self._support[joint] * (wrench @ self._J)
        return f

    def energy(self, t: float) -> float:
        """Potential of springs and of constant forces at time t (s), J."""
        energy = 0.0
        for force, place in self._given.forces:
            if force.potential:
                p, F, _ = self._load(force, place, t)
                energy -= float(F @ p)
        for spring, a, b in self._given.springs:
            length = float(np.linalg.norm(self._point(b) - self._point(a)))
            energy += 0.5 * spring.stiffness * (length - spring.length) ** 2
        return energy

    def dissipation(self, V: Array) -> float:
        """Power that the dampers take, W."""
        return sum(
            spring.damper * self._tension(spring, a, b, self._point(a), self._point(b), V)[3] ** 2
            for spring, a, b in self._given.springs
        )

    def tangent(self, times_map: Times, t: float, w_v: float, w_y: float) -> Array:
        """w_v d/dv + w_y d/dy of -J' W, without what moves along with the bodies, (nv, nv).

        The change of a damper's direction with its speed is left out (zero at rest).

        Args:
            times_map: Takes rows (k, nV) of expanded to rows (k, nv) of minimal velocities.
            t: Time [s].
            w_v: Weight of the derivative by velocity.
            w_y: Weight of the derivative by position.
        """
        J = self._J
        lifted = {joint: times_map(J * mask) for joint, mask in self._support.items()}
        width = next(iter(lifted.values())).shape[1]
        out = np.zeros((width, width))
        for force, place in self._given.forces:
            if force.follower or not w_y:
                continue
            p, F, M = self._load(force, place, t)
            E = np.zeros((6, 6))
            f, arm, m = (skew(x[None])[0] for x in (F, p, M))
            E[:3, 3:], E[3:, 3:] = f, arm @ f + m
            body = lifted[place.joint]
            out -= w_y * (body.T @ E @ body)
        for spring, a, b in self._given.springs:
            out -= self._spring_tangent(spring, a, b, lifted, w_v, w_y)
        return out

    def stiffness(self, times_map: Times) -> Array:
        """Stiffness of the springs along their lines, shape (nv, nv)."""
        J = self._J
        rows = []
        for spring, a, b in self._given.springs:
            p_a, p_b = self._point(a), self._point(b)
            along = (p_b - p_a) / max(float(np.linalg.norm(p_b - p_a)), 1e-300)
            # One of no length pulls by k d, as stiff across its line as along it.
            for u in [along] if spring.length else np.eye(3):
                apart = np.concatenate([u, np.cross(p_b, u)]) @ (J * self._support[b.joint])
                apart -= np.concatenate([u, np.cross(p_a, u)]) @ (J * self._support[a.joint])
                rows.append(np.sqrt(spring.stiffness) * apart)
        stretch = times_map(np.array(rows))
        return np.asarray(stretch.T @ stretch)

    def _spring_tangent(
        self,
        spring: FrameSpring,
        a: Attachment,
        b: Attachment,
        lifted: Mapping[int, Array],
        w_v: float,
        w_y: float,
    ) -> Array:
        p_a, p_b = self._point(a), self._point(b)
        length, u, pull, _ = self._tension(spring, a, b, p_a, p_b, None)
        d = p_b - p_a
        per_length = (
            pull / length if length else spring.stiffness
        )  # refused unless it has no length
        J_a, J_b = lifted[a.joint], lifted[b.joint]
        point_a = np.hstack([np.eye(3), -skew(p_a[None])[0]]) @ J_a
        point_b = np.hstack([np.eye(3), -skew(p_b[None])[0]]) @ J_b
        apart = point_b - point_a
        stretch = u @ apart
        stiffer = w_y * (spring.stiffness - per_length) + w_v * spring.damper
        gain = np.outer(u, stiffer * stretch)
        total = np.zeros((J_a.shape[1],) * 2)
        for J, p, sign in ((J_a, p_a, 1.0), (J_b, p_b, -1.0)):
            # Direction of the force, less the turn that the body brings along by itself.
            line = gain + w_y * per_length * (apart + skew(d[None])[0] @ J[3:])
            total += sign * (J.T @ np.vstack([line, skew(p[None])[0] @ line]))
        return total

    def _load(self, force: FrameForce, place: Attachment, t: float) -> tuple[Array, Array, Array]:
        scale = force.scale(t)
        F, M = scale * np.array(force.force), scale * np.array(force.moment)
        if force.follower:
            R = self._pose[place.joint][0] @ place.placement.rotation
            F, M = R @ F, R @ M
        return self._point(place), F, M

    def _point(self, place: Attachment) -> Array:
        R, p = self._pose[place.joint]
        return np.asarray(R @ place.placement.translation + p)

    def _tension(
        self,
        spring: FrameSpring,
        a: Attachment,
        b: Attachment,
        p_a: Array,
        p_b: Array,
        V: Array | None,
    ) -> tuple[float, Array, float, float]:
        """Length, direction a to b, pull (tension positive) and rate of stretch."""
        d = p_b - p_a
        length = float(np.linalg.norm(d))
        u = d / max(length, 1e-300)
        rate = 0.0
        if V is not None and spring.damper:
            twist_a = self._J @ (self._support[a.joint] * V)
            twist_b = self._J @ (self._support[b.joint] * V)
            v_a = twist_a[:3] + np.cross(twist_a[3:], p_a)
            v_b = twist_b[:3] + np.cross(twist_b[3:], p_b)
            rate = float(u @ (v_b - v_a))
        pull = spring.stiffness * (length - spring.length) + spring.damper * rate
        return length, u, pull, rate
