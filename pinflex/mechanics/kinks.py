"""Laws that bend: of pieces, each smooth, over one coordinate or the elongation of a spring.

A dead zone in a gear, the stops of a joint, a cable that only pulls and a table of a spring are the
same thing: a resistance f(x, x') whose pieces begin at places x. With d = x - x_0 and s its sign,

    f = f_0 + (s k |d|^n)(1 + s c_h x') + c x',     E = E_0 + f_0 d + k |d|^(n+1) / (n+1)

What the march does at the ends of pieces: `pinflex.integrators.events`.
Source: Hunt and Crossley (1975), J. Appl. Mech. 42, for c_h.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.blocks.joints import Friction
from pinflex.description.blocks.material import named
from pinflex.description.loops import Loop
from pinflex.mechanics.model.loads import (
    BALL,
    DIRECTION,
    PIN,
    POINT,
    WALL,
    Attachment,
    Touch,
    excess,
)
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.description.blocks.external import FrameSpring
    from pinflex.description.blocks.joints import Stops
    from pinflex.description.description import Description
    from pinflex.mechanics.evaluation.equations import Equations
    from pinflex.mechanics.model.loads import Expansion
    from pinflex.mechanics.model.system import System
    from pinflex.mechanics.reference.evaluator import Reference


FROM = -1e300  # where first pieces begin
RINGS = 1e5  # rad/s: of what rests on a rigid stop
_BEYOND = 1e-6  # rad or m beyond a rigid stop that something is said of
_RIGID = 1e9  # N/m or N m/rad, of rigid stops at rest


class Piece(NamedTuple):
    """A piece of a law, from a place on (see above); damper: c, chi: c_h times speed of entry."""

    start: float
    place: float
    force: float
    stiffness: float
    power: float = 1.0
    damper: float = 0.0
    chi: float = 0.0


class Row(NamedTuple):
    """A law: name, velocity row (-1: none), place in y, whether (cos, sin), its spring or -1.

    restitution: What rigid stops at the ends of its piece `free` give back of a speed; -1: none.
    gap: Of a contact of bodies (`pinflex.mechanics.kinks`) [m]; None: it is none.
    """

    name: str
    v: int
    q: int
    paired: bool
    spring: int
    pieces: tuple[Piece, ...]
    restitution: float = -1.0
    free: int = 0
    gap: float | None = None


class Pull(NamedTuple):
    """What a law resists by, its derivatives by x and x', energy [J] and power taken [W]."""

    force: Array
    slope: Array
    damping: Array
    energy: Array
    loss: Array


