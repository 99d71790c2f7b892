"""Visuals of a URDF's links: meshes and simple shapes, made light enough for a page.

Files are looked for in the package example-robot-data and in the folders given, nowhere else, so
that a saved run names no file of the machine that reads it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError
from pinflex.results.result import Result
from pinflex.viewer.collada import read_collada
from pinflex.viewer.simplify import simplify

TRIANGLES = 36_000  # of all meshes of a page together: about 0.5 MB of it
MOST = 6_000  # of one mesh
LARGEST = 100_000_000  # bytes of a mesh file
KINDS = (".dae", ".stl", ".obj", ".ply")


@dataclass(frozen=True)
class Surface:
    """Triangles in the frame of a link.

    Attributes:
        vertices: Points [m], shape (n, 3).
        faces: Three vertices each, counter-clockwise seen from outside, shape (m, 3).
        from_file: It comes from a mesh file, not from a box, cylinder or sphere.
    """

    vertices: Array
    faces: IntArray
    from_file: bool

    def moved(self, rotation: Array, shift: Array) -> Surface:
        """The surface in another frame: rotation (3, 3) first, then shift [m]."""
        return Surface(self.vertices @ rotation.T + shift, self.faces, self.from_file)


@dataclass(frozen=True)
class _Visual:
    file: str  # "" for a simple shape
    shape: Surface | None
    scale: tuple[float, float, float]
    rotation: Array
    shift: Array


def surfaces(
    result: Result, folders: Sequence[str | Path] = ()
) -> tuple[dict[str, Surface], list[str]]:
    """Surfaces by link, and what there is to say about those that are missing or thinned.

    Args:
        result: A run; its URDF text names the meshes.
        folders: Where `package://` and relative names are looked for, after example-robot-data.
    """
    return surfaces_of(result.meta.get("sources", {}).values(), folders)


def surfaces_of(
    texts: Iterable[str], folders: Sequence[str | Path] = ()
) -> tuple[dict[str, Surface], list[str]]:
    """The same of texts, the first of which that is a URDF with visuals counts.

    Args:
        texts: Files of a robot. folders: As above.
    """
    visuals = _visuals(texts)
    count = sum(1 for parts in visuals.values() for part in parts if part.file)
    most = int(np.clip(TRIANGLES / max(count, 1), 200, MOST))
    roots = [*_robot_data(), *map(_folder, folders)]
    found: dict[str, Surface] = {}
    missing: list[str] = []
    thinned = 0
    for link, parts in visuals.items():
        pieces = []
        for part in parts:
            piece = part.shape
            if part.file:
                path = _resolve(part.file, roots)
                read = None if path is None else _read(path, path.stat().st_mtime_ns, most)
                if read is None:
                    missing.append(part.file)
                    continue
                vertices, faces, whole = read
                thinned += whole > len(faces)
                piece = Surface(vertices * np.array(part.scale), faces, True)
                if np.prod(part.scale) < 0:  # a mirrored mesh is inside out
                    piece = Surface(piece.vertices, faces[:, ::-1], True)
            if piece is not None:
                pieces.append(piece.moved(part.rotation, part.shift))
        if pieces:
            found[link] = joined(pieces)
    notes = [f"{thinned} of {count} meshes are drawn with fewer triangles"] if thinned else []
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        notes.append(f"mesh not found: {missing[0]}{more}; simple shapes are drawn instead")
    return found, notes


def packed(surface: Surface) -> tuple[dict[str, Any] | None, IntArray]:
    """A surface as a page holds it, and the vertex that each of its points was.

    16 bits a number, equal vertices merged; None if it is too large.
    """
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    centre, half = (low + high) / 2, float((high - low).max()) / 2 or 1.0
    steps = np.round(32767 * (surface.vertices - centre) / half).astype(np.int16)
    points, first, place = np.unique(steps, axis=0, return_index=True, return_inverse=True)
    faces = place.reshape(-1)[surface.faces]
    real = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if len(points) > 65535 or not real.any():
        return None, first
    mesh = {
        "points": points,
        "faces": faces[real].astype(np.uint16),
        "centre": centre.tolist(),
        "half": half,
    }
    return mesh, first


def joined(pieces: list[Surface]) -> Surface:
    """Several surfaces as one."""
    first = np.cumsum([0, *(len(p.vertices) for p in pieces)])
    return Surface(
        np.concatenate([p.vertices for p in pieces]),
        np.concatenate([p.faces + n for p, n in zip(pieces, first, strict=False)]),
        all(p.from_file for p in pieces),
    )


def _visuals(texts: Iterable[str]) -> dict[str, list[_Visual]]:
    for text in texts:
        if "<robot" not in text or "<visual" not in text:
            continue
        try:
            root = ElementTree.fromstring(text)
            return {
                link.get("name", ""): [v for v in map(_visual, link.findall("visual")) if v]
                for link in root.findall("link")
            }
        except (ElementTree.ParseError, ValueError):
            continue
    return {}


def _visual(node: ElementTree.Element) -> _Visual | None:
    geometry, origin = node.find("geometry"), node.find("origin")
    kind = geometry[0] if geometry is not None and len(geometry) else None
    if kind is None:
        return None
    rotation = _turn(*_numbers(origin, "rpy", "0 0 0"))
    shift = np.array(_numbers(origin, "xyz", "0 0 0"))
    file, shape, scale = "", None, (1.0, 1.0, 1.0)
    if kind.tag == "mesh":
        file, scale = kind.get("filename", ""), _numbers(kind, "scale", "1 1 1")
    elif kind.tag == "box":
        shape = _box(np.array(_numbers(kind, "size", "0 0 0")))
    elif kind.tag in ("cylinder", "sphere"):
        radius = float(kind.get("radius", "0"))
        length = float(kind.get("length", "0"))
        shape = _turned(_meridian(kind.tag, radius, length))
    return _Visual(file, shape, scale, rotation, shift) if file or shape else None


def _numbers(
    node: ElementTree.Element | None, key: str, default: str
) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in (default if node is None else node.get(key, default)).split())
    return x, y, z


def _turn(roll: float, pitch: float, yaw: float) -> Array:
    return np.asarray(Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix())


def _box(size: Array) -> Surface:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2
    squares = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in squares for t in ((a, b, c), (a, c, d))]
    return Surface(corners, np.array(faces, dtype=np.intp), False)


def _meridian(kind: str, radius: float, length: float) -> list[tuple[float, float]]:
    """(distance from the z axis, height) from the lower pole to the upper one."""
    if kind == "cylinder":
        return [(0, -length / 2), (radius, -length / 2), (radius, length / 2), (0, length / 2)]
    turn = np.linspace(-np.pi / 2, np.pi / 2, 13)
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in turn]


def _turned(meridian: list[tuple[float, float]], sides: int = 28) -> Surface:
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    points = np.array([[r * np.cos(a), r * np.sin(a), z] for r, z in meridian for a in turn])
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = []
    for k in range(len(meridian) - 1):
        low, high = k * sides, (k + 1) * sides
        if meridian[k][0] > 1e-12:
            faces.append(np.stack([low + i, low + j, high + j], axis=1))
        if meridian[k + 1][0] > 1e-12:
            faces.append(np.stack([low + i, high + j, high + i], axis=1))
    return Surface(points, np.concatenate(faces), False)


def _robot_data() -> list[Path]:
    """Folder that holds example-robot-data/robots, where the package is installed."""
    spec = find_spec("example_robot_data")
    for place in (spec.submodule_search_locations or []) if spec else []:
        for parent in Path(place).parents:
            if (parent / "share" / "example-robot-data").is_dir():
                return [parent / "share"]
    return []


def _folder(name: str | Path) -> Path:
    if not Path(name).is_dir():
        raise DescriptionError(f"view: meshes: {name}: no such folder. Name one that holds them.")
    return Path(name).resolve()


def _resolve(name: str, roots: Sequence[Path]) -> Path | None:
    """The file a mesh name means: below one of the roots, or nothing."""
    below = name.removeprefix("package://").removeprefix("file://")
    if not below.lower().endswith(KINDS):
        return None
    tails = [below]
    if name.startswith("package://") and "/" in below:  # a root may be the package itself
        tails.append(below.split("/", 1)[1])
    for root in roots:
        for tail in tails:
            path = Path(os.path.realpath(root / tail))
            if path.is_relative_to(root) and path.is_file() and path.stat().st_size < LARGEST:
                return path
    return None


@lru_cache(maxsize=128)
def _read(path: Path, changed: int, most: int) -> tuple[Array, IntArray, int] | None:
    """Vertices, faces and how many faces the file has; `changed` only keys the cache."""
    try:
        if path.suffix.lower() == ".dae":
            vertices, faces = read_collada(path)
        else:
            import coal  # type: ignore[import-untyped,unused-ignore]

            # boxes along the axes: the tree that coal builds beside the triangles is not used
            model = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(path), np.ones(3))
            vertices = np.array(model.vertices(), dtype=float)
            triples = (model.tri_indices(i) for i in range(model.num_tris))
            faces = np.array([(t[0], t[1], t[2]) for t in triples], dtype=np.intp).reshape(-1, 3)
    except Exception:  # whatever is wrong with the file: the link is drawn in another way
        return None
    if not len(faces) or not np.all(np.isfinite(vertices)):
        return None
    light = simplify(vertices, faces, most)
    return *light, len(faces)
