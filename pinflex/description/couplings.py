"""Linear couplings of joints: `mimic` of a URDF, `follows` in the block `joints`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pinflex.description import schema
from pinflex.description.joints import JointExtra
from pinflex.description.source import Source
from pinflex.errors import DescriptionError
from pinflex.text import brief

SINGLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Coupling:
    """Two joints that move as one: position = ratio times the leader's + offset.

    Attributes:
        joint: The one that follows. leader: The one it follows; None: one that stands still.
        ratio: [rad | m, over rad | m of the leader]. offset: [rad | m].
    """

    __repr__ = brief

    joint: str
    leader: str | None
    ratio: float
    offset: float


def couplings(
    urdf: Source, joints: Mapping[str, JointExtra], types: Mapping[str, str], where: str
) -> tuple[Coupling, ...]:
    """Couplings in the order of the joints; the YAML's `follows` goes before a URDF's `mimic`."""
    found: dict[str, Coupling] = {}
    for joint in urdf.joints.values():
        extra = joints.get(joint.name)
        place = f"{schema.at(where, joint.name)}.follows"
        if extra is not None and extra.follows is not None:
            leader, ratio, offset = extra.follows, extra.ratio, extra.offset
        elif joint.mimic is not None and types[joint.name] in SINGLE:
            leader, ratio, offset = joint.mimic
            if leader not in urdf.joints:  # `check` says so; the joint moves by itself
                continue
        else:
            continue
        if not leader:  # follows: false
            continue
        found[joint.name] = _coupling(joint.name, (leader, ratio, offset), types, place)
    _refuse_rings(found, where)
    return tuple(found.values())


def _coupling(
    name: str, law: tuple[str, float, float], types: Mapping[str, str], place: str
) -> Coupling:
    """One coupling between joints of one freedom."""
    leader, ratio, offset = law
    kinds = {name: types[name], leader: types[leader]}
    if kinds[leader] == "fixed":
        return Coupling(name, None, 0.0, offset)
    for one, kind in kinds.items():
        if kind not in SINGLE:
            raise DescriptionError(
                f"{place}: {one} is {kind}. Couplings are between joints of one degree of freedom. "
                "Name another joint, or write `follows: false`."
            )
    return Coupling(name, leader, ratio, offset)


def _refuse_rings(found: Mapping[str, Coupling], where: str) -> None:
    for name in found:
        path, leader = [name], found[name].leader
        while leader is not None and leader in found and leader not in path:
            path.append(leader)
            leader = found[leader].leader
        if leader in path:
            raise DescriptionError(
                f"{schema.at(where, name)}.follows: {' follows '.join([*path, leader])}, round and "
                "round. Write `follows: false` for one of them."
            )


def read_actuated(
    value: object,
    where: str,
    types: Mapping[str, str],
    closed: bool,
    coupled: Sequence[Coupling],
) -> tuple[str, ...]:
    """Names of the joints with a motor: those given, or in an open chain all of one freedom."""
    followed = {one.joint: one.leader for one in coupled}
    single = tuple(name for name, kind in types.items() if kind in SINGLE)
    if value is not None:
        names = schema.names(value, where, single, "joint of one degree of freedom")
        for name in names:
            if name in followed:
                leader = followed[name] or "a fixed joint"
                raise DescriptionError(
                    f"{where}: {name} follows {leader}, so that it has no motor of its own. Take "
                    f"it out, or write joints.{name}.follows: false."
                )
        return names
    single = tuple(name for name in single if name not in followed)
    if closed:
        raise DescriptionError(
            f"{where}: missing. With loops not every joint has a motor. List those that do, or [] "
            f"for none. Joints: {', '.join(single[:12])}{', ...' if len(single) > 12 else ''}."
        )
    return single
