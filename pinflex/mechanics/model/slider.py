"""A passive sleeve that slides along a flexible beam: the closure rows of the kind `slider`.

The sleeve is carried by a frame b. In the beam's frame that frame sits at p = (X, Y, Z), and the
beam there is deflected by v(X) along y, w(X) along z and twisted by psi(X). No coordinate says
where the contact is, and nothing is remeshed. In each direction in which the beam bends (here v):

    hold    Y - v(X)                       the beam passes through the sleeve
    right   v(X + a) - v(X) - a v'(X)      a sleeve of length 2 a holds three points of the beam
    left    v(X - a) - v(X) + a v'(X)      on its tangent at the middle
    pivot   v(X + a) - 2 v(X) + v(X - a)   or, with `pivoting`, on one straight line
    tilt    e_x . n_y                      not `turning`: the section stays square to b's x axis e_x
    chord   Y                              the beam's frame stays on the line through the sleeve

and, not `turning`, where it bends both ways, `twist` e_y . n_z: the section does not turn in the
sleeve. n_y = (-v', 1, psi) and n_z = (-w', -psi, 1) are the section's axes, to first order.

`chord` is no force: it fixes the frame of a family that has the rigid rotation among its functions
(free_free), of which the joint of the beam would be a double. Its multiplier is of third order.

The contact is where frame b projects on the beam's x axis; the axial shift -1/2 int v'^2 dx of that
point changes v(X) in the third order, beyond what the shapes keep (`pinflex.bodies.basis`).

A link cut into segments has a beam frame in each: the rows are those of the segment that the sleeve
is on, along the curve of its sections as they are in space (`pinflex.mechanics.reference.sleeves`).

Source: Sharifnia, Akbarzadeh (2016), eq. 14-15, 25-28, for hold, right and left; forces act through
the transposed Jacobian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pinocchio as pin

from pinflex.bodies.track import Track, track
from pinflex.errors import DescriptionError
from pinflex.mechanics.manifold import ACROSS
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.description.loops import Loop
    from pinflex.mechanics.model.loads import Attachment, Expansion, Slot
    from pinflex.mechanics.model.parts import FlexiblePart


_LABELS = {
    "hold": "position across the beam",
    "right": "beam on the sleeve's axis, far end",
    "left": "beam on the sleeve's axis, near end",
    "pivot": "three points of the beam in line",
    "tilt": "beam along the fixed sleeve",
    "chord": "frame of the beam along its chord",
    "twist": "rotation about the beam",
}
_ACROSS = {"v": "y", "w": "z"}


@frozen(eq=False)
class Segment:
    """A piece of a beam that is cut into several.

    Attributes:
        offset: Where on the link it begins (m). length: Of it (m).
        track: How its sections move.
        eta: Place of its coordinates among the elastic ones.
        root: Its beam frame.
    """

    offset: float
    length: float
    track: Track
    eta: slice
    root: Attachment


@dataclass(frozen=True, eq=False)
class Sleeve:
    """A sleeve on a beam.

    Attributes:
        link: The beam. placement: Beam frame in the link's frame. length: Of the beam (m).
        half: Half the sleeve's length a (m), 0 for a point.
        sorts: Rows it makes: the sort and its direction, v or w.
        track: How v, w and the twist of one body vary along it; None on a rigid mechanism.
        eta: Place of the body in the elastic coordinates.
        segments: Of a link that is cut into several; none of one body, or on a rigid mechanism.
    """

    link: str
    placement: pin.SE3
    length: float
    half: float
    sorts: tuple[tuple[str, str], ...]
    track: Track | None
    eta: slice
    segments: tuple[Segment, ...] = ()

    def labels(self, loop: str) -> list[str]:
        """One name per row."""
        both = len({direction for _, direction in self.sorts}) > 1
        return [
            f"{loop}: {_LABELS[sort]}" + (f", {_ACROSS[d]}" if both and sort != "twist" else "")
            for sort, d in self.sorts
        ]


def sleeve(
    loop: Loop, parts: Mapping[str, FlexiblePart], expansion: Expansion, where: str
) -> Sleeve:
    """The sleeve of a loop on a rigid or an expanded model."""
    part = _beam(loop, parts, where)
    size = (part.link, part.placement, part.length, 0.5 * loop.sleeve)
    slots = [s for s in expansion.slots if s.link == part.link]
    sorts = _rows_held(loop, part, bool(slots))
    if not slots:
        return Sleeve(*size, sorts, None, slice(0, 0))
    if len(slots) > 1:
        return Sleeve(*size, sorts, None, slice(0, 0), _segments(slots))
    return Sleeve(*size, sorts, track(slots[0].body, ACROSS, False), slots[0].eta)


def _segments(slots: Sequence[Slot]) -> tuple[Segment, ...]:
    """The pieces of a link, root to tip; equal ones share their series."""
    tracks = {id(slot.body): slot.body for slot in slots}
    made = {key: track(body) for key, body in tracks.items()}
    return tuple(
        Segment(slot.offset, slot.body.length, made[key], slot.eta, slot.root)
        for slot, key in ((slot, id(slot.body)) for slot in slots)
    )


def _beam(loop: Loop, parts: Mapping[str, FlexiblePart], where: str) -> FlexiblePart:
    """The beam that a sleeve runs along; raises where it is none, or too short."""
    part = parts.get(loop.frame_a)
    if part is None:
        raise DescriptionError(
            f"{where}.between: {loop.frame_a} is not a flexible link. A slider runs along a beam: "
            f"write [BEAM, FRAME] with one of {', '.join(parts) or '(no link is flexible)'}."
        )
    solid = part.bodies[0].solid is not None
    if solid or not {"v", "w"} & set(part.planes):
        kind = "a solid" if solid else "a beam"
        raise DescriptionError(
            f"{where}: {loop.frame_a} is {kind}, deforming in {', '.join(part.planes)}. A slider "
            "needs a beam that bends: write bending_y: true."
        )
    if loop.sleeve >= part.length:
        raise DescriptionError(
            f"{where}.sleeve: {loop.sleeve:g} m is not shorter than the beam, {part.length:g} m."
        )
    if len(part.bodies) > 1:
        _require_segments(loop, part, where)
    return part


def _require_segments(loop: Loop, part: FlexiblePart, where: str) -> None:
    """Raise where a link in segments is none that a sleeve can pass along."""
    count, piece = len(part.bodies), part.bodies[0].length
    if part.bodies[0].root_moves:
        raise DescriptionError(
            f"{where}: the shapes of {loop.frame_a} move at its root, as free_free ones do, and "
            "those of its next segment begin there. Write segments: 1, or boundary: clamped_free."
        )
    if 0.5 * loop.sleeve > piece * (1 + 1e-9):
        most = int(part.length / (0.5 * loop.sleeve))
        raise DescriptionError(
            f"{where}.sleeve: half of {loop.sleeve:g} m is longer than a segment of "
            f"{loop.frame_a}, {piece:g} m ({count} segments). Write segments: {most} or fewer."
        )


def _rows_held(loop: Loop, part: FlexiblePart, bends: bool) -> tuple[tuple[str, str], ...]:
    """Sorts of rows with their direction; a straight beam has those of its line alone."""
    held = [d for d in ("v", "w") if d in part.planes]
    each = ["hold"] if loop.turning else ["hold", "tilt"]
    if bends:
        if loop.sleeve > 0.0:
            each += ["pivot"] if loop.pivoting else ["right", "left"]
        basis = part.spec.basis
        if basis.kind != "craig_bampton" and basis.boundary == "free_free":
            each.append("chord")
    sorts = [(sort, d) for d in held for sort in each]
    if not loop.turning and len(held) == 2:
        sorts.append(("twist", "w"))
    return tuple(sorts)
