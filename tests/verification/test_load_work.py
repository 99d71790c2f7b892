"""Work of loads that switch, ramp or follow, and of moments: closed forms, energy balance.

Claims:
    Levels, energy, steps
    - a push that ends (also between samples), an impulse, a ramp; a following force and moments on
      a turning arm: motion (Duhamel, F T / m, alpha t^2 / 2), work, energy balance | 1e-7 of the
      motion; 1e-7 to 1e-6 of the work, 1e-3 for a push between two samples | passes
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import pinflex as pf
from tests.scenes import Body, load

MASS, SPRING, PUSH = 2.0, 5000.0, 20.0  # kg, N/m, N: 8 Hz
OMEGA = np.sqrt(SPRING / MASS)
BLOCK = (Body("block", "base", "prismatic", axis=(1, 0, 0), mass=MASS),)
ARM = (
    Body("arm", "base", "continuous", mass=0.5, inertia=(1e-2,) * 3),
    Body("tip", "arm", xyz=(0.4, 0, 0)),
)


def block(folder: Path, when: str) -> pf.Mechanism:
    """A block on a spring, at rest, pushed for a while."""
    return load(folder, BLOCK, f"""gravity: [0, 0, 0]
actuated: []
joints: {{block_joint: {{spring: {SPRING}}}}}
forces: {{push: {{at: block, force: [{PUSH}, 0, 0], {when}}}}}
solve: {{level: coupled, start: straight, until: 0.3}}
""")  # fmt: skip


def pulse(t: Any, start: float, end: float) -> Any:
    """Position of the block after a push from `start` to `end` [s]."""

    def step(after: Any) -> Any:
        return np.where(after > 0, PUSH / SPRING * (1 - np.cos(OMEGA * after)), 0.0)

    return step(t - start) - step(t - end)


# Samples 1 ms apart: a switch at one, between two, two between the same two; from t = 0 or later.
@pytest.mark.parametrize(
    ("start", "end", "exact"),
    [(0.0, 0.05, 1e-7), (0.02, 0.0704, 1e-6), (0.0203, 0.0551, 1e-6), (0.0202, 0.0209, 1e-3)],
)
def test_a_push_that_ends_leaves_the_closed_form_and_its_energy(
    start: float, end: float, exact: float, tmp_path: Path
) -> None:
    """Duhamel's integral of a rectangle; it has done F (x(end) - x(start)), and stops."""
    run = pf.solve(block(tmp_path, f"start: {start}, until: {end}"), tol=1e-8, samples=301)
    x = run.joint("block_joint").position
    # tol is of the largest value; a step that ends at the switch keeps its order
    assert np.abs(x - pulse(run.t, start, end)).max() < 1e-7 * np.abs(x).max()
    # a sample at an instant at which it switches has what is just after it
    on = (run.t > start - 1e-9) & (run.t < end - 1e-9)
    a = (PUSH * on - SPRING * pulse(run.t, start, end)) / MASS
    assert np.abs(run.joint("block_joint").acceleration - a).max() < 1e-6 * np.abs(a).max()
    work = run.array("energy/loads")
    done = PUSH * pulse(np.minimum(run.t, end), start, end)
    # Between samples the position at a switch is found to the fourth power of (omega step) = 0.05;
    # of both sides of a pulse shorter than a step, half of whose work each tells, to the second.
    assert np.abs(work - done).max() < exact * done[-1]
    assert run.meta["energy_balance"] < exact
    assert not any("energy" in warning for warning in run.meta["warnings"])
    assert not np.any(run.array("energy/work")) and run.array("energy/spring").max() > 0


def test_a_short_push_is_an_impulse(tmp_path: Path) -> None:
    """v = F T / m at its end; the free vibration after it is F T / (m omega) sin(omega t)."""
    T = 1e-4
    run = pf.solve(block(tmp_path, f"until: {T}"), tol=1e-8, samples=301)
    x, after = run.joint("block_joint").position, run.t > T
    impulse = PUSH * T / (MASS * OMEGA) * np.sin(OMEGA * (run.t - T / 2))
    # the rectangle's own width: sin(omega T / 2) / (omega T / 2) = 1 - 1e-6
    assert np.abs(x - impulse)[after].max() < 2e-6 * np.abs(x).max()
    kinetic = 0.5 * MASS * (PUSH * T / MASS) ** 2
    # one parabola from t = 0 spans the push: its end differs by (omega T)^2 / 12
    assert run.array("energy/loads")[-1] == pytest.approx(kinetic, rel=1e-5)
    assert run.meta["energy_balance"] < 1e-4


