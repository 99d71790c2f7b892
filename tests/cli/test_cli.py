"""The commands: what they print for people and for machines, and which files they leave.

Claims:
    Pages, pictures, figures
    - the files of the runs alone give the page of the comparison, in another process and folder |
      byte by byte | equal
    - compare prints less than 40 lines; every stage is named while it runs | exact | passes
    - `pinflex --help` imports no pinocchio, scipy, matplotlib; `pinflex` alone prints the help | -
      | passes
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex import __main__
from pinflex.cli import vibration
from pinflex.errors import ConvergenceError
from pinflex.progress import Bar
from pinflex.results.result import Result
from tests.cli.small import call, write_model

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def fourbar(tmp_path_factory) -> str:
    return write_model(tmp_path_factory.mktemp("fourbar"), "fourbar")


@pytest.fixture(scope="module")
def compared(fourbar, tmp_path_factory) -> tuple[Path, str]:
    """One comparison of the four-bar, read by several tests."""
    folder = tmp_path_factory.mktemp("out") / "new" / "folder"
    done = run_pinflex("compare", fourbar, "-o", folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder, done.stdout


def run_pinflex(*arguments: object, **options) -> subprocess.CompletedProcess[str]:
    """A call in a process of its own, from the checkout."""
    return subprocess.run(
        [sys.executable, "-m", "pinflex", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        **options,
    )


def numbers(text: str) -> object:
    """JSON of an answer; NaN and Infinity, which JSON does not have, are refused."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


# help ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["check", "modes", "solve", "compare", "sweep", "map", "view"])
def test_each_command_has_a_help_with_an_example_of_its_own(capsys, command):
    with pytest.raises(SystemExit) as stop:
        __main__.main([command, "--help"])
    text = capsys.readouterr().out
    assert stop.value.code == 0
    assert f"example:\n  pinflex {command} " in text
    assert max(map(len, text.splitlines())) <= 100


def test_pinflex_alone_prints_the_help(capsys):
    answer = call(capsys)
    assert (answer.code, answer.err) == (2, "")
    assert "pinflex compare delta" in answer.out
    assert len(answer.out.splitlines()) <= 40  # a terminal's height
    commands = next(a for a in __main__.build_parser()._actions if a.dest == "command").choices
    lines = [line.split() for line in answer.out.splitlines() if line.startswith("    ")]
    told = {words[0] for words in lines if len(words) > 2}  # on one line with what it answers
    assert told >= {*commands}