@frozen
class Kinks:
    """Laws of pieces of a system.

    Attributes:
        rows: Names, coordinates and pieces. energy: E_0 of the pieces of each, J.
    """

    rows: tuple[Row, ...] = ()
    energy: tuple[Array, ...] = field(default=())

    @property
    def of_coordinates(self) -> list[int]:
        """Those over a coordinate."""
        return [k for k, row in enumerate(self.rows) if row.v >= 0]

    @property
    def rigid(self) -> bool:
        """Whether any gives a speed back at once, by a coefficient of restitution."""
        return any(row.restitution >= 0.0 for row in self.rows)

    @property
    def stiff(self) -> Kinks:
        """The same with springs, very stiff, in place of stops that give speeds back at once."""
        if not self.rigid:
            return self
        return made([row if row.restitution < 0.0 else _stiff(row) for row in self.rows])

    @property
    def pins(self) -> bool:
        """Whether there are pins with clearance."""
        return any(row.gap is not None for row in self.rows)

    def of_spring(self, spring: int) -> int:
        """The law of a spring between frames, or -1."""
        return next((k for k, row in enumerate(self.rows) if row.spring == spring >= 0), -1)

    def position(self, k: int, y: Array) -> Array:
        """The coordinate [rad | m] that law k is over, at y (..., nq), shape (...)."""
        row = self.rows[k]
        if row.paired:
            return np.asarray(np.arctan2(y[..., row.q + 1], y[..., row.q]))
        return np.asarray(y[..., row.q])

    def piece(self, k: int, x: Array) -> IntArray:
        """Pieces of law k at places x."""
        starts = np.array([piece.start for piece in self.rows[k].pieces])
        return np.searchsorted(starts, x, side="right") - 1

    def pull(self, k: int, x: Array | float, rate: Array | float) -> Pull:
        """Law k at places x and their rates: of states by themselves, without c_h."""
        x, rate = np.asarray(x, float), np.asarray(rate, float)
        p = self.piece(k, x)
        _, place, force, k_, n, c, _ = np.array(self.rows[k].pieces).T[:, p]
        d = x - place
        deep = np.abs(d)
        held = k_ * deep**n
        energy = self.energy[k][p] + force * d + held * deep / (n + 1.0)
        slope = n * k_ * deep ** (n - 1.0)
        return Pull(force + np.sign(d) * held + c * rate, slope, c, energy, c * rate**2)

    def passed(self, t: Array, Y: Array) -> list[str]:
        """What is said of rigid stops of joints that states Y (nt, nq) at times t lie beyond."""
        said = []
        for k in self.of_coordinates:
            row = self.rows[k]
            x, (low, high) = self.position(k, Y), self.ends(k, row.free)
            beyond = np.maximum(low - x, x - high)
            if row.restitution >= 0.0 and np.any(beyond > _BEYOND):
                said.append(
                    f"the motion leads {beyond.max():.3g} (rad or m) beyond the {row.name}, first "
                    f"at t = {t[np.argmax(beyond > _BEYOND)]:.4g} s: a rigid stop forbids that, "
                    "and torques there mean nothing."
                )
        return said

    def ends(self, k: int, piece: int) -> tuple[float, float]:
        """Where a piece of law k begins and ends."""
        pieces = self.rows[k].pieces
        last = piece + 1 == len(pieces)
        return pieces[piece].start, np.inf if last else pieces[piece + 1].start

    def tables(self, springs: int) -> dict[str, object]:
        """Tables for the compiled kernel."""
        numbers = [
            (*piece[1:], energy)
            for row, energies in zip(self.rows, self.energy, strict=True)
            for piece, energy in zip(row.pieces, energies, strict=True)
        ]
        return {
            "kink_v": [row.v for row in self.rows], "kink_q": [row.q for row in self.rows],
            "kink_paired": [row.paired for row in self.rows],
            "kink_at": np.cumsum([0, *(len(row.pieces) for row in self.rows)]),
            "spring_kink": [self.of_spring(k) for k in range(springs)],
            "kink_start": [piece.start for row in self.rows for piece in row.pieces],
            "kink_piece": np.array(numbers, dtype=float).reshape(-1, 7),
        }  # fmt: skip


def _stiff(row: Row) -> Row:
    """A rigid stop as a spring beyond the ends of its free piece."""
    ends = row.pieces[row.free].start, *(p.start for p in row.pieces[row.free + 1 :])
    pieces = [
        piece
        if k == row.free
        else piece._replace(stiffness=_RIGID, place=ends[0] if k < row.free else piece.start)
        for k, piece in enumerate(row.pieces)
    ]
    return row._replace(pieces=tuple(pieces), restitution=-1.0)


def made(rows: Sequence[Row]) -> Kinks:
    """Laws with their energies, which are 0 where they resist least."""
    return Kinks(tuple(rows), tuple(_energies(row.pieces) for row in rows))


def _energies(pieces: Sequence[Piece]) -> Array:
    """E_0 of pieces, such that energy is continuous, shape (pieces,)."""

    def inside(piece: Piece, x: float) -> float:
        d = x - piece.place
        power = piece.power + 1.0
        return float(piece.force * d + piece.stiffness * abs(d) ** power / power)

    found = [0.0]
    for before, piece in pairwise(pieces):
        x = piece.start
        found.append(found[-1] + inside(before, x) - inside(piece, x))
    idle = int(np.argmin([abs(piece.force) for piece in pieces]))  # a dead zone, or a zero
    return np.array(found) - found[idle]


def dead_zone(half: float, stiffness: float, damping: float) -> tuple[Piece, ...]:
    """What a play of half its width takes from a linear spring and damper."""
    lost = stiffness * half
    return (
        Piece(FROM, -half, lost, 0.0),
        Piece(-half, 0.0, 0.0, -stiffness, 1.0, -damping),
        Piece(half, half, -lost, 0.0),
    )


