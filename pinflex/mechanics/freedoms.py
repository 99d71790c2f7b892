"""Freedoms that need no motor: loose bodies and rods that spin, a free base.

A freedom is **idle** if nothing outside hangs on it. At home, with motors, elastic joints and a
free base locked, the motions that the closures still allow span N. Idle are those in which

- no joint, no loop frame, no load and no reported frame moves from its place (they may turn in
  it), and the platform does neither;
- each moved body keeps its centre of mass, so that gravity does no work; or the centre lies nearer
  to the axis of its turn than a tenth of the distance between the supports: a rod between two
  balls is not quite straight, but no pendulum.

The spin of a rod with balls at both ends is idle, a free sphere, a balanced wheel; a pendulum, the
shaft of a governor, a door on two hinges and an open four-bar are not: their centres or joints
move. What is idle is held where home has it: the spin of a rod by one row that keeps a direction
across it perpendicular to one of its neighbour, as a universal joint does in place of a ball. That
row stays regular however far the rod swings about the direction in the neighbour, which is the one
that it swings about most. Anything else idle keeps coordinates.

A CAD's axes that should meet often miss each other by its decimals; then the spin of a rod moves
its neighbours by a thousandth of it. Where such spins are all that motors leave undetermined, they
are held too, and said to be nearly idle, with that share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray, others
from pinflex.description.loops import Loop
from pinflex.linalg import independent_rows, null_space
from pinflex.mechanics.closure import Closures
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import skew, support
from pinflex.mechanics.model.loads import Attachment
from pinflex.mechanics.model.system import Idle
from pinflex.mechanics.model.tree import coordinate_names

INDEPENDENT = 1e-8  # of the largest: as closure rows that count
_STILL = 1e-7  # of the mechanism's size, for a motion of size one: closed loops leave 1e-12
_NEARLY = 2e-3  # the same where axes that should meet miss each other, by the decimals of a CAD
_PART = 0.1  # of a spin of size one, for a body that takes part in it
_SLENDER = 0.1  # of the distance between supports: a centre of mass nearer to the axis is idle
_MASSLESS = 1e-12  # of the heaviest body
_NONE = np.zeros(0, dtype=np.intp)


@dataclass(frozen=True)
class _Piece:
    """Bodies that move as one: their joints, and where they hang on other pieces."""

    joints: tuple[int, ...]
    points: tuple[Array, ...]

    @property
    def axis(self) -> Array | None:
        """Direction between the two points that are farthest apart; None where all are one."""
        apart = np.array(self.points) - self.points[0]
        far = apart[int(np.argmax(np.linalg.norm(apart, axis=1)))]
        size = float(np.linalg.norm(far))
        return far / size if size > 1e-6 else None  # [m]

    def lever(self, point: Array) -> float:
        """Distance of a point from the axis, or from the one point that the piece hangs at."""
        away, axis = point - self.points[0], self.axis
        return float(np.linalg.norm(away if axis is None else away - axis * (axis @ away)))


class Freedoms:
    """What the closures of a rigid mechanism allow at home."""

    def __init__(self, dynamics: Equations, home: Array) -> None:
        model, frames = dynamics.model, dynamics.system.expansion.frames
        at = dynamics.kinematics(home)
        self._all, self._model, self._frames = at.J[0], model, frames
        self._poses = [pin.SE3(p[:, :3], p[:, 3]) for p in at.poses[0]]
        self._inertia_of_rows = np.abs(np.diag(dynamics.mass(home)))
        self._carried: dict[int, str] = {}
        for name, place in frames.items():
            self._carried.setdefault(place.joint, name)
        self._hinges = self._interfaces(dynamics.system.closed)
        spread = np.array([point for *_, ends in self._hinges for point in ends])
        self._size = max(float(np.max(np.ptp(spread, axis=0))), 1e-9) if len(spread) else 1.0
        self._mass = max(float(i.mass) for i in model.inertias)
        self._still = _STILL

    def idle(
        self, J: Array, locked: IntArray, placed: Sequence[Attachment], still: Attachment | None
    ) -> Idle:
        """The idle freedoms; where others are left, spins that are nearly idle are among them."""
        N = allowed(J, locked)
        exact, _ = self._idle(N, J, placed, still)
        if N.shape[1] == len(exact.spins) + len(exact.rows):
            return exact
        self._still = _NEARLY
        nearly, rows = self._idle(N, J, placed, still)
        self._still = _STILL
        if nearly.rows.size or len(nearly.spins) != N.shape[1]:
            return exact
        known = {loop.name for loop in exact.spins}
        turns = np.linalg.inv(np.array(rows) @ N)  # each spin by 1, the others by none
        names = tuple(
            loop.name
            if loop.name in known
            else f"{loop.name} (nearly: other bodies move by {self._beside(N @ turn):.1e} of it)"
            for loop, turn in zip(nearly.spins, turns.T, strict=True)
        )
        return replace(nearly, names=names)

    def _beside(self, motion: Array) -> float:
        """How far a motion moves bodies that it is not a motion of [rad, or of the size]."""
        scale = np.array([self._size] * 3 + [1.0] * 3)
        N = motion[:, None]
        twists = [self._twists(joint, N)[:, 0] / scale for joint in range(len(self._poses))]
        sizes = [float(np.abs(twist).max()) for twist in twists]
        return max(size for size in sizes if size < _PART)

    def _idle(
        self, N: Array, J: Array, placed: Sequence[Attachment], still: Attachment | None
    ) -> tuple[Idle, list[Array]]:
        """The idle freedoms among the motions N (nv, k), and the rows of the spins among them."""
        if not N.shape[1]:
            return Idle(), []
        pieces = self._pieces(N)
        N = N @ self._kept(N, pieces, placed, still)
        N = N @ null_space(self._centres(N, pieces), self._still, 1.0)
        if not N.shape[1]:
            return Idle(), []
        spins, rows = self._spins(J, N, pieces)
        rest = N @ null_space(np.array(rows).reshape(-1, len(N)) @ N, INDEPENDENT, 1.0)
        held = np.sort(independent_rows(rest, INDEPENDENT, 1.0))
        rows_named = coordinate_names(self._model)
        names = (*(loop.name for loop in spins), *(rows_named[k] for k in held))
        heavy = self._inertia_of_rows[held] > _MASSLESS * float(np.max(self._inertia_of_rows))
        return Idle(tuple(spins), held, held[heavy], _NONE, names), rows

    # What moves ------------------------------------------------------------------------------

    def _twists(self, joint: int, N: Array) -> Array:
        """World twist at the origin [v; w] of a joint's body in each motion, shape (6, k)."""
        return np.asarray((self._all * support(self._model, joint)) @ N)

    def _interfaces(self, closed: Closures) -> list[tuple[int, int, tuple[Array, Array]]]:
        """Pairs of bodies with the points in the world at which they hang on each other."""
        found = []
        for joint in range(1, len(self._poses)):
            here = self._poses[joint].translation.copy()
            found.append((int(self._model.parents[joint]), joint, (here, here)))
        half = len(closed.names)
        points = [
            self._poses[int(body)].act(frame[:, 3])
            for body, frame in zip(closed.bodies, closed.local, strict=True)
        ]
        for k in range(half):
            a, b = int(closed.bodies[k]), int(closed.bodies[half + k])
            found.append((a, b, (points[k], points[half + k])))
        return found

    def _pieces(self, N: Array) -> list[_Piece]:
        """The bodies that move in N; those that move as one, welded by a loop, in one piece."""
        twists = [self._twists(joint, N) for joint in range(len(self._poses))]
        scale = np.array([self._size] * 3 + [1.0] * 3)[:, None]
        one = list(range(len(twists)))
        for a, b, _ in self._hinges:
            if np.max(np.abs((twists[a] - twists[b]) / scale)) < self._still:
                one = [one[a] if x == one[b] else x for x in one]
        pieces = []
        for number in dict.fromkeys(one):
            joints = tuple(k for k, x in enumerate(one) if x == number)
            if np.max(np.abs(twists[joints[0]] / scale)) < self._still:
                continue
            points = tuple(
                end
                for a, b, ends in self._hinges
                if one[a] != one[b]
                for body, end in zip((a, b), ends, strict=True)
                if one[body] == number
            )
            pieces.append(_Piece(joints, points))
        return pieces

    def _shift(self, joint: int, point: Array, N: Array) -> Array:
        """Velocity of a point of a body in each motion, over the mechanism's size, (3, k)."""
        twist = self._twists(joint, N)
        return np.asarray((twist[:3] - skew(point[None])[0] @ twist[3:]) / self._size)

    def _kept(
        self,
        N: Array,
        pieces: Sequence[_Piece],
        placed: Sequence[Attachment],
        still: Attachment | None,
    ) -> Array:
        """Combinations of motions that leave attachments, frames and platform in place."""
        rows = [self._shift(piece.joints[0], x, N) for piece in pieces for x in piece.points]
        for place in placed:
            point = self._poses[place.joint].act(place.placement.translation)
            rows.append(self._shift(place.joint, point, N))
        if still is not None:
            twist = self._twists(still.joint, N)
            rows += [twist[:3] / self._size, twist[3:]]
        return null_space(np.vstack(rows), self._still, 1.0)

    def _centres(self, N: Array, pieces: Sequence[_Piece]) -> Array:
        """Velocities of the centres of mass that may not move, shape (rows, k)."""
        rows = [np.zeros((0, N.shape[1]))]
        moving = [
            piece
            for piece in pieces
            if np.max(np.abs(self._twists(piece.joints[0], N)[3:]), initial=0.0) > self._still
        ]
        for piece, supports in zip(moving, self._supports(moving), strict=True):
            masses = [float(self._model.inertias[k].mass) for k in piece.joints]
            if sum(masses) <= _MASSLESS * self._mass:
                continue
            levers = [self._poses[k].act(self._model.inertias[k].lever) for k in piece.joints]
            centre = np.average(levers, axis=0, weights=masses)
            if piece.lever(centre) > _SLENDER * _length(supports):
                rows.append(self._shift(piece.joints[0], centre, N))
        return np.vstack(rows)

    def _supports(self, moving: Sequence[_Piece]) -> list[list[Array]]:
        """For each moving piece, the points of all that hang together with it."""
        owner = {joint: k for k, piece in enumerate(moving) for joint in piece.joints}
        group = list(range(len(moving)))
        for a, b, _ in self._hinges:
            if a in owner and b in owner:
                old, new = group[owner[b]], group[owner[a]]
                group = [new if g == old else g for g in group]
        return [
            [x for piece, g in zip(moving, group, strict=True) if g == own for x in piece.points]
            for own in group
        ]

    # How it is held --------------------------------------------------------------------------

    def _spins(
        self, J: Array, N: Array, pieces: Sequence[_Piece]
    ) -> tuple[list[Loop], list[Array]]:
        """A row for each rod that spins about the line between its supports."""
        swings, every = allowed(J, _NONE), np.eye(int(self._model.nv))
        moving = {joint for piece in pieces for joint in piece.joints}
        loops: list[Loop] = []
        rows: list[Array] = []
        for piece in pieces:
            u, joint = piece.axis, self._longest(piece)
            near = int(self._model.parents[piece.joints[0]])
            while near in moving:
                near = int(self._model.parents[near])
            turn = (self._twists(joint, every) - self._twists(near, every))[3:]
            if near not in self._carried or u is None or not _adds(u @ turn, rows, N):
                continue
            across = turn @ swings
            d = _largest(across - np.outer(u, u @ across), u)
            a, b = self._carried[near], self._carried[joint]
            R_a, R_b = (self._rotation(name) for name in (a, b))
            axes = _vec(R_a.T @ d), _vec(R_b.T @ np.cross(u, d))
            loops.append(Loop(f"spin of {b}", "spin", a, b, *axes))
            rows.append(u @ turn)
        return loops, rows

    def _longest(self, piece: _Piece) -> int:
        """The body of a piece that spans most: the rod, not a hinge of the ball at its end.

        A hinge that lies along the rod at home moves as one with it there, and not elsewhere.
        """
        own: dict[int, list[Array]] = {joint: [] for joint in piece.joints}
        for a, b, ends in self._hinges:
            for body, end in zip((a, b), ends, strict=True):
                if body in own:
                    own[body].append(end)
        return max(own, key=lambda joint: round(_length(own[joint]) / self._size, 6))

    def _rotation(self, name: str) -> Array:
        place = self._frames[name]
        return np.asarray(self._poses[place.joint].rotation @ place.placement.rotation)