def test_help_needs_no_heavy_library():
    code = (
        "import sys; from pinflex.__main__ import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'pinocchio', 'numpy', 'scipy', 'matplotlib', 'meshcat'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "pinflex compare delta" in done.stdout


def test_the_version_is_printed(capsys):
    with pytest.raises(SystemExit) as stop:
        __main__.main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out.startswith("pinflex ")


# check -----------------------------------------------------------------------------------------


def test_check_gives_the_published_sag_and_moment_of_the_3rrs(capsys):
    answer = call(capsys, "check", "3rrs", "--json")
    data = numbers(answer.out)
    assert (answer.code, answer.err) == (0, "")
    assert data["report"]["mobility"] == 3
    assert data["report"]["rank"] == 6
    rest = data["statics"]
    # published: 3.706 mm and 0.11296 N m in linear statics; 0.3 % as the project promises
    assert rest["linear"]["position"][2] == pytest.approx(-3.706e-3, rel=3e-3)
    assert rest["holding_linear"] == pytest.approx([0.11296] * 3, rel=3e-3)
    # a symmetric machine neither shifts nor tilts: round-off of a 0.2 m machine
    assert np.allclose(rest["linear"]["position"][:2] + rest["linear"]["rotation"], 0, atol=1e-9)
    # frame FE without preload, of the README: gravity makes 1.291 Hz of 1.524
    assert data["unloaded"][0] == pytest.approx(1.524, rel=1e-3)
    assert data["frequencies"][0] == pytest.approx(1.291, rel=1e-3)
    told = call(capsys, "check", "3rrs").out
    assert "13.30   without gravity and loads (modes --preload none)" in told
    # under its own weight the full equilibrium sags more
    assert rest["full"]["position"][2] < rest["linear"]["position"][2]


def test_check_writes_home_and_leaves_every_other_byte(capsys, tmp_path):
    guess = "home: {motor: 1.2, elbow: -0.9, pivot: 1.9}"
    model = Path(write_model(tmp_path, "fourbar", [(guess, f"# branch\n{guess}  # rough")]))
    model.chmod(0o640)
    before = model.read_text()
    closed = pf.load(model)
    answer = call(capsys, "check", model, "--write-home")
    assert (answer.code, answer.err) == (0, "")
    assert f"home written to {model}" in answer.out
    after = model.read_text()
    own, other = ([x for x in t.splitlines() if "home" not in x] for t in (after, before))
    assert own == other
    assert "  # rough\n" in after
    assert model.stat().st_mode & 0o777 == 0o640
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []
    again = pf.load(model)
    assert again.description.home["motor"] == 1.2
    # continuous joints: cosine and sine; nine digits are written
    np.testing.assert_allclose(again.home, closed.home, atol=1e-9)
    call(capsys, "check", model, "--write-home")
    assert model.read_text() == after


def test_check_writes_no_home_for_a_changed_or_an_installed_model(capsys, fourbar, monkeypatch):
    answer = call(capsys, "check", fourbar, "--write-home", "--set", "home.motor=1.3")
    assert (answer.code, answer.out) == (2, "")
    assert "not that of the file" in answer.err
    monkeypatch.setattr("pinflex.studies.scenes.home._PACKAGE", Path(fourbar).resolve().parent)
    answer = call(capsys, "check", fourbar, "--write-home")
    assert (answer.code, answer.out) == (2, "")
    assert "came with an installed package" in answer.err


def test_check_says_that_home_was_searched_and_which_frames_joints_name(capsys, tmp_path):
    changes = [
        ("home: {motor: 1.2, elbow: -0.9, pivot: 1.9}\n", ""),
        ("[coupler_tip, rocker_tip]", "[tip, rocker_end]"),
    ]
    model = write_model(tmp_path, "fourbar", changes)
    text = " ".join(call(capsys, "check", model).out.split())
    assert "tip (link coupler_tip)" in text
    assert "rocker_end (link rocker_tip)" in text
    assert ("home: found by a search" in text) == (pf.load(model).report.starts > 0)


def test_check_names_loops_planes_masses_and_what_the_urdf_says_in_vain(capsys, fourbar):
    text = call(capsys, "check", fourbar).out
    assert "mobility  1 = 3 joint coordinates - 2 independent closure rows" in text
    assert "coupler: axial, bending y (planar scene" in text
    assert "damping in the URDF is not used (elbow)" in text
    assert max(map(len, text.splitlines())) <= 100


def test_check_warns_of_a_beam_that_does_not_weigh_what_the_urdf_says(capsys, fourbar):
    answer = call(capsys, "check", fourbar, "--json", "--set", "flexible.*.material.rho=5400")
    data = numbers(answer.out)
    # twice the density of a beam that weighs what the URDF says
    assert data["links"][0]["mass_difference"] == pytest.approx(1.0, abs=1e-9)
    assert any("(+100 %)" in text and "coupler" in text for text in data["warnings"])


def test_check_names_redundant_rows_and_missing_motors(capsys, fourbar):
    closing = ["--set", "loops.pin.kind=revolute"]  # its three rows out of the plane are dependent
    data = numbers(call(capsys, "check", fourbar, "--json", *closing).out)
    assert data["report"]["rows"] == 5
    assert len(data["report"]["redundant"]) == 3
    assert len(data["loops"][0]["redundant"]) == 3
    none = ("--set", "actuated=[]", "--set", "motion=null")
    data = numbers(call(capsys, "check", fourbar, "--json", *none).out)
    assert any("0 motors for 1 degrees of freedom" in text for text in data["warnings"])
    assert data["statics"]["full"] is None
    assert "motors do not hold" in data["statics"]["full_reason"]


def test_check_says_that_a_motion_cannot_be_followed_and_still_reports(capsys):
    answer = call(capsys, "check", "3rrr", "--set", "motion.radius=0.2")
    assert answer.code == 0
    assert "circle of the platform (x, y, rz), 0.2 s: cannot be followed" in answer.out


# modes -----------------------------------------------------------------------------------------


def test_modes_give_the_published_frequencies_of_the_3rrs(capsys):
    data = numbers(call(capsys, "modes", "3rrs", "--preload", "none", "--count", 6, "--json").out)
    found = [mode["frequency"] for mode in data["modes"]]
    published = [1.524, 2.677, 4.544, 7.450, 8.224, 13.30]  # four digits
    assert found == pytest.approx(published, rel=5e-3)
    assert all(sum(mode["share"].values()) == pytest.approx(1.0) for mode in data["modes"])


def test_free_motors_give_as_many_free_motions_as_degrees_of_freedom(capsys):
    data = numbers(call(capsys, "modes", "3rrr", "--free-motors", "--count", 5, "--json").out)
    found = [mode["frequency"] for mode in data["modes"]]
    assert data["rigid_body_modes"] == 3
    assert len(found) == 5
    assert min(found) > 100


def test_a_pose_closes_the_loops_from_home(capsys, fourbar):
    def first(*pose: object) -> float:
        data = numbers(call(capsys, "modes", fourbar, "--count", 1, "--json", *pose).out)
        return data["modes"][0]["frequency"]

    # the coupler hangs between two pins at any pose, so only its load changes with the pose
    assert first("--pose", "motor=2.5") == pytest.approx(first(), rel=1e-2)
    assert first("--pose", "motor=2.5") != first()


def test_mode_shapes_are_written_as_a_page(capsys, fourbar, tmp_path):
    page = tmp_path / "shapes.html"
    answer = call(capsys, "modes", fourbar, "--count", 2, "--view", page)
    assert answer.code == 0
    assert answer.out.endswith(f"wrote {page}\n")
    assert "pinflex" in page.read_text(encoding="utf-8")


# solve and view --------------------------------------------------------------------------------


def test_solve_writes_the_run_and_the_table_it_says(capsys, fourbar, tmp_path):
    run, table = tmp_path / "run.npz", tmp_path / "run.csv"
    answer = call(capsys, "solve", fourbar, "--level", "ked", "-o", run, "--csv", table, "--json")
    data = numbers(answer.out)
    assert (answer.code, answer.err) == (0, "")
    assert data["files"] == [str(run), str(table)]
    result = Result.load(run)
    assert data["level"] == result.level == "ked"
    assert data["motors"]["motor"]["peak"] == np.max(np.abs(result.torque))
    assert data["instants"] == len(result.t) == len(table.read_text().splitlines()) - 1


def test_the_options_of_solve_override_the_yaml(capsys, fourbar):
    options = ("--until", "0.05", "--samples", "11", "--dt", "1e-3", "--level", "coupled")
    data = numbers(call(capsys, "solve", fourbar, "--json", *options).out)
    assert (data["until"], data["instants"]) == (pytest.approx(0.05), 11)
    assert data["settings"]["dt"] == pytest.approx(1e-3)


def test_set_changes_the_model(capsys, fourbar):
    def deflection(*options: object) -> float:
        done = call(capsys, "solve", fourbar, "--level", "quasistatic", "--json", *options)
        return numbers(done.out)["links"]["coupler"]["deflection"]

    thin = deflection("--set", "flexible.*.section.thickness=2.5e-3", "--set", "solve.samples=11")
    # half as thick: an eighth of the stiffness, half the weight, so four times the deflection
    assert thin == pytest.approx(4 * deflection("--set", "solve.samples=11"), rel=1e-2)


def test_view_writes_the_page_beside_the_run_or_where_it_is_told(capsys, compared, tmp_path):
    run = compared[0] / "fourbar-coupled.npz"
    page = tmp_path / "deep" / "page.html"
    answer = call(capsys, "view", run, "-o", page, "--no-open", "--field", "bending", "--scale", 5)
    assert (answer.code, answer.out) == (0, f"{page}\n")
    assert page.stat().st_size > 1e5
    data = numbers(call(capsys, "view", run, "--no-open", "--json").out)
    assert data["file"] == str(run.with_suffix(".html"))
    assert run.with_suffix(".html").is_file()


def test_a_user_with_only_the_files_of_the_runs_and_pinflex_gets_the_same_page(compared, tmp_path):
    """Byte by byte, in another process and folder: every level and yield strengths with them."""
    files = [f"fourbar-{level}.npz" for level in ("coupled", "rigid", "ked", "quasistatic")]
    for file in files:
        shutil.copy(compared[0] / file, tmp_path / file)
    command = [sys.executable, "-m", "pinflex", "view", *files, "-o", "sent.html", "--no-open"]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=tmp_path, env=env, check=True, capture_output=True)
    page = (tmp_path / "sent.html").read_bytes()
    assert page == (compared[0] / "animation.html").read_bytes()
    run, rigid = (Result.load(compared[0] / f"fourbar-{x}.npz") for x in ("coupled", "rigid"))
    assert run.array("rigid/torque") == pytest.approx(rigid.torque)
    assert run.meta["links"]["coupler"]["material"]["yield_strength"] == 5.03e8


