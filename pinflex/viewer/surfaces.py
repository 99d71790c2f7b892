"""Visuals of a URDF's links: meshes and simple shapes, made light enough for a page.

Files are looked for in the package example-robot-data and in the folders given, nowhere else, so
that a saved run names no file of the machine that reads it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError
from pinflex.results.drawing import Visual, drawing_of
from pinflex.results.result import Result
from pinflex.rotations import zyx_matrix
from pinflex.viewer.collada import read_collada

# Fewer triangles for a mesh: vertices that share a cell of a grid become one.
#
# The one vertex of a cell is where it has the least squared distance from the planes of all its
# triangles (Lindstrom, "Out-of-core simplification of large polygonal models", SIGGRAPH 2000), so
# that edges and flat faces keep their place.

_TRIES = 6
_FLAT = 0.02  # directions in which the planes of a cell are this much weaker say nothing


def simplify(vertices: Array, faces: IntArray, most: int) -> tuple[Array, IntArray]:
    """Vertices and faces with at most `most` triangles; a mesh that is small enough is whole."""
    if len(faces) <= most:
        return vertices, faces
    low, span = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    area = 0.5 * float(np.linalg.norm(_normals(vertices, faces), axis=1).sum())
    cell = np.sqrt(2 * area / most)  # of a flat sheet: two triangles a cell
    group, new = _clustered(vertices, faces, low, cell)
    for _ in range(_TRIES):
        if 0.8 * most < len(new) <= most:
            break
        cell = min(cell * np.sqrt(max(len(new), 1) / (0.9 * most)), span)
        group, new = _clustered(vertices, faces, low, cell)
    while len(new) > most:
        cell *= 1.2
        group, new = _clustered(vertices, faces, low, cell)
    used, place = np.unique(new, return_inverse=True)
    return _nearest(vertices, faces, group, cell)[used], place.reshape(-1, 3)


def _clustered(
    vertices: Array, faces: IntArray, low: Array, cell: float
) -> tuple[IntArray, IntArray]:
    """The cell of each vertex, shape (n,), and the triangles that are left between cells."""
    spot = ((vertices - low) / cell).astype(np.int64)
    size = spot.max(axis=0) + 1
    key = (spot[:, 0] * size[1] + spot[:, 1]) * size[2] + spot[:, 2]
    _, group = np.unique(key, return_inverse=True)
    new = group[faces]
    new = new[(new[:, 0] != new[:, 1]) & (new[:, 1] != new[:, 2]) & (new[:, 2] != new[:, 0])]
    # the same three in the same sense, whichever comes first
    first = np.argmin(new, axis=1)[:, None]
    new = np.take_along_axis(new, (first + np.arange(3)) % 3, axis=1)
    n = int(group.max()) + 1
    code = np.unique((new[:, 0] * n + new[:, 1]) * n + new[:, 2])
    new = np.stack([code // (n * n), code // n % n, code % n], axis=1)
    return np.asarray(group), np.asarray(new)


def _nearest(vertices: Array, faces: IntArray, group: IntArray, cell: float) -> Array:
    """Point closest to each cell's planes, about the mean of its vertices."""
    count = int(group.max()) + 1
    total = np.stack([np.bincount(group, vertices[:, a], count) for a in range(3)], axis=1)
    mean = total / np.bincount(group, minlength=count)[:, None]
    normal = _normals(vertices, faces)
    area = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(area, 1e-300)[:, None]
    A, b = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for corner in range(3):
        cells = group[faces[:, corner]]
        away = np.sum(unit * (vertices[faces[:, 0]] - mean[cells]), axis=1)
        for i in range(3):
            b[:, i] += np.bincount(cells, area * away * unit[:, i], count)
            for j in range(i + 1):
                A[:, i, j] += np.bincount(cells, area * unit[:, i] * unit[:, j], count)
    weight, axes = np.linalg.eigh(A)  # of its lower triangle
    keep = weight > _FLAT * np.maximum(weight[:, -1:], 1e-300)
    inverse = np.where(keep, 1 / np.where(keep, weight, 1.0), 0.0)
    step = np.einsum("nij,nj,nkj,nk->ni", axes, inverse, axes, b)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(mean + step * np.minimum(1.0, cell / np.maximum(length, 1e-300)))


