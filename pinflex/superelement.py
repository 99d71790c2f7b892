"""Craig-Bampton reduction of a solid body, with its inertia on a few weighted points.

The first interface is held in the frame of the body; each other one is a rigid region with six
coordinates (u, v, w, rx, ry, rz); below them vibrate the lowest modes with every interface held:

    u = Phi eta + 1/2 eta' G eta,     K = Phi' K Phi,  M = Phi' M Phi

Second order: coordinates in which the strains stay linear, as those of a beam. G is the motion whose
strain takes back C (H1' H2)_sym as well as the body can; shortening of a bent rod is a part of it.

Inertia: the kinetic energy of a deforming body depends on its shapes only through

    Z = int z z' dm,     z = (1, p, Phi_x, Phi_y, Phi_z),     p the place of the mass dm,

so as many points as Z has rank carry it exactly. Z = F' F; a reflection gives the first column of F
equal entries, and its rows are then points of equal positive mass. (Points picked in the mesh with
non-negative weights would have to match every entry of Z: some ten times as many.)
Sources: Craig, Bampton (1968); Shabana (2013), inertia shape integrals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.basis import FlexibleBody
from pinflex.errors import DescriptionError
from pinflex.solid import Solid

_SMALL = 1e-4  # share of a modal mass a dropped field may carry: 5e-5 of a frequency
_TURNS = (2, 1, 0)  # R = Rz Ry Rx: rotations z, y, x of an interface, in this order
_DIRECTIONS = ("u", "v", "w", "rx", "ry", "rz")
SECTIONS = 21
_CROSS = np.zeros((3, 3, 3))  # _CROSS[a] p = e_a x p
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_a, _c, _b], _CROSS[_a, _b, _c] = 1.0, -1.0


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
    """Reduce a solid to its interfaces and lowest modes.

    Args:
        solid: Body in the frame of the beam: its span lies along x.
        modes: Modes with all interfaces held.
        length: Span along which sections are reported (m).
        second_order: Rows G, where there is a mesh to compute them from.
        rayleigh: Damping alpha M + beta K (1/s, s). modal_damping: Ratio of every mode [-].
        where: Place in the description, for messages.
    """
    regions = list(solid.regions.items())
    centres = [solid.nodes[region].mean(axis=0) for _, region in regions]
    T, moving = _rigid_regions(solid, [r for _, r in regions], centres)
    shapes, K, squares = _craig_bampton(solid, T, moving, modes, where)
    n = shapes.shape[2]
    mass = solid.mass
    M = np.zeros((n, n))
    for c in range(3):
        M += shapes[:, c].T @ (mass @ shapes[:, c])
    M = 0.5 * (M + M.T)
    bends = None
    solve = _factor(T.T @ solid.K @ T, where)
    if second_order and solid.field is not None:
        bends = _second_order(solid, T, moving, shapes, [r for _, r in regions], solve)
    D = rayleigh[0] * M + rayleigh[1] * K
    if modal_damping:
        D = D + _modal_damping(K, M, modal_damping)
    # Mass points.
    z = np.column_stack([np.ones(len(solid.nodes)), solid.nodes, *shapes.transpose(1, 0, 2)])
    Z = z.T @ (mass @ z)
    weights, points, error = _mass_points(Z, n)
    ns = len(weights)
    Phi = points[:, 4:].reshape(ns, 3, n)
    # Coefficients of any field on the points: the projection that keeps its products with z.
    onto = np.linalg.pinv((points * weights[:, None]).T, rcond=1e-9)
    G = None
    if bends is not None:
        G = (onto @ (z.T @ (mass @ bends[0].reshape(len(z), -1)))).reshape(ns, 3, n, n)
    nodes = tuple(
        Node(
            name,
            centre,
            _node_rows(np.eye(n), k),
            None if bends is None else _node_rows(bends[1], k),
        )
        for k, ((name, _), centre) in enumerate(zip(regions[1:], centres[1:], strict=True))
    )
    # Sections.
    x = np.linspace(0.0, length, SECTIONS)
    fit = _section_fits(solid.nodes, x)
    rows = np.einsum("xkip,ipn->xkn", fit, shapes)
    curved = None if bends is None else np.einsum("xkip,ipab->xkab", fit, bends[0])
    for node in nodes:  # exact where an interface is a section of the span
        if np.linalg.norm(node.place - [length, 0.0, 0.0]) < 1e-6 * length:
            rows[-1] = node.Phi
            if curved is not None and node.G is not None:
                curved[-1] = node.G
    if np.linalg.norm(centres[0]) < 1e-6 * length:
        rows[0] = 0.0
        if curved is not None:
            curved[0] = 0.0
    lumps = np.asarray(mass.sum(axis=1)).reshape(-1)
    outer, arms = _outer(solid, z, lumps, x, onto)
    corners, triangles = np.arange(0), np.zeros((0, 3), dtype=np.intp)
    stress = None
    if solid.field is not None:
        corners, triangles = solid.field.surface()
        # Stress from forces, not from the shapes: those bend the ends of a rod where no moment is.
        need = np.zeros((3 * len(z), ns, 3))
        for c in range(3):
            need[c::3, :, c] = mass @ (z @ onto.T)
        loads = np.column_stack([T.T @ need.reshape(3 * len(z), -1), np.eye(T.shape[1], moving)])
        answer = (T @ solve(-loads)).reshape(len(z), 3, -1)
        stress = solid.field.stress_rows(answer, corners)
    extra = Superelement(
        points=points[:, 1:4],
        nodes=nodes,
        held=(regions[0][0], centres[0]),
        inertia_error=error,
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
        x=points[:, 1],
        mass=weights,
        Phi=Phi,
        G=G,
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
    rows: list[Array] = []
    columns: list[Array] = []
    values: list[Array] = []
    free = np.flatnonzero(owner == 0)
    at = (3 * free[:, None] + np.arange(3)).ravel()
    rows.append(at)
    columns.append(moving + np.arange(len(at)))
    values.append(np.ones(len(at)))
    for number, region in enumerate(regions[1:]):
        arm = solid.nodes[region] - centres[number + 1]
        block = np.zeros((len(region), 3, 6))
        block[:, :, :3] = np.eye(3)
        block[:, :, 3:] = np.einsum("acb,ib->ica", _CROSS, arm)  # e_a x arm
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


def _second_order(
    solid: Solid, T: Any, moving: int, shapes: Array, regions: Sequence[IntArray], solve: Any
) -> tuple[Array, Array]:
    """G of all nodes, (nn, 3, n, n), and of the interface coordinates, (moving, n, n)."""
    assert solid.field is not None
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
        S += one[a] * two[a] * (_CROSS[a] @ _CROSS[a])
        for b in _TURNS[place + 1 :]:
            S += (one[a] * two[b] + two[a] * one[b]) * (_CROSS[a] @ _CROSS[b])
    return S


def _node_rows(coordinates: Array, k: int) -> Array:
    """Rows (u, v, w, rz, ry, rx) of interface k from its coordinates (u, v, w, rx, ry, rz)."""
    return np.asarray(coordinates[6 * k + np.array([0, 1, 2, 5, 4, 3])])


def _modal_damping(K: Array, M: Array, ratio: float) -> Array:
    """D = M V diag(2 zeta omega) V' M of the modes V held at the root, V' M V = 1."""
    from scipy.linalg import eigh

    squares, V = eigh(K, M)
    MV = M @ V
    return np.asarray(MV * (2.0 * ratio * np.sqrt(np.maximum(squares, 0.0))) @ MV.T)


def _mass_points(Z: Array, n: int) -> tuple[Array, Array, float]:
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


def _section_fits(nodes: Array, x: Array) -> Array:
    """Rows (u, v, w, rz, ry, rx) of sections from nodal displacements, shape (nx, 6, nn, 3).

    Weighted least squares of a rigid section whose motion is quadratic in x, near each section.
    """
    length = float(x[-1] - x[0])
    across = nodes - nodes.mean(axis=0)
    across = across[:, 1:]
    out = np.zeros((len(x), 6, len(nodes), 3))
    reach = max(0.05 * length, 1.5 * float(np.max(np.diff(np.unique(np.round(nodes[:, 0], 9))))))
    for k, at in enumerate(x):
        s = (nodes[:, 0] - at) / reach
        near = np.flatnonzero(np.abs(s) < 3.0)
        weight = np.exp(-0.5 * s[near] ** 2)
        arm = np.column_stack([np.zeros(len(near)), nodes[near, 1:]])
        rigid = np.zeros((len(near), 3, 6))
        rigid[:, :, :3] = np.eye(3)
        rigid[:, :, 3:] = np.einsum("acb,ib->ica", _CROSS, arm)
        full = np.concatenate([rigid * (s[near] ** p)[:, None, None] for p in range(3)], axis=2)
        full = full * weight[:, None, None]
        inverse = np.linalg.pinv(full.reshape(-1, 18), rcond=1e-9)[[0, 1, 2, 5, 4, 3]]
        out[k][:, near] = inverse.reshape(6, len(near), 3) * weight[:, None]
    del across
    return out


def _outer(solid: Solid, z: Array, lumps: Array, x: Array, back: Array) -> tuple[Array, Array]:
    """Operators from point forces to force and moment arms of the mass beyond each section.

    The acceleration is linear in z, so point forces f_k give it everywhere, and the mass beyond x
    (row sums of the mass matrix) then needs sum_k f_k z_k' Z^-1 int_{>x} z dm.
    """
    beyond = np.array([solid.nodes[:, 0] > at for at in x], dtype=float)
    edge = np.array([np.abs(solid.nodes[:, 0] - at) < 1e-9 * x[-1] for at in x], dtype=float)
    share = (beyond + 0.5 * edge) * lumps
    share[0] = lumps  # the first section carries all of the body, what lies behind it included
    force = share @ z @ back.T
    moments = np.einsum("xi,id,ia->xad", share, z, solid.nodes, optimize=True) @ back.T
    return force, moments.transpose(0, 2, 1)
