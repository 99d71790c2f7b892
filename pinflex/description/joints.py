"""The block `joints` of a description: what a URDF cannot say about a joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pinflex.description import fields, schema
from pinflex.description.schema import Vec3
from pinflex.description.source import Source
from pinflex.errors import DescriptionError
from pinflex.text import brief

TYPES = ("fixed", "spherical", "universal")  # in place of the URDF's
_SPRINGS = ("spring", "parallel_spring", "rest")
_KEYS = ("type", "axes", "rotor_inertia", *_SPRINGS, "damper")
_LAW = ("follows", "ratio", "offset")


@dataclass(frozen=True)
class JointExtra:
    """What a URDF cannot say about a joint.

    Attributes:
        name: URDF joint.
        type: fixed, spherical or universal, in place of the URDF's type; None keeps that.
        axes: The two unit axes of a universal joint in the joint frame; None: x, then y.
        rotor_inertia: Inertia of the motor, seen at the joint [kg m^2 | kg].
        spring: Stiffness [N m/rad | N/m].
        parallel_spring: Whether it acts beside a motor.
        rest: Position where the spring is slack [rad | m].
        damper: Viscous damping [N m s/rad | N s/m].
        follows: Joint that it follows; "": none, whatever the URDF says; None: as in the URDF.
        ratio, offset: Its position is ratio times that joint's + offset [rad | m].
    """

    __repr__ = brief

    name: str
    type: str | None = None
    axes: tuple[Vec3, Vec3] | None = None
    rotor_inertia: float = fields.real(0.0, "inertia", low=0)
    spring: float = fields.real(0.0, "stiffness", low=0)
    rest: float = fields.real(0.0, "position")
    damper: float = fields.real(0.0, "damping", low=0)
    parallel_spring: bool = False
    follows: str | None = None
    ratio: float = fields.real(1.0, "ratio")
    offset: float = fields.real(0.0, "position")


def read_joints(value: object, where: str, urdf: Source) -> dict[str, JointExtra]:
    """The block `joints`, by joint name."""
    return {
        name: _joint(name, item, schema.at(where, name), urdf)
        for name, item in schema.mapping(value, where).items()
    }


def _joint(name: str, value: object, where: str, urdf: Source) -> JointExtra:
    schema.known(name, where, urdf.joints, f"joint in {urdf.file}")
    keys = (*_KEYS, *_LAW)
    block = schema.mapping(value, where, keys)
    place = {key: schema.at(where, key) for key in keys}
    kind = _type(block, name, place["type"], urdf)
    _require_one_freedom(block, kind, urdf.joints[name].type, place, urdf.file)
    values = fields.read(JointExtra, block, place)
    if "follows" in block:
        values["follows"] = _followed(block["follows"], place["follows"], urdf)
    elif "ratio" in block or "offset" in block:
        key = "ratio" if "ratio" in block else "offset"
        raise DescriptionError(f"{place[key]}: there is no joint to follow. Add `follows`.")
    if "parallel_spring" in block:  # a stiffness in the file, a flag beside `spring` in the record
        beside, at = block["parallel_spring"], place["parallel_spring"]
        stiffness = schema.number(beside, at, low=0, of="stiffness")
        if "spring" in block:
            raise DescriptionError(f"{at}: beside `spring`. Remove one of them.")
        values |= {"spring": stiffness, "parallel_spring": True}
    if "rest" in block and "spring" not in values:
        raise DescriptionError(f"{place['rest']}: there is no spring. Add `spring`.")
    if "axes" in block:
        values["axes"] = _axes(block["axes"], place["axes"], kind)
    return JointExtra(name, kind, **values)


def _followed(value: object, where: str, urdf: Source) -> str:
    """Joint that is followed; "" for `false`, which lets a joint with a mimic tag go."""
    if value is False:
        return ""
    return schema.known(value, where, urdf.joints, f"joint in {urdf.file}")


def _type(block: dict[str, Any], name: str, place: str, urdf: Source) -> str | None:
    """The type that takes the place of the URDF's."""
    if "type" not in block:
        return None
    written = urdf.joints[name].type
    kind = schema.choice(block["type"], place, TYPES)
    if written == kind:
        raise DescriptionError(f"{place}: {urdf.file} says {written} already. Remove the key.")
    return kind


def _require_one_freedom(
    block: dict[str, Any], kind: str | None, written: str, place: dict[str, str], file: str
) -> None:
    """Springs need a joint of one freedom, and every number a joint that moves."""
    for key in (key for key in block if key not in ("type", "axes")):
        if kind == "fixed":
            raise DescriptionError(
                f"{place[key]}: the joint is fixed by its `type`, so it would do nothing. "
                "Remove one of them."
            )
        if written == "fixed" and kind is None:
            raise DescriptionError(
                f"{place[key]}: the joint is fixed in {file}, so it would do "
                "nothing. Remove it, or give the joint a type."
            )
        if key in _SPRINGS and (kind or written in ("floating", "planar")):
            raise DescriptionError(
                f"{place[key]}: a {kind or written} joint has no one spring. "
                "Springs act on joints of one degree of freedom. Split the joint in the URDF."
            )


def _axes(value: object, where: str, kind: str | None) -> tuple[Vec3, Vec3]:
    if kind != "universal":
        raise DescriptionError(f"{where}: only a universal joint has two. Add type: universal.")
    pair = schema.items(value, where, 2)
    a, b = (schema.direction(axis, f"{where}[{i}]") for i, axis in enumerate(pair))
    if abs(sum(x * y for x, y in zip(a, b, strict=True))) > 1 - 1e-9:
        raise DescriptionError(f"{where}: {schema.shown(value)} are parallel. Turn one of them.")
    return a, b
