"""The hexapod against its closed forms: stiffness by its legs, sliders by its distances, weight.

Claims:
    Machines
    - hexapod: compliance of the platform in six directions; travel of the sliders; holding forces |
      sum of E A / L of six rods; distances; virtual work | 1e-8; 1e-9 m; 1e-8 | passes
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import pinflex as pf

TURN = np.radians([15 * s + c for c in (0, 120, 240) for s in (-1, 1)])
ROUND = np.radians([-45, 45, 75, 165, 195, 285])
FEET = 0.3 * np.stack([np.cos(TURN), np.sin(TURN), 0 * TURN], axis=1)
BALLS = 0.18 * np.stack([np.cos(ROUND), np.sin(ROUND), 0 * ROUND], axis=1)  # in the platform
HEIGHT = np.array([0.0, 0.0, 0.4])
LEGS = BALLS + HEIGHT - FEET
LENGTH = np.linalg.norm(LEGS, axis=1)
WRITTEN = 1e-8  # relative: the URDF gives ten digits, of lengths that differ by a tenth


def test_the_platform_gives_way_as_six_rods_in_line() -> None:
    ours = pf.platform_compliance(pf.load("hexapod"), preload="none")
    along = LEGS / LENGTH[:, None]
    rows = np.hstack([along, np.cross(BALLS, along)])
    # steel of pinflex's table; the rest of a leg is stiff
    modulus = pf.load("hexapod").description.flexible[0].material.E
    stiffness = modulus * math.pi * 0.01**2 / 0.3 * rows.T @ rows
    by_hand = np.linalg.inv(stiffness)
    size = np.sqrt(np.diag(by_hand))
    assert np.max(np.abs(ours - by_hand) / np.outer(size, size)) < WRITTEN


def test_the_sliders_travel_by_the_change_of_the_distances() -> None:
    robot = pf.load("hexapod")
    run = pf.solve(robot, level="rigid", samples=41)
    u = np.clip(run.t / 0.2, 0, 1)
    s = 10 * u**3 - 15 * u**4 + 6 * u**5
    turn = np.radians(4) * s
    c, sn, o = np.cos(turn), np.sin(turn), 0 * turn
    R = np.stack([np.stack([c, -sn, o], 1), np.stack([sn, c, o], 1), np.stack([o, o, o + 1], 1)], 1)
    centre = HEIGHT + np.stack([0.04 * s, o, 0.01 * s], axis=1)
    for k in range(6):
        leg = centre + R @ BALLS[k] - FEET[k]
        travel = np.linalg.norm(leg, axis=1) - LENGTH[k]
        ours = run.joint(f"slide_{k + 1}").position
        assert np.abs(ours - travel).max() < WRITTEN * 0.1  # of travels of some centimetres


def test_the_motors_carry_the_weight_in_six_equal_parts() -> None:
    """Virtual work of platform, rods and cylinders, whose centres turn with the legs."""
    robot = pf.load("hexapod")
    still = pf.solve(robot, pf.hold(duration=0.1), level="rigid", samples=2)
    rod, cylinder = 7850 * math.pi * 0.01**2 * 0.3, 2.2
    # the platform up by dz: a leg turns and stretches; its cylinder at 0.1 m, its rod 0.15 m short
    L, h = LENGTH[0], 0.4
    lift = 9.81 * (12 + 6 * (cylinder * _raised(0.1, L, h, 0) + rod * _raised(L - 0.15, L, h, 1)))
    assert still.torque[0] == pytest.approx(np.full(6, lift / (6 * h / L)), rel=1e-8)


def _raised(along: float, L: float, h: float, slides: int) -> float:
    """Rise of a point of the leg at a distance from its foot, by rise of the ball.

    z = along h / L, with L dL = h dh: the point keeps its distance, or slides with the rod.
    """
    keeps = along * (1 / L - h * h / L**3)
    return keeps + slides * (h / L) * (h / L)
