"""The block `loops` of a description: joints that close loops, and the table of their kinds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex import registered
from pinflex.description.blocks.external import WORLD, ends
from pinflex.description.blocks.joints import FRICTION, Friction, read_friction
from pinflex.description.blocks.material import MATERIALS
from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.reading.schema import Vec3
from pinflex.errors import DescriptionError
from pinflex.text import frozen

Pairs = tuple[tuple[int, int], ...]
ALONG: Pairs = ((0, 2), (1, 2))  # axis z of b along axis z of a
TURNED: Pairs = ((0, 1), (1, 2), (2, 0))  # b turned as a
# Of a joint with clearance, of a pin (or a ball) in a hole, and of a slider in a guide.
LOOSE = ("clearance", "restitution", "contact")
PIN = (*LOOSE, "pin", "pin_material", "friction")
GUIDE = (*LOOSE, "across", "length", "height")
CONTACTS = ("flores", "lankarani_nikravesh", "rigid")
_UPRIGHT = 1e-9  # cosine between directions that are perpendicular
_NO_TURN: tuple[Pairs, ...] = (ALONG, TURNED)


@dataclass(frozen=True)
class LoopKind:
    """A kind of closure: which rows hold frame b at frame a. Axes are 0, 1, 2 for x, y, z.

    Attributes:
        name: Value of the key `kind`.
        points: Axes of frame a along which the origins are held together.
        directions: Pairs (axis of a, axis of b) held perpendicular: none, one pair, `ALONG` (two
            axes on one line) or `TURNED` (no turn at all).
        keys: Further keys of the loop that have a meaning for it: axis, axis_b, length, sleeve, ...
    """

    name: str
    points: tuple[int, ...] = ()
    directions: Pairs = ()
    keys: tuple[str, ...] = ()


LOOP_KINDS: dict[str, LoopKind] = {
    kind.name: kind
    for kind in (
        LoopKind("weld", (0, 1, 2), TURNED),
        LoopKind("revolute", (0, 1, 2), ALONG, ("axis", "axial", *PIN)),
        LoopKind("prismatic", (0, 1), TURNED, ("axis", *GUIDE)),
        LoopKind("cylindrical", (0, 1), ALONG, ("axis",)),
        LoopKind("universal", (0, 1, 2), ((2, 0),), ("axis", "axis_b")),
        LoopKind("spherical", (0, 1, 2), (), PIN),
        LoopKind("planar", (0, 1), (), ("axis", *PIN)),
        LoopKind("distance", keys=("length",)),  # one row of its own
        LoopKind("slider", keys=("sleeve", "pivoting", "turning")),  # the rows of its sleeve
    )
}
# Not for files: keeps a rod between two balls from turning about itself.
_SPIN = LoopKind("spin", (), ((2, 0),), ("axis", "axis_b"))
_OWN = {kind.name: kind for kind in (_SPIN, LoopKind("coupling"))}


def loop_kind(name: str) -> LoopKind:
    """The row of the table of a kind, those that no file names included."""
    return _OWN[name] if name in _OWN else LOOP_KINDS[name]


def register_loop_kind(kind: LoopKind) -> None:
    """Add a kind of closure made of known rows; from then on `kind: NAME` is read and solved.

    Args:
        kind: Its row of the table.
    Raises:
        DescriptionError: The name is taken, or the rows are none that can be held.
    """
    where = f"loop kind {kind.name}"
    if kind.name in LOOP_KINDS or kind.name in _OWN:
        raise DescriptionError(f"{where}: there is one of that name. Choose another.")
    axes: Sequence[int] = (*kind.points, *(axis for pair in kind.directions for axis in pair))
    if not axes or not {*axes} <= {0, 1, 2} or len({*kind.points}) < len(kind.points):
        raise DescriptionError(
            f"{where}: {kind.points}, {kind.directions} hold nothing, or an axis that is not 0, 1 "
            "or 2, or one twice. Give the axes of `points`, pairs of axes in `directions`."
        )
    if len(kind.directions) > 1 and kind.directions not in _NO_TURN:
        raise DescriptionError(
            f"{where}: directions {kind.directions}. Allowed: none, one pair, ALONG = {ALONG}, "
            f"TURNED = {TURNED}; a search for a closed pose knows the angles of these."
        )
    if not {*kind.keys} <= {"axis", "axis_b"}:
        raise DescriptionError(f"{where}: keys {kind.keys}. Allowed: axis, axis_b.")
    LOOP_KINDS[kind.name] = kind
    registered.note(register_loop_kind, kind.name, kind)


def _pin_friction(value: object, where: str) -> Friction:
    """Coulomb's coefficient of pin and hole, or the block `friction` with coefficients in it."""
    if not isinstance(value, Mapping):
        value = {"coulomb": schema.number(value, where, low=0)}
    for key in ("coulomb", "breakaway"):
        if key in value:
            schema.number(value[key], schema.at(where, key), low=0)  # which has no unit
    if "viscous" in value:
        raise DescriptionError(
            f"{schema.at(where, 'viscous')}: pin and hole rub by coefficients, which have no "
            "viscous part. Remove it."
        )
    return read_friction(value, where)


