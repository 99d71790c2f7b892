"""Springs between frames that meet: of no length they pull by k d in every direction.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a spring of no length whose ends meet: frequency sqrt(K/M); energy of a pendulum that falls
      into it, alpha at 1 ms, tol 1e-6 | closed form; conservation | 1e-8; 1e-4 and 1e-7 J of 0.1 J
      | passes
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.studies.checking.check import check
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


def test_what_springs_alone_hold_sags_and_vibrates_in_check_and_modes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No motor, no link that bends, no spring in a joint: as a platform hung on cables."""
    still = scenes.load(tmp_path, ARM, YAML % "" + "gravity: [0, 0, 0]\n")
    assert check(still).frequencies[0] == pytest.approx(math.sqrt(K / M) / 2 / math.pi, rel=1e-8)
    assert main(["modes", str(tmp_path / "scene.yaml")]) == 0
    assert "5.812" in capsys.readouterr().out  # sqrt(K/M) / 2 pi
    hung = check(scenes.load(tmp_path, ARM, YAML % "" + "platform: tip\n")).statics.full
    assert hung is not None  # K L^2 sin q = M g L cos q
    fall = -L * math.sin(math.atan(M * 9.81 / (K * L)))
    assert hung.position[2] == pytest.approx(fall, rel=1e-9)  # in balance to 1e-11


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


def test_the_ground_is_an_end_as_a_frame_of_the_base_is(tmp_path: Path) -> None:
    """A spring with damper to a point of the ground, and to a massless frame there."""
    law = "stiffness: 800, damper: 5, length: 0.3"
    at = [L + 0.2, 0.1, 0.3]
    bodies = [*ARM[:2], Body("nail", "base", xyz=at)]
    runs = []
    for k, between in enumerate((f"[tip, world], at: {at}", "[nail, tip]")):
        (folder := tmp_path / str(k)).mkdir()
        yaml = (
            f"actuated: []\nsprings: {{s: {{between: {between}, {law}}}}}\nsolve: {{until: 0.4}}\n"
        )
        robot = scenes.load(folder, bodies, yaml)
        runs.append(pf.solve(robot, level="coupled", dt=1e-3, start="straight"))
    one, other = (run.joint("arm_joint").angle for run in runs)
    assert np.ptp(one) > 0.05
    assert np.max(np.abs(one - other)) < 1e-12  # the same sums, with the ends exchanged


@pytest.mark.parametrize(
    ("between", "words"),
    [
        ("[tip, world]", r"springs.s.at: the point of the ground .* Give it"),
        ("[tip, nail], at: [0, 0, 0]", r"springs.s.at: .* Neither end is world: remove it"),
        ("[world, world], at: [0, 0, 0]", "cannot be held to itself"),
    ],
)
def test_the_point_of_the_ground_is_asked_for(tmp_path: Path, between: str, words: str) -> None:
    with pytest.raises(pf.DescriptionError, match=words):
        scenes.load(
            tmp_path, ARM, f"actuated: []\nsprings: {{s: {{between: {between}, stiffness: 1}}}}\n"
        )


def test_a_run_knows_a_universal_joint_by_its_name(tmp_path: Path) -> None:
    bodies = (ARM[0], Body("hand", "arm", xyz=(L, 0, 0), mass=0.5, inertia=(0.01, 0.02, 0.015)))
    yaml = "actuated: []\njoints: {hand_joint: {type: universal}}\nhome: {hand_joint: [0.1, 0.2]}\n"
    run = pf.solve(scenes.load(tmp_path, bodies, yaml + "solve: {until: 0.1}\n"), dt=1e-3)
    whole, parts = run.joint("hand_joint"), [run.joint(f"hand_joint.{k}") for k in (1, 2)]
    assert whole.position.shape == (len(run.t), 2)
    assert np.array_equal(whole.position, np.stack([p.position for p in parts], 1))
    assert np.array_equal(whole.velocity[:, 1], parts[1].velocity)
    assert np.array_equal(whole.reaction, parts[1].reaction)  # on the link it carries
    with pytest.raises(pf.DescriptionError, match="no one angle"):
        _ = whole.angle
