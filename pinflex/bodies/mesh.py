"""Solid meshes: read from a file, or built for a stepped round rod, with their named faces.

scikit-fem (the extra `pinflex[fe]`) holds the mesh; displacements are quadratic on every cell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.description.files import MOST_DATA, require_regular
from pinflex.errors import DescriptionError, nearest
from pinflex.text import brief

Region = str | tuple[float, ...]  # a named group of faces, or a box x0 y0 z0 x1 y1 z1 [m]

_AROUND = 8  # quadratic arcs round a circle: its bending stiffness is right to 1e-4
_CORE = 0.55  # corners of the square core of a section, as a share of the innermost radius
_NEAR_STEP = np.array([0.1, 0.35])  # a cell beside a step is cut here, for the stress at the step
_FLAT = 1e-6  # volume of a cell below this share of its bounding cube: it has none


@dataclass(frozen=True, eq=False)
class Mesh:
    """A solid mesh with quadratic displacements.

    Attributes:
        cells: The scikit-fem mesh [m].
        element: Its scalar, quadratic scikit-fem element.
        regions: Node numbers of each interface, in the order in which they were asked for.
    """

    __repr__ = brief

    cells: Any
    element: Any
    regions: Mapping[str, IntArray]


def scikit_fem(where: str) -> Any:
    """The module skfem, or an error that says how to get it."""
    try:
        import skfem
    except ImportError:
        raise DescriptionError(
            f"{where}: solid meshes need scikit-fem and meshio, which are not installed. "
            'Install them: pip install "pinflex[fe]".'
        ) from None
    return skfem


def read(path: Path, interfaces: Mapping[str, Region], scale: float, where: str) -> Mesh:
    """Read a mesh of tetrahedra or hexahedra, linear or quadratic, from any format of meshio."""
    skfem = scikit_fem(where)
    import meshio
    from skfem.io.meshio import from_meshio

    if not path.is_file():
        beside = [p.name for p in sorted(path.parent.glob("*.*"))] if path.parent.is_dir() else []
        raise DescriptionError(
            f"{where}.file: {path.name}: no such file.{nearest(path.name, beside)} "
            "Give it relative to the YAML."
        )
    require_regular(path, MOST_DATA, f"{where}.file: {path.name}")
    try:
        data = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio raises what its many readers raise
        raise DescriptionError(
            f"{where}.file: {path.name}: meshio cannot read it ({str(error).strip()[:120]}). "
            "Formats: msh, vtk, vtu, inp, bdf, med, ..."
        ) from None
    solids = ("hexahedron27", "hexahedron", "tetra10", "tetra")
    kind = next((k for k in solids if k in data.cells_dict), None)
    if kind is None:
        found = ", ".join(data.cells_dict) or "none"
        raise DescriptionError(
            f"{where}.file: {path.name}: no solid cells (found: {found}). "
            f"Allowed: {', '.join(solids)}."
        )
    try:
        cells = from_meshio(data, ignore_orientation=True)
    except Exception as error:  # scikit-fem raises what its converters raise
        raise DescriptionError(
            f"{where}.file: {path.name}: scikit-fem cannot use it ({error}). "
            "Write one kind of solid cells, and surfaces as groups."
        ) from None
    if not isinstance(cells, (skfem.MeshTet, skfem.MeshHex)):
        raise DescriptionError(f"{where}.file: {path.name}: its cells are not {', '.join(solids)}.")
    element = skfem.ElementHex2() if isinstance(cells, skfem.MeshHex) else skfem.ElementTetP2()
    cells = type(cells)(
        np.ascontiguousarray(scale * cells.doflocs), cells.t, _boundaries=cells.boundaries
    )
    return checked(cells, element, interfaces, where)


def checked(cells: Any, element: Any, interfaces: Mapping[str, Region], where: str) -> Mesh:
    """The mesh with its interfaces, if every cell has a volume and all hang together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    skfem = scikit_fem(where)
    t = cells.t
    used = np.unique(t)
    p = cells.p[:, : cells.nvertices] if cells.p.shape[1] >= cells.nvertices else cells.p
    low, high = p[:, t].min(axis=1), p[:, t].max(axis=1)
    basis = skfem.CellBasis(cells, element, intorder=2)
    volume = basis.dx.sum(axis=1)
    worst = int(np.argmin(volume / np.max(high - low, axis=0) ** 3))
    bad = volume < _FLAT * np.max(high - low, axis=0) ** 3
    if np.any(bad):
        centre = ", ".join(f"{x:.4g}" for x in p[:, t[:, worst]].mean(axis=1))
        raise DescriptionError(
            f"{where}: {int(bad.sum())} of {t.shape[1]} cells have no volume, the flattest "
            f"{volume[worst]:.3g} m^3 at ({centre}) m. Repair the mesh.",
            cells=int(bad.sum()),
        )
    pairs = np.concatenate([np.stack([t[0], row]) for row in t[1:]], axis=1)
    graph = coo_array((np.ones(pairs.shape[1]), pairs), shape=(p.shape[1], p.shape[1]))
    labels = connected_components(graph, directed=False)[1][used]
    parts = len(np.unique(labels))
    if parts > 1:
        raise DescriptionError(
            f"{where}: the mesh falls into {parts} parts that share no node. Merge coincident "
            "nodes, or keep one part.",
            parts=parts,
        )
    regions = {name: _region(basis, region, name, where) for name, region in interfaces.items()}
    return Mesh(cells, element, regions)


