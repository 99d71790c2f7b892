"""What a flexible link needs by itself: its beam frame, its planes, its bodies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.bodies.basis import FlexibleBody, flexible_body
from pinflex.bodies.beam import damping
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.evaluation.compiled import require_memory
from pinflex.mechanics.model import tree
from pinflex.mechanics.model.planes import (
    LeftOut,
    Plane,
    active_planes,
    placed_beam,
    plane_of,
    require_carrying,
    with_shear,
)
from pinflex.mechanics.model.tree import Link, Rider
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.description.description import Description
    from pinflex.mechanics.model.loads import Expansion
    from pinflex.mechanics.model.system import System

# Slips of units, told by proportions that no robot has: millimetres for metres, tonnes for grams.
#
# What is truly meant is allowed by the key `allow` of the description.

HEAVY = 1e5  # [kg] of one link; the heaviest crane booms weigh 1e5 kg
FAR, LIGHT = 50.0, 1.0  # [m] of reach with less than so many kg for each metre of it


def require_beam(spec: FlexibleLink, length: float, where: str, allow: Sequence[str] = ()) -> None:
    """Raise where a section is wider than its link is long, or a beam heavier than a building."""
    sizes = {k: v for k, v in spec.section.dimensions if k in ("width", "height", "diameter")}
    # A section given by its numbers has no sizes, and may be of a beam without units.
    key, size = max(sizes.items(), key=lambda item: item[1], default=("", 0.0))
    if size > length and "wide" not in allow:
        meant = f" Did you mean {1e-3 * size:g}?" if size > 10 * length or size >= 1 else ""
        raise DescriptionError(
            f"{where}.section.{key}: {size:g} m is more than the span of the link, {length:.4g} m, "
            f"so this is no beam. Lengths are in m.{meant} Correct it, give another `length` or "
            "`end`, or write `allow: [wide]` at the top of the YAML."
        )
    mass = (spec.material.rho or 0.0) * spec.section.A * length
    if mass > HEAVY and "heavy" not in allow:
        raise DescriptionError(
            f"{where}: the beam weighs {mass:.3g} kg (A = {spec.section.A:.3g} m^2, {length:.4g} m "
            f"long, rho = {spec.material.rho:.4g} kg/m^3). Lengths are in m, densities in kg/m^3. "
            "Correct the section or rho, or write `allow: [heavy]` at the top of the YAML."
        )


def require_size(links: Sequence[Link], urdf: str, allow: Sequence[str] = ()) -> None:
    """Raise where a robot of some kilograms reaches as far as a skyscraper is high."""
    places = [pose.translation for pose in tree.poses_of(links)]
    reach = max((float(np.linalg.norm(place)) for place in places), default=0.0)
    mass = sum(float(link.inertia.mass) for link in links)
    if reach > FAR and 0 < mass < LIGHT * reach and "large" not in allow:
        raise DescriptionError(
            f"{urdf}: reaches {reach:.4g} m with {mass:.4g} kg in all, so its lengths look like "
            "millimetres. A URDF is in m: export it anew, or write `allow: [large]` at the top of "
            "the YAML.",
            reach=reach,
        )


def heavy(links: Sequence[Link]) -> list[str]:
    """A sentence on rigid links that weigh more than a lorry."""
    found = [f"{x.name} {x.inertia.mass:.4g} kg" for x in links if x.inertia.mass > 0.1 * HEAVY]
    if not found:
        return []
    more = f" and {len(found) - 4} more" if len(found) > 4 else ""
    return [
        f"the URDF has links of over {0.1 * HEAVY:g} kg: {', '.join(found[:4])}{more}. Masses are "
        "in kg, and a density of 1000 kg/m^3 on a part in mm makes such numbers."
    ]


_NEAR = 1e-6  # of a span, or of a segment: sections so near an end of it are that end


@frozen
class FlexiblePart:
    """A flexible link, resolved.

    Attributes:
        link: Link name.
        placement: Beam frame (x along the span, z = up) in the link's frame.
        length: Span in m.
        planes: Active directions among u, v, w, p.
        reason: Why these planes.
        bodies: One flexible body per segment, root to tip.
        riders: Rigid inertias on it: what the beam does not carry of the URDF's inertia, and the
            end masses of the description.
        spec: The description, with the density that its stations have.
        share: Share of the described density that they have, so that the URDF's inertia stays;
            None where the beam's inertia takes the place of the URDF's.
        left_out: What `auto` left out, though the scene may excite it.
    """

    link: str
    placement: pin.SE3
    length: float
    planes: tuple[str, ...]
    reason: str
    bodies: tuple[FlexibleBody, ...]
    riders: tuple[Rider, ...]
    spec: FlexibleLink
    share: float | None = None
    left_out: tuple[LeftOut, ...] = ()

    def moves_as(self, other: FlexiblePart) -> bool:
        """Whether its sections, and riders on them, are where those of another part are."""
        mine, theirs = (
            (x.link, x.planes, x.length, x.placement, len(x.bodies), [r.x for r in x.riders])
            for x in (self, other)
        )
        return mine == theirs and self.bodies[0].moves_as(other.bodies[0])

    def section_of(self, point: Array) -> float:
        """Section x (m) that carries a point given in the link's frame, shape (3,)."""
        x = float(self.placement.actInv(np.asarray(point, float))[0])
        x = min(max(x, 0.0), self.length)
        if x < _NEAR * self.length:
            return 0.0
        return self.length if x > self.length * (1 - _NEAR) else x

    def segment_of(self, x: float) -> tuple[int, float]:
        """The one segment that carries the section at x [m], and the section in it, from its root.

        A border of two segments is the tip of the first: what sits within round-off of it, too.
        """
        length = self.bodies[0].length
        k = min(max(math.ceil(x / length - _NEAR) - 1, 0), len(self.bodies) - 1)
        local = x - k * length
        return k, length if local > length * (1 - _NEAR) else local

    def rigid_inertias(self) -> tuple[pin.Inertia, ...]:
        """The undeformed link as its stations see it, in the link's frame."""
        inertias = []
        for k, body in enumerate(self.bodies):
            for j, (place, mass) in enumerate(zip(body.points, body.mass, strict=True)):
                tensor = np.diag(body.inertia[j]) if body.inertia is not None else np.zeros((3, 3))
                point = place + np.array([k * body.length, 0.0, 0.0])
                inertias.append(pin.Inertia(float(mass), point, tensor))
            for twist in body.It:
                inertias.append(pin.Inertia(0.0, np.zeros(3), np.diag([float(twist), 0.0, 0.0])))
        for rider in self.riders:
            place = pin.SE3(np.eye(3), np.array([rider.x, 0.0, 0.0]))
            inertias.append(place.act(rider.inertia))
        return tuple(self.placement.act(i) for i in inertias)

    @property
    def mass(self) -> float:
        """Mass of the beam without its riders, kg."""
        return float(sum(body.mass.sum() for body in self.bodies))


