"""`pinflex command`: what it prints and writes."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from tests.cli.small import call, write_model
from tests.pages import inflated


@pytest.fixture(scope="module")
def fourbar(tmp_path_factory) -> str:
    return write_model(tmp_path_factory.mktemp("fourbar"), "fourbar")


def test_a_command_is_written_and_held_against_a_forward_run(capsys, fourbar, tmp_path):
    file = tmp_path / "command.csv"
    nonic = "motion.kind=nonic"
    figure, page = tmp_path / "command.png", tmp_path / "command.html"
    shown = ("--plot", figure, "--view", page)
    done = call(
        capsys, "command", fourbar, "--set", nonic, "--verify", "--json", "-o", file, *shown
    )
    assert done.code == 0
    found = json.loads(done.out)
    assert [path.rpartition(".")[2] for path in found["files"]] == ["csv", "png", "html"]
    assert figure.stat().st_size > 2e4
    packed = re.search(r'id="pinflex-data">([^<]+)', page.read_text("utf-8"))
    assert packed is not None
    data = inflated(packed[1])
    assert data.count(b" off path") == 2  # a plot of each run
    exact, rigid = found["followed"]["exact"], found["followed"]["rigid"]
    assert exact["during"] < 1e-2 * rigid["during"]  # of 66 nm
    table = np.genfromtxt(file, delimiter=",", names=True)
    assert table.dtype.names[:2] == ("t_s", "motorposition_rad")
    assert table["t_s"][-1] == pytest.approx(found["duration"])
    assert np.abs(table["motortorque_N_m"]).max() == pytest.approx(
        found["motors"]["motor"]["torque"]
    )


def test_the_table_of_a_forward_run_names_the_coordinates_that_it_is_about(capsys, fourbar):
    """One motor can hold one coordinate: the others stray without being told, and so do turns."""
    done = call(capsys, "command", fourbar, "--set", "motion.kind=nonic", "--verify")
    assert done.code == 0
    (held,) = re.findall(r"Platform off its path in (\S+) in a coupled run", done.out)
    assert f"Estimated error of the platform: {held} " in done.out
    assert "turn during" not in done.out


def test_a_figure_without_a_forward_run_is_refused(capsys, fourbar):
    done = call(capsys, "command", fourbar, "--plot", "command.png")
    assert done.code == 2
    assert "Add --verify" in done.err


def test_the_text_says_time_error_and_torque(capsys, fourbar):
    done = call(capsys, "command", fourbar, "--level", "quasistatic")
    assert done.code == 0
    assert "fourbar: the quasistatic command takes" in done.out
    assert "Estimated error of the platform" in done.out
    assert "nothing saved" in done.out


def test_a_jerky_motion_and_a_weak_motor_are_refused(capsys, fourbar):
    jerky = "motion={kind: trapezoid, joints: {motor: 0.5}, duration: 0.1, ramp: 0.03}"
    done = call(capsys, "command", fourbar, "--set", jerky)
    assert done.code == 1
    assert "acceleration of motor jumps in a trapezoid motion" in done.err
