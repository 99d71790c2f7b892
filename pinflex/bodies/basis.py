"""A flexible link as stations: mass points whose motion is quadratic in a few coordinates eta.

With the strains linear in eta (curvatures kappa = (p', -w'', v''), stretch u', shear), the section
at x moves and turns, exactly to second order, by

    (u, v, w, rz, ry, rx) = Phi eta + 1/2 eta' G eta,      R = Rz(rz) Ry(ry) Rx(rx).

The beam frame has x along the span; v is the deflection along y, w along z, p the twist.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from pinflex.arrays import Array
from pinflex.bodies import beam
from pinflex.bodies.beam import (
    DIRECTIONS,
    beam_energy,
    bending,
    craig_bampton,
    damping,
    plain_shapes,
    union,
)
from pinflex.bodies.family import (
    BENDING,
    Family,
    assumed,
    combine,
    hermite,
    polynomial,
    quadrature,
    sines,
)
from pinflex.errors import DescriptionError
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.bodies.superelement import Superelement
    from pinflex.description.blocks.flexible import FlexibleLink


# What the curvature of a bent beam adds to its energy in fourth order.
#
# A beam that does not stretch, with v(x) and w(x) across its axis, has the squared curvature
#
#     v''^2 + w''^2 + (v' v'' + w' w'')^2 + O(6)
#
# of which the stiffness matrix holds the first two terms. Without the third the frequency of a
# large vibration moves the wrong way: of a cantilever in its first mode by -0.287 (a/L)^2 at the
# tip amplitude a, where it is +0.0194 (a/L)^2; the term brings 3/4 V4/V2 = 0.307 (a/L)^2.
#
# Source: Crespo da Silva and Glynn (1978), for the energy of an inextensible beam.


@dataclass(frozen=True, eq=False)
class Curvature:
    """The energy V4 = EI/2 int (v' v'' + w' w'')^2 dx of a body in its n coordinates.

    Attributes:
        slope: Rows of v' and w' at the points of a quadrature, shape (directions, points, n).
        bend: Rows of v'' and w'' there, likewise.
        weight: EI times the weights of the quadrature (N m^3), shape (points,).
    """

    slope: Array
    bend: Array
    weight: Array

    def energy(self, eta: Array) -> Array:
        """V4 (J) of states eta (..., n), shape (...)."""
        return np.asarray(0.5 * (self._mixed(eta)[0] ** 2 @ self.weight))

    def force(self, eta: Array) -> Array:
        """dV4/deta of states eta (..., n), shape (..., n)."""
        mixed, slope, bend = self._mixed(eta)
        push, sums = self.weight * mixed, "d...p,dpn->...n"
        return np.asarray(
            np.einsum(sums, push * bend, self.slope) + np.einsum(sums, push * slope, self.bend)
        )

    def stiffness(self, eta: Array) -> Array:
        """d2V4/deta2 of one state eta (n,), shape (n, n)."""
        mixed, slope, bend = self._mixed(eta)
        rows = (bend[:, :, None] * self.slope + slope[:, :, None] * self.bend).sum(axis=0)
        both = np.einsum("dpi,p,dpj->ij", self.slope, self.weight * mixed, self.bend)
        return np.asarray(both + both.T + rows.T @ (self.weight[:, None] * rows))

    def _mixed(self, eta: Array) -> tuple[Array, Array, Array]:
        """v' v'' + w' w'' at the points, (..., points), and v', w' and v'', w'' there."""
        slope, bend = (np.einsum("dpn,...n->d...p", rows, eta) for rows in (self.slope, self.bend))
        return (slope * bend).sum(axis=0), slope, bend


def curvature(
    families: Mapping[str, Family], slices: Mapping[str, slice], n: int, stiffness: float
) -> Curvature:
    """V4 of a body."""
    bending = [d for d in BENDING if d in families]
    breaks = union([families[d].breaks for d in bending])
    # A product of four functions.
    points, weights = quadrature(breaks, 2 * max(families[d].gauss for d in bending))
    x = points.ravel()
    slope, bend = (np.zeros((len(bending), len(x), n)) for _ in range(2))
    for k, d in enumerate(bending):
        F = families[d].evaluate(x)
        slope[k][:, slices[d]], bend[k][:, slices[d]] = F.df, F.curv
    return Curvature(slope, bend, stiffness * weights.ravel())


# Sections along a flexible body: how they move, and what hangs on them.

# Per body: a smooth curve on the screen and every maximum within 0.1 % of a parabola.
SECTIONS = 21


@frozen
class Cut:
    """Sections of one body: deflection rows and the balance operator.

    Attributes:
        x: Sections (m), shape (nx,).
        Phi: Rows (u, v, w, rz, ry, rx), shape (nx, 6, n). G: second order, or None.
        outer: Integrates station forces over the part beyond x: shape (nx, ns).
        outer_twist: The same for twist stations, shape (nx, nt).
    """

    x: Array
    Phi: Array
    G: Array | None
    outer: Array
    outer_twist: Array


def cut(body: FlexibleBody, count: int = SECTIONS) -> Cut:
    """Sections at equal distances along a body."""
    if body.solid is not None:
        return body.solid.cut
    x = np.linspace(0.0, body.length, count)
    families, slices = body.families, body.slices
    Phi = beam.first_order(families, slices, x)
    G = beam.second_order(families, slices, x, range(6)) if body.second_order else None
    breaks = union([family.breaks for family in families.values()])
    return Cut(x, Phi, G, _outer(x, body.x, breaks), _outer(x, body.xt, breaks))


def _outer(x: Array, stations: Array, breaks: Array) -> Array:
    """Operator from station forces to their integral over [x, L].

    Between breaks the force per length is the polynomial through the Gauss stations, so the section
    forces are smooth curves, not stairs.
    """
    operator = np.zeros((len(x), len(stations)))
    for start, end in itertools.pairwise(breaks):
        inside = np.flatnonzero((stations > start) & (stations < end))
        n = len(inside)
        if not n:
            continue
        xi = 2.0 * (stations[inside] - start) / (end - start) - 1.0
        V = legendre.legvander(xi, n - 1)
        # Discrete orthogonality at Gauss points: coefficients of force density from lumped forces.
        k = np.arange(n)
        coefficients = (2 * k + 1)[:, None] / 2.0 * V.T
        at = np.clip(2.0 * (x - start) / (end - start) - 1.0, -1.0, 1.0)
        primitive = legendre.legint(np.eye(n))
        integrals = legendre.legval(1.0, primitive) - legendre.legval(at, primitive).T
        operator[:, inside] = integrals @ coefficients
    return operator


# The Ritz link of eight end coordinates, without the two that move it as a whole.


def ritz8(length: float, direction: str, shear_ratio: float) -> Family:
    """End coordinates q1..q8 of a link: stretch, rotations about z and y, twist of both ends.

    The source's bending functions are linear, which bends nothing while its stiffness is that of
    end rotations: here q2, q3, q6, q7 are these rotations, against the chord, and the
    twist has the stiffness G J / l.
    The frame of the link is fixed to its root section, not to the chord, so the shapes are those
    of the chord less a rotation; q1 and q4 move the whole link, which its joint does already.

    Source: Liu, Zhu, Zhao, the link of the 3-TPT (models/3tpt/SOURCE.md).
    """
    one = hermite(length, 1, "cubic", direction=direction, shear_ratio=shear_ratio)
    if direction in BENDING:
        names = ("q2", "q6") if direction == "v" else ("q3", "q7")
        return combine(one, np.array([[-length, 0.0], [-1.0, 1.0]]), names)
    return combine(one, np.eye(1), ("q5" if direction == "u" else "q8",))


_THIN = 0.2  # sqrt(EI2 GJ) / EI1: a strip 2.3 times as high as wide; it buckles at a sag of L/4


@frozen(eq=False)
class FlexibleBody:
    """Stations, stiffness and damping of a beam in coordinates eta.

    Attributes:
        n: Number of coordinates. labels: Name of each.
        length: Length of the beam (m).
        families: Functions that span each direction. slices: Place of each in eta.
        second_order: Whether the second-order rows G exist; they are None otherwise.
        x: Stations (m), shape (ns,).
        mass: Their masses rho A w (kg), shape (ns,). End masses are not in them.
        Phi, G: Rows of their displacement (u, v, w), shapes (ns, 3, n) and (ns, 3, n, n).
        xt: Twist stations (m), shape (nt,): none without torsion or with rotary inertia.
        It: Their moments of inertia rho Ip w (kg m^2), shape (nt,).
        Phi_t, G_t: Rows of their rotation rx, shapes (nt, n) and (nt, n, n).
        inertia: rho (Ip, my, mz) w about (x, y, z) (kg m^2), shape (ns, 3); None: stations do not
            turn with inertia.
        Phi_r, G_r: Rows of their rotations (rz, ry, rx), shapes (ns, 3, n) and (ns, 3, n, n).
        K: Stiffness, shape (n, n).
        M: Linear mass matrix of the beam held at its root, shape (n, n); with the end masses,
            unless the link is cut into segments.
        D: Damping.
        root_moves: Whether the section at x = 0 moves in the frame of the beam.
        solid: What a reduced solid has beside; None for a beam.
        curvature: Its energy of fourth order, where `third_order` asks for it.
        rest: eta at which it is free of stress, shape (n,); None: all zero.
    """

    n: int
    length: float
    families: Mapping[str, Family]
    slices: Mapping[str, slice]
    labels: tuple[str, ...]
    second_order: bool
    x: Array
    mass: Array
    Phi: Array
    G: Array | None
    xt: Array
    It: Array
    Phi_t: Array
    K: Array
    M: Array
    D: Array
    G_t: Array | None = None
    inertia: Array | None = None
    Phi_r: Array | None = None
    G_r: Array | None = None
    root_moves: bool = False
    solid: Superelement | None = None
    curvature: Curvature | None = None
    rest: Array | None = None

    @cached_property
    def cut(self) -> Cut:
        """Sections at which outputs are taken."""
        return cut(self)

    @property
    def points(self) -> Array:
        """Places of the stations (m), shape (ns, 3)."""
        return np.outer(self.x, [1.0, 0.0, 0.0]) if self.solid is None else self.solid.points

    @property
    def interfaces(self) -> tuple[float, ...]:
        """Ends (m) whose sections move: the tip, and the root of families not clamped there."""
        return (0.0, self.length) if self.root_moves else (self.length,)

    def moves_as(self, other: FlexibleBody) -> bool:
        """Whether sections move as those of another beam: masses and stiffness may differ.

        Functions that do not depend on these are kept (`plain_shapes`), and are then the same.
        """
        mine, theirs = (
            (x.families, x.slices, x.length, x.second_order, x.inertia is None, x.root_moves)
            for x in (self, other)
        )
        beams = all(x.solid is None and x.curvature is None for x in (self, other))
        return beams and mine == theirs

    def rows(self, x: float) -> tuple[Array, Array | None]:
        """Rows (u, v, w, rz, ry, rx) of the section at x (m): Phi (6, n) and G (6, n, n)."""
        if self.solid is not None:
            return self.solid.rows(x)
        if x not in self._rows:  # equal links share their body, and loads ask again
            at = np.array([float(x)])
            Phi, G = beam.first_order(self.families, self.slices, at)[0], None
            if self.second_order:
                G = beam.second_order(self.families, self.slices, at, range(6))[0]
            self._rows[x] = Phi, G
        return self._rows[x]

    @cached_property
    def _rows(self) -> dict[float, tuple[Array, Array | None]]:
        return {}

    def fields(self, x: Array) -> dict[str, Array]:
        """Linear output rows at x (m), shape (nx,).

        Returns:
            deflection (u, v, w, rx, ry, rz), shape (nx, 6, n), and, of the directions present,
            axial (u'), curvature_v, curvature_w, shear_v, shear_w and twist (p'), shape (nx, n).
        """
        x = np.atleast_1d(np.asarray(x, dtype=np.float64))
        if self.solid is not None:
            return self.solid.fields(x)
        Phi = beam.first_order(self.families, self.slices, x)
        out = {"deflection": Phi[:, [0, 1, 2, 5, 4, 3]]}
        names = {"u": "axial", "v": "curvature_v", "w": "curvature_w", "p": "twist"}
        for direction, family in self.families.items():
            F = family.evaluate(x)
            out[names[direction]] = row = np.zeros((len(x), self.n))
            row[:, self.slices[direction]] = F.curv
            if family.shear:
                out[f"shear_{direction}"] = row = np.zeros((len(x), self.n))
                row[:, self.slices[direction]] = F.df - F.rot
        return out


def flexible_body(link: FlexibleLink, planes: Sequence[str], length: float) -> FlexibleBody:
    """Build the stations, stiffness and damping of a flexible link.

    craig_bampton: static end shapes and fixed-interface modes of polynomials; finite_element:
    Hermite elements; assumed: analytic bending modes, sines or polynomials for stretch and twist.
    """
    density = link.material.rho
    assert density is not None  # where it follows from the URDF's mass, `resolve` has it
    families, slices, K, M = _directions(link, planes, length, density)
    n, D = len(K), damping(link, slices, K, M)
    section, rotary = link.section, link.rotary_inertia is True
    # Two points at least: a rigid rotation of the beam is of first degree in x.
    gauss = max([f.gauss for d, f in families.items() if d != "p" or rotary], default=2)
    breaks = beam.union([f.breaks for f in families.values()])
    x, w = (a.ravel() for a in quadrature(breaks, gauss))
    xt = wt = np.zeros(0)
    if "p" in families and not rotary:  # stations that only turn about the beam
        xt, wt = (a.ravel() for a in quadrature(families["p"].breaks, families["p"].gauss))
    Phi, Phi_t = (beam.first_order(families, slices, at) for at in (x, xt))
    G = G_t = None
    if link.second_order:
        G = beam.second_order(families, slices, x, range(6 if rotary else 3))
        G_t = beam.second_order(families, slices, xt, (5,))[:, 0]
    sections = np.abs(beam.first_order(families, slices, np.append(0.0, x)))
    return FlexibleBody(
        n=n,
        length=length,
        families=families,
        slices=slices,
        labels=tuple(
            f"{d}{name}" if name.isdigit() else f"{d} {name}"
            for d, family in families.items()
            for name in family.names
        ),
        second_order=link.second_order,
        x=x,
        mass=density * section.A * w,
        Phi=Phi[:, :3],
        G=None if G is None else G[:, :3],
        xt=xt,
        It=density * section.Ip * wt,
        Phi_t=Phi_t[:, 5],
        G_t=G_t,
        inertia=density * np.outer(w, [section.Ip, *section.turning]) if rotary else None,
        Phi_r=Phi[:, 3:] if rotary else None,
        G_r=G[:, 3:] if rotary and G is not None else None,
        K=K,
        M=M,
        D=D,
        # Against the largest along the beam, entry by entry: each has its own unit.
        root_moves=bool(np.any(sections[0] > 1e-9 * sections.max(axis=0))),
        curvature=_curvature(link, families, slices, n),
        rest=_stretched(link, families, slices, K),
    )


def _directions(
    link: FlexibleLink, planes: Sequence[str], length: float, density: float
) -> tuple[dict[str, Family], dict[str, slice], Array, Array]:
    """Functions and coordinates of each direction, stiffness and mass of all, each (n, n)."""
    families: dict[str, Family] = {}
    slices: dict[str, slice] = {}
    blocks: dict[str, tuple[Array, Array]] = {}
    n = 0
    for direction in (d for d in DIRECTIONS if d in planes):
        family = _family(link, direction, length, planes)
        K, M, plain = beam_energy(link, direction, family, density)
        if link.basis.kind == "craig_bampton":
            if plain:
                family, T = plain_shapes(family, direction, link.basis.internal)
            else:
                T, names = craig_bampton(family, direction, K, M, link.basis.internal)
                family = combine(family, T, names)
            K, M = (0.5 * (x + x.T) for x in (T.T @ K @ T, T.T @ M @ T))
        families[direction], blocks[direction] = family, (K, M)
        slices[direction], n = slice(n, n + family.n), n + family.n
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for direction, at in slices.items():
        K[at, at], M[at, at] = blocks[direction]
    return families, slices, K, M


def _curvature(
    link: FlexibleLink, families: Mapping[str, Family], slices: Mapping[str, slice], n: int
) -> Curvature | None:
    """The energy of fourth order of a link with `third_order`; other links have none."""
    second = {"v": link.section.Iz, "w": link.section.Iy}
    bending = [second[d] for d in BENDING if d in families]
    if not link.third_order or not bending:
        return None
    what = (
        "without second_order"
        if not link.second_order
        else "with shear"
        if link.shear is True
        else ""
    )
    if max(bending) > (1.0 + 1e-6) * min(bending):
        what = f"in two planes of unlike stiffness (Iy {link.section.Iy:g}, Iz {link.section.Iz:g})"
    if what:
        raise DescriptionError(
            f"flexible.{link.link}.third_order: not for a beam that bends {what}. Leave it out, "
            "and raise segments where the deflection is large.",
            link=link.link,
        )
    return curvature(families, slices, n, link.material.E * bending[0])


def _stretched(
    link: FlexibleLink, families: Mapping[str, Family], slices: Mapping[str, slice], K: Array
) -> Array | None:
    """K^-1 f of a warm link, f = int EA alpha T u' dx: the stretch of a bar that nothing holds."""
    if not link.temperature:
        return None
    u, at, rest = families["u"], slices["u"], np.zeros(len(K))
    strain = (link.material.thermal_expansion or 0.0) * link.temperature
    root, tip = u.evaluate(np.array([0.0, u.length])).f
    rest[at] = np.linalg.solve(K[at, at], link.material.E * link.section.A * strain * (tip - root))
    return rest


