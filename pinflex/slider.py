"""A passive sleeve that slides along a flexible beam: the closure rows of the kind `slider`.

The sleeve is carried by a frame b; in the beam's frame that frame sits at (X, Y), and the beam's
curve there is f(X) = phi(X) eta. No coordinate says where the contact is, and nothing is remeshed:

    hold    Y - f(X)                       the beam passes through the sleeve
    right   f(X + a) - f(X) - a f'(X)      a sleeve of length 2 a holds three points of the beam
    left    f(X - a) - f(X) + a f'(X)      on its tangent at the middle
    pivot   f(X + a) - 2 f(X) + f(X - a)   or, with `pivoting`, on one straight line
    chord   Y                              the beam's frame stays on the line through the sleeve

`chord` is no force: it fixes the frame of a family that has the rigid rotation among its functions
(free_free), of which the joint of the beam would be a double. Its multiplier is of third order.

The contact is where frame b projects on the beam's x axis; the axial shift -1/2 int f'^2 dx of that
point changes f(X) in the third order, beyond what the shapes keep (`pinflex.basis`).

Source: Sharifnia, Akbarzadeh (2016), eq. 14-15, 25-28; forces act through the transposed Jacobian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError, MotionError
from pinflex.expanded import Expansion
from pinflex.family import Family
from pinflex.parts import FlexiblePart
from pinflex.supplement import Loop

# Weights of Y, of f and of a f' at X - a, X, X + a, for each sort of row.
_WEIGHTS: Mapping[str, tuple[float, tuple[float, ...], float]] = {
    "hold": (1.0, (0.0, -1.0, 0.0), 0.0),
    "right": (0.0, (0.0, -1.0, 1.0), -1.0),
    "left": (0.0, (1.0, -1.0, 0.0), 1.0),
    "pivot": (0.0, (1.0, -2.0, 1.0), 0.0),
    "chord": (1.0, (0.0, 0.0, 0.0), 0.0),
}
_LABELS = {
    "hold": "position across the beam",
    "right": "beam on the sleeve's axis, far end",
    "left": "beam on the sleeve's axis, near end",
    "pivot": "three points of the beam in line",
    "chord": "frame of the beam along its chord",
}
# Third derivatives come from second ones over this part of the length: round-off and truncation
# both stay below 1e-8 of them. They only enter the bias and the tangent.
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Sleeve:
    """A sleeve on a beam.

    Attributes:
        link: The beam. placement: Beam frame in the link's frame. length: Of the beam (m).
        half: Half the sleeve's length a (m), 0 for a point.
        sorts: Rows it makes.
        family: Functions of the deflection; None on a rigid mechanism.
        eta: Their place in the elastic coordinates.
    """

    link: str
    placement: pin.SE3
    length: float
    half: float
    sorts: tuple[str, ...]
    family: Family | None
    eta: slice

    def labels(self, loop: str) -> list[str]:
        """One name per row."""
        return [f"{loop}: {_LABELS[sort]}" for sort in self.sorts]


@dataclass(frozen=True, eq=False)
class Contact:
    """The rows of one sleeve among all closure rows; `which` of the sleeve's sorts they are."""

    sleeve: Sleeve
    loop: int
    rows: IntArray

    def select(self, renumber: IntArray) -> Contact:
        """The same with the rows kept; `renumber` holds -1 for the others."""
        kept = renumber[self.rows] >= 0
        sorts = tuple(s for s, keep in zip(self.sleeve.sorts, kept, strict=True) if keep)
        sleeve = replace(self.sleeve, sorts=sorts)
        return replace(self, sleeve=sleeve, rows=renumber[self.rows[kept]])


def sleeves(
    loops: Sequence[Loop], parts: Mapping[str, FlexiblePart], expansion: Expansion, where: str
) -> dict[str, Sleeve]:
    """The sleeves of a description on a rigid or an expanded model, by loop.

    Args:
        loops: Described loops. parts: Flexible links by name.
        expansion: The model; without elastic coordinates each sleeve has just its `hold`.
        where: Name of the model, for messages.
    """
    return {
        loop.name: _sleeve(loop, parts, expansion, f"{where}: loops.{loop.name}")
        for loop in loops
        if loop.kind == "slider"
    }


def _sleeve(
    loop: Loop, parts: Mapping[str, FlexiblePart], expansion: Expansion, where: str
) -> Sleeve:
    part = parts.get(loop.frame_a)
    if part is None:
        raise DescriptionError(
            f"{where}.between: {loop.frame_a} is not a flexible link. A slider runs along a beam: "
            f"write [BEAM, FRAME] with one of {', '.join(parts) or '(no link is flexible)'}."
        )
    if "v" not in part.planes or set(part.planes) - {"u", "v"} or len(part.bodies) > 1:
        raise DescriptionError(
            f"{where}: {loop.frame_a} deforms in {', '.join(part.planes)}, in {len(part.bodies)} "
            "segment(s). A slider needs one segment that bends along its y axis: write bending_y: "
            "true, bending_z: false, torsion: false, segments: 1."
        )
    if loop.sleeve >= part.length:
        raise DescriptionError(
            f"{where}.sleeve: {loop.sleeve:g} m is not shorter than the beam, {part.length:g} m."
        )
    size = (part.link, part.placement, part.length, 0.5 * loop.sleeve)
    slot = next((s for s in expansion.slots if s.link == part.link), None)
    if slot is None:
        return Sleeve(*size, ("hold",), None, slice(0, 0))
    sorts = ["hold"]
    if loop.sleeve > 0.0:
        sorts += ["pivot"] if loop.pivoting else ["right", "left"]
    basis = part.spec.basis
    if basis.kind != "craig_bampton" and basis.boundary == "free_free":
        sorts.append("chord")
    at = slot.body.slices["v"]
    eta = slice(slot.eta.start + at.start, slot.eta.start + at.stop)
    return Sleeve(*size, tuple(sorts), slot.body.families["v"], eta)


