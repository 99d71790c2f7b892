"""Bad input: one clear line each, exit code 2 for input and 1 for the scene, never a traceback."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import numpy as np
import pytest

from pinflex.results.result import Result
from tests.cli.small import Answer, call, write_model


def refused(answer: Answer, code: int, *words: str) -> None:
    """One line on stderr, nothing on stdout, and the words a user needs."""
    assert answer.code == code, answer.err
    assert answer.out == ""
    assert answer.err.startswith("pinflex: ")
    assert answer.err.count("\n") == 1
    assert answer.err.endswith(".\n")
    for word in ("Traceback", "internal error", 'File "', "Error:"):
        assert word not in answer.err
    for word in words:
        assert word in answer.err, answer.err


# Files -----------------------------------------------------------------------------------------

BAD_YAML = {
    "not YAML": ("home: {motor", "home: [motor", "line 6"),
    "a tab": ("gravity:", "\tgravity:", "line 2"),
    "a doubled key": ("platform:", "gravity: [0, 0, 0]\nplatform:", 'duplicate key "gravity"'),
    "an unknown key": ("gravity:", "gravty:", 'Did you mean "gravity"?'),
    "an unknown link": ("  coupler:\n", "  coupler_x:\n", 'Did you mean "coupler"?'),
    "an unknown frame": ("[coupler_tip,", "[coupler_tp,", 'Did you mean "coupler_tip"?'),
    "an unknown motor": ("actuated: [motor]", "actuated: [motr]", 'Did you mean "motor"?'),
    "an unknown joint in home": ("pivot: 1.9", "pivt: 1.9", 'Did you mean "pivot"?'),
    "an unknown loop kind": ("kind: planar", "kind: plane", 'Did you mean "planar"?'),
    "an unknown section": ("shape: rectangle", "shape: box", "Allowed: "),
    "an unknown material": ("like: aluminium_7075", "like: alu_7075", "aluminium_7075"),
    "an unknown level": ("level: coupled", "level: full", "coupled"),
    "an unknown motion": ("kind: cycloid", "kind: cyclod", 'Did you mean "cycloid"?'),
    "a motion of no motor": ("joints: {motor: 0.5}", "joints: {pivot: 0.5}", "motion.joints"),
    "negative thickness": ("thickness: 0.005", "thickness: -0.005", "section.thickness: -0.005"),
    "zero width": ("width: 0.02", "width: 0", "section.width: 0 is out of range"),
    "zero density": ("rho: 2700", "rho: 0", "material.rho: 0 is out of range"),
    "NaN density": ("rho: 2700", "rho: .nan", "material.rho: nan is out of range"),
    "infinite gravity": ("-9.81", "-.inf", "gravity[1]: -inf is out of range"),
    "a text for a number": ("duration: 0.1", "duration: fast", "duration"),
    "zero duration": ("duration: 0.1", "duration: 0", "duration"),
    "a negative step": ("dt: 2.5e-4", "dt: -1e-4", "solve.dt: -0.0001 is out of range"),
    "one sample": ("samples: 41", "samples: 1", "solve.samples: 1"),
    "no URDF": ("urdf: fourbar.urdf", "urdf: other.urdf", 'Did you mean "fourbar.urdf"?'),
    "no motors named": ("actuated: [motor]\n", "", "actuated: missing"),
}


@pytest.mark.parametrize("what", BAD_YAML)
def test_a_wrong_yaml_is_refused_by_file_key_and_value(capsys, tmp_path, what):
    old, new, words = BAD_YAML[what]
    model = write_model(tmp_path, "fourbar", [(old, new)])
    refused(call(capsys, "check", model), 2, "fourbar.yaml", words)


BAD_URDF = {
    "not XML": ("</robot>", "</robo>", "fourbar.urdf, line"),
    "another root": ('<robot name="fourbar">', '<r name="fourbar"><robot>', "malformed XML"),
    "a doubled name": ('name="rocker"', 'name="crank"', "crank"),
    "an unknown parent": ('parent link="crank"', 'parent link="crnk"', 'Did you mean "crank"?'),
    "a loop in the tree": ('<parent link="crank"/>', '<parent link="coupler_tip"/>', "go round"),
    "a negative mass": ('mass value="0.1"', 'mass value="-0.1"', "Allowed: a finite number >= 0"),
    "a mass that is none": ('mass value="0.1"', 'mass value="nan"', "'nan' is not valid"),
    "a negative inertia": ('iyy="1e-5"', 'iyy="-1e-5"', "None may be negative"),
    "an axis without direction": ('xyz="0 0 1"', 'xyz="0 0 0"', "has no direction"),
    "an unknown type": ('type="fixed"', 'type="rigid"', "no such type"),
    "no limits": ('type="continuous"', 'type="revolute"', "Missing: <limit>"),
}


@pytest.mark.parametrize("what", BAD_URDF)
def test_a_wrong_urdf_is_refused_by_element(capsys, tmp_path, what):
    old, new, words = BAD_URDF[what]
    model = write_model(tmp_path, "fourbar", [(old, new)], where="urdf")
    refused(call(capsys, "check", model), 2, "fourbar.urdf", words)


def test_files_that_are_none_are_refused(capsys, tmp_path):
    (tmp_path / "empty.yaml").write_text("")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00urdf")
    (tmp_path / "robot.urdf").write_text("<robot/>")
    (tmp_path / "robot.stl").write_text("solid")
    refused(call(capsys, "check", tmp_path / "empty.yaml"), 2, "empty.yaml")
    refused(call(capsys, "check", tmp_path / "bytes.yaml"), 2, "not UTF-8")
    refused(call(capsys, "check", tmp_path / "robot.urdf"), 2, "robot.urdf: no <link>")
    refused(call(capsys, "check", tmp_path / "robot.stl"), 2, "not a YAML file")
    refused(call(capsys, "check", tmp_path), 2, "holds no")
    refused(call(capsys, "check", "3rr"), 2, "no such file", "Did you mean", "3rrr")


# Arguments -------------------------------------------------------------------------------------

BAD_ARGUMENTS = {
    "another command": (("chek", "3rrr"), "invalid choice: 'chek'"),
    "no model": (("check",), "MODEL"),
    "two models": (("check", "3rrr", "3rrs"), "unrecognized arguments: 3rrs"),
    "a misspelt option": (("compare", "3rrr", "--level", "ked"), "Did you mean --levels"),
    "another option": (("check", "3rrr", "--jsn"), "--jsn"),
    "a setting without value": (("check", "3rrr", "--set", "gravity"), "key.path=value"),
    "a setting of no key": (("check", "3rrr", "--set", "grvity=1"), 'Did you mean "gravity"?'),
    "a setting of no link": (
        ("check", "3rrr", "--set", "flexible.distl_1.section.thickness=1e-3"),
        "distl_1",
    ),
    "a setting out of range": (("check", "3rrr", "--set", "flexible.*.material.E=-1"), "E: -1 is"),
    "no count": (("modes", "3rrr", "--count", "0"), "--count"),
    "another preload": (("modes", "3rrr", "--preload", "full"), "--preload"),
    "a pose without value": (("modes", "3rrr", "--pose", "motor_1"), "MOTOR=VALUE"),
    "a pose of no motor": (("modes", "3rrr", "--pose", "motor_9=1"), "Allowed: motor_1, motor_2"),
    "a pose that is no number": (("modes", "3rrr", "--pose", "motor_1=up"), "'up' is not a number"),
    "a pose of NaN": (("modes", "3rrr", "--pose", "motor_1=nan"), "motor_1: nan"),
    "nothing that vibrates": (("modes", "ur5", "--set", "flexible=null"), "nothing vibrates"),
    "another level": (("solve", "3rrr", "--level", "full"), "Allowed: rigid, quasistatic, ked"),
    "a step of zero": (("solve", "3rrr", "--dt", "0"), "--dt"),
    "a step of NaN": (("solve", "3rrr", "--dt", "nan"), "--dt"),
    "an endless run": (("solve", "3rrr", "--until", "inf"), "--until"),
    "too many samples": (("solve", "3rrr", "--samples", "1000000000"), "--samples"),
    "torque drive at ked": (
        ("solve", "3rrr", "--level", "ked", "--set", "solve.drive=torque"),
        "solve.drive: torque needs level coupled",
    ),
    "rigid alone": (("compare", "3rrr", "--levels", "rigid"), "nothing to be compared with"),
    "no such level": (("compare", "3rrr", "--levels", "ked,full"), "full: no such level"),
    "nothing flexible": (("compare", "ur5", "--set", "flexible=null"), "nothing is flexible"),
}


@pytest.mark.parametrize("what", BAD_ARGUMENTS)
def test_wrong_arguments_are_refused(capsys, monkeypatch, tmp_path, what):
    arguments, words = BAD_ARGUMENTS[what]
    monkeypatch.chdir(tmp_path)
    refused(call(capsys, *arguments), 2, words)
    left = [path for path in tmp_path.iterdir() if path.is_file()]
    assert left == []


def test_runs_that_cannot_be_read_are_refused(capsys, tmp_path):
    run = tmp_path / "run.npz"
    model = write_model(tmp_path, "arm")
    assert call(capsys, "solve", model, "--level", "rigid", "-o", run).code == 0
    whole = run.read_bytes()
    refused(call(capsys, "view", tmp_path / "none.npz"), 2, "no such result file")
    refused(call(capsys, "view", model), 2, "not an .npz archive")
    refused(call(capsys, "view", run, "--field", "heat"), 2, "'heat' is not drawn")
    refused(call(capsys, "view", run, "--scale", "-3"), 2, "'-3' is no magnification")
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    refused(call(capsys, "view", tmp_path / "cut.npz"), 2, "truncated or damaged")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    refused(call(capsys, "view", tmp_path / "other.npz"), 2, "of another program")


def test_what_cannot_be_written_is_found_out_before_the_run(capsys, monkeypatch, tmp_path):
    model = write_model(tmp_path, "arm")
    (tmp_path / "file").write_text("in the way")
    inside = tmp_path / "file" / "run.npz"
    for name in ("pinflex.advice.solve", "pinflex.studies.study"):
        module = importlib.import_module(name)
        monkeypatch.setattr(module, "solve", lambda *a, **k: pytest.fail("solved first"))
    refused(call(capsys, "solve", model, "-o", inside), 2, "cannot be written")
    refused(call(capsys, "solve", model, "--csv", inside), 2, "cannot be written")
    refused(call(capsys, "solve", model, "-o", tmp_path), 2, "is a folder")
    refused(call(capsys, "compare", model, "-o", tmp_path / "file"), 2, "cannot be written")


# Scenes ----------------------------------------------------------------------------------------


def test_loops_that_cannot_close_name_the_loop_and_the_gap(capsys, tmp_path):
    # 0.1 + 0.25 + 0.2 m cannot span 0.9 m: 0.35 m stay open
    far = [('xyz="0.3 0 0"', 'xyz="0.9 0 0"')]
    model = write_model(tmp_path, "fourbar", far, where="urdf")
    refused(call(capsys, "check", model), 1, 'loop "pin" does not close', "stays open by")


def test_a_singular_home_names_the_loop_and_the_motion(capsys, tmp_path):
    # a crank of 0.20 m whose end is 0.25 + 0.20 m off the far pivot: coupler and rocker in line
    longer = [
        (
            """<child link="coupler"/>
    <origin xyz="0.1""",
            """<child link="coupler"/>
    <origin xyz="0.2""",
        )
    ]
    model = write_model(tmp_path, "fourbar", longer, where="urdf")
    crank = math.acos((0.20**2 + 0.30**2 - 0.45**2) / (2 * 0.20 * 0.30))
    line = math.atan2(-0.20 * math.sin(crank), 0.30 - 0.20 * math.cos(crank))
    home = f"home={{motor: {crank}, elbow: {line - crank}, pivot: {line + math.pi}}}"
    answer = call(capsys, "check", model, "--set", home)
    refused(answer, 1, "singular pose", 'loop "pin" can still move', "sigma_min")


