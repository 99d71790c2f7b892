"""Levels of a comparison on one page: switched, overlaid, side by side, subtracted; verdicts.

Claims:
    Pages, pictures, figures
    - levels are switched at one instant and scale, overlaid, set side by side, subtracted; verdicts
      of a run | 2e-6 m; 1e-4 N m | passes
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pinflex.results.result import Result
from pinflex.viewer.curves import verdicts
from pinflex.viewer.scene import build_scenes
from pinflex.viewer.view import view, write_html
from tests.browser.chromium import Browser
from tests.browser.made_up import FALLEN


@pytest.fixture(scope="session")
def page(levels: dict[str, Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("levels") / "levels.html"
    return write_html(levels, path, first="coupled")


def test_levels_are_switched_by_radio_buttons_and_digits_at_one_instant_and_scale(
    browser: Browser, page: Path
) -> None:
    browser.open(page, "t=0.03&mag=10")
    assert browser.run("return document.querySelector('#levels input:checked').value") == "2"
    labels = "return [...document.querySelectorAll('#levels label')].map(l => l.textContent)"
    assert browser.run(labels) == ["rigid", "quasistatic", "coupled"]
    line = browser.centreline("distal_1")
    browser.driver.find_element("css selector", "#levels label:nth-child(2)").click()
    state = browser.run("return pinflex.state")
    assert (state["run"], state["t"], state["mag"]) == (1, pytest.approx(0.03), 10)
    rigid = np.array(browser.run("pinflex.setMag(0); return pinflex.centreline('distal_1')"))
    other = np.array(browser.run("pinflex.setMag(10); return pinflex.centreline('distal_1')"))
    moved = other.reshape(-1, 3) - rigid.reshape(-1, 3)
    assert 2 * moved == pytest.approx(line - rigid.reshape(-1, 3), abs=2e-6)
    browser.driver.find_element("tag name", "body").send_keys("1")
    assert browser.run("return pinflex.links") == []  # rigid
    assert browser.errors() == []


def test_another_level_is_overlaid_where_it_is(browser: Browser, page: Path) -> None:
    browser.open(page, "t=0.03&mag=10&ghost=over")
    rigid = np.array(browser.run("return pinflex.ghostline('distal_2')"))
    browser.run("pinflex.set({other: '1'})")
    other = np.array(browser.run("return pinflex.ghostline('distal_2')"))
    mine = browser.centreline("distal_2").ravel()
    assert 2 * (other - rigid) == pytest.approx(mine - rigid, abs=2e-6)
    assert np.abs(mine - rigid).max() > 1e-3
    keys = browser.run("return document.getElementById('keys').innerText")
    assert "quasistatic" in keys
    dashed = browser.run("return document.querySelector('#plots .dash').textContent")
    assert "quasistatic" in dashed


def test_the_difference_of_two_levels_is_drawn_and_plotted(
    browser: Browser, page: Path, levels: dict[str, Result]
) -> None:
    browser.open(page, "other=1&diff=1")
    run, half = levels["coupled"], levels["quasistatic"]
    k = 40
    browser.run("pinflex.seek(arguments[0])", run.t[k])
    legend = browser.run("return [pinflex.state.field, pinflex.legend.unit]")
    assert legend == ["difference", "mm"]
    away = (run.array("link/distal_1/centreline")[:100] - half.array("link/distal_1/centreline"))[k]
    shown = browser.run("return pinflex.values('distal_1')")
    assert shown == pytest.approx(1e3 * np.linalg.norm(away, axis=1), abs=2e-4)
    rows = browser.run("return pinflex.curves")
    assert rows[0][:2] == ["t [s]", "Δ motor torque motor_1 [N m]"]
    assert rows[k + 1][1] == pytest.approx(run.torque[k, 0] - half.torque[k, 0], abs=1e-4)
    assert rows[110][1] is None  # the other run has ended there
    assert browser.errors() == []


def test_side_by_side_both_are_coloured_and_named(browser: Browser, page: Path) -> None:
    browser.open(page, "t=0.03&other=1&ghost=beside&peak=0")
    names = "return [...document.querySelectorAll('.mark.title')].map(m => m.textContent)"
    assert browser.run(names) == ["coupled", "quasistatic"]
    plain = browser.pixels()
    other = browser.pixels("pinflex.set({field: 'axial'})")
    changed = np.flatnonzero(np.any(plain != other, axis=2).any(axis=0))
    assert changed.max() - changed.min() > 400  # px: links at the left and at the right


def test_the_share_of_yield_is_shown_to_a_hundred_per_cent(
    browser: Browser, run: Result, tmp_path: Path
) -> None:
    links = {
        name: {**about, "material": {**about["material"], "yield_strength": 4e8}}
        for name, about in run.meta["links"].items()
    }
    known = dataclasses.replace(run, meta={**run.meta, "links": links})
    browser.open(view(known, tmp_path / "yield.html").path, "field=utilisation")
    assert browser.run("return [pinflex.legend.max, pinflex.legend.unit]") == [100, "%"]
    browser.run("pinflex.seek(arguments[0])", run.t[40])
    shown = browser.run("return pinflex.values('distal_1')")
    assert shown == pytest.approx(run.link("distal_1").von_mises[40] / 4e6, rel=2e-4, abs=1e-3)
    said = browser.run("return document.getElementById('keys').innerText")
    assert "run maximum" in said


def test_verdicts_are_on_the_page_and_open_on_a_click(browser: Browser, page: Path) -> None:
    browser.open(page, "run=1")
    chip = browser.driver.find_element("css selector", "#chips .chip.bad")
    assert chip.text == "✕ buckles or falls at 0.165 s"
    chip.click()
    assert chip.text.endswith(FALLEN)
    assert chip.get_attribute("aria-expanded") == "true"


@pytest.mark.parametrize(
    "about, said",
    [
        ({"level": "ked"}, [("plain", "linear")]),
        ({"settings": {"start": "straight"}}, [("plain", "straight start")]),
        (
            {
                "settings": {"start": "straight"},
                "remark": "no equilibrium beyond 0.6 s: it buckles or falls there; "
                "started straight under gravity",
            },
            [
                ("bad", "no equilibrium beyond 0.6 s"),
                ("care", "straight start"),
            ],
        ),
        (
            {
                "grades": {"closure": "good", "energy": "wrong"},
                "warnings": [
                    "keeps the energy balance to 7 % only (wrong). Trust coupled.",
                    "t = 0.7 s: the stiffness is negative (static divergence: they buckle).",
                    "crank_1: deflection is 20 % of the length.",
                ],
            },
            [
                ("bad", "buckles from 0.7 s on"),
                ("bad", "energy balance: wrong"),
                ("care", "crank_1: deflection is 20 % of the length."),
            ],
        ),
        ({}, []),
    ],
)
def test_verdicts_of_a_run(
    run: Result, about: dict[str, object], said: list[tuple[str, str]]
) -> None:
    told = dataclasses.replace(run, meta={**run.meta, "warnings": [], **about})
    assert [(v["kind"], v["text"]) for v in verdicts(told)] == said


def test_runs_of_one_page_have_instants_stations_and_scale_in_common(
    levels: dict[str, Result],
) -> None:
    rigid, half, whole = build_scenes(list(levels.values()), levels["rigid"])
    assert rigid["scale"] == half["scale"] == whole["scale"]
    assert np.array_equal(half["t"], whole["t"][:100])
    for one, other in zip(half["links"], whole["links"], strict=True):
        assert np.array_equal(one["x"], other["x"])
