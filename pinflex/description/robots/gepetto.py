"""Reading the robot.yaml of Gepetto's example-parallel-robots, which stands beside a URDF.

closed_loop: [[closedloop1_A, closedloop1_B]]   pairs of frames
type: [6d]                                      6d: welded, 3d: only the points meet
name_mot: [motor_hip]                           joints with a motor
joint_name: [ball]                              joints that the URDF writes as revolute
joint_type: [SPHERICAL]                         and what they are: SPHERICAL, UJOINT_XY, FIXED
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pinflex.description.files import MOST_TEXT, Source, require_regular
from pinflex.description.reading import schema, yaml_text
from pinflex.description.robots import urdf
from pinflex.errors import DescriptionError, nearest

_LOOPS = {"3d": "spherical", "6d": "weld"}
_UNIVERSAL = re.compile(r"UJOINT_([XYZ])([XYZ])")
_KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")


def read(text: str, file: str, package_dirs: tuple[str, ...]) -> Source:
    """Read a robot.yaml and the URDF in its folder."""
    block = schema.mapping(yaml_text.load(text, file), file)
    if "urdf" in block:
        raise DescriptionError(f"{file}: urdf: is a description itself. Give `pinflex` this file.")
    robot = _beside(Path(package_dirs[0]) if package_dirs else Path(), file)
    tree = urdf.check(robot.read_text("utf-8-sig"), robot.name, package_dirs)
    types = _types(block, file, tree)
    changed = _retyped(tree.text, types)
    checked = urdf.check(changed, robot.name, package_dirs) if types else tree
    blocks: dict[str, Any] = {}
    kinds = {name: kind for name, kind in types.items() if kind is not None}
    if kinds:
        blocks["joints"] = kinds
    notes = [
        f"{file}, line {_line(text, key)}: `{key}` is not taken over."
        for key in block
        if key not in _KEYS
    ]
    if "name_mot" in block:
        place = schema.at(file, "name_mot")
        names = schema.names(block["name_mot"], place, tree.joints, f"joint in {robot.name}")
        leaders = {name: _leader(name, checked) for name in names}
        blocks["actuated"] = [*dict.fromkeys(leaders.values())]
        notes += [
            f"{file}, line {_line(text, 'name_mot')}: {name} follows {leader} (its mimic in "
            f"{robot.name}), whose motor moves both."
            for name, leader in leaders.items()
            if leader != name
        ]
    return replace(checked, loops=_loops(block, file, tree), blocks=blocks, notes=tuple(notes))


def _leader(name: str, tree: Source) -> str:
    """The joint at the end of a chain of mimic tags; the joint itself where it has none."""
    seen = [name]
    while (mimic := tree.joints[seen[-1]].mimic) is not None:
        if mimic[0] not in tree.joints or mimic[0] in seen:  # `couplings` tells about either
            break
        seen.append(mimic[0])
    return seen[-1]


def _beside(folder: Path, file: str) -> Path:
    """The URDF of the folder: robot.urdf, or the only one."""
    found = sorted(folder.glob("*.urdf"))
    path = next((p for p in found if p.name == "robot.urdf"), found[0] if len(found) == 1 else None)
    if path is None:
        have = ", ".join(p.name for p in found) or "none"
        raise DescriptionError(
            f"{file}: closed loops of a robot.urdf in the same folder, which has {have}. Put "
            "robot.urdf there."
        )
    require_regular(path, MOST_TEXT, f"{file}: {path.name}")
    return path


def _loops(block: Mapping[str, Any], file: str, tree: Source) -> dict[str, Any]:
    """Pairs of frames as the block `loops` says them."""
    pairs = schema.items(block.get("closed_loop") or [], f"{file}: closed_loop")
    kinds = schema.items(block.get("type") or ["6d"] * len(pairs), f"{file}: type", len(pairs))
    frames: Collection[str] = {*tree.links, *tree.joints}
    found: dict[str, Any] = {}
    for k, (pair, kind) in enumerate(zip(pairs, kinds, strict=True)):
        where = f"{file}: closed_loop[{k}]"
        a, b = (
            schema.known(name, where, frames, f"frame in {tree.file}")
            for name in schema.items(pair, where, 2)
        )
        word = schema.choice(str(kind).lower(), f"{file}: type[{k}]", _LOOPS)
        found[_loop_name(a, b, k, found)] = {"kind": _LOOPS[word], "between": [a, b]}
    return found


def _loop_name(a: str, b: str, k: int, taken: Collection[str]) -> str:
    """The common start of both names: closedloop1 of closedloop1_A and closedloop1_B."""
    same = next((n for n, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), len(a))
    name = a[:same].rstrip("_- .")
    return name if name and name not in taken else f"loop_{k + 1}"


def _types(block: Mapping[str, Any], file: str, tree: Source) -> dict[str, dict[str, Any] | None]:
    """Entries of the block `joints` for the named joints; None: fixed."""
    names = schema.items(block.get("joint_name") or [], f"{file}: joint_name")
    kinds = schema.items(block.get("joint_type") or [], f"{file}: joint_type", len(names))
    found: dict[str, dict[str, Any] | None] = {}
    for k, (name, kind) in enumerate(zip(names, kinds, strict=True)):
        joint = schema.known(name, f"{file}: joint_name[{k}]", tree.joints, f"joint in {tree.file}")
        word = str(kind).upper()
        axes = _UNIVERSAL.fullmatch(word)
        if axes and axes[1] != axes[2]:
            found[joint] = {"type": "universal", "axes": [axes[1].lower(), axes[2].lower()]}
        elif word in ("SPHERICAL", "FIXED"):
            found[joint] = {"type": "spherical"} if word == "SPHERICAL" else None
        else:
            allowed = ("SPHERICAL", "UJOINT_XY", "FIXED")
            raise DescriptionError(
                f"{file}: joint_type[{k}]: {schema.shown(kind)} is not known."
                f"{nearest(word, allowed)} Any two axes make a UJOINT."
            )
    return found


def _retyped(text: str, names: Collection[str]) -> str:
    """The URDF with these joints fixed, which the YAML may turn into others."""
    root = ET.fromstring(text.strip())
    for joint in root.findall("joint"):
        if (joint.get("name") or "").strip() in names:
            joint.set("type", "fixed")
            for tag in ("axis", "limit", "dynamics", "mimic", "safety_controller"):
                for element in joint.findall(tag):
                    joint.remove(element)
    return ET.tostring(root, encoding="unicode")


def _line(text: str, key: str) -> int:
    before = re.split(rf"^{re.escape(key)}\s*:", text, maxsplit=1, flags=re.M)[0]
    return before.count("\n") + 1
