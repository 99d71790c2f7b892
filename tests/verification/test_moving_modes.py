"""Modes about motions: whirling shafts, instants of runs; the rotating beam has its own file.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - of a growing pair of eigenvalues one is kept, of decaying ones both | by hand | 1e-12 | passes
    - `modes(at=)`: a shaft whirls at its frequency +- the spin, in circles; damped inside, it runs
      away beyond its critical speed | closed form, roots of a quadratic | 1e-6 | passes
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.levels.modes import _quadratic
from tests.scenes import Body, load

SHAFT = """
gravity: [0, 0, 0]
actuated: [hub_joint]
flexible:
  beam:
    material: {E: 1, nu: 0.3, rho: 1}
    section: {shape: given, A: 1, Iy: 1, Iz: 1, J: 1}
    basis: {internal: 6}
    end: tip
    bending_y: true
    bending_z: true
    torsion: false
    axial: false
    damping: {rayleigh: [0, 0]}
motion: {kind: hold, duration: 1.0}
"""
BODIES = (
    Body("hub", "base", "continuous", axis=(1, 0, 0), mass=1.0, inertia=(1, 1, 1)),
    Body("beam", "hub"),
    Body("tip", "beam", xyz=(1, 0, 0)),
)
OMEGA = np.array([1.87510407, 4.69409113]) ** 2  # [rad/s] clamped-free, E I = rho A = L = 1


def shaft(folder: Path, *overrides: str) -> pf.Mechanism:
    return load(folder, BODIES, SHAFT, overrides)


@pytest.mark.parametrize("spin", [0.5, 2.0, 10.0])
def test_a_round_shaft_whirls_at_its_frequency_plus_and_minus_the_spin(
    spin: float, tmp_path: Path
) -> None:
    """Seen from the turning shaft a circular motion at omega is one at omega -+ spin."""
    found = pf.modes(shaft(tmp_path), at={"hub_joint": spin})
    expected = np.sort(np.abs(np.concatenate([OMEGA - spin, OMEGA + spin])))
    # 1e-6: what six internal modes leave of the second frequency
    assert 2 * np.pi * np.sort(found.frequencies)[:4] == pytest.approx(expected, rel=1e-6)
    assert found.growth is not None and np.abs(found.growth).max() < 1e-9
    assert found.about == f"the steady motion hub_joint = {spin:g} (rad/s, m/s)"
    # A circle: as large in both directions, a quarter of a turn apart.
    first = found.shapes[1:, 0]
    y, z = np.split(first[np.abs(first) > 1e-9 * np.abs(first).max()], 2)
    assert y / z == pytest.approx(np.full(len(y), (y / z)[0]), abs=1e-6)
    assert abs((y / z)[0]) == pytest.approx(1.0, abs=1e-6)
    assert (y / z)[0].real == pytest.approx(0.0, abs=1e-6)


def test_damping_in_the_shaft_makes_it_whirl_up_beyond_its_critical_speed(tmp_path: Path) -> None:
    """s^2 + 2 i W s - W^2 + b w^2 s + w^2 = 0 for u = y + i z: the roots of a quadratic."""
    b, w = 0.01, OMEGA[0]
    robot = shaft(tmp_path, f"flexible.beam.damping.rayleigh=[0, {b}]")
    for spin in (2.0, 5.0):
        roots = np.roots([1.0, 2j * spin + b * w**2, w**2 - spin**2])
        found = pf.modes(robot, at={"hub_joint": spin})
        assert found.growth is not None
        s = found.growth + 2j * np.pi * found.frequencies
        for root in roots:
            exact = root if root.imag > 0 else root.conjugate()
            assert np.min(np.abs(s - exact)) < 1e-6 * abs(exact)
        assert (found.growth.max() > 0) == (spin > w)  # Jeffcott's rotor with internal damping


def test_an_instant_of_a_run_at_rest_has_the_modes_of_its_pose() -> None:
    robot = pf.load("cantilever")
    run = pf.solve(robot, level="quasistatic", until=0.1, samples=3)
    # exact to what round-off of two eigenvalue problems leaves
    expected = pf.modes(robot, count=4).frequencies
    for at in ((run, 0.1), 0.1):
        assert pf.modes(robot, at=at, count=4).frequencies == pytest.approx(expected, rel=1e-6)


def test_the_command_says_growth_and_refuses_two_motions(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["modes", "spinning_beam", "--spin", "hub=5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["about"].startswith("the steady motion hub = 5")
    assert {"frequency", "growth"} <= found["modes"][0].keys()
    assert main(["modes", "spinning_beam", "--spin", "hub=5", "--at", "1"]) == 2
    assert "Give one of them" in capsys.readouterr().err
    assert main(["modes", "spinning_beam", "--spin", "hob=5"]) == 2
    assert 'hob: not a motor. Did you mean "hub"?' in capsys.readouterr().err


def test_a_pose_and_a_motion_exclude_each_other(tmp_path: Path) -> None:
    robot = shaft(tmp_path)
    with pytest.raises(pf.DescriptionError, match="a pose or a motion"):
        pf.modes(robot, robot.home, at=0.0)


def test_of_a_growing_pair_one_is_kept_and_decaying_ones_are() -> None:
    """s^2 = 4 has s = 2 and its twin -2; s^2 + 4 s + 3 = 0 has s = -1 and -3; s^2 = -25 has 5i."""
    C, K = np.diag([0.0, 4.0, 0.0]), np.diag([-4.0, 3.0, 25.0])
    s, _ = _quadratic(np.eye(3), C, K)
    np.testing.assert_allclose(s, [-1, 2, -3, 5j], atol=1e-12)