class ContactState:
    """The rows of one sleeve as functions h(X, Y, eta), with their derivatives.

    Attributes:
        value: h, shape (rows,). by_X, by_Y: dh/dX and dh/dY, shape (rows,).
        by_eta, by_X_eta: dh/deta and d2h/(dX deta), shape (rows, n).
    """

    def __init__(self, contact: Contact) -> None:
        sleeve = contact.sleeve
        self.contact, self.rows, self.loop, self.eta = (
            contact,
            contact.rows,
            contact.loop,
            sleeve.eta,
        )
        weights = [_WEIGHTS[sort] for sort in sleeve.sorts]
        a, count = sleeve.half, len(weights)
        self._at = np.array([-a, 0.0, a])
        self.by_Y = np.array([w[0] for w in weights])
        self._value = np.array([w[1] for w in weights]).reshape(count, 3)
        self._slope = np.zeros((count, 3))
        self._slope[:, 1] = [a * w[2] for w in weights]
        self.X = 0.0
        self.value, self.by_X = np.zeros(count), np.zeros(count)
        self.by_eta = self.by_X_eta = np.zeros((count, 0))

    def update(self, X: float, Y: float, eta: Array) -> None:
        """Evaluate at (X, Y) in m and the elastic coordinates of all bodies."""
        self.X, self.value = X, self.by_Y * Y
        family = self.contact.sleeve.family
        if family is None:
            return
        F = family.evaluate(X + self._at)
        self.by_eta = self._value @ F.f + self._slope @ F.df
        self.by_X_eta = self._value @ F.df + self._slope @ F.curv
        here = eta[self.eta]
        self.value = self.value + self.by_eta @ here
        self.by_X = self.by_X_eta @ here

    def by_XX(self, eta: Array) -> Array:
        """d2h/dX2, shape (rows,)."""
        family = self.contact.sleeve.family
        if family is None:
            return np.zeros(len(self.rows))
        step = _STEP * family.length
        X = np.array([self.X - step, self.X + step])
        third = np.diff(family.evaluate(X).curv, axis=0) / (2.0 * step)
        second = family.evaluate(self.X + self._at).curv
        rows = self._value @ second + self._slope[:, 1:2] * third
        return np.asarray(rows @ eta[self.eta])

    def forces(self, lam: Array) -> Array:
        """What the sleeve does to the beam: rows (x, Fx, Fy, Mz) at X - a, X, X + a, shape (3, 4).

        Args:
            lam: Multipliers of all closure rows.
        """
        push = lam[self.rows]
        out = np.zeros((3, 4))
        out[:, 0] = self.X + self._at
        out[1, 1] = -push @ self.by_X
        out[:, 2], out[:, 3] = push @ self._value, push @ self._slope
        return out

    def require_on_beam(self, name: str, where: str, t: float | None) -> None:
        """Raise where an end of the sleeve lies beyond an end of the beam.

        Args:
            name: Of the loop. where: Name of the model. t: Time (s), if there is one.
        """
        sleeve = self.contact.sleeve
        ends = (self.X - sleeve.half, self.X + sleeve.half)
        # An end may stand on an end of the beam, up to what closing the loops leaves.
        slack = 1e-9 * sleeve.length
        if ends[0] >= -slack and ends[1] <= sleeve.length + slack:
            return
        when = where if t is None else f"{where}: t = {t:.6g} s"
        reach = f"x = {self.X:.6g} m" + (
            f", from {ends[0]:.6g} to {ends[1]:.6g} m" if sleeve.half else ""
        )
        raise MotionError(
            f'{when}: sleeve "{name}" leaves the beam {sleeve.link}: it is at {reach}, the beam '
            f"ends at 0 and {sleeve.length:g} m. Shorten the motion, or lengthen the beam.",
            loop=name,
            position=self.X,
            time=t,
        )


def section_forces(x: Array, forces: Array) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz that a sleeve adds, shape (nt, nx, 6).

    Args:
        x: Sections (m), shape (nx,). forces: From `ContactState.forces`, shape (nt, 3, 4).
    """
    at, Fx, Fy, Mz = (forces[:, None, :, k] for k in range(4))
    arm = at - x[None, :, None]
    beyond = arm >= 0.0
    out = np.zeros((len(forces), len(x), 6))
    for column, part in ((0, Fx), (1, Fy), (5, Mz + arm * Fy)):
        out[:, :, column] = np.sum(np.where(beyond, part, 0.0), axis=2)
    return out
