"""Loads at frames, springs and dampers between frames and of joints, added masses, dry friction.

Present only where a scene has them. A load is a world wrench W on a body; the residual gets -J' W.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.blocks.external import WORLD
from pinflex.errors import AssemblyError, DescriptionError
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody
    from pinflex.description.blocks.external import FrameForce, FrameSpring
    from pinflex.description.blocks.joints import Friction
    from pinflex.description.description import Description
    from pinflex.mechanics.kinks import Kinks


# Records of the expanded model: where frames, stations and interfaces sit, and their maps.


@frozen
class Attachment:
    """Where a frame sits in the expanded model: a joint and the pose in that joint's frame."""

    joint: int
    placement: pin.SE3


@frozen
class Interface:
    """A section that carries something: its place x [m], its joint and its velocity rows."""

    x: float
    attachment: Attachment
    force_rows: IntArray

    def bottom(self, model: pin.Model) -> int:
        """The translation at the bottom of its chain of joints.

        Its force has all six components, about the displaced section, in the beam frame.
        """
        joint = self.attachment.joint
        while model.joints[joint].idx_v != self.force_rows[0]:
            joint = int(model.parents[joint])
        return joint


@frozen
class Slot:
    """One flexible body in the expanded model: its eta slice, stations and interfaces.

    `turning`: joints of stations with rotary inertia, whose forces have all six components.
    """

    link: str
    offset: float
    body: FlexibleBody
    eta: slice
    root: Attachment
    stations: IntArray
    twists: IntArray
    interfaces: tuple[Interface, ...]
    turning: tuple[int, ...] = ()


@frozen
class Block:
    """The coordinate map of one body, or of a gear that gives way.

    X is the identity on the rigid rows and one small block per body; nothing else is stored.

    Attributes:
        rows: Expanded velocity rows, the curved ones first, shape (R,).
        q_rows: Where these coordinates sit in Q, shape (R,).
        Phi: First-order part, shape (R, n).
        G: Second-order part of the first Rc rows, shape (Rc, n, n).
        eta: Its slice of eta.
    """

    rows: IntArray
    q_rows: IntArray
    Phi: Array
    G: Array
    eta: slice


@frozen
class ElasticDrive:
    """A gear that gives way: its joint, its elastic coordinate and its expanded velocity row."""

    joint: str
    eta: int
    row: int


_SECTIONS = 10  # of a link, beside its root: they show every mode that is not faint


