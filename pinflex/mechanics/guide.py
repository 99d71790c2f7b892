"""The curve of a link cut into segments, seen from the root of one of them, with its derivatives.

The section at s of a segment sits, in the frame of the segment's root, at

    r(s) = (s + u, v + kappa_y b, w + kappa_z b),       b = s^2 (s - l) / l^2,

and is turned by R(s) = Rz(rz) Ry(ry) Rx(rx), all six to second order (`FlexibleBody.rows`): exactly
as the expanded model has it, so that the next segment begins where this one ends. The bump b is of
third order: with it the curve leaves the segment along the section's own x axis, which is that of
the next segment, and whatever runs along the curve has no jump of direction there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.jets import Jet, applied, constant, stacked, turned

if TYPE_CHECKING:
    from pinflex.bodies.track import Sections
    from pinflex.mechanics.slider import Segment, Sleeve

# Iterations for s, and the last step over the length: Newton leaves the square of it.
NEWTON, MET = 20, 1e-9


class Guide:
    """A link's curve in the frame of one segment, at one state.

    Attributes:
        on: Number of the segment. first: Variables of the jets before the coordinates.
        eta: Elastic coordinates that the jets know, shape (n,).
    """

    def __init__(self, sleeve: Sleeve, on: int, eta: Array, first: int) -> None:
        self.on, self.first, self._sleeve, self._all = on, first, sleeve, eta
        self.eta: IntArray = np.zeros(0, dtype=np.intp)
        self._at: dict[int, slice] = {}
        self.reach(on)
        self._kinks: dict[tuple[int, bool], Jet] = {}
        self._last: tuple[int, float, Sections] | None = None  # place and turn are asked for there

    def segment(self, number: int) -> Segment:
        """A segment of the link."""
        return self._sleeve.segments[number]

    def reach(self, number: int) -> None:
        """Count the coordinates of a segment among the variables."""
        if number in self._at:
            return
        eta, at = self.segment(number).eta, self.first + len(self.eta)
        self._at[number] = slice(at, at + eta.stop - eta.start)
        self.eta = np.concatenate([self.eta, np.arange(eta.start, eta.stop, dtype=np.intp)])

    @property
    def m(self) -> int:
        """Number of variables."""
        return self.first + len(self.eta)

    # Values ----------------------------------------------------------------------------------

    def place(self, number: int, s: float) -> tuple[Array, Array]:
        """r and dr/ds of a segment in the frame of its own root, shape (3,) each.

        Args:
            number: Of the segment.
            s: Place on it [m].
        """
        segment, kink = self.segment(number), self._kink(number, False).value
        out = segment.track.moved(s, self._all[segment.eta])
        out = out + bump(s, segment.length)[:2, None] * kink
        out[:, 0] += (s, 1.0)
        return out[0], out[1]

    def ahead(self, number: int, normal: Array, distance: float) -> float:
        """s of a segment at which normal . r(s), in this frame, is a distance (m).

        Args:
            number: Of the segment.
            normal: Shape (3,). distance: [m].
        """
        matrix, origin = self._frame(number, False)
        along, s = normal @ matrix.value, 0.0
        gap = distance - float(normal @ origin.value)
        for _ in range(NEWTON):
            place, rate = self.place(number, s)
            step = (gap - along @ place) / (along @ rate)
            s += float(step)
            if abs(step) < MET * self.segment(number).length:
                break
        return s

    def tip(self, number: int) -> Array:
        """The end of a segment in this frame, shape (3,)."""
        matrix, origin = self._frame(number, False)
        place = self.place(number, self.segment(number).length)[0]
        return np.asarray(matrix.value @ place + origin.value)

    # Jets ------------------------------------------------------------------------------------

    def seen(self, number: int, s: float, second: bool) -> Jet:
        """The section's place in this frame by (s, coordinates).

        Args:
            number: Of the segment. s: Place on it [m].
            second: Second derivatives too.
        """
        r = self.curve(number, s, second)
        if number == self.on:
            return r
        matrix, origin = self._frame(number, second)
        return applied(matrix, r) + origin

    def _frame(self, number: int, second: bool) -> tuple[Jet, Jet]:
        """Rotation and origin of a neighbour's frame (or this one) in this frame."""
        if number == self.on:
            one = constant(np.eye(3), self.m, second)
            return one, constant(np.zeros(3), self.m, second)
        before = min(number, self.on)
        length = self.segment(before).length
        R = _held(self.turn(before, length, second))
        t = _held(self.curve(before, length, second))
        if number > self.on:
            return R, t
        return R.transposed, applied(R.transposed, t).times(-1.0)

    def _sections(self, number: int, s: float) -> Sections:
        if self._last is None or self._last[:2] != (number, s):
            self._last = number, s, self.segment(number).track.at(s)
        return self._last[2]

    def turn(self, number: int, s: float, second: bool) -> Jet:
        """R of a section against its segment's root by (s, coordinates).

        Args:
            number: Of the segment. s: Place on it [m].
            second: Second derivatives too.
        """
        segment = self.segment(number)
        sections, mine = self._sections(number, s), self._all[segment.eta]
        a = _rows(sections, mine, slice(3, 6), 0, self._at[number], self.m, second)
        return turned(2, a[0]) @ turned(1, a[1]) @ turned(0, a[2])

    def curve(self, number: int, s: float, second: bool) -> Jet:
        """r of a section in the frame of its own segment by (s, coordinates).

        Args:
            number: Of the segment. s: Place on it [m].
            second: Second derivatives too.
        """
        segment = self.segment(number)
        sections, mine = self._sections(number, s), self._all[segment.eta]
        r = _rows(sections, mine, slice(0, 3), 0, self._at[number], self.m, second)
        r.value[0] += s
        r.grad[0, 0] += 1.0
        return r + _raised(self._kink(number, second), bump(s, segment.length))

    def _kink(self, number: int, second: bool) -> Jet:
        """(0, kappa_y, kappa_z): what the slope of (u, v, w) at the tip lacks of the axis there.

        Shear is no part of it: a section is not square to a beam that shears.
        """
        found = self._kinks.get((number, second))
        if found is None or found.grad.shape[-1] != self.m:
            segment, at = self.segment(number), self._at[number]
            mine = self._all[segment.eta]
            found = self._kinks[number, second] = _kink(segment, mine, at, self.m, second)
        return found


