"""A sleeve on a beam at one state: its rows, and what it does to the beam.

Of one body (`pinflex.mechanics.model.slider`) the sleeve stands at X, where frame b projects on the
beam's x axis; v, w and the twist psi are of first order:

    hold    Y - v(X)                  right, left   v(X +- a) - v(X) -+ a v'(X)
    tilt    e_x . n_y                 twist         e_y . n_z
    n_y = (-v', 1, psi),  n_z = (-w', -psi, 1)

Of a link in segments the beam is the curve r(s) of the sections as they are in space, with their
axes t, n_y, n_z. Frame b at p stands before the section s for which (p - r) . t = 0. There

    hold    (p - r) . n_y             right, left   (r(s+-) - r) . n_y,   (r(s+-) - r) . t = +- a

and tilt and twist as above. No row knows in which segment's frame it is written: where a sleeve
passes from one segment to the next nothing jumps. `pivot` is right + left, `chord` is Y.

Arrays begin with an axis of k points: the state itself, and complex ones near it, by which
`pinflex.mechanics.reference.closures` finds derivatives: every row is analytic in what it is of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.track import ORDERS
from pinflex.mechanics.manifold import ACROSS
from pinflex.rotations import zyx_matrix

if TYPE_CHECKING:
    from pinflex.bodies.track import Track
    from pinflex.mechanics.closure import Contact
    from pinflex.mechanics.model.slider import Segment, Sleeve

TINY = 1e-30  # of an imaginary step, which tells a derivative to the last digit
# How far beyond the root of a segment, over its length, a sleeve is on it. The curvature jumps
# there, as between elements; a sleeve that comes to rest at a border, as round numbers have it,
# would be on either side by turns. So far the curve goes on: 1e-12 of a length off the next one.
PAST = 1e-6
_NEWTON = 20  # iterations
_MET, _BESIDE = 1e-14, 1e-7  # of the length: the last step, and those of differences


def dot(f: Array, g: Array) -> Array:
    """Sum of products along the last axis."""
    return np.asarray(np.sum(f * g, axis=-1))


def section(track: Track, x: Array, eta: Array, rows: Sequence[int], order: int = 0) -> Array:
    """Some rows of (u, v, w, rz, ry, rx), or a derivative of them by x, shape (k, rows).

    By the Taylor series about the first of places x (k,): second derivatives by them are exact.
    """
    there, away = track.at(float(x[0].real)), x - x[0].real
    found = np.zeros((len(x), len(rows)), complex)
    for j in range(min(3, ORDERS - order)):
        Phi, G = (part[order + j][list(rows)] for part in there)
        moved = eta @ Phi.T
        if G.any():
            moved = moved + 0.5 * np.einsum("rij,ki,kj->kr", G, eta, eta)
        found += moved * (away**j / factorial(j))[:, None]
    return found


class _Segment:
    """One segment of a link: its sections as functions of s, in the frame of the segment's root.

        r(s) = (s + u, v + kappa_y b, w + kappa_z b),       b = s^2 (s - l) / l^2,

    turned by R(s) = Rz(rz) Ry(ry) Rx(rx), all six to second order (`FlexibleBody.rows`): exactly as
    the expanded model has it, so that the next segment begins where this one ends. The bump b is of
    third order: with it the curve leaves the segment along the section's own x axis, which is that
    of the next segment, and whatever runs along the curve has no jump of direction there.
    """

    def __init__(self, segment: Segment, eta: Array) -> None:
        self.length, self._track, self._eta = segment.length, segment.track, eta[:, segment.eta]
        self._kappa = self._kink()

    def r(self, s: Array) -> Array:
        """Place of a section, shape (k, 3)."""
        b, place = s * s * (s - self.length) / self.length**2, np.zeros((len(s), 3), complex)
        place[:, 0] = s
        return place + section(self._track, s, self._eta, (0, 1, 2)) + self._kappa * b[:, None]

    def R(self, s: Array) -> Array:
        """Axes of a section in its columns, shape (k, 3, 3)."""
        return zyx_matrix(section(self._track, s, self._eta, (3, 4, 5)))

    @property
    def tip(self) -> Array:
        """Its last section, for all points."""
        return np.full(len(self._eta), self.length, complex)

    def _kink(self) -> Array:
        """(0, kappa_y, kappa_z): what the slope of (u, v, w) at the tip lacks of the axis there.

        Shear is no part of it: a section is not square to a beam that shears.
        """
        rate = section(self._track, self.tip, self._eta, (0, 1, 2), 1)
        a, b = section(self._track, self.tip, self._eta, (3, 4)).T
        shear, ahead = self._eta @ self._track.shear.T, 1.0 + rate[:, 0]
        across = ahead * np.tan(a) - (rate[:, 1] - shear[:, 0])
        down = -ahead * np.tan(b) / np.cos(a) - (rate[:, 2] - shear[:, 1])
        return np.stack([0.0 * across, across, down], axis=1)


class Curve:
    """A link's curve before which a sleeve stands.

    Attributes:
        at: Where on the link that is (m). r, R: Place and axes of the section there.
    """

    def __init__(self, sleeve: Sleeve, on: int, p: Array, eta: Array) -> None:
        self._sleeve, self._on, self._eta, self._p = sleeve, on, eta, p
        here = _Segment(sleeve.segments[on], eta)
        s = _root(lambda s: dot(p - here.r(s), here.R(s)[:, :, 0]), p[:, 0], here.length)
        self.at = sleeve.segments[on].offset + float(s[0].real)
        self.r, self.R = here.r(s), here.R(s)

    def off(self, axis: int) -> Array:
        """Distance of the frame from the curve along an axis of the section."""
        return dot(self._p - self.r, self.normal(axis))

    def normal(self, axis: int) -> Array:
        """Axis of the section."""
        return self.R[:, :, axis]

    def end(self, side: int, axis: int) -> Array:
        """Distance of the curve at an end of the sleeve from the tangent in its middle."""
        half, t, number = self._sleeve.half, self.R[:, :, 0], self._reached(side)
        there, length = self._seen(number), self._sleeve.segments[number].length
        guess = self.r[:, 0] + side * half if number == self._on else 0.0 * self.r[:, 0]
        s = _root(lambda s: dot(there(s) - self.r, t) - side * half, guess, length)
        return dot(there(s) - self.r, self.normal(axis))

    def _reached(self, side: int) -> int:
        """Number of the segment that an end of the sleeve is on."""
        on, half, r, t = self._on, self._sleeve.half, self.r[0].real, self.R[0, :, 0].real
        if side < 0:
            return on - int(on > 0 and t @ r < half)
        if on + 1 == len(self._sleeve.segments):
            return on
        last = _Segment(self._sleeve.segments[on], self._eta[:1])
        return on + int(t @ (last.r(last.tip)[0].real - r) < half)

    def _seen(self, number: int) -> Callable[[Array], Array]:
        """r(s) of this segment or a neighbour in this one's frame."""
        there = _Segment(self._sleeve.segments[number], self._eta)
        if number == self._on:
            return there.r
        first = _Segment(self._sleeve.segments[min(number, self._on)], self._eta)
        R, origin = first.R(first.tip), first.r(first.tip)
        if number > self._on:
            return lambda s: (R @ there.r(s)[:, :, None])[:, :, 0] + origin
        return lambda s: ((there.r(s) - origin)[:, None] @ R)[:, 0]


