"""A flexible 3-RRR, which the tests of commands share."""

from __future__ import annotations

import pytest
from scenes import published

import pinflex as pf

BEAM = "{shape: rectangle, width: 0.025, thickness: 0.004}"
CRANKS = (
    "material: {like: aluminium_7075, E: 7.1e10, nu: 0.33, rho: 2810}, "
    "basis: {kind: craig_bampton, internal: 1}, inertia: beam, axial: false"
)


@pytest.fixture(scope="module")
def planar() -> pf.Mechanism:
    """A 3-RRR with flexible cranks and distal links; first mode 17.4 Hz."""
    rod = "{shape: rectangle, width: 0.025, thickness: 0.002}"
    flexible = (
        f"flexible={{'distal_?': {{{CRANKS}, section: {rod}}}, "
        f"'crank_?': {{{CRANKS}, section: {BEAM}}}}}"
    )
    return pf.load(published("3rrr"), [flexible, "damping={rayleigh: [0, 1.0e-4]}", "motion=null"])