def _normals(vertices: Array, faces: IntArray) -> Array:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a))


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


def surfaces(
    result: Result, folders: Sequence[str | Path] = ()
) -> tuple[dict[str, Surface], list[str]]:
    """Surfaces by link, and what there is to say about those that are missing or thinned."""
    return surfaces_of(drawing_of(result.meta).visuals, folders)


def surfaces_of(
    visuals: Mapping[str, Sequence[Visual]], folders: Sequence[str | Path] = ()
) -> tuple[dict[str, Surface], list[str]]:
    """The same of the visuals of a drawing, by link."""
    every = [(link, part) for link, parts in visuals.items() for part in parts]
    count = sum(bool(part.file) for _, part in every)
    most = int(np.clip(TRIANGLES / max(count, 1), 200, MOST))
    roots = [*_robot_data(), *map(_folder, folders)]
    found: dict[str, list[Surface]] = {}
    missing: list[str] = []
    thinned = 0
    for link, part in every:
        piece, less = _mesh(part, roots, most) if part.file else (_shape(part), False)
        thinned += less
        if piece is None:
            missing.append(part.file)
            continue
        turn, shift = zyx_matrix(np.array(part.rpy[::-1])), np.array(part.xyz)
        found.setdefault(link, []).append(piece.moved(turn, shift))
    notes = [f"{thinned} of {count} meshes are drawn with fewer triangles"] if thinned else []
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        notes.append(f"mesh not found: {missing[0]}{more}; simple shapes are drawn instead")
    return {link: joined(pieces) for link, pieces in found.items()}, notes


def packed(surface: Surface) -> tuple[dict[str, Any] | None, IntArray]:
    """A surface as a page holds it, and the vertex that each of its points was.

    16 bits a number, equal vertices merged; None if it is too large.
    """
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    centre, half = (low + high) / 2, float((high - low).max()) / 2 or 1.0
    steps = np.round(32767 * (surface.vertices - centre) / half).astype(np.int16)
    codes = steps.astype(np.int64) @ np.array([2**32, 2**16, 1])  # in the order of x, y, z
    _, first, place = np.unique(codes, return_index=True, return_inverse=True)
    points, faces = steps[first], place[surface.faces]
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


def _mesh(visual: Visual, roots: Sequence[Path], most: int) -> tuple[Surface | None, bool]:
    """The surface of a mesh file, None if it is not there, and whether it lost triangles."""
    path = _resolve(visual.file, roots)
    read = None if path is None else _read(path, path.stat().st_mtime_ns, most)
    if read is None:
        return None, False
    vertices, faces, whole = read
    if np.prod(visual.scale) < 0:  # a mirrored mesh is inside out
        faces = faces[:, ::-1]
    return Surface(vertices * np.array(visual.scale), faces, True), whole > len(faces)


@lru_cache(maxsize=128)
def _shape(visual: Visual) -> Surface:
    if visual.shape == "box":
        return _box(np.array(visual.size))
    return _turned(_meridian(visual.shape, *visual.size))


def _box(size: Array) -> Surface:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2
    squares = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in squares for t in ((a, b, c), (a, c, d))]
    return Surface(corners, np.array(faces, dtype=np.intp), False)


def _meridian(kind: str, radius: float, length: float = 0.0) -> list[tuple[float, float]]:
    """(distance from the z axis, height) from the lower pole to the upper one."""
    if kind == "cylinder":
        return [(0, -length / 2), (radius, -length / 2), (radius, length / 2), (0, length / 2)]
    turn = np.linspace(-np.pi / 2, np.pi / 2, 13)
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in turn]


def _turned(meridian: list[tuple[float, float]], sides: int = 28) -> Surface:
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    r, z = (x[:, None] for x in np.array(meridian).T)
    points = np.stack([r * np.cos(turn), r * np.sin(turn), z + 0.0 * turn], -1).reshape(-1, 3)
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
