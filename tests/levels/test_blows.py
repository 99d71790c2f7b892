"""A motor whose speed jumps: what it does to what hangs on it, or that it is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.solver.solve import blows
from tests.scenes import Body, load

SPEED, AT, OMEGA = 0.1, 0.103, 20.0  # [m/s], [s], [rad/s]


def carriage(folder: Path) -> pf.Mechanism:
    """A carriage that a motor moves, and on it a mass on a spring."""
    slide = {"axis": (1, 0, 0), "mass": 1.0, "inertia": (1, 1, 1)}
    bodies = (
        Body("cart", "base", "prismatic", **slide),  # type: ignore[arg-type]
        Body("mass", "cart", "prismatic", **slide),  # type: ignore[arg-type]
    )
    yaml = "gravity: [0, 0, 0]\nactuated: [cart_joint]\njoints: {mass_joint: {spring: 400}}\n"
    return load(folder, bodies, yaml)


def jump(t: Array, at: float = AT, by: float = SPEED) -> tuple[Array, Array, Array]:
    """Rest, then a constant speed."""
    moving = (t >= at)[:, None]
    return by * np.maximum(t - at, 0.0)[:, None], by * moving, 0.0 * moving


@pytest.mark.parametrize("corners", [(AT,), ()])
@pytest.mark.parametrize("level", ["ked", "coupled"])
def test_a_speed_that_jumps_inside_a_run_is_refused_with_its_size(
    tmp_path: Path, level: str, corners: tuple[float, ...]
) -> None:
    motion = pf.Motion("own", "joints", ("cart_joint",), 1.0, jump, corners=corners)
    with pytest.raises(pf.MotionError, match=r"cart_joint jumps by 0\.1 .* at t = 0\.103 s"):
        pf.solve(carriage(tmp_path), motion, level=level, samples=101)


def test_a_run_up_to_a_jump_and_a_start_from_it_keep_the_momentum(tmp_path: Path) -> None:
    """The way out that the refusal names: the mass stays behind, u = -V/omega sin(omega t)."""
    robot = carriage(tmp_path)
    still = pf.solve(robot, pf.hold(duration=AT), level="coupled", samples=11)
    on = pf.Motion("on", "joints", ("cart_joint",), 0.5, lambda t: jump(t, 0.0), absolute=True)
    run = pf.solve(robot, on, level="coupled", samples=101, tol=1e-6, start=still)
    u = run.joint("mass_joint").position
    np.testing.assert_allclose(u, -SPEED / OMEGA * np.sin(OMEGA * run.t), atol=1e-8)


def test_small_jumps_are_said_and_smooth_motions_are_not(tmp_path: Path) -> None:
    def nearly(t: Array) -> tuple[Array, Array, Array]:
        """A swing of 1 rad/s, and 0.5 % of that more from AT on."""
        more = jump(t, AT, 5e-3)
        swing = (0.1 * np.sin(10 * t), np.cos(10 * t), -10 * np.sin(10 * t))
        return tuple(x[:, None] + y for x, y in zip(swing, more, strict=True))  # type: ignore[return-value]

    motion = pf.Motion("own", "joints", ("cart_joint",), 1.0, nearly)
    (said,) = blows(motion, 0.5)
    assert "0.005 (rad/s or m/s), 0.5 %" in said and "t = 0.103 s" in said
    run = pf.solve(carriage(tmp_path), motion, level="coupled", until=0.2, samples=11)
    assert said in run.meta["warnings"]
    joints = {"cart_joint": 0.1}
    for smooth in (
        pf.trapezoid(joints=joints, duration=0.3, ramp=0.01),
        pf.quintic(joints=joints, duration=0.01),
        pf.harmonic(joints=joints, frequency=40.0),
        pf.quintic(joints=joints, duration=0.3).shaped("zvd", [7.0]),
        pf.hold(duration=1.0),
    ):
        assert blows(smooth, 0.5) == []


def test_a_harmonic_motion_that_a_shaper_repeats_starts_each_time_with_a_jump(
    tmp_path: Path,
) -> None:
    motion = pf.harmonic(joints={"cart_joint": 0.01}, frequency=2.0, duration=0.5)
    robot = carriage(tmp_path)
    pf.solve(robot, motion, level="coupled", samples=11)  # the jump at the start is made
    shaped = motion.shaped("zv", [5.0])
    with pytest.raises(pf.MotionError, match=r"jumps by 0\.0628 .* at t = 0\.1 s"):
        pf.solve(
            robot, shaped, level="coupled", samples=11
        )  # half of 2 pi 2 0.01, half a period on
