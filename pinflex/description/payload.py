"""The block `payload`: what the robot carries at a frame, with its weight and inertia."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from pinflex.description.blocks.frames import frame
from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.reading.schema import Vec3
from pinflex.errors import DescriptionError

KEYS = {"at": "", "mass": "mass", "centre": "place", "inertia": "inertia"}  # key, quantity
_TIMED = ("from", "until")
_NEGATIVE = 1e-9  # of the largest principal moment: round-off of one that is zero


@dataclass(frozen=True)
class Payload:
    """A rigid body that a frame carries from the start of a run to its end.

    Attributes:
        name: Of the link that it becomes.
        frame: What carries it; its axes are those of `centre` and `inertia`.
        mass: [kg].
        centre: Centre of mass [m].
        inertia: About the centre: xx yy zz xy xz yz [kg m^2].
    """

    name: str
    frame: str
    mass: float
    centre: Vec3 = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def __str__(self) -> str:
        x, y, z = self.centre
        away = f", its centre at [{x:g}, {y:g}, {z:g}] m" if any(self.centre) else ""
        return f"{self.mass:g} kg at {self.frame}{away}"

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
    """The block; None where it weighs nothing.

    Raises:
        DescriptionError: A payload that comes or goes on the way: masses are constant in a run.
    """
    block = dict(schema.mapping(value, where))
    for key in _TIMED:
        if key in block:
            raise DescriptionError(
                f"{schema.at(where, key)}: a payload stays for the whole run, for the masses of a "
                "model are constant. Run the scene twice, with and without `payload`, from rest to "
                "rest; what is grasped at speed is not modelled."
            )
    schema.mapping(block, where, tuple(KEYS), ("at", "mass"))
    centre = schema.vector(block.get("centre", (0, 0, 0)), schema.at(where, "centre"), of="place")
    found = Payload(
        _free_name({*urdf.links, *urdf.joints}),
        frame(block["at"], schema.at(where, "at"), urdf),
        schema.number(block["mass"], schema.at(where, "mass"), low=0, of="mass"),
        centre,
        _inertia(block.get("inertia", (0, 0, 0)), schema.at(where, "inertia")),
    )
    if not found.mass and any(found.centre):
        raise DescriptionError(f"{schema.at(where, 'centre')}: no mass has a centre. Give a mass.")
    return found if found.weighs else None


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
