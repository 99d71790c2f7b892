"""`pinflex frf`: a beam on a hub in closed form, zeros, and measured responses.

Claims:
    Commands: motions that the platform follows
    - frequency response of a beam on a hub; its zero in the right half plane | closed form
      (Euler-Bernoulli) | 2e-3 beside poles, 1e-6; 1e-3 | passes
    - zeros of a force across a strip that bends both ways: none of the other plane | clamped,
      pinned beam | 2e-3; 2e-2 (four functions) | passes
    - coherence of a noisy record; a response written and read back | powers of signal and noise |
      0.03 | passes
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
from scipy.optimize import brentq

import pinflex as pf
from pinflex.studies.frequency_response import frequency_response, slowest_right
from tests.cli.small import call
from tests.inversion.test_command import hub_torque_by_tip_acceleration

HUB = 0.1  # [kg m^2]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> pf.Mechanism:
    """A plane beam of L = rho A = E I = 1 on a hub, without damping."""
    bodies = [
        scenes.Body("beam", "base", "revolute", mass=1.0, com=(0.5, 0, 0), inertia=(1e-3,) * 3),
        scenes.Body("tip", "beam", xyz=(1, 0, 0)),
    ]
    yaml = f"gravity: [0, 0, 0]\nplatform: tip\njoints: {{beam_joint: {{rotor_inertia: {HUB}}}}}\n"
    yaml += "flexible:" + scenes.UNIT_BEAM + "    basis: {kind: craig_bampton, internal: 6}\n"
    folder = tmp_path_factory.mktemp("arm")
    return scenes.load(folder, bodies, yaml + "    inertia: beam\n")


def test_the_response_of_a_beam_on_a_hub_is_that_of_the_closed_form(arm: pf.Mechanism) -> None:
    study = frequency_response(arm, outputs=["tip.y.acceleration"], span=(0.05, 5.0))
    expected = np.array(
        [
            1.0 / hub_torque_by_tip_acceleration(2 * np.pi * f, 1.0, 1.0, 1.0, HUB)
            for f in study.frequencies
        ]
    )
    # two modes below 5 Hz; off their poles by a millionth of the frequency
    away = np.min(np.abs(study.frequencies[:, None] / study.natural[:4] - 1.0), axis=1) > 1e-3
    error = np.abs(study.response[:, 0] / expected - 1.0)[away]
    assert np.max(error) < 2e-3  # the closest points, where the pole's 1e-6 counts a thousandfold
    assert np.median(error) < 1e-6


def test_zeros_say_what_feedback_can_do(arm: pf.Mechanism) -> None:
    study = frequency_response(arm)
    assert study.outputs == ("beam_joint [rad]", "tip.y [m]")
    assert study.collocated == (True, False)
    hub, tip = (slowest_right(z, study.natural[0]) for z in study.zeros)
    assert hub is None
    assert tip is not None

    def by_torque(s: float) -> float:  # tip acceleration of a torque that grows as exp(s t)
        return float((1.0 / hub_torque_by_tip_acceleration(1j * s, 1.0, 1.0, 1.0, HUB)).real)

    exact = brentq(by_torque, 0.8 * 2 * np.pi * tip, 1.2 * 2 * np.pi * tip)
    assert tip == pytest.approx(exact / (2 * np.pi), rel=1e-3)  # eight shapes for the beam
    platform = study.platform_zeros
    assert platform is not None
    assert slowest_right(platform, study.natural[0]) == pytest.approx(tip, rel=1e-3)


def test_a_response_written_and_read_back_agrees(arm: pf.Mechanism, capsys, tmp_path: Path) -> None:
    file, model = tmp_path / "frf.csv", str(arm.description.path)
    done = call(capsys, "frf", model, "-o", file, "--from", "0.1", "--to", "5")
    assert done.code == 0
    assert "beam_joint" in done.out
    assert "no: from" in done.out
    figure = tmp_path / "frf.png"
    done = call(capsys, "frf", model, "-o", figure, "--measured", file, "--json")
    assert done.code == 0
    data = json.loads(done.out)
    assert data["measured"]["tip.y"]["agreement"] == pytest.approx(1.0, abs=1e-9)
    assert data["outputs"]["beam_joint [rad]"]["right_half_plane"] is None
    assert figure.stat().st_size > 1e4


def test_a_noisy_record_gives_its_response_and_coherence(tmp_path: Path) -> None:
    """A record of the linear model itself, with noise of known power at the output."""
    from scipy.signal import lsim

    robot, rng, dt, n = pf.load("race_r2"), np.random.default_rng(1), 1e-3, 30000
    given = {"motors": "acceleration", "outputs": ["platform.z.acceleration"]}
    model = pf.linearise(robot, forces=["platform.z"], modes=4, **given)
    u = np.zeros((n, 4))
    u[:, 3] = rng.normal(size=n)  # [N], white up to the rate of the record
    t = dt * np.arange(n)
    _, y, _ = lsim(model.to_scipy(), u, t, interp=False)
    loud = 0.3 * float(np.std(y))
    noisy = np.asarray(y).ravel() + loud * rng.normal(size=n)
    table = np.column_stack([t, u[:, 3], noisy])
    file = tmp_path / "record.csv"
    np.savetxt(file, table, delimiter=",", header="t,platform.z,platform.z.acceleration",
               comments="")  # fmt: skip
    study = frequency_response(robot, source="platform.z", measured=file, **given)
    one = study.measured[0]
    assert one.coherence is not None
    # coherence = |H|^2 / (|H|^2 + noise / input): spectra are flat, so powers are variances
    size = np.abs(model.response(one.frequencies)[:, 0, 3]) ** 2
    expected = size / (size + loud**2)
    band = (one.frequencies > 20.0) & (one.frequencies < 100.0)
    # eight segments, half overlapped: a standard deviation of about 0.1 each, 0.01 of the mean
    assert np.mean(one.coherence[band]) == pytest.approx(np.mean(expected[band]), abs=0.03)
    assert one.agreement > 0.7


def test_unknown_inputs_and_files_are_refused(arm: pf.Mechanism, tmp_path: Path) -> None:
    with pytest.raises(pf.DescriptionError, match="input: hub: no motor"):
        frequency_response(arm, source="hub")
    with pytest.raises(pf.DescriptionError, match="Give an increasing range"):
        frequency_response(arm, span=(5.0, 1.0))
    file = tmp_path / "odd.csv"
    file.write_text("f,x\n1,2\n")
    with pytest.raises(pf.DescriptionError, match="columns f, x. Give frequency"):
        frequency_response(arm, measured=file)
    file.write_text("frequency,tip.x.magnitude,tip.x.phase\n1,2,3\n")
    with pytest.raises(pf.DescriptionError, match="none of the outputs"):
        frequency_response(arm, measured=file)


def sagging(folder: Path, elbow: float, gravity: float, rho: float = 1e-3) -> pf.Mechanism:
    """A light round beam that a motor turns about a vertical axis, a weight on a free elbow."""
    bodies = [
        scenes.Body("crank", "base", "revolute"),
        scenes.Body("elbow", "crank", xyz=(REACH, 0, 0)),
        scenes.Body("arm", "crank", "revolute", xyz=(REACH, 0, 0), mass=1.0, com=(ARM, 0, 0),
                    inertia=(1e-9,) * 3),
    ]  # fmt: skip
    yaml = f"""
