"""The block `joints` of a description: what a URDF cannot say about a joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any

from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.reading.schema import Vec3
from pinflex.errors import DescriptionError
from pinflex.text import frozen

# The blocks `drive` and `friction` of a joint: motor and gear, their compliance and friction.
#
# A drive is a motor of inertia J_m behind a gear of ratio n, and between gear and link a spring:
#
#     joint angle = motor angle / n + eta,     torque on the link = -(K eta + D deta/dt)
#
# The motor's inertia n^2 J_m turns with the motor angle over n; that the rotor also turns with the
# link that carries it is left out, as usual for large n. With backlash b the spring is slack, and
# its damper idle, where |eta| < b / 2. Source: Spong (1987), J. Dyn. Syst. Meas. Control 109,
# assumption A1; Siciliano & Khatib, Handbook of Robotics, ch. 11; friction: Armstrong-Helouvry,
# Dupont & Canudas de Wit (1994), Automatica 30.

SPEED = 1e-3  # smoothing speed [rad/s | m/s]: a sticking joint creeps at less
_STRIBECK = 10.0  # Stribeck speed over the smoothing speed, where none is given


@frozen
class Friction:
    """Friction in a joint of one freedom, smooth in the speed v [rad/s | m/s]:

    F = (coulomb + E exp(-(v / stribeck)^2)) tanh(v / speed) + viscous v

    with E about breakaway - coulomb, such that the largest dry friction is breakaway.

    Attributes:
        coulomb: While it slides [N m | N]. breakaway: Largest at rest, at least `coulomb`.
        viscous: [N m s/rad | N s/m].
        stribeck: Speed at which breakaway has fallen to sliding [rad/s | m/s].
        speed: Smoothing speed [rad/s | m/s]: below it the joint sticks, that is, creeps.
    """

    coulomb: float = schema.real(0.0, "moment", low=0)
    viscous: float = schema.real(0.0, "damping", low=0)
    breakaway: float = schema.real(0.0, "moment", low=0)
    stribeck: float = schema.real(_STRIBECK * SPEED, "speed", above=0)
    speed: float = schema.real(SPEED, "speed", above=0)

    @property
    def dry(self) -> bool:
        """Whether there is more than the viscous part, which is a damper."""
        return self.breakaway > 0.0


@frozen
class Drive:
    """Motor and gear of a joint; without stiffness the gear is rigid.

    Attributes:
        gear: Turns of the motor for one of the joint; of a prismatic joint [rad/m].
        motor_inertia: Of rotor, shaft and wave generator, at the motor [kg m^2].
        stiffness: Of the gear, at the joint [N m/rad | N/m]; None: rigid.
        damping: Beside it [N m s/rad | N s/m].
        efficiency: Of the gear: power out over power in, 0 to 1.
        limit_curve: Motor speeds [rad/s] and the torque that the motor has there [N m].
        backlash: Play of the gear, from flank to flank, at the joint [rad | m].
    """

    gear: float = schema.real(1.0, "ratio")
    motor_inertia: float = schema.real(0.0, "inertia", low=0)
    stiffness: float | None = schema.real(None, "stiffness", above=0)
    damping: float = schema.real(0.0, "damping", low=0)
    efficiency: float = schema.real(1.0, above=0, high=1)
    limit_curve: schema.Points = schema.points_key("speed", "moment", 0, curve=True)
    backlash: float = schema.real(0.0, "angle", low=0)

    @property
    def rotor_inertia(self) -> float:
        """Inertia of the motor, seen at the joint [kg m^2 | kg]."""
        return self.gear**2 * self.motor_inertia


@dataclass(frozen=True)
class Tension:
    """Torques of more motors than freedoms that pull at every strut.

    Attributes:
        force: By this at least [N].
    """

    force: float = schema.real(schema.REQUIRED, "force", low=0, key="tension")


def read_share(value: object, where: str) -> str | Tension:
    """How more motors than freedoms share: `least`, or a least tension."""
    if isinstance(value, dict):
        return Tension(**schema.Block(value, where, _TENSION).read())
    if value != "least":
        raise DescriptionError(
            f"{where}: {schema.shown(value)} is not known. Allowed: least, {{tension: FORCE}} with "
            "the least pull of every strut in N."
        )
    return "least"


_TENSION, _FRICTION = schema.keys(Tension), schema.keys(Friction)
SHARE: schema.Form = {"anyOf": [{"enum": ["least"]}, schema.block_form(_TENSION)]}
FRICTION: schema.Form = {"anyOf": [schema.measure(None), schema.block_form(_FRICTION)]}


def read_friction(value: object, where: str) -> Friction:
    """The block `friction`."""
    block = schema.Block(value, where, _FRICTION)
    found = block.read()
    coulomb, speed = found.get("coulomb", 0.0), found.get("speed", SPEED)
    if "stribeck" in found and "breakaway" not in found:
        raise block.error("stribeck", "there is no breakaway to fall from. Add `breakaway`.")
    breakaway = found.setdefault("breakaway", coulomb)
    if breakaway < coulomb:
        raise block.error(
            "breakaway",
            f"{breakaway:g} is less than coulomb, {coulomb:g}. A joint at rest holds at least what "
            "rubs while it slides. Raise it, or remove it.",
        )
    if found.setdefault("stribeck", _STRIBECK * speed) < speed:
        raise block.error(
            "stribeck",
            f"{found['stribeck']:g} is less than the smoothing speed, {speed:g}, so that breakaway "
            "would never be reached. Lower `speed` to a tenth of it.",
        )
    return Friction(**found)


_RUBS = schema.key(None, read_friction, form=FRICTION)
_DRIVE = schema.keys(
    Drive, "gear", "motor_inertia", "stiffness", "damping", "friction", friction=_RUBS
)


def read_drive(value: object, where: str, reduction: float | None) -> tuple[Drive, Friction | None]:
    """The block `drive`, and the friction in it."""
    block = schema.Block(value, where, _DRIVE)
    found = ({} if reduction is None else {"gear": reduction}) | block.read()
    if "damping" in found and "stiffness" not in found:
        raise block.error(
            "damping",
            "the drive has no stiffness, so nothing moves in it that could be damped. Add "
            "`stiffness`, or write `friction: {viscous: ...}`.",
        )
    if found.get("backlash") and "stiffness" not in found:
        raise block.error(
            "backlash",
            "the drive has no stiffness, so nothing takes up the play. Add `stiffness`.",
        )
    if found.get("gear") == 0.0:
        raise block.error("gear", "0: the motor would not turn. Write its ratio.")
    rubs = found.pop("friction", None)
    return Drive(**found), rubs


def urdf_friction(coulomb: float) -> Friction:
    """The friction of a URDF's <dynamics friction=...>: dry, with the usual smoothing speed."""
    return Friction(coulomb=coulomb, breakaway=coulomb)


