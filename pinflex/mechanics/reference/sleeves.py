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
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.manifold import ACROSS

if TYPE_CHECKING:
    from pinflex.bodies.track import Track
    from pinflex.mechanics.closure import Contact
    from pinflex.mechanics.model.slider import Segment, Sleeve


# Arrays with their first and second derivatives along each of m variables.


@dataclass(frozen=True, eq=False)
class Jet:
    """An array and its derivatives along each variable by itself.

    Attributes:
        value: Shape (...). grad, bend: First and second derivatives, shape (..., m).
    """

    value: Array
    grad: Array
    bend: Array

    def __getitem__(self, at: Any) -> Jet:
        return Jet(self.value[at], self.grad[at], self.bend[at])

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.value + other.value, self.grad + other.grad, self.bend + other.bend)

    def __sub__(self, other: Jet) -> Jet:
        return self + other.times(-1.0)

    def times(self, factor: float) -> Jet:
        """The array times a number."""
        return Jet(factor * self.value, factor * self.grad, factor * self.bend)

    def plus(self, constant: float | Array) -> Jet:
        """The array plus constants."""
        return Jet(self.value + constant, self.grad, self.bend)

    def over(self, factors: Array) -> Jet:
        """The array over constants of its own shape."""
        each = factors[..., None]
        return Jet(self.value / factors, self.grad / each, self.bend / each)


def constant(value: Any, m: int = 1) -> Jet:
    """An array that depends on none of m variables."""
    value = np.asarray(value, dtype=float)
    none = np.zeros((*value.shape, m))
    return Jet(value, none, none)


def product(rule: str, f: Jet, g: Jet) -> Jet:
    """A product of two arrays by a rule of `numpy.einsum`, which does not name m."""
    (a, b), out = rule.split("->")[0].split(","), rule.split("->")[1]

    def first(x: Array, y: Array) -> Array:
        return np.asarray(np.einsum(f"{a}m,{b}->{out}m", x, y))

    def second(x: Array, y: Array) -> Array:
        return np.asarray(np.einsum(f"{a},{b}m->{out}m", x, y))

    both = np.einsum(f"{a}m,{b}m->{out}m", f.grad, g.grad)
    return Jet(
        np.asarray(np.einsum(rule, f.value, g.value)),
        first(f.grad, g.value) + second(f.value, g.grad),
        first(f.bend, g.value) + second(f.value, g.bend) + both + both,
    )


def dot(f: Jet, g: Jet) -> Jet:
    """Sum of products along the last axis."""
    return product("...i,...i->...", f, g)


def stacked(parts: Sequence[Jet]) -> Jet:
    """One array of several, along a new first axis."""
    return Jet(*(np.array([getattr(part, x) for part in parts]) for x in _PARTS))


def joined(parts: Sequence[Jet]) -> Jet:
    """One array of several, along the first axis."""
    return Jet(*(np.concatenate([getattr(part, x) for part in parts]) for x in _PARTS))


_PARTS = ("value", "grad", "bend")


def function(value: Array, first: Array, second: Array, of: Jet) -> Jet:
    """f(z) by its value (...), its derivatives (..., p) and (..., p, p) there, and z (p,)."""
    curved = np.einsum("pm,...pq,qm->...m", of.grad, second, of.grad)
    return Jet(np.asarray(value), first @ of.grad, curved + first @ of.bend)


def scalar(f: float, df: float, ddf: float, of: Jet) -> Jet:
    """A function of a number, by its value and derivatives there."""
    return Jet(np.asarray(f), df * of.grad, df * of.bend + ddf * of.grad**2)


def turn_about(axis: int, angle: Jet) -> Jet:
    """The rotation (3, 3) about a coordinate axis by an angle [rad]."""
    a = float(angle.value)
    cos, sin = (
        scalar(np.cos(a), -np.sin(a), -np.cos(a), angle),
        scalar(np.sin(a), np.cos(a), -np.sin(a), angle),
    )
    one, nil = constant(1.0, len(angle.grad)), constant(0.0, len(angle.grad))
    rows = [[nil] * 3 for _ in range(3)]
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows[axis][axis] = one
    rows[i][i] = rows[j][j] = cos
    rows[j][i], rows[i][j] = sin, sin.times(-1.0)
    return stacked([stacked(row) for row in rows])


