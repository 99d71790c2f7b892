"""Python as its users write it: natural names, plots, tables, progress, short tracebacks.

Claims:
    Equations
    - natural guesses of users work: plot, tables, names in brackets, motion(t), compare, check,
      with_ | users' list of 18 | each | pass
    - an error shows the user's line, the boundary and the message | lines of a script's stderr; of
      IPython's | 7; 15 | 6; 9
"""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.boundary import VARIABLE, public
from pinflex.description.solve import KEYS as OPTIONS
from pinflex.errors import DescriptionError, PinflexError
from pinflex.results.pose_map import Columns

KEYS = {"until": 0.02, "samples": 21, "dt": 1e-3}


@pytest.fixture(scope="module")
def robot() -> pf.Mechanism:
    return pf.load("3rrr")


@pytest.fixture(scope="module")
def run(robot: pf.Mechanism) -> pf.Result:
    return pf.solve(robot, level="coupled", **KEYS)


MOVE = pf.cycloid(joints={"motor_1": 0.2}, duration=0.1)
TABLE = Columns({"a": np.array([1.0, 2.0]), "b": np.array(["x", "y"])}, {"a": "m"})
Guess = Callable[[pf.Mechanism, pf.Result], Any]
# What three users tried first and found missing, with what each has to give.
GUESSES: dict[str, tuple[Guess, Callable[[Any], bool]]] = {
    "run.plot()": (lambda m, r: r.plot(), lambda x: len(x.lines) == 3),
    "run['torque']": (lambda m, r: r["torque"], lambda x: x.shape == (21, 3)),
    "run.joints": (lambda m, r: list(r.joints), lambda x: x[0] == "motor_1"),
    "run.frames": (lambda m, r: r.frames["platform"].position, lambda x: x.shape == (21, 3)),
    "run.links['distal_1']": (lambda m, r: r.links["distal_1"].x, lambda x: x[0] == 0.0),
    "run.loops": (lambda m, r: r.loops["pin_2"].force, lambda x: x.shape == (21, 3)),
    "run.joint(..).plot()": (lambda m, r: r.joint("knee_1").plot(), lambda x: len(x.lines) == 1),
    "run.deviation.plot()": (lambda m, r: r.deviation_from(r).plot(), lambda x: len(x) == 2),
    "robot.joints": (lambda m, r: m.joints["motor_1"].motor, lambda x: x is True),
    "robot.frames": (lambda m, r: m.frames, lambda x: x == ("platform",)),
    "robot.links": (lambda m, r: m.links["crank_1"].name, lambda x: x == "crank_1"),
    "robot.with_()": (
        lambda m, r: m.with_({"flexible.*.section.thickness": 2e-3}, "gravity.2=-1.62"),
        lambda x: x.description.gravity[2] == -1.62,
    ),
    "pf.check(robot)": (lambda m, r: str(pf.check(m, 2)), lambda x: "mobility" in x),
    "motion(t)": (lambda m, r: MOVE(0.05), lambda x: x == pytest.approx([0.1], abs=1e-15)),
    "motion([t, ..])": (lambda m, r: MOVE([0.0, 0.05, 0.1]), lambda x: x.shape == (3, 1)),
    "motion.plot()": (lambda m, r: MOVE.plot(), lambda x: len(x) == 3),
    "list(table)": (lambda m, r: list(TABLE), lambda x: x == ["a", "b"]),
    "dict(table)": (lambda m, r: dict(TABLE)["a"].tolist(), lambda x: x == [1.0, 2.0]),
}


@pytest.mark.parametrize("guess", GUESSES)
def test_the_natural_guess_works(guess: str, robot: pf.Mechanism, run: pf.Result, plt: Any) -> None:
    ask, right = GUESSES[guess]
    assert right(ask(robot, run))


