"""Loop closures: residual c, Jacobian J and their exact derivatives, all loops in one batch.

Every kind is made of three sorts of rows between frame a (on body A) and frame b (on body B):

    point      c = u . (p_b - p_a)                  u an axis of a
    direction  c = e_a . e_b                        an axis of a, an axis of b
    distance   c = (|p_b - p_a|^2 - l^2) / (2 l)

and couplings of joints, without frames (`pinflex.description.blocks.joints`):

    coupling   c = q_a - ratio q_b - offset

A sleeve on a flexible beam (`pinflex.mechanics.model.slider`) adds rows that also hold its elastic
coordinates.

Each row is W (twist of B - twist of A), twists taken at the world origin, so with J the world
Jacobians of Pinocchio the closure Jacobian is (W J) times the difference of the bodies' supports.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.blocks.external import WORLD
from pinflex.description.blocks.joints import Coupling
from pinflex.description.loops import ALONG, TURNED, Loop, Pairs, loop_kind
from pinflex.mechanics.manifold import support
from pinflex.mechanics.model.loads import (
    COUPLING,
    DIRECTION,
    DISTANCE,
    POINT,
    SLEEVE,
    Attachment,
    gear_name,
)
from pinflex.rotations import axis_frame
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.mechanics.evaluation.equations import Equations
    from pinflex.mechanics.model.slider import Sleeve


_AXES = "xyz"
LENGTHS = 1e-12  # [m] below which a length is none
_NOWHERE = Attachment(0, pin.SE3.Identity())


@frozen
class CoupledRows:
    """Rows c = A Q[at] - offset of an (expanded) model.

    Attributes:
        rows: Closure rows, shape (k,).
        at: Places in Q of the joints that are in a coupling, shape (joints,).
        A: Factors of their coordinates, shape (k, joints).
        offset: Shape (k,).
        J: dc/dQ, shape (k, nV).
    """

    rows: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    at: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    A: Array = field(default_factory=lambda: np.zeros((0, 0)))
    offset: Array = field(default_factory=lambda: np.zeros(0))
    J: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def value(self, Q: Array) -> Array:
        """c at configurations Q (n, nQ), shape (n, k)."""
        return np.asarray(Q[:, self.at] @ self.A.T - self.offset)

    def select(self, renumber: IntArray) -> CoupledRows:
        """Those whose new number is not -1."""
        k = renumber[self.rows] >= 0
        return CoupledRows(renumber[self.rows[k]], self.at, self.A[k], self.offset[k], self.J[k])


@dataclass(frozen=True, eq=False)
class Contact:
    """The rows of one sleeve among all closure rows.

    Attributes:
        sleeve: What it holds. loop: Its number. rows: One for each of the sleeve's sorts.
        supports: 1 where a velocity row moves a segment's root, shape (segments, nV).
        on: Segment that the rows are written for.
    """

    sleeve: Sleeve
    loop: int
    rows: IntArray
    supports: Array | None = None
    on: int = 0

    def select(self, renumber: IntArray) -> Contact:
        """The same with the rows kept; `renumber` holds -1 for the others."""
        kept = renumber[self.rows] >= 0
        sorts = tuple(s for s, keep in zip(self.sleeve.sorts, kept, strict=True) if keep)
        sleeve = replace(self.sleeve, sorts=sorts)
        return replace(self, sleeve=sleeve, rows=renumber[self.rows[kept]])


@frozen
class Closures:
    """The loop closures of one (rigid or expanded) model.

    Attributes:
        names, kinds: One per loop.
        labels: One per row, "loop: what is held".
        loop_of, sorts: Loop and sort of each row.
        a, b: Axes that rows of points (a) and directions use, else 0.
        lengths: Of distances [m], else 1.
        bodies: Joints of A then B, shape (2 loops,).
        local: Frames a then b in their joints, [R | p], shape (2 loops, 3, 4).
        contacts: Rows of sleeves on flexible beams.
        coupled: Rows of couplings, with the coordinates and numbers in them.
        support_a, support_b: 1 where a velocity row moves the body, shape (loops, nV).
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    labels: tuple[str, ...]
    loop_of: IntArray
    sorts: IntArray
    a: IntArray
    b: IntArray
    lengths: Array
    bodies: IntArray
    local: Array
    support_a: Array
    support_b: Array
    contacts: tuple[Contact, ...] = ()
    coupled: CoupledRows = field(default_factory=CoupledRows)

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.labels)

    def of(self, sort: int, loop: int | None = None) -> IntArray:
        """Rows of a sort, of one loop or of all."""
        rows = np.flatnonzero(self.sorts == sort)
        return rows if loop is None else rows[self.loop_of[rows] == loop]

    @cached_property
    def row_mask(self) -> Array:
        """support_b - support_a of each row's loop, shape (rows, nV)."""
        found: Array = (self.support_b - self.support_a)[self.loop_of]
        return found

    @property
    def joints(self) -> set[int]:
        """Joints that the loops act on, with the roots of all segments under sleeves."""
        roots = [s.root.joint for one in self.contacts for s in one.sleeve.segments]
        return {*self.bodies.tolist(), *roots}

    def frames(self, poses: Array) -> Array:
        """Frames [R | p] of A, then of B in the world, shape (n, 2 loops, 3, 4)."""
        R, p = np.split(poses[:, self.bodies], [3], 3)
        found: Array = R @ self.local
        found[..., 3:] += p
        return found

    def on(self, segments: Sequence[int]) -> Closures:
        """The same rows with each sleeve on a segment of its beam, by its number."""
        bodies, local, support_a = self.bodies.copy(), self.local.copy(), self.support_a.copy()
        contacts = list(self.contacts)
        for k, (contact, number) in enumerate(zip(contacts, segments, strict=True)):
            if contact.supports is None:
                continue
            root, loop = contact.sleeve.segments[number].root, contact.loop
            bodies[loop], support_a[loop] = root.joint, contact.supports[number]
            local[loop, :, :3], local[loop, :, 3] = (
                root.placement.rotation, root.placement.translation,
            )  # fmt: skip
            contacts[k] = replace(contact, on=number)
        return replace(
            self,
            bodies=bodies,
            local=local,
            support_a=support_a,
            contacts=tuple(contacts),
        )

    def select(self, rows: Sequence[int] | IntArray) -> Closures:
        """The same loops with some rows only (the independent ones)."""
        rows = np.asarray(rows, dtype=np.intp)
        renumber = np.full(self.n, -1, dtype=np.intp)
        renumber[rows] = np.arange(len(rows))
        return replace(
            self,
            labels=tuple(self.labels[r] for r in rows),
            loop_of=self.loop_of[rows],
            sorts=self.sorts[rows],
            a=self.a[rows],
            b=self.b[rows],
            lengths=self.lengths[rows],
            contacts=tuple(contact.select(renumber) for contact in self.contacts),
            coupled=self.coupled.select(renumber),
        )