def _root(f: Callable[[Array], Array], guess: Array, length: float) -> Array:
    """s (k,) with f(s) = 0, by Newton with slopes by differences."""
    s, h = np.full(len(guess), guess[0].real, complex), _BESIDE * length
    for _ in range(_NEWTON):
        now = f(s)
        step = h * now / (f(s + h) - now)
        s = s - step
        if np.abs(step).max() < _MET * length:
            break
    return s


_AXES = {"v": 1, "w": 2}
_SIDES = {"right": (1,), "left": (-1,), "pivot": (-1, 1)}
_SIZE = 9  # of g: v at X - a, X, X + a and v' at X, the same of w, and psi


class Place:
    """A sleeve's place on its beam.

    Attributes:
        at: Where on the link (m).
    """

    def __init__(self, contact: Contact, a: Array, b: Array, eta: Array) -> None:
        """`a`, `b`: axes and origin of the beam's and the sleeve's frame, (k, 4, 3)."""
        self._sleeve, self._on = contact.sleeve, contact.on
        apart = [b[:, 3] - a[:, 3], b[:, 0], b[:, 1]]
        # p, e_x, e_y in the beam's frame
        self._seen = [(a[:, :3] @ x[:, :, None])[:, :, 0] for x in apart]
        self._line = _line(contact, self._seen[0], eta)
        self.at = self._line.at

    def rows(self) -> Array:
        """What the sleeve leaves open, shape (k, rows)."""
        return _rows(self._sleeve, self._line, self._seen)

    def forces(self, lam: Array) -> Array:
        """What the sleeve does to the beam: (x, F, M, segment) at its ends and middle, (3, 8).

        x is from the root of the segment that the sleeve is on, whose frame F and M are in.
        """
        if isinstance(self._line, _Bent):
            return self._on_one_body(self._line, lam)
        e_x, e_y = (x[0].real for x in self._seen[1:])
        half, out = self._sleeve.half, np.zeros((3, 8))
        r, R = self._line.r[0].real, self._line.R[0].real
        out[:, 0] = r[0] + half * R[0, 0] * np.array([-1.0, 0.0, 1.0])
        out[:, 7] = self._on
        for h, (sort, direction) in zip(lam, self._sleeve.sorts, strict=True):
            n = R[:, _AXES[direction]]
            if sort == "hold":
                out[1, 1:4] -= h * n
            elif sort == "twist":
                out[1, 4:7] += h * np.cross(R[:, 2], e_y)
            elif sort == "tilt":
                out[1, 4:7] += h * np.cross(n, e_x)
            else:
                for side in _SIDES[sort]:
                    out[1 + side, 1:4] += h * n
                    out[1, 1:4] -= h * n
                if sort != "pivot":  # the tangent turns with the section in the middle
                    out[1, 4:7] -= _SIDES[sort][0] * half * h * np.cross(R[:, 0], n)
        return out

    def _on_one_body(self, line: _Bent, lam: Array) -> Array:
        """The same: g takes the derivatives of the rows by it, the place X that by X."""
        still = [np.tile(x[0], (_SIZE, 1)) for x in self._seen]
        g = np.asarray(line.g[0] + 1j * TINY * np.eye(_SIZE))
        by_g = _Bent(still[0], line.half, g, line.slopes)
        on = _rows(self._sleeve, by_g, still).imag @ lam / TINY
        out = np.zeros((3, 8))
        out[:, 0] = self.at + line.half * np.array([-1.0, 0.0, 1.0])
        out[:, 2], out[:, 3] = on[0:3], on[4:7]
        out[1, 1] = -on @ line.slopes
        out[1, 4], out[1, 5], out[1, 6] = on[8], -on[7], on[3]
        return out


