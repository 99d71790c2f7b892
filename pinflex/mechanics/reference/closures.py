"""Closure rows c(y), written once, on frames that carry their derivatives with them.

The same rows answer what is asked by what the frames move with: with unit velocities, c and
J = dc/dy; with time, c, J v and cdd at a = 0; with unit twists of B alone, what a multiplier is as
a wrench on B. The rows are those of `pinflex.mechanics.closure`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.mechanics.kinks import Kinks, Pull
from pinflex.mechanics.manifold import skew, support
from pinflex.mechanics.reference import sleeves
from pinflex.mechanics.reference.sleeves import PAST, Jet, constant, dot

if TYPE_CHECKING:
    from pinflex.arrays import Array, IntArray
    from pinflex.description.blocks.external import FrameForce
    from pinflex.mechanics.closure import Closures
    from pinflex.mechanics.model.loads import Attachment, Loads, Touch


@dataclass(frozen=True, eq=False)
class Moves:
    """What n states move with, in m variables.

    Attributes:
        twists: Of A, then of B of every loop, at the world's origin, shape (n, 2 loops, 6, m).
        swept: Rates of these along one variable, time, shape (n, 2 loops, 6), or None.
        Q: Expanded velocities, shape (n, nV, m). eta: Elastic ones, shape (n, n_eta, m).
        A: Accelerations that belong to `swept`, shape (n, nV), or None.
    """

    twists: Array
    swept: Array | None
    Q: Array
    eta: Array
    A: Array | None = None


def by_velocities(closed: Closures, X: Array | None, J: Array, n_eta: int) -> Moves:
    """Every velocity of the n states is a variable."""
    supports = np.concatenate([closed.support_a, closed.support_b])
    twists, (n, _, nV) = J[:, None] * supports[:, None], J.shape
    if X is None:
        return Moves(twists, None, np.broadcast_to(np.eye(nV), (n, nV, nV)), np.zeros((n, 0, nV)))
    nv = X.shape[2]
    eta = np.broadcast_to(np.eye(nv)[nv - n_eta :], (n, n_eta, nv))
    return Moves(twists @ X[:, None], None, X, eta)


def by_time(closed: Closures, V: Array, A: Array, J: Array, dJ: Array, eta_rate: Array) -> Moves:
    """Time is the variable, with no accelerations in minimal coordinates."""
    supports = np.concatenate([closed.support_a, closed.support_b])
    speeds, swept = V[:, None] * supports, A[:, None] * supports  # (n, 2 loops, nV)
    twists = speeds @ J.swapaxes(1, 2)
    swept = speeds @ dJ.swapaxes(1, 2) + swept @ J.swapaxes(1, 2)
    return Moves(twists[..., None], swept, V[..., None], eta_rate[..., None], A)


def wrenches(
    closed: Closures, poses: Array, Q: Array, eta: Array, lam: Array
) -> tuple[Array, list[tuple[int, Array]]]:
    """What multipliers do to bodies at one state: how far rows change with the twist of B alone.

    Returns:
    On each B about the origin of frame b, shape (loops, 6), and about the world's origin by
    joint, A's opposite ones among them: (joint, (6,)).
    """
    loops = len(closed.names)
    twists = np.zeros((1, 2 * loops, 6, 6))
    twists[0, loops:] = np.eye(6)
    moves = Moves(twists, None, np.zeros((1, len(Q), 6)), np.zeros((1, len(eta), 6)))
    W = rows(closed, poses[None], Q[None], eta[None], moves).grad[0]
    on_b = np.zeros((loops, 6))
    np.add.at(on_b, closed.loop_of, lam[:, None] * W)
    sides = zip(closed.bodies.tolist(), [*-on_b, *on_b], strict=True)
    about_b = on_b.copy()
    about_b[:, 3:] -= np.cross(closed.frames(poses[None])[0, loops:, :, 3], on_b[:, :3])
    return about_b, [(joint, wrench) for joint, wrench in sides if joint]


def sleeves_at(closed: Closures, poses: Array, eta: Array) -> list[sleeves.Place]:
    """Where the sleeves are at one state."""
    loops, frames = len(closed.names), closed.frames(poses[None])[0].swapaxes(1, 2)
    a_b, z = constant(frames), constant(eta)
    return [sleeves.Place(one, a_b[one.loop], a_b[loops + one.loop], z) for one in closed.contacts]


def rows(closed: Closures, poses: Array, Q: Array, eta: Array, moves: Moves) -> Jet:
    """c of all rows, shape (n, rows)."""
    frames, (n, m) = _moving(closed.frames(poses), moves), (len(poses), moves.Q.shape[2])
    loops, shape = len(closed.names), (n, closed.n, m)
    out = Jet(np.zeros(shape[:2]), np.zeros(shape), np.zeros(shape))
    at: IntArray
    if len(at := closed.point_rows):
        a = closed.loop_of[at]
        apart = frames[:, loops + a, 3] - frames[:, a, 3]
        _write(out, at, dot(frames[:, a, closed.point_axes], apart))
    if len(at := closed.dot_rows):
        a = closed.loop_of[at]
        _write(out, at, dot(frames[:, a, closed.dot_a], frames[:, loops + a, closed.dot_b]))
    if len(at := closed.distance_rows):
        a, lengths = closed.loop_of[at], np.tile(closed.lengths, (n, 1))
        apart = frames[:, loops + a, 3] - frames[:, a, 3]
        _write(out, at, dot(apart, apart).plus(-(lengths**2)).over(2.0 * lengths))
    if len(at := (coupled := closed.coupled).rows):
        grad = coupled.J @ moves.Q
        bend = 0.0 * grad if moves.A is None else (moves.A @ coupled.J.T)[..., None]
        _write(out, at, Jet(coupled.value(Q), grad, bend))
    for k in range(n) if closed.contacts else ():
        z = Jet(eta[k], moves.eta[k], np.zeros((len(eta[k]), m)))
        for contact in closed.contacts:
            if not len(contact.rows):  # other loops hold all that it would
                continue
            loop = contact.loop
            sleeve = sleeves.Place(contact, frames[k, loop], frames[k, loops + loop], z)
            _write(out, (k, contact.rows), sleeve.rows())
    return out


def _write(out: Jet, at: object, found: Jet) -> None:
    """Put rows at their places."""
    key = at if isinstance(at, tuple) else (slice(None), at)
    out.value[key], out.grad[key], out.bend[key] = found.value, found.grad, found.bend


def _moving(frames: Array, moves: Moves) -> Jet:
    """Frames of the loops, (n, 2 loops, 4, 3): three axes and the origin, with the twists' rates.

    x' = w x (.), of the origin + v, and once more for the second.
    """
    columns = frames.swapaxes(2, 3)
    arms = -skew(columns.reshape(-1, 3)).reshape(*columns.shape, 3)  # of (.) x column
    v, w = moves.twists[:, :, None, :3], moves.twists[:, :, None, 3:]
    grad = arms @ w
    grad[:, :, 3:] += v
    if moves.swept is None:  # only first derivatives are asked for
        return Jet(columns, grad, np.zeros_like(grad))
    rate, spin = grad[..., 0], w[..., 0]
    bend = (arms @ moves.swept[:, :, None, 3:, None])[..., 0] + np.cross(spin, rate)
    bend[:, :, 3] += moves.swept[:, :, :3]
    return Jet(columns, grad, bend[..., None])


def on_segments(closed: Closures, poses: Array) -> Closures:
    """The closures of one state, each sleeve on the segment of its beam that it stands before.

    It has passed the root of a segment when it stands before the section there.
    """
    if not any(contact.sleeve.segments for contact in closed.contacts):
        return closed
    origins, numbers = closed.frames(poses[None])[0, :, :, 3], []
    for contact in closed.contacts:
        passed = 0
        for segment in contact.sleeve.segments[1:]:
            pose = poses[segment.root.joint].reshape(4, 3)
            axis = segment.root.placement.rotation[:, 0] @ pose[:3]
            root = segment.root.placement.translation @ pose[:3] + pose[3]
            ahead = origins[len(closed.names) + contact.loop] - root
            passed += bool(ahead @ axis >= PAST * segment.length)
        numbers.append(passed)
    return closed.on(numbers)


# Forces from outside at one configuration: loads at frames, springs and dampers between two.


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
