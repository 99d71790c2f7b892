"""Triangles of a COLLADA file (.dae), with every node of its scene in place.

Read here because the loader of coal 3.0 mixes up the vertices of a node that has several materials.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.rotations import axis_turn

_UP = {  # rows: where x, y, z of the file point
    "X_UP": [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    "Y_UP": [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
}
_DEEPEST = 64  # nodes within nodes; more is a node that holds itself
_Element = ElementTree.Element


def read_collada(path: Path) -> tuple[Array, IntArray]:
    """Vertices [m], shape (n, 3), and triangles, shape (m, 3), z up."""
    root = ElementTree.parse(path).getroot()
    for element in root.iter():  # names without the namespace
        element.tag = element.tag.rpartition("}")[2]
    byid = {"#" + e.get("id", ""): e for e in root.iter() if e.get("id")}
    unit, axis = root.find("asset/unit"), root.findtext("asset/up_axis", "Y_UP").strip()
    world = np.eye(4)
    world[:3, :3] = np.array(_UP.get(axis, np.eye(3)))
    world[:3, :3] *= float(unit.get("meter", "1")) if unit is not None else 1.0
    shown = root.find("scene/instance_visual_scene")
    scene = byid.get(shown.get("url", "")) if shown is not None else root.find(".//visual_scene")
    points, faces, count = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.intp)], 0
    for geometry, pose in _instances(scene, world, byid, 0):
        mesh = byid[geometry].find("mesh")
        if mesh is None:
            continue
        for place, triangles in _meshes(mesh, byid):
            points.append(place @ pose[:3, :3].T + pose[:3, 3])
            mirrored = np.linalg.det(pose[:3, :3]) < 0
            faces.append(count + (triangles[:, ::-1] if mirrored else triangles))
            count += len(place)
    return np.concatenate(points), np.concatenate(faces)


def _instances(
    node: _Element | None, pose: Array, byid: dict[str, _Element], depth: int
) -> Iterator[tuple[str, Array]]:
    if node is None or depth > _DEEPEST:
        return
    for child in node:
        if child.tag == "instance_geometry":
            yield child.get("url", ""), pose
        elif child.tag == "node":
            yield from _instances(child, pose, byid, depth + 1)
        elif child.tag == "instance_node":
            yield from _instances(byid.get(child.get("url", "")), pose, byid, depth + 1)
        elif len(child) == 0:
            pose = pose @ _transform(child)


def _transform(element: _Element) -> Array:
    """Transform (4, 4) of an element; the identity for unknown ones."""
    if element.tag not in ("matrix", "translate", "scale", "rotate"):
        return np.eye(4)
    numbers = np.array((element.text or "").split(), dtype=float)
    if element.tag == "matrix":
        return numbers.reshape(4, 4)
    step = np.eye(4)
    if element.tag == "translate":
        step[:3, 3] = numbers
    elif element.tag == "scale":
        step[:3, :3] = np.diag(numbers)
    else:
        step[:3, :3] = axis_turn(numbers[:3], np.deg2rad(numbers[3]))
    return step


def _meshes(mesh: _Element, byid: dict[str, _Element]) -> Iterator[tuple[Array, IntArray]]:
    for group in mesh:
        if group.tag not in ("triangles", "polylist", "polygons"):
            continue
        inputs = {e.get("semantic"): e for e in group.findall("input")}
        stride = 1 + max(int(e.get("offset", "0")) for e in group.findall("input"))
        place = int(inputs["VERTEX"].get("offset", "0"))
        vertices = byid[inputs["VERTEX"].get("source", "")]
        source = next(e for e in vertices.findall("input") if e.get("semantic") == "POSITION")
        array = byid[source.get("source", "")].find("float_array")
        points = np.array(_text(array).split(), dtype=float).reshape(-1, 3)
        rows = [np.array(_text(p).split(), dtype=np.intp) for p in group.findall("p")]
        index = [row.reshape(-1, stride)[:, place] for row in rows]
        if group.tag == "triangles":
            yield points, np.concatenate([i.reshape(-1, 3) for i in index])
            continue
        sizes = [len(i) for i in index]
        if group.tag == "polylist":
            sizes = [int(n) for n in _text(group.find("vcount")).split()]
        yield points, _fans(np.concatenate(index), sizes)


def _fans(corners: IntArray, sizes: list[int]) -> IntArray:
    """Polygons cut into triangles from their first corner."""
    out, at = [], 0
    for n in sizes:
        out += [(corners[at], corners[at + k], corners[at + k + 1]) for k in range(1, n - 1)]
        at += n
    return np.array(out, dtype=np.intp).reshape(-1, 3)


def _text(element: _Element | None) -> str:
    return "" if element is None or element.text is None else element.text
