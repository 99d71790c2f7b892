"""A satellite: a hub and two flexible panels, free in space, against a finite-element beam.

Claims:
    Levels, energy, steps
    - a satellite's first four frequencies, `check`, `modes`, `idle: free`, their sensitivity to E |
      own Hermite beams on a free hub | 1e-3 | 2e-5
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import pinflex as pf
from pinflex.arrays import Array
from pinflex.studies.checking.check import check
from tests.scenes import Body, load

HUB, TURN, RADIUS, LENGTH = 100.0, 10.0, 0.5, 2.0  # [kg], [kg m^2] each axis, [m], [m]
E, WIDTH, THICK, RHO = 7.0e10, 0.3, 0.01, 2700.0
EI, RHO_A = E * WIDTH * THICK**3 / 12, RHO * WIDTH * THICK

BODIES = (
    Body("hub", "base", mass=HUB, inertia=(TURN,) * 3),
    Body("left", "hub", xyz=(RADIUS, 0, 0), mass=RHO_A * LENGTH, com=(LENGTH / 2, 0, 0),
         inertia=(0.1, 1.8, 1.8)),
    Body("right", "hub", xyz=(-RADIUS, 0, 0), rpy=(0, 0, np.pi), mass=RHO_A * LENGTH,
         com=(LENGTH / 2, 0, 0), inertia=(0.1, 1.8, 1.8)),
    Body("left_tip", "left", xyz=(LENGTH, 0, 0)),
    Body("right_tip", "right", xyz=(LENGTH, 0, 0)),
)  # fmt: skip
PANEL = f"""
    material: {{E: {E}, nu: 0.3, rho: {RHO}}}
    section: {{shape: rectangle, width: {THICK}, thickness: {WIDTH}}}
    bending_y: false
    bending_z: true
    torsion: false
    axial: false
    basis: {{kind: craig_bampton, internal: 3}}
"""
YAML = f"""
base: free_flyer
actuated: []
gravity: [0, 0, 0]
flexible:
  left:
    end: left_tip{PANEL}
  right:
    end: right_tip{PANEL}
"""


def bar(length: float) -> tuple[Array, Array]:
    """Stiffness and mass of a Hermite element."""
    a = length
    K = np.array([[12, 6*a, -12, 6*a], [6*a, 4*a*a, -6*a, 2*a*a], [-12, -6*a, 12, -6*a],
                  [6*a, 2*a*a, -6*a, 4*a*a]]) * EI / a**3  # fmt: skip
    M = np.array([[156, 22*a, 54, -13*a], [22*a, 4*a*a, 13*a, -3*a*a], [54, 13*a, 156, -22*a],
                  [-13*a, -3*a*a, -22*a, 4*a*a]]) * RHO_A * a / 420  # fmt: skip
    return K, M


def frequencies(held: bool) -> Array:
    """Bending of the two panels out of their plane, the hub rigid between them, Hz."""
    n, a = 40, LENGTH / 40
    size = 2 + 4 * n  # hub: height and slope; then each panel's
    K, M = np.zeros((size, size)), np.zeros((size, size))
    M[0, 0], M[1, 1] = HUB, TURN
    for side, first in ((1.0, 2), (-1.0, 2 + 2 * n)):
        T = np.zeros((2 * n + 2, size))  # height and slope along the panel, by all coordinates
        T[0, :2], T[1, :2] = (1.0, side * RADIUS), (0.0, side)
        T[2:, first : first + 2 * n] = np.eye(2 * n)
        for k in range(n):
            k_e, m_e = bar(a)
            rows = T[2 * k : 2 * k + 4]
            K, M = K + rows.T @ k_e @ rows, M + rows.T @ m_e @ rows
    some = slice(2 if held else 0, None)
    omega2 = eigh(K[some, some], M[some, some], eigvals_only=True)
    return np.asarray(np.sqrt(np.abs(omega2[0 if held else 2 :])) / (2 * np.pi))


def satellite(folder: Path, *changes: str) -> pf.Mechanism:
    return load(folder, BODIES, YAML, changes)


@pytest.mark.parametrize("idle", ["held", "free"])
def test_its_frequencies_are_those_of_a_free_hub(idle: str, tmp_path: Path) -> None:
    robot = satellite(tmp_path, f"idle={idle}")
    reference = frequencies(held=False)[:4]
    found = pf.modes(robot, count=40)
    lively = found.frequencies[found.frequencies > 1e-3]
    # 1e-3: three inner shapes a panel; shear and rotary inertia are left out on both sides.
    np.testing.assert_allclose(lively[:4], reference, rtol=1e-3)
    looked = check(robot)
    np.testing.assert_allclose(looked.frequencies[:4], reference, rtol=1e-3)
    assert "6 rigid-body modes at 0 Hz" in looked.frequency_note
    if idle == "held":
        assert len(lively) == len(found.frequencies) and found.rigid_body == 6
        assert "base free" in looked.frequency_note


def test_under_gravity_the_hub_is_held_and_check_says_so(tmp_path: Path) -> None:
    robot = satellite(tmp_path, "gravity=[0, -1e-3, 0]")
    looked = check(robot)
    assert "base held" in looked.frequency_note
    np.testing.assert_allclose(looked.frequencies[:2], frequencies(held=True)[:2], rtol=1e-3)


def test_the_slope_of_its_frequencies_is_that_of_the_free_hub(tmp_path: Path) -> None:
    """All frequencies go with the root of Young's modulus, half of it with either panel's."""
    robot = satellite(tmp_path)
    by = [f"flexible.{side}.material.E" for side in ("left", "right")]
    found = pf.sensitivities(robot, by=by, of=["frequency.1", "frequency.2"])
    np.testing.assert_allclose(found.table, 0.25, atol=1e-6)  # each half of the exponent 1/2
    np.testing.assert_allclose(found.values, frequencies(held=False)[:2], rtol=1e-3)