def test_a_pose_out_of_reach_says_how_far_the_motor_came(capsys):
    answer = call(capsys, "modes", "3rrr", "--pose", "motor_1=3")
    refused(answer, 1, "singular pose", "on the way from home, at motor_1 = 1.89")


def test_a_motion_out_of_reach_says_when(capsys):
    refused(call(capsys, "solve", "3rrr", "--set", "motion.radius=0.2"), 1, "t = 0")


def test_a_motion_through_a_singular_pose_says_when_and_which_loop(capsys):
    motion = "motion={kind: cycloid, joints: {motor_1: 1.2}, duration: 0.5}"
    answer = call(capsys, "solve", "3rrr", "--level", "rigid", "--set", motion)
    refused(answer, 1, "t = 0.", "singular pose", "pin_3")


def test_motors_that_fight_or_are_missing_are_named(capsys):
    every = "actuated=[motor_1, motor_2, motor_3, knee_1]"
    move = "motion={kind: cycloid, joints: {motor_1: 0.1}, duration: 0.1}"
    answer = call(capsys, "solve", "3rrr", "--level", "rigid", "--set", every, "--set", move)
    refused(answer, 1, "4 motors drive a mechanism of mobility 3")
    answer = call(
        capsys, "solve", "3rrr", "--level", "rigid", "--set", "actuated=[motor_1]", "--set", move
    )
    refused(answer, 1, "do not determine the motion")


