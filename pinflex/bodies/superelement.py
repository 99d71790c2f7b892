"""Craig-Bampton reduction of a solid body, with its inertia on a few weighted points.

The first interface is held in the frame of the body; each other one is a rigid region with six
coordinates (u, v, w, rx, ry, rz); below them vibrate the lowest modes with every interface held:

    u = Phi eta + 1/2 eta' G eta,     K = Phi' K Phi,  M = Phi' M Phi

Second order: coordinates in which the strains stay linear, as those of a beam. G is the motion
whose strain takes back C (H1' H2)_sym as well as the body can; a bent rod gets shorter by it.

Its inertia is carried by a few weighted points (`moments`).
Source: Craig, Bampton (1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.bodies import beam
from pinflex.bodies.basis import SECTIONS, Cut, FlexibleBody
from pinflex.bodies.solid import Solid
from pinflex.errors import DescriptionError
from pinflex.text import frozen

# The inertia of a deforming solid as a few mass points, and its motion at sections.
#
# The kinetic energy of a deforming body depends on its shapes only through
#
#     Z = int z z' dm,     z = (1, p, Phi_x, Phi_y, Phi_z),     p the place of the mass dm,
#
# so as many points as Z has rank carry it exactly. Z = F' F; a reflection gives the first column of
# F equal entries, and its rows are then points of equal positive mass. (Points picked in the mesh
# with non-negative weights would have to match every entry of Z: some ten times as many.) Source:
# Shabana (2013), inertia shape integrals.

_SMALL = 1e-4  # share of a modal mass a dropped field may carry: 5e-5 of a frequency
CROSS = np.zeros((3, 3, 3))  # CROSS[a] p = e_a x p
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    CROSS[_a, _c, _b], CROSS[_a, _b, _c] = 1.0, -1.0


def mass_points(Z: Array, n: int) -> tuple[Array, Array, float]:
    """Equal masses (ns,), rows z of the points (ns, d), and the largest error they leave.

    Mass, centre, second moments and the couplings of rigid with elastic motion are exact; of the
    elastic part, fields with less than `_SMALL` of the energy of a coordinate are left out.
    """
    L = np.linalg.cholesky(Z[:4, :4])
    couple = np.linalg.solve(L, Z[:4, 4:])
    rest = Z[4:, 4:] - couple.T @ couple
    # Each coordinate by its modal mass: a direction in which it hardly moves hardly counts.
    scale = np.tile(np.sqrt(np.diag(Z)[4:].reshape(3, n).sum(axis=0)), 3)
    values, V = np.linalg.eigh(rest / np.outer(scale, scale))
    keep = values > _SMALL
    F = np.zeros((4 + int(keep.sum()), len(Z)))
    F[:4, :4], F[:4, 4:] = L.T, couple
    F[4:, 4:] = np.sqrt(values[keep])[:, None] * V[:, keep].T * scale
    # The reflection that takes the first column of F to equal entries.
    r, first = len(F), F[:, 0]
    axis = first - np.linalg.norm(first) / np.sqrt(r)
    F = F - np.outer(2.0 * axis / (axis @ axis), axis @ F)
    weights = np.full(r, Z[0, 0] / r)
    points = F / np.sqrt(weights[0])
    points[:, 0] = 1.0
    whole = np.concatenate([np.sqrt(np.diag(Z)[:4]), scale])
    error = np.abs((points * weights[:, None]).T @ points - Z) / np.outer(whole, whole)
    return weights, points, float(error.max())


def section_fits(nodes: Array, x: Array) -> Array:
    """Rows (u, v, w, rz, ry, rx) of sections from nodal displacements, shape (nx, 6, nn, 3).

    Weighted least squares of a rigid section whose motion is quadratic in x, near each section.
    """
    length = float(x[-1] - x[0])
    out = np.zeros((len(x), 6, len(nodes), 3))
    reach = max(0.05 * length, 1.5 * float(np.max(np.diff(np.unique(np.round(nodes[:, 0], 9))))))
    for k, at in enumerate(x):
        s = (nodes[:, 0] - at) / reach
        near = np.flatnonzero(np.abs(s) < 3.0)
        weight = np.exp(-0.5 * s[near] ** 2)
        arm = np.column_stack([np.zeros(len(near)), nodes[near, 1:]])
        rigid = np.zeros((len(near), 3, 6))
        rigid[:, :, :3] = np.eye(3)
        rigid[:, :, 3:] = np.einsum("acb,ib->ica", CROSS, arm)
        full = np.concatenate([rigid * (s[near] ** p)[:, None, None] for p in range(3)], axis=2)
        full = full * weight[:, None, None]
        inverse = np.linalg.pinv(full.reshape(-1, 18), rcond=1e-9)[[0, 1, 2, 5, 4, 3]]
        out[k][:, near] = inverse.reshape(6, len(near), 3) * weight[:, None]
    return out


def outer_mass(nodes: Array, z: Array, lumps: Array, x: Array, back: Array) -> tuple[Array, Array]:
    """Operators from point forces to force and moment arms of the mass beyond each section.

    The acceleration is linear in z, so point forces f_k give it everywhere, and the mass beyond x
    (row sums of the mass matrix) then needs sum_k f_k z_k' Z^-1 int_{>x} z dm.
    """
    beyond = np.array([nodes[:, 0] > at for at in x], dtype=float)
    edge = np.array([np.abs(nodes[:, 0] - at) < 1e-9 * x[-1] for at in x], dtype=float)
    share = (beyond + 0.5 * edge) * lumps
    share[0] = lumps  # the first section carries all of the body, what lies behind it included
    force = share @ z @ back.T
    moments = np.einsum("xi,id,ia->xad", share, z, nodes, optimize=True) @ back.T
    return force, moments.transpose(0, 2, 1)


@frozen(eq=False)
class MassPoints:
    """Weighted points with the inertia of a body in f = 4 + 3 n fields: 1, x, y, z, the shapes.

    Attributes:
        z: The fields at the nodes, shape (nodes, f). fields: At the points, shape (ns, f).
        weights: Mass of each point (kg), shape (ns,).
        onto: Products z' M u of any field u -> its values at the points, shape (ns, f): the
            projection that keeps these products.
        error: Largest error of the points in the products, as a share of the largest entries.
    """

    z: Array
    fields: Array
    weights: Array
    onto: Array
    error: float

    @classmethod
    def of(cls, solid: Solid, shapes: Array) -> MassPoints:
        """The points of a solid."""
        z = np.column_stack([np.ones(len(solid.nodes)), solid.nodes, *shapes.transpose(1, 0, 2)])
        weights, points, error = mass_points(z.T @ (solid.mass @ z), shapes.shape[2])
        onto = np.linalg.pinv((points * weights[:, None]).T, rcond=1e-9)
        return cls(z, points, weights, np.asarray(onto, dtype=float), error)

    def project(self, solid: Solid, field: Array) -> Array:
        """Values of a field at the points, shape (ns, the rest)."""
        products = self.z.T @ (solid.mass @ field.reshape(len(self.z), -1))
        return np.asarray(self.onto @ products)


# Second-order shapes of a solid: coordinates in which its strains stay linear.
#
#     T' K T z_ij = -T' (int C (H_i' H_j)_sym : grad v + K s_ij),     G_ij = T z_ij + s_ij
#
# H_i is the gradient of shape i: the Green-Lagrange strain that two shapes make together is taken
# back as well as the body can, and no energy of third order is left. s_ij is what finite rotations
# of the rigid interfaces, R = Rz Ry Rx, add to their motion. A bent rod gets shorter, as a beam
# does.

_TURNS = (2, 1, 0)  # rotations z, y, x of an interface, in this order


def second_order_shapes(
    solid: Solid, T: Any, moving: int, shapes: Array, solve: Any
) -> tuple[Array, Array]:
    """G of all nodes, (nn, 3, n, n), and of the interface coordinates, (moving, n, n)."""
    assert solid.field is not None
    regions = list(solid.regions.values())
    n, nn = shapes.shape[2], len(solid.nodes)
    gradients = [solid.field.strained(shapes[:, :, k]) for k in range(n)]
    pairs = [(i, j) for i in range(n) for j in range(i, n)]
    loads = np.empty((3 * nn, len(pairs)))
    lift = np.zeros((3 * nn, len(pairs)))  # second order of the rotations of rigid interfaces
    for column, (i, j) in enumerate(pairs):
        loads[:, column] = solid.field.quadratic(gradients[i], gradients[j]).ravel()
        for number, region in enumerate(regions[1:]):
            turn = np.zeros((2, 3))
            for row, k in enumerate((i, j)):
                if 6 * number + 3 <= k < 6 * number + 6:
                    turn[row, k - 6 * number - 3] = 1.0
            if np.any(turn[0]) and np.any(turn[1]):
                arm = solid.nodes[region] - solid.nodes[region].mean(axis=0)
                dofs = 3 * region[:, None] + np.arange(3)
                lift[dofs, column] = arm @ _second_rotation(turn[0], turn[1]).T
    z = -solve(T.T @ (loads + solid.K @ lift))
    u = T @ z + lift
    G, node = np.empty((3 * nn, n, n)), np.empty((moving, n, n))
    for column, (i, j) in enumerate(pairs):
        G[:, i, j] = G[:, j, i] = u[:, column]
        node[:, i, j] = node[:, j, i] = z[:moving, column]
    return G.reshape(nn, 3, n, n), node


def _second_rotation(one: Array, two: Array) -> Array:
    """Bilinear part of Rz(rz) Ry(ry) Rx(rx) in two sets of small angles (rx, ry, rz), (3, 3)."""
    S = np.zeros((3, 3))
    for place, a in enumerate(_TURNS):
        S += one[a] * two[a] * (CROSS[a] @ CROSS[a])
        for b in _TURNS[place + 1 :]:
            S += (one[a] * two[b] + two[a] * one[b]) * (CROSS[a] @ CROSS[b])
    return S


_DIRECTIONS = ("u", "v", "w", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Node:
    """A rigid interface of a solid that moves.

    Attributes:
        name: Name. place: Its centre in the frame of the body (m), shape (3,).
        Phi, G: Rows (u, v, w, rz, ry, rx), shapes (6, n) and (6, n, n); G None without.
    """

    name: str
    place: Array
    Phi: Array
    G: Array | None


@frozen(eq=False)
class Superelement:
    """What a solid has beside the stations, K and M of any flexible body.

    Attributes:
        points: Places of the mass points (m), shape (ns, 3). They are moments of the body rather
            than places in it: some lie outside.
        nodes: Interfaces that move. held: Name and centre of the one that does not.
        inertia_error: Largest error of the points in Z, as a share of its largest entries.
        held_frequencies: Of the kept modes, all interfaces held (Hz), shape (modes,).
        cut: Sections along the span; its `outer` takes forces of the points to that of the mass
            beyond. outer_moment: The same mass's moment arms (m), shape (nx, ns, 3).
        corners: Surface nodes (m), shape (nc, 3). triangles: Shape (nt, 3).
        shapes: Displacements of the corners, shape (nc, 3, n).
        stress: Stress xx yy zz yz zx xy at the corners (Pa) for unit forces that the points need
            (each along x, y, z) and unit forces and moments that the interfaces need, shape
            (nc, 6, 3 ns + 6 interfaces); None without mesh.
    """

    points: Array
    nodes: tuple[Node, ...]
    held: tuple[str, Array]
    inertia_error: float
    held_frequencies: Array
    cut: Cut
    outer_moment: Array
    corners: Array
    triangles: IntArray
    shapes: Array
    stress: Array | None

    def rows(self, x: float) -> tuple[Array, Array | None]:
        """Rows (u, v, w, rz, ry, rx) at x (m), between sections by straight lines."""
        at, G = _between(self.cut.x, np.array([x])), self.cut.G
        curved = None if G is None else np.tensordot(at, G, 1)[0]
        return np.tensordot(at, self.cut.Phi, 1)[0], curved

    def fields(self, x: Array) -> dict[str, Array]:
        """Rows as those of a beam (`FlexibleBody.fields`), strains by differences of sections."""
        nodes, Phi = self.cut.x, self.cut.Phi
        at, slope = _between(nodes, x), np.gradient(Phi, nodes, axis=0, edge_order=2)
        names = {"axial": (0, 1.0), "curvature_v": (3, 1.0), "curvature_w": (4, -1.0)}
        out = {"deflection": np.tensordot(at, Phi[:, [0, 1, 2, 5, 4, 3]], 1)}
        for name, (row, sign) in (names | {"twist": (5, 1.0)}).items():
            out[name] = sign * (at @ slope[:, row])
        return out


def _between(nodes: Array, x: Array) -> Array:
    """Weights of linear interpolation, shape (len(x), len(nodes))."""
    return np.array([np.interp(x, nodes, e) for e in np.eye(len(nodes))]).T


def reduce(
    solid: Solid,
    modes: int,
    length: float,
    *,
    second_order: bool = True,
    rayleigh: tuple[float, float] = (0.0, 0.0),
    modal_damping: float = 0.0,
    where: str = "superelement",
) -> FlexibleBody:
    """Reduce a solid to its interfaces and lowest modes."""
    regions = list(solid.regions.items())
    centres = [solid.nodes[region].mean(axis=0) for _, region in regions]
    T, moving = _rigid_regions(solid, [r for _, r in regions], centres)
    shapes, K, squares = _craig_bampton(solid, T, moving, modes, where)
    n = shapes.shape[2]
    M = np.sum([shapes[:, c].T @ (solid.mass @ shapes[:, c]) for c in range(3)], axis=0)
    M = 0.5 * (M + M.T)
    D = rayleigh[0] * M + rayleigh[1] * K
    if modal_damping:
        D = D + beam.modal_damping(K, M, modal_damping)
    solve = _factor(T.T @ solid.K @ T, where)
    bends = None
    if second_order and solid.field is not None:
        bends = second_order_shapes(solid, T, moving, shapes, solve)
    nodes = tuple(
        Node(name, at, _node_rows(np.eye(n), k), bends and _node_rows(bends[1], k))
        for k, ((name, _), at) in enumerate(zip(regions[1:], centres[1:], strict=True))
    )
    mass = MassPoints.of(solid, shapes)
    ns = len(mass.weights)
    x = np.linspace(0.0, length, SECTIONS)
    rows, curved = _sections(solid, x, shapes, bends, nodes)
    lumps = np.asarray(solid.mass.sum(axis=1)).reshape(-1)
    outer, arms = outer_mass(solid.nodes, mass.z, lumps, x, mass.onto)
    corners, triangles = np.arange(0), np.zeros((0, 3), dtype=np.intp)
    stress = None
    if solid.field is not None:
        corners, triangles = solid.field.surface()
        stress = solid.field.stress_rows(_unit_answers(solid, mass, T, moving, solve), corners)
    extra = Superelement(
        points=mass.fields[:, 1:4],
        nodes=nodes,
        held=(regions[0][0], centres[0]),
        inertia_error=mass.error,
        held_frequencies=np.sqrt(squares) / (2.0 * np.pi),
        cut=Cut(x, rows, curved, outer, np.zeros((len(x), 0))),
        outer_moment=arms,
        corners=solid.nodes[corners],
        triangles=triangles,
        shapes=shapes[corners],
        stress=stress,
    )
    labels = [f"{node.name} {d}" for node in nodes for d in _DIRECTIONS]
    labels += [f"mode {k + 1}" for k in range(len(squares))]
    none = np.zeros(0)
    return FlexibleBody(
        n=n,
        length=length,
        families={},
        slices={},
        labels=tuple(labels),
        second_order=bends is not None,
        x=mass.fields[:, 1],
        mass=mass.weights,
        Phi=mass.fields[:, 4:].reshape(ns, 3, n),
        G=None if bends is None else mass.project(solid, bends[0]).reshape(ns, 3, n, n),
        xt=none,
        It=none,
        Phi_t=np.zeros((0, n)),
        K=K,
        M=M,
        D=D,
        solid=extra,
    )


def _unit_answers(solid: Solid, mass: MassPoints, T: Any, moving: int, solve: Any) -> Array:
    """Displacements (nodes, 3, 3 ns + 6 interfaces) under unit loads of points and interfaces.

    Stress comes from these forces, not from the shapes: those bend the ends of a rod where no
    moment is.
    """
    nn = len(mass.z)
    need = np.zeros((3 * nn, len(mass.weights), 3))
    for c in range(3):
        need[c::3, :, c] = solid.mass @ (mass.z @ mass.onto.T)
    loads = np.column_stack([T.T @ need.reshape(3 * nn, -1), np.eye(T.shape[1], moving)])
    return np.asarray((T @ solve(-loads)).reshape(nn, 3, -1))


def _rigid_regions(
    solid: Solid, regions: Sequence[IntArray], centres: Sequence[Array]
) -> tuple[Any, int]:
    """T from (6 coordinates per moving interface, other nodes) to all displacements."""
    from scipy.sparse import csc_array, eye_array, hstack

    nn = len(solid.nodes)
    owner = np.zeros(nn, dtype=np.intp)
    for number, region in enumerate(regions):
        if np.any(owner[region]):
            shared = solid.nodes[region[owner[region] > 0][0]]
            raise DescriptionError(
                f"interfaces: two of them share the node at {np.round(shared, 6)} m. Interfaces "
                "are rigid, so they must not touch. Choose smaller regions."
            )
        owner[region] = number + 1
    columns = []
    for region, centre in zip(regions[1:], centres[1:], strict=True):
        block = np.zeros((nn, 3, 6))
        block[region, :, :3] = np.eye(3)
        arm = solid.nodes[region] - centre
        block[region, :, 3:] = np.einsum("acb,ib->ica", CROSS, arm)  # e_a x arm
        columns.append(csc_array(block.reshape(3 * nn, 6)))
    free = (3 * np.flatnonzero(owner == 0)[:, None] + np.arange(3)).ravel()
    other = eye_array(3 * nn, format="csc")[:, free]
    return hstack([*columns, other], format="csc"), 6 * len(columns)


def _craig_bampton(
    solid: Solid, T: Any, moving: int, modes: int, where: str
) -> tuple[Array, Array, Array]:
    """Shapes (nn, 3, n), reduced stiffness (n, n) and omega^2 of the modes with all held."""
    from scipy.sparse import csc_array, kron
    from scipy.sparse.linalg import LinearOperator, eigsh

    K = csc_array(T.T @ solid.K @ T)
    M = csc_array(T.T @ kron(solid.mass, np.eye(3), format="csc") @ T)
    inner, count = slice(moving, None), K.shape[0] - moving
    if not 0 < modes < count - 1:
        raise DescriptionError(
            f"{where}.modes: {modes}. Allowed: 1 to {count - 2}, the free displacements less 2."
        )
    solve = _factor(K[inner, inner], where)
    static = -solve(K[inner, :moving].toarray())
    size = (count, count)
    squares, V = eigsh(
        K[inner, inner], modes, M[inner, inner], sigma=0.0,
        OPinv=LinearOperator(size, matvec=solve), v0=np.ones(count),
    )  # fmt: skip
    order = np.argsort(squares)
    squares, V = squares[order], V[:, order] * np.sqrt(float(solid.mass.sum()))
    if squares[0] <= 0.0:
        raise DescriptionError(
            f"{where}: K is not positive with the interfaces held (omega^2 = {squares[0]:.3g}). "
            "Join a part that hangs loose to the rest, or give a K that is a stiffness."
        )
    V *= np.where(V[np.argmax(np.abs(V), axis=0), np.arange(modes)] < 0.0, -1.0, 1.0)
    z = np.zeros((K.shape[0], moving + modes))
    z[:moving, :moving], z[inner, :moving], z[inner, moving:] = np.eye(moving), static, V
    reduced = z.T @ (K @ z)
    reduced[:moving, moving:] = reduced[moving:, :moving] = 0.0  # static shapes do no work on modes
    reduced[moving:, moving:] = np.diag(squares * float(solid.mass.sum()))
    shapes = (T @ z).reshape(len(solid.nodes), 3, -1)
    return shapes, 0.5 * (reduced + reduced.T), squares


def _factor(K: Any, where: str) -> Any:
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    try:
        # Symmetric ordering and pivots on the diagonal: K is positive definite.
        return splu(
            csc_matrix(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        ).solve  # fmt: skip
    except RuntimeError:
        raise DescriptionError(
            f"{where}: K is singular with the interfaces held: a part of the body hangs loose. "
            "Join it to the rest."
        ) from None


def _sections(
    solid: Solid,
    x: Array,
    shapes: Array,
    bends: tuple[Array, Array] | None,
    nodes: Sequence[Node],
) -> tuple[Array, Array | None]:
    """Rows (u, v, w, rz, ry, rx) of sections: Phi (nx, 6, n) and G (nx, 6, n, n)."""
    fit = section_fits(solid.nodes, x)
    rows = np.einsum("xkip,ipn->xkn", fit, shapes, optimize=True)
    curved = None
    if bends is not None:
        curved = np.einsum("xkip,ipab->xkab", fit, bends[0], optimize=True)
    # Exact where an interface is a section of the span.
    held = solid.nodes[next(iter(solid.regions.values()))].mean(axis=0)
    if np.linalg.norm(held) < 1e-6 * x[-1]:
        rows[0] = 0.0
        if curved is not None:
            curved[0] = 0.0
    for node in nodes:
        if np.linalg.norm(node.place - [x[-1], 0.0, 0.0]) < 1e-6 * x[-1]:
            rows[-1] = node.Phi
            if curved is not None and node.G is not None:
                curved[-1] = node.G
    return rows, curved


def _node_rows(coordinates: Array, k: int) -> Array:
    """Rows (u, v, w, rz, ry, rx) of interface k from its coordinates (u, v, w, rx, ry, rz)."""
    return np.asarray(coordinates[6 * k + np.array([0, 1, 2, 5, 4, 3])])
