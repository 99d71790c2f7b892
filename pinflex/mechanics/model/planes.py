"""Directions in which a flexible link deforms: stretch, two bendings, twist.

Model only what the scene needs: a mechanism that moves in one plane bends in that plane alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.errors import DescriptionError
from pinflex.mechanics.manifold import axis_of, twists_of
from pinflex.mechanics.model.tree import Link, poses_of
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.description.description import Description

# Where the beam of a flexible link begins and ends, its frame, and whether it carries a load.

_HERE = 1e-9  # m
_LITTLE = 0.1  # of the mass beside a beam: a camera or a cover on it, not the load of an arm


def span(
    where: str, spec: FlexibleLink, number: int, links: Sequence[Link], index: Mapping[str, int]
) -> tuple[Array, Array]:
    """Both ends of the span in the link's frame: joint to next joint unless told otherwise."""
    start = np.zeros(3) if spec.start is None else _point(where, spec.start, number, links, index)
    if spec.end is not None:
        return start, _point(where, spec.end, number, links, index)
    moving = _leading_on(number, links)
    points = {tuple(np.round(links[k].placement.translation, 9)): k for k in moving}
    ends = [k for p, k in points.items() if np.linalg.norm(np.array(p) - start) > _HERE]
    if len(ends) == 1:
        return start, np.array(links[ends[0]].placement.translation)
    if spec.length is not None:
        return start, start + np.array([spec.length, 0.0, 0.0])
    joint = _next_joint(moving[0], links) if len(moving) == 1 and not ends else None
    if joint is not None and joint != moving[0]:
        raise _leaves_at_the_root(where, spec.link, links[moving[0]].name, links[joint].name)
    names = ", ".join(links[k].name for k in moving) or "no child"
    raise DescriptionError(
        f"{where}: the span is not clear: {spec.link} leads to {names}. "
        "Give `end: FRAME` (a frame fixed to the link) or `length` in m along the link's x axis."
    )


def _leading_on(number: int, links: Sequence[Link]) -> list[int]:
    """Children on a joint; else fixed ones that carry the next joint; else all of them."""
    children = [k for k, link in enumerate(links) if link.parent == number]
    moving = [k for k in children if links[k].steps]
    return moving or [k for k in children if _next_joint(k, links) is not None] or children


def require_carrying(
    where: str,
    description: Description,
    spec: FlexibleLink,
    number: int,
    links: Sequence[Link],
    index: Mapping[str, int],
) -> None:
    """Refuse a beam to an `end` whose load is fixed to the link at the root, beside the beam.

    URDFs often split one arm into two links fixed to each other; the second carries the elbow. A
    camera on the first, beyond the root, does not make a beam of it.
    """
    if spec.end is None or spec.end == spec.link:
        return
    start = np.zeros(3) if spec.start is None else _point(where, spec.start, number, links, index)
    first = index[spec.end]
    while links[first].parent != number:
        first = links[first].parent
    beyond = [
        k
        for k, link in enumerate(links)
        if link.parent == number and np.linalg.norm(link.placement.translation - start) > _HERE
    ]
    named = {*description.tied, *description.loaded, *(f.link for f in description.flexible)}
    if first in beyond or first == index[spec.end] or any(_has(k, links, named) for k in beyond):
        return
    carried, beside = sum(_mass(k, links) for k in beyond), _mass(first, links)
    jointed = any(_next_joint(k, links) is not None for k in beyond)  # of a URDF without masses
    if carried < _LITTLE * beside or not (carried or jointed):
        raise _leaves_at_the_root(where, spec.link, links[first].name, spec.end, carried, beside)


def _leaves_at_the_root(
    where: str, link: str, child: str, end: str, carried: float = 0.0, beside: float = 0.0
) -> DescriptionError:
    what = f"{carried:.3g} kg, beside a load of {beside:.3g} kg" if carried else "nothing"
    return DescriptionError(
        f"{where}: this beam would carry {what}: {child}, which leads to {end}, is fixed to "
        f"{link} at the beam's root. Make {child} flexible instead, or give `length` in m (along "
        "the link's x axis, without `end`) to have the beam beside it.",
        link=link,
    )