def elastic(joints: Mapping[str, Any]) -> dict[str, Drive]:
    """The drives that give way, by joint."""
    found = {name: extra.drive for name, extra in joints.items() if extra.drive is not None}
    return {name: drive for name, drive in found.items() if drive.stiffness is not None}


TYPES = ("fixed", "spherical", "universal")  # in place of the URDF's
_SINGLE = ("spring", "parallel_spring", "rest", "drive", "friction", "stops", "table")


def _way(value: object, where: str, of: str) -> float:
    return schema.number(value, where, of=of)


@frozen
class Stops:
    """Ends of a joint's way: a spring with a damper beyond them, or a coefficient of restitution.

    Attributes:
        lower, upper: Where they are [rad | m]; None: on that side there is none.
        stiffness: [N m/rad | N/m]. damping: While it is touched [N m s/rad | N s/m].
        restitution: Part of the speed that a rigid stop gives back, 0 to 1; None: it is a spring.
    """

    lower: float | None = schema.key(None, _way, given=True, form=schema.measure("angle"))
    upper: float | None = schema.key(None, _way, given=True, form=schema.measure("angle"))
    stiffness: float | None = schema.real(None, "stiffness", above=0)
    damping: float = schema.real(0.0, "damping", low=0)
    restitution: float | None = schema.real(None, low=0, high=1)


_STOPS = schema.keys(Stops)


def _followed(value: object, where: str, urdf: Source) -> str:
    """Joint that is followed; "" for `false`, which lets a joint with a mimic tag go."""
    if value is False:
        return ""
    return schema.known(value, where, urdf.joints, f"joint in {urdf.file}")


