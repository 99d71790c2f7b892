"""Files that a description names: regular ones, of plausible size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pinflex.errors import DescriptionError
from pinflex.text import frozen

MOST_TEXT = 50_000_000  # [bytes] of a YAML or URDF
MOST_TABLE = 500_000_000  # of samples of a motion
MOST_DATA = 2_000_000_000  # of a mesh or matrices


def nameable(path: Path) -> bool:
    """Whether a file can have this name at all: systems refuse to look for longer ones."""
    return len(str(path)) < 4000 and all(len(part) < 256 for part in path.parts)


def require_regular(path: Path, most: int, where: str) -> None:
    """Raise for a folder, device or pipe, which may never end, and for a file that is too large."""
    try:
        if not path.exists():
            return
        regular, size = path.is_file(), path.stat().st_size
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise DescriptionError(f"{where}: cannot be read ({why}). Give a file.") from None
    if not regular:
        raise DescriptionError(f"{where}: is no regular file. Give a file, no folder or device.")
    if size > most:
        raise DescriptionError(
            f"{where}: {size / 1e6:.4g} MB. Allowed: at most {most / 1e6:g} MB. Give a smaller one."
        )


# What the file of a robot gives a description, whatever its format: names, model, loops.

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

_SPRINGS = ("spring", "parallel_spring")


@dataclass(frozen=True)
class SourceJoint:
    """A joint of a robot's file: its type and the links it joins.

    Attributes:
        damping: Viscous [N m s/rad | N s/m]. friction: Dry [N m | N].
        reduction: Gear ratio of its transmission, if the file has one.
        mimic: (joint, ratio, offset) where its position is ratio times that joint's + offset.
    """

    name: str
    type: str
    parent: str
    child: str
    damping: float = 0.0
    friction: float = 0.0
    reduction: float | None = None
    mimic: tuple[str, float, float] | None = None


@frozen
class Source:
    """A checked robot file, as every later step reads it.

    Attributes:
        file: File name, for messages.
        text: The model and its visuals as URDF; of another format what its reader makes of it.
        package_dirs: Folders in which `package://` is looked up.
        links: Link names in file order.
        joints: Joints by name.
        loops: Loops that the file itself closes, as the YAML block `loops` would say them.
        blocks: What else the file says that a URDF cannot, by top-level key of the YAML: joints,
            actuated, base, home, gravity, ...
        notes: Features of the file that are not taken over, a sentence with its line each.
    """

    file: str
    text: str
    package_dirs: tuple[str, ...]
    links: tuple[str, ...]
    joints: dict[str, SourceJoint]
    loops: Mapping[str, Any] = field(default_factory=dict)
    blocks: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def joined(self, block: Mapping[str, Any]) -> dict[str, Any]:
        """A YAML's blocks with those of the file under them; what the YAML writes wins.

        A name that the YAML leaves empty (`loops: {pin: }`) takes the file's entry away.
        """
        own = dict(self.blocks) | ({"loops": self.loops} if self.loops else {})
        whole = dict(block)
        for key, value in own.items():
            whole[key] = _over(value, whole[key]) if whole.get(key) is not None else value
        return whole


def _over(below: Any, above: Any) -> Any:
    """Two blocks as one; `above` wins, and an entry that is empty there is left out."""
    if not (isinstance(below, Mapping) and isinstance(above, Mapping)):
        return above
    if any(key in above for key in _SPRINGS):  # two words for one spring
        below = {k: v for k, v in below.items() if k not in _SPRINGS or k in above}
    both = {k: _over(v, above[k]) if k in above else v for k, v in below.items()}
    both |= {k: v for k, v in above.items() if k not in below}
    return {k: v for k, v in both.items() if v is not None}
