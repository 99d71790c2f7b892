"""Joints that close a loop and resist (bushings, bearings that yield), and joints with clearance.

A loop with `stiffness`, `damping` or `friction` becomes joints of the tree with springs, on links
without mass behind its first frame, and a weld to the second: every level then has them as it has
any elastic joint.

A bushing of stiffness K (6, 6), forces by displacements of b in the axes of a, takes a joint for
each column of A = L^-T, K = L diag(d) L' (Cholesky without roots), since A' K A = diag(d): three
that slide and three that turn, about axes aside of the frame where K couples turns with
displacements, and with a slide that follows where such an axis has a pitch. It is linear in turns
that are small.

A bearing that yields (`stiffness: {across: ..., tilt: ...}`) keeps its kind of loop: what the kind
holds and a stiffness is written for becomes joints behind its second frame, which carries the
bearing, so that a slider deflects alike wherever it is in its guide.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from pinflex.arrays import Array
from pinflex.description import sources
from pinflex.description.blocks import joints as drives
from pinflex.description.blocks.external import WORLD, ends
from pinflex.description.files import Source
from pinflex.description.loops import (
    ALONG,
    BUSHING,
    LOOP_KINDS,
    PIN,
    RESIST,
    TURNED,
    LoopKind,
    resists,
)
from pinflex.description.reading import schema
from pinflex.description.robots.tree_text import hang, triple
from pinflex.errors import DescriptionError
from pinflex.rotations import axis_frame, zyx_matrix

_ONE = ("revolute", "prismatic")  # kinds of one freedom, and types of a URDF
_NAMES = ("x", "y", "z", "rx", "ry", "rz")
_BEARING = {"across": (0, 1), "along": (2,), "tilt": (3, 4), "turn": (5,)}  # numbers of _NAMES
_MADE = "_yields"  # ends of links made here
_SYMMETRIC, _NEGATIVE, _PITCH = 1e-9, 1e-12, 1e-12  # of the largest entry


def yielding(block: schema.Block, tree: Source) -> tuple[dict[str, Any], Source]:
    """The YAML and the robot with joints in place of loops that resist."""
    loops = dict(block.get("loops", {}))
    joints = schema.mapping(block.get("joints", {}), block.at("joints"))
    root = ET.fromstring(tree.text.strip())
    built = False
    for name, spec in list(loops.items()):
        if not isinstance(spec, dict) or not resists(spec):
            continue
        loop = schema.Block(spec, schema.at(block.at("loops"), name))
        text = "a joint with clearance is held by contact. Remove this, or the clearance."
        loop.only({*RESIST} - {"friction"} if loop.get("clearance") is not None else (), text)
        pair, ground = _ends(loop, tree)
        made: list[tuple[str, list[_Joint], str]] = []
        if isinstance(spec.get("stiffness"), Mapping) and spec.get("kind") != BUSHING:
            side = 0 if pair[1] == ground else 1
            made.append((pair[side], _bearing(name, loop), f"{name}{_MADE}_bearing"))
            pair[side] = made[0][2]
            kept = {k: v for k, v in spec.items() if k != "stiffness"}
            if isinstance(spec.get("damping"), Mapping):
                del kept["damping"]
            spec = {**kept, "between": pair}
        if resists(spec):
            loop = schema.Block(spec, loop.where)
            if pair[0] == ground:
                pair.reverse()
            chain, weld = _chain(name, loop)
            made.append((pair[0], chain, f"{name}{_MADE}_end"))
            rest = {k: v for k, v in spec.items() if k not in (*RESIST, "kind", "between", "axis")}
            spec = {"kind": weld, "between": [made[-1][2], pair[1]], **rest}
        loops[name] = spec
        for link, chain, end in made:
            for joint in chain:
                _require_new(joint, joints, tree, loop)
            if end not in tree.links:
                _behind(root, link, chain, end)
                built = True
            joints |= {joint.name: joint.extra for joint in chain if joint.extra}
    whole = {**block, "loops": loops, "joints": joints}
    return whole, sources.rewritten(root, tree) if built else tree


class _Joint(NamedTuple):
    """A joint of the chain: name, URDF type, axis, a point on it, and its block of `joints`."""

    name: str
    kind: str
    axis: Array
    at: Array
    extra: dict[str, Any]


def _ends(block: schema.Block, tree: Source) -> tuple[list[str], str | None]:
    """The frames, and what the ground is called; None: it is no end."""
    pair = schema.items(block.get("between"), block.at("between"), 2)
    grounded = "at" in block or (WORLD not in tree.links and WORLD in pair)
    found = [*ends(pair, block.at("between"), tree, grounded)]
    return found, WORLD if grounded else None


def _require_new(
    joint: _Joint, joints: Mapping[str, Any], tree: Source, block: schema.Block
) -> None:
    own = f"{joint.name}{_MADE}" in tree.links
    if joint.name in joints or (joint.name in tree.joints and not own):
        raise block.error(
            "", f"its joint is called {joint.name}, and there is one of that name. Rename the loop."
        )


def _bearing(name: str, block: schema.Block) -> list[_Joint]:
    """Joints in the directions that a bearing gives way in: z along its axis."""
    kind = schema.choice(block.get("kind"), block.at("kind"), LOOP_KINDS)
    held = _held(LOOP_KINDS[kind])
    if not held:
        raise block.error("stiffness", f"a bearing of the kind {kind} has none. Remove it.")
    k = _by_direction(block, "stiffness", held)
    if not k:
        raise block.error("stiffness", f"in which direction? Allowed: {', '.join(held)}.")
    d = _by_direction(block, "damping", k) if isinstance(block.get("damping"), Mapping) else {}
    axis = np.array(schema.direction(block.get("axis", "z"), block.at("axis")))
    x = np.eye(3)[np.argmin(np.abs(axis))]
    x = x - (axis @ x) * axis
    x /= np.linalg.norm(x)
    chain = []
    for word, directions in _BEARING.items():
        for i in directions if word in k else ():
            extra = {"spring": k[word], **({"damper": d[word]} if d.get(word) else {})}
            way = (x, np.cross(axis, x), axis)[i % 3]
            joint = "prismatic" if i < 3 else "revolute"
            chain.append(_Joint(f"{name}.{_NAMES[i]}", joint, way, np.zeros(3), extra))
    return chain


def _held(kind: LoopKind) -> list[str]:
    """Directions that a bearing of a kind of loop holds."""
    along, turned = {*kind.points}, kind.directions
    holds = {"across": {0, 1} <= along, "along": 2 in along, "tilt": turned in (ALONG, TURNED)}
    return [word for word in _BEARING if holds.get(word, turned == TURNED)]


def _by_direction(block: schema.Block, key: str, words: Collection[str]) -> dict[str, float]:
    found = schema.mapping(block[key], block.at(key), words)
    # A direction that is left out is held: a stiffness of 0 would say neither.
    low, above = (-np.inf, 0.0) if key == "stiffness" else (0.0, -np.inf)
    return {
        word: schema.number(x, schema.at(block.at(key), word), low, above=above, of=key)
        for word, x in found.items()
    }


def _chain(name: str, block: schema.Block) -> tuple[list[_Joint], str]:
    """The joints of one loop, and the kind of loop that closes behind them."""
    kind = block.get("kind")
    if kind == BUSHING:
        return _bushing(name, block)
    if kind not in _ONE:
        key = next(key for key in RESIST if key in block)
        raise block.error(
            key,
            f"has no meaning for the kind {kind}, only for revolute and prismatic (about or along "
            "their axis) and for bushing. Remove it, change the kind, or write by direction what a "
            "bearing yields by: `stiffness: {across: ...}`.",
        )
    words = {"stiffness": "spring", "damping": "damper", "friction": "friction", "rest": "rest"}
    extra = {word: block[key] for key, word in words.items() if key in block}
    for key in block.keys() & {"stiffness", "damping"}:
        schema.number(block[key], block.at(key), low=0, of=key)
    if "friction" in extra:
        drives.read_friction(extra["friction"], block.at("friction"))
    if "rest" in extra and "spring" not in extra:
        raise block.error("rest", "there is no spring. Add `stiffness`.")
    axis = np.array(schema.direction(block.get("axis", "z"), block.at("axis")))
    return [_Joint(name, str(kind), axis, np.zeros(3), extra)], "weld"


def _bushing(name: str, block: schema.Block) -> tuple[list[_Joint], str]:
    block.only(("friction", "rest", "axis"), "has no meaning for the kind bushing. Remove it.")
    if "stiffness" not in block:
        raise block.error(
            "",
            "a bushing without stiffness. Give `stiffness`: 3 numbers [N/m], 6 ([N/m], then "
            "[N m/rad]) or a 6x6 matrix.",
        )
    K, size = _matrix(block["stiffness"], block.at("stiffness"), "stiffness")
    D = np.zeros((6, 6))
    if "damping" in block:
        D, _ = _matrix(block["damping"], block.at("damping"), "damping")
    A, k = _columns(K, block.at("stiffness"))
    d = A.T @ D @ A
    if np.any(np.abs(d - np.diag(np.diag(d))) > _SYMMETRIC * np.max(np.abs(d), initial=0.0)):
        raise block.error(
            "damping",
            "couples what the stiffness does not. Give 3 or 6 numbers beside 3 or 6, or a 6x6 "
            "matrix in proportion to the stiffness.",
        )
    chain: list[_Joint] = []
    for i in range(size):
        one = f"{name}.{_NAMES[i]}"
        numbers = {"spring": float(k[i]), "damper": float(d[i, i])}
        chain += _screw(one, A[:, i], {key: x for key, x in numbers.items() if x > 0.0})
    return chain, "weld" if size == 6 else "spherical"


def _screw(name: str, a: Array, extra: dict[str, Any]) -> list[_Joint]:
    """One displacement (3) and turn (3) as a joint, with a slide that follows for its pitch."""
    move, turn = a[:3], a[3:]
    size = float(np.linalg.norm(turn))
    if size == 0.0:
        length = float(np.linalg.norm(move))
        scaled = {key: value / length**2 for key, value in extra.items()}
        return [_Joint(name, "prismatic", move / length, np.zeros(3), scaled)]
    axis = turn / size
    scaled = {key: value / size**2 for key, value in extra.items()}
    pitch = float(axis @ move) / size
    joints = [_Joint(name, "revolute", axis, np.cross(axis, move) / size, scaled)]
    if abs(pitch) > _PITCH * max(float(np.linalg.norm(move)), 1e-300):
        follows = {"follows": name, "ratio": pitch}
        joints.append(_Joint(f"{name}.pitch", "prismatic", axis, np.zeros(3), follows))
    return joints


def _columns(K: Array, where: str) -> tuple[Array, Array]:
    """A and d of A' K A = diag(d), A upper triangular."""
    L, d, rest = np.eye(6), np.zeros(6), K.copy()
    size = np.sqrt(np.maximum(np.diag(K), 0.0))
    for i in range(6):
        d[i] = rest[i, i]
        if d[i] <= _NEGATIVE * size[i] ** 2:
            d[i] = 0.0
            scale = np.maximum(size[i] * size, 1e-300)
            if K[i, i] < 0.0 or np.any(np.abs(rest[i]) > _SYMMETRIC * scale):
                raise DescriptionError(
                    f"{where}: pushes by itself: its stiffness is negative in some direction. Give "
                    "a matrix without negative eigenvalues."
                )
            continue
        L[i:, i] = rest[i:, i] / d[i]
        rest = rest - d[i] * np.outer(L[:, i], L[:, i])
    return np.asarray(np.linalg.inv(L).T, float), d


