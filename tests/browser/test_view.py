"""The page as a user meets it: in a real browser, from a file, without a network.

Claims:
    Pages, pictures, figures
    - a page opens at rest where the platform is furthest from rigid; the peak names link, stress,
      share of yield | 1e-7 s; exact | passes
    - no request, no foreign script; names are no markup | - | -
    - magnification is linear; joints stay joined at x200 and between instants | 1e-6 m, 1e-5 m |
      passes
    - legend, values, hover, plots, deviation, worst instant = Result | 1e-6 to 3 digits | passes |
      also `browser/test_features.py`
    - equal pictures at equal times and from equal addresses | pixel by pixel | equal
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from pinflex.results.result import Result
from pinflex.viewer.view import write_html, write_modes_html
from tests.browser.chromium import Browser
from tests.browser.made_up import EVIL, renamed, shape
from tests.synthetic import synthetic_result


def test_the_page_draws_without_an_error_and_asks_nothing_of_the_network(
    browser: Browser, page: Path
) -> None:
    browser.open(page, "t=0.03")
    assert browser.pixels().std() > 5  # not one flat colour
    assert browser.errors() == []
    assert browser.run("return performance.getEntriesByType('resource').length") == 0


def test_the_policy_stops_requests_and_foreign_scripts(browser: Browser, page: Path) -> None:
    browser.open(page)
    browser.run(
        "window.stopped = [];"
        "addEventListener('securitypolicyviolation', e => stopped.push(e.effectiveDirective));"
        "const s = document.createElement('script'); s.textContent = 'window.injected = 1';"
        "document.body.append(s); new Image().src = 'http://127.0.0.1:9/x.png';"
        "return fetch('http://127.0.0.1:9/').catch(() => null)"
    )
    time.sleep(0.2)
    stopped = browser.run("return stopped")
    assert {"script-src-elem", "img-src", "connect-src"} <= set(stopped)
    assert browser.run("return window.injected === undefined")


def test_a_browser_that_cannot_unpack_the_page_says_which_can(browser: Browser, page: Path) -> None:
    old = {"source": "delete window.DecompressionStream"}
    script = browser.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", old)
    try:
        browser.driver.get("about:blank")
        browser.driver.get(page.as_uri())
        text = browser.run("return document.getElementById('app').textContent")
    finally:
        browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
    assert "too old" in text
    assert "Firefox 113" in text


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_run_of_few_instants_is_drawn(browser: Browser, tmp_path: Path, samples: int) -> None:
    whole = synthetic_result(samples=max(samples, 2))
    arrays = {k: v if k.endswith("/x") else v[:samples] for k, v in whole.arrays.items()}
    few = Result(whole.t[:samples], arrays, whole.meta)
    browser.open(write_html(few, tmp_path / "few.html"))
    assert browser.pixels().std() > 5
    assert browser.errors() == []


def test_pictures_differ_over_time_and_are_equal_at_equal_times(
    browser: Browser, page: Path
) -> None:
    browser.open(page)
    first = browser.pixels("pinflex.seek(0.03)")
    later = browser.pixels("pinflex.seek(0.08)")
    again = browser.pixels("pinflex.seek(0.03)")
    assert np.mean(np.any(first != later, axis=2)) > 0.005
    assert np.array_equal(first, again)


def test_magnification_is_linear_in_world_displacement(
    browser: Browser, page: Path, run: Result
) -> None:
    browser.open(page, "t=0")
    k = 18
    lines = []
    for mag in (0, 1, 10, 20):
        browser.run("pinflex.seek(arguments[0]); pinflex.setMag(arguments[1])", run.t[k], mag)
        lines.append(browser.centreline("distal_1"))
    rigid = run.array("link/distal_1/centreline_rigid")[k]
    true = run.array("link/distal_1/centreline")[k]
    assert lines[0] == pytest.approx(rigid, abs=1e-6)  # float32 of a robot of 0.7 m
    assert lines[1] == pytest.approx(true, abs=1e-6)
    assert lines[3] - lines[0] == pytest.approx(2 * (lines[2] - lines[0]), abs=1e-6)


@pytest.mark.parametrize("mag", [0, 1, 30, 200])
@pytest.mark.parametrize("t", [0.03, 0.0713])  # at an instant of the run, and between two
def test_joints_stay_joined(browser: Browser, page: Path, mag: float, t: float) -> None:
    browser.open(page)
    browser.run("pinflex.setMag(arguments[0]); pinflex.seek(arguments[1])", mag, t)
    for leg in (1, 2, 3):
        line = browser.centreline(f"distal_{leg}")
        corner = browser.run("return pinflex.point('platform', arguments[0])", leg - 1)
        elbow = browser.run("return pinflex.point(arguments[0], 1)", f"crank_{leg}")
        assert line[-1] == pytest.approx(corner, abs=1e-5)
        assert line[0] == pytest.approx(elbow, abs=1e-5)


@pytest.mark.parametrize("field", ["von_mises", "bending", "axial", "displacement"])
def test_legend_and_values_agree_with_the_result(
    browser: Browser, page: Path, run: Result, field: str
) -> None:
    factor = 1e3 if field == "displacement" else 1e-6
    values = {}
    for name in run.links:
        moved = run.array(f"link/{name}/centreline") - run.array(f"link/{name}/centreline_rigid")
        length = np.linalg.norm(moved, axis=2)
        values[name] = (
            length if field == "displacement" else run.array(f"link/{name}/stress/{field}")
        )
    browser.open(page, f"field={field}")
    legend = browser.run("return pinflex.legend")
    largest = factor * max(np.abs(v).max() for v in values.values())
    assert legend["max"] == pytest.approx(largest, rel=1e-6)
    assert legend["min"] == pytest.approx(-largest if field == "axial" else 0.0, rel=1e-6)
    assert legend["unit"] == ("mm" if field == "displacement" else "MPa")
    for k in (7, 60):
        browser.run("pinflex.seek(arguments[0])", run.t[k])
        shown = browser.run("return pinflex.values('distal_2')")
        assert shown == pytest.approx(factor * values["distal_2"][k], rel=1e-5, abs=1e-5 * largest)


def test_hover_tells_the_value_under_the_pointer(browser: Browser, page: Path, run: Result) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    k, i = 40, 10
    browser.open(page, f"t={run.t[k]}&peak=0")
    x, y = browser.run("return pinflex.pixel('distal_3', arguments[0])", i)
    body = browser.driver.find_element("tag name", "body")
    size = body.size
    ActionChains(browser.driver).move_to_element_with_offset(
        body, round(x - size["width"] / 2), round(y - size["height"] / 2)
    ).perform()
    text = browser.run("return document.getElementById('tip').innerText")
    assert "distal_3" in text
    told = float(text.split("von Mises stress")[1].split("MPa")[0])
    # the pointer stands on a whole pixel, and a station is about 10 pixels from the next
    near = 1e-6 * run.link("distal_3").von_mises[k, i - 1 : i + 2]
    assert near.min() * 0.99 <= told <= near.max() * 1.01


def test_worst_instant_is_where_the_result_has_it(
    browser: Browser, page: Path, run: Result
) -> None:
    browser.open(page)
    browser.run("pinflex.worst()")
    stress = np.stack([run.link(n).von_mises.max(axis=1) for n in run.links])
    k = int(stress.max(axis=0).argmax())
    assert browser.run("return pinflex.state.t") == pytest.approx(run.t[k], abs=1e-7)
    marker = browser.run("return document.querySelector('.mark.peak').innerText")
    link = list(run.links)[int(stress[:, k].argmax())]
    name, value, unit = marker.split()  # no strength is known of these links
    assert (name, unit) == (f"{link},", "MPa")
    assert float(value) == pytest.approx(1e-6 * stress.max(), rel=0.01)


def test_a_page_opens_where_the_platform_is_furthest_from_rigid_bent_coloured_and_at_rest(
    browser: Browser, page: Path, run: Result
) -> None:
    browser.open(page)
    away = run.deviation_from(synthetic_result("rigid", samples=121))
    worst = run.t[int(away.norm.argmax())]
    assert worst > 0
    state = browser.run("return pinflex.state")
    assert state["t"] == pytest.approx(worst, abs=1e-7)
    assert (state["play"], state["colours"]) == (False, True)
    assert state["mag"] > 1
    browser.open(page, "t=0")  # an address says where else
    assert browser.run("return pinflex.state.t") == 0


def test_the_peak_says_which_link_and_which_share_of_its_strength(
    browser: Browser, run: Result, tmp_path: Path
) -> None:
    links = {
        name: {**about, "material": {**about["material"], "yield_strength": 4e8}}
        for name, about in run.meta["links"].items()
    }
    warned = {"links": links, "warnings": ["distal_1: deflection is 20 % of the length."]}
    browser.open(write_html(Result(run.t, run.arrays, {**run.meta, **warned}), tmp_path / "y.html"))
    browser.run("pinflex.worst()")
    stress = max(run.link(name).von_mises.max() for name in run.links)
    marker = browser.run("return document.querySelector('.mark.peak').innerText")
    assert marker.endswith(f", {100 * stress / 4e8:.0f} % of yield")
    browser.run("pinflex.set({limit: 1e-6 * arguments[0]})", 2 * stress)
    marker = browser.run("return document.querySelector('.mark.peak').innerText")
    assert marker.endswith(", 50 % of limit")
    said = browser.run("return document.querySelector('#chips .care').innerText")
    assert said == "⚠ distal_1: deflection is 20 % of the length."


def test_the_address_reproduces_the_picture(browser: Browser, page: Path) -> None:
    browser.open(page)
    browser.run("pinflex.set({field: 'axial', force: true, names: true, limit: 20, ghost: 'off'})")
    browser.run("pinflex.setMag(50); pinflex.seek(0.0625)")
    time.sleep(0.6)  # the address is written at most four times a second
    state = browser.run("return pinflex.state")
    address = browser.run("return location.hash")
    shown = browser.pixels()
    browser.open(page, address[1:])
    again = browser.run("return pinflex.state")
    keys = ("t", "mag", "field", "force", "names", "limit", "ghost", "path", "play")
    assert {k: again[k] for k in keys} == {k: state[k] for k in keys}
    assert np.array_equal(browser.pixels(), shown)


def test_play_loops_and_pauses_by_the_space_key(browser: Browser, page: Path) -> None:
    from selenium.webdriver.common.by import By

    browser.open(page, "speed=0.05")
    body = browser.driver.find_element(By.TAG_NAME, "body")
    body.send_keys(" ")
    time.sleep(1.0)
    moving = browser.run("return pinflex.state")
    body.send_keys(" ")
    rest = browser.run("return pinflex.state")
    assert moving["play"]
    assert moving["t"] > 0.0
    assert not rest["play"]
    body.send_keys("\ue010")  # End
    assert browser.run("return pinflex.state.t") == pytest.approx(0.2, abs=1e-6)
    body.send_keys("\ue011\ue014")  # Home, right arrow: one instant on
    assert browser.run("return pinflex.state.t") == pytest.approx(0.2 / 120, abs=1e-6)
    before = browser.run("return pinflex.state.mag")
    body.send_keys("+")
    assert browser.run("return pinflex.state.mag") > before


def test_forces_and_torques_can_be_shown(browser: Browser, page: Path, run: Result) -> None:
    browser.open(page, "t=0.03&peak=0")
    plain = browser.pixels()
    forces = browser.pixels("pinflex.set({force: true})")
    both = browser.pixels("pinflex.set({torque: true})")
    assert np.any(plain != forces)
    assert np.any(both != forces)
    text = browser.run("return document.getElementById('keys').innerText")
    force = max(np.linalg.norm(run.joint(m).reaction[:, :3], axis=1).max() for m in run.motors)
    assert f"joint force, longest {force:.1f} N" in text
    assert f"motor torque, largest {np.abs(run.torque).max():.2f} N m" in text


def test_stress_above_the_limit_is_told_and_coloured(browser: Browser, page: Path) -> None:
    browser.open(page, "t=0.071&mag=20")
    plain = browser.pixels()
    limited = browser.pixels("pinflex.set({limit: 20, max: 15})")  # the legend ends below it
    changed = limited[np.any(limited != plain, axis=2)]
    pink = (changed[:, 0] > 100) & (changed[:, 1] < 60) & (changed[:, 2] > 40)
    assert pink.sum() > 50
    assert "limit 20.0 MPa, exceeded" in browser.run(
        "return document.getElementById('keys').innerText"
    )


def test_a_link_named_like_markup_does_nothing(
    browser: Browser, run: Result, tmp_path: Path
) -> None:
    file = write_html(renamed(run), tmp_path / "evil.html", title=EVIL)
    browser.open(file, "names=1")
    assert browser.run("return window.evil === undefined")
    assert browser.run("return pinflex.links") == [EVIL, "__proto__", "distal_3"]
    shown = browser.run("return document.querySelector('.mark.name').textContent")
    assert shown == EVIL
    assert browser.run("return document.querySelector('h1').textContent") == EVIL
    assert browser.errors() == []


def test_a_phone_shows_everything_without_scrolling_sideways(browser: Browser, page: Path) -> None:
    browser.open(page, "t=0.03", size=(420, 760))
    assert browser.run("return document.documentElement.scrollWidth") <= 420
    for name in ("play", "time", "mag", "legend", "plots", "readout"):
        box = browser.run(
            "const r = document.getElementById(arguments[0]).getBoundingClientRect();"
            "return [r.left, r.top, r.right, r.bottom]", name
        )  # fmt: skip
        assert box[0] >= 0
        assert box[2] <= 420.5
        assert box[3] <= 760.5
    assert "\u00d720" in browser.run("return document.getElementById('readout').innerText")


def test_every_control_has_a_name(browser: Browser, page: Path) -> None:
    browser.open(page)
    nameless = browser.run(
        "return [...document.querySelectorAll('#app button, #app select, #app input')].filter(e =>"
        " !e.closest('.dg') && !(e.getAttribute('aria-label') || (e.tagName == 'BUTTON' &&"
        " e.textContent) || (e.labels.length && e.labels[0].textContent.trim())))"
        ".map(e => e.outerHTML)"
    )
    assert nameless == []
    assert "von Mises" in browser.run(
        "return document.getElementById('pane').getAttribute('aria-label')"
    )


def test_reduced_motion_does_not_start_by_itself(browser: Browser, page: Path) -> None:
    feature = [{"name": "prefers-reduced-motion", "value": "reduce"}]
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": feature})
    try:
        browser.open(page, "play=1")
        assert not browser.run("return pinflex.state.play")
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    browser.open(page, "play=1")
    assert browser.run("return pinflex.state.play")


def test_what_moves_is_drawn_as_sharply_as_there_is_time_for_and_at_rest_sharply(
    browser: Browser, page: Path
) -> None:
    browser.open(page, "play=1")
    # A browser whose clock makes each frame a hundred times as long, or as short.
    browser.run(
        "window.clock = 1; const real = requestAnimationFrame.bind(window);"
        "window.requestAnimationFrame = (f) => real((now) => f(now * clock))"
    )
    levels = browser.run("return pinflex.sharpness.ratios")
    assert levels[0] == 2 > levels[-1] * 5  # drawn in software: at rest four times the pixels
    browser.run("window.clock = 100")
    _until(browser, "pinflex.sharpness.level", len(levels) - 1)
    assert browser.run("return pinflex.sharpness.now") == levels[-1]
    browser.run("window.clock = 0.01")
    # In motion no finer than the screen, whose pixels are the page's: at 2 frames took 65 ms.
    finest = next(k for k, x in enumerate(levels) if x < 1.01)
    _until(browser, "pinflex.sharpness.level", finest)
    time.sleep(2.0)  # at 60 frames a second as many as it would take to rise again
    assert browser.run("return pinflex.sharpness.level") == finest
    browser.run("pinflex.set({play: false})")
    _until(browser, "pinflex.sharpness.now", levels[0])
    browser.open(page, "play=1&sharp=0.5")  # asked for, it stays
    assert browser.run("return pinflex.sharpness.ratios") == [0.5]


def _until(browser: Browser, script: str, wanted: float) -> None:
    for _ in range(600):
        if browser.run(f"return {script}") == wanted:
            return
        time.sleep(0.05)
    raise AssertionError((script, browser.run(f"return {script}"), wanted))


def test_a_rigid_run_plays_without_colours(browser: Browser, tmp_path: Path) -> None:
    file = write_html(synthetic_result("rigid", samples=61), tmp_path / "rigid.html")
    browser.open(file, "t=0.05")
    assert browser.pixels().std() > 5
    assert browser.run("return pinflex.links") == []
    assert browser.errors() == []


def test_mode_shapes_share_the_player_and_have_a_picker(
    browser: Browser, run: Result, tmp_path: Path
) -> None:
    shapes = [(61.0, shape(run, 61.0, 1.0)), (140.0, shape(run, 140.0, -2.0))]
    file = write_modes_html(shapes, tmp_path / "modes.html")
    browser.open(file, "play=0&t=0.004")
    options = browser.run("return [...document.getElementById('run').options].map(o => o.text)")
    assert options == ["mode 1 · 61.00 Hz", "mode 2 · 140.0 Hz"]
    assert browser.run("return pinflex.legend.max") == pytest.approx(1.0)
    first = browser.centreline("distal_1")
    browser.run("pinflex.show(1); pinflex.set({play: false}); pinflex.seek(1 / 140 / 4)")
    assert not np.allclose(first, browser.centreline("distal_1"), atol=1e-4)
    assert "140.0 Hz" in browser.run("return document.getElementById('sub').textContent")
    assert browser.errors() == []


def test_two_runs_of_one_robot_are_switched_on_one_page(
    browser: Browser, run: Result, tmp_path: Path
) -> None:
    rigid = synthetic_result("rigid", samples=121)
    runs = {"exact command": run, "rigid command": run}
    browser.open(write_html(runs, tmp_path / "two.html", rigid=rigid), "play=0")
    labels = browser.run(
        "return [...document.querySelectorAll('#levels label')].map(l => l.textContent)"
    )
    assert labels == ["exact command", "rigid command"]
    said = "return document.getElementById('sub').textContent"
    assert browser.run(said) == "exact command"
    browser.run("pinflex.show(1)")
    assert browser.run(said) == "rigid command"
    assert browser.errors() == []
