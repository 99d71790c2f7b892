"""A steel bar, as flexible bodies in any basis, for the tests of beams."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody, flexible_body
from pinflex.description.blocks.flexible import Basis, FlexibleLink
from pinflex.description.blocks.material import Material
from pinflex.description.section import Section

L = 0.8  # [m]
STEEL = Material(2.1e11, 8.0e10, 7800.0, 0.3125)
BAR = Section.rectangle(width=0.012, thickness=0.005)
CB = Basis("craig_bampton", internal=2)
QUINTIC = Basis("finite_element", elements=2, order="quintic")
CUBIC = Basis("finite_element", elements=3, order="cubic")


def body(planes: str = "v", basis: Basis = CB, **link: Any) -> Any:
    link = {"material": STEEL, "section": BAR, "basis": basis} | link
    return flexible_body(FlexibleLink("beam", **link), tuple(planes), L)


def omega(K: Array, M: Array) -> Array:
    root = np.linalg.inv(np.linalg.cholesky(K))
    return 1.0 / np.sqrt(np.linalg.eigvalsh(root @ M @ root.T)[::-1])


def bending_unit(b: FlexibleBody, direction: str = "v") -> float:
    """sqrt(EI / m L^4) (1/s)."""
    second = BAR.Iz if direction == "v" else BAR.Iy
    return float(np.sqrt(STEEL.E * second / (STEEL.rho or 0) / BAR.A) / b.length**2)