@frozen
class Loop:
    """A joint that closes a loop between two frames of the tree.

    Attributes:
        name: Name for reports.
        kind: One of `LOOP_KINDS`.
        frame_a: First frame.
        frame_b: Second frame.
        axis: Unit axis of the joint, in frame a and in frame b (universal: in frame a only).
        axis_b: universal: unit axis in frame b; None: x.
        length: distance: [m]; None: as it is at home. Of a slider in its guide [m].
        sleeve: slider: length of the sleeve [m]; 0: it touches the beam at a point.
        pivoting: slider: the sleeve turns freely on three points in line, instead of along the
            beam's tangent at its middle.
        turning: slider: the sleeve may turn against frame b; else it is fixed to it.
        clearance: Radius of the hole less that of the pin, free way of a slider to each side of
            the guide [m]; None: the joint is ideal.
        pin: Diameter of the pin [m]. pin_material: Of pin and hole.
        axial: Play of a pin along its axis to each side [m]; None: it has none.
        across: Direction of the play of a slider, across `axis`, in frame a. height: Of the slider
            in it [m].
        restitution: Part of the speed that a blow gives back, above 0 to 1.
        contact: What a blow is damped by: one of `CONTACTS`.
        friction: Of pin and hole, its coulomb and breakaway as coefficients.
        grounded: Whether the frame called `WORLD` is a place on the ground: that which the guess
            of home gives to the other frame.
        at: Point of the ground instead of it [m].
    """

    name: str
    kind: str
    frame_a: str
    frame_b: str
    axis: Vec3 = schema.direction_key((0.0, 0.0, 1.0))
    axis_b: Vec3 | None = schema.direction_key(None)
    length: float | None = schema.real(None, "length", above=0)
    sleeve: float = schema.real(0.0, "length", low=0)
    pivoting: bool = schema.flag(False)
    turning: bool = schema.flag(True)
    clearance: float | None = schema.real(None, "length", above=0)
    pin: float | None = schema.real(None, "length", above=0)
    axial: float | None = schema.real(None, "length", above=0)
    across: Vec3 | None = schema.direction_key(None)
    height: float = schema.real(0.0, "length", low=0)
    friction: Friction | None = schema.key(None, _pin_friction, form=FRICTION)
    restitution: float = schema.real(0.9, above=0, high=1)
    contact: str = schema.word("flores", CONTACTS)
    pin_material: str = schema.word("steel", MATERIALS)
    grounded: bool = False
    at: Vec3 | None = schema.bare(schema.place_form)


RESIST = ("stiffness", "damping", "friction", "rest")  # keys of joints that resist
BUSHING = "bushing"
_KEPT = schema.keys(Loop)
LOOPS = schema.keys(
    Loop, "kind", "between",
    kind=schema.bare(lambda: {"enum": [*LOOP_KINDS, BUSHING]}, required=True),
    between=schema.bare(schema.PAIR, required=True),
)  # fmt: skip


