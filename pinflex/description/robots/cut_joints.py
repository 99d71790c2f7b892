"""Joints of the tree with clearance: cut, and closed again as loops.

`joints: {knee: {clearance: 50 um, pin: 5 mm}}` is short for a planar joint `knee`, across the axis
of the written one, and a loop `knee` of the kind planar between the frames `knee_hole`, which its
parent carries, and `knee_pin`, which it moves.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import numpy as np

from pinflex.description.files import Source
from pinflex.description.loops import PIN
from pinflex.description.reading import schema
from pinflex.description.robots import urdf
from pinflex.description.robots.tree_text import hang
from pinflex.errors import DescriptionError
from pinflex.rotations import axis_frame, zyx_matrix

_DROPPED = ("axis", "limit", "dynamics", "mimic", "safety_controller")


def cut(block: Mapping[str, Any], tree: Source, file: str) -> tuple[dict[str, Any], Source]:
    """The YAML's block and the robot with joints that have clearance as loops."""
    joints = schema.mapping(block["joints"], f"{file}: joints")
    loops, home = (
        schema.mapping(block.get(key, {}), f"{file}: {key}") for key in ("loops", "home")
    )
    root = None
    loose = [k for k, x in joints.items() if isinstance(x, Mapping) and "clearance" in x]
    for name in loose:
        where = f"{file}: joints.{name}"
        schema.known(name, where, tree.joints, f"joint in {tree.file}")
        _refuse_other_keys(name, joints[name], block, tree, where)
        between = [f"{name}_hole", f"{name}_pin"]
        loops[name] = {"kind": "planar", "between": between, **joints.pop(name)}
        angle = home.get(name, 0.0)
        if not isinstance(angle, list):
            home[name] = [0.0, 0.0, angle]
        if f"{name}_hole" not in tree.links:  # else: read again
            root = ET.fromstring(tree.text) if root is None else root
            _cut(root, name)
    whole = {**block, "joints": joints, "loops": loops, "home": home}
    if root is not None:
        tree = urdf.check(ET.tostring(root, encoding="unicode"), tree.file, tree.package_dirs)
    return whole, tree


def _refuse_other_keys(
    name: str, item: Mapping[str, Any], block: Mapping[str, Any], tree: Source, where: str
) -> None:
    """Refuse a joint that is no hinge, moves by itself, or says more."""
    if tree.joints[name].type not in ("revolute", "continuous", "planar"):
        raise DescriptionError(
            f"{where}.clearance: {name} is {tree.joints[name].type}. Joints of the tree have "
            "clearance as hinges; write others as loops."
        )
    if name in (block.get("actuated") or ()):
        raise DescriptionError(
            f"{where}.clearance: a motor turns {name}. Leave it out of `actuated`, or give the "
            "clearance to a joint beside it."
        )
    for key in item:
        if key not in PIN:
            raise DescriptionError(
                f"{where}.{key}: has no meaning beside clearance. Allowed: {', '.join(PIN)}."
            )
    if name in (block.get("loops") or {}):
        raise DescriptionError(f"{where}.clearance: a loop is called {name} too. Rename it.")


def _cut(root: ET.Element, name: str) -> None:
    """Let a planar joint, between two new links, take the place of a hinge."""
    joint = next(x for x in root.findall("joint") if (x.get("name") or "").strip() == name)
    origin, written = joint.find("origin"), joint.find("axis")
    axis = _numbers(written, "xyz", (1.0, 0.0, 0.0))
    turn = axis_frame(axis / np.linalg.norm(axis), None)
    place, rotation = _numbers(origin, "xyz"), zyx_matrix(_numbers(origin, "rpy")[::-1])
    parent, child = joint.find("parent"), joint.find("child")
    assert parent is not None
    assert child is not None
    for tag in (*_DROPPED, "origin"):
        for element in joint.findall(tag):
            joint.remove(element)
    joint.set("type", "planar")
    ET.SubElement(joint, "axis", xyz="0 0 1")
    hole, pin = f"{name}_hole", f"{name}_pin"
    hang(root, hole, f"{hole}_joint", parent.get("link", ""), place, rotation @ turn)
    ET.SubElement(root, "link", name=pin)
    hang(root, child.get("link", ""), f"{name}_carries", pin, np.zeros(3), turn.T)
    parent.set("link", hole)
    child.set("link", pin)


def _numbers(element: ET.Element | None, key: str, default: Any = (0.0, 0.0, 0.0)) -> Any:
    words = None if element is None else element.get(key)
    return np.array(default if words is None else [float(x) for x in words.split()], float)