# The curve of a link cut into segments, in the frame of the one that a sleeve stands on.
#
# The section at s of a segment sits, in the frame of the segment's root, at
#
#     r(s) = (s + u, v + kappa_y b, w + kappa_z b),       b = s^2 (s - l) / l^2,
#
# and is turned by R(s) = Rz(rz) Ry(ry) Rx(rx), all six to second order (`FlexibleBody.rows`):
# exactly as the expanded model has it, so that the next segment begins where this one ends. The
# bump b is of third order: with it the curve leaves the segment along the section's own x axis,
# which is that of the next segment, and whatever runs along the curve has no jump of direction
# there.

# How far beyond the root of a segment, over its length, a sleeve is on it. The curvature jumps
# there, as between elements; a sleeve that comes to rest at a border, as round numbers have it,
# would be on either side by turns. So far the curve goes on: 1e-12 of a length off the next one.
PAST = 1e-6
_NEWTON, _MET = 20, 1e-9  # iterations, and the last step over the length: its square is left


def section(track: Track, x: Jet, eta: Jet, rows: Sequence[int], order: int) -> Jet:
    """Some rows of (u, v, w, rz, ry, rx), or a derivative of them by x, shape (rows,)."""
    there, z = track.at(float(x.value)), joined([stacked([x]), eta])
    # Of order 3 the derivative is zero in one of third degree: nothing asks for more.
    at = slice(order, order + 3)
    Phi, G = (np.zeros((3, len(rows), *part.shape[2:])) for part in there)
    Phi[: len(there.Phi[at])], G[: len(there.G[at])] = there.Phi[at][:, rows], there.G[at][:, rows]
    turned = G @ eta.value
    value, linear = (Phi + 0.5 * turned) @ eta.value, Phi + turned
    first = np.concatenate([value[1][:, None], linear[0]], axis=1)
    second = np.zeros((len(rows), len(z.value), len(z.value)))
    second[:, 0, 0], second[:, 1:, 1:] = value[2], G[0]
    second[:, 0, 1:] = second[:, 1:, 0] = linear[1]
    return function(value[0], first, second, z)


class _Segment:
    """One segment: its sections as functions of s."""

    def __init__(self, segment: Segment, eta: Jet) -> None:
        self.length, self._of, self._eta = segment.length, segment, eta[segment.eta]
        self._kappa = self._kink()

    def r(self, s: Jet) -> Jet:
        """Place of a section, shape (3,)."""
        x, length = float(s.value), self.length
        b = scalar(
            x * x * (x - length) / length**2,
            (3 * x * x - 2 * x * length) / length**2,
            (6 * x - 2 * length) / length**2,
            s,
        )
        nil = constant(0.0, len(s.grad))
        along = stacked([s, nil, nil])
        moved = section(self._of.track, s, self._eta, (0, 1, 2), 0)
        return moved + along + product("i,->i", self._kappa, b)

    def R(self, s: Jet) -> Jet:
        """Axes of a section in its columns, shape (3, 3)."""
        angles = section(self._of.track, s, self._eta, (3, 4, 5), 0)
        z, y, x = (turn_about(axis, angles[k]) for axis, k in ((2, 0), (1, 1), (0, 2)))
        return product("ij,jk->ik", product("ij,jk->ik", z, y), x)

    def _kink(self) -> Jet:
        """(0, kappa_y, kappa_z): what the slope of (u, v, w) at the tip lacks of the axis there.

        Shear is no part of it: a section is not square to a beam that shears.
        """
        tip, track = constant(self.length, self._eta.grad.shape[1]), self._of.track
        rate = section(track, tip, self._eta, (0, 1, 2), 1)
        angles = section(track, tip, self._eta, (3, 4), 0)
        shear = function(
            track.shear @ self._eta.value, track.shear, np.zeros((2, track.n, track.n)), self._eta
        )
        a, b = (float(x) for x in angles.value)
        tangents = [
            scalar(np.tan(x), 1 / np.cos(x) ** 2, 2 * np.tan(x) / np.cos(x) ** 2, angles[k])
            for k, x in enumerate((a, b))
        ]
        sec = 1.0 / np.cos(a)
        secant = scalar(sec, sec * np.tan(a), sec * (2 * sec**2 - 1), angles[0])
        ahead, rise = rate[0].plus(1.0), product(",->", tangents[1], secant)
        across = product(",->", ahead, tangents[0]) - (rate[1] - shear[0])
        down = product(",->", ahead, rise).times(-1.0) - (rate[2] - shear[1])
        return stacked([constant(0.0, len(across.grad)), across, down])