def closures(
    loops: Sequence[Loop],
    frames: Mapping[str, Attachment],
    model: pin.Model,
    sleeves: Mapping[str, Sleeve] | None = None,
    couplings: Sequence[Coupling] = (),
    ground: Mapping[str, pin.SE3] | None = None,
) -> Closures:
    """All rows of the loops and couplings of a description on a model, redundant ones included."""
    sleeves, ground = sleeves or {}, ground or {}
    loops = (*(Loop(f"coupling of {one.joint}", "coupling", "", "") for one in couplings), *loops)
    ends = [_ends(loop, frames, sleeves.get(loop.name), ground.get(loop.name)) for loop in loops]
    rows = [(k, row) for k, loop in enumerate(loops) for row in _rows(loop, sleeves)]
    numbers = [(k, row.sort, row.a, row.b) for k, row in rows]
    loop_of, sorts, a, b = np.array(numbers, dtype=np.intp).reshape(-1, 4).T.copy()
    sides = [e[0] for e in ends] + [e[1] for e in ends]
    turns = [*map(_turn_a, loops), *map(_turn_b, loops)]
    support_a, support_b = _supports(model, sides).reshape(2, len(loops), int(model.nv))
    found = Closures(
        names=tuple(loop.name for loop in loops),
        kinds=tuple(loop.kind for loop in loops),
        labels=tuple(row.label for _, row in rows),
        loop_of=loop_of,
        sorts=sorts,
        a=a,
        b=b,
        lengths=np.array([row.length for _, row in rows], dtype=float),
        bodies=np.array([s.joint for s in sides], dtype=np.intp),
        local=_local(sides, turns),
        support_a=support_a,
        support_b=support_b,
        coupled=_coupled(couplings, model),
    )
    contacts = (
        _contact(sleeves[loop.name], k, found.of(SLEEVE, k), model)
        for k, loop in enumerate(loops)
        if loop.kind == "slider"
    )
    return replace(found, contacts=tuple(contacts))


def _coupled(couplings: Sequence[Coupling], model: pin.Model) -> CoupledRows:
    """The first rows: one for each coupling; a joint whose gear gives way moves by both."""
    if not couplings:
        return CoupledRows()
    factors = np.zeros((len(couplings), int(model.njoints)))
    for row, one in enumerate(couplings):
        for name, factor in ((one.joint, 1.0), (one.leader, -one.ratio)):
            parts = () if name is None else (name, gear_name(name))
            for part in filter(model.existJointName, parts):
                factors[row, model.getJointId(part)] = factor
    used = np.flatnonzero(np.any(factors != 0.0, axis=0))
    A, J = factors[:, used], np.zeros((len(couplings), int(model.nv)))
    J[:, [model.joints[int(k)].idx_v for k in used]] = A
    at = np.array([model.joints[int(k)].idx_q for k in used], dtype=np.intp)
    offset = np.array([one.offset for one in couplings])
    return CoupledRows(np.arange(len(couplings)), at, A, offset, J)


