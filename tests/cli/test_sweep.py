"""`pinflex sweep` and `pinflex map`: files, failures, a kill and a restart, Ctrl-C, a cluster.

Claims:
    Many cases
    - a sweep's row = the run with the same overrides | `solve` | 0 | 0
    - SIGKILL after 5 of 16 cases, same command again: 16 lines, none lost or repeated | - | exact |
      exact
    - Ctrl-C: what is done is in journal and table, exit code 130 | - | exact | exact
    - a case that fails, or kills its process, costs its own row | - | exact | exact | also
      `unit/studies/test_batch.py`
    - csv = parquet; a Dask cluster gives the same table | - | exact | exact
"""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.cli.small import call, write_model

ROOT = Path(__file__).resolve().parents[2]
THICKNESS = "flexible.*.section.thickness"


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_model(tmp_path_factory.mktemp("arm"), "arm")


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_sweep_has_a_row_for_each_case_with_the_numbers_of_its_run(arm, tmp_path, capsys):
    out = tmp_path / "new" / "sweep.csv"
    done = call(
        capsys, "sweep", arm, "--set", f"{THICKNESS}=3e-3:5e-3:2", "--set",
        "motion.duration=0.2,0.3", "--level", "quasistatic", "--jobs", 1, "--out", out,
    )  # fmt: skip
    assert (done.code, done.err) == (0, "")
    assert "4 cases, 4 done, 0 failed" in done.out and f"wrote {out}" in done.out
    assert len(done.out.splitlines()) < 25 and "stress.peak goes from" in done.out
    assert [path.name for path in out.parent.iterdir()] == ["sweep.csv"]  # the journal is gone
    table = rows(out)
    cases = [(r[THICKNESS], r["motion.duration"]) for r in table]
    assert cases == [("0.003", "0.2"), ("0.003", "0.3"), ("0.005", "0.2"), ("0.005", "0.3")]
    robot = pf.load(arm, ["flexible.upper.section.thickness=5e-3", "motion.duration=0.2"])
    run, rigid = (pf.solve(robot, level=level) for level in ("quasistatic", "rigid"))
    row = {name: float(value) for name, value in table[2].items() if "[" in name}
    # the same run: to the last digit
    torque = run.joint("shoulder").torque
    assert row["torque.peak.shoulder [N m]"] == np.abs(torque).max()
    assert row["torque.rms.shoulder [N m]"] == np.sqrt(np.mean(torque**2))
    stress = run.link("upper").von_mises
    assert row["stress.peak [Pa]"] == stress.max()
    when, where = np.unravel_index(int(np.argmax(stress)), stress.shape)
    assert (row["stress.t [s]"], row["stress.x [m]"]) == (run.t[when], run.link("upper").x[where])
    away = run.deviation_from(rigid).norm.max()
    assert row["deviation.position [m]"] == away
    assert row["frequency.1 [Hz]"] == pytest.approx(pf.modes(robot, count=1).frequencies[0])
    assert table[2]["stress.link"] == "upper" and table[2]["validity.within_theory"] == "1.0"


def test_csv_and_parquet_say_the_same(arm, tmp_path, capsys):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pinflex[sweep]")
    options = ["--set", f"{THICKNESS}=-1,4e-3", "--level", "quasistatic", "--jobs", 1]
    for kind in ("csv", "parquet"):
        journal = tmp_path / "journal"  # one journal for both: the seconds are the same
        if journal.exists():
            journal.rename(tmp_path / "t.parquet.journal")
        assert call(capsys, "sweep", arm, *options, "--out", tmp_path / f"t.{kind}").code == 0
        (tmp_path / f"t.{kind}.journal").rename(journal)  # kept: one case has failed
    said = parquet.read_table(tmp_path / "t.parquet").to_pylist()
    written = rows(tmp_path / "t.csv")
    assert [*said[0]] == [*written[0]] and len(said) == len(written) == 2
    for mine, other in zip(said, written, strict=True):
        assert {k: "" if v is None else str(v) for k, v in mine.items()} == other


