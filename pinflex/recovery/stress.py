"""Section forces and stresses of a flexible body, from the forces that its stations need.

Cut the link at x: the inner part must give the outer part the force R(x) and moment that its masses
and whatever hangs on it need. That balance is exact where the shapes' own curvature (EI v'') is not
yet converged, and it gives the axial force of links that have no axial mode.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from pinflex.arrays import Array
from pinflex.bodies import beam
from pinflex.bodies.basis import FlexibleBody
from pinflex.description.section import Section


@dataclass(frozen=True)
class Cut:
    """Outputs of one body at sections x: deflection rows and the balance operator.

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


def cut(body: FlexibleBody, count: int = 21) -> Cut:
    """Sections at equal distances along a body.

    Args:
        body: Flexible body.
        count: Sections.
    """
    if body.solid is not None:
        solid = body.solid
        return Cut(solid.x, solid.Phi, solid.G, solid.outer, np.zeros((len(solid.x), 0)))
    x = np.linspace(0.0, body.length, count)
    families, slices = body.families, body.slices
    Phi = beam.first_order(families, slices, x)
    G = beam.second_order(families, slices, x, range(6)) if body.second_order else None
    breaks = _breaks(body)
    return Cut(x, Phi, G, _outer(x, body.x, breaks), _outer(x, body.xt, breaks))


def _breaks(body: FlexibleBody) -> Array:
    edges = np.concatenate([family.breaks for family in body.families.values()])
    return np.unique(np.round(edges / body.length, 12)) * body.length


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


def deflections(section: Cut, eta: Array) -> Array:
    """Rows (u, v, w, rz, ry, rx) over time, shape (nt, nx, 6), for eta of shape (nt, n).

    Args:
        section: From `cut`.
        eta: Elastic coordinates of the body, shape (nt, n).
    """
    (sections, rows, n), count = section.Phi.shape, len(eta)
    d: Array = eta @ section.Phi.reshape(-1, n).T
    if section.G is not None:
        bent = (eta @ section.G.reshape(-1, n).T).reshape(count, -1, n)
        d += 0.5 * (bent @ eta[:, :, None])[:, :, 0]
    return d.reshape(count, sections, rows)


def resultants(
    section: Cut,
    body: FlexibleBody,
    d: Array,
    station: Array,
    twist: Array,
    loads: list[tuple[float, Array, Array]],
    eta: Array,
) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz, shape (nt, nx, 6).

    Args:
        section: Sections. body: The body. d: `deflections`, shape (nt, nx, 6).
        station: Forces the stations need, beam frame, shape (nt, ns, 3), N.
        twist: Torques the twist stations need, shape (nt, nt_stations), N m.
        loads: Interfaces: x, force and moment about the displaced section, each (nt, 3), that what
            hangs there needs.
        eta: Shape (nt, n).
    Returns:
        N > 0 in tension; V, T and M are what the inner part receives from the outer.
    """
    Phi = body.Phi
    where: Array = np.einsum("sdn,tn->tsd", Phi, eta, optimize=True)
    where[:, :, 0] += body.x
    arm = np.cross(where, station)
    force = np.einsum("xs,tsd->txd", section.outer, station, optimize=True)
    moment = np.einsum("xs,tsd->txd", section.outer, arm, optimize=True)
    if len(body.xt):
        moment[:, :, 0] += twist @ section.outer_twist.T
    place = d[:, :, :3].copy()
    place[:, :, 0] += section.x
    for x, pull, turn in loads:
        beyond = section.x <= x * (1 + 1e-12)
        k = int(np.argmin(np.abs(section.x - x)))
        at = place[:, k] + np.array([x - section.x[k], 0.0, 0.0])
        force[:, beyond] += pull[:, None]
        moment[:, beyond] += (turn + np.cross(at, pull))[:, None]
    moment -= np.cross(place, force)
    return -np.concatenate([force, moment], axis=2)


def stresses(section: Section, forces: Array) -> dict[str, Array]:
    """Largest stresses of each section, Pa, shapes (nt, nx).

    normal = axial + bending at the worst fibre; shear from torsion, largest on the section;
    von_mises = sqrt(normal^2 + 3 shear^2): an upper bound where the maxima are at two points.

    Args:
        section: Cross-section.
        forces: Section forces N Vy Vz T My Mz, shape (nt, nx, 6).
    """
    N, T = forces[:, :, 0], forces[:, :, 3]
    My, Mz = forces[:, :, 4], forces[:, :, 5]
    axial = N / section.A
    fibres = np.array(section.fibres)
    half = len(fibres) // 2
    rest = np.abs(fibres[:half] + fibres[-half:])
    opposite = 2 * half == len(fibres) and np.all(rest < 1e-12 * np.max(np.abs(fibres)))
    most, least = np.zeros_like(N), np.zeros_like(N)  # of bending, over the fibres
    for y, z in fibres[:half] if opposite else fibres:
        fibre = My * (z / section.Iy)
        fibre -= Mz * (y / section.Iz)
        np.maximum(most, fibre, out=most)
        np.minimum(least, fibre, out=least)
    bending = np.maximum(most, -least)
    if opposite:  # each stands for the one across too
        most, least = bending, -bending
    normal = np.maximum(axial + most, -(axial + least))
    shear = np.abs(T) / section.Wt
    return {
        "axial": axial,
        "bending": bending,
        "normal": normal,
        "shear": shear,
        "von_mises": np.hypot(normal, np.sqrt(3.0) * shear),
    }
