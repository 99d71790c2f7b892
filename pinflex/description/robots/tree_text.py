"""A tree of links and joints, each placed as its file draws it, written as a URDF.

The formats that are not URDF are read into this; what a URDF cannot say (loops, springs, types of
joints) their readers say as blocks of the YAML. A link's frame stands at the joint that carries it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field, replace

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.rotations import axis_turn


def pose(rotation: Array | None = None, shift: Array | None = None) -> Array:
    """A pose as a matrix, shape (4, 4)."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    if shift is not None:
        matrix[:3, 3] = shift
    return matrix


def inverse(matrix: Array) -> Array:
    """The inverse of a pose, shape (4, 4)."""
    turn = matrix[:3, :3].T
    return pose(turn, -turn @ matrix[:3, 3])


def rpy(rotation: Array) -> Array:
    """Roll, pitch, yaw [rad], R = Rz(yaw) Ry(pitch) Rx(roll), exact to round-off at any pitch.

    At a pitch of 90 degrees roll and yaw are not unique, so that roll is taken from what yaw
    leaves.
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    left = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ rotation
    return np.array([np.arctan2(-left[1, 2], left[1, 1]), np.arctan2(-left[2, 0], left[0, 0]), yaw])


def from_rpy(angles: Array) -> Array:
    """Rotation matrix of roll, pitch, yaw [rad], shape (3, 3)."""
    (a, b, c), (d, e, f) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [c * b, c * e * d - f * a, c * e * a + f * d],
            [f * b, f * e * d + c * a, f * e * a - c * d],
            [-e, b * d, b * a],
        ]
    )


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre [m] and inertia about it [kg m^2], in the axes of one frame."""

    mass: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    about: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def moved(self, matrix: Array) -> Inertia:
        """The same in another frame, in which the first has this pose."""
        turned = matrix[:3, :3]
        return Inertia(
            self.mass, turned @ self.centre + matrix[:3, 3], turned @ self.about @ turned.T
        )

    def __add__(self, other: Inertia) -> Inertia:
        mass = self.mass + other.mass
        if not mass:
            return self
        centre = (self.mass * self.centre + other.mass * other.centre) / mass
        about = self.about + other.about
        for part in (self, other):
            d = part.centre - centre
            about = about + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
        return Inertia(mass, centre, about)


@dataclass(frozen=True)
class Visual:
    """A shape to draw: box (size), cylinder (radius, length), sphere (radius) or mesh (file)."""

    kind: str
    matrix: Array
    values: dict[str, str]


@dataclass(frozen=True)
class Joint:
    """How a link is carried.

    Attributes:
        name: Its name. type: As a URDF has it.
        axis: Unit axis in the link's frame.
        limits: Lower and upper [rad | m], if there are any.
        effort: Largest torque or force [N m | N], 0 if none is given.
        offset: Position of the joint at which the file draws it [rad | m].
        mimic: Joint that it follows, ratio and offset.
    """

    name: str
    type: str = "fixed"
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    limits: tuple[float, float] | None = None
    effort: float = 0.0
    offset: float = 0.0
    mimic: tuple[str, float, float] | None = None


@dataclass(frozen=True)
class _Link:
    matrix: Array
    inertia: Inertia
    visuals: tuple[Visual, ...]


class Tree:
    """Links and joints, parents first."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.links: dict[str, _Link] = {}
        self.carriers: dict[str, tuple[str, Joint]] = {}
        self.joints: set[str] = set()

    def root(self, name: str, matrix: Array | None = None) -> None:
        """Add the first link."""
        self.links[name] = _Link(np.eye(4) if matrix is None else matrix, Inertia(), ())

    def add(self, name: str, parent: str, joint: Joint, matrix: Array) -> None:
        """Add a link."""
        for word, taken, new in (("links", self.links, name), ("joints", self.joints, joint.name)):
            if new in taken:
                raise DescriptionError(
                    f'{self.name}: two {word} are named "{new}". Rename one of them.'
                )
        self.links[name] = _Link(matrix, Inertia(), ())
        self.carriers[name] = (parent, joint)
        self.joints.add(joint.name)

    def follow(self, joint: str, leader: str, ratio: float, offset: float) -> None:
        """Let a joint follow another."""
        link = next(link for link, (_, j) in self.carriers.items() if j.name == joint)
        parent, carrier = self.carriers[link]
        self.carriers[link] = parent, replace(carrier, mimic=(leader, ratio, offset))

    def mark(self, name: str, link: str, matrix: Array) -> str:
        """Add a massless link on a fixed joint, and return its name."""
        self.add(name, link, Joint(f"{name}_mount"), matrix)
        return name

    def load(self, name: str, inertia: Inertia, visuals: tuple[Visual, ...], matrix: Array) -> None:
        """Give a link mass and shapes."""
        link = self.links[name]
        shift = inverse(link.matrix) @ matrix
        drawn = tuple(Visual(v.kind, shift @ v.matrix, v.values) for v in visuals)
        total = link.inertia + inertia.moved(shift)
        self.links[name] = _Link(link.matrix, total, (*link.visuals, *drawn))

    def text(self) -> str:
        """The URDF."""
        robot = ET.Element("robot", name=self.name)
        for name, link in self.links.items():
            element = ET.SubElement(robot, "link", name=name)
            _inertial(element, link.inertia)
            for visual in link.visuals:
                shape = ET.SubElement(element, "visual")
                _origin(shape, visual.matrix)
                ET.SubElement(ET.SubElement(shape, "geometry"), visual.kind, visual.values)
        for name, (parent, joint) in self.carriers.items():
            between = inverse(self.links[parent].matrix) @ self.links[name].matrix
            _joint(robot, name, parent, joint, between)
        ET.indent(robot)
        return ET.tostring(robot, encoding="unicode") + "\n"


def _joint(robot: ET.Element, name: str, parent: str, joint: Joint, matrix: Array) -> None:
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.type)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=name)
    if joint.offset:  # the joint stands at zero there
        back = -joint.offset
        slide = joint.type == "prismatic"
        step = pose(shift=back * joint.axis) if slide else pose(axis_turn(joint.axis, back))
        matrix = matrix @ step
    _origin(element, matrix)
    if joint.type in ("fixed", "floating"):
        return
    ET.SubElement(element, "axis", xyz=_text(joint.axis))
    if joint.mimic is not None:
        leader, ratio, offset = joint.mimic
        law = {"multiplier": repr(float(ratio)), "offset": repr(float(offset))}
        ET.SubElement(element, "mimic", {"joint": leader, **law})
    if joint.limits is None and joint.type == "continuous":
        return
    lower, upper = joint.limits or (0.0, 0.0)
    keys = {"lower": repr(float(lower)), "upper": repr(float(upper))}
    ET.SubElement(element, "limit", {**keys, "effort": repr(float(joint.effort)), "velocity": "0"})


def _inertial(element: ET.Element, inertia: Inertia) -> None:
    if not (inertia.mass or inertia.about.any()):
        return
    inside = ET.SubElement(element, "inertial")
    _origin(inside, pose(shift=inertia.centre))
    ET.SubElement(inside, "mass", value=repr(float(inertia.mass)))
    rows = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    rows["izz"] = (2, 2)
    values = {key: repr(float(inertia.about[at])) for key, at in rows.items()}
    ET.SubElement(inside, "inertia", values)


def _origin(element: ET.Element, matrix: Array) -> None:
    values = {"xyz": _text(matrix[:3, 3]), "rpy": _text(rpy(matrix[:3, :3]))}
    ET.SubElement(element, "origin", values)


def _text(values: Array) -> str:
    return " ".join(repr(float(v)) for v in values)