@frozen
class Expansion:
    """An expanded model and the constant parts of its coordinate map.

    Attributes:
        model: Expanded Pinocchio model.
        q_at, v_at: Where the rigid q and v sit in Q and V.
        blocks: Maps from eta to station and interface coordinates, body by body, then of gears.
        frames: Attachment of every link frame, by name.
        slots: The flexible bodies.
        n_eta: Number of elastic coordinates.
        drives: Gears that give way; their coordinates follow those of the links.
        carried: What joints carry (`pinflex.mechanics.model.expansion`).
    """

    model: pin.Model
    q_at: IntArray
    v_at: IntArray
    blocks: tuple[Block, ...]
    frames: Mapping[str, Attachment]
    slots: tuple[Slot, ...]
    n_eta: int
    drives: tuple[ElasticDrive, ...] = ()
    carried: tuple[Any, ...] = ()

    @cached_property
    def last(self) -> dict[Any, tuple[Array, Array]]:
        """Where the joints were last, see `pinflex.mechanics.reference.evaluator.Placing`."""
        return {}

    @cached_property
    def sections(self) -> Array:
        """How far sections of links move [m] by elastic coordinates, to first order: (n, n_eta).

        In the beam frame at the link's root, without rows of zeros. Where none moves, since links
        only twist, how far they turn [rad].
        """
        number, known, found = Counter(slot.link for slot in self.slots), {}, list[Array]()
        tips = dict[str, Array]()  # of the body before in a link, on which the next one rides
        for slot in self.slots:
            body, count = slot.body, max(1, _SECTIONS // number[slot.link])
            x = np.linspace(body.length, 0.0, count + 1)
            if (key := (id(body), count)) not in known:  # equal links share their body
                known[key] = body.fields(x)["deflection"]
            moved = np.zeros((len(x), 6, self.n_eta))  # u v w rx ry rz
            moved[:, :, slot.eta] = known[key]
            if (tip := tips.get(slot.link)) is not None:
                moved += tip
                moved[:, 1] += x[:, None] * tip[5]
                moved[:, 2] -= x[:, None] * tip[4]
            tips[slot.link] = moved[0]
            found.append(moved)
        rows = np.concatenate([np.zeros((0, 6, self.n_eta)), *found])
        places, turns = rows[:, :3].reshape(-1, self.n_eta), rows[:, 3]
        rows = places if places.any() else turns
        return np.asarray(rows[rows.any(axis=1)])


def gear_name(joint: str) -> str:
    """Name in the expanded model of the joint between a motor's side and the link."""
    return f"gear of {joint}"


def rigid_indices(rigid: pin.Model, model: pin.Model) -> tuple[IntArray, IntArray]:
    """Where the q and v of the rigid model sit in Q and V."""
    q_at = np.empty(rigid.nq, dtype=np.intp)
    v_at = np.empty(rigid.nv, dtype=np.intp)
    own = zip(
        *(x.tolist() for x in (rigid.idx_qs, rigid.idx_vs, rigid.nqs, rigid.nvs)), strict=True
    )
    qs, vs = model.idx_qs.tolist(), model.idx_vs.tolist()
    for name, (q, v, nq, nv) in zip(rigid.names.tolist(), own, strict=True):
        k = model.getJointId(name)
        q_at[q : q + nq] = range(qs[k], qs[k] + nq)
        v_at[v : v + nv] = range(vs[k], vs[k] + nv)
    return q_at, v_at


_FAINT = 1e-9  # of the speed that friction is smoothed at: there tanh(x) / x is 1
_MEET = 1e-9  # [m], far below what a drawing says


POINT, DIRECTION, DISTANCE, COUPLING, SLEEVE = range(5)  # rows of closures: kernel/source/kernel.h
BALL, PIN, WALL = range(3)  # in a socket, in a hole, a corner at a wall: kernel/source/touch.c


class Touch(NamedTuple):
    """A contact of two bodies: where they are, the distance e that counts, and how it rubs.

    Attributes:
        name: Of its loop. shape: `BALL`, `PIN` or `WALL`. a, b: The middle of the hole and of the
            pin, or a point of the wall's body and the corner.
        axis: Unit vector in the joint of a: along the hole, or towards the wall.
        gap: e at which it touches [m]. radius: From b to what touches [m].
        friction: Coulomb's coefficient. speed: At which it is smoothed [m/s].
        law: Its law among those of the system.
        excess, stribeck: E [-] and v_s [m/s] of friction at rest, as of `DryFriction`.
    """

    name: str
    shape: int
    a: Attachment
    b: Attachment
    axis: tuple[float, float, float]
    gap: float
    radius: float
    friction: float
    speed: float
    law: int
    excess: float = 0.0
    stribeck: float = 1.0

    def outward(self, d: Array) -> tuple[Array, Array]:
        """Unit vectors u towards the rim (n, 3), and u . d (n,), of ways d from a to b (n, 3)."""
        s = np.array(self.axis)
        along = d @ s
        if self.shape == WALL:
            return np.tile(s, (len(d), 1)), along
        off = d if self.shape == BALL else d - along[:, None] * s
        length = np.linalg.norm(off, axis=1)
        return off / np.maximum(length, 1e-300)[:, None], length

    def force(self, motion: Array, kinks: Kinks) -> TouchForce:
        """On B at b and about it, in axes of A, of n motions d, d', W of B as A sees it (n, 9)."""
        way, turn = motion[:, 3:6], motion[:, 6:]
        out, length = self.outward(motion[:, :3])
        rate = np.sum(out * way, axis=1)
        pull = kinks.pull(self.law, length - self.gap, rate)
        slip = way + self.radius * np.cross(turn, out) - rate[:, None] * out
        fast = np.linalg.norm(slip, axis=1)
        held = self.friction + self.excess * np.exp(-np.square(fast / self.stribeck))
        held = held * np.maximum(pull.force, 0.0)
        smooth = np.tanh(fast / self.speed) / np.maximum(fast, 1e-300)
        rub = (
            -(held * np.where(fast > _FAINT * self.speed, smooth, 1.0 / self.speed))[:, None] * slip
        )
        moment = self.radius * np.cross(out, rub)
        loss = pull.loss - np.sum(rub * slip, axis=1)
        return TouchForce(rub - pull.force[:, None] * out, moment, pull.energy, loss)


class TouchForce(NamedTuple):
    """Force and moment (n, 3), stored energy (n,), J, and power taken (n,), W, of a contact."""

    force: Array
    moment: Array
    energy: Array
    loss: Array


@dataclass(frozen=True)
class Loads:
    """Loads, springs and contacts of one model, with the frames they act on.

    Attributes:
        forces: Loads with their frame. springs: Springs with both frames. touches: Contacts.
    """

    forces: tuple[tuple[FrameForce, Attachment], ...]
    springs: tuple[tuple[FrameSpring, Attachment, Attachment], ...]
    touches: tuple[Touch, ...] = ()

    @property
    def present(self) -> bool:
        """Whether there is anything."""
        return bool(self.forces or self.springs or self.touches)

    @property
    def joints(self) -> set[int]:
        """Joints that they act on."""
        ends = [place for _, place in self.forces]
        ends += [end for _, a, b in self.springs for end in (a, b)]
        ends += [end for one in self.touches for end in (one.a, one.b)]
        return {int(end.joint) for end in ends}

    @property
    def timed(self) -> bool:
        """Whether a load starts, ends or ramps in time."""
        return any(f.timed for f, _ in self.forces)

    def spread(self, h: float, apart: Collection[float] = ()) -> Loads:
        """Loads that switch, but for times `apart`, as methods of second order feel steps of h [s].

        Between steps a switch would act up to half a step early or late. As a ramp of a step's
        length with the same middle it acts where it is, but for those in the first step.
        """
        found: list[tuple[FrameForce, Attachment]] = []
        for force, at in self.forces:
            end, begun, full = force.until, force.start, force.start + force.ramp
            if end is not None and end not in apart and end >= max(force.start, h):
                share = 1.0 if end >= full else (end - force.start) / force.ramp
                off = _times(force, -share, start=end - 0.5 * h, ramp=h)
                more = [] if end >= full else [_times(force, share - 1.0, end, full - end)]
                found += [(part, at) for part in (off, *more)]
                force = replace(force, until=None)
            start = force.start + 0.5 * (force.ramp - h)
            if force.ramp < h and start >= 0.5 * h and not {begun, full} & {*apart}:
                force = replace(force, start=start, ramp=h)
            found.append((force, at))
        return replace(self, forces=tuple(found))


def _times(load: FrameForce, factor: float, start: float, ramp: float) -> FrameForce:
    """Another load in its place, without end."""
    force, moment = ((factor * x, factor * y, factor * z) for x, y, z in (load.force, load.moment))
    return replace(load, force=force, moment=moment, start=start, ramp=ramp, until=None)


def loads(description: Description, frames: Mapping[str, Attachment]) -> Loads:
    """Place the described loads and springs on a model, and the weight of what comes and goes."""
    forces = [(f, frames[f.frame]) for f in description.forces]
    body = description.payload
    if body is not None and body.timed:
        at = frames[body.frame]
        centre = at.placement * pin.SE3(np.eye(3), np.array(body.centre))
        forces.append((body.weight(description.gravity), Attachment(at.joint, centre)))
    springs = description.springs
    return Loads(
        tuple(forces),
        tuple((s, _end(s, s.frame_a, frames), _end(s, s.frame_b, frames)) for s in springs),
    )


def _end(spring: FrameSpring, name: str, frames: Mapping[str, Attachment]) -> Attachment:
    """Where a spring is held: a frame, or a point of the ground."""
    if spring.at is None or name != WORLD:
        return frames[name]
    return Attachment(0, pin.SE3(np.eye(3), np.array(spring.at)))


def require_apart(given: Loads, model: pin.Model, home: Array, where: str) -> None:
    """Refuse a spring with a length or a damper whose ends meet at home: along which line?"""
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


# Masses that differ with the direction: what a fluid, or a guide, adds to the inertia of a frame.
#
# With the twist v of a frame in its own axes and the diagonal M of added masses and moments, the
# kinetic energy is v' M v / 2, and the body needs
#
#     f = M a + v x* (M v)
#
# a the spatial acceleration in the frame's axes. The second term has Munk's moment, by which a body
# with two unlike masses turns broadside on. Nothing here has weight.
#
# Source: Kirchhoff's equations of a body in an ideal fluid: Lamb, Hydrodynamics, art. 124.


@frozen
class AddedMasses:
    """Added inertias of one model, and that of a payload which comes or goes.

    Attributes:
        joints: That carry them. inertia: Of each, about the joint's origin in its axes, shape
            (joints, 6, 6). clocks: Loads in whose shares some of them count, by number.
    """

    joints: tuple[int, ...] = ()
    inertia: Array = field(default_factory=lambda: np.zeros((0, 6, 6)))
    clocks: Mapping[int, FrameForce] = field(default_factory=dict)

    @property
    def instants(self) -> tuple[float, ...]:
        """Times at which masses come or go [s]."""
        times = {t for clock in self.clocks.values() for t in clock.corners}
        return tuple(sorted(t for t in times if t > 0.0))

    def at(self, t: float) -> list[tuple[int, Array]]:
        """Joints and inertias that count at a time t [s]."""
        shares = dict.fromkeys(range(len(self.joints)), 1.0)
        shares |= {k: clock.scale(t) for k, clock in self.clocks.items()}
        return [(self.joints[k], x * self.inertia[k]) for k, x in shares.items() if x]


def added_masses(description: Description, frames: Mapping[str, Attachment]) -> AddedMasses:
    """Place the described masses, and a payload that comes or goes, on a model."""
    found: dict[int, Array] = {}
    for one in description.added_masses:
        at = frames[one.frame]
        own = _about_joint(np.diag([*one.mass, *one.inertia]), at)
        found[at.joint] = found.get(at.joint, np.zeros((6, 6))) + own
    joints, inertia = [*found], [*found.values()]
    clocks: dict[int, FrameForce] = {}
    body = description.payload
    if body is not None and body.timed and (at := frames[body.frame]).joint:
        clocks[len(joints)] = body.weight(description.gravity)
        joints.append(at.joint)
        inertia.append(_about_joint(body.spatial, at))
    return AddedMasses(tuple(joints), np.array(inertia).reshape(-1, 6, 6), clocks)


def require_staying(description: Description, what: str, then: str = "Leave out both.") -> None:
    """Refuse a payload that comes or goes where masses are those of the whole run.

    Raises:
        DescriptionError: With what to do.
    """
    if description.payload is not None and description.payload.timed:
        where = f"{description.name}: {what}: payload"
        raise DescriptionError(f"{where}: from, until: the payload has to stay here. {then}")


def _about_joint(M: Array, at: Attachment) -> Array:
    """Spatial inertia (6, 6) of a frame, about the origin of its joint."""
    back = at.placement.toActionMatrixInverse()
    return np.asarray(back.T @ M @ back)


# Dry friction of joints, smooth in their speed, on Pinocchio's rows.
#
#     F(v) = (F_c + E exp(-(v/v_s)^2)) tanh(v/v_0),     max F = F_b
#
# Present only where a scene has it; the viscous part is among the dampers. F v >= 0: it takes
# energy.

_NONE = np.zeros(0)
_SPEEDS, _ROUNDS = 3001, 5  # a maximum is flat: three digits of its place are six of its height


@frozen
class DryFriction:
    """Joints with dry friction.

    Attributes:
        rows: Velocity rows. coulomb: F_c [N m | N]. excess: E [N m | N].
        stribeck, speed: v_s and v_0 [rad/s | m/s].
    """

    rows: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    coulomb: Array = field(default_factory=lambda: _NONE)
    excess: Array = field(default_factory=lambda: _NONE)
    stribeck: Array = field(default_factory=lambda: _NONE)
    speed: Array = field(default_factory=lambda: _NONE)

    @property
    def present(self) -> bool:
        """Whether any joint rubs."""
        return len(self.rows) > 0

    def force(self, v: Array) -> Array:
        """Friction that the motion v (..., nv) has to overcome, in its rows (..., k) [N m | N]."""
        w = v[..., self.rows]
        level = self.coulomb + self.excess * np.exp(-np.square(w / self.stribeck))
        return np.asarray(level * np.tanh(w / self.speed))

    def slope(self, v: Array) -> Array:
        """Derivative of `force` by the speeds of its rows, shape (k,)."""
        w = v[self.rows]
        fall, smooth = np.exp(-np.square(w / self.stribeck)), np.tanh(w / self.speed)
        level = self.coulomb + self.excess * fall
        bend = -2.0 * self.excess * fall * w / self.stribeck**2
        return np.asarray(level * (1.0 - smooth**2) / self.speed + bend * smooth)

    def power(self, v: Array) -> Array:
        """Power that it takes (...), W, of speeds (..., nv)."""
        return np.asarray(np.sum(self.force(v) * v[..., self.rows], axis=-1))

    def tables(self) -> dict[str, Array | IntArray]:
        """Tables for the compiled kernel."""
        law = np.column_stack([self.coulomb, self.excess, self.stribeck, self.speed])
        return {"rub_v": self.rows, "rub_law": law}


def excess(rubs: Friction) -> float:
    """E with which the largest friction is breakaway: smoothing would cut it by some per cent."""
    wanted = rubs.breakaway - rubs.coulomb
    if not wanted:
        return 0.0
    v = np.linspace(0.0, 3.0, _SPEEDS) * rubs.stribeck
    smooth = np.tanh(v / rubs.speed)
    falling, found = np.exp(-np.square(v / rubs.stribeck)) * smooth, wanted
    for _ in range(_ROUNDS):
        at = int(np.argmax(rubs.coulomb * smooth + found * falling))
        found = (rubs.breakaway - rubs.coulomb * smooth[at]) / falling[at]
    return float(found)


def joint_friction(description: Description, model: pin.Model) -> DryFriction:
    """Dry friction of the joints of a description."""
    found = []
    for name, extra in description.joints.items():
        rubs = extra.friction
        if rubs is not None and rubs.dry and model.existJointName(name):
            row = int(model.joints[model.getJointId(name)].idx_v)
            found.append((row, rubs.coulomb, excess(rubs), rubs.stribeck, rubs.speed))
    if not found:
        return DryFriction()
    rows, *numbers = zip(*found, strict=True)
    return DryFriction(np.array(rows, dtype=np.intp), *(np.array(x, float) for x in numbers))


@frozen
class Springs:
    """Springs on single-axis joints: torque -k (q - rest).

    Attributes:
        v_at: Velocity rows. q_at: Position of the coordinate in q (its cosine if it has two).
        paired: True where q holds (cos, sin). stiffness: N m/rad | N/m. rest: rad | m.
    """

    v_at: IntArray
    q_at: IntArray
    paired: IntArray
    stiffness: Array
    rest: Array

    def angles(self, y: Array) -> Array:
        """Positions (rad | m) of the joints with springs at y (..., nq), shape (..., springs)."""
        angle = np.array(y[..., self.q_at])
        for k in np.flatnonzero(self.paired):
            angle[..., k] = np.arctan2(y[..., self.q_at[k] + 1], y[..., self.q_at[k]])
        return angle
