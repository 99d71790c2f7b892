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

from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.model.slider import ROWS
from pinflex.mechanics.reference.curve import Curve, section
from pinflex.mechanics.reference.jets import Jet, constant, dot, product, stacked

if TYPE_CHECKING:
    from pinflex.bodies.track import Track
    from pinflex.mechanics.model.slider import Contact, Sleeve

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
        still = [Jet(x.value, np.zeros((3, _SIZE))) for x in self._seen]
        by_g = _Bent(still[0], line.half, Jet(line.g.value, np.eye(_SIZE)), line.slopes)
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
        return _Bent(p, sleeve.half, constant(np.zeros(_SIZE), p), np.zeros(_SIZE))
    return _Bent(p, sleeve.half, *_deflections(sleeve.track, p[0], eta[sleeve.eta], sleeve.half))


def _deflections(track: Track, X: Jet, eta: Jet, half: float) -> tuple[Jet, Array]:
    """g, and its derivative by X alone, shape (9,)."""
    parts, slopes = [], []
    for row in ROWS[:2]:
        at = [(shift * half, 0) for shift in (-1.0, 0.0, 1.0)] + [(0.0, 1)]
        parts += [section(track, X.plus(shift), eta, [row], order)[0] for shift, order in at]
        slopes += [section(track, X.plus(x), eta, [row], order + 1)[0].value for x, order in at]
    parts.append(section(track, X, eta, [ROWS[2]], 0)[0])
    slopes.append(section(track, X, eta, [ROWS[2]], 1)[0].value)
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
        one = constant(1.0, slope)
        return stacked([slope, one, psi] if axis == 1 else [slope, psi.times(-1.0), one])