# compare ---------------------------------------------------------------------------------------


def test_compare_prints_one_screen_and_names_every_file_it_wrote(compared):
    folder, text = compared
    files = sorted(path.name for path in folder.iterdir() if path.name != "fourbar-coupled.html")
    assert {"comparison.txt", "comparison.json", "torques.png", "animation.html"} <= {*files}
    assert {f"fourbar-{level}.npz" for level in ("rigid", "ked", "coupled")} <= {*files}
    listed = text.split(f"In {folder}/:")[1].split("\ncomparison.txt has")[0]
    assert sorted(listed.replace("\n", " ").replace(" ", "").split(",")) == files
    assert f"Watch it in a browser: {(folder / 'animation.html').as_uri()}\n" in text
    whole = (folder / "comparison.txt").read_text(encoding="utf-8")
    for words in ("fourbar: Frame coupler_tip deviates", "the reference", "First resonance"):
        assert words in " ".join(text.split())
        assert words in " ".join(whole.split())
    for words in ("Motor torque [N m]", "coupler_tip", "von Mises", "Cost"):
        assert words in whole
    assert len(text.splitlines()) < 40
    assert max(map(len, text.splitlines())) <= 130  # the path of the test folder is long


def test_verbose_prints_the_long_tables_too_and_the_band_decides_what_suffices(
    capsys, fourbar, tmp_path
):
    options = ("-o", tmp_path, "--levels", "ked,coupled", "--set", "solve.samples=11")
    wide = call(capsys, "compare", fourbar, *options, "--band", "1.0", "-v").out
    assert wide.startswith((tmp_path / "comparison.txt").read_text(encoding="utf-8"))
    narrow = numbers(call(capsys, "compare", fourbar, *options, "--band", "1e-15", "--json").out)
    assert narrow["band"] == 1e-15
    assert [row["suffices"] for row in narrow["levels"]] == [False, True, True]
    assert "The simplest level that suffices is rigid." in " ".join(wide.split())
    whole = (tmp_path / "comparison.txt").read_text(encoding="utf-8")
    assert whole.split("misses ")[1].splitlines()[0].endswith(" nm")
    refused = call(capsys, "compare", fourbar, "--band", "0")
    assert refused.code == 2
    assert "--band" in refused.err


