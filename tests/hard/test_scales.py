"""Stiffness, mass and time over many decades: the answer scales, and nothing loses its digits.

Claims:
    Hard cases
    - EI over twelve decades: frequencies, sag, moves | 1e-4, 1e-9, 1e-5 | 2e-5
    - payload / link 1e-6 to 1e6; twist without inertia; massless joint | 2e-4; 1e-6; 1e-9 | passes
    - time scales 1e-6 to 1e6 s | 1e-8 m | passes
    - free-free modes to order 50 | 1e-6 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load

WAVE = 1.8751040687119611  # first clamped-free root
ARM = (
    Body("beam", "base", "revolute"),
    Body("tip", "beam", xyz=(1, 0, 0)),
)


def arm(folder: Path, E: float, *, payload: float = 0.0, rho: float = 1.0, extra: str = "",
        gravity: float = 0.0) -> pf.Mechanism:  # fmt: skip
    bodies = (ARM[0], Body("tip", "beam", xyz=(1, 0, 0), mass=payload))
    yaml = f"""
gravity: [0, {-gravity!r}, 0]
flexible:
  beam:
    material: {{E: {E!r}, nu: 0.3, rho: {rho!r}}}
    section: {{shape: given, A: 1, Iy: 1, Iz: 1, J: 1}}
    end: tip
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
    {extra}
"""
    return load(folder, bodies, yaml)


@pytest.mark.parametrize("decade", range(-4, 9))
def test_bending_stiffness_over_twelve_decades_scales_frequencies_and_deflection(
    decade: int, tmp_path: Path
) -> None:
    E = 10.0**decade
    m = arm(tmp_path, E, gravity=1e-3 * E)
    omega = 2 * np.pi * pf.modes(m, preload="none").frequencies
    # Two internal modes: 2e-5 measured in the first frequency, the same at every stiffness.
    assert omega[0] == pytest.approx(WAVE**2 * np.sqrt(E), rel=1e-4)
    sag = pf.linear_statics(m).y[1:]
    assert sag[0] == pytest.approx(-1e-3 / 8, rel=1e-9)  # w L^4 / 8 EI


@pytest.mark.parametrize("decade", range(-2, 11, 2))
def test_a_move_over_twelve_decades_of_stiffness_ends_in_the_rigid_limit(
    decade: int, tmp_path: Path
) -> None:
    """The tip lags by (inertia)/(EI): times E it is one number, until rounding ends the row."""
    E = 10.0**decade
    m = arm(tmp_path, E)
    slow = 20.0 / np.sqrt(E)  # many periods of the first mode, so that the lag is static
    move = pf.quintic(joints={"beam_joint": 0.01}, duration=slow)
    run = pf.solve(m, move, level="coupled", dt=slow / 400)
    rigid = pf.solve(m, move, level="rigid")
    # The same move in units of the period: the torque's scale is E, its shape the same.
    assert run.torque[:, 0] / E == pytest.approx(REFERENCE(tmp_path), rel=1e-5, abs=1e-9)
    assert np.abs(run.torque - rigid.torque).max() < 0.5 * np.abs(rigid.torque).max()


def REFERENCE(folder: Path) -> np.ndarray:  # type: ignore[type-arg]
    if not _CACHE:
        m = arm(folder, 1.0)
        move = pf.quintic(joints={"beam_joint": 0.01}, duration=20.0)
        _CACHE.append(pf.solve(m, move, level="coupled", dt=20.0 / 400).torque[:, 0])
    return _CACHE[0]


_CACHE: list[np.ndarray] = []  # type: ignore[type-arg]


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1e3, 1e6])
def test_a_light_link_with_a_heavy_load_and_the_reverse(ratio: float, tmp_path: Path) -> None:
    """First frequency of a cantilever with a tip mass, M/(m L) over twelve decades."""
    from tests.analytical import tip_mass

    m = arm(tmp_path, 1.0, payload=ratio)
    omega = 2 * np.pi * pf.modes(m, preload="none").frequencies
    # The root finder's grid starts at b = 0.2, a ratio of 1900; above, the massless beam is exact.
    exact = np.sqrt(3 / ratio) if ratio > 100 else tip_mass(ratio, 1)[0] ** 2
    assert omega[0] == pytest.approx(exact, rel=2e-4)
    r = pf.solve(m, pf.quintic(joints={"beam_joint": 0.1}, duration=1.0), level="coupled",
                 dt=2e-3)  # fmt: skip
    assert r.meta["energy_balance"] < 1e-3
    assert np.isfinite(r.torque).all()


def test_torsion_without_inertia_follows_statically(tmp_path: Path) -> None:
    """Twist inertia of 1e-12 of the bending inertia, a load at its tip: GJ p' is its moment."""
    bodies = (
        Body("beam", "base", "revolute", axis=(1, 0, 0)),
        Body("tip", "beam", xyz=(1, 0, 0), mass=1e-9, inertia=(0.5, 1e-9, 1e-9)),
    )
    yaml = """
gravity: [0, 0, 0]
flexible:
  beam:
    material: {E: 1.0e14, G: 1.0e14, rho: 1.0}
    section: {shape: given, A: 1, Iy: 1.0e-12, Iz: 1.0e-12, J: 2.0e-12}
    end: tip
    torsion: true
"""
    m = load(tmp_path, bodies, yaml)
    found = pf.modes(m, preload="none").frequencies
    assert np.isfinite(found).all()
    # GJ/L = 200 N m/rad against 0.5 kg m^2: 20 rad/s.
    assert np.min(np.abs(2 * np.pi * found - 20.0)) < 1e-6
    move = pf.quintic(joints={"beam_joint": 1.0}, duration=40.0)
    r = pf.solve(m, move, level="coupled", dt=5e-2)
    eta = r.arrays["eta"][:, m.parts["beam"].bodies[0].slices["p"]]
    static = -0.5 * move.evaluate(r.t)[2][:, 0] / 200.0
    # The jerk of the start rings with 10.4/(T omega) = 1.3 % of the static twist.
    assert np.abs(eta[:, 0] - static).max() < 0.05 * np.abs(static).max()