def _region(basis: Any, region: Region, name: str, where: str) -> IntArray:
    """Node numbers of an interface."""
    place = f"{where}.interfaces.{name}"
    if isinstance(region, str):
        groups = basis.mesh.boundaries or {}
        if region not in groups:
            raise DescriptionError(
                f"{place}: the mesh has no group of faces {region!r}.{nearest(region, groups)} "
                "Name one, or give a box [x0, y0, z0, x1, y1, z1] in m.",
                name=region,
            )
        nodes = basis.get_dofs(groups[region]).flatten()
    else:
        nodes = inside(basis.doflocs.T, region)
    return require_area(basis.doflocs.T, np.asarray(nodes, dtype=np.intp), place)


def inside(nodes: Array, box: Sequence[float]) -> IntArray:
    """Numbers of the nodes (nn, 3) in a box x0 y0 z0 x1 y1 z1, its faces included."""
    slack = 1e-9 * float(np.ptp(nodes, axis=0).max())
    low, high = np.array(box[:3]) - slack, np.array(box[3:]) + slack
    return np.flatnonzero(np.all((nodes >= low) & (nodes <= high), axis=1))


def require_area(nodes: Array, region: IntArray, where: str) -> IntArray:
    """An interface turns with its nodes: fewer than three, or all in a line, leave it loose."""
    arms = nodes[region] - nodes[region].mean(axis=0) if len(region) else np.zeros((1, 3))
    spread = np.linalg.svd(arms, compute_uv=False)
    if len(region) < 3 or spread[1] < 1e-6 * np.ptp(nodes, axis=0).max():
        raise DescriptionError(
            f"{where}: {len(region)} node(s) that span no area. A rigid interface needs three "
            "nodes that are not in one line. Choose a larger region.",
            nodes=len(region),
        )
    return region


