"""The blocks `forces`, `springs` and `added_masses`: what acts from outside the joints."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.reading.schema import Vec3
from pinflex.errors import DescriptionError

# Frames as a description names them: by their link, or by the joint that carries that link.

WORLD = "world"  # the ground as a frame of a loop or a spring


def frame(value: object, where: str, urdf: Source) -> str:
    """Link of a frame; a joint's name means its child link, unless a link has that name too."""
    if isinstance(value, str) and value.strip() in urdf.joints:
        name = value.strip()
        return name if name in urdf.links else urdf.joints[name].child
    return schema.known(value, where, urdf.links, f"link in {urdf.file}")


def frames(value: object, where: str, urdf: Source) -> tuple[str, ...]:
    """A list of different frames."""
    found: list[str] = []
    for i, item in enumerate(schema.items(value, where)):
        name = frame(item, f"{where}[{i}]", urdf)
        if name in found:
            by = "" if item == name else f" ({schema.shown(item)} is the joint that carries it)"
            raise DescriptionError(
                f'{where}[{i}]: "{name}" is listed twice{by}. Keep one.', name=name
            )
        found.append(name)
    return tuple(found)


def ends(pair: list[Any], where: str, urdf: Source, grounded: bool) -> tuple[str, str]:
    """Two frames of which one may be the ground."""
    if not grounded or WORLD not in pair:
        a, b = frames(pair, where, urdf)
        return a, b
    number = pair.index(WORLD)
    if pair.count(WORLD) > 1:
        raise DescriptionError(f"{where}: the ground cannot be held to itself. Name a frame.")
    other = frame(pair[1 - number], f"{where}[{1 - number}]", urdf)
    return (WORLD, other) if number == 0 else (other, WORLD)


def by_joint(block: Mapping[str, Any], urdf: Source) -> dict[str, str]:
    """Frames of a checked YAML that joints name: the link of each such joint."""
    asked: list[Any] = [block.get("platform"), *(block.get("frames") or ())]
    for group in ("loops", "forces", "springs", "flexible"):
        for item in (block.get(group) or {}).values():
            if isinstance(item, dict):
                asked += [item.get(key) for key in ("at", "start", "end")]
                asked += item.get("between") or ()
    names = {name.strip() for name in asked if isinstance(name, str)}
    return {name: urdf.joints[name].child for name in sorted(names - {*urdf.links})
            if name in urdf.joints}  # fmt: skip


def _at() -> Any:
    """The key `at`: the frame at which something acts."""
    return schema.key(schema.REQUIRED, frame, key="at", given=True, form=schema.TEXT)


_SNAP = 1e-13  # of the time: one that rounds to a switch is past it; stages inside are further off


