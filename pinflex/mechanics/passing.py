"""The rows of a sleeve on a link that is cut into segments, with their exact derivatives.

On the curve r(s), with the sections' axes t, n_y, n_z = R(s) (`pinflex.mechanics.guide`), frame b
at p stands before the section s for which (p - r) . t = 0. There, for n_y (and n_z likewise),

    hold    (p - r) . n_y           right, left  (r(s+-) - r) . n_y,    (r(s+-) - r) . t = +- a
    tilt    e_x . n_y               pivot        right + left           twist   e_y . n_z

(e_x, e_y: axes of b). To second order these are the rows of one body (`pinflex.mechanics.slider`).
No row knows in which segment's frame it is written: where a sleeve passes from one segment to the
next, residual, Jacobian and multipliers go on without a jump, and no event is needed.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.guide import Guide
from pinflex.mechanics.jets import Jet, constant, dot, eliminated, stacked
from pinflex.mechanics.poses import skew

if TYPE_CHECKING:
    from pinflex.mechanics.slider import Contact

_P, _X, _Y, _FIRST = slice(1, 4), slice(4, 7), slice(7, 10), 10  # variables: s, p, e_x, e_y, eta
_SIDES = {"right": (1,), "left": (-1,), "pivot": (-1, 1)}
_NORMAL = {"v": 1, "w": 2}


class PassingRows:
    """The rows of one sleeve, written for one segment.

    Attributes:
        rows: Among the closure rows. loop: Of the sleeve.
    """

    def __init__(self, contact: Contact) -> None:
        self.contact, self.rows, self.loop = contact, contact.rows, contact.loop
        sorts = [sort for sort, _ in contact.sleeve.sorts]
        self.turning: IntArray = np.flatnonzero([sort in ("tilt", "twist") for sort in sorts])
        self.about = np.array([int(sorts[k] == "twist") for k in self.turning], dtype=np.intp)

    def at(self, frame_a: Array, frame_b: Array, arm: Array, eta: Array) -> PassingState:
        """The rows at one state.

        Args:
            As `ContactRows.at`.
        """
        return PassingState(self, frame_a, frame_b, arm, eta)


class PassingState:
    """The rows of one sleeve at one state, their Jacobians and second derivatives.

    Attributes:
        rows, loop: As in `PassingRows`. place: Where on the link the sleeve is (m).
        value: h, shape (rows,). W: By the relative twist at the world origin, (rows, 6).
        eta: Elastic coordinates of the rows, shape (n,). by_eta: dh/deta by them, (rows, n).
    """

    def __init__(
        self, rows: PassingRows, frame_a: Array, frame_b: Array, arm: Array, eta: Array
    ) -> None:
        """As `ContactRows.at`."""
        self._of, self.rows, self.loop, self._width = rows, rows.rows, rows.loop, len(eta)
        self.sleeve = rows.contact.sleeve
        self._R, self._arm, self._axes = frame_a[:, :3], arm, frame_b[:, :2].T
        self._here = np.vstack([frame_b[:, 3] - frame_a[:, 3], self._axes]) @ self._R
        self._guide = guide = Guide(self.sleeve, rows.contact.on, eta, _FIRST)
        self._s = self._foot()
        self.place = guide.segment(guide.on).offset + self._s
        self._ends = self._find_ends()
        self.eta = guide.eta
        h = self._evaluate(second=False)
        self.value, self.by_eta = h.value, h.grad[:, _FIRST:]
        self._normal = {k: h.grad[:, at] @ self._R.T for k, at in ((0, _X), (1, _Y))}
        push = h.grad[:, _P] @ self._R.T
        self.W = np.hstack([push, push @ arm.T])
        for axis, normal in self._normal.items():
            self.W[:, 3:] += np.cross(self._axes[axis], normal)

    def _foot(self) -> float:
        """s of the section that frame b stands before."""
        guide, s = self._guide, float(self._here[0, 0])
        for _ in range(20):
            r = guide.curve(guide.on, s, False)
            t = guide.turn(guide.on, s, False)
            gap = self._here[0] - r.value
            slope = gap @ t.grad[:, 0, 0] - t.value[:, 0] @ r.grad[:, 0]
            step = -float(gap @ t.value[:, 0]) / slope
            s += step
            if abs(step) < 1e-7 * guide.segment(guide.on).length:  # Newton: its square is left
                break
        return s

    def _find_ends(self) -> dict[int, tuple[int, float]]:
        """Segment and s of both ends of the sleeve."""
        if not self.sleeve.half:
            return {}
        guide, on, half = self._guide, self._guide.on, self.sleeve.half
        r = guide.place(on, self._s)[0]
        t = guide.turn(on, self._s, False).value[:, 0]
        low = on > 0 and t @ r < half
        high = on + 1 < len(self.sleeve.segments) and t @ (guide.tip(on) - r) < half
        found = {}
        for side, number in ((-1, on - int(low)), (1, on + int(high))):
            guide.reach(number)
            found[side] = (number, guide.ahead(number, t, float(t @ r) + side * half))
        return found

    def _evaluate(self, second: bool) -> Jet:
        """h by (s, p, e_x, e_y, eta); nothing depends on s."""
        guide, m = self._guide, self._guide.m
        r = guide.curve(guide.on, self._s, second)
        turn = guide.turn(guide.on, self._s, second).transposed
        axes = []
        for value, at in zip(self._here, (_P, _X, _Y), strict=True):
            axes.append(constant(value, m, second))
            axes[-1].grad[:, at] = np.eye(3)
        p, e_x, e_y = axes
        foot = dot(p - r, turn[0])
        t, n_y, n_z, r = (eliminated(part, foot) for part in (*(turn[k] for k in range(3)), r))
        normals = {1: n_y, 2: n_z}
        ends = {side: self._end(side, r, t, second) - r for side in self._ends}
        made = []
        for sort, direction in self.sleeve.sorts:
            n = normals[_NORMAL[direction]]
            if sort == "hold":
                made.append(dot(p - r, n))
            elif sort == "tilt":
                made.append(dot(e_x, n))
            elif sort == "twist":
                made.append(dot(e_y, n_z))
            else:
                parts = [dot(ends[side], n) for side in _SIDES[sort]]
                made.append(parts[0] if len(parts) == 1 else parts[0] + parts[1])
        return stacked(made)

    def _end(self, side: int, r: Jet, t: Jet, second: bool) -> Jet:
        """The beam at the distance +-a along the tangent t in r."""
        number, s = self._ends[side]
        there = self._guide.seen(number, s, second)
        reach = constant(np.array(side * self.sleeve.half), self._guide.m, second)
        return eliminated(there, dot(there - r, t) - reach)

    @cached_property
    def _hess(self) -> Array:
        """Of h by (p, e_x, e_y, eta), shape (rows, 9 + n, 9 + n)."""
        hess = self._evaluate(second=True).hess
        assert hess is not None
        return hess[:, 1:, 1:]

    def bias(
        self, spin_a: Array, spin_b: Array, v_ab: Array, swept: Array, gap: Array, rate: Array
    ) -> tuple[Array, Array]:
        """Time derivative of W (rows, 6), and of by_eta times the elastic rates, (rows,).

        Args:
            As `ContactState.bias`.
        """
        R = self._R
        turns = (spin_b - spin_a) @ self._axes.T
        moved = np.concatenate([R.T @ (v_ab - spin_a @ gap), R.T @ turns[:, 0], R.T @ turns[:, 1],
                                rate[self.eta]])  # fmt: skip
        grown = self._hess @ moved
        push = self.W[:, :3] @ spin_a.T + grown[:, 0:3] @ R.T
        out = np.zeros_like(self.W)
        out[:, :3] = push
        out[:, 3:] = self.W[:, :3] @ swept.T + push @ self._arm.T
        for axis, normal in self._normal.items():
            e = self._axes[axis]
            changed = normal @ spin_a.T + grown[:, 3 + 3 * axis : 6 + 3 * axis] @ R.T
            out[:, 3:] += np.cross(spin_b @ e, normal) + np.cross(e, changed)
        return out, grown[:, _FIRST - 1 :] @ rate[self.eta]

    def turning_stiffness(self, lam: Array) -> tuple[Array, Array]:
        """What the moments of fixed sleeves change by when b turns against a: on B, on A, (3, 3).

        Args:
            lam: Multipliers of all closure rows.
        """
        on_b, on_a = np.zeros((3, 3)), np.zeros((3, 3))
        for axis, normal in self._normal.items():
            e, n = skew(self._axes[axis][None])[0], skew((lam[self.rows] @ normal)[None])[0]
            on_b += e @ n
            on_a += n @ e
        return on_b, on_a

    def add_tangent(self, total: Array, lam: Array, J_rel: Array) -> None:
        """Add what the moving contact changes in J' lam.

        Args:
            total: d(J' lam)/dy, shape (nv, nv). lam: Multipliers of all closure rows.
            J_rel: Relative twist of b to a by v, shape (6, nv).
        """
        Z = np.zeros((_FIRST - 1 + len(self.eta), len(total)))
        Z[0:3] = self._R.T @ (J_rel[:3] - self._arm @ J_rel[3:])
        for axis in (0, 1):
            turn = skew(self._axes[axis][None])[0]
            Z[3 + 3 * axis : 6 + 3 * axis] = -self._R.T @ turn @ J_rel[3:]
        at = len(total) - self._width + self.eta  # where the elastic coordinates stand in v
        Z[np.arange(_FIRST - 1, len(Z)), at] = 1.0
        total += Z.T @ np.tensordot(lam[self.rows], self._hess, 1) @ Z

    def forces(self, lam: Array) -> Array:
        """What the sleeve does to the beam: (x, F, M, segment) at its ends and middle, (3, 8).

        x is from the root of the segment that the sleeve is on, whose frame F and M are in.

        Args:
            lam: Multipliers of all closure rows.
        """
        guide, push = self._guide, lam[self.rows]
        R = guide.turn(guide.on, self._s, False).value
        r = guide.place(guide.on, self._s)[0]
        out = np.zeros((3, 8))
        out[:, 0] = r[0] + self.sleeve.half * R[0, 0] * np.array([-1.0, 0.0, 1.0])
        out[:, 7] = guide.on
        e_x, e_y = self._here[1:]
        for h, (sort, direction) in zip(push, self.sleeve.sorts, strict=True):
            n = R[:, _NORMAL[direction]]
            if sort == "hold":
                out[1, 1:4] -= h * n
            elif sort in ("tilt", "twist"):
                axis = R[:, 2] if sort == "twist" else n
                out[1, 4:7] += h * np.cross(axis, e_y if sort == "twist" else e_x)
            else:
                _on_ends(out, _SIDES[sort], h, n, R[:, 0], self.sleeve.half)
        return out


def _on_ends(out: Array, sides: tuple[int, ...], h: float, n: Array, t: Array, half: float) -> None:
    """Forces of a row that holds ends of the sleeve on the tangent in its middle, or in line."""
    for side in sides:
        out[1 + side, 1:4] += h * n
        out[1, 1:4] -= h * n
    if len(sides) == 1:  # the tangent turns with the section in the middle
        out[1, 4:7] -= sides[0] * half * h * np.cross(t, n)