def resolve(
    description: Description,
    links: Sequence[Link],
    without: Mapping[str, Sequence[LeftOut]] | None = None,
    coarse: bool = False,
    plane: Plane | None = None,
) -> dict[str, FlexiblePart]:
    """Flexible links with their bodies, by name; `plane`: of this description, if known."""
    index = {link.name: number for number, link in enumerate(links)}
    plane = plane_of(description, links, {}) if plane is None else plane
    slides = {loop.frame_a for loop in description.loops if loop.kind == "slider"}
    parts: dict[str, FlexiblePart] = {}
    for spec in description.flexible:
        out = tuple((without or {}).get(spec.link, ()))
        spec = _coarse(spec) if coarse and spec.link not in slides else spec
        parts[spec.link] = _part(description, spec, links, index, plane, out)
    return parts


def _coarse(spec: FlexibleLink) -> FlexibleLink:
    """The link with static end shapes alone, which are exact for loads at its ends."""
    if spec.basis.solid:
        return spec
    basis = spec.basis
    if basis.kind == "craig_bampton":
        basis = replace(basis, internal=0)
    return replace(spec, segments=1, basis=basis, second_order=False)


def _part(
    description: Description,
    spec: FlexibleLink,
    links: Sequence[Link],
    index: Mapping[str, int],
    plane: Plane,
    out: tuple[LeftOut, ...],
) -> FlexiblePart:
    where = f"{description.name}: flexible.{spec.link}"
    number = index[spec.link]
    placement, length = placed_beam(where, spec, links, index, plane.spans)
    require_carrying(where, description, spec, number, links, index)
    if spec.basis.solid:
        return _solid_part(description, spec, placement, length, where)
    planes, reason = active_planes(where, spec, plane.poses[number] * placement, plane, out)
    mass = links[number].inertia.mass
    require_memory(where, spec, planes, description.limit)
    if spec.material.rho is None:
        if mass <= 0:
            raise DescriptionError(
                f"{where}.material.rho: urdf, but the link has no mass in the URDF. "
                "Give a density in kg/m^3."
            )
        spec = _with_density(spec, mass / (_built(spec, length)[0].section.A * length))
    require_beam(spec, length, where, description.allow)
    spec, reason = with_shear(spec, planes, length, reason)
    beam = _beam(spec, planes, length)
    bodies, riders = (_body(beam),) * spec.segments, tree.end_riders(spec, length)
    told = planes, reason, bodies, riders, spec
    part = FlexiblePart(spec.link, placement, length, *told, left_out=out)
    keeps = spec.inertia == "urdf" and mass > 0
    return _ridden(where, part, links[number].inertia, beam) if keeps else part


