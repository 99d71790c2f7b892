"""Checking a URDF before Pinocchio reads it, so that errors name the element."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from pinflex.description.files import HOME_SIZES, Source, SourceJoint
from pinflex.description.reading import schema
from pinflex.description.robots.tree_text import malformed, refuse_doctype, require_shallow
from pinflex.errors import DescriptionError, nearest

_URDF_TYPES = tuple(t for t in HOME_SIZES if t not in ("universal", "spherical"))
_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")


@lru_cache(maxsize=4)  # a robot is loaded again and again
def check(text: str, file: str, package_dirs: tuple[str, ...] = ()) -> Source:
    """Check a URDF's text and list its names."""
    refuse_doctype(text, file, "a URDF")
    try:
        root = ET.fromstring(text.strip())
    except ET.ParseError as error:
        # Positions count from the first non-blank line, as the XML declaration must come first.
        line = error.position[0] + text[: len(text) - len(text.lstrip())].count("\n")
        raise malformed(file, line, error) from None
    except ValueError as error:
        raise DescriptionError(f"{file}: malformed XML: {error}. Correct it.") from None
    require_shallow(root, file)
    if root.tag != "robot":
        raise DescriptionError(f"{file}: the root element is <{root.tag}>. A URDF has <robot>.")
    if any("xacro" in element.tag for element in root.iter() if isinstance(element.tag, str)):
        raise DescriptionError(
            f"{file}: is a xacro, not a URDF. Expand it: `xacro {file} > x.urdf`."
        )
    links = _by_name(root, "link", file)
    if not links:
        raise DescriptionError(f"{file}: no <link>. A robot has at least one.")
    for name, element in links.items():
        inertial = element.find("inertial")
        if inertial is not None:
            _check_inertial(inertial, f'{file}: link "{name}"')
    geared = _reductions(root)
    joints = {
        name: _joint(element, name, links, file, geared.get(name))
        for name, element in _by_name(root, "joint", file).items()
    }
    _check_tree(tuple(links), joints, file)
    return Source(file, text, package_dirs, tuple(links), joints)


def _by_name(root: ET.Element, tag: str, file: str) -> dict[str, ET.Element]:
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
        raise DescriptionError(f"{where}: {text!r} is not valid. Allowed: {allowed}. Correct it.")
    return schema.within(value, where, of)


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
    element: ET.Element, name: str, links: dict[str, ET.Element], file: str, reduction: float | None
) -> SourceJoint:
    where = f'{file}: joint "{name}"'
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
    _require_limit(element, kind, where)
    dynamics = element.find("dynamics")
    damping, friction = (
        0.0 if dynamics is None else max(_number_or_zero(dynamics.get(key)), 0.0)
        for key in ("damping", "friction")
    )
    mimic = _mimic(element.find("mimic"), where)
    return SourceJoint(name, kind, ends[0], ends[1], damping, friction, reduction, mimic)


def _require_limit(element: ET.Element, kind: str, where: str) -> None:
    """Raise where Pinocchio's parser would: joints with an end need <limit effort= velocity=>."""
    limit = element.find("limit")
    absent = [key for key in ("effort", "velocity") if limit is None or not limit.get(key)]
    if kind in ("revolute", "prismatic") and absent:
        other = " For one that turns without end, write the type continuous."
        raise DescriptionError(
            f"{where}: a {kind} joint needs <limit lower= upper= effort= velocity=>. Missing: "
            f"{'<limit>' if limit is None else ', '.join(absent)}."
            f"{other if kind == 'revolute' else ''}"
        )


def _mimic(element: ET.Element | None, where: str) -> tuple[str, float, float] | None:
    """Joint, multiplier and offset of a mimic tag."""
    if element is None:
        return None
    ratio, offset = (
        _number(element.get(key, default), f"{where}: mimic {key}", of=of)
        for key, default, of in (("multiplier", "1", "ratio"), ("offset", "0", "position"))
    )
    return (element.get("joint") or "").strip(), ratio, offset


def _reductions(root: ET.Element) -> dict[str, float]:
    """Gear ratios by joint: mechanicalReduction of a transmission of one joint and one actuator."""
    found = {}
    for item in root.findall("transmission"):
        joints, motors = item.findall("joint"), item.findall("actuator")
        if len(joints) == 1 and len(motors) <= 1:
            places = (*motors, *joints, item)
            texts = (place.findtext("mechanicalReduction") for place in places)
            ratio = _number_or_zero(next(filter(None, texts), None))
            if ratio:
                found[joints[0].get("name", "")] = ratio
    return found


def _check_tree(links: tuple[str, ...], joints: dict[str, SourceJoint], file: str) -> None:
    carrier: dict[str, SourceJoint] = {}
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
    """Limits of a joint in a URDF as they are written; 0 where nothing is.

    Attributes:
        lower, upper: [rad | m]; the same two numbers mean that nobody wrote a limit.
        effort: [N m | N]. velocity: [rad/s | m/s].
        acceleration: The less of acceleration and deceleration [rad/s^2 | m/s^2] (URDF 1.2).
        jerk: [rad/s^3 | m/s^3] (URDF 1.2).
    """

    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0


@dataclass(frozen=True)
class MotorLimits:
    """Limits that are written, by joint: what profiles and `retime` keep.

    Attributes:
        velocity: [rad/s | m/s]. acceleration: [rad/s^2 | m/s^2]. jerk: [rad/s^3 | m/s^3].
        effort: [N m | N].
    """

    velocity: dict[str, float]
    acceleration: dict[str, float]
    jerk: dict[str, float]
    effort: dict[str, float]


@lru_cache(maxsize=4)  # every run of a digital controller asks for them
def limits(text: str) -> dict[str, Limits]:
    """Limits by joint; what is no number counts as not written."""
    keys = ("lower", "upper", "effort", "velocity", "jerk")
    found = {}
    for joint in ET.fromstring(text.strip()).findall("joint"):
        limit = joint.find("limit")
        if limit is not None:
            both = (_number_or_zero(limit.get(key)) for key in ("acceleration", "deceleration"))
            slower = min((x for x in both if x > 0.0), default=0.0)
            values = {key: _number_or_zero(limit.get(key)) for key in keys}
            found[joint.get("name", "")] = Limits(**values, acceleration=slower)
    return found


def motor_limits(text: str, motors: Iterable[str]) -> MotorLimits:
    """The limits of motors that a URDF writes."""
    known, names = limits(text), list(motors)
    return MotorLimits(
        **{
            field.name: {
                name: value
                for name in names
                if (value := getattr(known.get(name, Limits()), field.name)) > 0.0
            }
            for field in fields(MotorLimits)
        }
    )


def _number_or_zero(text: str | None) -> float:
    try:
        value = float(text or "0")
    except ValueError:
        return 0.0
    return value if math.isfinite(value) else 0.0
