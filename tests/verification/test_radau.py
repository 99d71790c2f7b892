"""Radau IIA collocation: orders against closed forms, and another method's answer on the race.

The pendulum is `test_integrators`'s (IFToMM A01): released horizontally, index 3, with position,
speed and tension known exactly at any time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import pinflex as pf
from pinflex.arrays import Array
from pinflex.benchmarks.loops import pendulum
from pinflex.collocation import radau
from pinflex.drive import MotorPath, breaks, motor_path
from pinflex.dynamics import Dynamics
from pinflex.mechanism import Mechanism
from pinflex.motion import Motion, from_spec
from pinflex.radau import Stages, Start, Step
from pinflex.start import straight_start
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
) -> tuple[Stages, list[Step], Start]:
    """Equal steps from a state, Newton to round-off."""
    system = m.flexible
    path: Callable[[Array], MotorPath] = lambda t: motor_path(m, motion, t)  # noqa: E731
    march = Stages(m, Dynamics(system), path, 1e-10, radau(stages))
    now, steps = march.first(0.0, y, v), []
    for _ in range(round(until / h)):
        steps.append(march.step(now, h, steps[-1] if steps else None))
        now = march.end(steps[-1])
    return march, steps, now


def fixed(stages: int, count: int) -> tuple[Stages, list[Step], Start]:
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
    # Position, velocity and multiplier of Radau IIA on index 3: 2 s - 1, s, s - 1 (Hairer, Lubich
    # and Roche 1989, theorem 6.4). Measured ones stand in tests/README.md.
    3: ((20, 40, 80), (5, 3, 2)),
    5: ((6, 9, 13), (9, 5, 4)),
}


@pytest.mark.parametrize("stages", ORDERS)
def test_orders_in_the_step(stages: int) -> None:
    counts, expected = ORDERS[stages]
    found = np.array([errors(stages, n) for n in counts])
    orders = [-slope(counts, column) for column in found.T]
    print(stages, orders, found)
    assert np.all(np.array(orders) > np.array(expected) - 0.2), orders
