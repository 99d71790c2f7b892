"""Section forces and stresses of a flexible body, from the forces that its stations need.

Cut the link at x: the inner part must give the outer part the force R(x) and moment that its masses
and whatever hangs on it need. That balance is exact where the shapes' own curvature (EI v'') is not
yet converged, and it gives the axial force of links that have no axial mode.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.section_at import Cut
from pinflex.description.section import Section


def deflections(section: Cut, eta: Array) -> Array:
    """Rows (u, v, w, rz, ry, rx) over time, shape (nt, nx, 6), for eta of shape (nt, n)."""
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

    Returns:
        N > 0 in tension; V, T and M are what the inner part receives from the outer.
    """
    where: Array = np.einsum("sdn,tn->tsd", body.Phi, eta, optimize=True)
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
    """
    N, _, _, T, My, Mz = np.ascontiguousarray(np.moveaxis(forces, -1, 0))  # read once per fibre
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