def _local(sides: Sequence[Attachment], turns: Sequence[Array]) -> Array:
    """Frames [R | p] of the sides in their joints, turned, shape (sides, 3, 4)."""
    local = np.zeros((len(sides), 3, 4))
    for k, (end, turn) in enumerate(zip(sides, turns, strict=True)):
        local[k, :, :3] = end.placement.rotation @ turn
        local[k, :, 3] = end.placement.translation
    return local


def _supports(model: pin.Model, sides: Sequence[Attachment]) -> Array:
    """1 where a velocity row moves a side, shape (sides, nV)."""
    found = [support(model, side.joint) for side in sides]
    return np.array(found).reshape(len(sides), int(model.nv))


class _Row(NamedTuple):
    """A row of a loop: its name, its sort, and axes or length [m] of it."""

    label: str
    sort: int
    a: int = 0
    b: int = 0
    length: float = 1.0


def _rows(loop: Loop, sleeves: Mapping[str, Sleeve]) -> Iterator[_Row]:
    """The rows that a loop holds."""
    kind = loop_kind(loop.kind)
    for axis in kind.points:
        yield _Row(f"{loop.name}: position along {_AXES[axis]}", POINT, axis)
    for a, b in kind.directions:
        about = _AXES[3 - a - b] if a != b else _AXES[a]
        yield _Row(f"{loop.name}: rotation about {about}", DIRECTION, a, b)
    if loop.kind == "coupling":
        yield _Row(f"{loop.name}: coupling", COUPLING)
    if loop.kind == "distance":
        length = np.nan if loop.length is None else loop.length
        yield _Row(f"{loop.name}: distance", DISTANCE, length=length)
    if loop.kind == "slider":
        for label in sleeves[loop.name].labels(loop.name):
            yield _Row(label, SLEEVE)


def _contact(sleeve: Sleeve, loop: int, rows: IntArray, model: pin.Model) -> Contact:
    """The rows of a sleeve, with what moves the segments under it."""
    roots = [segment.root for segment in sleeve.segments]
    return Contact(sleeve, loop, rows, _supports(model, roots) if roots else None)


def _turn_a(loop: Loop) -> Array:
    """Frame a in its link: its z is the axis of the loop, its x where a slider has play."""
    if loop.across is not None:
        return np.column_stack([loop.across, np.cross(loop.axis, loop.across), loop.axis])
    return axis_frame(loop.axis, None)


def _turn_b(loop: Loop) -> Array:
    """Frame b in its link; a universal joint holds a's axis (z) perpendicular to b's (x here)."""
    if "axis_b" in loop_kind(loop.kind).keys:
        return axis_frame(None, loop.axis_b)
    return _turn_a(loop)


def _ends(
    loop: Loop,
    frames: Mapping[str, Attachment],
    sleeve: Sleeve | None,
    ground: pin.SE3 | None,
) -> tuple[Attachment, Attachment]:
    """Both frames of a loop; those of a slider are turned into that of its beam."""
    if loop.kind == "coupling":
        return _NOWHERE, _NOWHERE
    if ground is not None:
        frames = {**frames, WORLD: Attachment(0, ground)}
    here, other = frames[loop.frame_a], frames[loop.frame_b]
    if sleeve is None:
        return here, other
    beam = sleeve.placement
    along = other.placement * pin.SE3(beam.rotation, np.zeros(3))
    return Attachment(here.joint, here.placement * beam), Attachment(other.joint, along)


# The closures as a search wants them: angles instead of their sines, everything in metres.
#
# The rows above are sines of small angles, exact and cheap near a closed pose; far from one a sine
# also vanishes at half a turn. Here the rotation of frame b against frame a
#
#     TURNED (weld)          r = log(R_a' R_b)                    the rotation vector, |r| <= pi
#     ALONG (revolute)       r = theta (n . x_a, n . y_a) ,       theta the angle from axis to axis
#     one pair (universal)   r = asin(e_a . e_b)                  the angle short of a right one
#
# is zero only where the frames fit. Points, distances and sleeves keep their rows. A rotation
# counts as the path that it makes at the distance `length`, so that metres and radians weigh alike.

_STRAIGHT = 1e-9  # sine of the angle of two axes below which they count as one line


