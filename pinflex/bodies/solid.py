"""A solid body before reduction: nodes, stiffness and mass, from a mesh or from given matrices.

Degree of freedom 3 i + c is the displacement of node i along axis c. The mass matrix is one number
per pair of nodes, the same for the three axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.bodies.mesh import Mesh, scikit_fem
from pinflex.description.blocks.material import Material
from pinflex.errors import DescriptionError
from pinflex.text import brief

_SYMMETRIC = 1e-8  # asymmetry of a matrix, as a share of its largest entry, that round-off explains
_FREE = 1e-6  # the same for the forces with which K resists a motion of the rigid body
_SPEED = (1.0, 1e5)  # speed of sound in a solid [m/s]; rubber has 30, diamond 12 000


@dataclass(frozen=True, eq=False)
class Solid:
    """An unsupported elastic body.

    Attributes:
        nodes: Places (m), shape (nn, 3).
        K: Stiffness (N/m), sparse, shape (3 nn, 3 nn).
        mass: Mass (kg), sparse, shape (nn, nn); the mass matrix is mass x identity(3).
        regions: Nodes of each interface; the first is held in the frame of the body.
        field: The finite elements behind it; None for given matrices.
    """

    __repr__ = brief

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
        """Stress xx yy zz yz zx xy (Pa) at mesh corners, averaged over the cells that meet there.

        Returns:
            Shape (k, 6, n).
        """
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
    from scipy.sparse import coo_array

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
    dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(ne, nb * 3)
    count = int(nodes.max()) + 1
    K = coo_array(
        (
            local.reshape(-1),
            (np.repeat(dofs, 3 * nb, axis=1).reshape(-1), np.tile(dofs, (1, 3 * nb)).reshape(-1)),
        ),
        shape=(3 * count, 3 * count),
    ).tocsc()
    masses = rho * ((value * dx[:, None]) @ value.transpose(0, 2, 1))
    M = coo_array(
        (
            masses.reshape(-1),
            (np.repeat(nodes, nb, axis=1).reshape(-1), np.tile(nodes, (1, nb)).reshape(-1)),
        ),
        shape=(count, count),
    ).tocsc()
    basis = scikit_fem(where).CellBasis(mesh.cells, mesh.element, intorder=1)
    return Solid(basis.doflocs.T.copy(), K, M, mesh.regions, field)


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