def test_a_case_that_fails_gets_its_reason_and_the_others_go_on(arm, tmp_path, capsys):
    """1e-4 m: the arm falls over; -1 m: no section. Both are rows."""
    out = tmp_path / "t.csv"
    sets = ["--set", f"{THICKNESS}=-1,1e-4,4e-3", "--set", "motion.joints.shoulder=0.5"]
    done = call(
        capsys, "sweep", arm, *sets, "--level", "quasistatic", "--outputs", "stress",
        "--jobs", 1, "--out", out, "--json",
    )  # fmt: skip
    assert done.code == 0
    table = rows(out)
    assert [row["status"] for row in table] == ["failed", "failed", "done"]
    assert "thickness: -1 is out of range" in table[0]["error"]
    assert "no equilibrium" in table[1]["error"] and "\n" not in table[1]["error"]
    assert table[0]["stress.peak [Pa]"] == "" and float(table[2]["stress.peak [Pa]"]) > 0
    assert json.loads(done.out)["columns"]["stress.peak"][0] is None
    alone = [f"{THICKNESS}=1e-4", *sets[2:], "--level", "quasistatic", "--outputs", "stress"]
    # the case is in the journal: another sweep to the same file takes it from there
    every = call(capsys, "sweep", arm, "--set", *alone, "--jobs", 1, "--out", out)
    assert every.code == 1 and "1 case, 0 done, 1 failed" in every.out
    assert "none of the cases has an answer: arm: t = 0.005 s: no equilibrium" in every.err


@pytest.mark.parametrize(
    "options, said",
    [
        (["--set", "flexible.*.section.thicknes=1,2"], 'no such key. Did you mean "thickness"?'),
        (["--set", "flexible.uper.section.thickness=1,2"], 'Did you mean "upper"?'),
        (["--set", f"{THICKNESS}=1:2"], "not a range"),
        (["--set", THICKNESS], "not of the form KEY=VALUES"),
        (["--set", "a=1,2", "--set", "b=1,2,3", "--zip"], "a has 2, b has 3"),
        (["--outputs", "stres"], 'Did you mean "stress"?'),
        (["--level", "coupld"], 'Did you mean "coupled"?'),
        (["--out", "table.xls"], "Allowed: .csv, .parquet."),
        (["--jobs", "0"], "'0' is not a whole number, 1 to 99999"),
    ],
)
def test_wrong_input_is_said_before_anything_runs(arm, capsys, options, said):
    done = call(capsys, "sweep", arm, *options)
    assert done.code == 2 and said in done.err and done.out == ""


# Processes ---------------------------------------------------------------------------------------

COUNT = 16
VALUES = [*np.linspace(3e-3, 5e-3, COUNT - 1).tolist(), -1]  # the last is no thickness
LONG = ["--set", f"{THICKNESS}={','.join(map(str, VALUES))}", "--outputs", "stress", "--jobs", "2"]


