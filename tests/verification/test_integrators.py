"""Orders of the integrators on a pendulum in Cartesian coordinates: the smallest index-3 problem.

IFToMM benchmark A01: m = 1 kg, L = 1 m, g = 9.81 m/s^2, released horizontally. Position at 1 s from
elliptic functions; speed from energy; tension 3 m g |z| / L.

Claims:
    Levels, energy, steps
    - pendulum loop (IFToMM A01): position, velocity, tension of order 2 | +- 0.05, 0.05, 0.1 |
      2.00, 2.00, 2.00 (generalized_alpha)
    - trapezoidal rule: tension rings, order 1 (documented contrast) | +- 0.2 | 1.06
    - Newmark with the published gamma = 0.528: order 1 | +- 0.15 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.finite import slope
from tests.scenes import Body, load

POINT = (
    Body("x", "base", "prismatic", axis=(1, 0, 0)),
    Body("z", "x", "prismatic", axis=(0, 0, 1), mass=1.0),
    Body("pivot", "base"),
)
YAML = """
actuated: []
home: {x_joint: 1.0}
loops: {rod: {kind: distance, between: [z, pivot], length: 1}}
"""
AFTER_ONE_SECOND = (-0.986291751132, -0.165010853126)  # [m]
STEPS = (1e-2, 5e-3, 2.5e-3, 1.25e-3)  # [s]
SCHEMES = {
    "generalized_alpha": {},
    "generalized_alpha, rho_inf 0.5": {"rho_inf": 0.5},
    "hht": {"integrator": "hht"},
    "trapezoidal": {"integrator": "newmark"},
}


def errors(folder: Path, **keys: object) -> np.ndarray:
    """Errors of position [m] and velocity [m/s] at 1 s, largest of the tension [N]; (steps, 3)."""
    m = load(folder, POINT, YAML)
    found = []
    for dt in STEPS:
        r = pf.solve(m, pf.hold(duration=1.0), level="coupled", dt=dt, samples=101, **keys)
        q, v = r.arrays["joint/q"], r.arrays["joint/v"]
        x, z = AFTER_ONE_SECOND
        # It swings left at 0.5 s and is on its way back at 1 s: the period is 2.368 s.
        speed = np.sqrt(2 * 9.81 * -z) * np.array([z, -x]) * -1.0
        speed *= np.sign(speed @ v[-1])
        tension = 3 * 9.81 * -q[:, 1]
        found.append(
            (
                np.abs(q[-1] - AFTER_ONE_SECOND).max(),
                np.abs(v[-1] - speed).max(),
                np.abs(np.abs(r.arrays["multiplier"][:, 0]) - tension).max(),
            )
        )
        assert r.worst_closure < 1e-9  # [m] no drift, whatever the step
        assert r.worst_closure < 1e-7 * dt
    return np.array(found)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_positions_and_velocities_are_of_second_order(scheme: str, tmp_path: Path) -> None:
    error = errors(tmp_path, **SCHEMES[scheme])
    assert slope(STEPS, error[:, 0]) == pytest.approx(2.0, abs=0.05)
    assert slope(STEPS, error[:, 1]) == pytest.approx(2.0, abs=0.05)
    assert error[-1, 0] < 5e-5


@pytest.mark.parametrize("scheme", [s for s in SCHEMES if s != "trapezoidal"])
def test_multipliers_are_of_second_order_too(scheme: str, tmp_path: Path) -> None:
    """Order one here would mean a wrong initial algorithmic acceleration."""
    error = errors(tmp_path, **SCHEMES[scheme])
    # Without the finest step, where rho_inf = 0.5 does even better.
    assert slope(STEPS[:3], error[:3, 2]) == pytest.approx(2.0, abs=0.1)
    assert error[-1, 2] < 1e-4 * 3 * 9.81


def test_the_trapezoidal_rule_has_ringing_multipliers(tmp_path: Path) -> None:
    """The documented contrast: same positions, tension a hundred times worse, first order."""
    error = errors(tmp_path, **SCHEMES["trapezoidal"])
    assert slope(STEPS[:3], error[:3, 2]) == pytest.approx(1.0, abs=0.2)
    assert error[0, 2] > 50 * errors(tmp_path)[0, 2]


def test_published_newmark_coefficients_with_gamma_above_a_half_are_of_first_order(
    tmp_path: Path,
) -> None:
    error = errors(tmp_path, integrator="newmark", newmark=(0.5280, 0.2642))
    assert slope(STEPS, error[:, 0]) == pytest.approx(1.0, abs=0.15)


def test_a_hundred_swings_later_the_rod_is_as_long_as_ever(tmp_path: Path) -> None:
    m = load(tmp_path, POINT, YAML)
    r = pf.solve(m, pf.hold(duration=60.0), level="coupled", dt=1e-2, samples=601)
    length = np.hypot(*r.arrays["joint/q"].T)
    np.testing.assert_allclose(length, 1.0, atol=1e-9)
    energy = r.arrays["energy/kinetic"] + r.arrays["energy/gravity"]
    assert np.abs(energy - energy[0]).max() < 0.02 * 9.81  # rho_inf = 0.8 takes a little