def _rows(
    sections: Sections, eta: Array, rows: slice, order: int, at: slice, m: int, second: bool
) -> Jet:
    """A derivative by s of some rows of a section, by (s, coordinates)."""
    Phi, G = sections.Phi[order : order + 3, rows], sections.G[order : order + 3, rows]
    turn = G @ eta
    value = Phi @ eta + 0.5 * turn @ eta
    lin = Phi + turn
    grad = np.zeros((value.shape[1], m))
    grad[:, 0], grad[:, at] = value[1], lin[0]
    if not second:
        return Jet(value[0], grad, None)
    hess = np.zeros((value.shape[1], m, m))
    hess[:, 0, 0] = value[2]
    hess[:, 0, at] = hess[:, at, 0] = lin[1]
    hess[:, at, at] = G[0]
    return Jet(value[0], grad, hess)


def bump(s: float, length: float) -> Array:
    """b = s^2 (s - l) / l^2 and two derivatives: no value at the ends, slopes 0 and 1.

    Args:
        s: Place [m].
        length: l [m].
    """
    raw = (s * s * (s - length), 3 * s * s - 2 * s * length, 6 * s - 2 * length)
    return np.array(raw) / length**2


def _raised(kink: Jet, along: Array) -> Jet:
    """kappa (3,), which s does not change, times the bump (b, b', b'')."""
    b, db, ddb = along
    grad = b * kink.grad
    grad[:, 0] += db * kink.value
    if kink.hess is None:
        return Jet(b * kink.value, grad, None)
    hess = b * kink.hess
    hess[:, 0, 0] += ddb * kink.value
    hess[:, 0] += db * kink.grad
    hess[:, :, 0] += db * kink.grad
    return Jet(b * kink.value, grad, hess)


def _kink(segment: Segment, eta: Array, at: slice, m: int, second: bool) -> Jet:
    """kappa of a segment, see `Guide._kink`."""
    rate = _held(_rows(segment.end, eta, slice(0, 3), 1, at, m, second))
    angles = _held(_rows(segment.end, eta, slice(3, 6), 0, at, m, second))
    rate.value[0] += 1.0
    rate.value[1:] -= segment.track.shear @ eta
    rate.grad[1:, at] -= segment.track.shear
    a, b = float(angles.value[0]), float(angles.value[1])
    tan_a, tan_b = (angles[k].of(np.tan(x), 1 / np.cos(x) ** 2, 2 * np.tan(x) / np.cos(x) ** 2)
                    for k, x in enumerate((a, b)))  # fmt: skip
    sec = 1.0 / np.cos(a)
    secant = angles[0].of(sec, sec * np.tan(a), sec * (2 * sec**2 - 1))
    across = rate[0] * tan_a - rate[1]
    down = (rate[0] * tan_b * secant).times(-1.0) - rate[2]
    return stacked([constant(np.array(0.0), m, second), across, down])


def _held(f: Jet) -> Jet:
    """The same at a section that stays: s changes nothing."""
    f.grad[..., 0] = 0.0
    if f.hess is not None:
        f.hess[..., 0, :] = f.hess[..., :, 0] = 0.0
    return f
