"""Mass of a flexible link beside its own beam: rigid masses at its ends, the beam as built."""

from __future__ import annotations

from dataclasses import dataclass

from pinflex.description import material, schema, section
from pinflex.description.material import Material
from pinflex.description.schema import Vec3
from pinflex.description.section import Section


@dataclass(frozen=True)
class EndMass:
    """A rigid mass at an end of a flexible link: mass [kg], moments of inertia [kg m^2]."""

    mass: float = 0.0
    inertia: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class AsBuilt:
    """The beam of the link whose inertia the URDF has; None or 0: as described.

    Attributes:
        material: Its density counts. section: Its area and moments.
        length: Its span [m].
    """

    material: Material | None = None
    section: Section | None = None
    length: float | None = None


def read_end_mass(spec: object, where: str) -> EndMass:
    """A mass from {mass, inertia}."""
    block = schema.mapping(spec, where, ("mass", "inertia"))
    turning, moving = block.get("inertia", (0, 0, 0)), block.get("mass", 0)
    inertia = schema.vector(turning, schema.at(where, "inertia"), low=0, of="inertia")
    return EndMass(schema.number(moving, schema.at(where, "mass"), low=0, of="mass"), inertia)


def read_as_built(spec: object, where: str) -> AsBuilt:
    """The beam of the URDF's link from {material, section, length}."""
    block = schema.mapping(spec, where, ("material", "section", "length"))
    place = {key: schema.at(where, key) for key in block}
    return AsBuilt(
        material.from_spec(block["material"], place["material"]) if "material" in block else None,
        section.from_spec(block["section"], place["section"]) if "section" in block else None,
        schema.number(block["length"], place["length"], above=0, of="length")
        if "length" in block
        else None,
    )