class LogClosure:
    """c and J of one system with rotations as angles, workspace included."""

    def __init__(self, dynamics: Equations, length: float) -> None:
        """`length` (m) weighs the rotations: the size of the mechanism."""
        self.dynamics, self.length = dynamics, length
        closed: Closures = dynamics.system.closed
        turns = ((k, kind, closed.of(DIRECTION, k)) for k, kind in enumerate(closed.kinds))
        self._turns = [turn for turn in turns if len(turn[2])]
        # -1 where two axes are to point against each other
        self.signs = np.ones(len(closed.names))

    def _frames(self, poses: Array) -> list[Array]:
        """Rotations of the frames of the loops, (loops, 3, 3) each, at one state's joint poses."""
        return np.split(self.dynamics.system.closed.frames(poses)[0, :, :, :3], 2)

    def axes(self, pose: Array) -> Array:
        """Cosine of the angle of the two axes of each loop (1 where it has none), at a pose."""
        closed = self.dynamics.system.closed
        a, b = self._frames(self.dynamics.joint_poses(pose))
        cosines = (a[:, :, 2] * b[:, :, 2]).sum(axis=1)
        return np.where([_holds(kind) == ALONG for kind in closed.kinds], cosines, 1.0)

    def twisted(self, pose: Array) -> bool:
        """Whether a weld is turned by half a turn at a pose: there its rows vanish, too."""
        closed = self.dynamics.system.closed
        pairs = zip(closed.kinds, *self._frames(self.dynamics.joint_poses(pose)), strict=True)
        return any(_holds(k) == TURNED and np.min(np.diag(a.T @ b)) < 0.5 for k, a, b in pairs)

    def flipped(self, pose: Array) -> bool:
        """The same of any loop: a pin may be put in from either side; `signs` says from which."""
        return self.twisted(pose) or bool(np.any(self.axes(pose) * self.signs < 0))

    def at(self, y: Array) -> tuple[Array, Array]:
        """Residual (m), shape (rows,), and its Jacobian, shape (rows, nv)."""
        d = self.dynamics
        at, closed, (c, J) = d.kinematics(y), d.system.closed, d.close(y)
        frames_a, frames_b = self._frames(at.poses)
        spin = at.J[0, 3:]
        for k, kind, rows in self._turns:
            a, b = frames_a[k], frames_b[k]
            relative = spin * closed.row_mask[rows[0]]
            if _holds(kind) == TURNED:
                R = a.T @ b
                c[rows] = pin.log3(R)
                J[rows] = np.asarray(pin.Jlog3(R)) @ (b.T @ relative)
            elif _holds(kind) == ALONG:
                c[rows], by_turn = _between(self.signs[k] * (a.T @ b[:, 2]))
                J[rows] = by_turn @ (a.T @ relative)
            else:
                sine = float(np.clip(c[rows[0]], -1.0, 1.0))
                J[rows] /= max(np.sqrt(1.0 - sine * sine), _STRAIGHT)
                c[rows] = np.arcsin(sine)
            c[rows] *= self.length
            J[rows] *= self.length
        return c, J

    def gaps(self, c: Array) -> tuple[Array, Array]:
        """How far each loop is open at a residual of `at`: m and rad, shape (loops,) each."""
        closed = self.dynamics.system.closed
        turned = closed.sorts == DIRECTION
        apart, angles = (np.zeros(len(closed.names)) for _ in range(2))
        np.add.at(apart, closed.loop_of[~turned], c[~turned] ** 2)
        np.add.at(angles, closed.loop_of[turned], (c[turned] / self.length) ** 2)
        return np.sqrt(apart), np.sqrt(angles)


def _holds(kind: str) -> Pairs:
    """Directions that a kind of loop holds."""
    return loop_kind(kind).directions


def _between(z: Array) -> tuple[Array, Array]:
    """theta (z_x, z_y) / sin(theta) of a unit axis z seen from a, and its change with a turn."""
    sine = float(np.hypot(z[0], z[1]))
    turn = np.array([[0.0, z[2], -z[1]], [-z[2], 0.0, z[0]], [z[1], -z[0], 0.0]])  # dz = w x z
    if sine < _STRAIGHT:
        if z[2] > 0:
            return z[:2].copy(), turn[:2]
        return np.array([np.pi, 0.0]), np.zeros((2, 3))
    theta = float(np.arctan2(sine, z[2]))
    f = theta / sine
    outward = z[:2] / sine
    # d theta = -dz_z / sin(theta), d sin(theta) = outward . dz
    df = (-turn[2] / sine - f * (outward @ turn[:2])) / sine
    return f * z[:2], f * turn[:2] + np.outer(z[:2], df)


def size_of(dynamics: Equations, y: Array) -> float:
    """Size of a mechanism at y (nq,): the largest distance of two joints or frames, m."""
    poses = dynamics.joint_poses(y)
    frames = dynamics.system.closed.frames(poses)[0, :, :, 3]
    points = np.concatenate([poses[0, 1:, :, 3], frames])
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    largest = float(np.max(apart, initial=0.0))
    return largest if largest > LENGTHS else 1.0
