"""Starts that are not nice: loads that come at once, motions that start inconsistent, no motion.

Claims:
    Hard cases
    - gravity at once rings to twice the sag; static start stays; start at speed; no motion | 5 %;
      1e-9 m; -; 1e-9 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load


def stiff_arm(folder: Path, E: float = 2e11) -> pf.Mechanism:
    bodies = (
        Body("upper", "base", "revolute", axis=(0, 1, 0)),
        Body("lower", "upper", "revolute", (1, 0, 0), axis=(0, 1, 0)),
        Body("hand", "lower", xyz=(1, 0, 0), mass=5.0, inertia=(0.01,) * 3),
    )
    yaml = f"""
gravity: [0, 0, -9.81]
home: {{lower_joint: 0.7}}
platform: hand
flexible:
  "upper, lower":
    material: {{E: {E!r}, nu: 0.3, rho: 7800}}
    section: {{shape: tube, diameter: 0.06, wall: 0.004}}
"""
    return load(folder, bodies, yaml)


def test_gravity_at_once_on_a_stiff_robot_rings_about_the_static_pose(tmp_path: Path) -> None:
    """A step load swings between nothing and twice the static deflection, and gains no energy."""
    m = stiff_arm(tmp_path)
    f1 = pf.modes(m).frequencies[0]
    move, step = pf.hold(duration=5 / f1), 1 / (200 * f1)
    r = pf.solve(m, move, level="coupled", dt=step, start="straight")
    still = pf.solve(m, pf.hold(duration=1.0), level="quasistatic", samples=2)
    z, z0 = (x.frame("hand").position[:, 2] for x in (r, still))
    static = z0[0] - z[0]
    assert z.mean() - z[0] == pytest.approx(static, rel=0.1)  # a few whole periods
    assert (z - z[0]).min() == pytest.approx(2 * static, rel=0.05)  # the first mode carries it
    assert r.meta["energy_balance"] < 1e-3


def test_a_static_start_stays_where_it_is(tmp_path: Path) -> None:
    m = stiff_arm(tmp_path)
    r = pf.solve(m, pf.hold(duration=0.2), level="coupled", start="static", dt=1e-3)
    z = r.frame("hand").position[:, 2]
    # Newton on the statics ends at 1e-12 m; the sag is 3 mm.
    assert np.ptp(z) < 1e-9


def test_a_motion_that_starts_at_speed_starts_the_robot_at_speed() -> None:
    """Inconsistent start: a harmonic motion has its full speed at t = 0, the URDF says rest."""
    m = pf.load("race_r1")
    shake = pf.harmonic(joints={"motor_1": 0.05, "motor_2": 0.02, "motor_3": 0.0}, frequency=5.0)
    rigid, r = (
        pf.solve(m, shake, level=level, until=0.05, dt=1e-4, samples=51)
        for level in ("rigid", "coupled")
    )
    np.testing.assert_allclose(r.arrays["joint/v"][0], rigid.arrays["joint/v"][0], atol=1e-9)
    assert r.arrays["residual/closure"].max() < 1e-11
    # No jump of the loop forces: the first steps of lambda are smooth to their own size.
    lam = r.arrays["multiplier"]
    jumps = np.abs(np.diff(lam, axis=0)).max(axis=1)
    assert jumps[0] < 3 * jumps[1:8].max()


def test_a_home_off_the_loops_is_closed_and_one_that_cannot_close_is_named(tmp_path: Path) -> None:
    m = pf.load("race_r1", ["home.knee_1=-2.1", "home.pin_1=0.4"])
    r = pf.solve(m, pf.hold(duration=0.01), level="coupled", dt=1e-3)
    assert r.arrays["residual/closure"].max() < 1e-12
    bodies = (
        Body("a", "base", "revolute", mass=1.0, inertia=(1, 1, 1)),
        Body("a_end", "a", xyz=(1, 0, 0)),
        Body("b", "base", "revolute", (5, 0, 0), mass=1.0, inertia=(1, 1, 1)),
        Body("b_end", "b", xyz=(1, 0, 0)),
    )
    yaml = "actuated: [a_joint]\nloops: {far: {kind: planar, between: [a_end, b_end]}}"
    with pytest.raises(pf.AssemblyError, match="stays open by") as caught:
        load(tmp_path, bodies, yaml)
    assert caught.value.loop == "far"


@pytest.mark.parametrize("level", pf.LEVELS)
@pytest.mark.parametrize("name", ["race_r1", "3rrr", "ur5", "spinning_beam"])
def test_no_motion_and_no_gravity_is_no_result_but_zeros(name: str, level: str) -> None:
    m = pf.load(name, ["gravity=[0,0,0]"])
    r = pf.solve(m, pf.hold(duration=0.1), level=level, dt=1e-2, samples=11)
    assert np.abs(r.torque).max() < 1e-9
    assert np.abs(r.arrays["joint/v"]).max() < 1e-9
    if "eta" in r.arrays:
        assert np.abs(r.arrays["eta"]).max() < 1e-9
    assert np.isfinite(r.meta["energy_balance"])
    assert r.meta["energy_balance"] < 1e-3


def test_a_move_of_zero_is_a_hold() -> None:
    m = pf.load("race_r1")
    zero = pf.quintic(joints={"motor_1": 0.0}, duration=0.05)
    r = pf.solve(m, zero, level="coupled", dt=1e-3, samples=51)
    # Positions round at 1e-16 rad: as accelerations over 1 ms^2, times 1e-2 kg m^2.
    assert np.abs(r.torque).max() < 1e-8


def test_a_motion_that_jumps_keeps_its_energy_to_the_order_of_the_step() -> None:
    """A trapezoid's acceleration jumps at its corners; the work there is known to a step times it.

    Two corners of a 20 ms ramp at 0.1 ms: 0.5 % of the kinetic energy each.
    """
    m = pf.load("race_r1")
    jerky = pf.trapezoid(joints={"motor_1": 0.2}, duration=0.1, ramp=0.02)
    balance = []
    for h in (1e-4, 5e-5):
        r = pf.solve(m, jerky, level="coupled", dt=h, until=0.15, samples=151)
        balance.append(r.meta["energy_balance"])
        assert r.arrays["residual/closure"].max() < 1e-11
    assert balance[0] < 2e-2
    assert balance[1] < 0.6 * balance[0]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 0.0])
def test_a_step_that_is_no_step_is_refused(bad: float) -> None:
    m = pf.load("race_r1")
    with pytest.raises(pf.DescriptionError, match="dt"):
        pf.solve(m, dt=bad)
    with pytest.raises(pf.DescriptionError, match="until"):
        pf.solve(m, until=bad)