actuated: [crank_joint]
gravity: [0, 0, {-gravity}]
home: {{crank_joint: 0.4, arm_joint: {elbow}}}
frames: [elbow]
flexible:
  crank:
    material: {{E: 2.0e+11, nu: 0.3, rho: {rho}}}
    section: {{shape: circle, diameter: 0.02}}
    end: elbow
    bending_y: true
    bending_z: true
    torsion: true
"""
    return scenes.load(folder, bodies, yaml)


REACH, ARM = 0.3, 0.2  # [m]


@pytest.mark.parametrize("elbow", [0.0, np.pi])
def test_a_free_joint_feels_how_the_sag_changes_with_the_pose(tmp_path: Path, elbow: float) -> None:
    """A zero of 0.01 Hz that looks like round-off is that of the weight, held by the sag.

    F = m g at the arm's end bends the crank by F (a - x) + F b cos(elbow) and twists it by
    F b sin(elbow), so V = -U with U the energy of both, and omega^2 = V'' / (m b^2).
    """
    I = np.pi * 0.02**4 / 64  # noqa: E741
    EI, GJ, F = 2e11 * I, 2e11 / 2.6 * 2 * I, 9.81
    stretched = 0.5 * F**2 * REACH**2 * ARM * np.cos(elbow) / EI
    exact = (stretched - F**2 * ARM**2 * REACH * (1 / GJ - 1 / EI)) / ARM**2
    study = frequency_response(sagging(tmp_path, elbow, 9.81), outputs=["crank_joint"])
    zeros = study.zeros[0][np.argsort(np.abs(study.zeros[0]))][:2]
    # zeros s with s^2 = -omega^2, on the real axis where V'' < 0. The closed form holds to 1e-6:
    # slopes of the sag, 1e-4, count as squares. In plain units QZ erred by 1e-3 to 1e-1.
    np.testing.assert_allclose((zeros**2).real, -exact, rtol=1e-5)
    (plain,) = frequency_response(sagging(tmp_path, elbow, 0.0), outputs=["crank_joint"]).zeros
    assert np.sort(np.abs(plain))[1] < 1e-3 * np.sqrt(abs(exact))


@pytest.mark.parametrize("output", ["crank_joint", "crank_joint.velocity"])
def test_zeros_do_not_hang_on_the_units_of_inputs_and_outputs(tmp_path: Path, output: str) -> None:
    """Those of the crank held, 0.1 to 1e8 /s, none of them damped."""
    model = pf.linearise(sagging(tmp_path, 0.0, 9.81), outputs=[output])
    zeros = model.zeros()
    assert np.max(np.abs(zeros.real)) < 1e-9 * np.max(np.abs(zeros))
    for of_input, of_output in ((3e-12, 1.0), (1.0, 1.7e5), (3e9, 1e9)):
        other = replace(model, B=of_input * model.B, C=of_output * model.C).zeros()
        np.testing.assert_allclose(np.abs(other), np.abs(zeros), rtol=1e-5, atol=1e-6)


def test_slow_zeros_are_said_to_be_those_of_free_joints(tmp_path: Path, capsys) -> None:
    sagging(tmp_path, 0.0, 9.81, 7850.0)
    scene = str(tmp_path / "scene.yaml")
    for more, said in ((), True), (("--set", "gravity=[0, 0, 0]"), False):
        done = call(capsys, "frf", scene, "--outputs", "crank_joint", *more)
        assert done.code == 0
        assert ("joints that are free to move" in done.out.replace("\n", " ")) == said
        assert ("e-0" in done.out.split("Zeros\n")[1].split("nothing")[0]) is False


def test_modes_that_an_input_does_not_move_are_no_zeros() -> None:
    """Of a strip that bends both ways, a force across it sees those of a clamped, pinned beam."""
    strip = pf.load("cantilever", ["flexible.beam.bending_z=true", "gravity=[0, 0, 0]"])
    study = pf.frequency_response(strip, source="tip.z")
    assert np.any(np.abs(study.natural / 66.83 - 1.0) < 1e-3)  # along the width, ten times as high
    zeros = np.sort(np.unique(np.round(np.abs(study.zeros[0]) / (2.0 * np.pi), 6)))
    clamped, pinned = 1.87510407, np.array([3.92660231, 7.06858275])  # of a beam's wave number
    wanted = study.natural[0] * (pinned / clamped) ** 2
    # a basis of four functions: 1e-3 and 1.3e-2, as its second and third frequencies
    np.testing.assert_allclose(zeros[:1], wanted[:1], rtol=2e-3)
    np.testing.assert_allclose(zeros[1:2], wanted[1:], rtol=2e-2)


def test_an_input_that_moves_nothing_is_refused_with_one_that_does() -> None:
    with pytest.raises(pf.DescriptionError, match=r"tip\.y moves nothing of tip\.y.*: tip\.z\."):
        pf.frequency_response("cantilever", source="tip.y")
    with pytest.raises(pf.DescriptionError, match=r"no motor to take.*: tip\.z\."):
        pf.frequency_response("cantilever")
