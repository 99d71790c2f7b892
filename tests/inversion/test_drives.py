"""Commands through elastic drives, as a line of the YAML or as a passive joint with a spring.

Claims:
    Commands: motions that the platform follows
    - elastic joint: motor angle, torque | closed form (Spong 1987) | 1e-8 | 6e-13, 4e-10
    - delta with elastic drives, Adept cycle 25, 305, 25 mm in 0.3 s, instants chosen by the
      command: error and residual swing over those of the rigid command | forward run | 1e-4 |
      passes; links as shipped 5e-7, 8e-6 (225 instants, 14 s of CPU), links alone 2e-7, 9e-6 (301,
      25 s)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scenes
from numpy.polynomial import Polynomial
from scipy.special import beta, betainc

import pinflex as pf
from pinflex.inversion.verify import followed


def arm(parent: str, m: float, inertia: float, lever: float) -> list[scenes.Body]:
    """An arm and its tip; mass [kg] at a lever [m], inertia about the joint [kg m^2]."""
    about_centre = (0.1, 0.1, inertia - m * lever**2)
    moving = scenes.Body("arm", parent, "revolute", mass=m, com=(lever, 0, 0), inertia=about_centre)
    return [moving, scenes.Body("tip", "arm", xyz=(0.8, 0, 0))]


def test_an_elastic_joint_alone_has_the_flat_command_of_spong(tmp_path: Path) -> None:
    """q of the link given: theta = q + (I q'' + m g l cos q) / k, tau = J theta'' + k (theta - q).

    Source: Spong (1987), J. Dyn. Syst. Meas. Control 109: the flexible-joint robot is flat.
    """
    m, inertia, lever, J, k, T, turn = 2.0, 0.3, 0.3, 0.05, 400.0, 0.4, 1.0
    bodies = [scenes.Body("gear", "base", "revolute"), *arm("gear", m, inertia, lever)]
    robot = scenes.load(
        tmp_path,
        bodies,
        f"""gravity: [0, -9.81, 0]
actuated: [gear_joint]
joints:
  gear_joint: {{rotor_inertia: {J}}}
  arm_joint: {{spring: {k}}}
platform: tip
""",
    )
    # nine smooth derivatives: where the fifth jumps, as at the ends of a nonic, differences of
    # order 8 see it in the torque (1e-4 there)
    flat = (Polynomial([0, 1]) * Polynomial([1, -1])) ** 9

    def rates(t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Position, speed, acceleration and the fourth rate; by symmetry, where u is small."""
        u = np.clip(t / T, 0.0, 1.0)
        near, scale = np.minimum(u, 1.0 - u), turn / beta(10, 10)
        odd = np.where(u <= 0.5, 1.0, -1.0)
        speed, rise, third = flat(near), odd * flat.deriv(1)(near), odd * flat.deriv(3)(near)
        moved = turn * betainc(10, 10, u)
        return moved, scale / T * speed, scale / T**2 * rise, scale / T**4 * third

    def law(t: np.ndarray) -> tuple[np.ndarray, ...]:
        return tuple(x[:, None] for x in rates(t)[:3])

    motion = pf.Motion("smooth", "platform", ("rz",), T, law)
    found = pf.command(robot, motion, before=0.1, after=0.1, instants=251)
    q, v, a, snap = rates(np.clip(found.t - found.before, 0.0, T))
    weight = m * 9.81 * lever
    theta = q + (inertia * a + weight * np.cos(q)) / k
    falls = -weight * (np.cos(q) * v**2 + np.sin(q) * a)  # second rate of the weight's moment
    torque = J * (a + (inertia * snap + falls) / k) + inertia * a + weight * np.cos(q)
    # at every instant; 6e-13 and 4e-10 of differences of order 8 and round-off over h^2
    assert np.max(np.abs(found.position[:, 0] - theta)) < 1e-8 * np.max(np.abs(theta))
    assert np.max(np.abs(found.torque[:, 0] - torque)) < 1e-8 * np.max(np.abs(torque))


def test_the_drive_of_one_line_has_it_to_round_off(tmp_path: Path) -> None:
    """The same robot by `drive`, and its motor side: no grid is in the answer, ends included."""
    m, inertia, lever, gear, k, T = 2.0, 0.3, 0.3, 50, 400.0, 0.4
    J = gear**2 * 2e-5
    bodies = arm("base", m, inertia, lever)
    robot = scenes.load(
        tmp_path,
        bodies,
        f"gravity: [0, -9.81, 0]\nplatform: tip\njoints: {{arm_joint: {{drive: {{gear: {gear}, "
        f"motor_inertia: 2e-5, stiffness: {k}, friction: {{coulomb: 0.5, speed: 0.5}}}}}}}}\n",
    )
    found = pf.command(robot, pf.nonic(platform={"rz": 1.0}, duration=T), before=0.1, after=0.1)
    u = Polynomial([0, 1]) / T
    s = u**5 * (126 - 420 * u + 540 * u**2 - 315 * u**3 + 70 * u**4)
    t = np.clip(found.t - found.before, 0.0, T)
    q, v, a, jerk, snap = ((s.deriv(n) if n else s)(t) for n in range(5))
    weight = m * 9.81 * lever
    load, falls = inertia * a + weight * np.cos(q), np.cos(q) * v**2 + np.sin(q) * a
    theta, rate = q + load / k, v + (inertia * jerk - weight * np.sin(q) * v) / k
    torque = J * (a + (inertia * snap - weight * falls) / k) + load + 0.5 * np.tanh(rate / 0.5)
    assert found.iterations == 0
    for ours, closed in ((found.position, theta), (found.velocity, rate), (found.torque, torque)):
        np.testing.assert_allclose(ours[:, 0], closed, rtol=0, atol=1e-8 * np.abs(closed).max())
    side = found.drives["arm_joint"]
    np.testing.assert_allclose(
        side["motor_torque"], torque / gear, atol=1e-8 * np.abs(torque).max()
    )
    np.testing.assert_allclose(side["torque"], load, atol=1e-7 * np.abs(load).max())
    np.testing.assert_allclose(side["motor_speed"], gear * rate, atol=1e-8 * np.abs(rate).max())
    header = found.to_csv(tmp_path / "c.csv").read_text().splitlines()[0]
    units = {"position": "rad", "speed": "rad/s", "torque": "N m"}
    assert header.endswith(",".join(f"arm_joint.motor_{x} [{unit}]" for x, unit in units.items()))


