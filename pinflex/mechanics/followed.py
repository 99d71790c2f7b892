"""Rigid motions kept with their mechanism: whatever runs, compares or draws asks for the same."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism

# Keys of a description that say nothing of how rigid joints move: home is compared.
_APART = (
    *("yaml_text", "gravity", "share", "forces", "control", "springs", "added_masses", "flexible"),
    *("system_damping", "solve", "limit", "allow"),
)


@dataclass(eq=False)
class Followed:
    """What was found of the motions of a rigid mechanism, the newest first.

    Attributes:
        motions: Of the YAML, shaped where it says so.
        nominals: Rigid motions at instants: (motion, nominal). Which of them serves depends on what
            was asked before: they are never shared.
        solved: What was solved for them: (motion, nominal).
        paths: Of the motors between two times: (motion, (start, end), function of time).
    """

    __repr__ = brief

    motions: list[Any] = field(default_factory=list)
    nominals: list[Any] = field(default_factory=list)
    solved: list[Any] = field(default_factory=list)
    paths: list[Any] = field(default_factory=list)

    def __reduce__(self) -> tuple[type[Followed], tuple[()]]:
        return Followed, ()  # found again where it is needed

    @staticmethod
    def keep(found: list[Any], new: Any, most: int) -> None:
        """Put what is new before what was found, and let the oldest go."""
        found.insert(0, new)
        del found[most:]


def share(one: Mechanism, other: Mechanism) -> None:
    """Let a mechanism have the rigid motions of another one of the same file, where they agree."""
    if _move_alike(one, other):
        known = one.followed
        vars(other)["followed"] = Followed(known.motions, [], known.solved, known.paths)


def _move_alike(one: Mechanism, other: Mechanism) -> bool:
    """Whether two mechanisms have the same rigid motions, to the last bit."""
    a, b, rigid = one.description, other.description, (one.rigid, other.rigid)
    if any(system.closed.contacts for system in rigid) or (a.motion or {}).get("shaper"):
        return False  # a sleeve knows its beam, and a shaper the modes
    keys = (x.name for x in fields(a) if x.name not in _APART)
    if [link.link for link in a.flexible] != [link.link for link in b.flexible]:
        return False
    if any(getattr(a, key) != getattr(b, key) for key in keys):
        return False
    pairs = ((x.home, x.rigid.held, x.rigid.motors) for x in (one, other))
    if not all(np.array_equal(x, y) for x, y in zip(*pairs, strict=True)):
        return False
    places = (system.rigid.jointPlacements for system in rigid)
    return all(x == y for x, y in zip(*places, strict=True))
