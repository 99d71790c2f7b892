"""Directions in which a flexible link deforms: stretch, two bendings, twist.

Model only what the scene needs: a mechanism that moves in one plane bends in that plane alone.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description import solid_keys
from pinflex.description.description import Description
from pinflex.description.flexible import FlexibleLink
from pinflex.errors import DescriptionError
from pinflex.mechanics.span import joint_axis, placed_beam
from pinflex.mechanics.tree import Link


@dataclass(frozen=True)
class LeftOut:
    """A deformation that `auto` leaves out: its largest share of anything, and of what.

    Attributes:
        direction: u, v, w or p. share: Largest share. of: Of what, in words.
    """

    direction: str
    share: float
    of: str


def plane_of(links: Sequence[Link], gravity: Array) -> tuple[list[pin.SE3], Array | None]:
    """Poses of the links at zero joint angles, and the normal of the plane all motion stays in.

    Args:
        links: Links, each after its parent.
        gravity: World frame [m/s^2], shape (3,).
    """
    poses: list[pin.SE3] = []
    for link in links:
        above = poses[link.parent] if link.parent >= 0 else pin.SE3.Identity()
        poses.append(above * link.placement)
    return poses, _plane_normal(links, poses, gravity)


def _plane_normal(links: Sequence[Link], poses: Sequence[pin.SE3], gravity: Array) -> Array | None:
    """Normal of the plane all motion stays in, or None for a spatial mechanism.

    All axes parallel, gravity in the plane, and every mass and joint at one height: then nothing
    excites bending out of the plane, or torsion.
    """
    normal = _common_axis(links, poses)
    if normal is None or abs(float(normal @ gravity)) > 1e-9:
        return None
    heights: list[float] = []
    for link, pose in zip(links, poses, strict=True):
        heavy = link.inertia.mass > 0
        if link.parent >= 0 and (link.steps or heavy):
            heights.append(float(normal @ pose.translation))
            if heavy:
                heights.append(float(normal @ pose.act(link.inertia.lever)))
    reach = max(float(np.linalg.norm(pose.translation)) for pose in poses)
    # 1e-6 of the reach: decimals of a hand-written URDF, not a real offset.
    return normal if not heights or np.ptp(heights) <= 1e-6 * max(reach, 1e-9) else None


def _common_axis(links: Sequence[Link], poses: Sequence[pin.SE3]) -> Array | None:
    """The axis (world) that all joints turn about in parallel, or None."""
    normal: Array | None = None
    for link, pose in zip(links, poses, strict=True):
        for step in link.steps:
            axis = joint_axis(link)
            if axis is None or not step.model.shortname().startswith("JointModelR"):
                return None
            world = pose.rotation @ np.array(axis)
            if normal is None:
                normal = world
            elif abs(abs(float(normal @ world)) - 1) > 1e-9:
                return None
    return normal


def undecided(spec: FlexibleLink, planes: Sequence[str]) -> tuple[str, ...]:
    """Those of a beam's planes about which the description says `auto`; one always stays.

    Args:
        spec: The flexible link.
        planes: Its active directions among u, v, w, p.
    """
    if spec.basis.kind in solid_keys.KINDS or len(planes) < 2:
        return ()
    asked = _asked(spec)
    return tuple(d for d in planes if asked[d] == "auto")


def any_undecided(
    description: Description, links: Sequence[Link], given: Collection[str] = ()
) -> bool:
    """Whether `auto` asks for a look at what deforms, in any link but those of given bodies.

    Args:
        description: Scene.
        links: Links, each after its parent.
        given: Links whose bodies come from elsewhere.
    """
    index = {link.name: number for number, link in enumerate(links)}
    poses, normal = plane_of(links, np.array(description.gravity, float))
    for spec in description.flexible:
        if spec.basis.kind in solid_keys.KINDS or spec.link in given:
            continue
        where = f"{description.name}: flexible.{spec.link}"
        placement, _ = placed_beam(where, spec, links, index)
        planes, _ = active_planes(where, spec, poses[index[spec.link]] * placement, normal, ())
        if undecided(spec, planes):
            return True
    return False


_WORDS = {"u": "axial", "v": "bending y", "w": "bending z", "p": "torsion"}


def _asked(spec: FlexibleLink) -> dict[str, bool | str]:
    return {"u": spec.axial, "v": spec.bending_y, "w": spec.bending_z, "p": spec.torsion}


def active_planes(
    where: str,
    spec: FlexibleLink,
    world: pin.SE3,
    normal: Array | None,
    out: Sequence[LeftOut],
) -> tuple[tuple[str, ...], str]:
    """Active directions: what was asked, and otherwise what the scene excites enough to matter.

    Args:
        where: Place of the link in the description, for the message.
        spec: The flexible link.
        world: Beam frame in the world at zero joint angles.
        normal: Normal of the plane of all motion, shape (3,); None: a spatial scene.
        out: Directions found to matter too little.
    """
    if normal is None:
        auto = dict.fromkeys("uvwp", True)
        reason = "spatial scene"
    else:
        along = abs(float(world.rotation[:, 2] @ normal))
        auto = {"u": True, "v": along > 1e-6, "w": along < 1 - 1e-6, "p": False}
        reason = "planar scene: nothing bends out of the plane or twists"
    for left in out:
        auto[left.direction] = False
    asked = _asked(spec)
    chosen = {d: auto[d] if asked[d] == "auto" else bool(asked[d]) for d in "uvwp"}
    if asked["p"] == "auto" and False in (asked["v"], asked["w"]):
        chosen["p"] = False  # the user has made the scene plane
    if not any(chosen.values()):
        raise DescriptionError(
            f"{where}: every direction is off. Leave at least one of axial, bending_y, bending_z, "
            "torsion on, or take the link out of `flexible`."
        )
    named = [f"{'no '[: 3 * (not asked[d])]}{_WORDS[d]}" for d in "uvwp" if asked[d] != "auto"]
    if named:
        reason = "as asked" + (f": {', '.join(named)}; {reason}" if len(named) < 4 else "")
    return tuple(d for d in "uvwp" if chosen[d]), reason