def allowed(J: Array, locked: IntArray) -> Array:
    """Orthonormal basis of the motions that closures and locked rows leave, shape (nv, k)."""
    nv = J.shape[1]
    passive = others(nv, locked)
    inside = null_space(J[:, passive], INDEPENDENT)
    N = np.zeros((nv, inside.shape[1]))
    N[passive] = inside
    return N


def _adds(row: Array, rows: Sequence[Array], N: Array) -> bool:
    """Whether a row takes one more of the motions N away than the others do."""
    known = np.array([*rows, row]) @ N
    return not null_space(known.T, INDEPENDENT, 1.0).shape[1]


def _length(points: Sequence[Array]) -> float:
    """Largest distance between points."""
    p = np.array(points)
    return float(np.max(np.linalg.norm(p[:, None] - p[None], axis=2), initial=0.0))


def _largest(turns: Array, u: Array) -> Array:
    """The direction across u in which turns (3, k) are largest; any one where there are none."""
    left, sigma, _ = np.linalg.svd(turns)
    if len(sigma) and sigma[0] > _STILL:
        return np.asarray(left[:, 0])
    d = np.cross(u, np.eye(3)[int(np.argmin(np.abs(u)))])
    return np.asarray(d / np.linalg.norm(d))


def _vec(x: Array) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])
