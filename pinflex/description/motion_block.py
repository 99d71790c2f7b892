"""The block `motion` of a YAML file, checked against the robot that it moves."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pinflex.description import ranges, schema
from pinflex.errors import DescriptionError


def without_units(motion: object, types: Mapping[str, str]) -> object:
    """A motion whose displacements have no units: "3 deg" is a number of rad."""
    if not isinstance(motion, dict) or motion.get("kind") == "spin_up":  # those are speeds
        return motion
    found = dict(motion)
    kinds = {"platform": dict.fromkeys("xyz", "prismatic"), "joints": types}
    for target, of in kinds.items():
        if isinstance(found.get(target), dict):
            found[target] = {
                name: ranges.measured(value, schema.quantity(of.get(name, "")))
                for name, value in found[target].items()
            }
    return found


def read_motion(
    value: object, where: str, folder: Path, actuated: tuple[str, ...], has_platform: bool
) -> dict[str, Any]:
    """The checked block, for `motion.from_spec`."""
    from pinflex.description import motion  # late: a description without a motion does not need it

    block = copy.deepcopy(schema.mapping(value, where))
    if isinstance(block.get("file"), str):
        block["file"] = str(folder.resolve() / block["file"])  # found from any folder
    checked = motion.from_spec(block, where)
    if checked.target == "platform" and not has_platform:
        raise DescriptionError(
            f"{where}: moves the platform, but the description names none. Add `platform: FRAME`."
        )
    if checked.target == "joints":
        place = schema.at(where, "joints")
        for name in checked.names:
            schema.known(name, place, actuated, "joint with a motor")
    return block