def tips_over(link: FlexibleLink, planes: Collection[str]) -> bool:
    """Whether bending in the stiff plane can buckle the beam sideways at a small deflection.

    A tip load P = 4.01 sqrt(EI2 GJ)/L^2 does so (Prandtl's cantilever), at a sag of 1.3 L times
    sqrt(EI2 GJ)/EI1. The twist is then a quarter wave and more, which the one shape of a bar that
    is turned at its end has not: it makes that load 36 % too high, one mode more 2 %.
    """
    if link.basis.kind != "craig_bampton" or link.basis.internal < 2:
        return False
    if not {"v", "w", "p"} <= set(planes):
        return False
    soft, stiff = sorted((link.section.Iy, link.section.Iz))
    E, G = link.material.E, link.material.G
    return float(np.sqrt(E * soft * G * link.section.J)) < _THIN * E * stiff


def _family(link: FlexibleLink, direction: str, length: float, planes: Collection[str]) -> Family:
    """Functions that span a direction, before any recombination."""
    basis, section, material = link.basis, link.section, link.material
    ratio = 0.0
    if link.shear is True and direction in BENDING:
        second, k = bending(section, direction)
        ratio = material.E * second / (k * material.G * section.A)
    if basis.kind == "finite_element":
        free = basis.boundary == "free_free" and direction in BENDING
        root = "free" if free else "clamped"
        return hermite(length, basis.elements, basis.order, root, direction, ratio)
    if basis.kind == "assumed":
        if direction in BENDING:
            return assumed(length, basis.boundary, basis.modes)
        if basis.stretch == "polynomials":
            return polynomial(length, basis.modes, direction)
        return sines(length, basis.modes)
    if basis.kind == "ritz8":
        return ritz8(length, direction, ratio)
    # Stretch and twist live far above bending: two internal modes fewer cost nothing there.
    n = basis.internal + 2 if direction in BENDING else max(basis.internal - 2, 0) + 1
    if direction == "p" and tips_over(link, planes):
        n += 1
    free = ratio > 0.0 and link.rotary_inertia is True and link.free_shear
    return polynomial(length, n, direction, ratio, free)
