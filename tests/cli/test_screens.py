"""Commands answer on one screen: the table, a sentence, and no sign that means nothing.

Claims:
    Equations
    - map, sweep, bench, advise on one screen; no inf, nan, ? | - | 45 lines | 24
"""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pinflex import boundary
from pinflex.__main__ import build_parser, main
from pinflex.advice import reduced_models as advice_text
from pinflex.advice.reduced_models import Advice, LeftOut
from pinflex.errors import PinflexError
from pinflex.results.verdict import criterion
from tests.cli.small import call, write_model

SCREEN = 45  # lines
THICKNESS = "flexible.*.section.thickness"


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_model(tmp_path_factory.mktemp("arm"), "arm")


def clean(text: str) -> bool:
    """Lines that fit, few of them, and neither inf nor nan nor a bare question mark."""
    lines = text.splitlines()
    signs = re.findall(r"(?<![\w.])(?:inf|nan|\?)(?!\w)", text)
    return len(lines) <= SCREEN and max(map(len, lines)) <= 120 and not signs


def test_a_map_says_its_ranges_a_sentence_and_the_rest_on_demand(arm, capsys):
    grid = ["--grid", "shoulder=-.5:.5:3", "--jobs", 1]
    brief, whole = (call(capsys, "map", arm, *grid, *more).out for more in ([], ["-v"]))
    assert clean(brief) and "The lowest frequency is" in brief
    assert "compliance" not in brief and "compliance" in whole


def test_a_map_of_modes_that_cross_says_the_lowest_of_each_pose(capsys):
    """A hexapod turned near its singular pose, where the spin of the platform falls below all."""
    said = call(capsys, "map", "hexapod", "--grid", "rz=0:1.2:3", "--jobs", 1).out
    rows = re.findall(r"frequency\.(\d) +Hz +([\d.]+)", said)
    lowest, mode = min((float(least), int(k)) for k, least in rows)
    assert mode != 1 and f"The lowest frequency is {lowest:.4g} to" in said


def test_a_map_and_a_sweep_without_values_say_so(arm, capsys):
    assert "No --grid and no --instants were given" in call(capsys, "map", arm, "--jobs", 1).out
    said = call(capsys, "sweep", arm, "--level", "rigid", "--outputs", "torque", "--jobs", 1).out
    assert "No --set was given" in said and clean(said)


def test_a_sweep_shows_its_cases_and_ranges_on_demand(arm, capsys):
    values = ["--set", f"{THICKNESS}=3e-3:5e-3:25", "--level", "rigid", "--outputs", "frequency"]
    brief, whole = (
        call(capsys, "sweep", arm, *values, "--jobs", 1, *more).out for more in ([], ["-v"])
    )
    assert clean(brief) and "the first 20 (5 more in the table: --out)" in brief
    assert "frequency.1 goes from" in brief and "(case 25)" in brief
    assert "Range of every number" not in brief and "Range of every number" in whole


def test_advice_has_rows_only_for_what_was_measured():
    none = dict.fromkeys(("torque", "platform"), float("inf"))
    some = {"torque": 0.004, "platform": 0.005}
    found = Advice(
        "arm", 1e-2, ("torque", "platform"), error=some,
        levels={"rigid": none, "ked": none, "coupled": some},
        left_out=tuple(
            LeftOut(what, {"torque": 3e-5, "platform": 4e-5}, True) for what in (
                "stretch (axial)", "modes beyond 1 of each link and plane",
                "modes beyond 0 of each link and plane",
            )
        ),
    )  # fmt: skip
    text = advice_text.report(found, whole=False).text()
    assert clean(text) and "Not measured: rigid, ked." in text
    least = (
        "Left out: stretch (axial), modes beyond 0 of each link and plane. -v says what each costs."
    )
    assert least in " ".join(text.split())  # the fewest modes say what more of them would
    assert "3.0e-05" not in text and "3.0e-05" in str(found)
    assert f"Suffices: {criterion(1e-2)}." in text and text.startswith("arm: reached.")


def test_an_advice_lets_off_what_the_band_allows_and_caps_what_is_all_wrong():
    error = {"torque": 0.04, "platform position": 2.0}
    found = Advice("arm", 0.05, ("torque", "platform"), level="rigid", error=error)
    assert found.used(error) == 40.0 and "NOT REACHED: error bars over 100 %" in str(found)
    far = {"platform position": 20e-6}
    near = replace(found, allowed={"platform position": 2.5}, sizes=far)  # within 50 um
    assert near.used(error) == 0.8 and "arm: reached." in str(near)
    bar, allowed = (" ".join(x.split()) for x in str(near).splitlines()[-3:-1])
    assert (bar, allowed) == ("the proposal 4 % 40 um", "allowed 5 % 50 um")
    assert near.worst({**error, "torque": 0.03}) == "40 um (platform position)"


def test_every_command_that_takes_a_model_takes_json_and_set():
    commands = build_parser()._subparsers._group_actions[0].choices  # argparse has no public way
    assert len(commands) == 22
    for name, command in commands.items():
        options = {option for action in command._actions for option in action.option_strings}
        places = {action.dest for action in command._actions if not action.option_strings}
        assert "--json" in options, name
        assert "model" not in places or "--set" in options, name


def test_debug_shows_every_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(boundary.VARIABLE, "")
    with pytest.raises(PinflexError) as caught:
        main(["check", "no-such-model", "--debug"])
    frames = [entry.name for entry in caught.traceback]
    assert {"load", "find_file"} <= set(frames)


def test_pinflex_alone_prints_its_help():
    said = subprocess.run(
        [sys.executable, "-m", "pinflex"], capture_output=True, text=True, check=False
    )
    assert said.stdout.startswith("usage: pinflex") and said.stderr == ""


def test_verify_says_each_case_as_it_ends(tmp_path: Path):
    """Two cases through a pipe: the first table is there before the second case has ended."""
    command = [sys.executable, "-m", "pinflex", "verify", "A hub", "A05"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        alive = process.poll() is None
        rest = process.stdout.read()
    assert first.strip() and alive and "quantities passed" in rest


def test_what_is_mistyped_leads_to_what_was_meant(arm, capsys):
    assert 'Did you mean "compare"?' in call(capsys, "compaer", "delta").err
    said = call(capsys, "solve", arm, "--set", "motion.shaper={kind:zvd,modes: 2}")
    assert "motion.shaper.kind: kind:zvd has no blank after its colon" in said.err
    assert "Write `kind: zvd`." in said.err


def test_check_tells_the_motion_and_the_end_of_the_run_apart(arm, capsys):
    long = call(capsys, "check", arm, "--set", "solve.until=9").out
    assert ", run to 9 s" in long and "9 s" not in long.split(", run to 9 s")[0]
    assert "run to" not in call(capsys, "check", arm).out
