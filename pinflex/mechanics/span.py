"""Where the beam of a flexible link begins and ends, its frame, and whether it carries a load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.description.flexible import FlexibleLink
from pinflex.errors import DescriptionError
from pinflex.mechanics.tree import Link

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


def _next_joint(number: int, links: Sequence[Link]) -> int | None:
    """The first link of a subtree that hangs on a moving joint."""
    if links[number].steps:
        return number
    below = (_next_joint(k, links) for k, link in enumerate(links) if link.parent == number)
    return next((k for k in below if k is not None), None)


def _has(number: int, links: Sequence[Link], names: set[str]) -> bool:
    """Whether a subtree has one of these frames."""
    if links[number].name in names:
        return True
    return any(_has(k, links, names) for k, below in enumerate(links) if below.parent == number)


def _mass(number: int, links: Sequence[Link]) -> float:
    """Mass of a subtree [kg]."""
    below = (_mass(k, links) for k, link in enumerate(links) if link.parent == number)
    return float(links[number].inertia.mass) + sum(below)


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


def joint_axis(link: Link) -> tuple[float, float, float] | None:
    """Axis of the link's own joint in the link's frame, when it has just one."""
    if len(link.steps) != 1:
        return None
    model = pin.Model()
    joint = model.addJoint(0, link.steps[0].model, pin.SE3.Identity(), "joint")
    if model.nv != 1:
        return None
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
    column = np.reshape(jacobian, 6)  # Pinocchio hands one column over as a vector
    axis = column[3:] if np.linalg.norm(column[3:]) > 0.5 else column[:3]
    return (float(axis[0]), float(axis[1]), float(axis[2]))


def placed_beam(
    where: str, spec: FlexibleLink, links: Sequence[Link], index: Mapping[str, int]
) -> tuple[pin.SE3, float]:
    """Beam frame in the link's frame, and the span."""
    number = index[spec.link]
    start, end = span(where, spec, number, links, index)
    return beam_frame(where, spec, links[number], start, end)


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