def test_a_sprung_joint_without_any_mass_behind_it_is_a_spring_in_series(tmp_path: Path) -> None:
    """The joint moves a massless pin; the beam's own joint turns on it: two rows, one inertia."""
    bodies = (
        Body("pin", "base", "revolute"),
        Body("rod", "pin", "revolute", mass=1.0, com=(1, 0, 0), inertia=(1e-3, 1e-3, 1e-3)),
    )
    yaml = """
gravity: [0, 0, 0]
joints: {pin_joint: {spring: 100.0}, rod_joint: {spring: 100.0}}
actuated: []
"""
    m = load(tmp_path, bodies, yaml)
    omega = 2 * np.pi * pf.modes(m, preload="none").frequencies
    # Two springs of 100 in series under 1.001 kg m^2; the massless row has no frequency.
    assert omega[np.isfinite(omega) & (omega > 0)][0] == pytest.approx(
        np.sqrt(50 / 1.001), rel=1e-9
    )


@pytest.mark.parametrize("seconds", [1e-6, 1e-3, 1e3, 1e6])
def test_very_short_and_very_long_time_scales_are_the_same_run(
    seconds: float, tmp_path: Path
) -> None:
    """Time in other units: E / seconds^2 and the same move give the same shape."""
    r, one = (
        pf.solve(
            arm(tmp_path, 1e2 / s**2),
            pf.quintic(joints={"beam_joint": 0.1}, duration=s),
            level="coupled",
            dt=s / 500,
        )
        for s in (seconds, 1.0)
    )
    np.testing.assert_allclose(r.arrays["eta"], one.arrays["eta"], atol=1e-8)
    np.testing.assert_allclose(r.torque * seconds**2, one.torque, rtol=1e-5, atol=1e-7)


FREE = """
gravity: [0, 0, 0]
actuated: []
flexible:
  beam:
    material: {{E: 1, nu: 0.3, rho: 1}}
    section: {{shape: given, A: 1, Iy: 1, Iz: 1, J: 1}}
    basis: {{kind: assumed, boundary: free_free, modes: {modes}}}
    end: tip
    bending_y: {y}
    bending_z: {z}
    torsion: false
    axial: false
"""


@pytest.mark.parametrize("plane", ["y", "z"])
def test_free_free_modes_to_order_fifty_keep_their_digits(plane: str, tmp_path: Path) -> None:
    """Roots of cos b cosh b = 1: (k + 1/2) pi from the fifth on, to 1e-13; two are rigid."""
    bodies = (Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0)))
    y, z = (str(plane == p).lower() for p in "yz")
    m = load(tmp_path, bodies, FREE.format(modes=50, y=y, z=z))
    omega = 2 * np.pi * pf.modes(m, count=60, preload="none").frequencies
    assert len(omega) == 50
    np.testing.assert_allclose(omega[:2], 0.0, atol=1e-2)  # of 2e4
    k = np.arange(5, 49)
    np.testing.assert_allclose(omega[2:][k - 1], ((k + 0.5) * np.pi) ** 2, rtol=1e-6)
    assert omega[2] == pytest.approx(4.73004074**2, rel=1e-7)


@pytest.mark.parametrize("modes", [3, 50])
def test_a_free_basis_on_a_joint_that_moves_the_same_way_is_refused(
    modes: int, tmp_path: Path
) -> None:
    """Two coordinates for one motion: no mass matrix can be inverted, so it is said."""
    bodies = (
        Body("slide", "base", "prismatic", axis=(0, 1, 0)),
        Body("beam", "slide", "revolute"),
        Body("tip", "beam", xyz=(1, 0, 0)),
    )
    m = load(tmp_path, bodies, FREE.format(modes=modes, y="true", z="false"))
    with pytest.raises(pf.SingularityError, match="two coordinates make one motion"):
        pf.modes(m, preload="none")
