"""Gain and delay margins against closed forms, and against runs beside them.

Claims:
    In the loop, FMUs
    - margins of a sampled PD on an inertia | Jury's conditions of the sampled system | 2e-6 of
      gains, 3e-6 of delays (bisected to 1e-6) | 1e-6
    - a run says that its loop is not stable, a PD and a PID on an inertia, without a delay and with
      one of a sample | eigenvalues of the inertia's own matrix | 5 % on both sides of the border |
      passes
    - a flexible arm oscillates just beyond its margins and settles just within | coupled runs |
      1 % of the gain, 3 % of the delay | -
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.signal import StateSpace

import pinflex as pf
from tests import scenes

J, PERIOD = 0.5, 0.01
ARM, HUB = (pf.Travel("arm_joint"),), (pf.Effort("arm_joint"),)


@pytest.fixture
def free(tmp_path: Path) -> pf.Mechanism:
    body = scenes.Body("arm", "base", "revolute", mass=1.0, com=(0,) * 3, inertia=(0.1, 0.1, J))
    return scenes.load(tmp_path, [body], "gravity: [0, 0, 0]\nsolve: {drive: torque}\n")


def controlled(kp: float, kd: float, ki: float = 0.0, delay: float = 0.0) -> pf.Control:
    law = pf.digital_pid(kp, ki, kd, period=PERIOD)
    return pf.Control(ARM, HUB, law, period=PERIOD, delay=delay)


def test_a_sampled_pd_on_an_inertia_by_jury(free: pf.Mechanism) -> None:
    """z^2 + (T^2 kp / 2 J + T kd / J - 2) z + 1 + T^2 kp / 2 J - T kd / J: stable while kd > T kp/2
    (which no gain changes) and T kd / J < 2."""
    kp, kd = 40.0, 3.0
    (row,) = pf.margins(free, controlled(kp, kd)).rows
    assert row.high == pytest.approx(2.0 * J / (PERIOD * kd), rel=2e-6)  # of the bisection
    assert row.low == 0.0  # it only drifts without
    assert np.isnan(pf.margins(free, controlled(kp, 0.45 * PERIOD * kp)).rows[0].high)


def test_the_delay_of_a_whole_period_by_jury(free: pf.Mechanism) -> None:
    """u of the sample before: roots of z (z - 1)^2 + (p + d) z + p - d with p = T^2 kp / 2 J and
    d = T kd / J."""
    kp, kd = 40.0, 3.0

    def largest(factor: float) -> float:
        p, d = PERIOD**2 * kp / (2 * J) * factor, PERIOD * kd / J * factor
        return float(np.max(np.abs(np.roots([1.0, -2.0, 1.0 + p + d, p - d])))) - 1.0

    (row,) = pf.margins(free, controlled(kp, kd, delay=PERIOD)).rows
    assert row.high == pytest.approx(brentq(largest, 2.0, 40.0), rel=2e-6)


@pytest.mark.parametrize("ki", [0.0, 60.0])
@pytest.mark.parametrize("delay", [0.0, PERIOD])
def test_a_run_says_that_its_loop_is_not_stable(
    ki: float, delay: float, free: pf.Mechanism
) -> None:
    """By eigenvalues of the inertia's own matrix, 5 % before the border and 5 % beyond it."""
    kp, kd = 40.0, 3.0
    whole = expm(PERIOD * np.array([[0, 1, 0], [0, 0, 1 / J], [0, 0, 0]]))

    def largest(gain: float) -> float:
        """Of q, q', the integral of the error and the output of the sample before."""
        u, F = gain * np.array([-kp, -kd, ki, 0.0]), np.zeros((4, 4))
        F[:2, :2] = whole[:2, :2]
        F[:2] += np.outer(whole[:2, 2], [0, 0, 0, 1] if delay else u)
        F[2, :3], F[3] = (-PERIOD, 0.0, 1.0 if ki else 0.0), u
        return float(np.max(np.abs(np.linalg.eigvals(F)))) - 1.0

    border = brentq(largest, 1.5, 60.0)
    for gain, words in ((0.95 * border, False), (1.05 * border, True)):
        law = pf.digital_pid(gain * kp, gain * ki, gain * kd, period=PERIOD, reference=0.1)
        control = pf.Control(ARM, HUB, law, period=PERIOD, delay=delay, limit=(20.0,))
        run = pf.solve(free, level="coupled", control=control, until=2.0, samples=201,
                       motion=pf.hold(duration=2.0))  # fmt: skip
        said = [x for x in run.meta["warnings"] if x.startswith("control: ")]
        assert len(said) == words, said
        for text in said:  # at the limits it may shake at half its rate, which is read off the run
            grows = PERIOD / np.log1p(largest(gain))
            assert f"every {grows:.2g} s" in text or "nearly every sample" in text


