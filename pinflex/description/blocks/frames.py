"""Frames as a description names them: by their link, or by the joint that carries that link."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.errors import DescriptionError

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
