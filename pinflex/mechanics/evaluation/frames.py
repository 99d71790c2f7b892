"""Frames on a system: their poses, Jacobians and coordinates, at n states."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.description.motions.laws import PLATFORM_COORDINATES
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.manifold import Manifold, skew, support
from pinflex.rotations import cross, euler_rates, zyx_angles

if TYPE_CHECKING:
    from pinflex.arrays import Array, IntArray
    from pinflex.mechanics.evaluation.equations import Equations
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.mechanics.model.loads import Attachment
    from pinflex.mechanics.reference.evaluator import Kinematics


class Frame:
    """A frame of one model: where it is, and how it moves with the coordinates."""

    def __init__(self, model: pin.Model, place: Attachment) -> None:
        self._model, self._joint, self._placement = model, place.joint, place.placement

    @cached_property
    def _support(self) -> Array:
        return support(self._model, self._joint)

    def pose(self, poses: Array) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and origins (n, 3) in the world, of joint poses (n, joints, 3, 4)."""
        turn, p = np.split(poses[:, self._joint], [3], 2)
        local = self._placement
        return turn @ local.rotation, turn @ local.translation + p[:, :, 0]

    def jacobian(self, at: Kinematics) -> Array:
        """Velocity of the origin and angular velocity, world axes, by v: shape (n, 6, nv)."""
        own, (_, p) = at.J * self._support, self.pose(at.poses)
        own[:, :3] -= skew(p) @ own[:, 3:]
        return at.here.times_map(own)


def motion_of(poses: Array, rates: Array, placement: pin.SE3) -> tuple[Array, Array, Array, Array]:
    """Of a frame: position, rotation, velocity and classical acceleration in the world."""
    turn, p = poses[:, :, :3], np.asarray(placement.translation)
    (v, w), (a, spin) = (x.reshape(-1, 2, 3).swapaxes(0, 1) for x in rates.swapaxes(0, 1))
    speed = v + cross(w, p)
    linear = a + cross(spin, p) + cross(w, speed)

    def world(*vectors: Array) -> Array:
        return np.concatenate([(turn @ x[..., None])[..., 0] for x in vectors], axis=1)

    position = turn @ p + poses[:, :, 3]
    return position, turn @ placement.rotation, world(speed, w), world(linear, spin)


