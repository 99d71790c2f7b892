"""Directions in which a flexible link deforms: stretch, two bendings, twist.

Model only what the scene needs: a mechanism that moves in one plane bends in that plane alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description import solid_keys
from pinflex.description.description import Description
from pinflex.description.flexible import FlexibleLink
from pinflex.errors import DescriptionError
from pinflex.mechanics.span import joint_axis, placed_beam
from pinflex.mechanics.tree import Link

# Decimals of a hand-written URDF, not a real offset: of the reach, and of a vector (1.5708 for a
# right angle is off by 4e-6).
_OFFSET = 1e-6
_TILT = 5e-5
# Share of shear in the sag of a cantilever above which it counts: a rectangle 0.16 as high as long,
# whose first frequency it lowers by 2 %, as much as the default shapes leave to their second.
SHORT = 2e-2


@dataclass(frozen=True)
class LeftOut:
    """A deformation that `auto` leaves out: its largest share of anything, and of what.

    Attributes:
        direction: u, v, w or p. share: Largest share. of: Of what, in words.
    """

    direction: str
    share: float
    of: str


@dataclass(frozen=True)
class Plane:
    """The plane that all motion stays in, where there is one.

    Attributes:
        poses: Of the links at zero joint angles, in the world.
        normal: World frame, shape (3,); None: a spatial scene.
        reason: What leaves the plane, in words, where nothing but that does.
    """

    poses: list[pin.SE3]
    normal: Array | None
    reason: str = ""


def plane_of(description: Description, links: Sequence[Link]) -> Plane:
    """The plane that a scene is a mirror image of itself in: nothing bends out of it or twists.

    All joints turn about one direction, and everything that acts is in the plane across it.
    """
    poses: list[pin.SE3] = []
    for link in links:
        above = poses[link.parent] if link.parent >= 0 else pin.SE3.Identity()
        poses.append(above * link.placement)
    normal = _common_axis(links, poses)
    if normal is None:
        return Plane(poses, None)
    every = list(_acting(description, links, poses))
    points = [p for one in every for p in one.points]
    reach = max((float(np.linalg.norm(p - points[0])) for p in points), default=0.0)
    height = float(normal @ points[0]) if points else 0.0
    for one in every:
        if one.leaves(normal, height, reach):
            return Plane(poses, None, f"{one.what} is not in the plane of the joints")
    return Plane(poses, normal)


@dataclass(frozen=True)
class _Acting:
    """Something that acts on a scene or has mass, in the world at zero joint angles.

    Attributes:
        what: Words for it.
        points: Places that have to be in the plane [m].
        along: Vectors that have to be in it. about: Vectors that have to be across it.
        inertia: Tensor with one principal axis across it, shape (3, 3).
        mass: That of the tensor [kg], which says when its products are those of a small offset.
    """

    what: str
    points: tuple[Array, ...] = ()
    along: tuple[Array, ...] = ()
    about: tuple[Array, ...] = ()
    inertia: Array | None = None
    mass: float = 0.0

    def leaves(self, normal: Array, height: float, reach: float) -> bool:
        """Whether it acts out of the plane at this height, by more than what a file rounds."""
        if any(abs(float(normal @ p) - height) > _OFFSET * reach for p in self.points):
            return True
        if any(abs(float(normal @ x)) > _TILT * np.linalg.norm(x) for x in self.along):
            return True
        if any(np.linalg.norm(np.cross(normal, x)) > _TILT * np.linalg.norm(x) for x in self.about):
            return True
        if self.inertia is None:
            return False
        across = np.cross(normal, self.inertia @ normal)
        size = max(self.mass * reach**2, float(np.linalg.norm(self.inertia)))
        return bool(np.linalg.norm(across) > _OFFSET * size)


def _acting(
    description: Description, links: Sequence[Link], poses: Sequence[pin.SE3]
) -> Iterator[_Acting]:
    """All that has mass, carries or loads the scene."""
    index = {link.name: number for number, link in enumerate(links)}
    for link, pose in zip(links, poses, strict=True):
        if link.parent >= 0 and link.steps:
            yield _Acting(f"joint {link.joint}", (pose.translation,))
        if link.parent >= 0 and link.weighs:
            I = pose.act(link.inertia)  # noqa: E741
            places = (I.lever,) if I.mass > 0 else ()
            yield _Acting(f"the mass of {link.name}", places, inertia=I.inertia, mass=I.mass)
    yield _Acting("gravity", along=(np.array(description.gravity, float),))
    yield from _beams(description, links, poses, index)
    yield from _loads(description, poses, index)


def _beams(
    description: Description,
    links: Sequence[Link],
    poses: Sequence[pin.SE3],
    index: Mapping[str, int],
) -> Iterator[_Acting]:
    """Beams lie in the plane, and their patches bend them in it."""
    for spec in description.flexible:
        if spec.basis.kind in solid_keys.KINDS:
            continue
        where = f"{description.name}: flexible.{spec.link}"
        placement, length = placed_beam(where, spec, links, index)
        beam = poses[index[spec.link]] * placement
        x, _, z = beam.rotation.T
        ends = (beam.translation, beam.translation + length * x)
        yield _Acting(f"the beam of {spec.link}", ends, along=(x,))
        for patch in spec.patches:
            yield _Acting(f"patch {patch.name}", about=(z,))


def _loads(
    description: Description, poses: Sequence[pin.SE3], index: Mapping[str, int]
) -> Iterator[_Acting]:
    """Forces, springs, dampers, added masses and start speeds, and where loops are tied."""

    def at(frame: str) -> pin.SE3:
        return poses[index[frame]]

    for force in description.forces:
        turn = at(force.frame).rotation if force.follower else np.eye(3)
        places = (at(force.frame).translation,) if any(force.force) else ()
        F, M = turn @ np.array(force.force), turn @ np.array(force.moment)
        yield _Acting(f"load {force.name}", places, (F,), (M,))
    for spring in description.springs:
        ends = [at(frame).translation for frame in spring.frames]
        ends += [] if spring.at is None else [np.array(spring.at)]
        yield _Acting(f"spring {spring.name}", tuple(ends))
    for added in description.added_masses:
        pose = at(added.frame)
        places = (pose.translation,) if any(added.mass) else ()
        for values in (added.mass, added.inertia):
            tensor = pose.rotation @ np.diag(values) @ pose.rotation.T
            yield _Acting(f"added mass {added.name}", places, inertia=tensor)
    for loop in description.loops:
        tied = [at(frame).translation for frame in (loop.frame_a, loop.frame_b) if frame in index]
        yield _Acting(f"loop {loop.name}", tuple(tied))
    for name, components in description.solve.start_speeds:
        if name in index:  # a link's; a joint moves in the plane
            speed = np.array([x or 0.0 for x in components])
            yield _Acting(f"the start speed of {name}", (at(name).translation,), (speed,))


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
            elif np.linalg.norm(np.cross(normal, world)) > _TILT:
                return None
    return normal


def undecided(spec: FlexibleLink, planes: Sequence[str]) -> tuple[str, ...]:
    """Those of a beam's planes about which the description says `auto`; one always stays."""
    if spec.basis.kind in solid_keys.KINDS or len(planes) < 2:
        return ()
    asked = _asked(spec)
    return tuple(d for d in planes if asked[d] == "auto")


