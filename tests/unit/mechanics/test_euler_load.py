"""The buckling load that a run's compression is held against."""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.recovery.validity import euler_load


def test_a_strip_buckles_across_its_thin_side() -> None:
    part = pf.load(
        "cantilever", ["flexible.beam.bending_y=true", "flexible.beam.bending_z=true"]
    ).parts["beam"]
    size = dict(part.spec.section.dimensions)
    thin, wide = sorted((size["thickness"], size["width"]))
    assert thin < wide
    exact = np.pi**2 * part.spec.material.E * wide * thin**3 / 12 / part.length**2
    assert euler_load(part) == pytest.approx(exact, rel=1e-12)