@frozen
class JointExtra:
    """What a URDF cannot say about a joint.

    Attributes:
        name: URDF joint.
        type: fixed, spherical or universal, in place of the URDF's type; None keeps that.
        axes: The two unit axes of a universal joint in the joint frame; None: x, then y.
        rotor_inertia: Inertia of the motor, seen at the joint [kg m^2 | kg].
        spring: Stiffness [N m/rad | N/m].
        parallel_spring: Whether it acts from link to link, beside a motor if there is one.
        rest: Position where the spring is slack [rad | m].
        damper: Viscous damping [N m s/rad | N s/m].
        drive: Motor and gear. friction: Of the joint, or in its drive.
        follows: Joint that it follows; "": none, whatever the URDF says; None: as in the URDF.
        ratio, offset: Its position is ratio times that joint's + offset [rad | m].
        stops: Ends of its way. table: Positions [rad | m] and what it resists there by [N m | N].
    """

    name: str
    type: str | None = schema.bare({"enum": [*TYPES]})
    axes: tuple[Vec3, Vec3] | None = schema.bare(schema.LIST)
    rotor_inertia: float = schema.real(0.0, "inertia", low=0)
    spring: float = schema.real(0.0, "stiffness", low=0)
    parallel_spring: bool = schema.real(False, "stiffness", low=0)  # in the file its stiffness
    rest: float = schema.real(0.0, "position", form=schema.measure("angle"))
    damper: float = schema.real(0.0, "damping", low=0)
    drive: Drive | None = schema.bare(schema.block_form(_DRIVE))
    friction: Friction | None = _RUBS
    follows: str | None = schema.key(
        None, _followed, given=True, form={"anyOf": [schema.TEXT, {"const": False}]}
    )
    ratio: float = schema.real(1.0, "ratio")
    offset: float = schema.real(0.0, "position")
    stops: Stops | None = schema.bare(schema.block_form(_STOPS))
    table: schema.Points = schema.bare(schema.LIST, ())

    @property
    def armature(self) -> float:
        """Inertia of rotor and gear, seen at the joint [kg m^2 | kg]."""
        return self.rotor_inertia + (0.0 if self.drive is None else self.drive.rotor_inertia)

    @property
    def viscous(self) -> float:
        """Damper and viscous friction [N m s/rad | N s/m]."""
        return self.damper + (0.0 if self.friction is None else self.friction.viscous)


def read_joints(value: object, where: str, urdf: Source) -> dict[str, JointExtra]:
    """The block `joints`, by joint name."""
    return {
        name: _joint(name, item, schema.at(where, name), urdf)
        for name, item in schema.mapping(value, where).items()
    }


JOINTS = schema.keys(JointExtra)


def _joint(name: str, value: object, where: str, urdf: Source) -> JointExtra:
    several = [one.strip() for one in name.split(",")]
    if len(several) > 1 and name not in urdf.joints and all(one in urdf.joints for one in several):
        raise DescriptionError(
            f"{where}: a block is of one joint. Write one entry for each: {', '.join(several)}."
        )
    schema.known(name, where, urdf.joints, f"joint in {urdf.file}")
    block, written = schema.Block(value, where, JOINTS), urdf.joints[name]
    kind, of = _type(block, written.type, urdf.file), schema.quantity(written.type)
    _require_one_freedom(block, kind, written.type, urdf.file)
    if isinstance(block.get("rest"), str):
        block["rest"] = schema.number(block["rest"], block.at("rest"), of=of)
    values = block.read(urdf)
    if "follows" not in block:
        block.only(("ratio", "offset"), "there is no joint to follow. Add `follows`.")
    if "parallel_spring" in block:
        if "spring" in block:
            raise block.error("parallel_spring", "beside `spring`. Remove one of them.")
        values |= {"spring": values["parallel_spring"], "parallel_spring": True}
    if "rest" in block and "spring" not in values:
        raise block.error("rest", "there is no spring. Add `spring`.")
    if "stops" in block:
        values["stops"] = _stops(schema.Block(block["stops"], block.at("stops"), _STOPS), of)
        if written.type == "continuous":
            _require_within_a_turn(values["stops"], block.at("stops"))
    if "table" in block:
        values["table"] = schema.points(block["table"], block.at("table"), of, "moment")
    if "drive" in block:
        values |= _driven(block, written.reduction)
    if "axes" in block:
        values["axes"] = _axes(block["axes"], block.at("axes"), kind)
    return JointExtra(name, kind, **values)


