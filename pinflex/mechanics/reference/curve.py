"""The curve of a link cut into segments, in the frame of the one that a sleeve stands on.

The section at s of a segment sits, in the frame of the segment's root, at

    r(s) = (s + u, v + kappa_y b, w + kappa_z b),       b = s^2 (s - l) / l^2,

and is turned by R(s) = Rz(rz) Ry(ry) Rx(rx), all six to second order (`FlexibleBody.rows`): exactly
as the expanded model has it, so that the next segment begins where this one ends. The bump b is of
third order: with it the curve leaves the segment along the section's own x axis, which is that of
the next segment, and whatever runs along the curve has no jump of direction there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.mechanics.reference.jets import (
    Jet,
    constant,
    dot,
    function,
    joined,
    product,
    scalar,
    stacked,
    still,
    turn_about,
)

if TYPE_CHECKING:
    from pinflex.bodies.track import Track
    from pinflex.mechanics.model.slider import Segment, Sleeve

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
        along = stacked([s, constant(0.0, s), constant(0.0, s)])
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
        tip, track = constant(self.length, self._eta), self._of.track
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
        return stacked([constant(0.0, across), across, down])


class Curve:
    """A link's curve before which a sleeve stands.

    Attributes:
        at: Where on the link that is (m). r, R: Place and axes of the section there.
    """

    def __init__(self, sleeve: Sleeve, on: int, p: Jet, eta: Jet) -> None:
        self._sleeve, self._on, self._eta, self._p = sleeve, on, eta, p
        here = _Segment(sleeve.segments[on], eta)
        flat_p, flat = still(p), _Segment(sleeve.segments[on], still(eta))

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
        there, flat = (self._seen(number, eta) for eta in (self._eta, still(self._eta)))

        def ahead(r: Callable[[Jet], Jet], origin: Jet, t: Jet) -> Callable[[Jet], Jet]:
            return lambda s: dot(r(s) - origin, t).plus(-side * half)

        length = self._sleeve.segments[number].length
        guess = 0.0 if number != self._on else float(self.r.value[0]) + side * half
        s = _root(ahead(there, self.r, t), ahead(flat, still(self.r), still(t)), guess, length, t)
        return dot(there(s) - self.r, self.normal(axis))

    def _reached(self, side: int) -> int:
        """Number of the segment that an end of the sleeve is on."""
        on, half, t = self._on, self._sleeve.half, self.R.value[:, 0]
        root, mine = on, still(self._eta)
        if side < 0:
            return on - int(on > 0 and t @ self.r.value < half)
        if on + 1 == len(self._sleeve.segments):
            return on
        last = _Segment(self._sleeve.segments[root], mine)
        tip = last.r(constant(last.length, mine)).value
        return on + int(t @ (tip - self.r.value) < half)

    def _seen(self, number: int, eta: Jet) -> Callable[[Jet], Jet]:
        """r(s) of this segment or a neighbour in this one's frame."""
        there = _Segment(self._sleeve.segments[number], eta)
        if number == self._on:
            return there.r
        first = _Segment(self._sleeve.segments[min(number, self._on)], eta)
        tip = constant(first.length, eta)
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
        found = flat(Jet(np.array(x), np.ones(1)))
        slope = float(found.grad[0])
        if abs(step) < _MET * length:  # the slope there is that of the derivatives
            break
        step = -float(found.value) / slope
        x += step
    s = constant(x, like)
    for _ in range(1 if like.hess is None else 2):
        s = s - f(s).times(1.0 / slope)
    return s
