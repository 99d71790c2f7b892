"""Samples between equal steps: the run of the steps alone, and cubics of another's making.

Claims:
    In the loop, FMUs
    - samples between equal steps: the same steps, cubics, told error | scipy's Hermite and spline |
      1e-12; 0.25 to 1.25 | passes
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline

import pinflex as pf


def test_samples_between_steps_do_not_cut_them() -> None:
    """61 instants at steps, 601 of which nine in ten lie between: the same 60 steps."""
    robot = pf.load("delta")  # whose joints are all angles
    few, many = (
        pf.solve(robot, level="coupled", dt=1e-3, until=0.06, samples=n) for n in (61, 601)
    )
    assert few.meta["cost"]["steps"] == many.meta["cost"]["steps"] == 60
    for key in ("eta", "joint/v", "torque", "multiplier"):
        want = few.array(key)
        # Times of steps differ by round-off; 1e-16 of positions is 1e-10 of accelerations here.
        np.testing.assert_allclose(
            many.array(key)[::10], want, rtol=0, atol=1e-9 * np.abs(want).max()
        )
    t, x = few.t, many.t
    cubic = CubicHermiteSpline(t, few.array("eta"), few.array("eta_v"))(x)
    np.testing.assert_allclose(many.array("eta"), cubic, rtol=0, atol=1e-12 * np.abs(cubic).max())
    # Motors are where their motion has them, not where a cubic does.
    exact = pf.solve(robot, level="rigid", until=0.06, samples=601)
    for name in robot.motors:
        want = exact.joint(name).angle
        np.testing.assert_allclose(many.joint(name).angle, want, rtol=0, atol=1e-10)
    # What is told bounds what a straight line misses of a smooth torque; a quarter for the spline.
    smooth = CubicSpline(t, few.torque)(x)
    missed, told = np.abs(many.torque - smooth).max(), many.meta["settings"]["interpolated"]
    assert 0.25 * told < missed < 1.25 * told
    assert any("samples lie between steps of 0.001 s" in text for text in many.meta["warnings"])


def test_a_run_between_whose_steps_samples_lie_goes_on() -> None:
    robot = pf.load("ur5")
    options = {"level": "coupled", "dt": 4e-3}
    whole = pf.solve(robot, until=0.2, samples=251, **options)
    half = pf.solve(robot, until=0.1, samples=126, **options)
    rest = pf.solve(robot, until=0.2, resume=half, **options)
    assert rest.meta["cost"]["steps"] == whole.meta["cost"]["steps"] == 50
    np.testing.assert_array_equal(rest.t, whole.t)
    # Newton's tolerance, 1e-7 of the accelerations: a resumed run begins with a new tangent.
    scale = np.abs(whole.torque).max()
    np.testing.assert_allclose(rest.torque, whole.torque, rtol=0, atol=1e-7 * scale)


@pytest.mark.parametrize("level, most", [("coupled", 2), ("ked", 201)])
def test_level_ked_still_ends_its_steps_at_samples(level: str, most: int) -> None:
    run = pf.solve(pf.load("cantilever"), level=level, dt=0.25, until=0.5, samples=201)
    assert most - 1 <= run.meta["cost"]["steps"] <= most  # ked counts its start
    said = "samples lie between" if level == "coupled" else "was cut to"
    assert any(said in text for text in run.meta["warnings"])