@pytest.mark.parametrize("slow", [1.0, 0.4])
def test_the_delay_margin_by_parabolas(slow: float, free: pf.Mechanism) -> None:
    """An inertia that a torque pushes for a part of a period, then the next one: its polynomial."""
    kp, kd, T = 40.0 * slow**2, 12.0 * slow, PERIOD

    def largest(delay: float) -> float:
        n = int(delay / T)
        old = delay - n * T  # u of n + 1 samples before acts so long, that of n before the rest
        new = T - old
        place = np.array([0.5 * new**2, old * (T - 0.5 * old)])
        speed = np.array([new, old])
        double = J * np.polymul([1.0, -2.0, 1.0], [1.0] + (n + 1) * [0.0])
        law = kp * np.polyadd(np.polymul(place, [1.0, -1.0]), T * speed)
        law = np.polyadd(law, kd * np.polymul(speed, [1.0, -1.0]))
        return float(np.max(np.abs(np.roots(np.polyadd(double, law))))) - 1.0

    (row,) = pf.margins(free, controlled(kp, kd)).rows
    phase = np.arctan2(kd * kd / J, kp) / (kd / J)  # [s], roughly, of the continuous loop
    assert row.delay == pytest.approx(brentq(largest, 0.5 * phase, 1.5 * phase), rel=3e-6)


def test_a_system_by_its_polynomial_and_no_margin_without_damping(free: pf.Mechanism) -> None:
    ours = pf.margins(free, controlled(40.0, 0.0, 0.0)).rows
    assert np.isnan(ours[0].high)  # without kd an inertia oscillates
    lead = StateSpace([[0.5]], [[1.0]], [[-30.0]], [[100.0]], dt=PERIOD)  # 100 (z - .8)/(z - .5)
    (row,) = pf.margins(free, pf.Control(ARM, HUB, lead, period=PERIOD)).rows

    def largest(g: float) -> float:
        b = g * PERIOD**2 / (2 * J)
        poles = np.polymul([1, -2, 1], [1, -0.5])
        zeros = b * np.polymul([1, 1], [100.0, -80.0])
        return float(np.max(np.abs(np.roots(np.polyadd(poles, zeros))))) - 1.0

    assert row.high == pytest.approx(brentq(largest, 1.0, 60.0), rel=2e-6)


def test_integrals_are_those_of_the_law_in_state_space(tmp_path: Path) -> None:
    """Up to the sample before (digital_pid), and by the trapezoidal rule (pid)."""
    body = scenes.Body("arm", "base", "revolute", mass=1.0, com=(0,) * 3, inertia=(0.1, 0.1, J))
    text = "gravity: [0, 0, 0]\nsolve: {drive: torque}\njoints: {arm_joint: {damper: 4}}\n"
    robot, kp, ki = scenes.load(tmp_path, [body], text), 10.0, 30.0

    def found(law: object) -> tuple[float, ...]:
        (row,) = pf.margins(robot, pf.Control(ARM, HUB, law, period=PERIOD)).rows
        return row.low, row.high, row.frequency, row.delay

    def system(direct: float) -> StateSpace:
        return StateSpace([[1.0]], [[PERIOD]], [[ki]], [[direct]], dt=PERIOD)

    digital = found(pf.digital_pid(kp, ki, period=PERIOD))
    assert 1.0 < digital[1] < np.inf  # J s^3 + 4 s^2 + kp s + ki would bear any
    assert digital == pytest.approx(found(system(kp)), rel=1e-9)  # round-off
    by_trapezoids = found(pf.pid(-kp, -ki))
    assert by_trapezoids == pytest.approx(found(system(kp + 0.5 * PERIOD * ki)), rel=1e-9)
    assert abs(by_trapezoids[1] / digital[1] - 1.0) > 1e-3


@pytest.fixture
def arm(tmp_path: Path) -> pf.Mechanism:
    bodies = [
        scenes.Body("hub", "base", "revolute", mass=1.0, com=(0,) * 3, inertia=(0.05,) * 3),
        scenes.Body("beam", "hub", mass=0.2, com=(0.5, 0, 0), inertia=(1e-3,) * 3),
        scenes.Body("tip", "beam", xyz=(1, 0, 0)),
    ]
    yaml = """
gravity: [0, 0, 0]
frames: [tip]
solve: {drive: torque}
flexible:
  beam:
    section: {shape: rectangle, width: 0.02, thickness: 0.004}
    material: aluminium
    damping: {modal: 0.01}
    tip: {mass: 0.3}
"""
    return scenes.load(tmp_path, bodies, yaml)


