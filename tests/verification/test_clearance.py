"""Pins with clearance: Hertz's blow, restitution by another integrator, the ideal joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import pinflex as pf
from pinflex.errors import DescriptionError
from tests.finite import slope
from tests.scenes import Body, load

MASS, GAP, PIN, SPEED = 0.3, 2e-4, 0.01, 0.5
E, NU = 2.1e11, 0.3  # steel
# A body that moves in a plane, with a pin in a hole of the ground.
FLYING = (
    Body("hole", "base"),
    Body("x", "base", "prismatic", axis=(1, 0, 0), mass=1e-9),
    Body("pin", "x", "prismatic", axis=(0, 1, 0), mass=MASS),
)
K = 4 / (3 * 2 * (1 - NU**2) / E) * np.sqrt(PIN / 2 * (PIN / 2 + GAP) / GAP)


def flying(folder: Path, contact: str) -> pf.Mechanism:
    return load(folder, FLYING, f"""gravity: [0, 0, 0]
actuated: []
loops: {{joint: {{kind: planar, between: [hole, pin], clearance: {GAP}, pin: {PIN}, {contact}}}}}
solve: {{level: coupled, start: straight}}
""")  # fmt: skip


def thrown(folder: Path, contact: str, until: float) -> pf.Result:
    """The pin leaves the middle at 3 : 4, so that both axes are met."""
    speeds = {"x_joint": 0.6 * SPEED, "pin_joint": 0.8 * SPEED}
    return pf.solve(flying(folder, contact), pf.hold(duration=until), tol=1e-8, start_speeds=speeds)


def test_an_elastic_blow_lasts_as_hertz_says(tmp_path: Path) -> None:
    """x_max = (5 m v^2 / 4 K)^(2/5), for 2 x_max / v times the integral of (1 - u^(5/2))^(-1/2)."""
    run = thrown(tmp_path, "restitution: 1", 2.5 * GAP / SPEED)
    met = run.events
    deep = (5 * MASS * SPEED**2 / (4 * K)) ** 0.4
    lasts = 2 * deep / SPEED * quad(lambda u: (1 - u**2.5) ** -0.5, 0, 1, epsabs=1e-12)[0]
    assert [x.what for x in met[:2]] == ["contact", "release"]
    assert met[0].time == pytest.approx(GAP / SPEED, rel=1e-9)
    # x^(3/2) begins with an infinite second derivative, so that steps lose order there.
    assert met[1].time - met[0].time == pytest.approx(lasts, rel=1e-6)
    assert met[1].speed == pytest.approx(SPEED, rel=1e-6)
    stored = run.array("energy/kinetic") + run.array("energy/spring")
    assert np.ptp(stored) < 1e-6 * stored[0]
    orbit = run.array("loop/joint/orbit")
    assert np.abs(np.cross(orbit, [0.6, 0.8, 0.0])).max() < 1e-8 * GAP  # x slides with 1e-9 kg more
    assert np.linalg.norm(orbit, axis=1).max() == pytest.approx(GAP + deep, rel=1e-3)  # of samples


@pytest.mark.parametrize(
    ("contact", "chi"),
    [("flores", 8 * 0.2 / (5 * 0.8)), ("lankarani_nikravesh", 0.75 * (1 - 0.8**2))],
)
def test_blows_are_damped_as_published(contact: str, chi: float, tmp_path: Path) -> None:
    """One blow of F = K x^1.5 (1 + chi x'/v_0) by DOP853."""
    e, c = 0.8, chi

    def rates(_: float, s: list[float]) -> list[float]:
        x, v = max(s[0], 0.0), s[1]
        return [v, -K * x**1.5 * (1 + c * v / SPEED) / MASS]

    def out(_: float, s: list[float]) -> float:
        return s[0]

    out.terminal, out.direction = True, -1  # type: ignore[attr-defined]
    blow = solve_ivp(rates, (0, 1e-2), [0, SPEED], "DOP853", events=out, rtol=1e-11, atol=1e-18)
    run = thrown(tmp_path, f"contact: {contact}, restitution: {e}", 2.5 * GAP / SPEED)
    met = run.events
    assert met[1].speed == pytest.approx(-blow.y_events[0][0][1], rel=1e-6)
    assert met[1].time - met[0].time == pytest.approx(blow.t_events[0][0], rel=1e-6)
    lost = 0.5 * MASS * (SPEED**2 - met[1].speed ** 2)
    # to the order that the quadrature of steps has over x^(3/2)
    assert run.array("energy/dissipated")[-1] == pytest.approx(lost, rel=1e-6)
    assert abs(met[1].speed / SPEED - e) < 0.05  # which is what the laws are made for, about


def test_a_pendulum_on_a_loose_pin_swings_as_one_on_an_ideal_one(tmp_path: Path) -> None:
    """It is off by the clearance, whatever the pin does in its hole: first order."""
    bodies = (
        Body("hole", "base"),
        Body("bob", "base", "planar", mass=1.0, inertia=(0.02,) * 3),
        Body("pin", "bob", xyz=(-0.4, 0, 0)),
    )
    ideal = """gravity: [0, -9.81, 0]
actuated: []
home: {bob_joint: [0.4, 0, 0]}
loops: {joint: {kind: planar, between: [hole, pin]}}
solve: {level: coupled, start: straight}
"""
    exact = pf.solve(load(tmp_path, bodies, ideal), pf.hold(duration=0.4), tol=1e-6, samples=81)
    off, gaps = [], (4e-4, 2e-4, 1e-4)
    for gap in gaps:
        yaml = ideal.replace("[hole, pin]", f"[hole, pin], clearance: {gap}, pin: 0.01, "
                             "restitution: 0.5, contact: lankarani_nikravesh")  # fmt: skip
        run = pf.solve(load(tmp_path, bodies, yaml), pf.hold(duration=0.4), tol=1e-3, samples=81)
        assert run.meta["energy_balance"] < 1e-5
        found = run.array("joint/q")[:, :2] - exact.array("joint/q")[:, :2]
        off.append(np.abs(found).max())
    assert np.all(np.array(off) < 4 * np.array(gaps))
    # Blows differ from run to run: the slope is one of sizes, not of a smooth function.
    assert slope(gaps, off) == pytest.approx(1.0, abs=0.2)


def test_three_rrr_with_loose_pins(tmp_path: Path) -> None:
    """Energy is kept account of over 200 blows; a single history is told to mean little."""
    pins = [f"loops.pin_{k}.{key}" for k in (2, 3) for key in ("clearance=5e-5", "pin=0.005")]
    run = pf.solve(pf.load("3rrr", pins), tol=1e-3, until=0.05, start="straight")
    assert len(run.events) > 100
    assert run.meta["energy_balance"] < 1e-6
    reached = np.linalg.norm(run.array("loop/pin_2/orbit"), axis=1)
    assert 5e-5 < reached.max() < 5.3e-5  # the rim, and a little into it
    ideal = pf.solve(pf.load("3rrr"), tol=1e-3, until=0.05)
    assert np.abs(run.torque).max() > np.abs(ideal.torque).max()
    assert any("single history" in text for text in run.meta["warnings"])


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("clearance: 50 um", "of which pin"),
        ("pin: 5 mm", "the joint is ideal"),
        ("clearance: 50 um, pin: 5 mm, contact: hertz", "is not known"),
    ],
)
def test_pins_that_say_too_little_are_refused(keys: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=said):
        load(tmp_path, FLYING, "actuated: []\nloops: {joint: {kind: planar, between: "
                               f"[hole, pin], {keys}}}}}\n")  # fmt: skip