@dataclass(frozen=True)
class _Beam:
    """What the body of a link follows from: links alike in that share it, of any load.

    Attributes:
        alike: The link without its name and what its place in the mechanism says.
        planes, length: Directions, and length of one of its bodies [m].
        spec: As it is written, for errors.
    """

    alike: FlexibleLink
    planes: tuple[str, ...]
    length: float
    spec: FlexibleLink = field(compare=False)


@lru_cache(maxsize=64)
def _body(beam: _Beam) -> FlexibleBody:
    """The body of a beam, kept: designs of one robot differ in a few links."""
    return flexible_body(beam.spec, beam.planes, beam.length)


def _beam(spec: FlexibleLink, planes: tuple[str, ...], length: float) -> _Beam:
    alike = replace(spec, link="", inertia="beam", as_built=None, start=None, end=None, up=None)
    return _Beam(alike, planes, length / spec.segments, spec)


@dataclass(frozen=True)
class _Ridden:
    """A link whose inertia its beam and riders share: links alike in that share the body.

    Attributes:
        beam, built: The beam, and the one that the URDF's link has.
        numbers: Mass, centre and inertia of the URDF's link about the start of the beam.
        inertia, riders: The same as an object, and masses at the ends, which the beam tells.
    """

    beam: _Beam
    built: _Beam
    numbers: bytes
    inertia: pin.Inertia = field(compare=False)
    riders: tuple[tree.Rider, ...] = field(compare=False)


@lru_cache(maxsize=64)
def _weighed(link: _Ridden) -> tuple[tree.Split, FlexibleBody]:
    """Shares of the inertia, and the body with its own: as described where too little fits."""
    spec, body, built = link.beam.spec, _body(link.beam), _body(link.built)
    segments = link.built.spec.segments
    length, whole = segments * link.built.length, spec.segments * link.beam.length
    shares = tree.split(link.inertia, (built,) * segments, length)
    if shares.share < tree.LEAST:
        return shares, body
    shares = tree.moved(shares, whole / length)
    return shares, tree.weighed(body, spec, shares, (*shares.riders, *link.riders))


def _built(spec: FlexibleLink, length: float) -> tuple[FlexibleLink, float]:
    """The link as the one whose inertia the URDF has, and its span [m]."""
    old = spec.as_built
    if old is None:
        return spec, length
    material = spec.material if old.material is None else old.material
    material = material if material.rho is not None else replace(material, rho=spec.material.rho)
    section = spec.section if old.section is None else old.section
    return replace(spec, material=material, section=section, as_built=None), old.length or length


def _with_density(spec: FlexibleLink, rho: float | None) -> FlexibleLink:
    return replace(spec, material=replace(spec.material, rho=rho))


def _ridden(where: str, part: FlexiblePart, urdf: pin.Inertia, own: _Beam) -> FlexiblePart:
    """The part with the URDF's inertia, shared between its beam (as built) and riders."""
    spec, rho = part.spec, part.spec.material.rho or 0.0
    built, length = _built(spec, part.length)
    inertia = part.placement.actInv(urdf)
    numbers = np.concatenate([[inertia.mass], inertia.lever, inertia.inertia.ravel()]).tobytes()
    theirs = own if built is spec else _beam(built, part.planes, length)
    shares, body = _weighed(_Ridden(own, theirs, numbers, inertia, part.riders))
    if shares.share < tree.LEAST:
        lighter = rho * shares.share / tree.LEAST
        advice = f", or material.rho up to {lighter:.3g} kg/m^3" if lighter > 1 else ""
        raise DescriptionError(
            f"{where}.inertia: a beam of {part.mass:.3g} kg does not fit into the URDF's inertia "
            f"of {part.link} ({urdf.mass:.3g} kg, {100 * shares.share:.2g} % of the beam fit). "
            f"Write inertia: beam, so that the beam's own inertia takes its place{advice}."
        )
    return replace(
        part,
        bodies=(body,) * spec.segments,
        riders=(*shares.riders, *part.riders),
        spec=_with_density(spec, shares.share * rho),
        share=shares.share,
    )


def _solid_part(
    description: Description, spec: FlexibleLink, placement: pin.SE3, length: float, where: str
) -> FlexiblePart:
    from pinflex.bodies.solid_link import equivalent_section, solid_body

    folder = Path() if description.path is None else description.path.parent
    if spec.material.rho is None and spec.basis.kind == "mesh":
        raise DescriptionError(
            f"{where}.material.rho: missing. The mass of a mesh is its volume times rho [kg/m^3]."
        )
    body = solid_body(spec, placement, length, folder, where)
    spec = replace(spec, section=equivalent_section(body, spec.material.rho))
    reason = "a solid deforms in every direction"
    directions = ("u", "v", "w", "p")
    return FlexiblePart(spec.link, placement, length, directions, reason, (body,), (), spec)


