"""A tree of links and joints, each placed as its file draws it, written as a URDF.

The formats that are not URDF are read into this; what a URDF cannot say (loops, springs, types of
joints) their readers say as blocks of the YAML. A link's frame stands at the joint that carries it.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from xml.parsers import expat

import numpy as np

from pinflex.arrays import Array
from pinflex.description.reading import schema
from pinflex.errors import DescriptionError, nearest
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


def hang(
    root: ET.Element, link: str, joint: str, parent: str, at: Array, turn: Array | None = None
) -> ET.Element:
    """Fix a link of a URDF, a new one if it is not there, to another; returns the joint."""
    if all((one.get("name") or "").strip() != link.strip() for one in root.findall("link")):
        ET.SubElement(root, "link", name=link)
    made = ET.SubElement(root, "joint", name=joint, type="fixed")
    ET.SubElement(made, "parent", link=parent)
    ET.SubElement(made, "child", link=link)
    origin = ET.SubElement(made, "origin", xyz=triple(at))
    if turn is not None:
        origin.set("rpy", triple(rpy(turn)))
    return made


def triple(numbers: Iterable[float]) -> str:
    """Three numbers as a URDF has them, to the last digit."""
    return " ".join(repr(float(x)) for x in numbers)


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
    ET.SubElement(element, "axis", xyz=triple(joint.axis))
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
    values = {"xyz": triple(matrix[:3, 3]), "rpy": triple(rpy(matrix[:3, :3]))}
    ET.SubElement(element, "origin", values)


# XML whose elements know their line, for readers that name what they leave out.

_DEEPEST = 500  # MuJoCo's limit too
_DOCTYPE = re.compile("<!(DOCTYPE|ENTITY)", re.I)


class Element(ET.Element):
    """An element with the line of its file on which it starts, and the file's name."""

    line: int = 0
    file: str = ""

    @property
    def place(self) -> str:
        """File and line, for messages."""
        return f"{self.file}, line {self.line}"

    def all(self, tag: str | None = None) -> Iterator[Element]:
        """The children, of one tag if given."""
        for child in self if tag is None else self.findall(tag):
            assert isinstance(child, Element)
            yield child

    def child(self, path: str) -> Element | None:
        """The first child of a tag, or the first at the end of tags, as in "axis/limit"."""
        return next(self.all(path), None)


def refuse_doctype(text: str, file: str, what: str) -> None:
    """A document type can hold entities that grow without bound, and robots have no use for one."""
    first, *rest = text.split("<!--")
    if _DOCTYPE.search(first + "".join(x.partition("-->")[2] for x in rest)):
        raise DescriptionError(f"{file}: holds a <!DOCTYPE>, which {what} must not. Remove it.")


def malformed(file: str, line: int, error: Exception) -> DescriptionError:
    """The refusal of text that is no XML."""
    return DescriptionError(
        f"{file}, line {line}: malformed XML: {str(error).split(':')[0]}. Correct the line.",
        line=line,
    )


def require_shallow(root: ET.Element, file: str) -> None:
    """Refuse elements in elements without end, which no robot has."""
    level = [root]
    for _ in range(_DEEPEST):
        level = [child for element in level for child in element]
        if not level:
            return
    raise DescriptionError(
        f"{file}: elements go more than {_DEEPEST} deep. Remove what is no part of a robot."
    )


def parse(text: str, file: str, tags: tuple[str, ...], what: str) -> Element:
    """The root element of an XML text."""
    refuse_doctype(text, file, what)
    builder = ET.TreeBuilder(element_factory=Element)
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def start(name: str, attributes: dict[str, str]) -> None:
        element = builder.start(name, attributes)
        assert isinstance(element, Element)
        element.line, element.file = parser.CurrentLineNumber + lead, file

    lead = text[: len(text) - len(text.lstrip())].count("\n")
    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.strip(), True)
    except expat.ExpatError as error:
        raise malformed(file, error.lineno + lead, error) from None
    except ValueError as error:
        raise DescriptionError(f"{file}: malformed XML: {error}. Correct it.") from None
    root = builder.close()
    assert isinstance(root, Element)
    require_shallow(root, file)
    if tags and root.tag not in tags:
        raise DescriptionError(f"{file}: the root element is <{root.tag}>, not <{tags[0]}>.")
    return root


def numbers(
    text: str | None, element: Element, key: str, size: int | None = None, of: str = "place"
) -> Array:
    """The finite numbers of a text, `size` of them if given."""
    where = f"{element.place}: <{element.tag}> {key}"
    try:
        values = np.array([float(part) for part in (text or "").split()])
    except ValueError:
        values = np.array([np.nan])
    if not np.all(np.isfinite(values)) or (size is not None and len(values) != size):
        count = "numbers" if size is None else f"{size} number{'s' if size > 1 else ''}"
        raise DescriptionError(f"{where}: {text!r} is not {count}. Correct it.")
    for value in values:
        schema.within(float(value), where, of)
    return values


def unused(element: Element, taken: Collection[str], children: bool = False) -> Iterator[str]:
    """Sentences on attributes (or children) of an element that are not among those taken."""
    own = f' "{element.get("name")}"' if element.get("name") else ""
    found = {child.tag: child.place for child in reversed([*element.all()])} if children else {}
    places = found if children else dict.fromkeys(element.attrib, element.place)
    for name, place in places.items():
        if name not in taken:
            word = f"<{name}>" if children else name
            yield f"{place}: {word} of <{element.tag}>{own} is not taken over."


def known(name: str, names: Collection[str], element: Element, what: str) -> str:
    """A name that the file defines."""
    if name not in names:
        raise DescriptionError(f'{element.place}: no such {what}: "{name}".{nearest(name, names)}')
    return name