def any_undecided(
    description: Description, links: Sequence[Link], given: Collection[str] = ()
) -> bool:
    """Whether `auto` asks for a look at what deforms, in any link but those of given bodies."""
    index = {link.name: number for number, link in enumerate(links)}
    plane = plane_of(description, links)
    for spec in description.flexible:
        if spec.basis.kind in solid_keys.KINDS or spec.link in given:
            continue
        where = f"{description.name}: flexible.{spec.link}"
        placement, _ = placed_beam(where, spec, links, index)
        planes, _ = active_planes(where, spec, plane.poses[index[spec.link]] * placement, plane, ())
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
    plane: Plane,
    out: Sequence[LeftOut],
) -> tuple[tuple[str, ...], str]:
    """Active directions: what was asked, and otherwise what the scene excites enough to matter."""
    if plane.normal is None:
        auto = dict.fromkeys("uvwp", True)
        reason = f"spatial scene: {plane.reason}" if plane.reason else "spatial scene"
    else:
        along = abs(float(world.rotation[:, 2] @ plane.normal))
        auto = {"u": True, "v": along > 1e-6, "w": along < 1 - 1e-6}
        # an oblique section leaves the plane as it bends; a round one does not
        oblique = auto["v"] and auto["w"] and abs(spec.section.Iy / spec.section.Iz - 1) > 1e-9
        auto["p"] = oblique
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


def with_shear(
    spec: FlexibleLink, planes: Collection[str], length: float, reason: str
) -> tuple[FlexibleLink, str]:
    """The link with `auto` of shear and rotary inertia decided, and the reason of its directions.

    Both come with a short beam: where the shear makes more than `SHORT` of the sag of a
    cantilever, F L / (k G A) beside F L^3 / (3 E I). A section `given` by its numbers has no known
    shear factors, and only some bases have shear.
    """
    E, G, cut = spec.material.E, spec.material.G, spec.section
    basis = spec.basis
    able = basis.kind == "craig_bampton" or (basis.kind, basis.order) == ("finite_element", "cubic")
    able = able and cut.shape != "given" and not spec.third_order
    sides = [(cut.Iz, cut.ky)] * ("v" in planes) + [(cut.Iy, cut.kz)] * ("w" in planes)
    share = max((3 * E * second / (k * G * cut.A * length**2) for second, k in sides), default=0.0)
    short = able and share > SHORT
    shear = short if spec.shear == "auto" else spec.shear
    turning = short and shear is True if spec.rotary_inertia == "auto" else spec.rotary_inertia
    if spec.shear == "auto" and shear is True:
        both = " and rotary inertia" if turning else ""
        reason += f"; short, so with shear ({100 * share:.2g} % of its sag){both}"
    free = spec.rotary_inertia is True
    return replace(spec, shear=shear, rotary_inertia=turning, free_shear=free), reason
