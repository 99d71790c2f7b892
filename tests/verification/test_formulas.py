"""Formulas of the textbook behind single outputs: stress, forces, work, shapers, rotations."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import pinflex as pf
from pinflex.bodies.second_order import _second_rotation
from pinflex.description.external import FrameForce
from pinflex.description.section import from_spec
from pinflex.description.shaping import shaper
from pinflex.recovery.load_work import load_work
from pinflex.recovery.stress import stresses
from tests.finite import slope
from tests.scenes import load
from tests.verification.test_beams import BEAM, scene


def test_a_shaft_under_bending_and_torsion() -> None:
    """sqrt(s^2 + 3 t^2) with s = 32 M / pi d^3, t = 16 T / pi d^3 (von Mises 1913)."""
    d, M, T = 0.02, 30.0, 50.0
    shaft = from_spec({"shape": "circle", "diameter": d}, "section")
    of = stresses(shaft, np.array([[[0.0, 0.0, 0.0, T, 0.6 * M, 0.8 * M]]]))
    bending, shear = 32 * M / (math.pi * d**3), 16 * T / (math.pi * d**3)
    assert of["shear"].item() == pytest.approx(shear, rel=1e-12)  # round-off
    # The worst fibre is one of a polygon of the rim: 24 places, cos(pi / 24) = 0.9914 at worst.
    assert bending * 0.991 <= of["bending"].item() <= bending * (1 + 1e-12)
    expected = math.sqrt(of["bending"].item() ** 2 + 3 * shear**2)
    assert of["von_mises"].item() == pytest.approx(expected, rel=1e-12)


def test_the_root_moment_has_the_arm_of_the_bent_beam(tmp_path: Path) -> None:
    """M = F_y (L - shortening) + F_x w: statics of the beam as it stands, whatever bends it."""
    head = "forces: {load: {at: tip, force: [-0.8, 0.3, 0]}}\nframes: [tip]\n"
    robot = load(tmp_path, BEAM, scene("{kind: craig_bampton, internal: 4}", head))
    run = pf.solve(robot, pf.hold(duration=1.0), "quasistatic", samples=2)
    (x, y, _), root = run.frame("tip").position[0], run.link("beam").resultant[0, 0]
    assert y > 0.12  # against the straight beam's F_y L: a third more
    # Forces are those of equilibrium, to Newton's tolerance.
    assert abs(root[5]) == pytest.approx(0.3 * x + 0.8 * y, rel=1e-6)


def swept(force: FrameForce, count: int) -> float:
    """Work of a load on a point that moves and turns, from instants of position and rotation."""
    t = np.linspace(0.0, 1.0, count)
    p, R, rate, rise = (np.array([f(x) for x in t]) for f in (place, turn, rates, rises))
    return float(load_work(force, t, p, R, rate, rise)[-1])


def place(t: float) -> list[float]:
    return [math.sin(2 * t), 0.5 * t**2, math.cos(t)]


def turn(t: float) -> np.ndarray:
    return Rotation.from_euler("z", 3 * t + t**2).as_matrix()


def rates(t: float) -> list[float]:
    return [2 * math.cos(2 * t), t, -math.sin(t), 0, 0, 3 + 2 * t]


def rises(t: float) -> list[float]:
    return [-4 * math.sin(2 * t), 1, -math.cos(t), 0, 0, 2]


@pytest.mark.parametrize("follower", [True, False])
def test_work_of_a_load_converges_with_the_fourth_power(follower: bool) -> None:
    force = FrameForce("f", "tip", (3.0, -2.0, 1.0), (0.5, 0.2, 4.0), follower, ramp=2.0)

    def power(t: float) -> float:
        R = turn(t) if follower else np.eye(3)
        v = np.array(rates(t))
        return force.scale(t) * float((R @ force.force) @ v[:3] + (R @ force.moment) @ v[3:])

    exact = quad(power, 0.0, 1.0, epsabs=1e-13)[0]
    steps = np.array([8, 16, 32])
    gaps = [abs(swept(force, int(n) + 1) - exact) for n in steps]
    # Euler-Maclaurin: h^4 once the end correction has the true slope, h^2 with any other.
    assert slope(1.0 / steps, gaps) > 3.7


@pytest.mark.parametrize("damping", [0.05, 0.1, 0.2, 0.3])
def test_the_damped_ei_shaper_leaves_its_five_per_cent(damping: float) -> None:
    made = shaper("ei", 2.0, damping)
    # The published fit of the shares is good to 4 % of 5 % up to a damping of 0.3.
    assert made.residual(2.0, damping).item() == pytest.approx(0.05, rel=0.041)
    # At the edges of its range, some 20 % off in frequency, no more than that either.
    assert np.all(made.residual(np.linspace(1.75, 2.3, 12), damping) < 0.053)


def test_second_order_of_an_interface_is_that_of_three_turns() -> None:
    """d2/ds dt of Rz Ry Rx at the sum of two sets of angles, by differences."""
    rng, h = np.random.default_rng(3), 1e-3

    def R(angles: np.ndarray) -> np.ndarray:
        return Rotation.from_euler("ZYX", angles[::-1]).as_matrix()

    for _ in range(5):
        one, two = rng.normal(size=(2, 3))
        parts = [a * b * R(h * (a * one + b * two)) for a in (1, -1) for b in (1, -1)]
        expected = sum(parts) / (4 * h**2)
        assert np.allclose(_second_rotation(one, two), expected, atol=1e-4)  # of size one, h^2
