"""What a command's error bar says of the time after its motors have stopped, and of fine grids."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scenes
from inversion.test_command_bars import five_bar

import pinflex as pf
from pinflex.inversion.verify import followed
from pinflex.solver.solve import default_motion


def test_most_of_the_bar_comes_once_the_motors_have_stopped_and_a_forward_run_sees_it() -> None:
    """The ur5: links that still swing go on by 2 um; while motors move the platform is 10 nm off.

    The forward run's tolerance is of about 1 mm of deflection: 1e-5 leaves 10 nm.
    """
    robot = pf.load("ur5")
    found = pf.command(robot, limited=False)
    result = followed(robot, default_motion(robot), found, tol=1e-5)
    along, turned = (float(np.linalg.norm(x)) for x in np.split(found.error, 2))
    assert max(result.during, result.after) < 0.1 * result.stopped
    assert result.stopped < along < 10.0 * result.stopped
    assert result.turned_stopped < turned < 10.0 * result.turned_stopped
    assert np.all(found.cut_off > 0.8 * found.error)


def test_a_finer_grid_does_not_shake_the_motors_by_round_off(tmp_path: Path) -> None:
    """1000 instants of .3 ms: differences raise round-off of poses by 1 / h^2.

    Held against the usual grid, 6 times as coarse: its own bar is 0.1 nm, of cranks of 0.1 m.
    """
    robot = five_bar(tmp_path)
    motion = pf.nonic(platform={"x": 0.01, "y": 0.01}, duration=0.3)
    usual = pf.command(robot, motion, limited=False)
    fine = pf.command(robot, motion, limited=False, instants=1000)
    assert np.all(fine.error < 2.0 * usual.error)
    ends = fine.position[fine.t > fine.t[-1] - fine.after]
    assert np.abs(np.diff(ends, 4, axis=0)).max() < 1e-9  # [rad]


def test_an_angle_that_is_held_is_no_part_of_a_rotation_vector(tmp_path: Path) -> None:
    """A boom that slews, and twists by a weight beside it: `ry` is held, `rx` and `rz` are not.

    About the world's y the twist shows as soon as the boom has turned; a concrete pump's `ry` was
    shown .77 mrad off where the angle was right to 1e-6.
    """
    body = scenes.Body
    robot = scenes.load(tmp_path, [
        body("post", "base", "revolute", mass=5, inertia=(0.1, 0.1, 0.1)),
        body("boom", "post", "revolute", (0, 0, 0.5), axis=(0, 1, 0), mass=1.3, com=(0.5, 0, 0),
             inertia=(1e-3, 0.1, 0.1)),
        body("tip", "boom", xyz=(1, 0, 0)),
        body("weight", "tip", xyz=(0, 0.3, 0), mass=1.0, inertia=(1e-3,) * 3),
    ], """
platform: tip
flexible:
  boom: {material: steel, section: {shape: tube, diameter: 0.02, wall: 0.002}, end: tip}
damping: {rayleigh: [0, 1.0e-3]}
""")  # fmt: skip
    motion = pf.nonic(joints={"post_joint": 0.5, "boom_joint": -0.3}, duration=0.6)
    found = pf.command(robot, motion, coordinates=["y", "ry"], limited=False)
    result = followed(robot, motion, found, tol=1e-5)
    moving = result.run.t <= found.t[-1]
    off = np.abs(result.off_path.rotation[moving, 1]).max()
    vector = np.abs(result.run.deviation_from(result.ideal, "tip").rotation[moving, 1]).max()
    assert off < found.error[1] + 1e-6 < 0.1 * vector  # the run's own, of 30 mrad of sag
