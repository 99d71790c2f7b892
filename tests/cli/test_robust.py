"""What a command survives: signals, files that are none, full disks, slips of units, bombs.

Claims:
    Bad input, costs, signals
    - SIGTERM and SIGHUP save the run; checkpoints give the run that goes through; links followed,
      pipes refused; a full disk leaves the old file | - | 1e-6 in eta | 2e-7
    - steps, instants, segments, elements, merges and archives that cannot fit are refused before
      they are paid; mm for m; `limit` and `allow` lift it | - | exact | passes
    - dead loads without gravity: strip under 24 N of thrust | `pf.modes` | 1e-3 Hz | 2.5109
    - payload of 6e9 beams: first frequency | closed form | 1e-7 | 1e-9
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import DescriptionError
from pinflex.writing import replaced, write_text
from tests.cli.small import call, write_model
from tests.processes import wait_until_busy

ROOT = Path(__file__).resolve().parents[2]


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "pinflex", *arguments], text=True, stderr=subprocess.PIPE,
        stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(ROOT)},
        preexec_fn=heed_signals,
    )  # fmt: skip


def heed_signals() -> None:
    """Undo what a test run in the background (nohup, &) hands on: signals that are ignored."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_run_that_is_ended_by_a_signal_is_saved(tmp_path: Path, number: signal.Signals) -> None:
    run = tmp_path / "run.npz"
    # 2e5 steps, ten seconds: longer than the signal takes to come.
    with start("solve", "race_r2", "--set", "solve.dt=2e-6", "-o", str(run)) as process:
        wait_until_busy(process)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert "was saved" in said
    assert pf.Result.load(run).t[-1] > 0
    assert said.count("\n") == 1


def test_checkpoints_give_the_run_that_goes_through(tmp_path: Path, capsys) -> None:
    model = write_model(tmp_path, "arm")
    whole, parts = tmp_path / "whole.npz", tmp_path / "parts.npz"
    assert call(capsys, "solve", model, "-o", whole).code == 0
    assert call(capsys, "solve", model, "-o", parts, "--checkpoint", "0.05").code == 0
    a, b = pf.Result.load(whole), pf.Result.load(parts)
    # 1e-6 of the largest: going on starts Newton without the step before, and it stops at another
    # point within its tolerance
    largest = np.abs(a.arrays["eta"]).max()
    np.testing.assert_allclose(a.arrays["eta"], b.arrays["eta"], rtol=0, atol=1e-6 * largest)


def test_a_checkpoint_due_at_the_end_is_none(tmp_path: Path, capsys) -> None:
    """64 steps end where progress is told: there the run is done, and not to be resumed."""
    model, run = write_model(tmp_path, "arm"), tmp_path / "run.npz"
    words = ["--level", "coupled", "--dt", "1e-4", "--until", "0.0064", "--checkpoint", "1e-9"]
    assert call(capsys, "solve", model, *words, "-o", run).code == 0
    assert pf.Result.load(run).t[-1] == pytest.approx(0.0064)


def test_what_is_no_regular_file_is_not_replaced(tmp_path: Path, capsys) -> None:
    model = write_model(tmp_path, "arm")
    pipe, link, real = tmp_path / "pipe", tmp_path / "link.npz", tmp_path / "real.npz"
    os.mkfifo(pipe)
    real.write_text("old")
    link.symlink_to(real)
    answer = call(capsys, "solve", model, "--level", "rigid", "-o", pipe)
    assert (answer.code, "no regular file" in answer.err) == (2, True)
    assert call(capsys, "solve", model, "--level", "rigid", "-o", link).code == 0
    assert link.is_symlink() and pf.Result.load(real).level == "rigid"


def test_a_file_that_cannot_be_finished_leaves_the_old_one(tmp_path: Path) -> None:
    path = write_text(tmp_path / "page.html", "old")

    def full() -> None:
        with replaced(path) as part:
            part.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(DescriptionError, match="cannot be written"):
        full()
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_ked_structural_runs_on_an_open_chain() -> None:
    run = pf.solve(pf.load("cantilever"), level="ked", ked="structural", until=0.01, samples=5)
    assert np.isfinite(run.arrays["eta"]).all() and run.arrays["eta"].any()


def test_a_platform_of_one_freedom_is_mapped(capsys) -> None:
    assert call(capsys, "map", "spinning_beam", "--grid", "rz=0:.1:2").code == 0
    answer = call(capsys, "map", "spinning_beam", "--grid", "x=0:.1:2")
    assert answer.code in (1, 2) and "internal error" not in answer.err


