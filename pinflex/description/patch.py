"""Piezoelectric patches on a flexible link: a voltage that bends it. The block `patches`.

A patch from x1 to x2 does the virtual work  dW = k V (f'(x2) - f'(x1)) : two opposite moments k V.
"""

from __future__ import annotations

from dataclasses import dataclass

from pinflex.description import schema
from pinflex.description.section import Section
from pinflex.errors import DescriptionError


@dataclass(frozen=True)
class Patch:
    """A patch that bends its link along beam y.

    Attributes:
        name: Name of the actuator.
        start, end: Where it begins and ends along the beam [m].
        constant: k, bending moment per volt [N m/V].
    """

    name: str
    start: float
    end: float
    constant: float

    def require_on_beam(self, where: str, length: float) -> None:
        """Raise where the patch does not lie on a beam of a length [m]."""
        if 0.0 <= self.start < self.end <= length * (1.0 + 1e-9):
            return
        raise DescriptionError(
            f"{where}.patches.{self.name}: it lies from {self.start:g} to {self.end:g} m, the beam "
            f"from 0 to {length:g} m. Give 0 <= from < to <= {length:g}."
        )


def piezo_constant(
    d31: float, E_patch: float, width: float, thickness: float, E: float, b: float, h: float
) -> float:
    """Bending moment per volt of a patch on one face, k = -d31 E Ep h^2 b bp / (E h b + Ep hp bp).

    Source: Sharifnia, Akbarzadeh (2016), eq. 32.
    """
    stretch = E * h * b + E_patch * thickness * width
    return -d31 * E * E_patch * h**2 * b * width / stretch


_SIZES = ("d31", "E", "width", "thickness")
KEYS = ("from", "to", "constant", *_SIZES)


def read_patches(value: object, where: str, E: float, section: Section) -> tuple[Patch, ...]:
    """The block `patches` of a link, in file order."""
    found = []
    for name, item in schema.mapping(value, where).items():
        here = schema.at(where, name)
        block = schema.mapping(item, here, KEYS, ("from", "to"))
        start, end = (
            schema.number(block[k], schema.at(here, k), of="place") for k in ("from", "to")
        )
        if "constant" in block:
            for key in block.keys() & set(_SIZES):
                raise DescriptionError(
                    f"{schema.at(here, key)}: redundant with `constant`. Give one."
                )
            constant = schema.number(block["constant"], schema.at(here, "constant"), of="moment")
        else:
            schema.mapping(item, here, None, _SIZES)
            d31 = schema.number(block["d31"], schema.at(here, "d31"), low=-1, high=1)
            E_patch, width, thickness = (
                schema.number(
                    block[k], schema.at(here, k), above=0, of="elasticity" if k == "E" else "length"
                )
                for k in _SIZES[1:]
            )
            y, z = zip(*section.outline, strict=True)
            h, b = max(y) - min(y), max(z) - min(z)
            constant = piezo_constant(d31, E_patch, width, thickness, E, b, h)
        found.append(Patch(name, start, end, constant))
    return tuple(found)
