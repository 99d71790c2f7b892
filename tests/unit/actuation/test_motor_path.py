"""Motors of a platform motion: interpolated between few poses, also where accelerations jump.

Claims:
    Tolerances, collocation
    - motors of a platform motion whose accelerations jump (3tpt): few poses, interpolated between |
      inverse kinematics at every instant | 1e-10 m; 1e-7 of accelerations of 4.9 m/s^2 | 8e-15;
      8e-9
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.actuation import drive
from pinflex.actuation.drive import nominal
from pinflex.actuation.path import motor_axes
from pinflex.solver.solve import default_motion


@pytest.mark.parametrize("until", [0.5, 0.62, 0.7])  # in the motion, at its end, behind it
def test_a_motion_with_jumps_takes_few_poses(until: float, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = pf.load("3tpt")  # a trapezoid: accelerations jump at 0.02, 0.6 and 0.62 s
    motion, poses, plain = default_motion(robot), [], drive.motors_along
    assert motion.switches == pytest.approx((0.02, 0.6, 0.62))

    def counted(*given: object) -> object:
        poses.append(len(given[2]))  # type: ignore[arg-type]
        return plain(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(drive, "motors_along", counted)
    t = np.linspace(0.0, until, 1241)  # the jumps are among these times
    path = drive.motor_path(robot, motion, t)
    assert sum(poses) < 300
    exact, axes = nominal(robot, motion, t), motor_axes(robot)
    assert np.abs(path.position - exact.q[:, axes.q_at]).max() < 1e-10  # m, as promised
    # Poses are closed to 1e-14 m; pieces of 5 ms turn that into 1e-14 / (5 ms)^2 of accelerations.
    assert np.abs(path.velocity - exact.v[:, axes.v_at]).max() < 1e-10
    assert np.abs(path.acceleration - exact.a[:, axes.v_at]).max() < 1e-7  # of 4.9 m/s^2