class Curve:
    """A link's curve before which a sleeve stands.

    Attributes:
        at: Where on the link that is (m). r, R: Place and axes of the section there.
    """

    def __init__(self, sleeve: Sleeve, on: int, p: Jet, eta: Jet) -> None:
        self._sleeve, self._on, self._eta, self._p = sleeve, on, eta, p
        here = _Segment(sleeve.segments[on], eta)
        flat_p, flat = constant(p.value), _Segment(sleeve.segments[on], constant(eta.value))

        def before(p: Jet, of: _Segment) -> Callable[[Jet], Jet]:
            return lambda s: dot(p - of.r(s), of.R(s)[:, 0])

        s = _root(before(p, here), before(flat_p, flat), float(p.value[0]), here.length, p)
        self.at = sleeve.segments[on].offset + float(s.value)
        self.r, self.R = here.r(s), here.R(s)

    def off(self, axis: int) -> Jet:
        """Distance of the frame from the curve along an axis of the section."""
        return dot(self._p - self.r, self.normal(axis))

    def normal(self, axis: int) -> Jet:
        """Axis of the section."""
        return self.R[:, axis]

    def end(self, side: int, axis: int) -> Jet:
        """Distance of the curve at an end of the sleeve from the tangent in its middle."""
        half, t = self._sleeve.half, self.R[:, 0]
        number = self._reached(side)
        there, flat = (self._seen(number, eta) for eta in (self._eta, constant(self._eta.value)))

        def ahead(r: Callable[[Jet], Jet], origin: Jet, t: Jet) -> Callable[[Jet], Jet]:
            return lambda s: dot(r(s) - origin, t).plus(-side * half)

        length = self._sleeve.segments[number].length
        guess = 0.0 if number != self._on else float(self.r.value[0]) + side * half
        s = _root(
            ahead(there, self.r, t),
            ahead(flat, constant(self.r.value), constant(t.value)),
            guess,
            length,
            t,
        )
        return dot(there(s) - self.r, self.normal(axis))

    def _reached(self, side: int) -> int:
        """Number of the segment that an end of the sleeve is on."""
        on, half, t = self._on, self._sleeve.half, self.R.value[:, 0]
        mine = constant(self._eta.value)
        if side < 0:
            return on - int(on > 0 and t @ self.r.value < half)
        if on + 1 == len(self._sleeve.segments):
            return on
        last = _Segment(self._sleeve.segments[on], mine)
        tip = last.r(constant(last.length)).value
        return on + int(t @ (tip - self.r.value) < half)

    def _seen(self, number: int, eta: Jet) -> Callable[[Jet], Jet]:
        """r(s) of this segment or a neighbour in this one's frame."""
        there = _Segment(self._sleeve.segments[number], eta)
        if number == self._on:
            return there.r
        first = _Segment(self._sleeve.segments[min(number, self._on)], eta)
        tip = constant(first.length, eta.grad.shape[1])
        R, origin = first.R(tip), first.r(tip)
        if number > self._on:
            return lambda s: product("ij,j->i", R, there.r(s)) + origin
        return lambda s: product("ji,j->i", R, there.r(s) - origin)


def _root(
    f: Callable[[Jet], Jet], flat: Callable[[Jet], Jet], guess: float, length: float, like: Jet
) -> Jet:
    """s with f(s) = 0: a number by Newton, then its derivatives, one order an iteration."""
    x, step = guess, length
    for _ in range(_NEWTON):
        found = flat(Jet(np.array(x), np.ones(1), np.zeros(1)))
        slope = float(found.grad[0])
        if abs(step) < _MET * length:  # the slope there is that of the derivatives
            break
        step = -float(found.value) / slope
        x += step
    s = constant(x, like.grad.shape[-1])
    for _ in range(2):
        s = s - f(s).times(1.0 / slope)
    return s


_AXES = {"v": 1, "w": 2}
_SIDES = {"right": (1,), "left": (-1,), "pivot": (-1, 1)}
_SIZE = 9  # of g: v at X - a, X, X + a and v' at X, the same of w, and psi


