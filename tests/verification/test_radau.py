"""Radau IIA collocation: orders against closed forms, and another method's answer on the race.

The pendulum is `test_integrators`'s (IFToMM A01): released horizontally, index 3, with position,
speed and tension known exactly at any time.

Claims:
    Tolerances, collocation
    - pendulum loop (A01), 3 stages: position, velocity, tension | elliptic functions | 5, 3, 2 +-
      0.7 | 4.95, 2.4, 2.4
    - the same, 5 stages | same | 9, 5, 4 +- 0.7 | 8.35, 4.9, 4.5; 5e-11 m with 13 steps
    - loops shut at ends of steps; open between by order s + 1 | - | 1e-11 m; 6 +- 0.6 | passes;
      5.9: 3e-8 m with 13 steps a swing
    - R1, R2: 20 equal steps of 1 ms against 10, 25 us | generalized_alpha | 3e-5 | 5e-6, 2e-6
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import pinflex as pf
from pinflex.actuation.drive import motor_path
from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion, from_spec
from pinflex.integrators.collocation import radau
from pinflex.integrators.plain.radau import PlainRadau, Step
from pinflex.integrators.problem import Problem, State
from pinflex.lab.loops import pendulum
from pinflex.levels.start import straight_start
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from tests.finite import slope

GRAVITY = 9.81  # [m/s^2]
END = 0.9  # [s] on the way up: neither speed nor tension is at an extreme


def swing(t: Array) -> tuple[Array, Array, Array]:
    """Position (nt, 2) in m, velocity (nt, 2) in m/s, tension (nt,) in N, from rest at x = 1 m."""
    k, w = np.sqrt(0.5), np.sqrt(GRAVITY)
    sn, cn, dn, _ = ellipj(ellipk(k * k) - w * t, k * k)
    angle, rate = 2 * np.arcsin(k * sn), -2 * w * k * cn * dn / np.sqrt(1 - (k * sn) ** 2)
    position = np.column_stack([np.sin(angle), -np.cos(angle)])
    velocity = rate[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return position, velocity, 3 * GRAVITY * np.cos(angle)


def marched(
    m: Mechanism, stages: int, h: float, until: float, motion: Motion, y: Array, v: Array
) -> tuple[PlainRadau, list[Step], State]:
    """Equal plain steps from a state, Newton to round-off."""
    problem = Problem(m, Equations(m.flexible), lambda t: motor_path(m, motion, t))
    march, now, steps = PlainRadau(problem, radau(stages)), problem.first(0.0, y, v), list[Step]()
    for _ in range(round(until / h)):
        steps.append(march.step(now, h))
        now = steps[-1].end
    return march, steps, now


def fixed(stages: int, count: int) -> tuple[PlainRadau, list[Step], State]:
    m = pendulum()
    y, v = m.undeformed(), np.zeros(m.flexible.nv)
    return marched(m, stages, END / count, END, pf.hold(duration=END), y, v)


def errors(stages: int, count: int) -> Array:
    """Of position (m), velocity (m/s) and tension (N) at the end of the last step."""
    _, _, now = fixed(stages, count)
    position, velocity, tension = swing(np.array([END]))
    return np.array(
        [
            np.abs(now.y - position[0]).max(),
            np.abs(now.v - velocity[0]).max(),
            abs(abs(now.lam[0]) - tension[0]),
        ]
    )


def test_the_closed_form_is_the_published_position_after_a_second() -> None:
    np.testing.assert_allclose(swing(np.array([1.0]))[0][0], [-0.986291751132, -0.165010853126],
                               atol=1e-12)  # fmt: skip


ORDERS = {
    # Position, velocity and multiplier of Radau IIA on index 3 are of order 2 s - 1, s and s - 1
    # (Hairer, Lubich and Roche 1989, section 6). Measured: 4.95, 2.4, 2.4;
    # 8.4, 4.9, 4.5.
    3: ((20, 40, 80), (5, 3, 2)),
    5: ((6, 9, 13), (9, 5, 4)),
}


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of a tenth of a period take more corrections than a run allows."""
    monkeypatch.setattr("pinflex.integrators.plain.radau._ITERATIONS", 60)


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("stages", ORDERS)
def test_orders_in_the_step(stages: int) -> None:
    counts, expected = ORDERS[stages]
    found = np.array([errors(stages, n) for n in counts])
    orders = [-slope(counts, column) for column in found.T]
    # Steps of a tenth of the period are not the limit yet, and errors that change their sign bend
    # the slopes: more than half of an order would be another order.
    np.testing.assert_allclose(orders, expected, atol=0.7)
    assert found[-1, 0] < {3: 3e-9, 5: 1e-10}[stages]  # [m]


@pytest.mark.usefixtures("patient")
def test_energy_is_kept_to_the_error_of_the_step() -> None:
    drift = []
    for count in (6, 12):
        _, steps, now = fixed(5, count)
        every = [step.start for step in steps] + [now]
        drift.append(
            max(abs(0.5 * s.v @ s.v + GRAVITY * s.y[1]) for s in every)  # [J] of 9.81; 1 kg
        )
    assert drift[0] < 2e-3
    assert np.log2(drift[0] / drift[1]) > 4.5  # that of the velocity


@pytest.mark.usefixtures("patient")
def test_loops_are_shut_at_the_ends_of_steps_and_between_to_the_order_of_the_stages() -> None:
    gaps = []
    counts = (6, 9, 13)
    for count in counts:
        march, steps, now = fixed(5, count)
        ends = np.array([step.start.y for step in steps] + [now.y])
        # A pose at the end of a step is a stage: 1e-12 of the displacement.
        assert np.abs(np.hypot(*ends.T) - 1.0).max() < 1e-11
        between = [march.dense(s, s.start.t + s.h * np.linspace(0, 1, 21))[0] for s in steps]
        gaps.append(np.abs(np.hypot(*np.concatenate(between).T) - 1.0).max())
    # The polynomial through the stages is of degree s + 1, its error of order s + 1.
    assert -slope(counts, gaps) == pytest.approx(6.0, abs=0.6)


@pytest.mark.parametrize("name", ["race_r1", "race_r2"])
def test_equal_steps_agree_with_generalized_alpha_refined(name: str) -> None:
    """Nothing in common but the residual: order 2 at 10 and 25 us against order 9 at 1 ms."""
    # stretch rings faster than the steps of generalized-alpha resolve
    m = pf.load(name, ["flexible.*.basis.internal=0", "flexible.*.axial=false"])
    motion, end = from_spec(m.description.motion, name), 0.02
    t = np.linspace(0.0, end, 21)
    path = motor_path(m, motion, t[:1])
    start = straight_start(m, motion, path, Equations(m.flexible))
    march, steps, now = marched(m, 5, 1e-3, end, motion, *start)
    dt = {"race_r1": 1e-5, "race_r2": 2.5e-5}[name]
    # Newton's tolerance out of the way of both.
    r = pf.solve(m, motion, level="coupled", until=end, dt=dt, samples=21, tolerance=1e-10)
    eta = np.array([step.start.y for step in steps] + [now.y])[:, m.flexible.rigid.nq :]
    torque = np.array([step.start.torque for step in steps] + [now.torque])
    for found, expected in ((eta, r.arrays["eta"]), (torque, r.torque)):
        error = np.abs(found - expected).max() / np.abs(expected).max()
        # 5e-6, 4e-6; 2e-6, 7e-7 measured: generalized_alpha has an error of that size itself.
        assert error < 3e-5
    assert (
        max(np.abs(march.problem.dynamics.close(step.start.y)[0]).max() for step in steps) < 1e-11
    )
