"""Dynamic stress at any point of a section, the worst section, and the four strength theories.

    sigma = N/A + My z/Iy - Mz y/Iz,     tau from the torque T alone

x runs along the beam, (y, z) lie in the section. Shear from transverse forces is left out, as in
the source; it is of the order of (thickness / length) of the bending stress.

Source: Liu et al. (2017), J. Cent. South Univ. 24, eqs. 27 to 30; Timoshenko and Goodier, Theory
of Elasticity, section 109, for the torsion of a rectangle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.description import torsion
from pinflex.description.section import SHAPES, Section
from pinflex.errors import DescriptionError, nearest
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.results.result import Result

THEORIES = ("first", "second", "third", "fourth")


@dataclass(frozen=True)
class PointStress:
    """Stress at one point of every section of a link.

    Attributes:
        t: Times, shape (nt,), s. x: Sections, shape (nx,), m.
        sigma: Normal stress, Pa, shape (nt, nx). tau_xy, tau_xz: Shear stress, Pa, (nt, nx).
        nu: Poisson's ratio, for the second theory.
    """

    __repr__ = brief

    t: Array
    x: Array
    sigma: Array
    tau_xy: Array
    tau_xz: Array
    nu: float

    @property
    def tau(self) -> Array:
        """Magnitude of the shear stress, Pa."""
        return np.hypot(self.tau_xy, self.tau_xz)

    def equivalent(self, theory: str = "fourth") -> Array:
        """Equivalent stress by a strength theory, Pa, shape (nt, nx)."""
        return equivalent(self.sigma, self.tau, theory, self.nu)


def point_stress(
    result: Result,
    link: str,
    y: float,
    z: float,
    warping: bool = True,
    forces: Array | None = None,
) -> PointStress:
    """Stress over time at the point (y, z) of every section of a link."""
    view = result.link(link)
    section = section_of(result, link)
    _inside(section, y, z, link)
    forces = view.resultant if forces is None else forces
    N, T, My, Mz = (forces[:, :, k] for k in (0, 3, 4, 5))
    sigma = N / section.A + My * (z / section.Iy) - Mz * (y / section.Iz)
    per_y, per_z = torsion_shear(section, y, z, warping)
    material = result.meta["links"][link]["material"]
    nu = material["E"] / (2 * material["G"]) - 1.0
    return PointStress(result.t, view.x, sigma, T * per_y, T * per_z, nu)


def section_of(result: Result, link: str) -> Section:
    """Cross-section of a link, from the meta of a run.

    Raises:
        DescriptionError: A file of an older pinflex lacks its dimensions.
    """
    try:
        return Section(**result.meta["links"][link]["section"])
    except TypeError:
        raise DescriptionError(
            f"{link}: the run does not hold all of the section (an older pinflex wrote it). "
            "Solve again."
        ) from None


def torsion_shear(
    section: Section, y: float, z: float, warping: bool = True
) -> tuple[float, float]:
    """Shear stresses tau_xy and tau_xz at (y, z) for a torque of one, 1/m^3."""
    if not warping:
        return torsion.plane(section, y, z)
    field = SHAPES[section.shape].shear if section.shape in SHAPES else None
    if field is None:
        raise DescriptionError(
            f"torsion_shear: no field of shear stress for the shape {section.shape}. "
            "Use the largest one, torque / Wt (link stress `shear`), or warping=False."
        )
    return field(section, y, z)


def _inside(section: Section, y: float, z: float, link: str) -> None:
    ys, zs = (max(abs(p[k]) for p in section.fibres) for k in (0, 1))
    if abs(y) > ys * (1 + 1e-9) or abs(z) > zs * (1 + 1e-9):
        raise DescriptionError(
            f"{link}: ({y:g}, {z:g}) m is outside the section: |y| <= {ys:g}, |z| <= {zs:g}. "
            "Give a point in the beam frame."
        )


def principal(sigma: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Principal stresses s1 >= s2 = 0 >= s3 of a beam point, Pa."""
    radius = np.hypot(0.5 * sigma, tau)
    return 0.5 * sigma + radius, np.zeros_like(radius), 0.5 * sigma - radius


def equivalent(sigma: Array, tau: Array, theory: str = "fourth", nu: float = 0.3) -> Array:
    """Equivalent stress of the four strength theories, Pa."""
    s1, s2, s3 = principal(sigma, tau)
    if theory == "first":
        return s1
    if theory == "second":
        return np.asarray(s1 - nu * (s2 + s3))
    if theory == "third":
        return np.asarray(s1 - s3)
    if theory == "fourth":
        return np.asarray(np.sqrt(0.5 * ((s1 - s2) ** 2 + (s2 - s3) ** 2 + (s3 - s1) ** 2)))
    raise DescriptionError(f"theory: {theory}.{nearest(theory, THEORIES)}")


@dataclass(frozen=True)
class Worst:
    """Largest stress: link, section x (m), time t (s), value (Pa)."""

    link: str
    kind: str
    x: float
    t: float
    value: float


def worst_section(result: Result, kind: str = "von_mises", link: str | None = None) -> Worst:
    """Largest stress over time, sections and links."""
    names = [link] if link is not None else list(result.links)
    if not names:
        raise DescriptionError(
            "worst_section: a rigid run has no stresses. Solve a flexible level."
        )
    best: Worst | None = None
    for name in names:
        view = result.link(name)
        values = np.abs(view.stress(kind))
        k, j = np.unravel_index(int(np.argmax(values)), values.shape)
        if best is None or values[k, j] > best.value:
            best = Worst(name, kind, float(view.x[j]), float(result.t[k]), float(values[k, j]))
    assert best is not None
    return best