def resists(spec: Mapping[str, Any]) -> bool:
    """Whether a loop becomes joints of the tree; pins with clearance have a friction of their own.

    See `pinflex.description.blocks.bushing`.
    """
    if spec.get("kind") == BUSHING:
        return True
    loose = spec.get("clearance") is not None
    return any(spec.get(key) is not None and not (loose and key == "friction") for key in RESIST)


def read_loops(value: object, where: str, urdf: Source) -> tuple[Loop, ...]:
    """The block `loops`, in file order."""
    return tuple(_loop(name, block, urdf) for name, block in schema.entries(value, where, LOOPS))


def _loop(name: str, block: schema.Block, urdf: Source) -> Loop:
    kind = schema.choice(block["kind"], block.at("kind"), LOOP_KINDS)
    pair = schema.items(block["between"], block.at("between"), 2)
    grounded = "at" in block or (WORLD not in urdf.links and WORLD in pair)
    a, b = ends(pair, block.at("between"), urdf, grounded)
    at = _at(block, (a, b), kind)
    for key in _KEPT:
        if key in block and key != "at" and key not in LOOP_KINDS[kind].keys:
            owners = ", ".join(k.name for k in LOOP_KINDS.values() if key in k.keys)
            raise block.error(
                key,
                f"has no meaning for the kind {kind}, only for {owners}. Remove it, or change the "
                "kind.",
            )
    loop = Loop(name, kind, a, b, **block.read(), grounded=grounded, at=at)
    if loop.pivoting and loop.sleeve == 0:
        raise block.error("pivoting", "a sleeve of no length turns anyway. Give `sleeve` in m.")
    loop = _with_clearance(loop, block)
    if loop.pivoting and not loop.turning:
        raise block.error(
            "turning", "false, but `pivoting` lets the sleeve turn. Remove one of them."
        )
    return loop


def _with_clearance(loop: Loop, block: schema.Block) -> Loop:
    """A loop whose keys of clearance fit each other."""
    if loop.clearance is None:
        keys = {*PIN, *GUIDE, "axial"} - ({"length"} if loop.kind == "distance" else set())
        block.only(keys, "the joint is ideal. Add `clearance` in m.")
        return loop
    guide = loop.kind == "prismatic"
    contact = "rigid" if guide and "contact" not in block else loop.contact
    if guide and contact != "rigid":
        raise block.error(
            "contact",
            f"{contact} is for pins, by Hertz. A slider meets its guide as a rigid body: remove "
            "it, or write rigid.",
        )
    if contact == "rigid" and loop.friction is not None and loop.friction.dry:
        raise block.error("friction", "rigid blows have none. Remove it, or write contact: flores.")
    if guide and (loop.across is None or abs(np.dot(loop.across, loop.axis)) > _UPRIGHT):
        raise block.error(
            "across",
            "in which direction has the slider play? Give one perpendicular to `axis` "
            f"{list(loop.axis)}, in frame {loop.frame_a}.",
        )
    if contact != "rigid" and loop.pin is None:
        raise block.error("clearance", "of which pin? Add its diameter: `pin`; or contact: rigid.")
    return replace(loop, contact=contact)


def _at(block: schema.Block, ends: tuple[str, str], kind: str) -> Vec3 | None:
    """The point of the ground that is held; None: where home has the frame."""
    if WORLD in ends and kind == "slider":
        raise block.error(
            "",
            "a sleeve needs a frame of the robot or of its base. Add a massless link there.",
        )
    value = block.get("at")
    if "at" in block and WORLD not in ends:
        raise block.error(
            "at",
            f"a place on the ground, but neither frame is {WORLD}. Name it in `between`.",
        )
    return None if value in (None, "home") else schema.vector(value, block.at("at"), of="place")