@pytest.mark.parametrize("what, part, time", [("gain", 0.01, 0.4), ("delay", 0.03, 2.0)])
def test_a_flexible_arm_oscillates_beyond_its_margins_and_not_within(
    what: str, part: float, time: float, arm: pf.Mechanism
) -> None:
    kp, kd, period = 60.0, 4.0, 2e-3
    joint = next(iter(arm.coordinates))

    def control(gain: float = 1.0, later: float = 0.0) -> pf.Control:
        law = pf.digital_pid(gain * kp, 0.0, gain * kd, period=period, reference=1e-3)
        places = (pf.Travel(joint),), (pf.Effort(joint),)
        return pf.Control(*places, law, period=period, delay=later, limit=(np.inf,))

    row = pf.margins(arm, control()).rows[0]
    growth = []
    for factor in (1.0 - part, 1.0 + part):
        if what == "gain":
            other = control(gain=factor * row.high)
        else:
            other = control(later=factor * row.delay)
        run = pf.solve(
            arm,
            motion=pf.hold(duration=time),
            level="coupled",
            control=other,
            tol=1e-3,
            samples=2001,
        )
        size = np.abs(run.joint(joint).velocity)
        growth.append(size[1500:].max() / size[500:1000].max())
    assert growth[0] < 1.0 < growth[1]


def test_what_has_no_margins_says_so(free: pf.Mechanism) -> None:
    with pytest.raises(pf.DescriptionError, match="acts continuously"):
        pf.margins(free, pf.Control(ARM, HUB, pf.pid(-1.0)))
    law = pf.Control(ARM, HUB, lambda t, m, rate, total: -m, period=PERIOD)
    with pytest.raises(pf.DescriptionError, match="any function"):
        pf.margins(free, law)
    two = pf.digital_pid([1.0, 2.0], period=PERIOD)
    with pytest.raises(pf.DescriptionError, match="gains for 2 measures, where 1 are measured"):
        pf.margins(free, pf.Control(ARM, HUB, two, period=PERIOD))


def test_poses_and_drives_are_rows() -> None:
    robot = pf.load("ur5", ["solve.drive=torque", "solve.kp=2e4", "solve.kd=600"])
    law = pf.digital_pid([4000.0, 2000.0], 0.0, [200.0, 60.0], period=5e-4)
    names = ("shoulder_lift_joint", "elbow_joint")
    control = pf.Control(
        tuple(map(pf.Travel, names)), tuple(map(pf.Effort, names)), law, period=5e-4
    )
    found = pf.margins(robot, control, [robot.home, robot.home + 0.3])
    assert [(row.pose, row.drive) for row in found.rows] == [
        (k, name) for k in (0, 1) for name in (*names, "all")
    ]
    assert "elbow_joint" in str(found)


def test_a_patch_that_excites_a_beam_lets_it_ring_at_the_margin() -> None:
    """With motors (there are none) still: at the largest gain the first mode neither grows nor
    decays, beside it as the eigenvalue says, by the part of its damping that is left."""
    patch = "flexible.beam.patches={pzt: {from: 0.1, to: 0.3, constant: 0.01}}"
    still = ("motion={kind: hold, duration: 1}", "flexible.beam.damping={modal: 0.005}", patch)
    beam, period = pf.load("cantilever", [*still, "gravity=[0, 0, -0.1]"]), 1e-3

    def control(gain: float) -> pf.Control:
        law = pf.digital_pid(0.0, 0.0, -gain, period=period)
        places = (pf.Deflection("beam", 0.5),), (pf.Voltage("pzt"),)
        return pf.Control(*places, law, period=period, delay=period)

    (row,) = pf.margins(beam, control(0.05)).rows
    assert row.frequency == pytest.approx(6.68, abs=0.01)  # the first mode's
    for part in (0.5, 1.0, 1.5):
        run = pf.solve(beam, control=control(0.05 * part * row.high), until=4.0, tol=1e-3,
                       samples=4001)  # fmt: skip
        tip = np.diff(run.link("beam").deflection[:, -1, 1])
        turned = tip * np.exp(-2j * np.pi * row.frequency * run.t[1:])
        later, window = (round(n / row.frequency / 1e-3) for n in (10, 6))
        size = [abs(np.hanning(window) @ turned[k : k + window]) for k in (1500, 1500 + later)]
        growth = size[1] / size[0]
        expected = np.exp((part - 1.0) * 0.005 * 2.0 * np.pi * 10.0)
        # the run by a tolerance of 1e-3
        assert growth == pytest.approx(expected, rel=0.01), part
