"""Springs between frames that meet: of no length they pull by k d in every direction."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests import scenes
from tests.scenes import Body

L, M, K = 0.8, 1.5, 2000.0  # length of the pendulum, the mass at its end, stiffness
ARM = [
    Body("arm", "base", "revolute", axis=(0, 1, 0), mass=M, com=(L, 0, 0)),
    Body("tip", "arm", xyz=(L, 0, 0)),
    Body("nail", "base", xyz=(L, 0, 0)),
]
YAML = """
actuated: []
home: {arm_joint: 0}
springs: {s: {between: [tip, nail], stiffness: 2000%s}}
solve: {until: 0.3}
"""


def test_the_frequency_is_that_of_a_spring_across_the_arm(tmp_path: Path) -> None:
    # Without gravity: M L^2 q'' = -K L^2 q, whatever the axis of the pendulum does to the line.
    robot = scenes.load(tmp_path, ARM, YAML % "" + "gravity: [0, 0, 0]\n")
    f = pf.modes(robot).frequencies[0]
    assert f == pytest.approx(math.sqrt(K / M) / 2 / math.pi, rel=1e-8)  # inertia of the body: none


@pytest.mark.parametrize("options", [{"dt": 1e-3}, {"tol": 1e-6}], ids=["alpha", "tol"])
def test_a_pendulum_falls_into_its_spring_and_keeps_its_energy(
    tmp_path: Path, options: dict[str, float]
) -> None:
    robot = scenes.load(tmp_path, ARM, YAML % "")
    run = pf.solve(robot, level="coupled", start="straight", **options)
    q = run.joint("arm_joint").position
    # m g L sin q + k/2 |d|^2 with |d| = 2 L sin(q/2); turning about +y lowers the tip.
    v = run.joint("arm_joint").velocity
    energy = (
        0.5 * M * L**2 * v**2 - M * 9.81 * L * np.sin(q) + 0.5 * K * (2 * L * np.sin(q / 2)) ** 2
    )
    assert np.max(q) > 0.014  # twice the sag of m g / k L = 9.2 mrad
    # of the m g L q that falls, 0.1 J: second order of the step, or the tolerance
    assert np.max(np.abs(energy)) < (1e-3 if "dt" in options else 1e-6) * 0.1


@pytest.mark.parametrize("key", ["length: 0.1", "damper: 3"])
def test_a_line_without_direction_is_refused(tmp_path: Path, key: str) -> None:
    with pytest.raises(pf.AssemblyError, match=f"springs.s: .* meet .* so its {key.split(':')[0]}"):
        scenes.load(tmp_path, ARM, YAML % f", {key}")
