"""Kinematics of a beam to second order: how a section moves and turns with the coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray, distinct
from pinflex.bodies.family import BENDING, Family, combine, quadrature

if TYPE_CHECKING:
    from pinflex.description.blocks.flexible import FlexibleLink
    from pinflex.description.section import Section


# First-order rows: (row, direction, field, sign), with rz = v', ry = -w', rx = p.
_FIRST_ORDER = (
    (0, "u", "f", 1.0),
    (1, "v", "f", 1.0),
    (2, "w", "f", 1.0),
    (3, "v", "rot", 1.0),
    (4, "w", "rot", -1.0),
    (5, "p", "f", 1.0),
)


DIRECTIONS = ("u", "v", "w", "p")
_SMALL = 1 << 16  # numbers: rows of so many are kept


def union(breaks: Sequence[Array]) -> Array:
    """Sorted points of all, without those that differ by rounding only."""
    points = distinct(*breaks)
    return np.asarray(points[np.append(True, np.diff(points) > 1e-12 * points[-1])])


def first_order(families: Mapping[str, Family], slices: Mapping[str, slice], x: Array) -> Array:
    """Rows (u, v, w, rz, ry, rx) at x, shape (nx, 6, n)."""
    Phi = np.zeros((len(x), 6, _width(slices)))
    values = {d: family.evaluate(x) for d, family in families.items()}
    for row, direction, field, sign in _FIRST_ORDER:
        if direction in values:
            Phi[:, row, slices[direction]] = sign * getattr(values[direction], field)
    return Phi


def second_order(
    families: Mapping[str, Family], slices: Mapping[str, slice], x: Array, rows: Sequence[int]
) -> Array:
    """Second-order rows of (u, v, w, rz, ry, rx) at x; not to be changed.

    With a, b the bending rotations (rv, -rw), g the shear strains and integrals from 0 to x,

        rz:  -int rw' p            ry:  -int rv' p            rx:  -int rv' rw
        u:   -int rv v' + int rv^2 / 2, and the same in w;  -1/2 int v'^2 without shear
        v:   int (-int rw' p + u' rv - p gw)      w:   int (int rv' p + u' rw + p gv)

    which expands R' = R kappa^, r' = R (1 + u', gv, gw) for R = Rz(rz) Ry(ry) Rx(rx). A double
    integral is taken as int int h = x int h - int s h. Symmetric in the last two of its axes,
    (nx, len(rows), n, n).
    """
    asked = tuple((d, one, slices[d].start) for d, one in families.items()), tuple(rows)
    small = len(x) * len(rows) * _width(slices) ** 2 < _SMALL
    return (_second_order if small else _second_order.__wrapped__)(*asked, x.tobytes())


@lru_cache(maxsize=128)
def _second_order(
    asked: tuple[tuple[str, Family, int], ...], rows: tuple[int, ...], at: bytes
) -> Array:
    """The same, kept: no load, section or material changes them."""
    families = {d: one for d, one, _ in asked}
    slices = {d: slice(start, start + one.n) for d, one, start in asked}
    n, x = _width(slices), np.frombuffer(at)
    G = np.zeros((len(x), len(rows), n, n))
    if len(x) == 0:
        return G
    integral = _Integral(families, x)
    s, F = integral.s, {d: family.evaluate(integral.s) for d, family in families.items()}

    def add(row: int, a: str, b: str, block: Array) -> None:
        """Put the bilinear form eta_a' block eta_b into 1/2 eta' G eta of a row."""
        if row in rows:
            at = rows.index(row)
            G[:, at, slices[a], slices[b]] += block
            G[:, at, slices[b], slices[a]] += np.swapaxes(block, 1, 2)

    for d, own, across, turn, sign in (("v", 1, 2, 4, 1.0), ("w", 2, 1, 3, -1.0)):
        if d not in F:
            continue
        rot, df, curv = F[d].rot, F[d].df, F[d].curv
        shear = df - rot if families[d].shear else None
        # -rot v' + rot^2 / 2 = -v'^2 / 2 + (v' - rot)^2 / 2
        shortening = integral(df, df)
        if shear is not None:
            shortening -= integral(shear, shear)
        add(0, d, d, -0.5 * shortening)
        if "u" in F:
            add(own, d, "u", integral(rot, F["u"].df))
        if "p" in F:
            p = F["p"].f
            turning = integral(curv, p)
            add(turn, d, "p", -turning)
            drift = x[:, None, None] * turning - integral(curv, p, s)
            if shear is not None:
                drift += integral(shear, p)
            add(across, d, "p", sign * drift)
    if "v" in F and "w" in F:
        add(5, "v", "w", -integral(F["v"].curv, F["w"].rot))
    G.flags.writeable = False  # others look at it, too
    return G


class _Integral:
    """Integrals from the root to positions x (m), shape (nx,), of products of two fields.

    Attributes:
        s: Points (m) at which the fields are to be given, shape (ns,).
    """

    def __init__(self, families: Mapping[str, Family], x: Array) -> None:
        breaks = union([f.breaks for f in families.values()])
        knots = distinct(breaks, x)
        points, self._weights = quadrature(knots, max(f.gauss for f in families.values()))
        self.s, self._last = points.ravel(), np.searchsorted(knots, x)

    def __call__(self, left: Array, right: Array, factor: Array | None = None) -> Array:
        """Integral of left_i right_j factor, shape (nx, ni, nj)."""
        pieces, weights = self._weights.shape, self._weights
        if factor is not None:
            weights = weights * factor.reshape(pieces)
        weighted = left.reshape(*pieces, -1) * weights[..., None]
        parts = np.swapaxes(weighted, 1, 2) @ right.reshape(*pieces, -1)
        total = np.zeros((pieces[0] + 1, *parts.shape[1:]))
        np.cumsum(parts, axis=0, out=total[1:])
        return np.asarray(total[self._last])


def _width(slices: Mapping[str, slice]) -> int:
    return max(int(at.stop) for at in slices.values())


# Stiffness, mass and damping of a beam by direction; its static end shapes and modes.


def bending(section: Section, direction: str) -> tuple[float, float]:
    """Second moment [m^4] and shear factor of bending."""
    return (section.Iz, section.ky) if direction == "v" else (section.Iy, section.kz)


def beam_energy(
    link: FlexibleLink, direction: str, family: Family, rho: float
) -> tuple[Array, Array, bool]:
    """Stiffness and mass matrix of one direction, end masses included, each (n, n).

    And whether they are those of a plain bar, see `plain_shapes`, but for their units.
    """
    section, E, G = link.section, link.material.E, link.material.G
    bends, along = direction in BENDING, rho * section.A
    if bends:
        second, k = bending(section, direction)
        spin = rho * section.turning[direction == "v"] * (link.rotary_inertia is True)
        shear = k * G * section.A * family.shear
        stiffness, plain = E * second, not (spin or shear)
    else:
        shear, plain = 0.0, True
        stiffness, along, spin = (
            (E * section.A, along, 0.0)
            if direction == "u"
            else (G * section.J, 0.0, rho * section.Ip)
        )
    bent, slid, moved, turned = _integrals(family)
    K, M = stiffness * bent + shear * slid, along * moved + spin * turned
    axis = {"p": 0, "w": 1, "v": 2}.get(direction)
    for end, at in ((link.root, 0.0), (link.tip, family.length)):
        # One body stands for every segment of a link that is cut; none of them owns the ends.
        if end is not None and link.segments == 1:
            F, plain = family.evaluate(np.array([at])), False
            turn = 0.0 if axis is None else end.inertia[axis]
            M += (direction != "p") * end.mass * F.f.T @ F.f + turn * F.rot.T @ F.rot
    return K, M, plain


@lru_cache(maxsize=64)
def _integrals(family: Family) -> tuple[Array, ...]:
    """Integrals of curv' curv, (df - rot)' (df - rot), f' f and rot' rot, each (n, n)."""
    x, weights = quadrature(family.breaks, family.gauss)
    F, w = family.evaluate(x.ravel()), weights.ravel()[:, None]
    each = (F.curv, F.df - F.rot if family.shear else 0.0 * F.f, F.f, F.rot)
    found = tuple(field.T @ (w * field) for field in each)
    return tuple(0.5 * (x + x.T) for x in found)


@lru_cache(maxsize=64)
def plain_shapes(family: Family, direction: str, internal: int) -> tuple[Family, Array]:
    """The end shapes and modes of `craig_bampton` for a bar without shear, ends or turning mass.

    They do not depend on its section or material. Returns the new functions, and T.
    """
    K, _, moved, turned = _integrals(family)
    T, names = craig_bampton(family, direction, K, turned if direction == "p" else moved, internal)
    return combine(family, T, names), T


def craig_bampton(
    family: Family, direction: str, K: Array, M: Array, internal: int
) -> tuple[Array, tuple[str, ...]]:
    """Static tip shapes and the lowest modes with the tip held, from a family clamped at its root.

    Returns:
        T (n, m), such that the new functions are f @ T, and their names. The end shapes have unit
        tip displacement or rotation; the modes have int f^2 dx = L.
    Source: Craig, Bampton (1968).
    """
    tip = family.evaluate(np.array([family.length]))
    B = np.vstack([tip.f, tip.rot]).T if direction in BENDING else tip.f.T
    compliance = np.linalg.solve(K, B)
    static = compliance @ np.linalg.inv(B.T @ compliance)
    held = np.linalg.qr(B, mode="complete")[0][:, B.shape[1] :]
    # Eigenvectors of K^-1 M, not of M^-1 K: the lowest modes are then the accurate ones.
    root = np.linalg.inv(np.linalg.cholesky(held.T @ K @ held))
    modes = held @ root.T @ np.linalg.eigh(root @ (held.T @ M @ held) @ root.T)[1][:, ::-1]
    modes = modes[:, :internal]
    x, weights = quadrature(family.breaks, family.gauss)
    shapes = family.evaluate(np.append(x.ravel(), 0.0))
    norm = np.sqrt(weights.ravel() @ (shapes.f[:-1] @ modes) ** 2 / family.length)
    start = shapes.curv[-1] @ modes  # the first lobe is positive
    names = ("tip", "slope")[: B.shape[1]] + tuple(str(k + 1) for k in range(modes.shape[1]))
    return np.hstack([static, modes * np.where(start < 0.0, -1.0, 1.0) / norm]), names


# Damping of a body from its stiffness and mass: Rayleigh's two terms and a ratio of every mode.


def damping(
    link: FlexibleLink, places: Mapping[str, slice | IntArray], K: Array, M: Array
) -> Array:
    """Damping matrix of a body, direction by direction, from its stiffness and mass, (n, n)."""
    alpha, beta = link.rayleigh
    D, every = np.zeros_like(K), np.arange(len(K))
    for place in places.values():
        at = np.ix_(every[place], every[place])
        D[at] = alpha * M[at] + beta * K[at]
        if link.modal_damping:
            D[at] += modal_damping(K[at], M[at], link.modal_damping)
    return D


def modal_damping(K: Array, M: Array, ratio: float) -> Array:
    """D = M V diag(2 zeta omega) V' M of the modes V held at the root, V' M V = 1."""
    L = np.linalg.cholesky(M)
    half = np.linalg.solve(L, K)
    squares, U = np.linalg.eigh(np.linalg.solve(L, half.T))
    MV = L @ U
    return np.asarray(MV * (2.0 * ratio * np.sqrt(np.maximum(squares, 0.0))) @ MV.T)
