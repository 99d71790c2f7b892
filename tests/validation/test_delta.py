"""The delta against a space frame of its own: stiffness, sag, modes, deviation, rigid torques.

The frame (tests/frame.py, tests/delta_frame.py) shares no code with pinflex: direct stiffness,
three beams an arm and six a rod, poses by hand. Both leave out shear and rotary inertia.

Claims:
    Machines
    - delta: compliance and stiffness of the plate in six directions, sag, eight frequencies,
      quasistatic deviation at six instants | space frame by direct stiffness (`frame.py`,
      `delta_frame.py`), poses and inertia forces by hand | 1 % | 4e-4, 5e-5, 1.3e-3, 1e-3
    - delta: rigid torques | virtual work in the place of the plate | 1e-3 | 2e-4
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.studies.pose import platform_compliance
from tests.delta_frame import START, DeltaFrame, acceleration_of, elbows, plate_at, quasistatic
from tests.frame import Array

WITHIN = 0.01  # asked of the model; what is reached stands beside each test


@pytest.fixture(scope="module")
def robot() -> pf.Mechanism:
    return pf.load("delta")


@pytest.fixture(scope="module")
def home() -> DeltaFrame:
    return DeltaFrame(START)


@pytest.fixture(scope="module")
def rigid(robot: pf.Mechanism) -> pf.Result:
    return pf.solve(robot, level="rigid")


@pytest.fixture(scope="module")
def still(robot: pf.Mechanism) -> pf.Result:
    return pf.solve(robot, level="quasistatic")


def test_the_platform_gives_way_as_the_frame_does(robot: pf.Mechanism, home: DeltaFrame) -> None:
    ours, frame = platform_compliance(robot), home.compliance()
    size = np.sqrt(np.diag(frame))
    # others free (1 / C_ii) and the whole matrix, in units of its diagonal: 4e-4
    assert np.diag(ours) == pytest.approx(np.diag(frame), rel=WITHIN)
    assert np.max(np.abs(ours - frame) / np.outer(size, size)) < WITHIN
    # others held (K_ii): 4e-4
    K, own = np.linalg.inv(ours), np.linalg.inv(frame)
    assert np.diag(K) == pytest.approx(np.diag(own), rel=WITHIN)


def test_it_sags_as_the_frame_does(rigid: pf.Result, still: pf.Result, home: DeltaFrame) -> None:
    sag = home.deviation(np.zeros(3), np.zeros((3, 3)))
    away = still.deviation_from(rigid, "plate")
    assert np.linalg.norm(away.position[0] - sag[:3]) < WITHIN * np.linalg.norm(sag[:3])
    assert np.linalg.norm(away.rotation[0] - sag[3:]) < WITHIN * np.linalg.norm(sag[3:])


def test_it_has_the_frequencies_of_the_frame(robot: pf.Mechanism, home: DeltaFrame) -> None:
    ours = pf.modes(robot, count=8, preload="none").frequencies
    # the first three are the machine's, the others its rods': 1.3e-3
    assert ours == pytest.approx(home.frequencies(8), rel=WITHIN)


def test_its_quasistatic_deviation_is_that_of_the_frame_under_rigid_inertia_forces(
    rigid: pf.Result, still: pf.Result
) -> None:
    away = still.deviation_from(rigid, "plate")
    largest = away.max()
    for k in np.searchsorted(still.t, (0.03, 0.07, 0.11, 0.19, 0.23, 0.27)):
        frame = quasistatic(float(still.t[k]))
        # 1e-3: deflection changes the pose by a thousandth
        assert np.linalg.norm(away.position[k] - frame[:3]) < WITHIN * largest
        turned = np.linalg.norm(frame[3:])
        assert np.linalg.norm(away.rotation[k] - frame[3:]) < WITHIN * max(turned, 1e-5)


def test_the_rigid_torques_are_those_of_a_lagrangian_in_the_place_of_the_plate(
    rigid: pf.Result,
) -> None:
    """Virtual work of weights and inertia forces: arms and rods as lines of mass, no rotation."""
    k = int(np.searchsorted(rigid.t, 0.09))
    expected = _virtual_work(float(rigid.t[k]))
    # rods and arms have no thickness here: their spin inertia is 1e-4 of the rest
    assert rigid.torque[k] == pytest.approx(expected, rel=1e-3)


def _virtual_work(t: float) -> Array:
    """Torques of the motors [N m] that balance plate, elbows, arms, rods and rotors."""
    from tests import delta_frame as d

    h = 1e-3  # [s]
    places = plate_at(t + h * np.arange(-2, 3))
    tips = acceleration_of(elbows(places), h)  # (3, 3)
    plate = acceleration_of(places, h)
    step = 1e-6 * np.eye(3)  # [m]
    moved = (elbows(places[2] + step) - elbows(places[2] - step)) / 2e-6  # leg, by place, xyz
    arm_mass = d.ARM_BAR.rho * d.ARM_BAR.area * d.ARM
    rod_mass = d.ROD_BAR.rho * d.ROD_BAR.area * d.ROD
    force = d.PLATE_MASS * (plate - d.G)  # on the plate, to hold and accelerate all
    jacobian = np.zeros((3, 3))  # of the motor angles by the place of the plate
    rotor = np.zeros(3)
    elbow_at = elbows(places)
    for leg in range(3):
        J, a = moved[leg].T, tips[leg]
        # arm: mass / 3 at the tip for inertia, / 2 for weight; rod: (2 1; 1 2) / 6 of its mass
        pull = d.ELBOW * (a - d.G) + arm_mass * (a / 3 - d.G / 2)
        force = force + J.T @ pull
        force = force + 2 * rod_mass * (J.T @ (a / 3 + plate / 6 - d.G / 2))
        force = force + 2 * rod_mass * (plate / 3 + a / 6 - d.G / 2)
        R = d.azimuth(leg)
        local = elbow_at[leg] @ R - np.array([d.BASE, 0, 0])  # (5, 3) in the plane of the arm
        angle = np.arctan2(-local[:, 2], local[:, 0])
        rotor[leg] = 0.06 * np.array([-1, 16, -30, 16, -1]) @ angle / (12 * h * h)
        tangent = R @ np.array([-np.sin(angle[2]), 0, -np.cos(angle[2])]) * d.ARM
        jacobian[leg] = tangent @ J / d.ARM**2
    return np.asarray(np.linalg.solve(jacobian.T, force) + rotor)
