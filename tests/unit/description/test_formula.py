"""Formulas of time: values, exact rates, and what is no formula."""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf

T = np.linspace(0.1, 1.3, 7)
# Fourth-order differences at h = 1e-3 of functions of order one: 1e-10 and, twice, 1e-8.
STEP = 1e-3
FORMULAS = (
    "0.3*t^2",
    "(1 - cos(2*pi*t)) / (20*pi)",
    "0.1*sin(pi*cos(pi*t)) + sqrt(0.25 - (0.34 - 0.1*cos(pi*cos(pi*t)))**2)",
    "exp(-t)*tan(t/2) - atan(3*t) + log(1 + t)",
    "t^2.5 + 2^t + (1 + t)^t",
    "-t/(1 + t)^3 + 5",
)


@pytest.mark.parametrize("text", FORMULAS)
def test_velocity_and_acceleration_are_the_derivatives(text: str) -> None:
    motion = pf.formula(joints={"a": text}, duration=1.0)

    def p(t: float) -> float:
        return float(motion.evaluate(np.array([t]))[0][0, 0])

    position, velocity, acceleration = motion.evaluate(T)
    for k, t in enumerate(T):
        near = [p(t + s * STEP) for s in (-2, -1, 0, 1, 2)]
        first = (near[0] - 8 * near[1] + 8 * near[3] - near[4]) / (12 * STEP)
        second = (-near[0] + 16 * near[1] - 30 * near[2] + 16 * near[3] - near[4]) / (12 * STEP**2)
        assert velocity[k, 0] == pytest.approx(first, rel=1e-7, abs=1e-8)
        assert acceleration[k, 0] == pytest.approx(second, rel=1e-6, abs=1e-7)
        assert position[k, 0] == p(t)


def test_a_parabola_starts_at_rest_with_its_acceleration() -> None:
    p, v, a = pf.formula(joints={"a": "0.3*t^2"}, duration=1.0).evaluate(np.array([0.0]))
    assert (p[0, 0], v[0, 0], a[0, 0]) == (0.0, 0.0, 0.6)


def test_the_specification_rebuilds_the_motion() -> None:
    from pinflex.description.motions.motion import from_spec

    motion = pf.formula(platform={"x": "t", "z": 0}, duration=2.0, absolute=True)
    again = from_spec(motion.spec, "motion")
    np.testing.assert_array_equal(again.evaluate(T)[0], motion.evaluate(T)[0])
    assert again.absolute


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.3*s^2", "s: unknown"),
        ("__import__('os')", "unknown|no place"),
        ("t.real", "no place"),
        ("sin", "sin: unknown"),
        ("t(t)", "t: unknown"),
        ("t +", "no formula"),
        ("sin(t, t)", "no place"),
        ("[t]", "no place"),
        ("sqrt(0.5 - t)", "not finite"),
        ("1/t", "not finite"),
        ("t^1.5", "not finite"),  # the acceleration at t = 0
        ("'t'", "no place"),
    ],
)
def test_what_is_no_formula_is_refused(text: str, message: str) -> None:
    with pytest.raises(pf.DescriptionError, match=message):
        pf.formula(joints={"a": text}, duration=1.0)
