"""The blocks `drive` and `friction` of a joint: motor, gear, what gives way and what rubs in them.

A drive is a motor of inertia J_m behind a gear of ratio n, and between gear and link a spring:

    joint angle = motor angle / n + eta,     torque on the link = -(K eta + D deta/dt)

The motor's inertia n^2 J_m turns with the motor angle over n; that the rotor also turns with the
link that carries it is left out, as usual for large n. With backlash b the spring is slack, and its
damper idle, where |eta| < b / 2.
Source: Spong (1987), J. Dyn. Syst. Meas. Control 109, assumption A1; Siciliano & Khatib, Handbook
of Robotics, ch. 11; friction: Armstrong-Helouvry, Dupont & Canudas de Wit (1994), Automatica 30.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pinflex.description.reading import schema
from pinflex.errors import DescriptionError
from pinflex.text import brief

SPEED = 1e-3  # smoothing speed [rad/s | m/s]: a sticking joint creeps at less
_STRIBECK = 10.0  # Stribeck speed over the smoothing speed, where none is given
SHARE: dict[str, Any] = {  # as JSON Schema says it
    "anyOf": [
        {"enum": ["least"]},
        {
            "type": "object",
            "properties": {"tension": {"type": "number", "minimum": 0}},
            "required": ["tension"],
            "additionalProperties": False,
        },
    ]
}
KEYS = (
    *("gear", "motor_inertia", "stiffness", "damping"),
    *("friction", "efficiency", "limit_curve", "backlash"),
)


@dataclass(frozen=True)
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

    __repr__ = brief

    coulomb: float = schema.real(0.0, "moment", low=0)
    viscous: float = schema.real(0.0, "damping", low=0)
    breakaway: float = schema.real(0.0, "moment", low=0)
    stribeck: float = schema.real(_STRIBECK * SPEED, "speed", above=0)
    speed: float = schema.real(SPEED, "speed", above=0)

    @property
    def dry(self) -> bool:
        """Whether there is more than the viscous part, which is a damper."""
        return self.breakaway > 0.0


@dataclass(frozen=True)
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

    __repr__ = brief

    gear: float = 1.0
    motor_inertia: float = schema.real(0.0, "inertia", low=0)
    stiffness: float | None = schema.real(None, "stiffness", above=0)
    damping: float = schema.real(0.0, "damping", low=0)
    efficiency: float = schema.real(1.0, above=0, high=1)
    limit_curve: tuple[tuple[float, float], ...] = ()
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

    force: float


def read_share(value: object, where: str) -> str | Tension:
    """How more motors than freedoms share: `least`, or a least tension."""
    if isinstance(value, dict):
        key = schema.at(where, "tension")
        block = schema.mapping(value, where, ("tension",), ("tension",))
        return Tension(schema.number(block["tension"], key, low=0, of="force"))
    if value != "least":
        raise DescriptionError(
            f"{where}: {schema.shown(value)} is not known. Allowed: least, {{tension: FORCE}} with "
            "the least pull of every strut in N."
        )
    return "least"


def read_friction(value: object, where: str) -> Friction:
    """The block `friction`."""
    keys = schema.names_of(Friction)
    block = schema.mapping(value, where, keys)
    place = {key: schema.at(where, key) for key in keys}
    found = schema.read(Friction, block, place)
    coulomb, speed = found.get("coulomb", 0.0), found.get("speed", SPEED)
    if "stribeck" in found and "breakaway" not in found:
        raise DescriptionError(
            f"{place['stribeck']}: there is no breakaway to fall from. Add `breakaway`."
        )
    breakaway = found.setdefault("breakaway", coulomb)
    if breakaway < coulomb:
        raise DescriptionError(
            f"{place['breakaway']}: {breakaway:g} is less than coulomb, {coulomb:g}. A joint at "
            "rest holds at least what rubs while it slides. Raise it, or remove it."
        )
    if found.setdefault("stribeck", _STRIBECK * speed) < speed:
        raise DescriptionError(
            f"{place['stribeck']}: {found['stribeck']:g} is less than the smoothing speed, "
            f"{speed:g}, so that breakaway would never be reached. Lower `speed` to a tenth of it."
        )
    return Friction(**found)


def read_drive(value: object, where: str, reduction: float | None) -> tuple[Drive, Friction | None]:
    """The block `drive`, and the friction in it."""
    block = schema.mapping(value, where, KEYS)
    place = {key: schema.at(where, key) for key in KEYS}
    found: dict[str, Any] = schema.read(Drive, block, place)
    if "damping" in found and "stiffness" not in found:
        raise DescriptionError(
            f"{place['damping']}: the drive has no stiffness, so nothing moves in it that could be "
            "damped. Add `stiffness`, or write `friction: {viscous: ...}`."
        )
    if found.get("backlash") and "stiffness" not in found:
        raise DescriptionError(
            f"{place['backlash']}: the drive has no stiffness, so nothing takes up the play. Add "
            "`stiffness`."
        )
    if reduction is not None:
        found["gear"] = reduction
    if "gear" in block:
        found["gear"] = schema.number(block["gear"], place["gear"], of="ratio")
    if found.get("gear") == 0.0:
        raise DescriptionError(f"{place['gear']}: 0: the motor would not turn. Write its ratio.")
    if "limit_curve" in block:
        found["limit_curve"] = _curve(block["limit_curve"], place["limit_curve"])
    rubs = read_friction(block["friction"], place["friction"]) if "friction" in block else None
    return Drive(**found), rubs


def _curve(value: object, where: str) -> tuple[tuple[float, float], ...]:
    """Points [speed, torque] of a motor, speeds increasing from 0 or more."""
    points: list[tuple[float, float]] = []
    for k, item in enumerate(schema.items(value, where)):
        at = f"{where}[{k}]"
        pair = schema.items(item, at, 2)
        speed = schema.number(pair[0], f"{at}[0]", low=0, of="speed")
        points.append((speed, schema.number(pair[1], f"{at}[1]", low=0, of="moment")))
        if k and speed <= points[-2][0]:
            raise DescriptionError(
                f"{at}: the speed {speed:g} does not follow {points[-2][0]:g}. Write the points "
                "[motor speed rad/s, motor torque N m] by increasing speed."
            )
    if len(points) < 2:
        raise DescriptionError(f"{where}: one point is no curve. Write two or more.")
    return tuple(points)


def urdf_friction(coulomb: float) -> Friction:
    """The friction of a URDF's <dynamics friction=...>: dry, with the usual smoothing speed."""
    return Friction(coulomb=coulomb, breakaway=coulomb)


def elastic(joints: Mapping[str, Any]) -> dict[str, Drive]:
    """The drives that give way, by joint."""
    found = {name: extra.drive for name, extra in joints.items() if extra.drive is not None}
    return {name: drive for name, drive in found.items() if drive.stiffness is not None}