def _matrix(value: object, where: str, of: str) -> tuple[Array, int]:
    """A matrix (6, 6) of 3 or 6 numbers or of rows, and how many directions it holds."""
    rows = schema.items(value, where)
    if len(rows) == 6 and any(isinstance(row, list) for row in rows):
        K = np.array([
            schema.numbers(row, f"{where}[{i}]", 6) for i, row in enumerate(rows)
        ], float)  # fmt: skip
        size = np.sqrt(np.maximum(np.outer(np.diag(K), np.diag(K)), 0.0))
        if np.any(np.abs(K - K.T) > _SYMMETRIC * np.maximum(size, 1e-300)):
            raise DescriptionError(f"{where}: is not symmetric. Give K with K = K'.")
        return 0.5 * (K + K.T), 6
    if len(rows) not in (3, 6):
        raise DescriptionError(
            f"{where}: {len(rows)} numbers. Allowed: 3 [N/m], 6 ([N/m], then [N m/rad]) or 6 rows "
            "of 6."
        )
    values = [schema.number(x, f"{where}[{i}]", low=0, of=of) for i, x in enumerate(rows)]
    return np.diag([*values, *[0.0] * (6 - len(values))]), len(values)


def _behind(root: ET.Element, link: str, chain: list[_Joint], end: str) -> None:
    """Put the chain behind a link, and `end` behind it, with the place and axes of the link."""
    at = np.zeros(3)
    for joint in chain:
        made = hang(root, f"{joint.name}{_MADE}", joint.name, link, joint.at - at)
        made.set("type", joint.kind)
        ET.SubElement(made, "axis", xyz=triple(joint.axis))
        ET.SubElement(made, "limit", lower="-1e3", upper="1e3", effort="1e9", velocity="1e9")
        link, at = f"{joint.name}{_MADE}", joint.at
    hang(root, end, f"{end}_fixed", link, -at)


