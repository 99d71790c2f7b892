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
from pinflex.bodies import damping
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.moments import CROSS, MassPoints, outer_mass, section_fits
from pinflex.bodies.second_order import second_order_shapes
from pinflex.bodies.solid import Solid
from pinflex.errors import DescriptionError
from pinflex.text import brief

_DIRECTIONS = ("u", "v", "w", "rx", "ry", "rz")
SECTIONS = 21


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


@dataclass(frozen=True, eq=False)
class Superelement:
    """What a solid has beside the stations, K and M of any flexible body.

    Attributes:
        points: Places of the mass points (m), shape (ns, 3). They are moments of the body rather
            than places in it: some lie outside.
        nodes: Interfaces that move. held: Name and centre of the one that does not.
        inertia_error: Largest error of the points in Z, as a share of its largest entries.
        held_frequencies: Of the kept modes, all interfaces held (Hz), shape (modes,).
        x: Sections along the span (m), shape (nx,).
        Phi, G: Their rows (u, v, w, rz, ry, rx), shapes (nx, 6, n) and (nx, 6, n, n).
        outer: Forces of the points -> force of the mass beyond a section, shape (nx, ns).
        outer_moment: The same mass's moment arms (m), shape (nx, ns, 3).
        corners: Surface nodes (m), shape (nc, 3). triangles: Shape (nt, 3).
        shapes: Displacements of the corners, shape (nc, 3, n).
        stress: Stress xx yy zz yz zx xy at the corners (Pa) for unit forces that the points need
            (each along x, y, z) and unit forces and moments that the interfaces need, shape
            (nc, 6, 3 ns + 6 interfaces); None without mesh.
    """

    __repr__ = brief

    points: Array
    nodes: tuple[Node, ...]
    held: tuple[str, Array]
    inertia_error: float
    held_frequencies: Array
    x: Array
    Phi: Array
    G: Array | None
    outer: Array
    outer_moment: Array
    corners: Array
    triangles: IntArray
    shapes: Array
    stress: Array | None

    def rows(self, x: float) -> tuple[Array, Array | None]:
        """Rows (u, v, w, rz, ry, rx) at x (m), between sections by straight lines."""
        at = _between(self.x, np.array([x]))
        curved = None if self.G is None else np.tensordot(at, self.G, 1)[0]
        return np.tensordot(at, self.Phi, 1)[0], curved

    def fields(self, x: Array) -> dict[str, Array]:
        """Rows as those of a beam (`FlexibleBody.fields`), strains by differences of sections."""
        at, slope = _between(self.x, x), np.gradient(self.Phi, self.x, axis=0, edge_order=2)
        names = {"axial": (0, 1.0), "curvature_v": (3, 1.0), "curvature_w": (4, -1.0)}
        out = {"deflection": np.tensordot(at, self.Phi[:, [0, 1, 2, 5, 4, 3]], 1)}
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
        D = D + damping.modal_damping(K, M, modal_damping)
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
        x=x,
        Phi=rows,
        G=curved,
        outer=outer,
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
        G_t=None,
        rotary=False,
        inertia=None,
        Phi_r=None,
        G_r=None,
        K=K,
        M=M,
        D=D,
        root_moves=False,
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
    from scipy.sparse import coo_array

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
    moving = 6 * (len(regions) - 1)
    rows: list[Any] = []
    columns: list[Any] = []
    values: list[Any] = []
    free = np.flatnonzero(owner == 0)
    at = (3 * free[:, None] + np.arange(3)).ravel()
    rows.append(at)
    columns.append(moving + np.arange(len(at)))
    values.append(np.ones(len(at)))
    for number, region in enumerate(regions[1:]):
        arm = solid.nodes[region] - centres[number + 1]
        block = np.zeros((len(region), 3, 6))
        block[:, :, :3] = np.eye(3)
        block[:, :, 3:] = np.einsum("acb,ib->ica", CROSS, arm)  # e_a x arm
        i, c, k = np.nonzero(block)
        rows.append(3 * region[i] + c)
        columns.append(6 * number + k)
        values.append(block[i, c, k])
    shape = (3 * nn, moving + len(at))
    index = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(values), index), shape=shape).tocsc(), moving


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
            "The body has a part that hangs loose, or K is not a stiffness."
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
            f"{where}: K is singular with the interfaces held: a part of the body hangs loose."
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
