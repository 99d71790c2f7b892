"""`pinflex frf`: a beam on a hub in closed form, zeros, and measured responses."""

from __future__ import annotations

import json
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
    assert study.outputs == ("beam_joint [rad | m]", "tip.y [m]")
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
    assert data["outputs"]["beam_joint [rad | m]"]["right_half_plane"] is None
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