# Joints of the tree with clearance: cut, and closed again as loops.
#
# `joints: {knee: {clearance: 50 um, pin: 5 mm}}` is short for a planar joint `knee`, across the
# axis of the written one, and a loop `knee` of the kind planar between the frames `knee_hole`,
# which its parent carries, and `knee_pin`, which it moves.

_DROPPED = ("axis", "limit", "dynamics", "mimic", "safety_controller")


def cut(block: Mapping[str, Any], tree: Source, file: str) -> tuple[dict[str, Any], Source]:
    """The YAML's block and the robot with joints that have clearance as loops."""
    joints, loops, home = (
        schema.mapping(block.get(key, {}), f"{file}: {key}") for key in ("joints", "loops", "home")
    )
    root = None
    loose = [k for k, x in joints.items() if isinstance(x, Mapping) and "clearance" in x]
    for name in loose:
        joint = schema.Block(joints[name], f"{file}: joints.{name}")
        schema.known(name, joint.where, tree.joints, f"joint in {tree.file}")
        _refuse_other_keys(name, joint, block, tree)
        between = [f"{name}_hole", f"{name}_pin"]
        loops[name] = {"kind": "planar", "between": between, **joints.pop(name)}
        angle = home.get(name, 0.0)
        if not isinstance(angle, list):
            home[name] = [0.0, 0.0, angle]
        if f"{name}_hole" not in tree.links:  # else: read again
            root = ET.fromstring(tree.text) if root is None else root
            _cut(root, name)
    whole = {**block, "joints": joints, "loops": loops, "home": home}
    return whole, tree if root is None else sources.rewritten(root, tree)


