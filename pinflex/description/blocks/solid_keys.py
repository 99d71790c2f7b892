"""Keys of solid links in a description: the kinds mesh and matrices of `basis`."""

from __future__ import annotations

from functools import partial
from typing import Any

from pinflex.description.reading import schema
from pinflex.errors import DescriptionError

KINDS = ("mesh", "matrices")
BEAM_KEYS = (
    *("bending_y", "bending_z", "torsion", "axial", "rotary_inertia", "third_order", "shear"),
    *("root", "tip", "section", "patches"),
)


def is_solid(basis: object) -> bool:
    """Whether a parsed block `basis` is that of a solid."""
    return isinstance(basis, dict) and basis.get("kind") in KINDS


def refuse_beam_keys(block: dict[str, Any], place: dict[str, str]) -> None:
    """Keys that mean something for beams only."""
    for key in BEAM_KEYS:
        if key in block:
            raise DescriptionError(
                f"{place[key]}: a solid deforms in every direction and has its own inertia, so "
                "this has no meaning for it. Remove it."
            )
    if block.get("inertia", "beam") == "urdf":
        raise DescriptionError(
            f"{place['inertia']}: a solid has the mass of its mesh or matrices. Remove it."
        )
    if block.get("segments", 1) != 1:
        raise DescriptionError(f"{place['segments']}: a solid is one body. Remove it.")


def read(key: str, value: object, place: str) -> Any:
    """One key of the kinds mesh and matrices."""
    if key in ("file", "mass", "stiffness", "nodes"):
        return schema.text(value, place)
    if key == "modes":
        return schema.integer(value, place, 1, 1000)
    if key == "rod":
        return _rod(value, place)
    if key == "interfaces":
        box = partial(schema.numbers, size=6, of="place")
        return tuple(
            (name, item if isinstance(item, str) else box(item, f"{place}.{name}"))
            for name, item in schema.mapping(value, place).items()
        )
    return schema.number(value, place, above=0, of="ratio" if key == "scale" else "length")


def _rod(value: object, where: str) -> tuple[tuple[float, float], ...]:
    """(diameter, length) of each segment from {diameters: [...], lengths: [...]}."""
    block = schema.mapping(value, where, ("diameters", "lengths"), ("diameters",))
    count = len(schema.items(block["diameters"], f"{where}.diameters"))
    if "lengths" not in block and count != 1:
        raise DescriptionError(
            f"{where}.lengths: missing. Give the length [m] of each of the {count} diameters."
        )
    pairs: list[tuple[float, float]] = []
    lengths: list[Any] = [0.0]
    if "lengths" in block:
        lengths = schema.items(block["lengths"], f"{where}.lengths", count)
    for k, (d, x) in enumerate(zip(block["diameters"], lengths, strict=True)):
        diameter = schema.number(d, f"{where}.diameters[{k}]", above=0, of="length")
        span = 0.0
        if "lengths" in block:
            span = schema.number(x, f"{where}.lengths[{k}]", above=0, of="length")
        pairs.append((diameter, span))
    return tuple(pairs)


def check(kind: str, block: dict[str, Any], where: str) -> None:
    """A solid comes from one source, and has at least the interface at which it is held."""
    sources = {"mesh": ("file", "rod"), "matrices": ("file", "mass")}[kind]
    given = [key for key in sources if key in block]
    if len(given) != 1:
        raise DescriptionError(
            f"{where}: {' and '.join(given) or 'nothing'} given for the body. Give one of "
            f"{', '.join(sources)}."
        )
    if "mass" in block and not {"stiffness", "nodes"} <= block.keys():
        raise DescriptionError(f"{where}: mass needs stiffness and nodes beside it. Give all.")
    if "rod" in block and block.keys() & {"interfaces", "scale"}:
        raise DescriptionError(
            f"{where}: a rod is built in m, and its ends are the interfaces. Remove interfaces and "
            "scale."
        )
    if "rod" not in block and not block.get("interfaces"):
        raise DescriptionError(
            f"{where}.interfaces: missing. Name the rigid regions, first the one fixed to the "
            "link's frame: {root: GROUP, tip: GROUP}."
        )