def frame_poses(system: Equations, y: Array, place: Attachment) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and origins (n, 3) of a frame in the world at poses y (n, nq)."""
    return poses_of_frames(system, y, (place,))[0]


def poses_of_frames(
    system: Equations, y: Array, places: Sequence[Attachment]
) -> list[tuple[Array, Array]]:
    """Rotations (n, 3, 3) and origins (n, 3) of some frames in the world at poses y (n, nq)."""
    if (compiled := system.compiled) is None:
        poses = system.joint_poses(y)
        return [Frame(system.model, place).pose(poses) for place in places]
    found = compiled.poses(y, [place.joint for place in places])
    return [
        (at[:, :, :3] @ place.placement.rotation, at @ [*place.placement.translation, 1.0])
        for at, place in zip(found, places, strict=True)
    ]


def frame_pose(system: Equations, y: Array, place: Attachment) -> pin.SE3:
    """Pose of a frame in the world at y (nq,)."""
    R, p = Frame(system.model, place).pose(system.joint_poses(y))
    return pin.SE3(R[0], p[0])


def frame_jacobian(system: Equations, y: Array, place: Attachment) -> Array:
    """Velocity and angular velocity of a frame by velocity rows, world axes, shape (6, nv)."""
    found: Array = Frame(system.model, place).jacobian(system.kinematics(y))[0]
    return found


class PlatformCoordinates:
    """World position x y z [m] and intrinsic Z-Y-X angles rz ry rx [rad] of a frame.

    Attributes:
        names: Coordinates that are read, in order.
        turning: Which of them are angles, shape (k,). joint: That carries the frame.
    """

    def __init__(self, system: Equations, place: Attachment, names: Sequence[str]) -> None:
        for name in names:
            if name not in PLATFORM_COORDINATES:
                raise DescriptionError(
                    f"coordinates: {name}: no platform coordinate."
                    f"{nearest(name, PLATFORM_COORDINATES)}"
                )
        self.names, self.joint, self._place = tuple(names), place.joint, place
        self.turning = np.array([name.startswith("r") for name in names], dtype=bool)
        self._frame = Frame(system.model, place)
        self._columns = [PLATFORM_COORDINATES.index(name) for name in names]

    def of(self, system: Equations, y: Array) -> Array:
        """Values at y (n, nq), shape (n, k): of the compiled equations where they serve."""
        ((R, p),) = poses_of_frames(system, y, [self._place])
        return np.column_stack([p, zyx_angles(R)])[:, self._columns]

    def _every(self, poses: Array) -> Array:
        """Place and angles; the place alone where no angle is read."""
        R, p = self._frame.pose(poses)
        return np.column_stack([p, zyx_angles(R)]) if self.turning.any() else p

    def at(self, at: Kinematics) -> tuple[Array, Array]:
        """Values, shape (n, k), and Jacobian by velocity rows, shape (n, k, nv)."""
        every, J = self._every(at.poses), self._frame.jacobian(at)
        if self.turning.any():
            J[:, 3:] = np.linalg.solve(euler_rates(every[:, 3:]), J[:, 3:])
        return every[:, self._columns], J[:, self._columns]

    def bias(self, system: Equations, Y: Array, V: Array) -> Array:
        """Second rates of the coordinates at Y and V with accelerations of zero, shape (n, k)."""
        (poses,), (rates,) = system.motions(Y, V, 0.0 * V, [self.joint])
        _, turn, speed, swept = motion_of(poses, rates, self._place.placement)
        if not self.turning.any():
            return swept[:, self._columns]
        B = euler_rates(zyx_angles(turn))
        rates = np.linalg.solve(B, speed[:, 3:, None])[:, :, 0]
        z, y, x = (B[:, :, k] for k in range(3))
        turned = rates[:, :1] * rates[:, 1:2] * cross(z, y)
        turned += rates[:, 2:] * cross(rates[:, :1] * z + rates[:, 1:2] * y, x)
        swept[:, 3:] = np.linalg.solve(B, (swept[:, 3:] - turned)[:, :, None])[:, :, 0]
        return swept[:, self._columns]

    def error(self, values: Array, wanted: Array) -> Array:
        """values - wanted, angles within half a turn, shape (..., k)."""
        error = values - wanted
        turned = (error[..., self.turning] + np.pi) % (2.0 * np.pi) - np.pi
        error[..., self.turning] = turned
        return np.asarray(error)


# Closures in a motion, and their rates, of many states.

_MOVE = 1e-7  # m or rad: of a difference


def closure_motion(dynamics: Equations, Y: Array, V: Array, A: Array) -> Array:
    """Closures, and their first and second time derivatives, shape (3, n, rows)."""
    if (compiled := dynamics.compiled) is not None:
        return compiled.closure_motion(Y, V, A)
    c, J = dynamics.close(Y)
    return np.array([c, _times(J, V), _times(J, A) + dynamics.closure_bias(Y, V)])


class FrozenLinks:
    """A mechanism that moves with its links as they are bent, whichever joints its tree is made of.

    Motors move as they do in the rigid motion, and the closures of the pose at hold determine the
    passive joints. Where these cannot meet all rows (redundant ones that compliance takes up),
    links and elastic joints give way with the least elastic energy.

    With a sleeve on a bent beam rates stay those of the rigid motion: there v^2 times the curvature
    enters, which jumps between elements. Pins move with their holes: where they lie in them is what
    an equilibrium is about, and the closures that clearance leaves would let some joints go.
    """

    def __init__(self, dynamics: Equations, mechanism: Mechanism, free: IntArray) -> None:
        """Nothing is evaluated yet."""
        system, passive = mechanism.flexible, mechanism.rigid.free
        if dynamics.system.closed.n != system.closed.n:
            dynamics = type(dynamics)(system)
        self._dynamics, self._free, self._K = dynamics, passive, np.zeros((0, 0))
        if len(passive) != system.closed.n:
            self._free, springs, K = free, system.springs, system.K.copy()
            K[springs.v_at, springs.v_at] += springs.stiffness
            K[passive] = K[:, passive] = 0.0
            self._K = K[np.ix_(free, free)]

    def rates(self, Y: Array, V: Array, A: Array) -> tuple[Array, Array]:
        """Velocities and accelerations (n, nv) at poses Y (n, nq) that meet the closures there."""
        d = self._dynamics
        if not self._moving(V, A):
            return V, A
        J = d.close(Y).J
        inverse = self._inverse(J[:, :, self._free])
        V = V + self._moved(inverse, _times(J, V))
        return V, A + self._moved(inverse, _times(J, A) + d.closure_bias(Y, V))

    def stiffness(self, y: Array, v: Array, a: Array, M: Array, C: Array) -> float | Array:
        """What their change from pose to pose adds to the stiffness, shape (nv, nv).

        By differences, of round-off 1e-8: Newton asks for no more.
        """
        d, nv = self._dynamics, len(v)
        if not self._moving(v, a):
            return 0.0
        Y = Manifold(d).retract(y, _MOVE * np.eye(nv))
        V, A = np.tile(v, (nv, 1)), np.tile(a, (nv, 1))
        inverse = self._inverse(d.close(y[None]).J[:, :, self._free])
        dV = self._moved(inverse, closure_motion(d, Y, V, A)[1])
        dA = self._moved(inverse, closure_motion(d, Y, V + dV, A)[2])
        return np.asarray((C @ dV.T + M @ dA.T) / _MOVE)

    def _moving(self, v: Array, a: Array) -> bool:
        closed = self._dynamics.system.closed
        return closed.n > 0 and not closed.contacts and bool(v.any() or a.any())

    def _moved(self, inverse: Array, opening: Array) -> Array:
        """Rates of the free rows that close what opens, shape (n, nv)."""
        rates = np.zeros((len(opening), self._dynamics.system.nv))
        rates[:, self._free] = -_times(inverse, opening)
        return rates

    def _inverse(self, J: Array) -> Array:
        """Moves of the free rows that change each closure by one, shape (n, free, rows)."""
        n = len(self._K)
        if not n:
            return np.asarray(np.linalg.inv(J))
        S = np.zeros((len(J), n + J.shape[1], n + J.shape[1]))
        S[:, :n, :n], S[:, n:, :n], S[:, :n, n:] = self._K, J, J.swapaxes(1, 2)
        return np.asarray(np.linalg.inv(S)[:, :n, n:])


def _times(J: Array, V: Array) -> Array:
    """J (n, k, m) times vectors V (n, m), shape (n, k)."""
    return np.asarray((J @ V[:, :, None])[:, :, 0])