# Runs that stop ----------------------------------------------------------------------------------


def stopped(answer: Answer, run: Path, latest: float) -> Result:
    """The file of a run that stopped holds finite numbers up to its last good step."""
    refused(answer, 1, f"was saved to {run}", "The run up to t = ")
    assert "error.result" not in answer.err  # which only a Python caller has
    result = Result.load(run)
    assert result.meta["status"] == "stopped"
    assert result.meta["message"]
    assert 0 < result.t[-1] < latest
    assert all(np.isfinite(values).all() for values in result.arrays.values())
    return result


def test_a_coupled_run_that_diverges_leaves_its_file(capsys, tmp_path):
    model = write_model(tmp_path, "fourbar")
    # a foil of 0.05 mm at steps a hundred times too long
    options = ("--set", "flexible.*.section.thickness=5e-5", "--dt", "0.01", "--samples", "11")
    run, table = tmp_path / "run.npz", tmp_path / "run.csv"
    answer = call(capsys, "solve", model, *options, "-o", run, "--csv", table)
    result = stopped(answer, run, 0.1)
    assert "Newton stopped" in answer.err
    assert len(table.read_text().splitlines()) == len(result.t) + 1
    # and without -o the user hears that there was something to keep
    refused(call(capsys, "solve", model, *options), 1, "-o RUN.npz saves the run up to t = ")


