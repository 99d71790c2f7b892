"""The blocks `forces`, `springs` and `added_masses`: what acts from outside the joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pinflex.description.blocks.frames import WORLD, ends, frame
from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.reading.schema import Vec3
from pinflex.errors import DescriptionError

FORCE_KEYS = ("at", "force", "moment", "follower", "start", "until", "ramp")
ADDED_KEYS = ("at", "mass", "inertia")
SPRING_KEYS = {"stiffness": "stiffness", "damper": "damping", "length": "length"}  # key, quantity


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
    frame: str
    force: Vec3 = (0.0, 0.0, 0.0)
    moment: Vec3 = (0.0, 0.0, 0.0)
    follower: bool = False
    start: float = 0.0
    until: float | None = None
    ramp: float = 0.0

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
        """Share of the load that acts at a time t [s]."""
        if t < self.start or (self.until is not None and t > self.until):
            return 0.0
        return min(1.0, (t - self.start) / self.ramp) if self.ramp else 1.0


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
    stiffness: float
    damper: float = 0.0
    length: float = 0.0
    at: Vec3 | None = None
    tension_only: bool = False
    table: tuple[tuple[float, float], ...] = ()

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
    frame: str
    mass: Vec3 = (0.0, 0.0, 0.0)
    inertia: Vec3 = (0.0, 0.0, 0.0)


def read_added_masses(value: object, where: str, urdf: Source) -> tuple[AddedMass, ...]:
    """The block `added_masses`, in file order."""
    found = []
    for name, item in schema.mapping(value, where).items():
        here = schema.at(where, name)
        block = schema.mapping(item, here, ADDED_KEYS, ("at",))
        at, fields = _at_frame(block, here, urdf, {"mass", "inertia"}, 0.0)
        if not any(any(vector) for vector in fields.values()):
            raise DescriptionError(f"{here}: no mass. Give mass: [x, y, z] or inertia: [x, y, z].")
        found.append(AddedMass(name, at, **fields))
    return tuple(found)


def read_forces(value: object, where: str, urdf: Source) -> tuple[FrameForce, ...]:
    """The block `forces`, in file order."""
    found = []
    for name, item in schema.mapping(value, where).items():
        here = schema.at(where, name)
        block = schema.mapping(item, here, FORCE_KEYS, ("at",))
        at, fields = _at_frame(block, here, urdf, {"force", "moment"})
        if not fields:
            raise DescriptionError(f"{here}: no load. Give force: [x, y, z] or moment: [x, y, z].")
        if "follower" in block:
            fields["follower"] = schema.boolean(block["follower"], schema.at(here, "follower"))
        for key in block.keys() & {"start", "until", "ramp"}:
            fields[key] = schema.number(block[key], schema.at(here, key), low=0, of="time")
        found.append(FrameForce(name, at, **fields))
    return tuple(found)


def _at_frame(
    block: dict[str, Any], here: str, urdf: Source, vectors: set[str], low: float = -math.inf
) -> tuple[str, dict[str, Any]]:
    """The frame of the key `at`, and those vectors that the block has."""
    at = frame(block["at"], schema.at(here, "at"), urdf)
    given = block.keys() & vectors
    return at, {k: schema.vector(block[k], schema.at(here, k), low=low, of=k) for k in given}


def read_springs(value: object, where: str, urdf: Source) -> tuple[FrameSpring, ...]:
    """The block `springs`, in file order."""
    found = []
    for name, item in schema.mapping(value, where).items():
        here = schema.at(where, name)
        keys = ("between", *SPRING_KEYS, "at", "tension_only", "table")
        need = ("between",) if isinstance(item, dict) and "table" in item else ()
        block = schema.mapping(item, here, keys, need or ("between", "stiffness"))
        pair = schema.items(block["between"], schema.at(here, "between"), 2)
        grounded = WORLD not in urdf.links and WORLD in pair
        if grounded != ("at" in block):
            raise DescriptionError(
                f"{here}.at: the point of the ground [m] of a spring between a frame and {WORLD}. "
                f"{'Give it.' if grounded else f'Neither end is {WORLD}: remove it.'}"
            )
        a, b = ends(pair, schema.at(here, "between"), urdf, grounded)
        values: dict[str, Any] = {
            key: schema.number(block[key], schema.at(here, key), low=0, of=quantity)
            for key, quantity in SPRING_KEYS.items()
            if key in block
        }
        values.setdefault("stiffness", 0.0)
        at = schema.vector(block["at"], schema.at(here, "at"), of="place") if grounded else None
        found.append(FrameSpring(name, a, b, **values, at=at, **_one_sided(block, here)))
    return tuple(found)


def _one_sided(block: dict[str, Any], here: str) -> dict[str, Any]:
    """What of a spring is not straight."""
    found: dict[str, Any] = {}
    if "tension_only" in block:
        taut = schema.boolean(block["tension_only"], schema.at(here, "tension_only"))
        found["tension_only"] = taut
    if "table" in block:
        found["table"] = schema.points(block["table"], schema.at(here, "table"), "place", "force")
        for key in block.keys() & {"stiffness", "tension_only"}:
            raise DescriptionError(
                f"{schema.at(here, key)}: beside `table`, which says all of the force. Remove one."
            )
    return found