def _refuse_other_keys(
    name: str, joint: schema.Block, block: Mapping[str, Any], tree: Source
) -> None:
    """Refuse a joint that is no hinge, moves by itself, or says more."""
    if tree.joints[name].type not in ("revolute", "continuous", "planar"):
        raise joint.error(
            "clearance",
            f"{name} is {tree.joints[name].type}. Joints of the tree have clearance as hinges; "
            "write others as loops.",
        )
    if name in (block.get("actuated") or ()):
        raise joint.error(
            "clearance",
            f"a motor turns {name}. Leave it out of `actuated`, or give the clearance to a joint "
            "beside it.",
        )
    for key in joint:
        if key not in PIN:
            raise joint.error(key, f"has no meaning beside clearance. Allowed: {', '.join(PIN)}.")
    if name in (block.get("loops") or {}):
        raise joint.error("clearance", f"a loop is called {name} too. Rename it.")


def _cut(root: ET.Element, name: str) -> None:
    """Let a planar joint, between two new links, take the place of a hinge."""
    joint = next(x for x in root.findall("joint") if (x.get("name") or "").strip() == name)
    origin, written = joint.find("origin"), joint.find("axis")
    axis = _read(written, "xyz", (1.0, 0.0, 0.0))
    turn = axis_frame(axis / np.linalg.norm(axis), None)
    place, rotation = _read(origin, "xyz"), zyx_matrix(_read(origin, "rpy")[::-1])
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


def _read(element: ET.Element | None, key: str, default: Any = (0.0, 0.0, 0.0)) -> Any:
    words = None if element is None else element.get(key)
    return np.array(default if words is None else [float(x) for x in words.split()], float)