def _stops(block: schema.Block, of: str) -> Stops:
    """The block `stops` of a joint whose positions are `of` a quantity."""
    found = Stops(**block.read(of))
    if found.lower is None and found.upper is None:
        raise block.error("", "no stop. Give `lower`, `upper` or both.")
    if found.lower is not None and found.upper is not None and found.lower >= found.upper:
        raise block.error(
            "upper", f"{found.upper:g} is not above lower, {found.lower:g}. Exchange them."
        )
    if (found.stiffness is None) == (found.restitution is None):
        raise block.error(
            "",
            "a stop is a spring (`stiffness`, and `damping` if you like) or rigid "
            "(`restitution`). Give one of the two.",
        )
    if "damping" in block and found.stiffness is None:
        raise block.error("damping", "a rigid stop has none. Give `stiffness`.")
    return found


def _require_within_a_turn(given: Stops, where: str) -> None:
    """Refuse stops that a joint without end would reach the long way round too."""
    ends = given.lower, given.upper
    if None in ends or not all(abs(x or 0.0) < pi for x in ends):
        raise DescriptionError(
            f"{where}: a continuous joint knows its angle between -pi and pi only, where a turn to "
            "the other side would meet the stop too. Give `lower` and `upper` within, or make the "
            "joint revolute in the URDF."
        )


def _driven(block: schema.Block, reduction: float | None) -> dict[str, Any]:
    """Drive and friction; what would say the same twice is refused."""
    drive, rubs = read_drive(block["drive"], block.at("drive"), reduction)
    if rubs is not None and "friction" in block:
        raise block.error("friction", "beside drive.friction. Remove one.")
    if drive.motor_inertia and "rotor_inertia" in block:
        text = f"beside drive.motor_inertia, which is {drive.rotor_inertia:g} at the joint."
        raise block.error("rotor_inertia", f"{text} Remove one.")
    if drive.stiffness is not None:
        side = "with drive.stiffness the joint's coordinate is the motor's side of the gear."
        if "parallel_spring" in block:
            raise block.error(
                "parallel_spring",
                f"it acts from link to link, and {side} Write the spring between two frames under "
                "`springs`.",
            )
        block.only(("stops", "table"), f"{side} Leave out one of them.")
    return {"drive": drive} | ({} if rubs is None else {"friction": rubs})


def with_urdf_dynamics(
    joints: dict[str, JointExtra],
    block: Mapping[str, Mapping[str, Any]],
    urdf: Source,
    single: tuple[str, ...],
) -> dict[str, JointExtra]:
    """The joints with damping and friction of the URDF, where the YAML says nothing of them."""
    found = dict(joints)
    for name in single:
        written = urdf.joints[name]
        extra = joints.get(name, JointExtra(name))
        viscous = extra.friction is not None and extra.friction.viscous
        if written.damping and not viscous and "damper" not in (block.get(name) or ()):
            extra = replace(extra, damper=written.damping)
        if written.friction and extra.friction is None:
            extra = replace(extra, friction=urdf_friction(written.friction))
        if extra != joints.get(name, JointExtra(name)):
            found[name] = extra
    return found


def _type(block: schema.Block, written: str, file: str) -> str | None:
    """The type that takes the place of the URDF's."""
    if "type" not in block:
        return None
    kind = schema.choice(block["type"], block.at("type"), TYPES)
    if written == kind:
        raise block.error("type", f"{file} says {written} already. Remove the key.")
    return kind


def _require_one_freedom(block: schema.Block, kind: str | None, written: str, file: str) -> None:
    """Springs need a joint of one freedom, and every number a joint that moves."""
    for key in (key for key in block if key not in ("type", "axes")):
        if kind == "fixed":
            raise block.error(
                key,
                "the joint is fixed by its `type`, so it would do nothing. Remove one of them.",
            )
        if written == "fixed" and kind is None:
            raise block.error(
                key,
                f"the joint is fixed in {file}, so it would do nothing. Remove it, or give the "
                "joint a type.",
            )
        if key in _SINGLE and (kind or written in ("floating", "planar")):
            what = {"drive": "Drives", "friction": "Friction"}.get(key, "Springs")
            one = what.lower().rstrip("s")
            raise block.error(
                key,
                f"a {kind or written} joint has no one {one}. {what} "
                f"{'acts' if what == 'Friction' else 'act'} on joints of one degree of freedom. "
                "Split the joint in the URDF.",
            )