def start(arm: str, out: Path) -> subprocess.Popen[str]:
    """A sweep of some seconds in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "pinflex", "sweep", arm, *LONG, "--out", str(out)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        # a shell that runs the tests in the background makes them, and so this, deaf to Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip


def wait_for(journal: Path, lines: int, process: subprocess.Popen[str]) -> None:
    """Until so many cases are kept."""
    while not journal.exists() or journal.read_bytes().count(b"\n") < lines:
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.01)


def test_killed_and_restarted_no_case_is_lost_or_repeated(arm, tmp_path):
    out, journal = tmp_path / "t.csv", tmp_path / "t.csv.journal"
    first = start(arm, out)
    wait_for(journal, 5, first)
    os.kill(first.pid, signal.SIGKILL)  # and its workers end by themselves
    first.communicate(timeout=60)  # which waits for them: they hold the pipe
    kept = journal.read_bytes()
    kept = kept[: kept.rindex(b"\n") + 1]
    assert 5 <= kept.count(b"\n") < COUNT and not out.exists()
    second = start(arm, out)
    assert (second.communicate(timeout=60)[1], second.returncode) == ("", 0)
    lines = journal.read_bytes()  # it stays, as one case has no answer
    assert lines.startswith(kept)
    found = [json.loads(line)["key"] for line in lines.splitlines()]
    assert len(found) == len(set(found)) == COUNT
    table = rows(out)
    assert [row["status"] for row in table] == ["done"] * (COUNT - 1) + ["failed"]
    stress = [float(row["stress.peak [Pa]"]) for row in table[:-1]]
    for k in (0, COUNT - 2):
        robot = pf.load(arm, [f"flexible.upper.section.thickness={table[k][THICKNESS]}"])
        # another process on the same machine: to the last digits
        assert stress[k] == pytest.approx(pf.solve(robot).link("upper").von_mises.max(), rel=1e-9)


def test_ctrl_c_keeps_what_is_done_and_says_so(arm, tmp_path):
    out, journal = tmp_path / "t.csv", tmp_path / "t.csv.journal"
    process = start(arm, out)
    wait_for(journal, 3, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal sends it: to the workers too
    said = process.communicate(timeout=60)[1]
    kept = journal.read_bytes().count(b"\n")
    assert process.returncode == 130
    assert said.startswith(f"pinflex: interrupted: {kept} of {COUNT} cases are done and kept in ")
    assert said.count("\n") == 1
    assert len(rows(out)) == kept < COUNT


def test_a_tolerance_holds_the_numbers_that_a_table_has():
    """Torque alone in fewer steps than stress too, and as near to a run a hundred times finer."""
    values, tol = {"solve.tol": [1e-2]}, 1e-2
    torque = pf.sweep("race_r2", values, level="coupled", outputs=["torque", "cost"])
    every = pf.sweep("race_r2", values, level="coupled", outputs=["torque", "stress", "cost"])
    true = pf.sweep("race_r2", {"solve.tol": [1e-4]}, level="coupled", outputs=["torque"])
    assert torque["cost.steps"][0] <= every["cost.steps"][0]
    for key in [key for key in torque if key.startswith("torque.peak")]:
        assert abs(torque[key][0] / true[key][0] - 1.0) < tol


def test_a_dask_cluster_gives_the_same_table(arm):
    distributed = pytest.importorskip("distributed", reason="needs pinflex[sweep]")
    values = {THICKNESS: [3e-3, 4e-3, -1.0]}
    here = pf.sweep(arm, values, level="quasistatic", outputs=["stress", "torque"])
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        there = pf.sweep(
            arm, values, level="quasistatic", outputs=["stress", "torque"],
            scheduler=cluster.scheduler_address,
        )  # fmt: skip
    said = {name: repr(values.tolist()) for name, values in there.arrays.items()}  # nan = nan
    assert said == {name: repr(values.tolist()) for name, values in here.arrays.items()}


def test_a_sweep_refused_before_its_first_case_leaves_no_file(arm, tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs pinflex[sweep]")
    monkeypatch.setattr("pinflex.studies.batch._PATIENCE", "100ms")
    with pytest.raises(pf.DescriptionError, match="no Dask scheduler answers"):
        pf.sweep(arm, {THICKNESS: [3e-3]}, level="quasistatic", journal=tmp_path / "t.journal",
                 scheduler="127.0.0.1:1")  # fmt: skip
    assert not list(tmp_path.iterdir())


# map ---------------------------------------------------------------------------------------------


def test_a_map_is_a_table_and_a_figure(tmp_path, capsys):
    arm = write_model(tmp_path, "arm")
    out, figure = tmp_path / "map.csv", tmp_path / "map.png"
    done = call(capsys, "map", arm, "--grid", "shoulder=-.5:.5:3", "--jobs", 1,
                "--out", out, "--plot", figure)  # fmt: skip
    assert (done.code, done.err) == (0, "")
    table = rows(out)
    assert [row["shoulder [rad]"] for row in table] == ["-0.5", "0.0", "0.5"]
    home = pf.modes(pf.load(arm), count=2).frequencies
    assert [float(table[1][f"frequency.{k} [Hz]"]) for k in (1, 2)] == pytest.approx(home)
    assert figure.read_bytes().startswith(b"\x89PNG")
    for wrong, said in (
        (["--grid", "elbow=1"], "neither a motor nor a platform coordinate"),
        (["--plot", "map.gif"], "Allowed: .png, .pdf, .svg"),
        (["--count", "0"], "'0' is not a whole number, 1 to 99999"),
    ):
        assert said in call(capsys, "map", arm, *wrong).err
