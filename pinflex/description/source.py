"""What the file of a robot gives a description, whatever its format: names, model, loops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pinflex.text import brief

# Configuration sizes of the joint types: what a value of `home` may hold.
HOME_SIZES: dict[str, tuple[int, ...]] = {
    "fixed": (),
    "revolute": (1,),
    "continuous": (1,),
    "prismatic": (1,),
    "universal": (2,),
    "planar": (3,),  # x, y, angle
    "spherical": (3, 4),  # rotation vector, or quaternion x y z w
    "floating": (6, 7),  # position and rotation vector, or position and quaternion x y z w
}


@dataclass(frozen=True)
class SourceJoint:
    """A joint of a robot's file: its type, the links it joins, what it follows.

    `mimic` is (joint, ratio, offset) where its position is ratio times that joint's + offset.
    """

    name: str
    type: str
    parent: str
    child: str
    mimic: tuple[str, float, float] | None = None


@dataclass(frozen=True)
class Source:
    """A checked robot file, as every later step reads it.

    Attributes:
        file: File name, for messages.
        text: The model and its visuals as URDF; of another format what its reader makes of it.
        package_dirs: Folders in which `package://` is looked up.
        links: Link names in file order.
        joints: Joints by name.
        loops: Loops that the file itself closes, as the YAML block `loops` would say them.
    """

    __repr__ = brief

    file: str
    text: str
    package_dirs: tuple[str, ...]
    links: tuple[str, ...]
    joints: dict[str, SourceJoint]
    loops: Mapping[str, Any] = field(default_factory=dict)
