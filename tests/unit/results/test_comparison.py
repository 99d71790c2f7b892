"""The comparison table holds the numbers of the results, and always fits its page.

Claims:
    Pages, pictures, figures
    - a motor that idles is judged by a thousandth of what its joint bears | by hand: 1e-6 | passes
      (a Panda's closed gripper: 3.1e12 % before)
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from pinflex.errors import DescriptionError
from pinflex.results.comparison import comparison
from pinflex.results.result import Result, peak, rms
from pinflex.results.verdict import criterion, platform_allowed
from tests.synthetic import synthetic_result


@pytest.fixture(scope="module")
def flexible() -> Result:
    return synthetic_result()


@pytest.fixture(scope="module")
def rigid() -> Result:
    return synthetic_result("rigid")


def test_the_comparison_holds_the_numbers_of_the_arrays(rigid, flexible):
    table = comparison(rigid, {"coupled": flexible}, frequencies=range(10, 100, 10), first=4)
    row = table.torques[1]
    difference = flexible.torque[:, 1] - rigid.torque[:, 1]
    assert (row.motor, row.level, row.unit) == ("motor_2", "coupled", "N m")
    assert row.max_difference == peak(difference)
    assert row.rms_percent == pytest.approx(100 * rms(difference) / peak(rigid.torque[:, 1]))
    platform = table.platform[0]
    deviation = flexible.deviation_from(rigid)
    assert platform.position == deviation.max()
    assert platform.position_time == flexible.t[np.argmax(deviation.norm)]
    stress = table.stresses[0]
    assert (stress.link, stress.fraction) == (
        "distal_1",
        pytest.approx(0.5),
    )  # half a sine peaks at mid-span
    link = flexible.link("distal_1")
    assert stress.x == pytest.approx(link.length / 2) and stress.von_mises == peak(link.von_mises)
    assert link.von_mises[list(flexible.t).index(stress.time)].max() == stress.von_mises
    assert stress.von_mises == peak(flexible.link("distal_1").von_mises)
    assert table.frequencies == (10.0, 20.0, 30.0, 40.0)
    assert [c.level for c in table.costs] == ["rigid", "coupled"]


def test_the_comparison_of_a_run_with_itself_is_zero(flexible):
    table = comparison(flexible, {"same": flexible})
    assert {row.max_difference for row in table.torques} == {0.0}
    assert {row.rms_percent for row in table.torques} == {0.0}
    assert table.platform[0].position == 0.0


def test_no_percentage_is_given_of_a_motor_at_rest(rigid, flexible):
    idle = rigid.torque * [1.0, 0.0, 1e-15]
    still = replace(rigid, arrays={**rigid.arrays, "torque": idle})
    table = comparison(still, {"coupled": flexible})
    assert [row.max_percent is None for row in table.torques] == [False, True, True]
    assert json.loads(table.to_json())["torques"][1]["max_percent"] is None
    assert " -" in table.text()


def test_the_table_fits_100_columns_of_ascii_whatever_the_names(rigid, flexible):
    long = [f"a_very_long_motor_name_of_the_left_arm_{i}" for i in range(3)]

    def renamed(run: Result) -> Result:
        wild = {**run.arrays, "torque": run.torque * [1e-5, 1e8, 1.2345]}
        return replace(run, arrays=wild, meta={**run.meta, "actuated": long})

    runs = {"coupled with 8 segments": renamed(flexible)}
    text = comparison(renamed(rigid), runs, [1.0]).text()
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 100
    assert all(f"m_{i} " in text for i in range(3))  # the number at the end survives shortening


def test_the_json_has_stable_keys_and_si_units(rigid, flexible):
    data = json.loads(comparison(rigid, {"coupled": flexible}).to_json())
    assert list(data) == [
        *("name", "torques", "platform", "stresses", "frequencies", "costs"),
        *("frequency_note", "notes", "unsolved"),
        *("residuals", "band", "levels", "verdict", "start", "falls", "drives", "tol"),
    ]
    assert data["stresses"][0]["von_mises"] > 1e6  # Pa
    assert 1e-4 < data["platform"][0]["position"] < 1e-3  # m


def stopped(run: Result, away: float) -> Result:
    """The run, but the platform moves for 0.1 s and then, if flexible, circles at `away` [m]."""
    t, position = run.t, np.zeros((len(run.t), 3))
    position[:, 0] = 0.1 * np.clip(t / 0.1, 0, 1)
    swing = away * np.exp(-10 * (t - 0.1)) * (t >= 0.1)
    position[:, :2] += swing[:, None] * np.stack([np.cos(400 * t), np.sin(400 * t)], axis=1)
    arrays = {**run.arrays, "frame/platform/position": position}
    return replace(run, arrays=arrays)


def test_the_verdict_says_in_words_what_the_numbers_are(rigid, flexible):
    table = comparison(
        stopped(rigid, 0.0),
        {"coupled": stopped(flexible, 4e-4)},
        [36.2],
        yield_strengths={"distal_1": 1e9},
        stop=0.1,
        band=2e-4,
    )
    (row,) = table.residuals
    assert row.amplitude == pytest.approx(4e-4, rel=0.02)  # rest is found from six periods
    assert row.settling == pytest.approx(np.log(2) / 10, abs=2e-3)
    words = " ".join(table.brief().split())
    off = max(r.max_difference for r in table.torques)
    for said in (
        "Frame platform deviates from the rigid motion by up to 0.4 mm",
        "after the stop it still shakes by 0.4 mm and settles to 0.2 mm in 0.0",
        f"Motor torques differ from rigid by up to {off:.3g} N m",
        "First resonance: 36.2 Hz",
        "No simpler level than coupled suffices",
    ):
        assert said in words


def test_after_a_stop_that_never_comes_nothing_is_said_of_settling(rigid, flexible):
    moving = comparison(rigid, {"coupled": flexible}, stop=0.05)  # the move takes 0.1 s
    assert moving.residuals == ()
    assert "after the stop" not in moving.verdict
    short = comparison(stopped(rigid, 0), {"coupled": stopped(flexible, 1e-3)}, [60.0], stop=0.1)
    assert "does not settle to 50 um within 0.1 s" in short.verdict


def test_the_simplest_level_that_suffices_is_named_and_the_others_say_what_they_miss(
    rigid, flexible
):
    half = replace(flexible, arrays={**flexible.arrays, "torque": 0.9 * flexible.torque})
    table = comparison(rigid, {"quasistatic": half, "ked": flexible, "coupled": flexible})
    assert [row.suffices for row in table.levels] == [False, False, True, True]
    assert table.levels[1].torque_off == pytest.approx(0.1)
    assert "misses torque 10 %" in table.brief()
    assert "The simplest level that suffices is ked." in table.verdict
    runs = {"ked": flexible, "coupled": flexible}
    for seconds, words in ((4.9, "suffices is ked."), (5.1, "ked, though it costs far more")):
        assert words in comparison(rigid, runs, cpu={"ked": seconds, "coupled": 1.0}).verdict


def test_a_row_has_one_base_and_the_screen_its_criterion(rigid, flexible):
    half = replace(flexible, arrays={**flexible.arrays, "torque": 0.9 * flexible.torque})
    runs = {"quasistatic": half, "coupled": flexible}
    table = comparison(rigid, runs)
    first, last = table.levels[0], table.levels[-1]
    assert last.torque_percent == 100 * first.torque_off  # one difference, seen from both ends
    off = peak(flexible.torque - rigid.torque) / peak(flexible.torque)
    assert last.torque_percent == pytest.approx(100 * off, rel=1e-12)
    assert f"Suffices: {criterion()}." in table.brief()
    wide = comparison(rigid, runs, tol=0.15, band=1e-4)
    assert wide.levels[1].suffices and not table.levels[1].suffices  # 10 % off
    assert "torque within 15 % of the coupled peak, platform within 0.1 mm or 15 %" in wide.brief()


def test_what_a_start_in_equilibrium_sags_is_told_apart_from_what_shakes(rigid, flexible):
    def moved(away: np.ndarray) -> Result:
        place = rigid.frame("platform").position + away[:, None] * [0.0, 0.0, 1.0]
        return replace(flexible, arrays={**flexible.arrays, "frame/platform/position": place})

    ramp = np.linspace(0.0, 1.0, len(rigid.t))
    sags = comparison(rigid, {"coupled": moved(3e-4 + 1e-4 * ramp)}).verdict
    assert "deviates from the rigid motion by up to 0.4 mm (0.3 mm of it static sag)" in sags
    most = comparison(rigid, {"coupled": moved(9e-4 + 1e-4 * ramp)}).verdict
    assert "1 mm (0.9 mm of it static sag, from which it moves by up to 0.1 mm)" in most
    assert "sag" not in comparison(rigid, {"coupled": moved(4e-4 * ramp)}).verdict


def gripper(run: Result, force: float, weight: float) -> Result:
    """The run with its third motor a finger: its force and the weight that its joint bears [N]."""
    arrays = {**run.arrays, "torque": run.torque.copy()}
    arrays["torque"][:, 2] = force
    arrays["reaction/motor_3"] = np.tile([0.0, 0.0, weight, 0.0, 0.0, 0.0], (len(run.t), 1))
    units = {**run.meta.get("units", {}), "torque/motor_3": "N"}
    return replace(run, arrays=arrays, meta={**run.meta, "units": units})


@pytest.mark.parametrize(
    ("force", "weight", "off"),
    [
        (1e-18, 0.15, 0.0),  # round-off of the one motor in newtons: 1e-18 of 1e-18 N is nothing
        (1e-8, 0.15, 1e-8 / 1.5e-4),  # a thousandth of the weight is what friction takes
        (0.15, 0.15, 2.0),  # a finger that works is judged by its own force
    ],
)
def test_a_motor_that_idles_is_judged_by_what_its_joint_bears(rigid, flexible, force, weight, off):
    runs = {
        "ked": gripper(flexible, -force, weight),
        "coupled": gripper(flexible, force, weight),
    }
    rows = comparison(gripper(rigid, 0.0, weight), runs).levels
    assert rows[1].torque_off == pytest.approx(2 * off if off < 1 else off, rel=1e-6, abs=1e-12)
    assert rows[1].suffices == (off < 0.05)


def test_a_level_alone_is_not_judged(rigid):
    text = comparison(rigid, {}).text()
    assert "alone: not judged" in text and "suffices" not in text


def test_one_screen_holds_the_answer_however_much_there_is_to_note(rigid, flexible):
    notes = [f"note {i}: " + 30 * "word " for i in range(20)]
    unsolved = {"quasistatic": "no equilibrium. " + 30 * "word ", "ked": 30 * "word "}
    table = comparison(
        rigid, {"coupled": flexible}, [36.2], notes=notes, unsolved=unsolved, start=20 * "word "
    )
    lines = table.brief().splitlines()
    assert len(lines) < 36  # and four for the names of the files
    assert "18 more notes are in comparison.txt." in table.brief()
    assert lines.index(next(x for x in lines if x.startswith("! "))) < 6  # under the verdict
    assert "note 19" in table.text()


def test_runs_of_different_models_are_not_compared(rigid, flexible):
    other = replace(flexible, meta={**flexible.meta, "actuated": ["a", "b", "c"]})
    with pytest.raises(DescriptionError, match="Compare runs of one model"):
        comparison(rigid, {"other": other})


def test_a_platform_may_be_off_by_the_band_or_the_share_whichever_is_more() -> None:
    assert platform_allowed(0.1, 0.05, 50e-6) == pytest.approx(5e-3)  # 5 % of 10 cm
    assert platform_allowed(1e-6, 0.05, 50e-6) == 50e-6