@dataclass(frozen=True)
class FrameForce:
    """A load at a frame.

    Attributes:
        name: Name for reports.
        frame: Where it acts.
        force: [N], in the world; of a follower, in the frame.
        moment: [N m], likewise.
        follower: Turns with the frame.
        start, until: When it acts [s]. ramp: Time it takes to come on, linearly [s].
    """

    name: str
    frame: str = _at()
    force: Vec3 = schema.triple((0.0, 0.0, 0.0), "force")
    moment: Vec3 = schema.triple((0.0, 0.0, 0.0), "moment")
    follower: bool = schema.flag(False)
    start: float = schema.real(0.0, "time", low=0)
    until: float | None = schema.real(None, "time", low=0)
    ramp: float = schema.real(0.0, "time", low=0)

    @property
    def timed(self) -> bool:
        """Whether it changes in time."""
        return self.start > 0 or self.until is not None or self.ramp > 0

    @property
    def potential(self) -> bool:
        """Whether its force has one: constant in the world. A moment in space has none."""
        return not self.follower and not self.timed

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which it, or its slope, changes [s]."""
        times = {self.start, self.start + self.ramp}
        return tuple(sorted(times if self.until is None else times | {self.until}))

    def scale(self, t: float) -> float:
        """Share of the load that acts at a time t [s]: just after, where it switches."""
        past = t + _SNAP * max(1.0, t)
        if past < self.start or (self.until is not None and past >= self.until):
            return 0.0
        return max(0.0, min(1.0, (t - self.start) / self.ramp)) if self.ramp else 1.0


@dataclass(frozen=True)
class FrameSpring:
    """A spring with a damper between the origins of two frames.

    Attributes:
        name: Name for reports.
        frame_a, frame_b: Its ends.
        stiffness: [N/m]. damper: [N s/m]. length: Unloaded [m].
        at: Point of the ground [m] where an end is `WORLD`.
        tension_only: A cable: it does not push.
        table: Elongations [m] and forces [N] in place of the stiffness.
    """

    name: str
    frame_a: str
    frame_b: str
    stiffness: float = schema.real(0.0, "stiffness", low=0)
    damper: float = schema.real(0.0, "damping", low=0)
    length: float = schema.real(0.0, "length", low=0)
    at: Vec3 | None = schema.key(None, partial(schema.vector, of="place"), form=schema.place_form)
    tension_only: bool = schema.flag(False)
    table: schema.Points = schema.points_key("place", "force")

    @property
    def frames(self) -> tuple[str, ...]:
        """Its ends on the robot."""
        pair = (self.frame_a, self.frame_b)
        return pair if self.at is None else tuple(name for name in pair if name != WORLD)


@dataclass(frozen=True)
class AddedMass:
    """Inertia at a frame that differs with the direction, and has no weight.

    Attributes:
        name: Name for reports.
        frame: Whose axes the directions are.
        mass: Along x, y, z [kg]. inertia: About them [kg m^2].
    """

    name: str
    frame: str = _at()
    mass: Vec3 = schema.triple((0.0, 0.0, 0.0), "mass", 0.0)
    inertia: Vec3 = schema.triple((0.0, 0.0, 0.0), "inertia", 0.0)


ADDED_MASSES, FORCES = schema.keys(AddedMass), schema.keys(FrameForce)
SPRINGS = schema.keys(FrameSpring, "between", between=schema.bare(schema.PAIR, required=True))


def read_added_masses(value: object, where: str, urdf: Source) -> tuple[AddedMass, ...]:
    """The block `added_masses`, in file order."""
    found = []
    for name, block in schema.entries(value, where, ADDED_MASSES):
        values = block.read(urdf)
        if not any(any(values.get(key, ())) for key in ("mass", "inertia")):
            raise block.error("", "no mass. Give mass: [x, y, z] or inertia: [x, y, z].")
        found.append(AddedMass(name, **values))
    return tuple(found)


def read_forces(value: object, where: str, urdf: Source) -> tuple[FrameForce, ...]:
    """The block `forces`, in file order."""
    found = []
    for name, block in schema.entries(value, where, FORCES):
        values = block.read(urdf)
        if not values.keys() & {"force", "moment"}:
            raise block.error("", "no load. Give force: [x, y, z] or moment: [x, y, z].")
        found.append(FrameForce(name, **values))
    return tuple(found)


def read_springs(value: object, where: str, urdf: Source) -> tuple[FrameSpring, ...]:
    """The block `springs`, in file order."""
    found = []
    for name, item in schema.mapping(value, where).items():
        need = ("between",) if isinstance(item, dict) and "table" in item else ()
        block = schema.Block(
            item, schema.at(where, name), SPRINGS, *(need or ("between", "stiffness"))
        )
        pair = schema.items(block["between"], block.at("between"), 2)
        grounded = WORLD not in urdf.links and WORLD in pair
        if grounded != ("at" in block):
            what = "Give it." if grounded else f"Neither end is {WORLD}: remove it."
            raise block.error(
                "at", f"the point of the ground [m] of a spring between a frame and {WORLD}. {what}"
            )
        a, b = ends(pair, block.at("between"), urdf, grounded)
        found.append(FrameSpring(name, a, b, **block.read()))
        if "table" in block:
            text = "beside `table`, which says all of the force. Remove one."
            block.only(("stiffness", "tension_only"), text)
    return tuple(found)


# The block `payload`: what the robot carries at a frame, with its weight and inertia.

_NEGATIVE = 1e-9  # of the largest principal moment: round-off of one that is zero


@dataclass(frozen=True)
class Payload:
    """A rigid body that a frame carries.

    One that comes or goes (`timed`) moves with the frame as it does: speeds stay, and accelerations
    jump. It is no link of the model then but an added mass, with its weight as a load, in time.

    Attributes:
        name: Of the link that it becomes.
        frame: What carries it; its axes are those of `centre` and `inertia`.
        mass: [kg].
        centre: Centre of mass [m].
        inertia: About the centre: xx yy zz xy xz yz [kg m^2].
        start, until: When it is carried [s].
    """

    name: str
    frame: str = _at()
    mass: float = schema.real(schema.REQUIRED, "mass", low=0)
    centre: Vec3 = schema.triple((0.0, 0.0, 0.0), "place")
    inertia: tuple[float, ...] = schema.key((0.0,) * 6, lambda x, at: _inertia(x, at), form={})
    start: float = schema.real(0.0, "time", low=0, key="from")
    until: float | None = schema.real(None, "time", low=0)

    def __str__(self) -> str:
        x, y, z = self.centre
        away = f", its centre at [{x:g}, {y:g}, {z:g}] m" if any(self.centre) else ""
        away += f", from {self.start:g} s" if self.start else ""
        away += "" if self.until is None else f", until {self.until:g} s"
        return f"{self.mass:g} kg at {self.frame}{away}"

    @property
    def timed(self) -> bool:
        """Whether it comes or goes on the way."""
        return self.start > 0.0 or self.until is not None

    def weight(self, gravity: Vec3) -> FrameForce:
        """Its weight, to act at its centre: also without gravity, as the clock of its mass."""
        x, y, z = (self.mass * g for g in gravity)
        return FrameForce(self.name, self.frame, (x, y, z), start=self.start, until=self.until)

    @property
    def weighs(self) -> bool:
        """Whether there is anything to carry."""
        return self.mass > 0.0 or any(self.inertia)

    @property
    def tensor(self) -> np.ndarray:
        """Inertia about the centre of mass (3, 3) [kg m^2]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def spatial(self) -> np.ndarray:
        """Inertia (6, 6) about the frame's origin, of the twist (velocity, angular velocity)."""
        x, y, z = self.centre
        cross = self.mass * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turning = self.tensor - cross @ cross / self.mass if self.mass else self.tensor
        return np.block([[self.mass * np.eye(3), -cross], [cross, turning]])