def test_the_table_agrees_with_the_runs(compared):
    folder, _ = compared
    data = numbers((folder / "comparison.json").read_text(encoding="utf-8"))
    rigid, coupled = (Result.load(folder / f"fourbar-{x}.npz") for x in ("rigid", "coupled"))
    row = next(r for r in data["torques"] if r["level"] == "coupled")
    assert row["max_difference"] == pytest.approx(np.max(np.abs(coupled.torque - rigid.torque)))
    assert row["rigid_peak"] == pytest.approx(np.max(np.abs(rigid.torque)))
    link = next(r for r in data["stresses"] if r["level"] == "coupled")
    assert link["von_mises"] == pytest.approx(coupled.link("coupler").von_mises.max())
    # aluminium_7075 yields at 503 MPa
    assert link["yield_share"] == pytest.approx(link["von_mises"] / 5.03e8)
    assert [row["level"] for row in data["costs"]] == ["rigid", "quasistatic", "ked", "coupled"]


def test_the_levels_agree_where_deflections_are_small(compared):
    rows = numbers((compared[0] / "comparison.json").read_text(encoding="utf-8"))["torques"]
    peaks = {row["level"]: row["peak"] for row in rows}
    # the vibration is 2 % of the torque and linear: ked and coupled see the same
    assert peaks["ked"] == pytest.approx(peaks["coupled"], rel=2e-2)