def test_a_closed_loop_of_elastic_drives_follows_to_round_off() -> None:
    """The shipped delta with rigid links: the forward run knows nothing of the command."""
    rigid_links = ["flexible=null", "damping=null"]
    gears = [f"joints.motor_{k}.drive={{gear: 20, stiffness: 2.0e+4}}" for k in (1, 2, 3)]
    robot = pf.load("delta", [*rigid_links, *gears])
    motion = pf.nonic(platform={"x": 0.1, "y": 0.0, "z": 0.05}, duration=0.3)
    found = pf.command(robot, motion, before=0.02, after=0.05, instants=150, limited=False)
    assert found.iterations == 0
    result = followed(robot, motion, found, tol=1e-5)
    assert "torque" not in result.run.errors.time  # one that nearly vanishes would refuse the tol
    assert max(result.during, result.after) < 1e-9  # [m], of some 1e-4 of the rigid command
    # The platform does not turn: round-off of its rotation shortens no step (it did: 10 000).
    assert result.run.meta["cost"]["steps"] < 400


def test_the_bar_of_a_quasistatic_command_covers_with_flexible_links_and_elastic_drives() -> None:
    """The ur5 by 141 mm in 0.2 s, six drives: 18 nm of error, which a forward run resolves."""
    stiff = dict.fromkeys(("shoulder_pan", "shoulder_lift", "elbow"), 2e4)
    stiff |= dict.fromkeys(("wrist_1", "wrist_2", "wrist_3"), 5e3)
    drive = "{{gear: 100, stiffness: {:g}, damping: 5, motor_inertia: 1.0e-4}}"
    robot = pf.load("ur5", [f"joints.{n}_joint.drive={drive.format(k)}" for n, k in stiff.items()])
    moves = {"x": 0.1, "y": 0.1, "z": -0.05, "rz": 0.1, "ry": 0.0, "rx": 0.0}
    motion = pf.nonic(platform=moves, duration=0.2)
    slow = pf.command(robot, motion, "quasistatic", limited=False)
    # tol is of the 1 mm by which gears and links give way: 1e-4 would leave 0.1 um, 1e-5 10 nm.
    result = followed(robot, motion, slow, tol=1e-5)
    along = np.linalg.norm(slow.error[:3])
    assert max(result.during, result.after) < along < 2.0 * max(result.during, result.after)
    assert max(result.turned_during, result.turned_after) < np.linalg.norm(slow.error[3:])


@pytest.fixture(scope="module")
def delta() -> pf.Mechanism:
    """The shipped delta with a gear of 20 kN m/rad between each motor and its arm."""
    drive = "{gear: 20, stiffness: 2.0e+4, damping: 10}"
    return pf.load("delta", [f"joints.motor_{k}.drive={drive}" for k in (1, 2, 3)])


@pytest.mark.parametrize("drives", ["links alone", "elastic drives too"])
def test_a_delta_swings_at_most_a_ten_thousandth_of_what_it_did(
    drives: str, delta: pf.Mechanism
) -> None:
    """305 mm in 0.3 s along a line: error and residual swing, beside the rigid command's."""
    robot = delta if drives != "links alone" else pf.load("delta")
    motion = pf.nonic(platform={"x": 0.305, "y": 0.0, "z": 0.0}, duration=0.3)
    rest = {"before": 0.05, "after": 0.1}  # instants as the command chooses them
    commands = [pf.command(robot, motion, level, **rest) for level in ("rigid", "exact")]
    # `tol` is relative to the largest deviation, 1.2 mm: the runs' own error is 1 nm
    rigid, exact = (followed(robot, motion, found, tol=1e-6) for found in commands)
    assert rigid.during > 1e-4  # [m]: there is something to gain
    assert exact.during < 1e-4 * rigid.during
    assert exact.swing < 1e-4 * max(rigid.swing, rigid.after)


def test_a_delta_with_elastic_drives_follows_the_adept_cycle(delta: pf.Mechanism) -> None:
    """25, 305, 25 mm in 0.3 s; the links' static shapes alone, which halves the cost."""
    coarse = {"basis": "{kind: craig_bampton, internal: 0}"}
    robot = pf.load(delta.description.path, [f"flexible.*.basis={coarse['basis']}"])
    motion = pf.adept(duration=0.3)
    rest = {"before": 0.05, "after": 0.1}
    commands = [pf.command(robot, motion, level, **rest) for level in ("rigid", "exact")]
    # 1e-4 of the rigid swing is 2e-6 of the largest deviation that `tol` is relative to.
    rigid, exact = (followed(robot, motion, found, tol=1e-6) for found in commands)
    assert rigid.during > 1e-3  # [m]: 3.4 mm
    assert exact.during < 1e-4 * rigid.during
    assert exact.swing < 1e-4 * rigid.swing
    found = commands[1]
    assert 50.0 < np.max(np.abs(found.torque)) < 120.0  # N m; what the URDF allows
    assert 5.0 < np.max(np.abs(found.velocity)) < 15.0  # rad/s
    assert max(found.actuation) < 0.01  # [s]: next to none, against 0.3 s