@pytest.mark.parametrize(
    ("guess", "word"),
    [("linearize", "linearise"), ("frf", "frequency_response"), ("simulate", "solve"),
     ("optimize", "design"), ("static_equilibrum", "static_equilibrium")],
)  # fmt: skip
def test_a_word_of_another_toolkit_is_answered_with_ours(guess: str, word: str) -> None:
    with pytest.raises(AttributeError, match=rf"no attribute '{guess}'. Did you mean pf.{word}\?"):
        getattr(pf, guess)
    assert not hasattr(pf, "__wrapped__") and not hasattr(pf, "of_no_meaning")
    from pinflex import _MEANT

    assert {*_MEANT.values()} <= {*pf.__all__} and not {*_MEANT} & {*pf.__all__}


def test_names_complete_in_a_notebook(robot: pf.Mechanism, run: pf.Result) -> None:
    for names in (robot.joints, robot.links, run.joints, run.frames, run.links, run.loops):
        offered = names._ipython_key_completions_()
        assert offered and names[offered[0]].name == offered[0]
    assert "torque" in run._ipython_key_completions_()
    assert run.links[0] == "distal_1" and run.links == tuple(run.links) and len(run.links[:2]) == 2
    assert pickle.loads(pickle.dumps(run.links)) == tuple(run.links)
    for wrong in (lambda: run.joints["motr_1"], lambda: robot.links["crank1"]):
        with pytest.raises(DescriptionError, match="Did you mean"):
            wrong()
    robot_dir = dir(run)
    assert {"joints", "plot", "to_pandas"} <= set(robot_dir)


def test_with_gives_a_new_mechanism_and_keeps_own_bodies(robot: pf.Mechanism) -> None:
    thicker = robot.with_({"flexible.*.section.thickness": np.float64(4e-3)})
    assert thicker.parts["distal_1"].spec.section.A > robot.parts["distal_1"].spec.section.A
    body = robot.parts["distal_1"].bodies[0]
    own = pf.load("3rrr", bodies={"distal_1": body}).with_("gravity.2=-1.62")
    assert own.parts["distal_1"].bodies[0] is body


def test_a_plot_takes_axes_and_gives_them_back(run: pf.Result, plt: Any) -> None:
    figure, axes = plt.subplots(4)
    assert run.plot("torque", ax=axes[0]) is axes[0]
    assert run.links["distal_1"].plot(ax=axes[1]) is axes[1]
    assert run.plot_spectrum("torque/motor_1", ax=axes[2]) is axes[2]
    assert run.frames["platform"].plot(ax=axes[3]) is axes[3]
    assert plt.get_fignums() == [figure.number]  # no other figure was opened
    torque = axes[0].lines[0]
    assert np.array_equal(torque.get_ydata(), run.torque[:, 0])
    assert axes[0].get_ylabel() == "torque [N m]"
    with pytest.raises(DescriptionError, match="a map for each link"):
        run.plot("stress", ax=axes[0])


def test_a_plot_without_axes_is_pyplots(run: pf.Result, plt: Any) -> None:
    ax = run.plot("frame/platform")
    assert plt.gcf() is ax.figure  # so that a notebook shows it
    assert [line.get_label() for line in ax.lines] == ["x", "y", "z"]
    assert len(run.plot("stress")) == 4  # three links and the scale of colours
    assert run.loops["pin_2"].plot().get_ylabel() == "force pin_2 [N]"