def resting(place: float, mass: float) -> Piece:
    """What holds a mass (kg | kg m^2) that has come to rest on a rigid stop.

    So stiff that it gives way by 1e-10 of what accelerates it, and damped as fast as can be.
    """
    return Piece(place, place, 0.0, mass * RINGS**2, 1.0, 2.0 * mass * RINGS)


def stops(given: Stops, mass: float) -> tuple[Piece, ...]:
    """Springs and dampers beyond the stops of a joint that moves a mass (kg | kg m^2)."""
    law = (0.0, given.stiffness or 0.0, 1.0, given.damping)
    if given.restitution is not None:
        law = resting(0.0, mass)[2:6]
    lower, upper = given.lower, given.upper
    free = Piece(FROM if lower is None else lower, 0.0, 0.0, 0.0)
    below = () if lower is None else (Piece(FROM, lower, *law),)
    return (*below, free, *(() if upper is None else (Piece(upper, upper, *law),)))


def table(points: Sequence[tuple[float, float]], damper: float = 0.0) -> tuple[Piece, ...]:
    """Straight from point to point (place, force), and on beyond the first and the last."""
    pieces = []
    for k, ((x, f), (x1, f1)) in enumerate(pairwise(points)):
        pieces.append(Piece(x if k else FROM, x, f, (f1 - f) / (x1 - x), 1.0, damper))
    return tuple(pieces)


def kinks(description: Description, model: pin.Model, expansion: Expansion | None) -> Kinks:
    """Laws of pieces of a description; `expansion`: with gears that give way."""
    rows = []
    for name, extra in description.joints.items():
        pieces = () if extra.stops is None else stops(extra.stops, _mass(model, name, extra.stops))
        both = [("stop of ", pieces), ("table of ", table(extra.table) if extra.table else ())]
        for what, each in both:
            if each:
                joint = model.joints[model.getJointId(name)]
                given = None if extra.stops is None or what == "table of " else extra.stops
                back = -1.0 if given is None or given.restitution is None else given.restitution
                at = int(joint.idx_v), int(joint.idx_q), bool(joint.nq == 2)
                free = int(given is not None and given.lower is not None)
                rows.append(Row(what + name, *at, -1, each, back, free))
    for place in () if expansion is None else expansion.drives:
        drive = description.joints[place.joint].drive
        if drive is not None and drive.backlash:
            half = dead_zone(0.5 * drive.backlash, drive.stiffness or 0.0, drive.damping)
            v, q = int(model.nv) + place.eta, int(model.nq) + place.eta
            rows.append(Row(f"play of {place.joint}", v, q, False, -1, half))
    for k, spring in enumerate(description.springs):
        if law := spring_law(spring):
            rows.append(Row(spring.name, -1, 0, False, k, law))
    return made(rows)


def _mass(model: pin.Model, name: str, given: Stops) -> float:
    """About what a rigid stop of a joint meets, at the model's neutral pose."""
    if given.restitution is None:
        return 0.0
    row = model.joints[model.getJointId(name)].idx_v
    return float(pin.crba(model, model.createData(), pin.neutral(model))[row, row])


def spring_law(spring: FrameSpring) -> tuple[Piece, ...]:
    """The pieces of a spring between frames; none of one that is straight."""
    if spring.table:
        return table(spring.table, spring.damper)
    if not spring.tension_only:
        return ()
    taut = Piece(0.0, 0.0, 0.0, spring.stiffness, 1.0, spring.damper)
    return Piece(FROM, 0.0, 0.0, 0.0), taut


