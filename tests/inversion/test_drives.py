"""Commands through elastic drives: a passive joint with a spring between motor and link."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import scenes
from numpy.polynomial import Polynomial
from scipy.special import beta, betainc

import pinflex as pf
from pinflex.inversion.verify import followed

ROOT = Path(pf.__file__).parents[1]


def test_an_elastic_joint_alone_has_the_flat_command_of_spong(tmp_path: Path) -> None:
    """q of the link given: theta = q + (I q'' + m g l cos q) / k, tau = J theta'' + k (theta - q).

    Source: Spong (1987), J. Dyn. Syst. Meas. Control 109: the flexible-joint robot is flat.
    """
    m, inertia, lever, J, k, T, turn = 2.0, 0.3, 0.3, 0.05, 400.0, 0.4, 1.0
    bodies = [
        scenes.Body("gear", "base", "revolute"),
        scenes.Body(
            "arm", "gear", "revolute", mass=m, com=(lever, 0, 0),
            inertia=(0.1, 0.1, inertia - m * lever**2),
        ),
        scenes.Body("tip", "arm", xyz=(0.8, 0, 0)),
    ]  # fmt: skip
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


@pytest.fixture(scope="module")
def delta(tmp_path_factory: pytest.TempPathFactory) -> pf.Mechanism:
    """The shipped delta with a gear of 20 kN m/rad between each motor and its arm."""
    folder = tmp_path_factory.mktemp("delta")
    text = (ROOT / "models/delta/delta.urdf").read_text()
    for k in (1, 2, 3):
        joint = re.search(rf'<joint name="motor_{k}".*?</joint>', text, re.S)
        assert joint is not None
        origin = re.search(r"<origin[^>]*/>", joint[0])
        assert origin is not None
        motor = joint[0].replace(f'link="arm_{k}"', f'link="gear_{k}"')
        elastic = joint[0].replace(f'"motor_{k}"', f'"elastic_{k}"')
        elastic = elastic.replace(origin[0], '<origin xyz="0 0 0"/>')
        elastic = elastic.replace('link="base"', f'link="gear_{k}"')
        text = text.replace(joint[0], f'<link name="gear_{k}"/>{motor}{elastic}')
    (folder / "delta.urdf").write_text(text)
    yaml = (ROOT / "models/delta/delta.yaml").read_text()
    springs = "".join(f"  elastic_{k}: {{spring: 2.0e+4, damper: 10}}\n" for k in (1, 2, 3))
    (folder / "delta.yaml").write_text(yaml.replace("  ball_1a:", springs + "  ball_1a:", 1))
    return pf.load(folder / "delta.yaml")


@pytest.mark.parametrize("drives", ["links alone", "elastic drives too"])
def test_a_delta_swings_at_most_a_ten_thousandth_of_what_it_did(
    drives: str, delta: pf.Mechanism
) -> None:
    """305 mm in 0.3 s along a line: error and residual swing, beside the rigid command's."""
    robot = delta if drives != "links alone" else pf.load("delta")
    motion = pf.nonic(platform={"x": 0.305, "y": 0.0, "z": 0.0}, duration=0.3)
    rest = {"before": 0.05, "after": 0.1, "instants": 150}
    rigid = followed(robot, motion, pf.command(robot, motion, "rigid", **rest))
    exact = followed(robot, motion, pf.command(robot, motion, "exact", **rest))
    assert rigid.during > 1e-4  # [m]: there is something to gain
    assert exact.during < 1e-4 * rigid.during
    assert exact.swing < 1e-4 * max(rigid.swing, rigid.after)


def test_a_delta_with_elastic_drives_follows_the_adept_cycle(delta: pf.Mechanism) -> None:
    """25, 305, 25 mm in 0.3 s; the links' static shapes alone, which halves the cost."""
    coarse = {"basis": "{kind: craig_bampton, internal: 0}"}
    robot = pf.load(delta.description.path, [f"flexible.*.basis={coarse['basis']}"])
    motion = pf.adept(duration=0.3)
    rest = {"before": 0.05, "after": 0.1, "instants": 240}
    commands = [pf.command(robot, motion, level, **rest) for level in ("rigid", "exact")]
    rigid, exact = (followed(robot, motion, found) for found in commands)
    assert rigid.during > 1e-3  # [m]: 3.4 mm
    assert exact.during < 1e-4 * rigid.during
    assert exact.swing < 1e-4 * rigid.swing
    found = commands[1]
    assert 50.0 < np.max(np.abs(found.torque)) < 120.0  # N m; what the URDF allows
    assert 5.0 < np.max(np.abs(found.velocity)) < 15.0  # rad/s
    assert max(found.actuation) < 0.01  # [s]: next to none, against 0.3 s
