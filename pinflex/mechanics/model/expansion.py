"""The expanded Pinocchio model: rigid joints plus the stations and interfaces of flexible links.

A flexible link is a set of stations (small rigid slices carrying its mass) and interfaces (where
other links attach). Each is a joint on the link's own frame, and its coordinates are functions of
the link's modal coordinates eta, right to second order:

    u = Phi eta + 1/2 eta' G eta,      X = du/deta = Phi + G eta

With the rigid coordinates q kept as they are, minimal coordinates y = (q, eta) map to expanded ones
Q = T(y), V = X v, A = X a + Xdot v, and Pinocchio does the rest on Q.

Joints come first, and what they carry is put on them in the end: a design that differs in masses
and stiffness alone has the joints and the map of another one, and is weighed anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import repeat

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.superelement import Superelement
from pinflex.mechanics.manifold import bounded
from pinflex.mechanics.model.loads import (
    Attachment,
    Block,
    ElasticDrive,
    Expansion,
    Interface,
    Slot,
    gear_name,
    rigid_indices,
)
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.tree import JointStep, Link

Row = tuple[int, Array, Array | None]  # velocity row of the expanded model, Phi (n,), G (n, n)


def _blocks(
    model: pin.Model, slices: Sequence[slice], maps: Sequence[Sequence[Row]]
) -> Iterator[Block]:
    """The map of each body; curved rows come first."""
    # where in Q each velocity row is, of joints with as many of one as of the other
    at, first, counts = (np.array(x.tolist()) for x in (model.idx_qs, model.idx_vs, model.nvs))
    q_of = np.repeat(at - first, counts) + np.arange(model.nv)
    for eta, every in zip(slices, maps, strict=True):
        ordered, n = sorted(every, key=lambda row: row[2] is None), eta.stop - eta.start
        rows = np.array([row for row, _, _ in ordered], dtype=np.intp)
        Phi = np.array([Phi for _, Phi, _ in ordered], dtype=float).reshape(-1, n)
        G = np.array([G for *_, G in ordered if G is not None], dtype=float).reshape(-1, n, n)
        G = 0.5 * (G + G.swapaxes(1, 2))  # eta' G eta has no other part
        yield Block(rows, q_of[rows], Phi, G, eta)


_POINT, _STRAIGHT, _HERE = np.zeros((3, 3)), np.eye(3), pin.SE3.Identity()
_NOWHERE = np.zeros(3)
_SLIDE = pin.JointModelTranslation()
_TURNS = pin.JointModelRZ(), pin.JointModelRY(), pin.JointModelRX()


# What joints carry: the inertias of a link, of all or some of its stations, or of a rider on it.

Of = Callable[[Sequence[Link], Mapping[str, FlexiblePart]], Sequence[pin.Inertia]]
# Joints, the places of what they carry (each in the frame of the next), and what that is.
Carried = tuple[Sequence[int], tuple[pin.SE3, ...], Of]


def _own(number: int, links: Sequence[Link], _: object) -> Sequence[pin.Inertia]:
    return (links[number].inertia,)


def _undeformed(name: str, _: object, parts: Mapping[str, FlexiblePart]) -> Sequence[pin.Inertia]:
    return parts[name].rigid_inertias()


def _rider(
    name: str, number: int, _: object, parts: Mapping[str, FlexiblePart]
) -> Sequence[pin.Inertia]:
    return (parts[name].riders[number].inertia,)


def _of_stations(
    name: str, segment: int, turned: bool, _: object, parts: Mapping[str, FlexiblePart]
) -> Sequence[pin.Inertia]:
    body = parts[name].bodies[segment]
    tensors = map(np.diag, body.inertia) if turned else repeat(_POINT)  # type: ignore[arg-type]
    masses = zip(body.mass.tolist(), tensors, strict=False)
    return [pin.Inertia(mass, _NOWHERE, tensor) for mass, tensor in masses]


def _of_twists(
    name: str, segment: int, _: object, parts: Mapping[str, FlexiblePart]
) -> Sequence[pin.Inertia]:
    turning = parts[name].bodies[segment].It.tolist()
    return [pin.Inertia(0.0, _NOWHERE, np.diag([one, 0.0, 0.0])) for one in turning]


def _weigh(
    model: pin.Model,
    carried: Iterable[Carried],
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
) -> None:
    """Put on joints what they carry."""
    for joints, places, of in carried:
        for joint, inertia in zip(joints, of(links, parts), strict=True):
            for place in places:
                inertia = place.act(inertia)
            model.appendBodyToJoint(joint, inertia, _HERE)


def weighed(
    expansion: Expansion, links: Sequence[Link], parts: Mapping[str, FlexiblePart]
) -> Expansion:
    """The same joints under links and parts that move alike (`FlexiblePart.moves_as`)."""
    model, none = pin.Model(expansion.model), pin.Inertia.Zero()
    for joint in {joint for joints, _, _ in expansion.carried for joint in joints}:
        model.inertias[joint] = none
    _weigh(model, expansion.carried, links, parts)
    bodies = {name: iter(part.bodies) for name, part in parts.items()}
    slots = tuple(replace(slot, body=next(bodies[slot.link])) for slot in expansion.slots)
    return replace(expansion, model=model, slots=slots)


@dataclass
class _Section:
    """What a section of a flexible link carries: links, and riders of it, by their numbers."""

    children: list[int] = field(default_factory=list)
    riders: list[int] = field(default_factory=list)


def _section(sections: list[dict[float, _Section]], part: FlexiblePart, x: float) -> _Section:
    """The section at x [m] of a link among those of its segments, made where it is new."""
    segment, local = part.segment_of(x)
    return sections[segment].setdefault(local, _Section())


@dataclass
class _Assembler:
    """Adds joints depth first: every joint of a subtree before any joint of another."""

    links: Sequence[Link]
    parts: Mapping[str, FlexiblePart]
    needed: frozenset[str]
    flexible: bool
    model: pin.Model
    frames: dict[str, Attachment] = field(default_factory=dict)
    slots: list[Slot] = field(default_factory=list)
    maps: list[list[tuple[int, Array, Array | None]]] = field(default_factory=list)
    n_eta: int = 0
    geared: frozenset[str] = frozenset()
    gears: list[tuple[str, int]] = field(default_factory=list)
    carried: list[Carried] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.children: list[list[int]] = [[] for _ in self.links]
        for number, link in enumerate(self.links):
            if link.parent >= 0:
                self.children[link.parent].append(number)

    def run(self) -> None:
        for number, link in enumerate(self.links):
            if link.parent < 0:
                self._child(number, Attachment(0, pin.SE3.Identity()), link.placement)

    def _link(self, number: int, here: Attachment) -> None:
        link = self.links[number]
        self.frames[link.name] = here
        if link.name in self.needed:
            body = pin.FrameType.BODY
            self.model.addFrame(pin.Frame(link.name, here.joint, 0, here.placement, body))
        part = self.parts.get(link.name)
        if part is not None and self.flexible:
            self._flexible_link(number, here, part)
            return
        if part is None:
            self._append(here, partial(_own, number))
        else:
            count = len(part.rigid_inertias())
            self._append(here, partial(_undeformed, link.name), count=count)
        for child in self.children[number]:
            self._child(child, here, self.links[child].placement)

    def _matters(self, number: int) -> bool:
        """A massless, fixed frame that nothing refers to needs no section of its own."""
        link = self.links[number]
        if link.steps or link.weighs or link.name in self.needed:
            return True
        return any(self._matters(child) for child in self.children[number])

    def _child(self, number: int, here: Attachment, placement: pin.SE3) -> None:
        """Hang a link, by its joints, at a pose in the frame of an attachment."""
        link = self.links[number]
        joint, placement = here.joint, here.placement * placement
        for step in link.steps:
            joint = self.model.addJoint(joint, step.model, placement, step.name)
            placement = pin.SE3.Identity()
            if self.flexible and step.name in self.geared:
                joint = self._gear(joint, step)
        self._link(number, Attachment(joint, placement))

    def _gear(self, motor: int, step: JointStep) -> int:
        """The joint between motor and link, about the same axis: its coordinate is elastic."""
        name, model = gear_name(step.name), bounded(step.model)
        joint = int(self.model.addJoint(motor, model, pin.SE3.Identity(), name))
        self.gears.append((step.name, int(self.model.joints[joint].idx_v)))
        return joint

    def _flexible_link(self, number: int, here: Attachment, part: FlexiblePart) -> None:
        """Chain the segments, each with its stations, and hang the children where they sit."""
        root = Attachment(here.joint, here.placement * part.placement)
        if part.bodies[0].solid is not None:
            self._solid(number, root, part, part.bodies[0].solid)
            return
        sections: list[dict[float, _Section]] = [{} for _ in part.bodies]
        for child in self.children[number]:
            if self._matters(child):
                x = part.section_of(self.links[child].placement.translation)
                _section(sections, part, x).children.append(child)
        for number, rider in enumerate(part.riders):
            _section(sections, part, rider.x).riders.append(number)
        for k, body in enumerate(part.bodies):
            if k + 1 < len(part.bodies):
                sections[k].setdefault(body.length, _Section())
            root = self._body(part, body, k, root, sections[k])

    def _body(
        self,
        part: FlexiblePart,
        body: FlexibleBody,
        k: int,
        root: Attachment,
        sections: dict[float, _Section],
    ) -> Attachment:
        """A segment with what its sections carry, these by their x from its root; its tip."""
        offset = k * body.length
        eta = slice(self.n_eta, self.n_eta + body.n)
        self.n_eta += body.n
        slot_number = len(self.slots)
        self.maps.append([])
        stations, turning = self._stations(part.link, k, body, root)
        twists = self._twists(part.link, k, body, root)
        self.slots.append(Slot(part.link, offset, body, eta, root, stations, twists, (), turning))
        interfaces: list[Interface] = []
        following = root
        if body.root_moves and k == 0:
            sections.setdefault(0.0, _Section())
        for x, section in sorted(sections.items()):
            if x <= 0 and not body.root_moves:
                here = root
            else:
                Phi, G = body.rows(x)
                place = np.array([x, 0.0, 0.0])
                interfaces.append(self._node(root, slot_number, place, Phi, G))
                here = interfaces[-1].attachment
            for number in section.riders:
                apart = np.array([part.riders[number].x - offset - x, 0.0, 0.0])
                of = partial(_rider, part.link, number)
                self._append(here, of, pin.SE3(np.eye(3), apart))
            to_section = part.placement * pin.SE3(np.eye(3), np.array([offset + x, 0.0, 0.0]))
            for child in section.children:
                self._child(child, here, to_section.actInv(self.links[child].placement))
            if x == body.length:
                following = here
        self.slots[slot_number] = replace(self.slots[slot_number], interfaces=tuple(interfaces))
        return following

    def _solid(
        self, number: int, root: Attachment, part: FlexiblePart, solid: Superelement
    ) -> None:
        """A reduced solid: its points, then each interface with the children nearest to it."""
        body = part.bodies[0]
        eta = slice(self.n_eta, self.n_eta + body.n)
        self.n_eta += body.n
        slot = len(self.slots)
        self.maps.append([])
        stations, _ = self._stations(part.link, 0, body, root)
        none = np.zeros(0, dtype=np.intp)
        self.slots.append(Slot(part.link, 0.0, body, eta, root, stations, none, ()))
        places = [solid.held[1], *(node.place for node in solid.nodes)]
        nearest: list[list[int]] = [[] for _ in places]
        for child in self.children[number]:
            if self._matters(child):
                at = part.placement.actInv(self.links[child].placement.translation)
                nearest[int(np.argmin([np.linalg.norm(at - p) for p in places]))].append(child)
        interfaces: list[Interface] = []
        for k, children in enumerate(nearest):
            carrier, section, to_place = root, root.placement, part.placement
            if k:
                node = solid.nodes[k - 1]
                interfaces.append(self._node(root, slot, node.place, node.Phi, node.G))
                carrier, section = interfaces[-1].attachment, pin.SE3.Identity()
                to_place = part.placement * pin.SE3(np.eye(3), node.place)
            for child in children:
                placement = to_place.actInv(self.links[child].placement)
                self._child(child, Attachment(carrier.joint, section), placement)
        self.slots[slot] = replace(self.slots[slot], interfaces=tuple(interfaces))

    def _stations(
        self, name: str, segment: int, body: FlexibleBody, root: Attachment
    ) -> tuple[IntArray, tuple[int, ...]]:
        """Rows of the stations of a body, and the joints of those that turn with inertia."""
        rows, slot = np.empty((len(body.mass), 3), dtype=np.intp), len(self.slots)
        turned = body.inertia is not None and body.Phi_r is not None
        joints, slides = [], list[int]()
        for k, place in enumerate(body.points):
            joint, rows[k] = self._slide(root, place)
            self._map(slot, rows[k], body.Phi[k], None if body.G is None else body.G[k])
            if turned:
                slides.append(joint)
                turn = None if body.G_r is None else body.G_r[k]
                joint = self._turn(joint, slot, body.Phi_r[k], turn)  # type: ignore[index]
            joints.append(joint)
        self.carried.append((joints, (), partial(_of_stations, name, segment, turned)))
        return rows, tuple(slides)

    def _twists(self, name: str, segment: int, body: FlexibleBody, root: Attachment) -> IntArray:
        rows = np.arange(self.model.nv, self.model.nv + len(body.xt), dtype=np.intp)
        joints = []
        for _ in body.It:
            called = f"twist {self.model.njoints}"
            joints.append(self.model.addJoint(root.joint, _TURNS[2], root.placement, called))
        self.carried.append((joints, (), partial(_of_twists, name, segment)))
        self._map(len(self.slots), rows, body.Phi_t, body.G_t)
        return rows

    def _node(
        self, root: Attachment, slot: int, place: Array, Phi: Array, G: Array | None
    ) -> Interface:
        joint, slide = self._slide(root, place)
        self._map(slot, slide, Phi[:3], None if G is None else G[:3])
        joint = self._turn(joint, slot, Phi[3:], None if G is None else G[3:])
        return Interface(float(place[0]), Attachment(joint, pin.SE3.Identity()), slide)

    def _slide(self, root: Attachment, place: Array) -> tuple[int, IntArray]:
        """A joint that moves along x, y and z, and its velocity rows."""
        placement, row = root.placement * pin.SE3(_STRAIGHT, place), int(self.model.nv)
        name = f"section {self.model.njoints}"
        joint = int(self.model.addJoint(root.joint, _SLIDE, placement, name))
        return joint, np.arange(row, row + 3)

    def _turn(self, joint: int, slot: int, Phi: Array, G: Array | None) -> int:
        """Rotations z, y, x of a section: only the ones that move become joints."""
        moves = Phi.any(axis=1) if G is None else Phi.any(axis=1) | G.any(axis=(1, 2))
        some, row = np.flatnonzero(moves), int(self.model.nv)
        for direction in some:
            name = f"turn {self.model.njoints}"
            joint = int(self.model.addJoint(joint, _TURNS[direction], _HERE, name))
        rows = np.arange(row, row + len(some))
        self._map(slot, rows, Phi[some], None if G is None else G[some])
        return joint

    def _map(self, slot: int, rows: IntArray, Phi: Array, G: Array | None) -> None:
        bent = np.zeros(len(rows), dtype=bool)
        if G is not None:
            bent[:] = G.any(axis=(1, 2))
        self.maps[slot] += [
            (row, Phi[k], G[k] if G is not None and curved else None)
            for k, (row, curved) in enumerate(zip(rows.tolist(), bent.tolist(), strict=True))
        ]

    def _append(self, here: Attachment, of: Of, *places: pin.SE3, count: int = 1) -> None:
        if here.joint:
            self.carried.append(([here.joint] * count, (*places, here.placement), of))


def expand(
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    needed: frozenset[str],
    rigid: pin.Model | None,
    gravity: Array,
    geared: frozenset[str] = frozenset(),
) -> Expansion:
    """Build the expanded model with its maps, or, with `rigid=None`, the rigid tree itself."""
    model = pin.Model()
    model.gravity.linear = np.array(gravity, float)
    work = _Assembler(links, parts, needed, rigid is not None, model, geared=geared)
    work.run()
    _weigh(model, work.carried, links, parts)
    q_at, v_at = rigid_indices(model if rigid is None else rigid, model)
    places = enumerate(work.gears, start=work.n_eta)
    drives = tuple(ElasticDrive(name, eta, row) for eta, (name, row) in places)
    slices = [slot.eta for slot in work.slots] + [slice(d.eta, d.eta + 1) for d in drives]
    turn = np.ones(1)  # the joint turns by the elastic coordinate itself
    blocks = tuple(_blocks(model, slices, [*work.maps, *([(d.row, turn, None)] for d in drives)]))
    n_eta = work.n_eta + len(drives)
    slots, carried = tuple(work.slots), tuple(work.carried)
    return Expansion(model, q_at, v_at, blocks, work.frames, slots, n_eta, drives, carried)


def of_model(model: pin.Model, links: Sequence[Link]) -> Expansion:
    """Pinocchio's own model as an expansion with nothing added."""
    frames: dict[str, Attachment] = {}
    for link in links:
        frame = model.frames[model.getFrameId(link.name, pin.FrameType.BODY)]
        frames[link.name] = Attachment(int(frame.parentJoint), frame.placement)
    return Expansion(model, np.arange(model.nq), np.arange(model.nv), (), frames, (), 0)