def _below(number: int, links: Sequence[Link]) -> Iterator[int]:
    """A link and all that hang on it, depth first."""
    yield number
    for k, link in enumerate(links):
        if link.parent == number:
            yield from _below(k, links)


def _next_joint(number: int, links: Sequence[Link]) -> int | None:
    """The first link of a subtree that hangs on a moving joint."""
    return next((k for k in _below(number, links) if links[k].steps), None)


def _has(number: int, links: Sequence[Link], names: set[str]) -> bool:
    """Whether a subtree has one of these frames."""
    return any(links[k].name in names for k in _below(number, links))


def _mass(number: int, links: Sequence[Link]) -> float:
    """Mass of a subtree [kg]."""
    return sum(float(links[k].inertia.mass) for k in _below(number, links))


def _point(
    where: str, name: str, number: int, links: Sequence[Link], index: Mapping[str, int]
) -> Array:
    """Origin of a frame that hangs on a link, in the link's frame at zero joint angles."""
    placement, k = pin.SE3.Identity(), index[name]
    while k != number:
        if k < 0:
            raise DescriptionError(
                f"{where}: frame {name} does not hang on the link {links[number].name}. "
                "Start and end are frames of the link itself or the next joint's link."
            )
        placement = links[k].placement * placement
        k = links[k].parent
    return np.array(placement.translation)


def joint_axis(link: Link) -> Array | None:
    """Axis of the link's own joint in the link's frame, when it has just one."""
    if len(link.steps) != 1:
        return None
    joint = link.steps[0].model
    return axis_of(joint) if joint.nv == 1 else None


# Beam frame in the link's frame, and length [m], by what they follow from.
Spans = dict[tuple[object, ...], tuple[pin.SE3, float]]


def placed_beam(
    where: str, spec: FlexibleLink, links: Sequence[Link], index: Mapping[str, int], spans: Spans
) -> tuple[pin.SE3, float]:
    """Beam frame in the link's frame, and the length in m; `spans`: those known of these links."""
    key, number = (spec.link, spec.start, spec.end, spec.up, spec.length), index[spec.link]
    if key not in spans:
        start, end = span(where, spec, number, links, index)
        spans[key] = beam_frame(where, spec, links[number], start, end)
    return spans[key]


def beam_frame(
    where: str, spec: FlexibleLink, link: Link, start: Array, end: Array
) -> tuple[pin.SE3, float]:
    """Beam frame in the link's frame, x along the span and z up, and the length in m."""
    span = end - start
    length = float(np.linalg.norm(span))
    if length < 1e-9:
        raise DescriptionError(
            f"{where}: the span has no length. Give `end: FRAME` or `length` in m."
        )
    x = span / length
    wishes = [spec.up] if spec.up is not None else [joint_axis(link), (0, 0, 1), (0, 1, 0)]
    for wish in wishes:
        up = np.zeros(3) if wish is None else np.array(wish, float)
        z = up - x * (x @ up)
        if np.linalg.norm(z) > 1e-3 * max(float(np.linalg.norm(up)), 1e-300):
            z /= np.linalg.norm(z)
            rotation = np.column_stack([x, np.cross(z, x), z])
            return pin.SE3(rotation, start), length if spec.length is None else spec.length
    raise DescriptionError(
        f"{where}.up: {spec.up} is parallel to the span. Give a vector across the beam."
    )


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


@frozen
class Plane:
    """The plane that all motion stays in, where there is one.

    Attributes:
        poses: Of the links at zero joint angles, in the world.
        normal: World frame, shape (3,); None: a spatial scene.
        reason: What leaves the plane, in words, where nothing but that does.
        spans: Beams placed so far.
    """

    poses: list[pin.SE3]
    normal: Array | None
    reason: str = ""
    spans: Spans = field(default_factory=dict)