class Place:
    """A sleeve's place on its beam.

    Attributes:
        at: Where on the link (m).
    """

    def __init__(self, contact: Contact, a: Jet, b: Jet, eta: Jet) -> None:
        """`a`, `b`: axes and origin of the beam's and the sleeve's frame, (4, 3); `eta` of all."""
        self._sleeve, self._on = contact.sleeve, contact.on
        apart = [b[3] - a[3], b[0], b[1]]
        seen = [product("ji,i->j", a[:3], x) for x in apart]  # p, e_x, e_y in the beam's frame
        self._seen, self._line = seen, _line(contact, seen[0], eta)
        self.at = self._line.at

    def rows(self) -> Jet:
        """What the sleeve leaves open, shape (rows,)."""
        return _rows(self._sleeve, self._line, self._seen)

    def forces(self, lam: Array) -> Array:
        """What the sleeve does to the beam: (x, F, M, segment) at its ends and middle, (3, 8).

        x is from the root of the segment that the sleeve is on, whose frame F and M are in.
        """
        if isinstance(self._line, _Bent):
            return self._on_one_body(self._line, lam)
        e_x, e_y = (x.value for x in self._seen[1:])
        half, out = self._sleeve.half, np.zeros((3, 8))
        r, R = self._line.r.value, self._line.R.value
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
        still = [constant(x.value, _SIZE) for x in self._seen]
        g = Jet(line.g.value, np.eye(_SIZE), np.zeros((_SIZE, _SIZE)))
        by_g = _Bent(still[0], line.half, g, line.slopes)
        on = lam @ _rows(self._sleeve, by_g, still).grad
        out = np.zeros((3, 8))
        out[:, 0] = self.at + line.half * np.array([-1.0, 0.0, 1.0])
        out[:, 2], out[:, 3] = on[0:3], on[4:7]
        out[1, 1] = -on @ line.slopes
        out[1, 4], out[1, 5], out[1, 6] = on[8], -on[7], on[3]
        return out


def _rows(sleeve: Sleeve, line: _Bent | Curve, seen: list[Jet]) -> Jet:
    p, e_x, e_y = seen

    def row(sort: str, axis: int) -> Jet:
        if sort == "hold":
            return line.off(axis)
        if sort == "chord":
            return p[axis]
        if sort == "tilt":
            return dot(e_x, line.normal(axis))
        if sort == "twist":
            return dot(e_y, line.normal(2))
        ends = [line.end(side, axis) for side in _SIDES[sort]]
        return ends[0] if len(ends) == 1 else ends[0] + ends[1]

    return stacked([row(sort, _AXES[direction]) for sort, direction in sleeve.sorts])


def _line(contact: Contact, p: Jet, eta: Jet) -> _Bent | Curve:
    sleeve = contact.sleeve
    if sleeve.segments:
        return Curve(sleeve, contact.on, p, eta)
    if sleeve.track is None:  # a straight beam
        return _Bent(p, sleeve.half, constant(np.zeros(_SIZE), p.grad.shape[1]), np.zeros(_SIZE))
    return _Bent(p, sleeve.half, *_deflections(sleeve.track, p[0], eta[sleeve.eta], sleeve.half))


def _deflections(track: Track, X: Jet, eta: Jet, half: float) -> tuple[Jet, Array]:
    """g, and its derivative by X alone, shape (9,)."""
    parts, slopes = [], []
    for row in ACROSS[:2]:
        at = [(shift * half, 0) for shift in (-1.0, 0.0, 1.0)] + [(0.0, 1)]
        parts += [section(track, X.plus(shift), eta, [row], order)[0] for shift, order in at]
        slopes += [section(track, X.plus(x), eta, [row], order + 1)[0].value for x, order in at]
    parts.append(section(track, X, eta, [ACROSS[2]], 0)[0])
    slopes.append(section(track, X, eta, [ACROSS[2]], 1)[0].value)
    return stacked(parts), np.array(slopes)


class _Bent:
    """A beam of one body, to first order.

    Attributes:
        at: X (m). half: Of the sleeve's length (m). g: Its deflections, see `_SIZE`.
        slopes: Their derivatives by X, shape (9,).
    """

    def __init__(self, p: Jet, half: float, g: Jet, slopes: Array) -> None:
        self._p, self.half, self.g, self.slopes = p, half, g, slopes
        self.at = float(p.value[0])

    def off(self, axis: int) -> Jet:
        """Distance of the frame from the beam along y or z."""
        return self._p[axis] - self.g[4 * axis - 3]

    def end(self, side: int, axis: int) -> Jet:
        """Distance of the beam at an end of the sleeve from the tangent in its middle."""
        first = 4 * (axis - 1)
        slope = self.g[first + 3].times(side * self.half)
        return self.g[first + 1 + side] - self.g[first + 1] - slope

    def normal(self, axis: int) -> Jet:
        """Axis of the section."""
        slope, psi = self.g[4 * axis - 1].times(-1.0), self.g[8]
        one = constant(1.0, len(slope.grad))
        return stacked([slope, one, psi] if axis == 1 else [slope, psi.times(-1.0), one])