def test_an_archive_larger_than_memory_is_not_read(tmp_path: Path) -> None:
    bomb = tmp_path / "run.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", bytes(3_000_000))
    with pytest.raises(DescriptionError, match="are read without asking"):
        pf.Result.load(bomb, most=1e6)


SLIPS = {
    "a section in mm": ("flexible.coupler.section.width=20", "Did you mean 0.02"),
    "a heavy beam": (
        "flexible.coupler={material: {E: 7e10, nu: 0.3, rho: 1e9}, "
        "section: {shape: circle, diameter: 0.1}}",
        "weighs",
    ),
    "an endless step": ("solve.dt=1e-12", "limit:"),
    "many instants": ("solve.samples=100000000", "limit:"),
    "many segments": ("flexible.coupler.segments=1000000000", "limit:"),
    "many elements": ("flexible.coupler.basis={kind: finite_element, elements: 200}", "limit:"),
    "absurd gravity": ("gravity=[0, 1e18, 0]", "out of range"),
    "a home of many turns": ("home.motor=1e15", "out of range"),
    "a device": ("motion={kind: sampled, file: /dev/zero}", "no regular file"),
}


@pytest.mark.parametrize("what", SLIPS)
def test_slips_and_costs_are_refused_before_they_are_paid(capsys, tmp_path: Path, what) -> None:
    change, words = SLIPS[what]
    model = write_model(tmp_path, "fourbar")
    answer = call(capsys, "solve", model, "--set", change)
    assert answer.code == 2 and words in answer.err and answer.err.count("\n") == 1


def test_a_key_lifts_what_is_refused(tmp_path: Path) -> None:
    model = write_model(tmp_path, "fourbar")
    wide = ["flexible.coupler.section.width=0.5"]
    with pytest.raises(DescriptionError, match=r"allow: \[wide\]"):
        pf.load(model, wide)
    assert pf.load(model, [*wide, "allow=[wide]"]).parts


def test_merges_that_multiply_or_disagree_are_refused(tmp_path: Path) -> None:
    lines = ["a0: &a0 {x: 1}"]
    lines += [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}" for i in range(1, 20)]
    for text, words in (("\n".join(lines), "values"), ("<<: {a: 1}\n<<: {a: 2}", "<<: \\[")):
        (tmp_path / "bad.yaml").write_text(text)
        with pytest.raises(DescriptionError, match=words):
            pf.load(tmp_path / "bad.yaml")


def test_loads_without_gravity_count_in_every_frequency() -> None:
    """24 N of thrust at the tip of a strip that buckles at 28 N: 2.511 Hz, not 6.684."""
    from pinflex.studies.checking.check import first_frequencies

    thrust = ["gravity=[0,0,0]", "forces={push: {at: tip, force: [-24, 0, 0]}}"]
    robot = pf.load("cantilever", thrust)
    assert first_frequencies(robot, 1)[0][0] == pytest.approx(2.511, abs=1e-3)


def test_a_payload_of_a_thousand_million_beams_has_its_frequency() -> None:
    """omega^2 = 3 E I / (L^3 m): the inverse problem keeps what the direct one rounds to zero."""
    robot = pf.load("cantilever", ["gravity=[0,0,0]", "flexible.*.tip={mass: 1.0e9}"])
    part = robot.parts["beam"]
    stiffness = 3 * part.spec.material.E * part.spec.section.Iz / part.length**3
    expected = np.sqrt(stiffness / (1e9 + 33 / 140 * part.mass)) / (2 * np.pi)
    # 1e-7: the beam's own mass and round-off of 1e-16 over sqrt of 1e13
    assert pf.modes(robot, preload="none").frequencies[0] == pytest.approx(expected, rel=1e-7)


def test_a_table_has_the_angle_of_a_continuous_joint(tmp_path: Path) -> None:
    run = pf.solve(pf.load("spinning_beam"), level="rigid", samples=41)
    head = run.to_csv(tmp_path / "run.csv").read_text().splitlines()[0]
    assert "position hub [rad]" in head and "hub[0]" not in head
    assert run.unit("joint/q/hub") == "cos, sin"
    # 6 rad/s reached along u - sin(2 pi u)/(2 pi) in 15 s, then 5 s: 45 + 30 rad
    assert run.joint("hub").angle[-1] == pytest.approx(75.0, rel=1e-9)


def test_steps_that_round_off_eats_are_told() -> None:
    short = pf.solve(pf.load("race_r1"), dt=1e-9, until=1e-7, samples=3)
    assert any("round-off" in text for text in short.meta["warnings"])