def test_compare_in_json_prints_one_object_and_nothing_else(capsys, fourbar, tmp_path):
    folder = tmp_path / "out"
    options = ("--levels", "quasistatic", "--set", "solve.samples=11", "--json")
    answer = call(capsys, "compare", fourbar, "-o", folder, *options)
    data = numbers(answer.out)
    assert {row["level"] for row in data["torques"]} == {"quasistatic"}
    assert sorted(data["files"]) == sorted(path.name for path in folder.iterdir())
    assert not any(folder.glob("spectrum*"))  # a quasistatic run has none


def test_a_level_that_cannot_be_solved_does_not_stop_the_others(capsys, tmp_path):
    model = write_model(tmp_path, "arm")
    # bent by four times its length at the quasistatic level, which then finds no balance
    soft = "flexible.upper.material={E: 3e10, nu: 0.3, rho: urdf}"
    (tmp_path / "arm-quasistatic.npz").write_text("left by an earlier comparison")
    hanging = ("--set", "home={shoulder: -1.5707963}", "--set", "motion.joints={shoulder: 1.5}")
    levels = ("--levels", "quasistatic,coupled")
    answer = call(
        capsys, "compare", model, "-o", tmp_path, "--set", soft, *hanging, *levels, "--json"
    )
    data = numbers(answer.out)
    assert answer.code == 0
    assert {row["level"] for row in data["torques"]} == {"coupled"}
    reason = data["unsolved"]["quasistatic"]
    assert "no equilibrium" in reason
    assert reason.endswith("is in arm-quasistatic-partial.npz.")
    partial = Result.load(tmp_path / "arm-quasistatic-partial.npz")
    assert partial.meta["status"] == "stopped"
    assert 1 <= len(partial.t) < 41
    assert not (tmp_path / "arm-quasistatic.npz").exists()
    text = (tmp_path / "comparison.txt").read_text(encoding="utf-8")
    assert "NOT SOLVED, see below" in text
    assert data["falls"] == partial.t[-1]
    assert "buckles or falls" in data["verdict"]
    assert "- quasistatic was not solved. arm: t = " in text


def test_without_a_rigid_reference_the_rest_is_still_reported(capsys, tmp_path):
    model = write_model(tmp_path, "arm", [("platform: hand", "platform: hand\nactuated: []")])
    model = _swinging(model)
    options = ("-o", tmp_path / "out", "--levels", "coupled", "--json")
    answer = call(capsys, "compare", model, *options)
    data = numbers(answer.out)
    assert answer.code == 0
    assert "do not determine the motion" in data["unsolved"]["rigid"]
    assert data["platform"] == []
    assert data["stresses"][0]["level"] == "coupled"


