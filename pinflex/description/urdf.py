"""Finding a URDF and checking it before Pinocchio reads it, so that errors name the element."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinflex.description import ranges
from pinflex.description.files import MOST_TEXT, require_regular
from pinflex.errors import DescriptionError, ModelNotFoundError, nearest
from pinflex.text import brief

# Configuration sizes of the joint types: what a value of `home` may hold.
HOME_SIZES: dict[str, tuple[int, ...]] = {
    "fixed": (),
    "revolute": (1,),
    "continuous": (1,),
    "prismatic": (1,),
    "universal": (2,),
    "planar": (3,),  # x, y, angle
    "spherical": (3, 4),  # rotation vector, or quaternion x y z w
    "floating": (6, 7),  # position and rotation vector, or position and quaternion x y z w
}
_URDF_TYPES = tuple(t for t in HOME_SIZES if t not in ("universal", "spherical"))
_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
_ROBOT_DATA = "example-robot-data:"


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF: its type and the links it joins."""

    name: str
    type: str
    parent: str
    child: str


@dataclass(frozen=True)
class Urdf:
    """A checked URDF: its text and the names in it.

    Attributes:
        file: File name, for messages.
        text: The XML.
        package_dirs: Folders in which `package://` is looked up.
        links: Link names in file order.
        joints: Joints by name.
    """

    __repr__ = brief

    file: str
    text: str
    package_dirs: tuple[str, ...]
    links: tuple[str, ...]
    joints: dict[str, UrdfJoint]


def find(source: str, folder: Path, where: str) -> Urdf:
    """Read and check the URDF of the key `urdf`.

    Args:
        source: A file, relative to `folder`, or "example-robot-data:NAME".
        folder: Folder of the YAML.
        where: Place of the key, for messages.
    """
    if source.startswith(_ROBOT_DATA):
        path, packages = _robot_data(source[len(_ROBOT_DATA) :].strip(), where)
        return check(read_text(path, where), path.name, packages)
    path = folder / source
    if not path.is_file():
        found = [p.name for p in sorted(folder.glob("*.urdf"))]
        raise ModelNotFoundError(
            f'{where}: no file "{source}" beside the YAML.{nearest(source, found)} Give a path '
            f"relative to the YAML, or {_ROBOT_DATA}NAME."
        )
    packages = tuple(dict.fromkeys((str(path.parent.resolve()), str(folder.resolve()))))
    return check(read_text(path, where), path.name, packages)


def read_text(path: Path, where: str) -> str:
    """The text of a file that must be readable UTF-8."""
    require_regular(path, MOST_TEXT, f"{where}: {path.name}")
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DescriptionError(
            f"{where}: {path.name} is not UTF-8 text (byte {error.start}). Save it as UTF-8."
        ) from None
    except OSError as error:
        raise DescriptionError(f"{where}: cannot read {path.name}: {error.strerror}.") from None


def _robot_data(name: str, where: str) -> tuple[Path, tuple[str, ...]]:
    """Path of a robot of the package example-robot-data, without loading its meshes."""
    try:
        from example_robot_data import (  # type: ignore[import-not-found,import-untyped,unused-ignore]
            ROBOTS,
            getModelPath,
        )
    except ImportError:
        raise DescriptionError(
            f'{where}: "{_ROBOT_DATA}{name}" needs the package example-robot-data-loaders, which '
            "is not installed. Run `pip install example-robot-data-loaders`, or give a URDF file."
        ) from None
    if name not in ROBOTS:
        raise ModelNotFoundError(
            f'{where}: no robot "{name}" in example-robot-data.{nearest(name, sorted(ROBOTS))}'
        )
    loader = ROBOTS[name]
    if not loader.urdf_filename:
        raise DescriptionError(
            f'{where}: the robot "{name}" of example-robot-data is an SDF, not a URDF. Choose '
            "another, or convert it."
        )
    part = f"{loader.path}/{loader.urdf_subpath}/{loader.urdf_filename}"
    try:
        root = Path(loader.model_path or getModelPath(part))
    except OSError:
        raise DescriptionError(
            f'{where}: the files of the robot "{name}" are missing. Install example-robot-data.'
        ) from None
    return root / part, (str((root / "../..").resolve()),)


