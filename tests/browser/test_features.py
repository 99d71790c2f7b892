"""What the page offers: the rigid ghost, plots, loop, limit, deviation, links that slide.

Claims:
    Pages, pictures, figures
    - the page of a command tells the distance from the wanted path, in the coordinates imposed |
      exact | race_r2: 3.71e-4 um, as its table | also `cli/test_command_line.py`
"""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.results.result import Result
from pinflex.results.views import Deviation
from pinflex.viewer.curves import with_rigid_torque
from pinflex.viewer.scene import build_scene, build_scenes
from pinflex.viewer.view import write_html
from tests.browser.chromium import Browser
from tests.synthetic import synthetic_result

# [px] its x in the plot
CURSOR = (
    "return new DOMMatrix(getComputedStyle(document.querySelector('#plots .cursor')).transform).e"
)


def test_the_rigid_robot_is_overlaid_beside_or_hidden(browser: Browser, page: Path) -> None:
    browser.open(page, "t=0.03&peak=0&path=0&names=0")
    shown = {g: browser.pixels(f"pinflex.set({{ghost: '{g}'}})") for g in ("off", "over", "beside")}
    for one, other in (("off", "over"), ("over", "beside"), ("off", "beside")):
        assert np.mean(np.any(shown[one] != shown[other], axis=2)) > 0.003
    texts = {
        g: browser.run(
            f"pinflex.set({{ghost: '{g}'}}); return document.getElementById('keys').innerText"
        )
        for g in shown
    }
    assert "rigid mechanism" in texts["over"]
    assert "rigid mechanism" not in texts["off"]
    browser.driver.find_element("tag name", "body").send_keys("g")  # off after beside
    assert browser.run("return pinflex.state.ghost") == "off"