def _rows(sleeve: Sleeve, line: _Bent | Curve, seen: list[Array]) -> Array:
    p, e_x, e_y = seen

    def row(sort: str, axis: int) -> Array:
        if sort == "hold":
            return line.off(axis)
        if sort == "chord":
            return p[:, axis]
        if sort == "tilt":
            return dot(e_x, line.normal(axis))
        if sort == "twist":
            return dot(e_y, line.normal(2))
        return np.asarray(sum(line.end(side, axis) for side in _SIDES[sort]))

    return np.stack([row(sort, _AXES[direction]) for sort, direction in sleeve.sorts], axis=1)


def _line(contact: Contact, p: Array, eta: Array) -> _Bent | Curve:
    sleeve = contact.sleeve
    if sleeve.segments:
        return Curve(sleeve, contact.on, p, eta)
    if sleeve.track is None:  # a straight beam
        return _Bent(p, sleeve.half, np.zeros((len(p), _SIZE)), np.zeros(_SIZE))
    bent = _deflections(sleeve.track, p[:, 0], eta[:, sleeve.eta], sleeve.half)
    return _Bent(p, sleeve.half, *bent)


def _deflections(track: Track, X: Array, eta: Array, half: float) -> tuple[Array, Array]:
    """g (k, 9), and its derivative by X alone, shape (9,)."""

    def found(more: int) -> Array:
        places = (-half, 0), (0.0, 0), (half, 0), (0.0, 1)
        every = [section(track, X + x, eta, ACROSS, order + more) for x, order in places]
        return np.stack([*(at[:, k] for k in (0, 1) for at in every), every[1][:, 2]], axis=1)

    return found(0), found(1)[0].real


class _Bent:
    """A beam of one body, to first order.

    Attributes:
        at: X (m). half: Of the sleeve's length (m). g: Its deflections, see `_SIZE`, (k, 9).
        slopes: Their derivatives by X, shape (9,).
    """

    def __init__(self, p: Array, half: float, g: Array, slopes: Array) -> None:
        self._p, self.half, self.g, self.slopes = p, half, g, slopes
        self.at = float(p[0, 0].real)

    def off(self, axis: int) -> Array:
        """Distance of the frame from the beam along y or z."""
        return self._p[:, axis] - self.g[:, 4 * axis - 3]

    def end(self, side: int, axis: int) -> Array:
        """Distance of the beam at an end of the sleeve from the tangent in its middle."""
        before, here, after, slope = self.g[:, 4 * (axis - 1) : 4 * axis].T
        return np.asarray((after if side > 0 else before) - here - side * self.half * slope)

    def normal(self, axis: int) -> Array:
        """Axis of the section."""
        slope, psi = -self.g[:, 4 * axis - 1], self.g[:, 8]
        one = np.ones_like(psi)
        return np.stack([slope, one, psi] if axis == 1 else [slope, -psi, one], axis=1)
