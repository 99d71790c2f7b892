"""Where a run starts: in equilibrium wherever something acts, straight where there is none.

Claims:
    Hard cases
    - by default nothing moves while the motors stand still, ked and coupled; straight rings | - |
      1e-9 m of a 3 mm sag | passes
    - an acceleration that jumps starts from the sag at rest; a motion at speed from the balance
      with its inertia | quasistatic | 1e-12 | passes
    - what hangs at rest from a link that bends starts there; straight where home is off that | the
      same on a soft spring, quasistatic | 1e-8 m | passes
    - no stable equilibrium, falling freedoms: straight, with the reason; static is refused and
      names straight | race_r2, thinner | exact | passes
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load

ARM = (
    Body("upper", "base", "revolute", axis=(0, 1, 0)),
    Body("lower", "upper", "revolute", (1, 0, 0), axis=(0, 1, 0)),
    Body("hand", "lower", xyz=(1, 0, 0), mass=5.0, inertia=(0.01,) * 3),
)
YAML = """
home: {lower_joint: 0.7}
platform: hand
flexible:
  "upper, lower":
    material: {E: 2.0e11, nu: 0.3, rho: 7800}
    section: {shape: tube, diameter: 0.06, wall: 0.004}
"""
HOLD = pf.hold(duration=0.05)


def swing(r: pf.Result) -> float:
    """How far the hand moves in a run in which the motors stand still [m]."""
    return float(np.ptp(r.frame("hand").position[:, 2]))


@pytest.mark.parametrize("level", ["ked", "coupled"])
def test_by_default_nothing_moves_when_the_motors_stand_still(level: str, tmp_path: Path) -> None:
    m = load(tmp_path, ARM, YAML)
    r = pf.solve(m, HOLD, level=level, dt=1e-3, samples=51)
    assert r.meta["settings"]["start"] == "static"
    assert r.meta["warnings"] == []
    # Newton on the statics ends at 1e-12 m; the sag is 3 mm.
    assert swing(r) < 1e-9
    sag = pf.solve(m, HOLD, level="quasistatic", samples=2).frame("hand").position[0, 2]
    # The linear balance of ked misses what is of second order in the sag.
    assert r.frame("hand").position[0, 2] == pytest.approx(
        sag, abs=1e-12 if level != "ked" else 2e-5
    )


@pytest.mark.parametrize("level", ["ked", "coupled"])
def test_straight_rings_and_static_does_not(level: str, tmp_path: Path) -> None:
    m = load(tmp_path, ARM, YAML)
    rings, stays = (
        pf.solve(m, HOLD, level=level, dt=1e-3, samples=51, start=start)
        for start in ("straight", "static")
    )
    assert swing(rings) > 4e-3  # twice the static sag
    assert swing(stays) < 1e-9
    assert rings.meta["settings"]["start"] == "straight"
    assert rings.meta["warnings"] == []


@pytest.mark.parametrize("level", ["ked", "coupled"])
def test_an_acceleration_that_jumps_shakes_what_was_at_rest(level: str, tmp_path: Path) -> None:
    """At rest before t = 0: the start is the sag under gravity, not under the first inertia."""
    m = load(tmp_path, ARM, YAML)
    sag, started = (
        pf.solve(m, move, level=level, dt=1e-4, samples=11, until=1e-3)
        for move in (HOLD, pf.trapezoid(joints={"upper_joint": 0.2}, duration=0.1, ramp=0.02))
    )
    z = sag.frame("hand").position[0, 2]
    assert started.frame("hand").position[0, 2] == pytest.approx(z, abs=1e-12)


def test_a_motion_at_speed_starts_under_its_inertia(tmp_path: Path) -> None:
    m = load(tmp_path, ARM, YAML)
    shake = pf.harmonic(joints={"upper_joint": 0.05}, frequency=2.0)
    begun, still = (
        pf.solve(m, shake, level=level, samples=2, until=1e-3)
        for level in ("coupled", "quasistatic")
    )
    # Balanced with the nominal velocity and acceleration, as every instant of quasistatic is.
    np.testing.assert_allclose(begun.arrays["eta"][0], still.arrays["eta"][0], atol=1e-12)


def test_where_nothing_acts_it_is_straight_and_nothing_is_said(tmp_path: Path) -> None:
    m = load(tmp_path, ARM, "gravity: [0, 0, 0]\n" + YAML)
    r = pf.solve(m, HOLD, level="coupled", dt=1e-3, samples=11)
    assert r.meta["settings"]["start"] == "straight"
    assert r.meta["warnings"] == []
    assert swing(r) == 0.0


def test_a_load_that_lasts_is_balanced_and_a_blow_is_not(tmp_path: Path) -> None:
    push = "gravity: [0, 0, 0]\nforces: {{push: {{at: hand, force: [0, 0, -50]{}}}}}\n"
    lasts = load(tmp_path, ARM, push.format("") + YAML)
    assert swing(pf.solve(lasts, HOLD, level="coupled", dt=1e-3, samples=51)) < 1e-9
    blow = load(tmp_path, ARM, push.format(", until: 0.02") + YAML)
    for level in ("ked", "coupled"):
        r = pf.solve(blow, HOLD, level=level, dt=1e-3, samples=51)
        assert r.frame("hand").position[0, 2] == pytest.approx(-np.sin(0.7), abs=1e-12)
        assert swing(r) > 1e-3


def test_links_that_buckle_start_straight_and_say_why() -> None:
    thin = pf.load("race_r2", ["flexible.*.section.thickness=7e-4", "solve.start=auto"])
    brief = {"level": "coupled", "until": 1e-3, "dt": 1e-4, "samples": 3}
    r = pf.solve(thin, **brief)
    assert r.meta["settings"]["start"] == "straight"
    assert "because there is no static equilibrium near it" in r.meta["warnings"][0]
    with pytest.raises(pf.ConvergenceError, match="write start: straight"):
        pf.solve(thin, start="static", **brief)
    # A little thicker there is an equilibrium, which gives way when it is touched.
    thicker = pf.load("race_r2", ["flexible.*.section.thickness=1e-3", "solve.start=auto"])
    r = pf.solve(thicker, **brief)
    assert "because its static equilibrium is unstable" in r.meta["warnings"][0]
    forced = pf.solve(thicker, start="static", **brief)
    assert forced.meta["settings"]["start"] == "static"
    assert "unstable" in forced.meta["warnings"][0]


def test_what_falls_starts_where_home_puts_it(tmp_path: Path) -> None:
    m = load(tmp_path, ARM, "actuated: [upper_joint]\n" + YAML)
    r = pf.solve(m, HOLD, level="coupled", dt=1e-3, samples=51)
    assert r.meta["settings"]["start"] == "straight"
    assert "because the motors do not hold every freedom" in r.meta["warnings"][0]
    assert r.joint("lower_joint").position[0] == 0.7


def test_what_hangs_at_rest_starts_there_and_its_modes_are_of_its_weight(tmp_path: Path) -> None:
    """The lower link hangs from the sagging upper one: a start of straight links shook it."""
    hanging = (
        YAML.replace("0.7", "1.5705") + "    axial: true\n"
    )  # 0.3 mrad off pi / 2, as one writes it
    m = load(tmp_path, ARM, "actuated: [upper_joint]\n" + hanging)
    r = pf.solve(m, HOLD, level="coupled", dt=1e-3, samples=51)
    assert r.meta["settings"]["start"] == "static"
    assert r.meta["warnings"] == []
    assert swing(r) < 1e-9  # [m], as above
    # A spring that holds nothing makes the freedom one that every level knows, as the refusal says.
    with pytest.raises(pf.MotionError, match="soft spring"):
        pf.solve(m, HOLD, level="quasistatic")
    spring = "joints: {lower_joint: {spring: 1e-3, rest: 1.5705}}\n"
    soft = load(tmp_path, ARM, "actuated: [upper_joint]\n" + spring + hanging)
    sag = pf.solve(soft, HOLD, level="quasistatic", samples=2).frame("hand").position[0, 2]
    # 1e-8: its 1e-3 N m/rad against 80 of the weight turn the lower link by 1e-5 of the 3 mrad
    assert r.frame("hand").position[0, 2] == pytest.approx(sag, abs=1e-8)
    found = pf.check(m)
    assert "sag, full     hand" in found.text()
    first = pf.modes(m, count=2)
    assert first._most(0) == "weight 100 %"
    assert first._most(1).startswith(("upper", "lower"))
    off = load(tmp_path, ARM, "actuated: [upper_joint]\n" + YAML.replace("0.7", "1.56"))
    said = pf.solve(off, HOLD, level="coupled", dt=1e-3, samples=51).meta["warnings"][0]
    assert "Write start: static" in said


def test_a_stopped_run_says_how_it_started(tmp_path: Path) -> None:
    m = load(tmp_path, ARM, YAML)
    wild = pf.quintic(joints={"upper_joint": 900.0}, duration=0.5)
    with pytest.raises(pf.ConvergenceError) as caught:
        pf.solve(m, wild, level="coupled", dt=0.05, samples=11, until=0.5)
    assert caught.value.result.meta["settings"]["start"] == "static"


def test_gravity_that_reaches_nothing_elastic_shakes_nothing(tmp_path: Path) -> None:
    """A plane arm lies flat and its elbow is free: its weight bends nothing, and nothing rings."""
    flat = [replace(b, axis=(0, 0, 1)) for b in ARM]
    plane = YAML + "    bending_z: false\n    torsion: false\n"
    m = load(tmp_path, flat, "actuated: [upper_joint]\n" + plane)
    r = pf.solve(m, HOLD, level="coupled", dt=1e-3, samples=51)
    assert r.meta["settings"]["start"] == "straight" and r.meta["warnings"] == []
    assert np.max(np.ptp(r.frame("hand").position, axis=0)) == 0.0


@pytest.mark.parametrize("level", ["ked", "coupled"])
@pytest.mark.parametrize("slack", [True, False])
def test_a_spring_acts_where_it_is_stretched(level: str, slack: bool, tmp_path: Path) -> None:
    """Slack there is nothing to balance; stretched it is balanced. Neither moves."""
    post = Body("post", "base", xyz=(1, 0, -3))
    length = float(np.linalg.norm([np.cos(0.7), 0, 3 - np.sin(0.7)])) - (0.0 if slack else 0.1)
    rope = f"springs: {{rope: {{between: [hand, post], stiffness: 200, length: {length!r}}}}}\n"
    m = load(tmp_path, (*ARM, post), f"gravity: [0, 0, 0]\n{rope}{YAML}")
    r = pf.solve(m, HOLD, level=level, dt=1e-3, samples=51)
    assert r.meta["settings"]["start"] == ("straight" if slack else "static")
    assert swing(r) < 1e-9  # m, as above