def check(text: str, file: str, package_dirs: tuple[str, ...] = ()) -> Urdf:
    """Check a URDF's text and list its names.

    Args:
        text: The XML.
        file: File name, for messages.
        package_dirs: Kept in the result.
    """
    # A document type can hold entities that grow without bound, and URDF has no use for one.
    first, *rest = text.split("<!--")
    if re.search("<!(DOCTYPE|ENTITY)", first + "".join(x.partition("-->")[2] for x in rest), re.I):
        raise DescriptionError(f"{file}: holds a <!DOCTYPE>, which a URDF must not. Remove it.")
    try:
        root = ET.fromstring(text.strip())
    except ET.ParseError as error:
        # Positions count from the first non-blank line, as the XML declaration must come first.
        line = error.position[0] + text[: len(text) - len(text.lstrip())].count("\n")
        raise DescriptionError(
            f"{file}, line {line}: malformed XML: {str(error).split(':')[0]}. Correct the line.",
            line=line,
        ) from None
    except ValueError as error:
        raise DescriptionError(f"{file}: malformed XML: {error}. Correct it.") from None
    if root.tag != "robot":
        raise DescriptionError(f"{file}: the root element is <{root.tag}>. A URDF has <robot>.")
    if any("xacro" in element.tag for element in root.iter() if isinstance(element.tag, str)):
        raise DescriptionError(
            f"{file}: is a xacro, not a URDF. Expand it: `xacro {file} > x.urdf`."
        )
    links = _names(root, "link", file)
    if not links:
        raise DescriptionError(f"{file}: no <link>. A robot has at least one.")
    for name, element in links.items():
        inertial = element.find("inertial")
        if inertial is not None:
            _check_inertial(inertial, f'{file}: link "{name}"')
    joints = {
        name: _joint(element, name, links, f'{file}: joint "{name}"', file)
        for name, element in _names(root, "joint", file).items()
    }
    _check_tree(tuple(links), joints, file)
    return Urdf(file, text, package_dirs, tuple(links), joints)


def _names(root: ET.Element, tag: str, file: str) -> dict[str, ET.Element]:
    found: dict[str, ET.Element] = {}
    for i, element in enumerate(root.findall(tag)):
        name = (element.get("name") or "").strip()
        if not name or name == "universe":
            raise DescriptionError(
                f'{file}: <{tag}> number {i + 1} has the name "{name}". Give it one that is not '
                'empty and not "universe", which Pinocchio keeps for itself.'
            )
        if name in found:
            raise DescriptionError(f'{file}: two of <{tag}> are named "{name}". Rename one.')
        found[name] = element
    return found


def _number(text: str | None, where: str, low: float = -math.inf, of: str = "place") -> float:
    try:
        value = float(text if text is not None else "")
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= low):
        allowed = "a finite number" + (f" >= {low:g}" if low > -math.inf else "")
        raise DescriptionError(f"{where}: {text!r} will not do. Allowed: {allowed}. Correct it.")
    return ranges.within(value, where, of)


def _triple(element: ET.Element | None, key: str, where: str) -> tuple[float, ...]:
    text = None if element is None else element.get(key)
    if text is None:
        return (0.0, 0.0, 0.0)
    parts = text.split()
    if len(parts) != 3:
        raise DescriptionError(f'{where} {key}: "{text}" is not three numbers. Correct it.')
    return tuple(_number(part, f"{where} {key}") for part in parts)


