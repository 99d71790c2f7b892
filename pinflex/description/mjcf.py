"""Reading an MJCF (MuJoCo): bodies, joints, springs, equalities and motors.

Joint positions are MuJoCo's: a `ref` is the position at which the file draws the joint, and `home`
starts there. Equalities hold exactly here, where MuJoCo has stiff springs (solref, solimp).

Source: MuJoCo documentation, XML reference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description import mjcf_values, urdf
from pinflex.description.mjcf_values import Values
from pinflex.description.source import Source
from pinflex.description.tree_text import Inertia, Joint, Tree, Visual, pose
from pinflex.description.xml_lines import Element, numbers
from pinflex.errors import DescriptionError

_TYPES = {"hinge": "revolute", "slide": "prismatic", "ball": "fixed", "free": "floating"}
_GROUPS = 3  # geoms of the groups 0 to 2 are drawn, as in MuJoCo
_BODY = ("body", "frame", "inertial", "joint", "freejoint", "geom", "site", "camera", "light")


@dataclass
class Robot:
    """An MJCF on its way into a tree.

    Attributes:
        values: What its attributes mean.
        tree: Links and joints.
        poses: Pose of each body in the world as the file draws it.
        joints: Element, position at that pose and body of every joint.
        blocks: What a URDF cannot say.
        loops: Closures.
    """

    values: Values
    tree: Tree
    poses: dict[str, Array] = field(default_factory=dict)
    joints: dict[str, JointData] = field(default_factory=dict)
    sites: dict[str, tuple[str, Array]] = field(default_factory=dict)
    blocks: dict[str, Any] = field(default_factory=dict)
    loops: dict[str, Any] = field(default_factory=dict)

    def note(self, element: Element, text: str) -> None:
        """Say what is not taken over.

        Args:
            element: Whose line is named.
            text: A sentence.
        """
        self.values.notes.append(f"{element.place}: {text}")


@dataclass(frozen=True)
class JointData:
    """A joint of the file: its attributes with defaults, its type, and its `ref` [rad | m]."""

    element: Element
    given: dict[str, str]
    type: str
    ref: float


def read(text: str, file: str, package_dirs: tuple[str, ...]) -> Source:
    """Read an MJCF.

    Args:
        text: The XML. file: Its name. package_dirs: The first one is its folder.
    """
    from pinflex.description import mjcf_extras

    folder = Path(package_dirs[0]) if package_dirs else Path()
    root = mjcf_values.read_root(text, file, folder)
    robot = Robot(Values(root, folder), Tree(root.get("model") or Path(file).stem))
    worlds = list(root.all("worldbody"))
    bodies = [body for world in worlds for body in world.all("body")]
    if not bodies:
        raise DescriptionError(f"{file}: no <body>. A robot has at least one.")
    free = len(bodies) == 1 and _free(bodies[0]) and len(list(worlds[0].all("frame"))) == 0
    if free:
        _free_root(robot, bodies[0])
    else:
        robot.tree.root("world")
        robot.poses["world"] = np.eye(4)
        for world in worlds:
            _children(robot, world, "world", np.eye(4), "main")
    for world in worlds:
        if next(world.all("geom"), None) is not None:
            robot.note(next(world.all("geom")), "<geom> of the world is not taken over.")
        for site in world.all("site"):
            placed = robot.values.pose(site, robot.values.of(site, "main"))
            robot.sites[site.get("name", "")] = ("world", placed)
    mjcf_extras.joints(robot)
    mjcf_extras.motors(robot)
    mjcf_extras.equalities(robot)
    if free:
        _say_shift(robot, bodies[0])
    mjcf_extras.rest(robot)
    checked = urdf.check(robot.tree.text(), file, package_dirs)
    notes = tuple(robot.values.notes)
    return replace(checked, loops=robot.loops, blocks=robot.blocks, notes=notes)


def _free(body: Element) -> bool:
    return body.child("freejoint") is not None or any(
        joint.get("type") == "free" for joint in body.all("joint")
    )


def _free_root(robot: Robot, body: Element) -> None:
    """One free body in the world is a free base."""
    name = body.get("name") or "body_1"
    matrix = robot.values.pose(body, dict(body.attrib))
    robot.tree.root(name, matrix)
    robot.poses[name] = matrix
    robot.blocks["base"] = "free_flyer"
    if not np.allclose(matrix[:3, :3], np.eye(3), atol=1e-12):
        robot.blocks["home"] = {"root_joint": base_pose(matrix)}
    _fill(robot, body, name, matrix, body.get("childclass") or "main")


def _say_shift(robot: Robot, body: Element) -> None:
    """A free base starts at the origin, unless its pose in the file has a meaning."""
    name = body.get("name") or "body_1"
    if robot.poses[name][:3, 3].any() and "root_joint" not in robot.blocks.get("home", {}):
        robot.note(body, f"the pos of {name} is not taken over: it starts at the origin, unless "
                   "home.root_joint says more.")  # fmt: skip


def base_pose(matrix: Array) -> list[float]:
    """A pose as `home.root_joint` takes it: place and quaternion x y z w."""
    return [*_plain(matrix[:3, 3]), *_plain(_quaternion(matrix[:3, :3]))]


def _children(robot: Robot, element: Element, parent: str, matrix: Array, kind: str) -> None:
    """The bodies of a body, through frames between them."""
    for child in element.all():
        inside = child.get("childclass") or kind
        if child.tag == "frame":
            step = robot.values.pose(child, dict(child.attrib))
            _children(robot, child, parent, matrix @ step, inside)
        elif child.tag == "body":
            _body(robot, child, parent, matrix, inside)


def _body(robot: Robot, body: Element, parent: str, above: Array, kind: str) -> None:
    """A body, with one link for each of its joints."""
    name = body.get("name") or f"body_{len(robot.poses)}"
    matrix = above @ robot.values.pose(body, dict(body.attrib))
    robot.poses[name] = matrix
    joints = list(_joints(robot, body, name, kind))
    link = parent
    for k, (label, data) in enumerate(joints):
        own = name if k == len(joints) - 1 else f"{name}.{k + 1}"
        robot.joints[label] = data
        at = numbers(data.given.get("pos", "0 0 0"), data.element, "pos", 3)
        if data.type == "free":
            at = np.zeros(3)
        robot.tree.add(own, link, _carrier(robot, label, data), matrix @ pose(shift=at))
        link = own
    if not joints:
        robot.tree.add(name, parent, Joint(f"{name}_mount"), matrix)
    _fill(robot, body, name, matrix, kind)


def _joints(robot: Robot, body: Element, name: str, kind: str) -> Iterator[tuple[str, JointData]]:
    """Joints of a body by name, in the file's order."""
    found = [e for e in body.all() if e.tag in ("joint", "freejoint")]
    for k, element in enumerate(found):
        given = robot.values.of(element, kind) if element.tag == "joint" else {"type": "free"}
        word = given.get("type", "hinge")
        if word not in _TYPES:
            raise DescriptionError(
                f'{element.place}: no such type of joint: "{word}". Allowed: {", ".join(_TYPES)}.'
            )
        label = element.get("name") or f"{name}_joint" + (f"_{k + 1}" if k else "")
        ref = float(numbers(given.get("ref", "0"), element, "ref", 1, "position")[0])
        ref = float(robot.values.angle(ref)) if word == "hinge" else ref
        yield label, JointData(element, given, word, ref if word in ("hinge", "slide") else 0.0)


