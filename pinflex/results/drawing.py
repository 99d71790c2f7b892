"""Parts of a robot that a drawing needs and arrays do not have: joints, visuals, loops, beam axes.

A run has them in its meta, written when it was solved. Files of before are read from the source
texts that they hold, here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pinflex.arrays import Array
from pinflex.text import frozen

Plain = dict[str, Any]
_SHAPES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


@dataclass(frozen=True)
class Joint:
    """One joint as the URDF has it; origin [m] in the parent link, axis in the joint frame."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array


@dataclass(frozen=True)
class Visual:
    """A mesh file or simple shape on a link.

    Attributes:
        file: Name of the mesh as the URDF has it; "" for a simple shape.
        shape: box, cylinder or sphere; "" for a mesh.
        size: Edges of a box; radius and length of a cylinder; radius of a sphere [m].
        scale: Of a mesh, shape (3,).
        rpy: Its turn about the link's x, y, z axes, in this order [rad].
        xyz: Its origin in the link [m].
    """

    file: str
    shape: str
    size: tuple[float, ...]
    scale: tuple[float, ...]
    rpy: tuple[float, ...]
    xyz: tuple[float, ...]


@frozen
class Drawing:
    """Parts of a robot by name.

    Attributes:
        joints: Of the URDF.
        visuals: By link.
        loops: Frames that each loop joint ties.
        beams: Axes of flexible links in the link's frame, columns x, y, z, shape (3, 3).
    """

    joints: Mapping[str, Joint] = field(default_factory=dict)
    visuals: Mapping[str, list[Visual]] = field(default_factory=dict)
    loops: Mapping[str, list[str]] = field(default_factory=dict)
    beams: Mapping[str, Array] = field(default_factory=dict)


def drawing_of(meta: Mapping[str, Any]) -> Drawing:
    """Parts of the robot of a run, from its meta, or of an older file from its source texts."""
    sources, parts = meta.get("sources", {}), meta.get("drawing")
    if parts is None:
        parts = next(filter(None, map(_of_text, sources.values())), {})
    joints = {name: _read_joint(name, x) for name, x in parts.get("joints", {}).items()}
    visuals = {
        link: [_read_visual(x) for x in every] for link, every in parts.get("visuals", {}).items()
    }
    loops = {x["name"]: x["between"] for x in meta.get("loops", ()) if "between" in x}
    beams = {}
    for name, link in meta.get("links", {}).items():
        axes = link.get("frame") or _beam(joints, name)
        if axes is not None:
            beams[name] = np.asarray(axes, float)
    return Drawing(joints, visuals, loops or _loops_of_texts(sources), beams)


def urdf_parts(text: str) -> Plain:
    """Joints and visuals of a URDF as JSON has them; a visual that cannot be read is left out."""
    root = ElementTree.fromstring(text.strip())
    return {
        "joints": {j.get("name", ""): x for j in root.findall("joint") if (x := _joint(j))},
        "visuals": {
            link.get("name", ""): every
            for link in root.findall("link")
            if (every := [x for v in link.findall("visual") if (x := _visual(v))])
        },
    }


def _joint(node: ElementTree.Element) -> Plain | None:
    parent, child = node.find("parent"), node.find("child")
    if parent is None or child is None:
        return None
    fixed = node.get("type", "fixed") == "fixed"  # whose axis nothing reads
    return {
        "kind": node.get("type", "fixed"),
        "parent": parent.get("link", ""),
        "child": child.get("link", ""),
        "origin": _numbers(node.find("origin"), "xyz", "0 0 0"),
        "axis": _numbers(None if fixed else node.find("axis"), "xyz", "1 0 0"),
    }


def _visual(node: ElementTree.Element) -> Plain | None:
    geometry, origin = node.find("geometry"), node.find("origin")
    kind = geometry[0] if geometry is not None and len(geometry) else None
    mesh = kind is not None and kind.tag == "mesh"
    file = kind.get("filename", "") if kind is not None and mesh else ""
    if kind is None or not (file if mesh else kind.tag in _SHAPES):
        return None
    try:
        return {
            "file": file,
            "shape": "" if file else kind.tag,
            "size": [x for key in _SHAPES.get(kind.tag, ()) for x in _numbers(kind, key, "0")],
            "scale": _numbers(kind, "scale", "1 1 1"),
            "rpy": _numbers(origin, "rpy", "0 0 0"),
            "xyz": _numbers(origin, "xyz", "0 0 0"),
        }
    except ValueError:
        return None


def _numbers(node: ElementTree.Element | None, key: str, default: str) -> list[float]:
    return [float(x) for x in (default if node is None else node.get(key, default)).split()]


def _read_joint(name: str, x: Plain) -> Joint:
    origin, axis = (np.asarray(x[key], float) for key in ("origin", "axis"))
    return Joint(name, x["kind"], x["parent"], x["child"], origin, axis)


def _read_visual(x: Plain) -> Visual:
    numbers = (tuple(x[key]) for key in ("size", "scale", "rpy", "xyz"))
    return Visual(x["file"], x["shape"], *numbers)


# Files without these parts in their meta -----------------------------------------------------


def _of_text(text: str) -> Plain:
    if "<robot" not in text:
        return {}
    try:
        return urdf_parts(text)
    except (ElementTree.ParseError, ValueError):
        return {}


def _beam(joints: Mapping[str, Joint], name: str) -> Array | None:
    """Beam axes in the link's frame by the default rule: x to the child, z by the own axis."""
    spans = [j.origin for j in joints.values() if j.parent == name and np.any(j.origin)]
    above = [j for j in joints.values() if j.child == name]
    if not spans or not above:
        return None
    x = max(spans, key=lambda s: float(np.linalg.norm(s)))
    x = x / np.linalg.norm(x)
    for up in (above[0].axis, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])):
        z = up - x * (x @ up)
        if np.linalg.norm(z) > 1e-3:
            z = z / np.linalg.norm(z)
            return np.stack([x, np.cross(z, x), z], axis=1)
    return None


def _loops_of_texts(sources: Mapping[str, str]) -> dict[str, list[str]]:
    """Frames that each loop joint ties, from the YAML text."""
    for name, text in sources.items():
        if not name.endswith((".yaml", ".yml")):
            continue
        import yaml  # type: ignore[import-untyped,unused-ignore]

        try:
            read = yaml.safe_load(text)
        except yaml.YAMLError:
            continue
        found = read.get("loops") if isinstance(read, dict) else None
        if isinstance(found, dict):
            pairs = {str(k): v.get("between") for k, v in found.items() if isinstance(v, dict)}
            return {k: list(map(str, v)) for k, v in pairs.items() if isinstance(v, list)}
    return {}