def _check_inertial(inertial: ET.Element, where: str) -> None:
    for key in ("xyz", "rpy"):
        _triple(inertial.find("origin"), key, f"{where}: inertial origin")
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        what = "mass" if mass is None else "inertia"
        raise DescriptionError(f"{where}: <inertial> has no <{what}>. Write it, or leave both out.")
    _number(mass.get("value"), f"{where}: mass", low=0, of="mass")
    xx, xy, xz, yy, yz, zz = (
        _number(inertia.get(key), f"{where}: inertia {key}", of="inertia")
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    # 1e-7 kg m^2 (a gram at a centimetre) lets rounded tensors of tiny parts pass.
    if moments[0] < -max(1e-7, 1e-6 * moments[-1]):
        shown = ", ".join(f"{m:.4g}" for m in moments)
        raise DescriptionError(
            f"{where}: inertia has the principal moments {shown} kg m^2. None may be negative. "
            "Check the signs and the products of inertia."
        )


def _joint(
    element: ET.Element, name: str, links: dict[str, ET.Element], where: str, file: str
) -> UrdfJoint:
    kind = element.get("type") or ""
    if kind not in _URDF_TYPES:
        raise DescriptionError(
            f'{where}: no such type: "{kind}".{nearest(kind, _URDF_TYPES)} For a spherical or '
            "universal joint write fixed, and its type under `joints` in the YAML."
        )
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = "" if end is None else (end.get("link") or "").strip()
        if link not in links:
            raise DescriptionError(
                f'{where}: {tag}: no such link in {file}: "{link}".{nearest(link, links)}'
            )
        ends.append(link)
    for key in ("xyz", "rpy"):
        _triple(element.find("origin"), key, f"{where}: origin")
    axis = element.find("axis")
    if kind in _WITH_AXIS and axis is not None:
        vector = _triple(axis, "xyz", f"{where}: axis")
        if math.hypot(*vector) < 1e-9:
            raise DescriptionError(
                f"{where}: axis: {vector} has no direction. Write a unit vector."
            )
    return UrdfJoint(name, kind, ends[0], ends[1])


def _check_tree(links: tuple[str, ...], joints: dict[str, UrdfJoint], file: str) -> None:
    carrier: dict[str, UrdfJoint] = {}
    advice = "A URDF is a tree: cut the loop there and close it under `loops` in the YAML."
    for joint in joints.values():
        other = carrier.setdefault(joint.child, joint)
        if other is not joint:
            raise DescriptionError(
                f'{file}: link "{joint.child}" has two parents, through the joints "{other.name}" '
                f'and "{joint.name}". {advice}'
            )
    rooted: set[str] = set()
    for link in links:
        path: list[str] = []
        step = link
        while step not in rooted and step in carrier:
            path.append(step)
            step = carrier[step].parent
            if step in path:
                cycle = " -> ".join(reversed(path[path.index(step) :]))
                raise DescriptionError(f"{file}: the links {cycle} go round. {advice}")
        rooted.update((*path, step))
    roots = [link for link in links if link not in carrier]
    if len(roots) > 1:
        raise DescriptionError(
            f"{file}: the links {', '.join(roots[:8])} have no parent, but one tree has one root. "
            "Join the others to it, with fixed joints if they stand still."
        )


@dataclass(frozen=True)
class Limits:
    """Limits of a joint in a URDF; nothing written is inf.

    Attributes:
        effort: [N m | N]. velocity: [rad/s | m/s].
    """

    effort: float
    velocity: float


def limits(text: str) -> dict[str, Limits]:
    """Effort and velocity limits by joint; zero means that nobody wrote one."""
    found = {}
    for joint in ET.fromstring(text.strip()).findall("joint"):
        limit = joint.find("limit")
        if limit is not None:
            effort, velocity = (_positive(limit.get(key)) for key in ("effort", "velocity"))
            found[joint.get("name", "")] = Limits(effort, velocity)
    return found


def _positive(text: str | None) -> float:
    try:
        value = float(text or "0")
    except ValueError:
        value = 0.0
    return value if value > 0.0 else math.inf