@pytest.mark.parametrize(("begin", "samples"), [(0.0, 301), (0.0133, 301), (0.0133, 61)])
def test_the_work_of_a_ramp_is_the_integral_of_its_power(
    begin: float, samples: int, tmp_path: Path
) -> None:
    ramp = 0.08
    run = pf.solve(block(tmp_path, f"start: {begin}, ramp: {ramp}"), tol=1e-8, samples=samples)

    def speed(t: float) -> float:  # of the answer to a slope, which ends after `ramp`
        def part(after: float) -> float:
            return PUSH / SPRING / ramp * (1 - np.cos(OMEGA * after)) if after > 0 else 0.0

        return part(t - begin) - part(t - begin - ramp)

    def power(t: float) -> float:
        return PUSH * min(max((t - begin) / ramp, 0.0), 1.0) * speed(t)

    done = quad(power, 0.0, 0.3, points=(begin, begin + ramp), limit=200, epsabs=1e-14)[0]
    # (omega step)^4 / 100 where a corner lies between samples 5 ms apart: 4e-5
    limit = 1e-4 if samples < 100 else 1e-6
    assert run.array("energy/loads")[-1] == pytest.approx(done, rel=limit)
    assert run.meta["energy_balance"] < limit


@pytest.mark.parametrize(
    ("load_of_it", "torque"),
    [
        ("force: [0, 3, 0], follower: true", 1.2),
        ("moment: [0, 0, 1.2]", 1.2),
        ("moment: [0, 0, 1.2], follower: true", 1.2),
        ("moment: [0, 0, 1.2], until: 0.1", 1.2),
    ],
)
def test_a_force_that_follows_and_a_moment_do_their_torque_times_the_angle(
    load_of_it: str, torque: float, tmp_path: Path
) -> None:
    """A rigid arm turns as alpha t^2 / 2, several times round."""
    m = load(tmp_path, ARM, f"""gravity: [0, 0, 0]
actuated: []
forces: {{push: {{at: tip, {load_of_it}}}}}
solve: {{level: coupled, start: straight, until: 0.4, samples: 81, tol: 1.0e-8}}
""")  # fmt: skip
    run = pf.solve(m)
    alpha, end = torque / 1e-2, 0.1 if "until" in load_of_it else 0.4
    angle = 0.5 * alpha * np.minimum(run.t, end) ** 2
    # the power is linear in time: the trapezium rule has no error
    np.testing.assert_allclose(run.array("energy/loads"), torque * angle, rtol=0, atol=1e-7)
    assert run.meta["energy_balance"] < 1e-7


def test_equal_steps_keep_the_balance_of_a_switched_load_to_first_order() -> None:
    """A load that is there at the start of a step and gone at its end has half a step too much."""
    m = pf.load("cantilever", ["gravity=[0,0,0]",
                               "forces={tip: {at: tip, force: [0,0,1], until: 0.05}}"])  # fmt: skip
    found = []
    for dt in (4e-4, 2e-4, 1e-4):
        run = pf.solve(m, level="coupled", until=0.1, start="straight", dt=dt, samples=101)
        found.append(run.meta["energy_balance"])
    assert found[0] > 1.6 * found[1] > 2.5 * found[2] and found[2] < 2e-3
    linear = pf.solve(m, level="ked", until=0.1, start="straight", dt=dt, samples=101)
    # not of first order: 4e-4 is there without a switch, of what level ked leaves out
    assert linear.meta["energy_balance"] < 4e-3 and "energy" not in str(linear.meta["warnings"])


def test_a_constant_force_keeps_its_potential_and_has_no_work_beside_it(tmp_path: Path) -> None:
    m = load(tmp_path, BLOCK, f"""gravity: [0, 0, 0]
actuated: []
joints: {{block_joint: {{spring: {SPRING}}}}}
forces: {{push: {{at: block, force: [{PUSH}, 0, 0]}}}}
solve: {{level: coupled, start: straight, until: 0.1, tol: 1.0e-8, samples: 51}}
""")  # fmt: skip
    run = pf.solve(m)
    assert "energy/loads" not in run.arrays
    assert run.array("energy/spring").min() < 0 and run.meta["energy_balance"] < 1e-7


def test_a_run_that_goes_on_counts_the_work_once(tmp_path: Path) -> None:
    m = block(tmp_path, "until: 0.05")
    options: dict[str, Any] = {"dt": 1e-4}
    whole = pf.solve(m, samples=301, **options)
    half = pf.solve(m, until=0.1, samples=101, **options)
    on = pf.solve(m, resume=half, until=0.3, **options)
    assert on.array("energy/loads")[-1] == pytest.approx(whole.array("energy/loads")[-1], rel=1e-6)
    again = pf.recompute(m, pf.Result.load(on.save(tmp_path / "on.npz")))
    np.testing.assert_array_equal(again.array("energy/loads"), on.array("energy/loads"))
