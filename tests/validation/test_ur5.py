"""An arm from example-robot-data with two elastic links: what stiffness and payload do to it.

Claims:
    Machines
    - ur5: torque and pose of the balanced arm tend to rigid like 1/E | - | +- 0.03 | 1.00
    - frequencies like sqrt(E); fall with payload | - | 1e-9; monotone | 46.4 Hz empty, 34.6 Hz with
      5 kg
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from tests.finite import slope

FACTORS = (1.0, 10.0, 100.0)  # of Young's modulus


def stiffened(factor: float) -> pf.Mechanism:
    return pf.load("ur5", [f"flexible.*.material.E={7e10 * factor!r}"])


def test_frequencies_grow_with_the_root_of_stiffness() -> None:
    found = np.array([pf.modes(stiffened(f), preload="none").frequencies[:6] for f in FACTORS])
    for factor, row in zip(FACTORS, found, strict=True):
        np.testing.assert_allclose(row, np.sqrt(factor) * found[0], rtol=1e-9)
    loaded = pf.modes(stiffened(1.0)).frequencies[:6]
    np.testing.assert_allclose(loaded, found[0], rtol=1e-4)  # gravity hardly bends these tubes


def test_balanced_torques_and_poses_tend_to_the_rigid_ones_like_one_over_stiffness() -> None:
    torque, pose = [], []
    for factor in FACTORS:
        m = stiffened(factor)
        rigid = pf.solve(m, level="rigid", samples=41, until=0.6)
        balanced = pf.solve(m, level="quasistatic", samples=41, until=0.6)
        torque.append(np.abs(balanced.torque - rigid.torque).max())
        pose.append(balanced.deviation_from(rigid, "tool0").max())
    assert slope(FACTORS, torque) == pytest.approx(-1.0, abs=0.03)
    assert slope(FACTORS, pose) == pytest.approx(-1.0, abs=0.01)
    assert torque[-1] < 1e-4  # [N m] of 58


def test_vibrating_torques_tend_to_the_rigid_ones_too() -> None:
    """From rest in equilibrium: a cycloid's jerk rings the arm, the less the stiffer it is."""
    torque, pose = [], []
    for factor in FACTORS:
        m = stiffened(factor)
        rigid = pf.solve(m, level="rigid", samples=81, until=0.6)
        run = pf.solve(m, level="coupled", samples=81, until=0.6, tol=1e-4, start="static")
        torque.append(np.abs(run.torque - rigid.torque).max())
        pose.append(run.deviation_from(rigid, "tool0").max())
    assert slope(FACTORS, pose) == pytest.approx(-1.0, abs=0.02)
    # The amplitude of the ringing falls with the ratio of a period to the motion, 1/sqrt(E), and
    # faster where damping (stiffness-proportional) ends it.
    assert slope(FACTORS, torque) < -0.5
    # 1.32e-3 of the peak, as with tol=1e-5 and with steps of 25 us (at 1 ms the first modes of the
    # stiffest arm are not resolved: 2.3e-3)
    assert torque[-1] < 1.4e-3 * 58  # [N m]


def test_frequencies_fall_with_the_payload() -> None:
    loads = (0.0, 1.0, 3.0, 5.0)  # [kg] at the wrist
    found = [
        pf.modes(pf.load("ur5", [f"flexible.forearm_link.tip={{mass: {kg}}}"])).frequencies[:4]
        for kg in loads
    ]
    assert np.all(np.diff(np.array(found), axis=0) < 0)
    assert found[-1][0] < 0.8 * found[0][0]


def test_the_links_weigh_what_the_urdf_says() -> None:
    """Mass, centre and moments: the beams carry what a tube weighs, the rest rides on them."""
    m = stiffened(1.0)
    for name, tube in (("upper_arm_link", 1.438), ("forearm_link", 0.7187)):  # [kg] rho A L
        part = m.parts[name]
        assert part.mass == pytest.approx((part.share or 0) * tube, rel=1e-3)
        urdf = next(link.inertia.matrix() for link in m.links if link.name == name)
        every = sum((i.matrix() for i in part.rigid_inertias()), np.zeros((6, 6)))
        np.testing.assert_allclose(every, urdf, atol=1e-12 * np.abs(urdf).max())
