"""What the elements of an SDF mean: poses, axes, limits, shapes.

Source: sdformat.org, specification 1.6 (poses in the model's frame, axes in the joint's) and 1.7
(`relative_to`, `expressed_in`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.tree_text import Tree, Visual, from_rpy, pose
from pinflex.description.xml_lines import Element, known, numbers
from pinflex.errors import DescriptionError

_HUGE = 1e15  # a limit as large is none


@dataclass
class Reading:
    """A model on its way into a tree."""

    file: str
    tree: Tree
    poses: dict[str, Array]
    joints: dict[str, Element]
    blocks: dict[str, Any] = field(default_factory=dict)
    loops: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def name_of(element: Element) -> str:
    """The name of an element that must have one."""
    name = element.get("name") or ""
    if not name:
        raise DescriptionError(f"{element.place}: <{element.tag}> without a name. Give it one.")
    return name


def text_of(element: Element, tag: str) -> str:
    """The text of a child, without blanks around it."""
    return (element.findtext(tag) or "").strip()


def value_of(element: Element, tag: str, default: float = 0.0) -> float:
    """The number of a child."""
    text = text_of(element, tag)
    try:
        return float(text) if text else default
    except ValueError:
        raise DescriptionError(
            f"{element.place}: {tag}: {text!r} is not a number. Correct it."
        ) from None


def plain(vector: Array) -> list[float]:
    """The numbers as YAML takes them."""
    return [round(float(x), 15) + 0.0 for x in vector]


def pose_of(element: Element | None) -> tuple[str, Array]:
    """The frame that a <pose> is written in ("" for the default one), and the matrix."""
    found = None if element is None else element.child("pose")
    if found is None or not (found.text or "").strip():
        return "", np.eye(4)
    values = numbers(found.text, found, "x y z roll pitch yaw", 6)
    frame = found.get("relative_to") or found.get("frame") or ""
    angles = np.radians(values[3:]) if found.get("degrees") == "true" else values[3:]
    return frame, pose(from_rpy(angles), values[:3])


def poses(model: Element) -> dict[str, Array]:
    """Pose of every link, joint and frame in the model's frame."""
    elements = {
        name_of(e): e for tag in ("link", "joint", "frame") for e in model.all(tag)
    }  # names are unique among them
    found: dict[str, Array] = {"": np.eye(4), "__model__": np.eye(4), "world": np.eye(4)}

    for start in elements:
        name, way = start, dict[str, Array]()  # from a frame to one whose pose is known
        while name not in found:
            asking = elements[next(reversed(way))] if way else model
            if name in way:
                raise DescriptionError(f"{asking.place}: the poses of {name} go round.")
            element = elements[known(name, elements, asking, "frame")]
            frame, way[name] = pose_of(element)
            if element.tag == "joint":
                frame = frame or text_of(element, "child")
            elif element.tag == "frame":
                frame = frame or element.get("attached_to") or ""
            name = frame
        for one in reversed(way):
            found[one] = found[name] @ way[one]
            name = one
    return found


def axis_of(reading: Reading, joint: Element, name: str, tag: str = "axis") -> Array:
    """Unit axis of a joint in the model's frame."""
    element = joint.child(tag)
    xyz = None if element is None else element.child("xyz")
    vector = np.array([0.0, 0.0, 1.0]) if xyz is None else numbers(xyz.text, xyz, tag, 3)
    size = float(np.linalg.norm(vector))
    if size < 1e-9:
        raise DescriptionError(f"{joint.place}: {tag} {vector} has no direction.")
    turned = reading.poses[name]
    if xyz is not None and xyz.get("expressed_in"):
        turned = reading.poses[known(xyz.get("expressed_in", ""), reading.poses, xyz, "frame")]
    elif element is not None and text_of(element, "use_parent_model_frame") in ("1", "true"):
        turned = np.eye(4)
    return np.asarray(turned[:3, :3] @ vector / size)


def limits_of(joint: Element) -> tuple[tuple[float, float] | None, float]:
    """Lower and upper position [rad | m], if there are any, and largest effort [N m | N]."""
    axis = joint.child("axis")
    limit = None if axis is None else axis.child("limit")
    if limit is None:
        return None, 0.0
    lower, upper, effort = (
        value_of(limit, key, bad)
        for key, bad in (("lower", -math.inf), ("upper", math.inf), ("effort", 0.0))
    )
    bounded = lower > -_HUGE and upper < _HUGE and lower < upper
    return (lower, upper) if bounded else None, max(effort, 0.0) if effort < _HUGE else 0.0


def dynamics(joint: Element) -> dict[str, float]:
    """Damping, friction and spring of a joint."""
    axis = joint.child("axis")
    given = None if axis is None else axis.child("dynamics")
    keys = ("damping", "friction", "spring_stiffness", "spring_reference")
    return {} if given is None else {key: value_of(given, key) for key in keys}


def visual(element: Element) -> Visual | None:
    """What a <visual> looks like; None for a shape that is not drawn."""
    geometry = element.child("geometry")
    shape = None if geometry is None else next(geometry.all(), None)
    if shape is None:
        return None
    _, matrix = pose_of(element)
    if shape.tag == "mesh":
        file = text_of(shape, "uri").removeprefix("model://").removeprefix("package://")
        scale = text_of(shape, "scale") or "1 1 1"
        return Visual("mesh", matrix, {"filename": f"package://{file}", "scale": scale})
    if shape.tag in ("box", "cylinder", "sphere"):
        keys = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}
        return Visual(shape.tag, matrix, {key: text_of(shape, key) for key in keys[shape.tag]})
    return None