def test_a_linear_run_that_grows_without_bound_leaves_its_file(capsys, tmp_path):
    model = write_model(tmp_path, "arm")
    # without second order a spinning beam softens until it runs away: the famous wrong answer
    options = (
        *("--set", "flexible.upper.second_order=false"),
        *("--set", "motion={kind: spin_up, joints: {shoulder: 60}, duration: 0.5}"),
        *("--until", "100", "--dt", "0.01"),
    )
    run = tmp_path / "run.npz"
    answer = call(capsys, "solve", model, "--level", "ked", *options, "-o", run)
    refused(answer, 1, "grows without bound", f"was saved to {run}")
    assert Result.load(run).t[-1] < 100


def test_a_quasistatic_run_without_equilibrium_leaves_its_file(capsys, tmp_path):
    model = write_model(tmp_path, "arm")
    options = (
        *("--set", "flexible.upper.material={E: 3e10, nu: 0.3, rho: urdf}"),
        *("--set", "home={shoulder: -1.5707963}", "--set", "motion.joints={shoulder: 1.5}"),
    )
    run = tmp_path / "run.npz"
    answer = call(capsys, "solve", model, "--level", "quasistatic", *options, "-o", run)
    stopped(answer, run, 0.2)
    assert "no equilibrium" in answer.err
    assert call(capsys, "view", run, "--no-open").code == 0