# Joints with clearance: loops that are held by contact, at level coupled.
#
# A pin in a larger hole, a ball in a larger socket, a slider in a wider guide. What the clearance
# lets go is held by nothing until it is used up: until the distance e of the centres reaches the
# clearance c, or a corner of the slider its wall. From there on, with x = e - c,
#
#     F = K x^(3/2) (1 + chi x' / v_0),     K = 4 / (3 (s_a + s_b)) sqrt(R_a R_b / (R_a - R_b))
#
# where s = (1 - nu^2) / E, R_b the pin's radius, R_a = R_b + c, v_0 the speed of approach, and by
# the coefficient of restitution e_r
#
#     chi = 3 (1 - e_r^2) / 4        Lankarani and Nikravesh (1990), J. Mech. Design 112, eq. 18
#     chi = 8 (1 - e_r) / (5 e_r)    Flores, Machado, Silva, Martins (2011), Multibody Syst. Dyn. 25
#
# The first is for e_r near 1. `rigid` is the limit of stiff bodies: x' is given back at once
# (`pinflex.integrators.events`). Where it slides it is rubbed by the law of joints' friction with F
# times its coefficients.

_HERTZ = 1.5


def stiffness(loop: Loop) -> float:
    """K of the pin of a loop in its hole [N/m^1.5]."""
    assert loop.clearance is not None
    material, radius = named(loop.pin_material), 0.5 * (loop.pin or 0.0)
    softness = 2.0 * (1.0 - material.nu**2) / material.E
    apart = radius * (radius + loop.clearance) / loop.clearance
    return float(4.0 / (3.0 * softness) * apart**0.5)


def damping(loop: Loop) -> float:
    """chi of a loop."""
    e = loop.restitution
    if loop.contact == "flores":
        return 8.0 * (1.0 - e) / (5.0 * e)
    return 0.75 * (1.0 - e**2)


def with_clearance(system: System, loops: Sequence[Loop]) -> System:
    """A system whose loops with clearance are held by contact."""
    cut = {loop.name: loop for loop in loops if loop.clearance is not None}
    if not cut:
        return system
    closed, touches, rows = system.closed, list(system.loads.touches), list(system.kinks.rows)
    kept = np.ones(closed.n, dtype=bool)
    mass = sum(inertia.mass for inertia in system.expansion.model.inertias)
    for k, name in enumerate(closed.names):
        if name not in cut:
            continue
        loop, ends = cut[name], (k, len(closed.names) + k)
        a, b = (
            Attachment(int(closed.bodies[i]), pin.SE3(pose[:, :3].copy(), pose[:, 3].copy()))
            for i, pose in zip(ends, closed.local[list(ends)], strict=True)
        )
        kept[_let_go(system, k, loop)] = False
        for touch in _touches(loop, a, b):
            touches.append(touch._replace(law=len(rows)))
            back = loop.restitution if loop.contact == "rigid" else -1.0
            rows.append(Row(name, -1, 0, False, -1, _law(loop, mass), back, 0, touch.gap))
    loads = replace(system.loads, touches=tuple(touches))
    return replace(system, closed=closed.select(np.flatnonzero(kept)), loads=loads,
                   kinks=made(rows))  # fmt: skip


def _law(loop: Loop, mass: float) -> tuple[Piece, ...]:
    free = Piece(FROM, 0.0, 0.0, 0.0)
    if loop.contact == "rigid":
        return free, resting(0.0, mass)
    return free, Piece(0.0, 0.0, 0.0, stiffness(loop), _HERTZ, 0.0, damping(loop))


def _let_go(system: System, k: int, loop: Loop) -> IntArray:
    """Rows of the k-th loop that its clearance leaves."""
    closed = system.closed
    if loop.kind == "prismatic":
        axes, about = [0], (2, 0)  # across, and turning about the third axis
    else:
        axes = [0, 1, 2] if loop.kind == "spherical" or loop.axial is not None else [0, 1]
        about = (-1, -1)
    points, turns = closed.of(POINT, k), closed.of(DIRECTION, k)
    points = points[np.isin(closed.a[points], axes)]
    turns = turns[(closed.a[turns] == about[0]) & (closed.b[turns] == about[1])]
    return np.concatenate([points, turns])


