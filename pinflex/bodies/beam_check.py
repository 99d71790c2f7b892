"""Whether the numbers of a flexible link make sense, before anything is built of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.description.flexible import BEAM_BASES, BOUNDARIES, ORDERS
from pinflex.errors import DescriptionError, nearest

if TYPE_CHECKING:
    from pinflex.description.flexible import FlexibleLink

DIRECTIONS = ("u", "v", "w", "p")
_SECOND = {"v": "Iz", "w": "Iy", "p": "J"}  # of the section, that a direction deforms against


def checked_density(
    link: FlexibleLink, planes: Sequence[str], length: float, rho: float | None
) -> float:
    """Density (kg/m^3) of a link whose numbers make sense; anything else is an error."""
    if not planes or not set(planes) <= set(DIRECTIONS):
        text = f"directions {tuple(planes)} are not some of {DIRECTIONS}. Name those that deform."
        raise _wrong(link, "", text)
    _require_basis(link)
    density = link.material.rho if rho is None else rho
    if density is None:
        text = "the density is to follow from the mass in the URDF, but rho is not given. "
        raise _wrong(link, ".material.rho", text + "Give a number.")
    for key, value in _sizes(link, planes, length, density).items():
        if not 0.0 < value < np.inf:
            raise _wrong(link, f".{key}", f"{value!r} is not a finite number above 0. Give one.")
    if link.basis.internal < 0:
        text = f"{link.basis.internal} is negative. Give 0, 1, 2, ..."
        raise _wrong(link, ".basis.internal", text)
    return density


def _wrong(link: FlexibleLink, key: str, text: str) -> DescriptionError:
    return DescriptionError(f"flexible.{link.link}{key}: {text}", link=link.link)


def _require_basis(link: FlexibleLink) -> None:
    """Known words, and shear only in functions that have it."""
    basis = link.basis
    for key, name, known in (
        ("kind", basis.kind, BEAM_BASES),
        ("order", basis.order, ORDERS),
        ("boundary", basis.boundary, BOUNDARIES),
    ):
        if name not in known:
            raise _wrong(link, f".basis.{key}", f'unknown {key} "{name}".{nearest(name, known)}')
    what = {"assumed": "assumed modes", "finite_element": f"{basis.order} elements"}
    if link.shear is True and what.get(basis.kind, "cubic elements") != "cubic elements":
        text = f"{what[basis.kind]} have no shear. Use finite_element of order cubic, or "
        raise _wrong(link, ".shear", text + "craig_bampton.")


def _sizes(
    link: FlexibleLink, planes: Sequence[str], length: float, density: float
) -> dict[str, float]:
    """Every number that must be finite and above 0, by its key in the YAML."""
    section, material = link.section, link.material
    needed = ["A", *(key for d, key in _SECOND.items() if d in planes)]
    needed += ["ky", "kz"] if link.shear is True else []
    sizes = {"length": length, "material.E": material.E, "material.rho": density}
    sizes |= {"material.G": material.G} if link.shear is True or "p" in planes else {}
    sizes |= {f"section.{key}": getattr(section, key) for key in needed}
    return sizes | {"basis.elements": link.basis.elements, "basis.modes": link.basis.modes}
