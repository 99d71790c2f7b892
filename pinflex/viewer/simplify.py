"""Fewer triangles for a mesh: vertices that share a cell of a grid become one.

The one vertex of a cell is where it has the least squared distance from the planes of all its
triangles (Lindstrom, "Out-of-core simplification of large polygonal models", SIGGRAPH 2000), so
that edges and flat faces keep their place.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array, IntArray

_TRIES = 6
_FLAT = 0.02  # directions in which the planes of a cell are this much weaker say nothing


def simplify(vertices: Array, faces: IntArray, most: int) -> tuple[Array, IntArray]:
    """The mesh with at most `most` triangles; one that is small enough comes back whole.

    Returns:
        Vertices and faces.
    """
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
