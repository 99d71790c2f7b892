"""A solid body before reduction: nodes, stiffness and mass, from a mesh or from given matrices.

Degree of freedom 3 i + c is the displacement of node i along axis c. The mass matrix is one number
per pair of nodes, the same for the three axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.description.blocks.material import Material
from pinflex.description.files import MOST_DATA, require_regular
from pinflex.errors import DescriptionError, nearest
from pinflex.text import frozen

# Solid meshes: read from a file, or built for a stepped round rod, with their named faces.
#
# scikit-fem (the extra `pinflex[fe]`) holds the mesh; displacements are quadratic on every cell.

Region = str | tuple[float, ...]  # a named group of faces, or a box x0 y0 z0 x1 y1 z1 [m]

_AROUND = 8  # quadratic arcs round a circle: its bending stiffness is right to 1e-4
_CORE = 0.55  # corners of the square core of a section, as a share of the innermost radius
_NEAR_STEP = np.array([0.1, 0.35])  # a cell beside a step is cut here, for the stress at the step
_FLAT = 1e-6  # volume of a cell below this share of its bounding cube: it has none


@frozen(eq=False)
class Mesh:
    """A solid mesh with quadratic displacements.

    Attributes:
        cells: The scikit-fem mesh [m].
        element: Its scalar, quadratic scikit-fem element.
        regions: Node numbers of each interface, in the order in which they were asked for.
    """

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


def existing(path: Path, where: str, advice: str = "") -> Path:
    """The path, if there is a file of a size that can be meant."""
    if not path.is_file():
        beside = [p.name for p in sorted(path.parent.glob("*.*"))] if path.parent.is_dir() else []
        hint = nearest(path.name, beside)
        raise DescriptionError(f"{where}: {path.name}: no such file.{hint}{advice}")
    require_regular(path, MOST_DATA, f"{where}: {path.name}")
    return path


def read(path: Path, interfaces: Mapping[str, Region], scale: float, where: str) -> Mesh:
    """Read a mesh of tetrahedra or hexahedra, linear or quadratic, from any format of meshio."""
    skfem = scikit_fem(where)
    import meshio
    from skfem.io.meshio import from_meshio

    existing(path, f"{where}.file", " Give it relative to the YAML.")
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
        raise DescriptionError(
            f"{where}.file: {path.name}: its cells are others. Allowed: {', '.join(solids)}."
        )
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


_SYMMETRIC = 1e-8  # asymmetry of a matrix, as a share of its largest entry, that round-off explains
_FREE = 1e-6  # the same for the forces with which K resists a motion of the rigid body
_SPEED = (1.0, 1e5)  # speed of sound in a solid [m/s]; rubber has 30, diamond 12 000


@frozen(eq=False)
class Solid:
    """An unsupported elastic body.

    Attributes:
        nodes: Places (m), shape (nn, 3).
        K: Stiffness (N/m), sparse, shape (3 nn, 3 nn).
        mass: Mass (kg), sparse, shape (nn, nn); the mass matrix is mass x identity(3).
        regions: Nodes of each interface; the first is held in the frame of the body.
        field: The finite elements behind it; None for given matrices.
    """

    nodes: Array
    K: Any
    mass: Any
    regions: Mapping[str, IntArray]
    field: Field | None = None


@dataclass(frozen=True, eq=False)
class Field:
    """Elements of a mesh and their material: stresses and second-order strains.

    Attributes:
        mesh: The mesh.
        material: Isotropic material.
    """

    mesh: Mesh
    material: Material

    @property
    def stiffness(self) -> Array:
        """C in stress = C strain, order xx yy zz yz zx xy with engineering shears, (6, 6), Pa."""
        E, nu = self.material.E, self.material.nu
        lame = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        shear = E / (2.0 * (1.0 + nu))
        C = np.diag([2.0 * shear] * 3 + [shear] * 3)
        C[:3, :3] += lame
        return C

    @cached_property
    def points(self) -> tuple[Array, Array, IntArray, Array]:
        """Gradients (ne, nb, 3, nq), volumes (ne, nq), nodes (ne, nb), values at Gauss points."""
        basis = scikit_fem("solid").CellBasis(self.mesh.cells, self.mesh.element, intorder=4)
        functions = [basis.basis[k][0] for k in range(basis.Nbfun)]
        grad = np.array([np.asarray(f.grad) for f in functions]).transpose(2, 0, 1, 3)
        value = np.array([np.broadcast_to(np.asarray(f), basis.dx.shape) for f in functions])
        return np.ascontiguousarray(grad), basis.dx, basis.element_dofs.T, value.transpose(1, 0, 2)

    def strained(self, u: Array) -> Array:
        """Displacement gradients at the Gauss points, shape (ne, nq, 3, 3), of u (nn, 3)."""
        grad, _, nodes, _ = self.points
        return np.asarray(np.einsum("eic,eijq->eqcj", u[nodes], grad, optimize=True))

    def force(self, stress: Array) -> Array:
        """Nodal forces int stress : grad(v) of symmetric stresses (ne, nq, 3, 3), shape (nn, 3)."""
        grad, dx, nodes, _ = self.points
        local = np.einsum("eqcj,eijq,eq->eic", stress, grad, dx, optimize=True)
        out = np.zeros((int(nodes.max()) + 1, 3))
        np.add.at(out, nodes, local)
        return out

    def quadratic(self, one: Array, two: Array) -> Array:
        """Forces of the strain that two displacements make together, shape (nn, 3).

        int C (H1' H2)_sym : grad(v), from their gradients H (ne, nq, 3, 3): the part of the
        Green-Lagrange strain that is bilinear in them.
        """
        H = np.swapaxes(one, 2, 3) @ two
        return self.force(self._stress(0.5 * (H + np.swapaxes(H, 2, 3))))

    def _stress(self, strain: Array) -> Array:
        lame, shear = self.stiffness[0, 1], self.stiffness[3, 3]
        trace = np.trace(strain, axis1=2, axis2=3)[:, :, None, None]
        return np.asarray(2.0 * shear * strain + lame * trace * np.eye(3))

    def surface(self) -> tuple[IntArray, IntArray]:
        """Corner nodes on the surface, and triangles (nt, 3) between them."""
        cells = self.mesh.cells
        facets = cells.facets[:, cells.boundary_facets()]
        if len(facets) == 4:  # corners of a quadrilateral, in any order: sort them round it
            p = cells.p[:, facets]
            arm = p - p.mean(axis=1, keepdims=True)
            normal = np.cross(arm[:, 1], arm[:, 0], axis=0)
            side = np.cross(normal, arm[:, 0], axis=0)
            angle = np.arctan2(
                np.einsum("ckf,cf->kf", arm, side) / np.linalg.norm(side, axis=0),
                np.einsum("ckf,cf->kf", arm, arm[:, 0]) / np.linalg.norm(arm[:, 0], axis=0),
            )
            facets = np.take_along_axis(facets, np.argsort(angle, axis=0), axis=0)
            facets = np.concatenate([facets[[0, 1, 2]], facets[[0, 2, 3]]], axis=1)
        corners, triangles = np.unique(facets, return_inverse=True)
        return corners, triangles.reshape(3, -1).T

    def stress_rows(self, shapes: Array, corners: IntArray) -> Array:
        """Stress xx yy zz yz zx xy (Pa) at k corners, averaged over the cells there, (k, 6, n)."""
        skfem, cells = scikit_fem("solid"), self.mesh.cells
        at = np.asarray(cells.refdom.p, dtype=float)
        rule = (at, np.full(at.shape[1], 1.0 / at.shape[1]))
        basis = skfem.CellBasis(cells, self.mesh.element, quadrature=rule)
        grad = np.array([np.asarray(basis.basis[k][0].grad) for k in range(basis.Nbfun)])
        H = np.einsum("eicn,ijeq->eqcjn", shapes[basis.element_dofs.T], grad, optimize=True)
        e = H + np.swapaxes(H, 2, 3)
        pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
        strain = np.stack([e[:, :, a, b] * (0.5 if a == b else 1.0) for a, b in pairs], axis=2)
        stress = np.einsum("ab,eqbn->eqan", self.stiffness, strain)
        weight = np.broadcast_to(basis.dx.sum(axis=1)[:, None], basis.dx.shape)
        total = np.zeros((int(cells.t.max()) + 1, 6, shapes.shape[2]))
        share = np.zeros(len(total))
        np.add.at(total, cells.t.T, stress * weight[:, :, None, None])
        np.add.at(share, cells.t.T, weight)
        return np.asarray(total[corners] / share[corners][:, None, None])


def _density(material: Material, where: str) -> float:
    """Density (kg/m^3) of a material whose numbers are those of one isotropic solid, in SI."""
    if material.rho is None or not -1.0 < material.nu < 0.5:
        text = f"rho = {material.rho}, nu = {material.nu:g}: a solid needs a density and nu < 0.5."
        raise DescriptionError(f"{where}.material: {text} Give both.")
    isotropic = material.E / (2.0 * (1.0 + material.nu))
    if abs(material.G - isotropic) > 1e-3 * isotropic:
        raise DescriptionError(
            f"{where}.material: G = {material.G:g} Pa, but E and nu give {isotropic:g} Pa. "
            "A solid mesh is isotropic: give E and nu only."
        )
    speed = float(np.sqrt(material.E / material.rho))
    if not _SPEED[0] < speed < _SPEED[1]:
        raise DescriptionError(
            f"{where}.material: sound would travel at {speed:.3g} m/s (E = {material.E:g} Pa, "
            f"rho = {material.rho:g} kg/m^3), which no solid does. Use SI units: Pa, kg/m^3, m."
        )
    return material.rho


def of_mesh(mesh: Mesh, material: Material, where: str) -> Solid:
    """Assemble stiffness and mass of a mesh.

    K = int B' C B dV, mass = int rho N' N dV, with quadratic displacements.
    """
    rho = _density(material, where)
    field = Field(mesh, material)
    grad, dx, nodes, value = field.points
    ne, nb, _, nq = grad.shape
    C = field.stiffness
    lame, shear = C[0, 1], C[3, 3]
    flat = grad.reshape(ne, nb * 3, nq)
    A = (flat * dx[:, None]) @ flat.transpose(0, 2, 1)  # [ia, jb] = int N_i,a N_j,b
    A = A.reshape(ne, nb, 3, nb, 3)
    local = lame * A + shear * A.transpose(0, 1, 4, 3, 2)
    along = shear * np.einsum("eiaja->eij", A)
    for c in range(3):
        local[:, :, c, :, c] += along
    K = _assembled(local, (3 * nodes[:, :, None] + np.arange(3)).reshape(ne, nb * 3))
    M = _assembled(rho * ((value * dx[:, None]) @ value.transpose(0, 2, 1)), nodes)
    basis = scikit_fem(where).CellBasis(mesh.cells, mesh.element, intorder=1)
    return Solid(basis.doflocs.T.copy(), K, M, mesh.regions, field)


def _assembled(local: Array, dofs: IntArray) -> Any:
    """The sparse sum of matrices of cells that have the degrees of freedom (ne, n)."""
    from scipy.sparse import coo_array

    n, count = dofs.shape[1], int(dofs.max()) + 1
    rows, columns = np.repeat(dofs, n, axis=1), np.tile(dofs, (1, n))
    entries = local.reshape(-1), (rows.reshape(-1), columns.reshape(-1))
    return coo_array(entries, shape=(count, count)).tocsc()


def of_matrices(nodes: Array, K: Any, M: Any, regions: Mapping[str, IntArray], where: str) -> Solid:
    """A body given by its matrices, if they are those of an unsupported elastic solid."""
    from scipy.sparse import csc_array

    nn = len(nodes)
    if nodes.ndim != 2 or nodes.shape[1] != 3 or not np.all(np.isfinite(nodes)):
        raise DescriptionError(f"{where}: nodes: shape {nodes.shape}. Give x, y, z [m] per node.")
    K, M = csc_array(K), csc_array(M)
    for name, A in (("K", K), ("M", M)):
        _require_symmetric(name, A, nn, where)
    mass = M[0::3, 0::3]
    _require_equal_masses(M, mass, where)
    _require_unsupported(K, nodes, where)
    return Solid(nodes, K, mass.tocsc(), regions)


def _require_symmetric(name: str, A: Any, nn: int, where: str) -> None:
    """Raise where a matrix is not finite, symmetric and of three rows a node."""
    if A.shape != (3 * nn, 3 * nn):
        raise DescriptionError(
            f"{where}: {name} has shape {A.shape}, but {nn} nodes with 3 displacements each "
            f"need {(3 * nn, 3 * nn)}. Order the rows node by node: x, y, z."
        )
    if not np.all(np.isfinite(A.data)):
        raise DescriptionError(f"{where}: {name} holds numbers that are not finite.")
    size, off = float(abs(A).max()), abs(A - A.T).tocoo()
    if size == 0.0 or off.max() > _SYMMETRIC * size:
        k = int(np.argmax(off.data)) if off.nnz else 0
        i, j = (int(off.coords[0][k]), int(off.coords[1][k])) if off.nnz else (0, 0)
        text = "is zero" if size == 0.0 else f"is not symmetric: entry ({i}, {j})"
        value = f" differs from ({j}, {i}) by {off.max():.3g}" if off.nnz else ""
        raise DescriptionError(
            f"{where}: {name} {text}{value}. Give the full, symmetric matrix, not a triangle "
            "of it.",
            asymmetry=float(off.max()) if off.nnz else 0.0,
        )


def _require_equal_masses(M: Any, mass: Any, where: str) -> None:
    """Raise where a node has not the same mass along x, y and z."""
    other = max(
        float(abs(M[a::3, b::3] - (mass if a == b else 0.0 * mass)).max())
        for a in range(3)
        for b in range(3)
    )
    if other > _SYMMETRIC * abs(M).max() or mass.sum() <= 0.0:
        raise DescriptionError(
            f"{where}: M does not give each node the same mass along x, y and z (they differ by "
            f"{other:.3g} kg), so it is not that of displacements in m. Give masses in kg, node by "
            "node."
        )


def _require_unsupported(K: Any, nodes: Array, where: str) -> None:
    """Raise where a stiffness resists a motion of the rigid body."""
    arm = nodes - nodes.mean(axis=0)
    for axis in range(3):
        shift = np.zeros((len(nodes), 3))
        shift[:, axis] = 1.0
        spin = np.cross(np.eye(3)[axis], arm)
        for what, motion in (("translation along", shift), ("rotation about", spin)):
            ratio = float(np.abs(K @ motion.ravel()).max() / (abs(K).max() * np.abs(motion).max()))
            if ratio > _FREE:
                raise DescriptionError(
                    f"{where}: K resists a {what} {'xyz'[axis]} of the rigid body (by {ratio:.2g} "
                    "of its largest entry). Give it without supports, for nodes in m."
                )
