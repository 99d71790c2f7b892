"""Beams along a polyline or an arc: a chain of straight flexible links in place of one.

The link LINK stays as a massless frame on its joint. LINK_1, LINK_2, ... are the pieces, fixed to
each other in the axes of LINK; LINK_end is the frame at the end. What hung on LINK hangs on the
nearest corner. An arc is a polygon with its corners on the circle: errors fall with the square of
the number of pieces.
"""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description import sources
from pinflex.description.blocks import flexible
from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.robots.tree_text import hang, triple
from pinflex.errors import DescriptionError

KEYS = ("polyline", "arc")
_NOT_BESIDE = ("start", "end", "length", "root", "patches")
_PIECES = 16  # of an arc: of a quarter of a circle they leave 0.2 % of its deflection
_MOST = 200
_SHORT = 1e-6  # of the whole length: two points that are one
_FLAT = 1e-9  # of the square of the distances: three points on one line
_ARC = dict.fromkeys(("through", "to"), schema.triple(schema.REQUIRED, "place"))
_ARC["pieces"] = schema.whole(_PIECES, 2, _MOST)


def straightened(
    block: dict[str, Any], where: str, tree: Source
) -> tuple[dict[str, Any], Source] | None:
    """The YAML and the robot with chains of straight links; None where no link is curved."""
    raw = block.get("flexible")
    if not isinstance(raw, dict) or not any(_curved(spec) for spec in raw.values()):
        return None
    root, found = ET.fromstring(tree.text.strip()), dict[str, Any]()
    for link, spec in flexible.expand(raw, where, tree).items():
        if not _curved(spec):
            found[link] = spec
            continue
        beam = schema.Block(spec, schema.at(where, link))
        corners = _corners(beam)
        beam.only(
            _NOT_BESIDE,
            "has no meaning for a beam along a curve, which has its own ends. Remove it.",
        )
        if beam.get("inertia", "beam") != "beam":
            text = "has the inertia of its pieces, in place of the URDF's. Write inertia: beam."
            raise beam.error("inertia", f"a beam along a curve {text}")
        names = [f"{link}_{k}" for k in range(1, len(corners))]
        found |= _pieces(beam, names, f"{link}_end")
        _rebuild(root, tree, link, [*names, f"{link}_end"], corners, beam.where)
    return {**block, "flexible": found}, sources.rewritten(root, tree)


def _curved(spec: object) -> bool:
    return isinstance(spec, dict) and any(spec.get(key) is not None for key in KEYS)


def _corners(beam: schema.Block) -> Array:
    """Corners of the polygon in the link's frame [m], shape (n + 1, 3)."""
    key, *more = (key for key in KEYS if key in beam)
    if more:
        raise beam.error("", "polyline and arc: one beam has one line. Remove one.")
    at = beam.at(key)
    if key == "arc":
        corners = _arc(beam["arc"], at)
    else:
        items = schema.items(beam["polyline"], at)
        points = [schema.vector(p, f"{at}[{k}]", of="place") for k, p in enumerate(items)]
        corners = np.array(points, float).reshape(-1, 3)
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    if not 1 <= len(sides) <= _MOST:
        raise DescriptionError(
            f"{at}: {len(corners)} points. Allowed: 2 to {_MOST + 1}, [x, y, z] in m each."
        )
    if np.min(sides) <= _SHORT * np.sum(sides):
        k = int(np.argmin(sides))
        raise DescriptionError(f"{at}: points {k} and {k + 1} are one. Remove one of them.")
    return corners


def _arc(spec: object, where: str) -> Array:
    """Corners on the circle from the link's origin through a point to another."""
    block = schema.Block(spec, where, _ARC).read()
    b, c, n = np.array(block["through"]), np.array(block["to"]), block.get("pieces", _PIECES)
    normal = np.cross(b, c)
    size = float(normal @ normal)
    if size <= _FLAT * float(b @ b) * float(c @ c) or np.allclose(b, c):
        raise DescriptionError(
            f"{where}: the origin, `through` and `to` lie on one line, through which there is no "
            "circle. Move `through`, or take a polyline."
        )
    center = np.cross(float(b @ b) * c - float(c @ c) * b, normal) / (2 * size)
    x = -center
    radius = float(np.linalg.norm(x))
    x, z = x / radius, normal / math.sqrt(size)
    y = np.cross(z, x)

    away = c - center  # about b x c the way from the origin to c leads through b
    whole = math.atan2(float(away @ y), float(away @ x)) % (2 * math.pi)
    turn = np.linspace(0.0, whole, n + 1)[:, None]
    return np.asarray(center + radius * (np.cos(turn) * x + np.sin(turn) * y))


def _pieces(spec: Mapping[str, Any], names: Sequence[str], end: str) -> dict[str, Any]:
    """The block of each piece; a mass at the tip is on the last one.

    A piece is shorter than the beam, so that `auto` would call it short: shear is as written.
    """
    written = {key: copy.deepcopy(v) for key, v in spec.items() if key not in (*KEYS, "tip")}
    common = {"shear": False, "rotary_inertia": False} | written
    found = {
        name: {**copy.deepcopy(common), "inertia": "beam", "end": after}
        for name, after in zip(names, [*names[1:], end], strict=True)
    }
    if "tip" in spec:
        found[names[-1]]["tip"] = spec["tip"]
    return found


def _rebuild(
    root: ET.Element, tree: Source, link: str, names: Sequence[str], corners: Array, where: str
) -> None:
    """Put the chain into the URDF, what hung on the link on its nearest corner."""
    for name in names:
        if name in tree.links or f"{name}_joint" in tree.joints:
            raise DescriptionError(
                f"{where}: its pieces are called {names[0]} to {names[-1]}, but {tree.file} has a "
                f"link {name} or a joint {name}_joint. Rename that."
            )
    own = next(e for e in root.findall("link") if _name(e, "name") == link)
    for element in list(own):
        own.remove(element)
    for joint in root.findall("joint"):
        parent = joint.find("parent")
        if parent is not None and _name(parent, "link") == link:
            _moved(joint, parent, names, corners)
    before, at = link, np.zeros(3)
    for name, corner in zip(names, corners, strict=True):
        hang(root, name, f"{name}_joint", before, corner - at)
        before, at = name, corner


def _moved(joint: ET.Element, parent: ET.Element, names: Sequence[str], corners: Array) -> None:
    """Let a joint of the curved link start at the nearest corner, at the same place."""
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    point = np.array([float(x) for x in origin.get("xyz", "0 0 0").split()])
    k = int(np.argmin(np.linalg.norm(corners - point, axis=1)))
    if k:  # at the first corner it stays on the link itself
        parent.set("link", names[k])
        origin.set("xyz", triple(point - corners[k]))


def _name(element: ET.Element, key: str) -> str:
    return (element.get(key) or "").strip()