def _carrier(robot: Robot, name: str, data: JointData) -> Joint:
    given, element = data.given, data.element
    if data.type in ("ball", "free"):
        return Joint(name, _TYPES[data.type])
    axis = mjcf_values.unit(
        numbers(given.get("axis", "0 0 1"), element, "axis", 3), element, "axis"
    )
    word, limits = _TYPES[data.type], _limits(robot, data)
    if data.type == "hinge" and limits is None:
        word = "continuous"
    return Joint(name, word, axis, limits, offset=data.ref)


def _limits(robot: Robot, data: JointData) -> tuple[float, float] | None:
    given = data.given
    limited = given.get("limited", "auto")
    if "range" not in given or limited == "false":
        return None
    if limited == "auto" and robot.values.compiler.get("autolimits", "true") == "false":
        return None
    pair = numbers(given["range"], data.element, "range", 2, "position")
    low, high = robot.values.angle(pair) if data.type == "hinge" else pair
    return float(low), float(high)


def _fill(robot: Robot, body: Element, name: str, matrix: Array, kind: str) -> None:
    """Mass, shapes and sites of a body, then the bodies on it."""
    values = robot.values
    total, visuals = _mass_and_shapes(robot, body, kind)
    robot.tree.load(name, total, visuals, matrix)
    for site, shift, own in _inside(robot, body, "site", np.eye(4), kind):
        if site.get("name"):
            placed = matrix @ shift @ values.pose(site, values.of(site, own))
            robot.sites[site.get("name", "")] = (name, placed)
    for element in body.all():
        if element.tag not in _BODY:
            robot.note(element, f"<{element.tag}> in the body {name} is not taken over.")
    _children(robot, body, name, matrix, kind)


def _mass_and_shapes(robot: Robot, body: Element, kind: str) -> tuple[Inertia, tuple[Visual, ...]]:
    """Of one body in its own frame; the inertia of its geoms where it is not written."""
    values, given = robot.values, body.child("inertial")
    mode = values.compiler.get("inertiafromgeom", "auto")
    by_geoms = mode == "true" or (mode == "auto" and given is None)
    total = Inertia()
    if given is not None and not by_geoms:
        total = mjcf_values.inertial(values, given)
    visuals: list[Visual] = []
    for geom, shift, own in _inside(robot, body, "geom", np.eye(4), kind):
        attributes = values.of(geom, own)
        inertia, visual = mjcf_values.geom(values, geom, attributes)
        if by_geoms and visual is not None and visual.kind == "mesh":
            inertia = mjcf_values.mesh_inertia(values, geom, attributes)
        if by_geoms:
            total = total + inertia.moved(shift)
        if visual is not None and int(attributes.get("group", "0")) < _GROUPS:
            visuals.append(Visual(visual.kind, shift @ visual.matrix, visual.values))
    return total, tuple(visuals)


def _inside(
    robot: Robot, element: Element, tag: str, matrix: Array, kind: str
) -> Iterator[tuple[Element, Array, str]]:
    """Elements of a body, through frames: element, pose of the frame, class."""
    for child in element.all():
        if child.tag == tag:
            yield child, matrix, kind
        elif child.tag == "frame":
            step = matrix @ robot.values.pose(child, dict(child.attrib))
            yield from _inside(robot, child, tag, step, child.get("childclass") or kind)


def _quaternion(rotation: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_quat())  # x y z w


def _plain(values: Array) -> list[float]:
    return [float(x) for x in values]
