"""Linear models against modes, statics, a small coupled run and closed forms.

Claims:
    Commands: motions that the platform follows
    - linear model: poles = modes; static gain = compliance however few modes; zeros = clamped beam
      | modes, statics, closed form | 1e-7; 1e-6; 1e-4 | passes
    - linear model: small quick motion = coupled run; python-control has the same response | coupled
      level; python-control | 1e-4; 1e-9 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scenes

import pinflex as pf


@pytest.fixture(scope="module")
def robot() -> pf.Mechanism:
    return pf.load("race_r2")


def test_poles_of_the_undamped_model_are_the_modes() -> None:
    robot = pf.load("race_r2", ["damping=null"])
    model = pf.linearise(robot, motors="acceleration")
    poles = np.sort(np.abs(model.poles.imag))[6::2] / (2 * np.pi)  # after three motors at rest
    expected = pf.modes(robot, count=8).frequencies
    np.testing.assert_allclose(poles[:8], expected, rtol=1e-7)  # eig of a matrix twice as large


def test_the_static_gain_is_the_compliance_however_many_modes_are_kept(robot: pf.Mechanism) -> None:
    outputs = [f"platform.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")]
    expected = pf.platform_compliance(robot)
    for count in (None, 3):
        model = pf.linearise(
            robot, motors="acceleration", forces=outputs, outputs=outputs, modes=count
        )
        gain = model.response(1e-4)[0][:, 3:].real  # three motors come first
        np.testing.assert_allclose(gain, expected, atol=1e-6 * np.abs(expected).max())


def test_a_small_coupled_run_is_the_step_response(robot: pf.Mechanism) -> None:
    """A quick small motor motion: linear model and coupled level."""
    from scipy.signal import lsim

    size = 1e-5
    motion = pf.quintic(joints={"motor_1": size}, duration=0.05)
    run = pf.solve(robot, motion, level="coupled", tol=1e-5, start="static", until=0.2)
    model = pf.linearise(robot, motors="acceleration", outputs=["platform.z", "platform.x"])
    fine = np.linspace(0.0, 0.2, 4001)
    u = np.zeros((len(fine), 3))
    u[:, 0] = motion.evaluate(fine)[2][:, 0]
    _, out, _ = lsim(model.to_scipy(), u, fine)
    frame = run.array("frame/platform/position")
    for column, axis in enumerate((2, 0)):
        moved = frame[:, axis] - frame[0, axis]
        linear = np.interp(run.t, fine, out[:, column])
        assert np.max(np.abs(moved - linear)) < 1e-4 * np.max(np.abs(moved)) + 1e-12


def test_zeros_from_hub_torque_to_hub_angle_are_the_clamped_beam(tmp_path: Path) -> None:
    """Collocated feedback: holding the hub leaves the cantilever's frequencies (minimum phase)."""
    bodies = [
        scenes.Body("beam", "base", "revolute", mass=1.0, com=(0.5, 0, 0), inertia=(1e-3,) * 3),
        scenes.Body("tip", "beam", xyz=(1, 0, 0)),
    ]
    yaml = "gravity: [0, 0, 0]\nplatform: tip\nflexible:" + scenes.UNIT_BEAM
    yaml += "    basis: {kind: craig_bampton, internal: 6}\n"
    robot = scenes.load(tmp_path, bodies, yaml, ["joints={beam_joint: {rotor_inertia: 0.1}}"])
    collocated = pf.linearise(robot, outputs=["beam_joint"])
    found = np.unique(np.round(np.abs(collocated.zeros().imag), 3))
    expected = np.array([1.8751040687, 4.6940911330]) ** 2  # cos x cosh x = -1
    np.testing.assert_allclose(found[:2], expected, rtol=1e-4)  # rounded to 1e-3 to merge pairs
    tip = pf.linearise(robot, outputs=["tip.y"]).zeros()
    assert np.max(tip.real) > 1.0  # not collocated: a zero in the right half plane


def test_python_control_gets_the_same_model(robot: pf.Mechanism) -> None:
    control = pytest.importorskip("control")
    model = pf.linearise(robot, modes=4)
    other = model.to_control()
    assert isinstance(other, control.StateSpace)
    w = 2 * np.pi * 7.0
    np.testing.assert_allclose(other(1j * w), model.response(7.0)[0], rtol=1e-9)


def test_unknown_names_are_refused(robot: pf.Mechanism) -> None:
    with pytest.raises(pf.DescriptionError, match="motors: torqe.*torque"):
        pf.linearise(robot, motors="torqe")
    with pytest.raises(pf.DescriptionError, match="one of the axes"):
        pf.linearise(robot, outputs=["platform.q"])
