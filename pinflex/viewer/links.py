"""Geometry of flexible links on a page: a section, or a surface, along a centreline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray, chosen
from pinflex.results.result import Result
from pinflex.viewer.surfaces import Surface, packed, simplify

STATIONS = 25  # of a link, besides those where a field peaks
TRIANGLES = 9_000  # of all surfaces with stress of a page together
MOST, FEWEST = 3_000, 300  # of one of them
SECTION_FORCES = ("N", "Vy", "Vz", "T", "My", "Mz")
_NOTHING = 1e-3  # of the largest force (or moment) of a link: its diagram would tell nothing
FIELDS = {  # key: label, unit, shown = SI * factor
    "von_mises": ("von Mises stress", "MPa", 1e-6),
    "bending": ("bending stress", "MPa", 1e-6),
    "axial": ("axial stress", "MPa", 1e-6),
    "shear": ("shear stress", "MPa", 1e-6),
    "displacement": ("displacement", "mm", 1e3),
}


def stations(result: Result, name: str) -> IntArray:
    """Stations of a link worth keeping: spread evenly, and those where a field peaks."""
    get = _arrays(result, name)
    count = len(get["x"])
    even = np.linspace(0, count - 1, min(STATIONS, count)).round().astype(np.intp)
    if count <= STATIONS:
        return even
    fields = [get[f"stress/{k}"] for k in FIELDS if f"stress/{k}" in get]
    peaks = [np.abs(f).max(axis=0).argmax() for f in fields]
    return np.union1d(even, np.array(peaks, dtype=np.intp))


def link_geometry(
    result: Result, name: str, skin: Surface | None, station: IntArray
) -> dict[str, Any]:
    """One flexible link at every instant, at the stations worth keeping."""
    get = _arrays(result, name)
    about = result.meta.get("links", {}).get(name, {})
    centre, x, at = get["centreline"], get["x"], chosen(station, len(get["x"]))
    rigid = get.get("centreline_rigid", centre)
    fields = {k: get[f"stress/{k}"] for k in FIELDS if f"stress/{k}" in get}
    section_y = get["section_y"] if "section_y" in get else _any_normal(rigid)
    y_rigid = _rigid_normal(rigid, section_y)
    mesh = _on_beam(skin, about)
    surface: dict[str, Array] = {}
    if "mesh/nodes" in get:
        solids = sum(k.endswith("/mesh/nodes") for k in result.arrays)
        mesh, surface = _solid(get, int(np.clip(TRIANGLES / solids, FEWEST, MOST)))
    return {
        "name": name,
        "x": x[station],
        "length": float(about.get("length", x[-1])),
        "outline": about.get("section", {}).get("outline") or _circle(0.01 * float(x[-1])),
        "mesh": mesh,
        "rigid": rigid[:, at],
        "disp": centre[:, at] - rigid[:, at],
        "y_rigid": y_rigid,
        "y_disp": section_y[:, at] - y_rigid[:, None],
        "fields": {k: f[:, at] for k, f in fields.items()},
        "surface": surface,
        "sections": _sections(get["resultant"][:, at]) if "resultant" in get else {},
    }


def undeformed(link: dict[str, Any]) -> dict[str, Any]:
    """The link in the rigid mechanism, which has neither displacements nor stresses."""
    still = {k: np.zeros_like(link[k]) for k in ("disp", "y_disp")}
    return {**link, **still, "fields": {}, "surface": {}, "sections": {}}


def _sections(resultant: Array) -> dict[str, Array]:
    """Section forces by name, (nt, n) each, but for those that are nothing beside the others."""
    each = np.abs(resultant).max(axis=0).max(axis=0)
    most = each.reshape(2, 3).max(axis=1).repeat(3)
    return {
        name: resultant[:, :, i]
        for i, name in enumerate(SECTION_FORCES) if each[i] > _NOTHING * most[i]
    }  # fmt: skip


def thinned(link: dict[str, Any], keep: IntArray | slice) -> dict[str, Any]:
    """The link at the instants kept, shape (n,)."""
    out = {**link, **{k: link[k][keep] for k in ("rigid", "disp", "y_rigid", "y_disp")}}
    for kind in ("fields", "surface", "sections"):
        out[kind] = {k: f[keep] for k, f in link[kind].items()}
    ends = out["rigid"][:, [0, -1]]
    line = _straight(link["x"], ends)
    if np.abs(line - out["rigid"]).max() < 1e-6 * link["length"]:  # straight: two ends say it all
        out["rigid"] = ends
    return out


def centreline(link: dict[str, Any], k: int, mag: float) -> Array:
    """Points of a centreline at instant k, displacements magnified; shape (n, 3)."""
    rigid = link["rigid"][k]
    if len(rigid) == 2:  # a straight one is kept by its ends
        rigid = _straight(link["x"], rigid)
    return np.asarray(rigid + mag * link["disp"][k])


def _straight(x: Array, ends: Array) -> Array:
    """Points at x between two ends, shape (..., 2, 3)."""
    share = (x - x[0]) / (x[-1] - x[0])
    return np.asarray(np.stack([1 - share, share], axis=1) @ ends)


def time_arrays(link: dict[str, Any]) -> list[Array]:
    """Arrays of a link that have a row for every instant, but for section forces: kept coarsely."""
    own = [link[k] for k in ("rigid", "disp", "y_rigid", "y_disp")]
    return [*own, *link["fields"].values(), *link["surface"].values()]


def largest(link: dict[str, Any], field: str) -> Array | None:
    """Largest magnitude of a field in a link over time, shape (nt,); None without that field."""
    values = link["surface"].get(field, link["fields"].get(field))
    return None if values is None else np.abs(values).max(axis=1)


def _arrays(result: Result, name: str) -> dict[str, Array]:
    start = f"link/{name}/"
    return {k[len(start) :]: v for k, v in result.arrays.items() if k.startswith(start)}


def _solid(get: dict[str, Array], most: int) -> tuple[dict[str, Any] | None, dict[str, Array]]:
    """Surface of a solid's mesh in its beam frame, and fields at its points, (nt, n).

    A mode shape has no size, and so no stress.
    """
    nodes = get["mesh/nodes"]
    stress = get.get("mesh/von_mises", np.empty((0, len(nodes))))
    points, faces = simplify(nodes, get["mesh/triangles"].astype(np.intp), most)
    if len(points) < len(nodes):  # a point shows the worst of the nodes that it stands for
        from scipy.spatial import cKDTree

        own = cKDTree(nodes).query(points)[1]
        stands = cKDTree(points).query(nodes)[1]
        for node in np.argsort(stress.max(axis=0, initial=0.0)):  # the worst is written last
            own[stands[node]] = node
        stress = stress[:, own]
    mesh, first = packed(Surface(points, faces, True))
    return mesh, {"von_mises": stress[:, first]} if mesh and len(stress) else {}


def _on_beam(skin: Surface | None, about: dict[str, Any]) -> dict[str, Any] | None:
    """The mesh of a flexible link in its beam frame, to be bent with it."""
    if skin is None or not skin.from_file or "frame" not in about or "origin" not in about:
        return None
    turn = np.asarray(about["frame"], dtype=float).T  # from the link's frame to the beam's
    return packed(skin.moved(turn, -turn @ np.asarray(about["origin"], dtype=float)))[0]


def _rigid_normal(rigid: Array, section_y: Array) -> Array:
    """World direction of the section's y axis in the rigid pose, shape (nt, 3).

    The root section's own, made square to the rigid span: a turn about an axis across the span
    moves y along the span only, to first order.
    """
    along, y = unit(rigid[:, -1] - rigid[:, 0]), section_y[:, 0]
    return unit(y - along * np.sum(along * y, axis=1)[:, None])


def unit(vector: Array) -> Array:
    """Vectors of length one, shape (..., 3)."""
    return np.asarray(vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-30))


def _any_normal(rigid: Array) -> Array:
    """A direction across the link, for a result without section directions."""
    along = unit(rigid[:, -1] - rigid[:, 0])
    pick = np.eye(3)[np.abs(along).mean(axis=0).argmin()]
    return np.broadcast_to(unit(np.cross(along, pick))[:, None], rigid.shape)


def _circle(radius: float) -> list[list[float]]:
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return [[float(radius * np.cos(a)), float(radius * np.sin(a))] for a in turn]


# Triangles carried by the centreline of a flexible link, as page/meshes.js has them.

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
        centre, t, y, z = _frames_along(link, k, mag)
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


def _frames_along(link: dict[str, Any], k: int, mag: float) -> tuple[Array, Array, Array, Array]:
    """Centre and axes of the sections of a link at instant k, each (s, 3)."""
    centre = centreline(link, k, mag)
    along = unit(np.gradient(centre, axis=0))
    y = link["y_rigid"][k] + mag * link["y_disp"][k]
    y = unit(y - along * np.sum(along * y, axis=1, keepdims=True))
    return centre, along, y, np.cross(along, y)