def _axes(value: object, where: str, kind: str | None) -> tuple[Vec3, Vec3]:
    if kind != "universal":
        raise DescriptionError(f"{where}: only a universal joint has two. Add type: universal.")
    pair = schema.items(value, where, 2)
    a, b = (schema.direction(axis, f"{where}[{i}]") for i, axis in enumerate(pair))
    if abs(sum(x * y for x, y in zip(a, b, strict=True))) > 1 - 1e-9:
        raise DescriptionError(f"{where}: {schema.shown(value)} are parallel. Turn one of them.")
    return a, b


# Linear couplings of joints: `mimic` of a URDF, `follows` in the block `joints`.

SINGLE = ("revolute", "continuous", "prismatic")


@frozen
class Coupling:
    """Two joints that move as one: position = ratio times the leader's + offset.

    Attributes:
        joint: The one that follows. leader: The one it follows; None: one that stands still.
        ratio: [rad | m, over rad | m of the leader]. offset: [rad | m].
    """

    joint: str
    leader: str | None
    ratio: float
    offset: float


def couplings(
    urdf: Source, joints: Mapping[str, JointExtra], types: Mapping[str, str], where: str
) -> tuple[Coupling, ...]:
    """Couplings in the order of the joints; the YAML's `follows` goes before a URDF's `mimic`."""
    found: dict[str, Coupling] = {}
    for joint in urdf.joints.values():
        extra = joints.get(joint.name)
        place = f"{schema.at(where, joint.name)}.follows"
        law = None
        if extra is not None and extra.follows is not None:
            law = extra.follows, extra.ratio, extra.offset
        elif joint.mimic is not None and types[joint.name] in SINGLE:
            law = joint.mimic
        # Without a leader is `follows: false`; of one that is not there `check` tells.
        if law is not None and law[0] in urdf.joints:
            found[joint.name] = _coupling(joint.name, law, types, place)
    _refuse_rings(found, where)
    return tuple(found.values())


def _coupling(
    name: str, law: tuple[str, float, float], types: Mapping[str, str], place: str
) -> Coupling:
    """One coupling between joints of one freedom."""
    leader, ratio, offset = law
    kinds = {name: types[name], leader: types[leader]}
    if kinds[leader] == "fixed":
        return Coupling(name, None, 0.0, offset)
    for one, kind in kinds.items():
        if kind not in SINGLE:
            raise DescriptionError(
                f"{place}: {one} is {kind}. Couplings are between joints of one degree of freedom. "
                "Name another joint, or write `follows: false`."
            )
    return Coupling(name, leader, ratio, offset)


def _refuse_rings(found: Mapping[str, Coupling], where: str) -> None:
    for name in found:
        path, leader = [name], found[name].leader
        while leader is not None and leader in found and leader not in path:
            path.append(leader)
            leader = found[leader].leader
        if leader in path:
            raise DescriptionError(
                f"{schema.at(where, name)}.follows: {' follows '.join([*path, leader])}, round and "
                "round. Write `follows: false` for one of them."
            )


def read_actuated(
    value: object,
    where: str,
    types: Mapping[str, str],
    closed: bool,
    coupled: Sequence[Coupling],
) -> tuple[str, ...]:
    """Names of the joints with a motor: those given, or in an open chain all of one freedom."""
    followed = {one.joint: one.leader for one in coupled}
    single = tuple(name for name, kind in types.items() if kind in SINGLE)
    if value is not None:
        names = schema.names(value, where, single, "joint of one degree of freedom")
        for name in names:
            if name in followed:
                leader = followed[name] or "a fixed joint"
                raise DescriptionError(
                    f"{where}: {name} follows {leader}, so that it has no motor of its own. Take "
                    f"it out, or write joints.{name}.follows: false."
                )
        return names
    single = tuple(name for name in single if name not in followed)
    if closed:
        raise DescriptionError(
            f"{where}: missing. With loops not every joint has a motor. List those that do, or [] "
            f"for none. Joints: {', '.join(single[:12])}{', ...' if len(single) > 12 else ''}."
        )
    return single
