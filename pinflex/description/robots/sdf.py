"""Reading an SDF: links placed in the model's frame, joints in any order, loops closed by joints.

The first joint that names a link as its child carries it; a further one closes a loop. A gearbox
between a rotor and a link becomes rotor inertia on the joint that it drives, ratio squared times
the rotor's moment about its axis; the spin of the rotor is left out.

Source: sdformat.org, specification 1.6 (poses in the model's frame, axes in the joint's) and 1.7
(`relative_to`, `expressed_in`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.files import Source
from pinflex.description.robots import urdf
from pinflex.description.robots.tree_text import (
    Element,
    Inertia,
    Joint,
    Tree,
    Visual,
    known,
    numbers,
    parse,
    pose,
    unused,
)
from pinflex.errors import DescriptionError
from pinflex.rotations import zyx_matrix

_HUGE = 1e15  # from here on a limit means that there is none


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
    return frame, pose(zyx_matrix(angles[::-1]), values[:3])


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
    element, xyz = joint.child(tag), joint.child(f"{tag}/xyz")
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
    limit = joint.child("axis/limit")
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
    given = joint.child("axis/dynamics")
    keys = ("damping", "friction", "spring_stiffness", "spring_reference")
    return {} if given is None else {key: value_of(given, key) for key in keys}


def visual(element: Element) -> Visual | None:
    """The shape of a <visual>; None for one that is not drawn."""
    shape = element.child("geometry/*")
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


# Type of a joint: that of the URDF's joint which carries a link, and the kind of loop it closes.
_TYPES = {
    "revolute": ("revolute", "revolute"), "continuous": ("continuous", "revolute"),
    "prismatic": ("prismatic", "prismatic"), "fixed": ("fixed", "weld"),
    "ball": ("fixed", "spherical"), "universal": ("fixed", "universal"),
}  # fmt: skip
_WITH_AXIS = ("revolute", "continuous", "prismatic", "universal")
# Tags that are taken over, or that say nothing about the mechanism.
_TAKEN = {
    "model": ("link", "joint", "frame", "pose", "self_collide", "static", "allow_auto_disable"),
    "link": ("pose", "inertial", "visual", "collision", "self_collide"),
    "inertial": ("pose", "mass", "inertia"),
    "joint": ("pose", "parent", "child", "axis", "axis2", "gearbox_ratio",
              "gearbox_reference_body"),
    "axis": ("xyz", "limit", "dynamics", "use_parent_model_frame", "initial_position"),
    "axis2": ("xyz", "use_parent_model_frame"),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction", "spring_stiffness", "spring_reference"),
}  # fmt: skip


def read(text: str, file: str, package_dirs: tuple[str, ...]) -> Source:
    """Read the model of an SDF."""
    root = parse(text, file, ("sdf",), "an SDF")
    holders = [root, *root.all("world")]
    models = [model for holder in holders for model in holder.all("model")]
    if len(models) != 1:
        raise DescriptionError(f"{file}: {len(models)} <model>. Allowed: one. Leave one in.")
    model = models[0]
    links = {name_of(link): link for link in model.all("link")}
    if not links:
        raise DescriptionError(f"{model.place}: no <link>. A robot has at least one.")
    joints = {name_of(joint): joint for joint in model.all("joint")}
    reading = Reading(file, Tree(model.get("name") or file), poses(model), joints)
    _grow(reading, links, text_of(model, "static") in ("1", "true"))
    for name, link in links.items():
        _mass_and_shapes(reading, name, link)
    for name, joint in joints.items():
        _springs_and_gears(reading, name, joint)
    for world in root.all("world"):
        if text_of(world, "gravity"):
            vector = numbers(text_of(world, "gravity"), world, "gravity", 3, "acceleration")
            reading.blocks["gravity"] = plain(vector)
    _notes(reading, model)
    checked = urdf.check(reading.tree.text(), file, package_dirs)
    return replace(checked, loops=reading.loops, blocks=reading.blocks, notes=tuple(reading.notes))


# Tree ----------------------------------------------------------------------------------------


def _grow(reading: Reading, links: dict[str, Element], static: bool) -> None:
    """Links by the first joint that carries each; further joints close loops."""
    carriers, closing = _carriers(reading, links)
    tied = any(text_of(reading.joints[name], "parent") == "world" for name in carriers.values())
    roots = [link for link in links if link not in carriers]
    if (tied and roots) or (not tied and len(roots) != 1):
        raise DescriptionError(
            f"{reading.file}: the links {', '.join(roots[:8])} hang on nothing, but one tree has "
            "one root. Join them with joints."
        )
    root = "world" if tied else roots[0]
    reading.tree.root(root, reading.poses[root])
    if not tied and not static:
        reading.blocks["base"] = "free_flyer"
    waiting = dict(carriers)
    while waiting:
        for child, name in list(waiting.items()):
            if text_of(reading.joints[name], "parent") in reading.tree.links:
                _carry(reading, child, name)
                del waiting[child]
    for name in closing:
        _close(reading, name)


def _carriers(reading: Reading, links: dict[str, Element]) -> tuple[dict[str, str], list[str]]:
    """Joint that carries each link, and the joints that close loops."""
    carriers: dict[str, str] = {}
    closing: list[str] = []
    for name, joint in reading.joints.items():
        kind = joint.get("type") or ""
        if kind == "gearbox":
            continue
        if kind not in _TYPES:
            raise DescriptionError(
                f'{joint.place}: a joint of type "{kind}" cannot be taken over. Allowed: '
                f"{', '.join(_TYPES)}, gearbox. Split or replace it."
            )
        child = known(text_of(joint, "child"), links, joint, "link")
        parent = text_of(joint, "parent")
        known(parent, {**links, "world": joint}, joint, "link")
        if child in carriers or parent in _below(child, carriers, reading):
            closing.append(name)
        else:
            carriers[child] = name
    return carriers, closing


def _below(link: str, carriers: dict[str, str], reading: Reading) -> set[str]:
    """The link and all that hangs on it so far."""
    found = {link}
    while True:
        more = {c for c, j in carriers.items() if text_of(reading.joints[j], "parent") in found}
        if more <= found:
            return found
        found |= more


def _carry(reading: Reading, child: str, name: str) -> None:
    joint = reading.joints[name]
    kind = joint.get("type") or ""
    matrix = reading.poses[child].copy()
    matrix[:3, 3] = reading.poses[name][:3, 3]
    limits, effort = limits_of(joint)
    word, _ = _TYPES[kind]
    if word == "revolute" and limits is None:
        word = "continuous"
    axis = np.array([0.0, 0.0, 1.0])
    if kind in _WITH_AXIS:
        axis = matrix[:3, :3].T @ axis_of(reading, joint, name)
    made = Joint(name, word, axis, limits, effort)
    reading.tree.add(child, text_of(joint, "parent"), made, matrix)
    extra: dict[str, Any] = {}
    if kind == "ball":
        extra = {"type": "spherical"}
    elif kind == "universal":
        second = matrix[:3, :3].T @ axis_of(reading, joint, name, "axis2")
        extra = {"type": "universal", "axes": [plain(axis), plain(second)]}
    if extra:
        reading.blocks.setdefault("joints", {})[name] = extra


def _close(reading: Reading, name: str) -> None:
    """A loop between two frames at the joint, which meet as the file draws it."""
    joint = reading.joints[name]
    kind = joint.get("type") or ""
    frame = reading.poses[name]
    ends = [
        reading.tree.mark(f"{name}_{end}", link, frame)
        for end, link in (("a", text_of(joint, "parent")), ("b", text_of(joint, "child")))
    ]
    loop: dict[str, Any] = {"kind": _TYPES[kind][1], "between": ends}
    if kind in _WITH_AXIS:
        loop["axis"] = plain(frame[:3, :3].T @ axis_of(reading, joint, name))
    if kind == "universal":
        loop["axis_b"] = plain(frame[:3, :3].T @ axis_of(reading, joint, name, "axis2"))
    reading.loops[name] = loop
    for key in ("damping", "spring_stiffness", "friction"):
        value = dynamics(joint).get(key, 0.0)
        if value:
            reading.notes.append(
                f"{joint.place}: {key} {value:g} of the joint {name}, which closes a loop, is not "
                "taken over."
            )


# What links and joints have ------------------------------------------------------------------


def _mass_and_shapes(reading: Reading, name: str, link: Element) -> None:
    """Mass and shapes of a link."""
    inertial = link.child("inertial")
    inertia = Inertia()
    if inertial is not None:
        _, frame = pose_of(inertial)
        given = inertial.child("inertia")
        xx, xy, xz, yy, yz, zz = (
            0.0 if given is None else value_of(given, f"i{key}")
            for key in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        inertia = Inertia(value_of(inertial, "mass"), about=about).moved(frame)
    visuals = [v for v in map(visual, link.all("visual")) if v is not None]
    reading.tree.load(name, inertia, tuple(visuals), reading.poses[name])


def _springs_and_gears(reading: Reading, name: str, joint: Element) -> None:
    """Spring, damper and gearbox of a joint of the tree."""
    kind = joint.get("type") or ""
    if kind == "gearbox":
        _gearbox(reading, name, joint)
        return
    if name in reading.loops:
        return
    values = dynamics(joint)
    extra: dict[str, Any] = {}
    if values.get("damping") and kind != "fixed":
        extra["damper"] = values["damping"]
    if values.get("spring_stiffness") and kind in ("revolute", "continuous", "prismatic"):
        extra["spring"] = values["spring_stiffness"]
        if values["spring_reference"]:
            extra["rest"] = values["spring_reference"]
    rubs = values.get("friction", 0.0)
    if rubs and kind in ("revolute", "continuous", "prismatic"):
        extra["friction"] = {"coulomb": rubs}
    elif rubs:
        reading.notes.append(
            f"{joint.place}: friction {rubs:g} of the joint {name} is not taken over: it has "
            "several freedoms or none."
        )
    if extra:
        reading.blocks.setdefault("joints", {}).setdefault(name, {}).update(extra)


def _gearbox(reading: Reading, name: str, joint: Element) -> None:
    """A rotor behind a gear as inertia on the joint that it drives; the motor is there."""
    rotor, child = text_of(joint, "parent"), text_of(joint, "child")
    base, ratio = text_of(joint, "gearbox_reference_body"), value_of(joint, "gearbox_ratio", 1.0)
    carried = reading.tree.carriers
    if {rotor, child} - {*carried} or {carried[rotor][0], carried[child][0]} != {base} or not ratio:
        reading.notes.append(
            f"{joint.place}: the gearbox {name} is not taken over: {rotor} and {child} do not both "
            f"hang on {base}."
        )
        return
    spin, driven = carried[rotor][1], carried[child][1]
    link = reading.tree.links[rotor]
    moment = float(spin.axis @ link.inertia.about @ spin.axis) / ratio**2
    blocks = reading.blocks.setdefault("joints", {})
    for part in (spin.name, driven.name):
        blocks.setdefault(part, {})
    blocks[driven.name]["rotor_inertia"] = moment
    del blocks[spin.name]
    fixed = Joint(spin.name, "fixed")
    carried[rotor] = (base, fixed)
    motors = reading.blocks.setdefault("actuated", [])
    motors.append(driven.name)
    reading.notes.append(
        f"{joint.place}: the gearbox {name} is rotor inertia {moment:.4g} on {driven.name}, which "
        f"is taken for a motor; {rotor} stands still against {base}."
    )


def _notes(reading: Reading, model: Element) -> None:
    """Note each tag that is not taken over, with its line."""
    for element in model.iter():
        assert isinstance(element, Element)
        if element.tag in _TAKEN:
            reading.notes += unused(element, _TAKEN[element.tag], children=True)
    hit = model.child("link/collision")
    if hit is not None:
        reading.notes.append(f"{hit.place}: <collision> is not taken over, here and below.")
    if model.child("pose") is not None:
        reading.notes.append(f"{model.place}: the <pose> of the model is not taken over.")