def stepped_rod(segments: Sequence[tuple[float, float]], size: float | None, where: str) -> Mesh:
    """A round rod of (diameter, length) segments along x from the origin, as 27-node hexahedra.

    The faces at both ends are the interfaces "root" and "tip". Circles are quadratic arcs whose
    radii give the exact area, so the mass is exact; steps are sharp, so the stress there grows
    without bound as the cells shrink.
    """
    from scipy.spatial import cKDTree

    skfem = scikit_fem(where)
    diameters = sorted({d for d, _ in segments})
    size = diameters[0] if size is None else size
    flat, chord, quads, ring = _disc([0.5 * d for d in diameters])
    planes, filled = [0.0], []
    for k, (diameter, length) in enumerate(segments):
        count = max(2, math.ceil(length / size - 1e-9))
        share = np.arange(count + 1) / count
        near = _NEAR_STEP / count
        ends = near if k > 0 else near[:0], 1.0 - near if k < len(segments) - 1 else near[:0]
        share = np.unique(np.concatenate([share, *ends]))
        filled += [diameters.index(diameter)] * (len(share) - 1)
        planes += list(planes[-1] + length * share[1:])
    n = len(flat)
    # Corners of a cell in the order of scikit-fem's reference cube.
    corners = np.asarray(skfem.MeshHex().refdom.p, dtype=int).T
    around = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}
    t = np.concatenate(
        [
            np.array(
                [quads[ring <= most][:, around[j, k]] + n * (layer + i) for i, j, k in corners]
            )
            for layer, most in enumerate(filled)
        ],
        axis=1,
    )
    x = np.repeat(planes, n)
    p = np.vstack([x, np.tile(flat.T, len(planes))])
    used, t = np.unique(t, return_inverse=True)
    cells = skfem.MeshHex2.from_mesh(skfem.MeshHex(p[:, used], t.reshape(8, -1)))
    # Mid-side nodes come on chords; they belong on the arcs.
    locs = cells.doflocs.copy()
    locs[1:] = chord[1][cKDTree(chord[0]).query(locs[1:].T)[1]].T
    cells = skfem.MeshHex2(locs, cells.t)
    end, wide = planes[-1], diameters[-1]
    across = (-wide, -wide), (wide, wide)
    faces: dict[str, Region] = {
        "root": (0.0, *across[0], 0.0, *across[1]),
        "tip": (end, *across[0], end, *across[1]),
    }
    return checked(cells, skfem.ElementHex2(), faces, where)


def _disc(radii: Sequence[float]) -> tuple[Array, tuple[Array, Array], IntArray, IntArray]:
    """Quadrangles of a disc with a circle at every radius: a square core and rings about it.

    Returns:
        Corners (n, 2); all points of the biquadratic cells, on chords and on arcs, each (k, 2);
        corners of each cell (m, 4); number of the radius that bounds it (m,).
    """
    turn = 2.0 * math.pi / _AROUND
    arc = _AROUND * (4.0 / 3.0 * math.sin(turn / 2.0) - math.sin(turn) / 6.0)
    exact = math.sqrt(math.pi / arc)
    a = _CORE * radii[0] / math.sqrt(2.0)
    m = _AROUND // 2  # two cells, so four half cells, along each side of the core
    line = a * np.linspace(-1.0, 1.0, m + 1)
    grids = [np.stack(np.meshgrid(line, line, indexing="ij"), axis=2)]
    owner = [0]
    for side in range(4):
        angle = math.pi / 2.0 * side + np.linspace(-math.pi / 4.0, math.pi / 4.0, m + 1)
        R = np.array([[math.cos(math.pi / 2 * side), -math.sin(math.pi / 2 * side)],
                      [math.sin(math.pi / 2 * side), math.cos(math.pi / 2 * side)]])  # fmt: skip
        inner = np.column_stack([np.full(m + 1, a), line]) @ R.T
        for k, radius in enumerate(radii):
            outer = exact * radius * np.column_stack([np.cos(angle), np.sin(angle)])
            cells = 1 if k == 0 else max(1, round((radius - radii[k - 1]) / (0.4 * radii[0])))
            share = np.linspace(0.0, 1.0, 2 * cells + 1)[:, None, None]
            grids.append((1.0 - share) * inner + share * outer)
            owner.append(k)
            inner = outer
    corners: list[Array] = []
    chords, arcs, rings = [], [], []
    for grid, k in zip(grids, owner, strict=True):
        straight = grid.copy()
        straight[1::2] = 0.5 * (straight[:-1:2] + straight[2::2])
        straight[:, 1::2] = 0.5 * (straight[:, :-1:2] + straight[:, 2::2])
        chords.append(straight.reshape(-1, 2))
        arcs.append(grid.reshape(-1, 2))
        v = grid[::2, ::2]
        quads = np.stack([v[:-1, :-1], v[1:, :-1], v[1:, 1:], v[:-1, 1:]], axis=2)
        corners.append(quads.reshape(-1, 4, 2))
        rings += [k] * (quads.shape[0] * quads.shape[1])
    every = np.concatenate(corners).reshape(-1, 2)
    _, first, back = np.unique(
        np.round(every / radii[-1], 9), axis=0, return_index=True, return_inverse=True
    )
    both = np.concatenate(chords), np.concatenate(arcs)
    return every[first], both, back.reshape(-1, 4), np.array(rings, dtype=np.intp)