def read_payload(value: object, where: str, urdf: Source) -> Payload | None:
    """The block; None where it weighs nothing."""
    block = schema.Block(value, where, PAYLOAD)
    found = Payload(_free_name({*urdf.links, *urdf.joints}), **block.read(urdf))
    if not found.mass and any(found.centre):
        raise block.error("centre", "no mass has a centre. Give a mass.")
    if found.until is not None and found.until <= found.start:
        text = f"{found.until:g} s. Give a time after `from`, {found.start:g} s."
        raise block.error("until", text)
    return found if found.weighs else None


PAYLOAD = schema.keys(Payload)


def _inertia(value: object, where: str) -> tuple[float, ...]:
    """Three or six moments of a body that can be."""
    many = list(value) if isinstance(value, list | tuple) else []
    if len(many) not in (3, 6):
        raise DescriptionError(
            f"{where}: {schema.shown(value)}. Give [xx, yy, zz] or [xx, yy, zz, xy, xz, yz] about "
            "the centre of mass, kg m^2."
        )
    lows = [0.0, 0.0, 0.0, -math.inf, -math.inf, -math.inf]
    moments = tuple(
        schema.number(x, f"{where}[{k}]", low=low, of="inertia")
        for k, (x, low) in enumerate(zip(many, lows, strict=False))
    )
    moments += (0.0,) * (6 - len(moments))
    principal = np.linalg.eigvalsh(Payload("", "", 0.0, inertia=moments).tensor)
    if principal[0] < -_NEGATIVE * principal[2]:
        shown = ", ".join(f"{m:.4g}" for m in principal)
        raise DescriptionError(
            f"{where}: the principal moments are {shown} kg m^2. None may be negative. Check the "
            "products of inertia."
        )
    return moments


def _free_name(taken: Collection[str]) -> str:
    """A name for the link that the robot does not use."""
    name = "payload"
    while {name, f"{name}_joint"} & {*taken}:
        name += "_"
    return name