def test_importing_pinflex_imports_no_matplotlib() -> None:
    code = (
        "import sys, pinflex as pf; r = pf.solve(pf.load('3rrr'), level='rigid', samples=21)\n"
        "repr(r), r._repr_html_(), r.joints\n"
        "assert not {'matplotlib', 'pandas', 'xarray', 'tqdm'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_run_as_pandas_has_units(run: pf.Result) -> None:
    pytest.importorskip("pandas")
    frame = run.to_pandas()
    assert frame.index.name == "t" and np.array_equal(frame.index, run.t)
    assert np.array_equal(frame["torque motor_2"], run.torque[:, 1])
    assert frame.attrs["units"]["torque motor_2"] == "N m"
    assert frame.attrs["units"]["t"] == "s"
    table = TABLE.to_pandas()
    assert list(table.columns) == ["a", "b"] and table.attrs["units"] == {"a": "m"}


def test_a_run_as_xarray_has_names_and_units(run: pf.Result) -> None:
    pytest.importorskip("xarray")
    data = run.to_xarray()
    assert {key.replace("/", ".") for key in run.arrays} - set(data.variables) == {
        f"link.{name}.x"
        for name in run.links  # the coordinate of each link
    }
    assert np.array_equal(data.torque.sel(motor="motor_2"), run.torque[:, 1])
    assert data.torque.attrs["units"] == "N m"
    x = data["frame.platform.position"].sel(xyz="x")
    assert np.array_equal(x, run.frame("platform").position[:, 0])
    v = data["link.distal_1.deflection"].sel(displacement="v")
    assert np.array_equal(v, run.link("distal_1").deflection[:, :, 1])
    assert np.array_equal(v["link.distal_1"], run.link("distal_1").x)


@pytest.mark.parametrize("name, call", [("pandas", "to_pandas"), ("xarray", "to_xarray")])
def test_a_library_that_is_not_there_is_named(
    name: str, call: str, run: pf.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(PinflexError, match=f"{call} needs {name}.*pip install {name}"):
        getattr(run, call)()


def test_compare_gives_runs_table_and_figures(robot: pf.Mechanism, plt: Any, tmp_path: Any) -> None:
    short = robot.with_("solve.until=0.02", "solve.samples=21", "solve.dt=1e-3")
    done = pf.compare(short, levels=["ked"], folder=tmp_path)
    assert [*done.runs] == ["rigid", "ked"]
    assert done["ked"].level == "ked" and "ked" in done._repr_html_()
    assert len(done._repr_html_()) < 20_000 and len(repr(done)) < 200
    assert {"torques", "deviation_ked"} <= done.figures.keys()
    assert len(done.plot("deviation")) == 2
    assert {path.name for path in done.files} >= {"comparison.json", "3rrr-ked.npz"}
    assert all(path.is_file() and path.parent == tmp_path for path in done.files)
    with pytest.raises(DescriptionError, match="no such figure"):
        done.plot("wrong")


def test_compare_takes_a_motion(robot: pf.Mechanism) -> None:
    short = robot.with_("solve={level: coupled, samples: 11, dt: 1e-3}")
    done = pf.compare(short, pf.quintic(joints={"motor_1": 0.1}, duration=0.03), ["ked"])
    assert done["ked"].t[-1] == pytest.approx(0.03) and done.files == ()
    q = done["rigid"].joint("motor_1").position
    assert q[-1] - q[0] == pytest.approx(0.1, abs=1e-9)


def test_progress_is_a_bar_or_a_function(
    robot: pf.Mechanism, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[int, int]] = []
    keys: dict[str, Any] = KEYS | {"dt": 5e-5}
    quiet = pf.solve(robot, level="coupled", **keys, progress=lambda k, n: told.append((k, n)))
    assert told and told[-1][0] <= told[-1][1]
    assert capsys.readouterr().err == ""
    pf.solve(robot, level="coupled", **keys, progress=False)
    assert capsys.readouterr().err == ""
    for present in (True, False):  # with tqdm, and with the bar of the commands
        if not present:
            monkeypatch.setitem(sys.modules, "tqdm.auto", None)
            monkeypatch.setattr("pinflex.progress._PAUSE", 0.0)
        shown = pf.solve(robot, level="coupled", **keys, progress=True)
        assert "coupled" in capsys.readouterr().err
        assert np.array_equal(shown.torque, quiet.torque)


def test_every_long_call_takes_progress_true(
    robot: pf.Mechanism, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    monkeypatch.setattr("pinflex.progress._PAUSE", 0.0)
    vary = ["flexible.*.section.thickness"]
    calls = {
        "sweep": lambda x: pf.sweep(
            robot, {"solve.samples": [5, 6]}, level="rigid", outputs=["torque"], progress=x
        ),
        "pose_map": lambda x: pf.pose_map(robot, {"x": [0.0, 0.01]}, count=2, progress=x),
        "sensitivities": lambda x: pf.sensitivities(robot, vary, ["mass"], progress=x),
    }
    for name, call in calls.items():
        call(False)
        assert capsys.readouterr().err == "", name
        call(True)
        said = capsys.readouterr().err
        assert said.startswith(f"\r{name[:12]}") and said.endswith("\r\x1b[K"), name


def test_solve_names_its_options(robot: pf.Mechanism) -> None:
    import inspect

    known = inspect.signature(pf.solve).parameters
    assert {*OPTIONS, "tolerance", "control", "progress"} <= known.keys()
    assert not any(p.kind is p.VAR_KEYWORD for p in known.values())
    with pytest.raises(DescriptionError, match='tolerence: no such option. Did you mean "toler'):
        pf.solve(robot, tolerence=1e-3)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="missing 1 required positional"):
        pf.solve()  # type: ignore[call-arg]


_THICK = "flexible.*.section.thickness"


@pytest.mark.parametrize(
    "call, said",
    [
        ("sweep(robot, 5)", "sweep: parameters: 5 does not fit. Give {text: anything};"),
        ("sweep(robot, {THICK: [1e-3]}, outputs=None)", "outputs: None does not fit. Give [text,"),
        ("solve(robot, 'coupled')", "solve: motion: 'coupled' does not fit. Give Motion or None;"),
        ("command(robot, 3)", "command: motion: 3 does not fit. Give Motion or None;"),
        ("solve(3)", "solve: mechanism: 3 does not fit. Give Mechanism or Description or"),
        ("solve(robot, control=3)", "control: 3 does not fit. Give Control or True or False or "),
        ("view(robot)", "does not fit. Give Result or {text: Result};"),
        ("design(robot, 'mass', ())", "design: nothing varies. Give (low, high) by key path"),
        ("design(robot, 'mass', {})", "design: nothing varies. Give (low, high) by key path"),
        ("design(robot, 'mass', True)", "vary: True does not fit. Give {text: (number, number)};"),
        ("design(robot, 'mass', 1e-3)", "vary: 0.001 does not fit. Give {text: (number, number)}"),
        ("design(robot, 'mass', {THICK: 3.0})", f"vary['{_THICK}']: 3.0 does not fit. Give (num"),
        ("design(robot, 'mass', {THICK: (1,)})", f"vary['{_THICK}']: (1,) does not fit. Give ("),
        ("design(robot, 'mass', {}, choose={THICK: 5})", "5 does not fit. Give [{text: number} or"),
        ("fit(robot, {'frequency': [1.0]}, {THICK: 'ab'})", "'ab' does not fit. Give (number, num"),
        ("fit(robot, {'frequency': [1.0]}, {THICK: 5})", "Give (number, number) or None; help(pin"),
        ("sensitivities(robot, by=5)", "by: 5 does not fit. Give [text, ...]; help(pinflex.sensi"),
        ("frequency_response(robot, outputs=0)", "outputs: 0 does not fit. Give [text, ...]; hel"),
        ("frequency_response(robot, span=(1,))", "span: (1,) does not fit. Give (number or None,"),
    ],
)
def test_an_argument_of_a_wrong_kind_is_told_the_right_one(
    robot: pf.Mechanism, call: str, said: str
) -> None:
    with pytest.raises(DescriptionError, match=re.escape(said)):
        eval(f"pf.{call}", {"pf": pf, "robot": robot, "THICK": _THICK})


def test_a_fault_of_the_code_is_not_laid_on_arguments_that_fit() -> None:
    @public
    def broken(x: float, some: Sequence[str] = (), more: Mapping[str, int] | None = None) -> None:
        raise AttributeError("a fault inside")

    for fits in ((1, "a"), (np.float64(1.0), iter("a"), {"b": np.int64(2)}), (2.0, ["c"], None)):
        with pytest.raises(AttributeError, match="a fault inside"):
            broken(*fits)
    with pytest.raises(DescriptionError, match=re.escape("more['b']: 0.5 does not fit")):
        broken(1.0, (), {"b": 0.5})  # type: ignore[dict-item]


SLIP = """
import pinflex as pf
robot = pf.load("3rrr")
pf.solve(robot, level="quasi")
"""


def test_a_traceback_shows_the_users_line_and_the_message(tmp_path: Any) -> None:
    script = tmp_path / "slip.py"
    script.write_text(SLIP)
    lines = {}
    for wish in ("", "full"):
        told = subprocess.run(
            [sys.executable, str(script)], env={**_environment(), VARIABLE: wish},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert told.returncode == 1
        lines[wish] = told.stderr.splitlines()
        assert 'pf.solve(robot, level="quasi")' in told.stderr
        assert "Did you mean" in lines[wish][-1]
    assert len(lines[""]) <= 7 < len(lines["full"])


def test_ipython_shows_a_short_traceback_too(
    robot: pf.Mechanism, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shell = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell
    monkeypatch.delenv(VARIABLE, raising=False)
    cell = shell()
    cell.colors = "nocolor"
    cell.user_ns |= {"pf": pf, "robot": robot}
    cell.run_cell('pf.solve(robot, level="quasi")')
    said = capsys.readouterr().out
    assert "Did you mean" in said and len(said.splitlines()) < 15


def test_an_error_keeps_its_data_and_its_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(PinflexError) as caught:
        pf.load("no-such-model")
    assert caught.value.__suppress_context__ and caught.value.__cause__ is None
    frames = []
    here = caught.value.__traceback__
    while here is not None:
        frames.append(here.tb_frame.f_code.co_name)
        here = here.tb_next
    assert frames[-1] == "called" and len(frames) == 2


def _environment() -> dict[str, str]:
    import os

    return dict(os.environ)


def test_functions_of_a_mechanism_take_a_name_or_a_path() -> None:
    by_name, by_path = pf.solve("cantilever", level="rigid"), pf.solve(mechanism="cantilever")
    assert by_name.meta["name"] == by_path.meta["name"] == "cantilever"
    path = Path(__file__).parents[2] / "models" / "cantilever"
    assert pf.modes(path).frequencies == pytest.approx(pf.modes("cantilever").frequencies)
    assert pf.check("cantilever").name == "cantilever"
    with pytest.raises(DescriptionError, match='Did you mean "cantilever"'):
        pf.modes("cantilevr")


def test_the_version_and_public_names_alone() -> None:
    assert pf.__version__
    assert {*dir(pf)} == {*pf.__all__, "__version__"}


@pytest.mark.parametrize(
    "guess, meant",
    [("time", "run.t"), ("platform", "run.frame('platform')"), ("torqe", "run.torque")],
)
def test_a_guessed_attribute_of_a_run_is_answered(run: pf.Result, guess: str, meant: str) -> None:
    with pytest.raises(AttributeError, match=re.escape(f"Did you mean {meant}?")):
        getattr(run, guess)
    assert not hasattr(run, "_repr_png_")  # what a notebook asks for has no hint and is not there


def test_modes_print_their_frequencies() -> None:
    text = str(pf.modes("3rrr", count=2))
    assert "103.4" in text
    assert " 0 %" not in text


def test_the_motion_of_a_yaml_is_at_hand_as_it_is_shaped() -> None:
    robot = pf.load("ur5", ["motion.shaper=zvd", "solve.until=null"])
    assert robot.motion.duration == pf.solve(robot, level="rigid", samples=5).t[-1]
    assert robot.motion.duration > pf.load("ur5").motion.duration