# Damping matrices of flexible links: of the description, or from Python in their place.
#
# A link in segments is damped as the one link that it is, by its own modes held at its root:
# damping of each segment by itself would fall with their number, as modes of short segments are
# fast.

_ROUND_OFF = 1e-9  # of the largest entry, for symmetry and for the sign of energy

# Rows (u, v, w, rz, ry, rx) as displacement and rotation about x, y, z.
_DAMPED_AXES = [0, 1, 2, 5, 4, 3]


def rows_of(expansion: Expansion) -> dict[str, IntArray]:
    """Places in eta of the coordinates of each link, root to tip."""
    rows: dict[str, list[int]] = {}
    for slot in expansion.slots:
        rows.setdefault(slot.link, []).extend(range(slot.eta.start, slot.eta.stop))
    return {link: np.array(at, dtype=np.intp) for link, at in rows.items()}


def link_damping(part: FlexiblePart) -> Array:
    """Damping of a link in all its coordinates, root to tip, shape (n, n)."""
    first, count = part.bodies[0], len(part.bodies)
    if count == 1:
        return first.D
    K = np.asarray(np.kron(np.eye(count), first.K))
    every = np.arange(count)[:, None] * first.n
    places = {d: (every + np.arange(first.n)[at]).ravel() for d, at in first.slices.items()}
    return damping(part.spec, places, K, _mass(part))


def _mass(part: FlexiblePart) -> Array:
    """Linear mass matrix of a straight link in segments, riders too, held at its root, (n, n).

    What a segment moves by at x is what its root moves by as a rigid body, and its own rows.
    """
    width = sum(body.n for body in part.bodies)
    root, roots, done = np.zeros((6, width)), [], 0
    M = np.zeros((width, width))
    for body in part.bodies:
        roots.append((root, slice(done, done + body.n)))
        own, done = roots[-1][1], done + body.n
        for k, x in enumerate(body.x):
            B = _moved(root, float(x))
            B[:3, own] += body.Phi[k]
            M += body.mass[k] * B[:3].T @ B[:3]
            if body.inertia is not None and body.Phi_r is not None:
                B[3:, own] += body.Phi_r[k][::-1]
                M += B[3:].T @ (body.inertia[k][:, None] * B[3:])
        for moment, Phi in zip(body.It, body.Phi_t, strict=True):
            turn = root[3].copy()
            turn[own] += Phi
            M += moment * np.outer(turn, turn)
        root = _section(body, root, own, body.length)
    for rider in part.riders:
        k, x = part.segment_of(rider.x)
        B = _section(part.bodies[k], *roots[k], x)
        M += B.T @ rider.inertia.matrix() @ B
    return 0.5 * (M + M.T)


def _section(body: FlexibleBody, root: Array, own: slice, x: float) -> Array:
    """Displacement and rotation of a section at x (m) of a segment, shape (6, n)."""
    B = _moved(root, x)
    B[:, own] += body.rows(x)[0][_DAMPED_AXES]
    return B


def _moved(root: Array, x: float) -> Array:
    """What a point at x (m) along the beam moves by with the root, shape (6, n)."""
    B = root.copy()
    B[1] += x * root[5]
    B[2] -= x * root[4]
    return B


def with_damping(system: System, name: str, given: Mapping[str, Array]) -> System:
    """The flexible system with the given damping of some links, which must not make energy."""
    D, first = system.D.copy(), int(system.rigid.nv)
    rows = rows_of(system.expansion)
    for link, matrix in given.items():
        where = f"{name}: damping: {link}"
        if link not in rows:
            raise DescriptionError(f"{where} is not flexible.{nearest(link, rows)}")
        at, own = first + rows[link], np.asarray(matrix, float)
        n = len(at)
        if own.shape != (n, n) or not np.all(np.isfinite(own)):
            raise DescriptionError(
                f"{where}: shape {own.shape}. Allowed: finite numbers of shape {(n, n)}, one row "
                "for each elastic coordinate of the link (mechanism.parts[LINK].bodies)."
            )
        small = _ROUND_OFF * float(np.max(np.abs(own), initial=0.0))
        if np.max(np.abs(own - own.T), initial=0.0) > small:
            raise DescriptionError(f"{where}: is not symmetric. Give (D + D') / 2.")
        least = float(np.min(np.linalg.eigvalsh(own), initial=0.0))
        if least < -n * small:
            raise DescriptionError(
                f"{where}: has the eigenvalue {least:.3g}, with which it would make energy. "
                "Allowed: eigenvalues >= 0."
            )
        D[np.ix_(at, at)] = own
    return replace(system, D=D)