def test_the_plots_show_the_values_at_the_cursor_and_a_click_moves_it(
    browser: Browser, page: Path, run: Result
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser.open(page)
    places = []
    for k in (0, 30, 60, 120):
        browser.run("pinflex.seek(arguments[0])", run.t[k])
        places.append(browser.run(CURSOR))
        told = browser.run(
            "return [...document.querySelectorAll('#plots figure')].map(f =>"
            " [...f.querySelectorAll('.values span')].map(s => s.textContent))"
        )
        torques = [float(text.split()[-1].replace("\u2212", "-")) for text in told[0]]
        assert torques == pytest.approx(run.torque[k], rel=6e-3, abs=1e-3)  # three digits
        stress = [float(text.split()[-1]) for text in told[2]]
        largest = [1e-6 * run.link(n).von_mises[k].max() for n in run.links]
        assert stress == pytest.approx(largest, rel=6e-3, abs=1e-3)
    steps = np.diff(places) / np.diff(run.t[[0, 30, 60, 120]])
    assert steps == pytest.approx(np.full(3, steps[0]), rel=1e-3)
    svg = browser.driver.find_element("css selector", "#plots svg")
    box = browser.run("const r = arguments[0].getBoundingClientRect(); return [r.width]", svg)
    ActionChains(browser.driver).move_to_element_with_offset(svg, 0, 0).click().perform()
    middle = browser.run(CURSOR)
    assert middle == pytest.approx(box[0] / 2, abs=2)


def test_rigid_torques_are_dashed_beside_the_flexible_ones(
    browser: Browser, page: Path, run: Result
) -> None:
    browser.open(page)
    curves = "return document.querySelectorAll('#plots figure:first-child .curve').length"
    assert browser.run(curves) == 6
    assert browser.run("return document.querySelectorAll('#plots .curve.rigid').length") == 3
    assert "rigid" in browser.run("return document.querySelector('#plots .dash').textContent")
    both = with_rigid_torque(run, synthetic_result("rigid", samples=61))  # fewer instants
    curves_kept = build_scene(both)["plots"][0]["curves"]
    rigid = [c["y"] for c in curves_kept if c["rigid"]]
    assert np.stack(rigid, axis=1)[::2] == pytest.approx(
        synthetic_result("rigid", samples=61).torque
    )


def test_the_deviation_of_the_platform_is_told_in_its_unit(
    browser: Browser, page: Path, run: Result
) -> None:
    away = run.deviation_from(synthetic_result("rigid", samples=121), "platform")
    browser.open(page, f"t={run.t[25]}")
    text = browser.run("return document.getElementById('readout').innerText")
    told = text.split("platform: ")[1]
    assert float(told.split(" mm")[0]) == pytest.approx(
        1e3 * np.linalg.norm(away.position[25]), rel=5e-3
    )
    assert float(told.split("mm, ")[1].split(" mrad")[0]) == pytest.approx(
        1e3 * np.linalg.norm(away.rotation[25]), rel=5e-3
    )


def test_of_a_wanted_path_the_distance_from_it_is_told(run: Result) -> None:
    """A command imposes some coordinates; the rigid mechanism may be off in the others."""
    rigid, n = synthetic_result("rigid", samples=121), len(run.t)
    imposed = Deviation(run.t, np.linspace(0, 2e-6, 3 * n).reshape(n, 3), np.zeros((n, 3)))
    told, alone = build_scenes([run, run], rigid, off_path=[imposed, None])
    assert told["track"]["deviation"] == pytest.approx(imposed.norm)
    assert told["track"]["unit"] == "µm"
    titles = [
        [p["title"] for p in scene["plots"] if "off" in p["title"]] for scene in (told, alone)
    ]
    assert titles == [["platform off path"], ["platform off rigid"]]
    assert told["largest"] == pytest.approx(alone["largest"], rel=0.5)  # the drawing is the same


def test_without_loop_it_stops_at_the_end_and_starts_again_from_there(
    browser: Browser, page: Path
) -> None:
    browser.open(page, "speed=0.5&loop=0&play=1")
    for _ in range(60):
        if not browser.run("return pinflex.state.play"):
            break
        time.sleep(0.1)
    assert browser.run("return pinflex.state.t") == pytest.approx(0.2)
    browser.run("pinflex.set({speed: 0.05, play: true})")  # 3 s to 0.15, on a busy machine too
    assert browser.run("return pinflex.state.t") < 0.15


def test_the_limit_of_the_material_is_on_the_legend_of_its_page(
    browser: Browser, run: Result, tmp_path: Path
) -> None:
    links = {
        name: {**about, "material": {**about["material"], "yield_strength": 1e6 * (20 + i)}}
        for i, (name, about) in enumerate(run.meta["links"].items())
    }
    known = dataclasses.replace(run, meta={**run.meta, "links": links})
    browser.open(write_html(known, tmp_path / "limit.html"))
    keys = "return document.getElementById('keys').innerText"
    assert "limit 20.0 MPa" in browser.run(keys)  # the lowest of the links
    browser.open(write_html(known, tmp_path / "own.html", limit=5e8))
    assert "limit 500 MPa" in browser.run(keys)


def test_a_smaller_maximum_says_what_the_run_has(browser: Browser, page: Path) -> None:
    browser.open(page)
    whole = browser.run("return pinflex.legend.max")
    browser.run("pinflex.set({max: arguments[0]})", whole / 2)
    assert browser.run("return pinflex.legend.max") == pytest.approx(whole / 2)
    assert "run maximum" in browser.run("return document.getElementById('keys').innerText")
    ticks = browser.run(
        "return [...document.querySelectorAll('#ticks span')].map(s => s.innerText)"
    )
    assert float(ticks[0]) == pytest.approx(whole / 2, rel=5e-3)  # the end itself


def test_a_joint_that_only_the_urdf_calls_fixed_moves() -> None:
    """The legs of the 3-TPT hang on universal joints that its YAML makes of fixed ones."""
    result = pf.solve(pf.load("3tpt"), level="quasistatic", samples=5, until=0.4)
    bodies = {b["name"]: b for b in build_scene(result)["bodies"]}
    assert len(bodies["base"]["points"]) == 3
    for leg in (1, 2, 3):
        turned = bodies[f"swing_{leg}"]["rigid"].reshape(-1, 3, 4)[:, :, :3]
        assert np.ptp(turned, axis=0).max() > 0.01


def test_a_place_on_a_link_is_no_body_and_a_platform_on_one_is() -> None:
    """The URDF of the 3-RRS fixes its platform to a link; its YAML makes that a ball joint."""
    spatial = pf.solve(pf.load("3rrs"), level="quasistatic", samples=3, until=0.1)
    assert [b["frame"] for b in build_scene(spatial)["bodies"] if b["platform"]] == [False]
    beam = pf.solve(
        pf.load("prprp", ["flexible.beam.basis.modes=4"]), level="ked", samples=3, until=2e-3
    )
    frames = {b["name"]: b["frame"] for b in build_scene(beam)["bodies"]}
    assert frames["tip"] is True
    assert frames["carriage_1"] is False


def test_a_sliding_link_has_rails_as_long_as_its_way() -> None:
    slide = pf.solve(pf.load("prprp", ["flexible.beam.basis.modes=4"]), level="rigid", samples=5)
    base = next(b for b in build_scene(slide)["bodies"] if b["base"])
    ends = np.array(base["rails"])
    assert ends.shape == (2, 2, 3)
    assert np.ptp(ends[:, :, 2], axis=1) == pytest.approx([0.3, 0.3])  # 0.3 t^2 over 1 s
    assert sorted(ends[:, 0, 0]) == pytest.approx([0.0, 0.18])


@pytest.fixture(scope="module")
def hexapod() -> Result:
    return pf.solve(pf.load("hexapod"), level="quasistatic", samples=3)


def test_what_slides_out_of_a_leg_has_a_line_to_where_it_started(hexapod: Result) -> None:
    """Its start and its end lie on the axis of the slider, as far apart as the motor has moved."""
    bodies = {b["name"]: b for b in build_scene(hexapod)["bodies"]}
    for k in range(1, 7):
        ((start, child),) = bodies[f"cylinder_{k}"]["stems"]
        assert child == f"rod_{k}"
        pose = hexapod.arrays[f"body/cylinder_{k}/pose"]
        way = hexapod.link(child).centreline[:, 0] - (pose[:, :, :3] @ start + pose[:, :, 3])
        out = hexapod.joint(f"slide_{k}").position[:, None] * pose[:, :, 2]  # along its z
        assert way == pytest.approx(out, abs=1e-12)  # [m], lengths of 1 m rounded
    assert all(not b["stems"] for name, b in bodies.items() if not name.startswith("cylinder"))


def test_the_page_draws_that_line_as_the_leg_moves(
    browser: Browser, hexapod: Result, tmp_path: Path
) -> None:
    browser.open(write_html(hexapod, tmp_path / "hexapod.html"), "mag=1")
    for k, t in enumerate(hexapod.t):
        browser.run("pinflex.seek(arguments[0])", float(t))
        lines = np.array(browser.run("return pinflex.stems")).reshape(6, 2, 3)
        roots = [hexapod.link(f"rod_{n}").centreline[k, 0] for n in range(1, 7)]
        assert lines[:, 1] == pytest.approx(np.array(roots), abs=1e-6)  # 32 bits of 1 m
        moved = [abs(hexapod.joint(f"slide_{n}").position[k]) for n in range(1, 7)]
        assert np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) == pytest.approx(moved, abs=1e-6)