def _swinging(model: str) -> str:
    """The arm without motor or motion falls from rest."""
    path = Path(model)
    lines = [x for x in path.read_text().splitlines() if not x.startswith("motion")]
    path.write_text("\n".join(lines).replace("samples: 41", "samples: 41, until: 0.1") + "\n")
    return model


def test_when_no_level_can_be_solved_the_code_is_1_and_the_reasons_are_written(
    capsys, monkeypatch, fourbar, tmp_path
):
    def stop(mechanism: object, motion: object, level: str, **options: object) -> Result:
        raise ConvergenceError(f"{level} stopped. Try another.")

    monkeypatch.setattr("pinflex.studies.study.solve", stop)
    answer = call(capsys, "compare", fourbar, "-o", tmp_path)
    assert answer.code == 1
    assert answer.err.startswith("pinflex: fourbar: none of the levels rigid, quasistatic, ked")
    text = (tmp_path / "comparison.txt").read_text(encoding="utf-8")
    assert "coupled was not solved. coupled stopped. Try another." in text


# progress and endings --------------------------------------------------------------------------


def test_progress_is_drawn_for_a_terminal_and_wiped_at_the_end(capsys):
    bar = Bar("coupled", shown=True)
    bar.last -= 1.0  # a second has passed
    bar(30, 120)
    drawn = capsys.readouterr().err
    assert drawn.startswith("\rcoupled")
    assert " 25 % " in drawn
    bar.close()
    assert capsys.readouterr().err == "\r\x1b[K"


def test_every_stage_of_a_comparison_is_named(capsys, monkeypatch, fourbar, tmp_path):
    monkeypatch.setattr("pinflex.cli.console.sys.stderr.isatty", lambda: True)
    said = call(capsys, "compare", fourbar, "-o", tmp_path, "--levels", "coupled").err
    stages = [text.split(" ...")[0] for text in said.split("\r") if " ..." in text]
    assert stages[0].startswith("loading")
    assert stages[1:] == [
        *("rigid", "saving rigid", "coupled", "error bars", "saving coupled", "frequencies"),
        *(f"drawing {k} of 4" for k in (1, 2, 3, 4)),
        "writing the page",
    ]
    assert said.endswith("\r\x1b[K")


def test_no_progress_goes_into_a_pipe(capsys):
    bar = Bar("coupled")
    bar.last -= 1.0
    bar(30, 120)
    bar.close()
    assert capsys.readouterr().err == ""


def test_an_interrupt_ends_with_130_and_one_line(capsys, monkeypatch):
    def interrupted(args: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(vibration, "run_check", interrupted)
    assert call(capsys, "check", "3rrr") == (130, "", "pinflex: interrupted.\n")


def test_an_internal_error_is_one_line_that_asks_to_report_it(capsys, monkeypatch):
    def broken(args: object) -> int:
        raise ZeroDivisionError("float division\nby zero")

    monkeypatch.setattr(vibration, "run_check", broken)
    answer = call(capsys, "check", "3rrr")
    assert (answer.code, answer.out) == (1, "")
    assert answer.err.startswith("pinflex: internal error, ZeroDivisionError: float division by")
    assert "please report it" in answer.err
    assert answer.err.count("\n") == 1
    with pytest.raises(ZeroDivisionError):
        __main__.main(["check", "3rrr", "--debug"])


@pytest.mark.skipif(os.name != "posix", reason="a reader that closes its pipe early")
def test_a_reader_that_goes_away_is_not_an_error(fourbar):
    process = subprocess.Popen(
        [sys.executable, "-m", "pinflex", "check", fourbar],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    said = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=60) == 141  # 128 + SIGPIPE, as a shell says it
    assert said == ""


def test_live_without_meshcat_is_one_sentence_with_the_command_before_any_work(
    capsys, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "meshcat", None)
    answer = call(capsys, "view", tmp_path / "no.npz", "--live")
    assert (answer.code, answer.out) == (1, "")
    assert answer.err.count("\n") == 1 and "pip install meshcat" in answer.err
    assert "Traceback" not in answer.err and not [*tmp_path.iterdir()]
