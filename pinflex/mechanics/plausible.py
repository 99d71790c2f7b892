"""Slips of units, told by proportions that no robot has: millimetres for metres, tonnes for grams.

What is truly meant is allowed by the key `allow` of the description.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinflex.description.flexible import FlexibleLink
from pinflex.errors import DescriptionError
from pinflex.mechanics.tree import Link

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
    reach = 0.0
    place: list[pin.SE3] = []
    for link in links:
        above = place[link.parent] if link.parent >= 0 else pin.SE3.Identity()
        place.append(above * link.placement)
        reach = max(reach, float(np.linalg.norm(place[-1].translation)))
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
