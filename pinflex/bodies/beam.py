"""Kinematics of a beam to second order: how a section moves and turns with the coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.family import Family, quadrature

# First-order rows: (row, direction, field, sign), with rz = v', ry = -w', rx = p.
_FIRST_ORDER = (
    (0, "u", "f", 1.0),
    (1, "v", "f", 1.0),
    (2, "w", "f", 1.0),
    (3, "v", "rot", 1.0),
    (4, "w", "rot", -1.0),
    (5, "p", "f", 1.0),
)


def union(breaks: Sequence[Array]) -> Array:
    """Sorted points of all, without those that differ by rounding only."""
    points = np.unique(np.concatenate(breaks))
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
    """Second-order rows of (u, v, w, rz, ry, rx) at x.

    With a, b the bending rotations (rv, -rw), g the shear strains and integrals from 0 to x,

        rz:  -int rw' p            ry:  -int rv' p            rx:  -int rv' rw
        u:   -int rv v' + int rv^2 / 2, and the same in w;  -1/2 int v'^2 without shear
        v:   int (-int rw' p + u' rv - p gw)      w:   int (int rv' p + u' rw + p gv)

    which expands R' = R kappa^, r' = R (1 + u', gv, gw) for R = Rz(rz) Ry(ry) Rx(rx). A double
    integral is taken as int int h = x int h - int s h.

    Returns:
        Shape (nx, len(rows), n, n), symmetric in the last two.
    """
    n = _width(slices)
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
    return G


class _Integral:
    """Integrals from the root to positions x (m), shape (nx,), of products of two fields.

    Attributes:
        s: Points (m) at which the fields are to be given, shape (ns,).
    """

    def __init__(self, families: Mapping[str, Family], x: Array) -> None:
        breaks = union([f.breaks for f in families.values()])
        knots = np.unique(np.concatenate([breaks, x]))
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
