"""Triangles carried by the centreline of a flexible link, as page/meshes.js has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.viewer.links import centreline, unit
from pinflex.viewer.simplify import simplify

_SIDES = 20  # of an outline, at most


@dataclass(frozen=True)
class Skin:
    """A closed surface in beam coordinates, and what colours it.

    Attributes:
        points: Of the undeformed link [m], shape (n, 3), x along the beam.
        faces: Three points each, shape (m, 3).
        x: Stations [m], shape (s,).
        values: A field at the stations, or at points of the mesh, shape (nt, v).
        shown: Which of the values a point shows, shape (n,).
    """

    points: Array
    faces: IntArray
    x: Array
    values: Array
    shown: IntArray

    def at(self, link: dict[str, Any], k: int, mag: float) -> Array:
        """The points in the world at instant k, displacements magnified; shape (n, 3)."""
        centre, t, y, z = _sections(link, k, mag)
        x = np.clip(self.points[:, 0], self.x[0], self.x[-1])
        i = np.clip(np.searchsorted(self.x, x, side="right") - 1, 0, len(self.x) - 2)
        w = ((x - self.x[i]) / (self.x[i + 1] - self.x[i]))[:, None]
        here, along, left, up = (a[i] * (1 - w) + a[i + 1] * w for a in (centre, t, y, z))
        beyond = (self.points[:, 0] - x)[:, None]  # past the ends it goes on straight
        return np.asarray(
            here + beyond * along + self.points[:, 1:2] * left + self.points[:, 2:] * up
        )


def skin(link: dict[str, Any], field: str, least: float, most: int) -> Skin:
    """Surface that is drawn of a flexible link."""
    x, values = link["x"], link["fields"].get(field)
    if values is None:
        values = np.linalg.norm(link["disp"], axis=2)
    if not link["mesh"]:
        points, faces = _tube(link, least)
        return Skin(points, faces, x, values, np.repeat(np.arange(len(x)), len(points) // len(x)))
    whole, faces = triangles(link["mesh"])
    points, faces = simplify(whole, faces, most)
    if field in link["surface"]:
        from scipy.spatial import cKDTree

        return Skin(points, faces, x, link["surface"][field], cKDTree(whole).query(points)[1])
    nearest = np.abs(points[:, :1] - x).argmin(axis=1)
    return Skin(points, faces, x, values, nearest)


def triangles(mesh: dict[str, Any]) -> tuple[Array, IntArray]:
    """Vertices [m] and faces of a packed surface."""
    points = mesh["points"] / 32767 * mesh["half"] + np.array(mesh["centre"])
    return points, mesh["faces"].astype(np.intp)


def _tube(link: dict[str, Any], least: float) -> tuple[Array, IntArray]:
    """The outline of the section at every station."""
    outline = np.array(link["outline"])
    if len(outline) > _SIDES:
        outline = outline[np.linspace(0, len(outline), _SIDES, endpoint=False).astype(int)]
    outline = outline * np.maximum(1.0, least / np.maximum(np.ptp(outline, axis=0), 1e-9))
    m, n = len(link["x"]), len(outline)
    points = np.column_stack([np.repeat(link["x"], n), np.tile(outline, (m, 1))])
    i, j = np.meshgrid(np.arange(m - 1), np.arange(n), indexing="ij")
    a, b = (i * n + j).ravel(), (i * n + (j + 1) % n).ravel()
    return points, np.concatenate([np.stack([a, b, b + n], 1), np.stack([a, b + n, a + n], 1)])


def _sections(link: dict[str, Any], k: int, mag: float) -> tuple[Array, Array, Array, Array]:
    """Centre and axes of the sections of a link at instant k, each (s, 3)."""
    centre = centreline(link, k, mag)
    along = unit(np.gradient(centre, axis=0))
    y = link["y_rigid"][k] + mag * link["y_disp"][k]
    y = unit(y - along * np.sum(along * y, axis=1, keepdims=True))
    return centre, along, y, np.cross(along, y)