def plane_of(description: Description, links: Sequence[Link], spans: Spans) -> Plane:
    """The plane that a scene is a mirror image of itself in: nothing bends out of it or twists.

    All joints turn about one direction or slide across it, and all that acts is in the plane across
    it.
    """
    poses = poses_of(links)
    cut = {loop.name for loop in description.loops if loop.clearance is not None}
    normal = _common_axis(links, poses, cut)
    if normal is None:
        return Plane(poses, None, "", spans)
    every = list(_acting(description, links, poses, spans))
    points = [p for one in every for p in one.points]
    reach = max((float(np.linalg.norm(p - points[0])) for p in points), default=0.0)
    height = float(normal @ points[0]) if points else 0.0
    for one in every:
        if one.leaves(normal, height, reach):
            return Plane(poses, None, f"{one.what} is not in the plane of the joints", spans)
    return Plane(poses, normal, "", spans)


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
    description: Description, links: Sequence[Link], poses: Sequence[pin.SE3], spans: Spans
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
    yield from _beams(description, links, poses, index, spans)
    yield from _loads(description, poses, index)


def _beams(
    description: Description,
    links: Sequence[Link],
    poses: Sequence[pin.SE3],
    index: Mapping[str, int],
    spans: Spans,
) -> Iterator[_Acting]:
    """Beams lie in the plane, and their patches bend them in it."""
    for spec in description.flexible:
        if spec.basis.solid:
            continue
        where = f"{description.name}: flexible.{spec.link}"
        placement, length = placed_beam(where, spec, links, index, spans)
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
    body = description.payload
    if body is not None and body.timed:  # else a link; its weight is gravity's
        pose = at(body.frame)
        tensor, places = (
            pose.rotation @ body.tensor @ pose.rotation.T,
            (pose.act(np.array(body.centre)),),
        )
        yield _Acting("the payload", places if body.mass else (), inertia=tensor, mass=body.mass)
    for loop in description.loops:
        tied = [at(frame).translation for frame in (loop.frame_a, loop.frame_b) if frame in index]
        yield _Acting(f"loop {loop.name}", tuple(tied))
    for name, components in description.solve.start_speeds:
        if name in index:  # a link's; a joint moves in the plane
            speed = np.array([x or 0.0 for x in components])
            yield _Acting(f"the start speed of {name}", (at(name).translation,), (speed,))


def _common_axis(
    links: Sequence[Link], poses: Sequence[pin.SE3], cut: Collection[str]
) -> Array | None:
    """The axis (world) that joints turn about in parallel, and across which they slide, or None.

    A hinge that is `cut`, for it has clearance, is a planar joint about its z.
    """
    turning, sliding = list[Array](), list[Array]()
    for link, pose in zip(links, poses, strict=True):
        for step in link.steps:
            loose = link.joint in cut
            axis = np.array([0.0, 0.0, 1.0]) if loose else joint_axis(link)
            if axis is None:
                return None
            slides = not loose and not twists_of(step.model)[3:].any()
            (sliding if slides else turning).append(pose.rotation @ axis)
    if not turning or any(np.linalg.norm(np.cross(turning[0], x)) > _TILT for x in turning):
        return None
    return None if any(abs(turning[0] @ x) > _TILT for x in sliding) else turning[0]


def undecided(spec: FlexibleLink, planes: Sequence[str]) -> tuple[str, ...]:
    """Those of a beam's planes about which the description says `auto`; one always stays."""
    if spec.basis.solid or len(planes) < 2:
        return ()
    asked = _asked(spec)
    return tuple(d for d in planes if asked[d] == "auto")


def any_undecided(
    description: Description, links: Sequence[Link], plane: Plane, given: Collection[str] = ()
) -> bool:
    """Whether `auto` asks for a look at what deforms, in any link but those of given bodies."""
    index = {link.name: number for number, link in enumerate(links)}
    for spec in description.flexible:
        if spec.basis.solid or spec.link in given:
            continue
        where = f"{description.name}: flexible.{spec.link}"
        placement, _ = placed_beam(where, spec, links, index, plane.spans)
        planes, _ = active_planes(where, spec, plane.poses[index[spec.link]] * placement, plane, ())
        if undecided(spec, planes):
            return True
    return False


_WORDS = {"u": "axial", "v": "bending y", "w": "bending z", "p": "torsion"}


def _asked(spec: FlexibleLink) -> dict[str, bool | str]:
    return {"u": spec.axial, "v": spec.bending_y, "w": spec.bending_z, "p": spec.torsion}


def active_planes(
    where: str, spec: FlexibleLink, world: pin.SE3, plane: Plane, out: Sequence[LeftOut]
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
