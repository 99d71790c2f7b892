"""A payload: torques by hand, the same body as a link of the URDF, tip masses, sums of masses.

Claims:
    Machines
    - payload: holding torques of a UR10; a link of the URDF; a mass at a tip; one that the model
      lost is noticed | bare Pinocchio; the URDF's parser; cos cosh equation | printed digits; 1e-9;
      1e-5 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.__main__ import build_parser, main
from pinflex.mechanics.model import tree
from tests.benchmarks.masses import modelled, off_scene
from tests.scenes import load
from tests.verification.test_added_masses import ARM, YAML, first_frequency

CARRIED = "payload={at: tool0, mass: 5, centre: [0.1, -0.05, 0.2], inertia: [0.1, 0.2, 0.25]}"
ROUNDING = 1e-12  # sums of some inertias


def test_holding_torques_of_a_ur10_with_five_kilograms(tmp_path: Path) -> None:
    pytest.importorskip("example_robot_data")
    arms = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    names = [f"{arm}_joint" for arm in arms]
    scene = tmp_path / "ur10.yaml"
    pose = zip(names[1:5], (-1.2, 1.6, -1.9, -1.57), strict=True)
    home = "".join(f"  {name}: {angle}\n" for name, angle in pose)
    scene.write_text(
        f"urdf: example-robot-data:ur10\nactuated: [{', '.join(names)}]\nhome:\n{home}"
        "platform: tool0\npayload: {at: tool0, mass: 5}\n"
    )
    run = pf.solve(pf.load(scene), pf.hold(duration=0.1), level="rigid", samples=2)
    torque = dict(zip(run.motors, run.torque[0], strict=True))
    # A bare Pinocchio model by another hand; half of the last digit that it printed.
    assert torque["shoulder_lift_joint"] == pytest.approx(-105.07, abs=0.005)
    assert torque["elbow_joint"] == pytest.approx(-62.7, abs=0.05)
    assert torque["wrist_1_joint"] == pytest.approx(-5.57, abs=0.005)


def test_a_payload_is_the_same_as_a_link_of_the_urdf(tmp_path: Path) -> None:
    robot = pf.load("ur5")
    urdf = tmp_path / "loaded.urdf"
    body = (
        '<link name="box"><inertial><origin xyz="0.1 -0.05 0.2"/><mass value="5"/>'
        '<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="glue" type="fixed"><parent link="tool0"/><child link="box"/></joint></robot>'
    )
    urdf.write_text(robot.description.urdf_text.replace("</robot>", body))
    other = pf.load("ur5", [f"urdf={urdf}"])
    mine = robot.with_(CARRIED)
    options = {"level": "coupled", "tol": 1e-3, "samples": 21}
    a, b = pf.solve(mine, **options), pf.solve(other, **options)
    # The same numbers in the same order but for the parser's; two marches of one model.
    scale = np.abs(b.torque).max(axis=0)
    assert np.abs(a.torque - b.torque).max(axis=0) == pytest.approx(
        0 * scale, abs=1e-9 * scale.max()
    )
    assert off_scene(mine) < ROUNDING
    assert np.abs(modelled(mine) - modelled(other)).max() < 1e-12 * modelled(mine).max()
    assert np.abs(a.torque - pf.solve(robot, **options).torque).max() > 0.1 * scale.max()


def test_a_payload_at_the_tip_of_a_beam_lowers_its_first_mode(tmp_path: Path) -> None:
    m = load(tmp_path, ARM, YAML, ["payload={at: tip, mass: 1.2}"])
    # Three internal modes: 1e-6 of the first frequency; two directions of a square section.
    expected = [first_frequency(1.2)] * 2
    assert pf.modes(m).frequencies[:2] == pytest.approx(expected, rel=1e-5)


def test_a_payload_that_the_model_lost_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tree, "_carry", lambda model, payload: model.addFrame(_massless(model)))
    with pytest.raises(pf.AssemblyError, match="does not weigh what the scene says"):
        pf.load("ur5", ["payload.at=tool0", "payload.mass=0.001"])


def _massless(model: pin.Model) -> pin.Frame:
    return pin.Frame("nothing", 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)


def test_a_payload_of_nothing_leaves_the_model_as_it_is() -> None:
    robot = pf.load("ur5", ["payload.at=tool0", "payload.mass=0"])
    assert robot.description.payload is None and "payload" not in robot.links


@pytest.mark.parametrize(
    "block, words",
    [
        ("{at: tol0, mass: 5}", r'payload\.at: no such link .*"tol0"\. Did you mean "tool0"'),
        ("{at: tool0}", r"payload\.mass"),
        ("{at: tool0, mass: -1}", r"payload\.mass: -1"),
        ("{at: tool0, mass: 1, inertia: [1, 2]}", r"payload\.inertia: .*xx, yy, zz, xy"),
        ("{at: tool0, mass: 1, inertia: [1, 1, 1, 2, 0, 0]}", "principal moments are -1"),
        ("{at: tool0, mass: 0, centre: [1, 0, 0]}", "no mass has a centre"),
    ],
)
def test_what_is_no_payload_is_told(block: str, words: str) -> None:
    with pytest.raises(pf.DescriptionError, match=words):
        pf.load("ur5", [f"payload={block}"])


def test_a_command_takes_a_payload(capsys: pytest.CaptureFixture[str]) -> None:
    args = build_parser().parse_args(["check", "ur5", "--set", "a=1", "--payload", "500 g@tool0"])
    assert args.set == ["a=1", "payload.at=tool0", "payload.mass=0.5"]
    assert main(["check", "ur5", "--payload", "5kg@tool0"]) == 0
    assert "  payload   5 kg at tool0\n" in capsys.readouterr().out
    assert main(["check", "ur5", "--payload", "kg@tool0"]) == 2
    assert "is not of the form MASS@FRAME" in capsys.readouterr().err