def _touches(loop: Loop, a: Attachment, b: Attachment) -> Iterator[Touch]:
    """Where the bodies of a loop may touch."""
    gap, rubs, R = loop.clearance or 0.0, loop.friction or Friction(), a.placement.rotation
    one = Touch(
        loop.name, PIN, a, b, _axis(R, 2), gap, 0.5 * (loop.pin or 0.0), rubs.coulomb, rubs.speed,
        0, excess(rubs), rubs.stribeck,
    )  # fmt: skip
    if loop.kind == "prismatic":
        x, z = np.array(_axis(b.placement.rotation, 0)), np.array(_axis(b.placement.rotation, 2))
        half, end = 0.5 * loop.height, 0.5 * (loop.length or 0.0)
        for side in (1.0, -1.0):
            for way in (1.0, -1.0):
                at = pin.SE3(b.placement)
                at.translation = at.translation + side * half * x + way * end * z
                corner, wall = Attachment(b.joint, at), _axis(side * R, 0)
                yield one._replace(shape=WALL, b=corner, axis=wall, gap=half + gap, radius=0.0)
        return
    yield one._replace(shape=BALL) if loop.kind == "spherical" else one
    if loop.axial is not None:
        for side in (1.0, -1.0):
            yield one._replace(shape=WALL, axis=_axis(side * R, 2), gap=loop.axial, radius=0.0)


def _axis(R: Array, k: int) -> tuple[float, float, float]:
    x, y, z = R[:, k].tolist()
    return x, y, z


# By joint: poses (n, 3, 4) in the world, and twists (n, 6) in the joint's own axes.
Places = Mapping[int, tuple[Array, Array]]


def places_of(equations: Equations | Reference, Y: Array, V: Array, A: Array) -> Places:
    """Of all joints that loads, springs and contacts of a system act on."""
    joints = sorted(equations.system.loads.joints - {0})
    poses, rates = equations.motions(Y, V, A, joints)
    still = np.tile(np.eye(4)[:3], (len(Y), 1, 1)), np.zeros((len(Y), 6))
    return {0: still} | dict(zip(joints, zip(poses, rates[:, :, 0], strict=True), strict=True))


def moving(end: Attachment, places: Places) -> tuple[Array, Array, Array]:
    """Place, speed and spin of an end in the world, (n, 3) each."""
    pose, twist = places[end.joint]
    R, local = pose[:, :, :3], end.placement.translation
    own = twist[:, :3] + np.cross(twist[:, 3:], local)
    speed, spin = ((R @ x[:, :, None])[:, :, 0] for x in (own, twist[:, 3:]))
    return pose[:, :, 3] + R @ local, speed, spin


def relative_motion(one: Touch, places: Places) -> tuple[Array, Array, Array]:
    """Axes of A (n, 3, 3), the motion of B as A sees it (n, 9), and the place of b (n, 3)."""
    (p_a, v_a, spin_a), (p_b, v_b, spin_b) = (moving(end, places) for end in (one.a, one.b))
    R, d = places[one.a.joint][0][:, :, :3], p_b - p_a
    way = v_b - v_a - np.cross(spin_a, d)
    motion = [(x[:, None] @ R)[:, 0] for x in (d, way, spin_b - spin_a)]
    return R, np.concatenate(motion, axis=1), p_b


def pins(equations: Equations, Y: Array, V: Array, A: Array) -> dict[str, tuple[Array, Array]]:
    """Where pins are in their holes, in axes of frame a, and the wrench on them in the world.

    Shapes (n, 3) and (n, 6), m, N and N m, about the origin of frame b; without what impacts damp.
    """
    system, found = equations.system, dict[str, tuple[Array, Array]]()
    touches, closed, n = system.loads.touches, system.closed, len(Y)
    if not touches:
        return found
    places, frames = places_of(equations, Y, V, A), closed.frames(equations.joint_poses(Y))
    for one in touches:
        loop = closed.names.index(one.name)
        frame_a, frame_b = frames[:, loop], frames[:, len(closed.names) + loop]
        R, motion, corner = relative_motion(one, places)
        acts = one.force(motion, system.kinks)
        F, M = ((R @ x[:, :, None])[:, :, 0] for x in (acts.force, acts.moment))
        wrench = np.concatenate([F, M + np.cross(corner - frame_b[:, :, 3], F)], axis=1)
        way = frame_b[:, :, 3] - frame_a[:, :, 3]
        place = (way[:, None] @ frame_a[:, :, :3])[:, 0]
        before = found.get(one.name, (place, np.zeros((n, 6))))[1]
        found[one.name] = place, before + wrench
    return found
