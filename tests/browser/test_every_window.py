"""Every feature of the page in every window, light and dark, with the numbers of the run.

A page is opened once a theme; a window is a change of size, as by a user.

Claims:
    Pages, pictures, figures
    - at 1440x900, 390x844, 844x390, light and dark: nothing beyond the window or over something
      else, names for a screen reader, keys, no violation of axe-core 4.14, nothing on the console |
      none | none
    - in the same six: levels switched, overlaid, subtracted; link panel; colours, peak, yield,
      section forces; path, arrows; views, scale bar; curves by name, table, zoom; CSV, PNG, link =
      Result | 3 digits of a text, 2e-4 of the largest of a run, 2e-6 m | passes
"""

from __future__ import annotations

import io
import itertools
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pinflex.results.result import Result
from pinflex.viewer.view import write_html
from tests.browser.chromium import Browser
from tests.browser.made_up import FALLEN, with_strength
from tests.browser.places import apart, violations

AXE = Path(__file__).with_name("axe") / "axe.min.js"
SIZES = {"desktop": (1440, 900), "upright": (390, 844), "sideways": (844, 390)}
WINDOWS = list(itertools.product(("light", "dark"), SIZES))
K = 18  # instant at which numbers are compared: everything bends and pushes
STRENGTH = 4e8  # [Pa]
SHARP = 0.5  # pixels drawn a pixel of the window: software draws four times as fast
THREE = 6e-3  # relative: texts have three digits
FLOAT = 2e-6  # of a length of 0.2 m, in single precision


@pytest.fixture(scope="module")
def page(levels: dict[str, Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    runs = {
        name: run if name == "rigid" else with_strength(run, STRENGTH)
        for name, run in levels.items()
    }
    path = tmp_path_factory.mktemp("every") / "every.html"
    return write_html(runs, path, first="coupled", rigid=levels["rigid"])


@pytest.fixture(scope="module")
def opened(browser: Browser, page: Path) -> Iterator[Any]:
    """Opens the page in a theme, unless it is open in it."""
    now = None

    def open_in(theme: str) -> Browser:
        nonlocal now
        if theme != now:
            feature = {"name": "prefers-color-scheme", "value": theme}
            browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
            browser.open(page, f"sharp={SHARP}", size=SIZES["desktop"])
            browser.run(AXE.read_text("utf-8"))
            browser.run("window.fresh = JSON.stringify(pinflex.state)")
            now = theme
        return browser

    yield open_in
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


@pytest.fixture(params=WINDOWS, ids="-".join, scope="module")
def sized(request: pytest.FixtureRequest, opened: Any) -> Browser:
    theme, name = request.param
    browser: Browser = opened(theme)
    width, height = SIZES[name]
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    return browser


@pytest.fixture
def window(sized: Browser, run: Result) -> Iterator[Browser]:
    """The page as it opens, at instant K; no error of a script while it is used."""
    sized.driver.execute_async_script(
        "document.querySelectorAll('details[open]').forEach(d => d.open = false);"
        "pinflex.show(2, {...JSON.parse(fresh), t: arguments[0]}); pinflex.look('fit');"
        "plots.scrollTo(0, 0);"  # and what follows a change of size has happened:
        "requestAnimationFrame(() => requestAnimationFrame(arguments[1]))",
        run.t[K],
    )
    yield sized
    assert sized.errors() == []


def told(text: str) -> float:
    """The number in a text."""
    return float(text.replace("\u2212", "-").replace("e\u2212", "e-"))


def texts(browser: Browser, selector: str) -> list[str]:
    return list(
        browser.run(
            "return [...document.querySelectorAll(arguments[0])].filter(e => !e.hidden)"
            ".map(e => e.textContent)",
            selector,
        )
    )


def test_nothing_is_hidden_and_axe_finds_nothing(window: Browser) -> None:
    apart(window, "")
    apart(window, "pinflex.set({other: '1', diff: true, force: true})")
    apart(window, "pinflex.set({diff: false, ghost: 'beside', names: true})")
    apart(window, "pinflex.set({ghost: 'over', link: 'distal_2'})")
    assert violations(window) == []
    chosen = "table: true, hide: ['motor_2', 'distal_1'], zoom: [0.02, 0.1]"
    apart(window, f"pinflex.set({{{chosen}}})")
    apart(window, "pinflex.show(1)")
    window.run("options.open = true")
    assert violations(window) == []


def test_levels_are_switched_overlaid_and_subtracted(
    window: Browser, levels: dict[str, Result]
) -> None:
    run, half = levels["coupled"], levels["quasistatic"]
    assert texts(window, "#levels label") == ["rigid", "quasistatic", "coupled"]
    scale = window.run("return pinflex.state.mag")
    line, still = (run.array(f"link/distal_1/{k}")[K] for k in ("centreline", "centreline_rigid"))
    shown = window.centreline("distal_1")
    assert shown == pytest.approx(still + scale * (line - still), abs=FLOAT * scale)
    window.run("pinflex.set({other: '1', ghost: 'over'})")
    ghost = np.array(window.run("return pinflex.ghostline('distal_1')")).reshape(-1, 3)
    assert ghost == pytest.approx(still + 0.5 * scale * (line - still), abs=FLOAT * scale)
    window.run("pinflex.set({ghost: 'beside'}); pinflex.frame()")
    assert texts(window, ".mark.title") == ["coupled", "quasistatic"]
    window.run("pinflex.set({diff: true})")
    away = (run.array("link/distal_1/centreline")[:100] - half.array("link/distal_1/centreline"))[K]
    distance = 1e3 * np.linalg.norm(away, axis=1)
    assert window.run("return pinflex.values('distal_1')") == pytest.approx(distance, abs=2e-4)
    assert window.run("return pinflex.legend.unit") == "mm"
    assert texts(window, "#plots b")[0] == "\u0394 motor torque [N m]"
    window.run("document.querySelectorAll('#levels input')[1].click()")
    assert window.run("return [pinflex.state.run, pinflex.state.t]") == [1, run.t[K]]
    window.run("pinflex.setMag(arguments[0])", scale)
    assert window.centreline("distal_1") == pytest.approx(ghost, abs=FLOAT * scale)
    chip = window.driver.find_element("css selector", "#chips .chip.bad")
    assert chip.text == "\u2715 buckles or falls at 0.165 s"
    chip.click()
    assert chip.text.endswith(FALLEN)
    assert chip.get_attribute("aria-expanded") == "true"
    apart(window, "")


def test_a_click_on_a_link_opens_its_diagrams(window: Browser, run: Result) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    x, y = window.run("return pinflex.pixel('distal_3', 10)")
    body = window.driver.find_element("tag name", "body")
    middle = [body.size["width"] / 2, body.size["height"] / 2]
    ActionChains(window.driver).move_to_element_with_offset(
        body, round(x - middle[0]), round(y - middle[1])
    ).click().perform()
    beam = window.run("return pinflex.beam")
    assert (beam["name"], beam["quantities"]) == ("distal_3", ["von_mises", "N", "Vy", "Mz"])
    link, i = run.link("distal_3"), beam["station"]
    assert i == pytest.approx(10, abs=2)  # half of its length, within a finger's width
    wanted = [1e-6 * link.von_mises, *(link.resultant[:, :, j] for j in (0, 1, 5))]
    rows = np.array(beam["rows"][2 : 2 + len(beam["x"])], float)
    for column, values in zip(rows[:, 1:].T, wanted, strict=True):
        assert column == pytest.approx(values[K], abs=2e-4 * np.abs(values).max())  # 2^-12 of it
    shown = [told(text) for text in texts(window, "#diagrams .values")]
    assert shown == pytest.approx([w[K, i] for w in wanted], rel=THREE, abs=1e-3)
    assert told(texts(window, "#history .values")[0]) == pytest.approx(wanted[0][K, i], rel=THREE)
    over = np.array(beam["rows"][-len(run.t) :], float)
    assert over[:, 4] == pytest.approx(wanted[3][:, i], abs=2e-4 * np.abs(wanted[3]).max())
    stage = window.run("return [stage.clientWidth, stage.clientHeight]")
    for i in (0, 20):
        place = window.run("return pinflex.pixel('distal_3', arguments[0])", i)
        assert 0 <= place[0] <= stage[0] and 0 <= place[1] <= stage[1]
    assert stage[0] * stage[1] > 0.3 * np.prod(window.run("return [innerWidth, innerHeight]"))
    body.send_keys("\ue00c")  # Escape
    assert window.run("return document.getElementById('beam').hidden")


def test_colours_peak_and_yield_are_those_of_the_run(window: Browser, run: Result) -> None:
    stress = {name: 1e-6 * run.link(name).von_mises for name in run.links}
    worst = max(stress, key=lambda name: stress[name][K].max())
    largest = stress[worst][K].max()
    legend = window.run("return [pinflex.legend.max, pinflex.legend.unit]")
    assert legend == [pytest.approx(max(s.max() for s in stress.values()), rel=1e-4), "MPa"]
    name, value, share = texts(window, ".mark.peak")[0].split(", ")
    assert (name, told(value.split()[0])) == (worst, pytest.approx(largest, rel=THREE))
    percent = 1e8 * largest / STRENGTH
    assert told(share.split()[0]) == pytest.approx(percent, abs=0.5)
    window.run("pinflex.set({field: 'utilisation'})")
    assert window.run("return [pinflex.legend.max, pinflex.legend.unit]") == [100, "%"]
    shown = window.run("return pinflex.values(arguments[0])", worst)
    assert max(shown) == pytest.approx(percent, rel=2e-4)
    moment = run.link("distal_1").resultant[:, :, 5]
    window.run("pinflex.set({field: 'Mz'})")
    shown = window.run("return pinflex.values('distal_1')")
    assert shown == pytest.approx(moment[K], abs=2e-4 * np.abs(moment).max())
    window.run("pinflex.set({field: 'von_mises'})")
    said = texts(window, "#status")[0]  # to a screen reader
    assert said.endswith(f"at most {value.split()[0]} MPa in {worst}")


def test_the_path_is_a_line_and_forces_have_their_values(window: Browser, run: Result) -> None:
    plain = window.pixels("pinflex.set({path: 'off', ghost: 'off', peak: false})")
    path = window.pixels("pinflex.set({path: 'true'})")
    drawn = np.any(plain != path, axis=2)
    assert 5 < drawn.sum() < 0.02 * drawn.size
    assert drawn.sum(axis=1).max() < 0.2 * drawn.shape[1]  # a line, not a brush
    assert "path of platform" in texts(window, "#keys > *")
    window.run("pinflex.set({force: true, torque: true}); pinflex.frame()")
    largest = max(np.linalg.norm(run.joint(m).reaction[K, :3]) for m in run.motors)
    assert max(told(t.split()[0]) for t in texts(window, ".mark.force")) == pytest.approx(
        largest, rel=THREE
    )
    torques = [told(t.split()[0]) for t in texts(window, ".mark.torque")]
    assert max(torques, key=abs) == pytest.approx(max(run.torque[K], key=abs), rel=THREE)
    assert "joint force" in " ".join(texts(window, "#plots b"))


def test_views_turn_the_axes_and_the_bar_is_true(window: Browser) -> None:
    ends: dict[str, Any] = {}
    for name in ("front", "top", "fit"):
        window.run("document.getElementById('view-' + arguments[0]).click()", name)
        place = (window.run("return pinflex.pixel('distal_1', arguments[0])", i) for i in (0, 20))
        ends[name] = np.subtract(*place)
        if name == "top":
            bar = window.run(
                "pinflex.frame(); const r = document.getElementById('ruler');"
                "return [r.getBoundingClientRect().width, r.textContent]"
            )
    assert abs(ends["front"][1]) < 3  # px: the robot is flat
    assert np.linalg.norm(ends["top"]) > np.linalg.norm(ends["front"])
    line = window.centreline("distal_1")
    chord = np.linalg.norm(line[20] - line[0])
    length = told(bar[1].split()[0]) * (1e-3 if bar[1].endswith("mm") else 1.0)
    scale = chord / np.linalg.norm(ends["top"])
    assert length / bar[0] == pytest.approx(scale, rel=0.03)  # in perspective
    assert sorted(texts(window, "#triad text")) == ["x", "y", "z"]


def test_curves_are_chosen_by_name_and_tabled(window: Browser, run: Result) -> None:
    count = "return document.querySelectorAll('#plots figure:first-child .curve').length"
    assert window.run(count) == 6  # three motors, each beside rigid
    window.run("document.querySelector('#plots [data-name=motor_2]').click()")
    assert window.run(count) == 4
    assert "hide=motor_2" in window.run("pinflex.copyLink(); return location.hash")
    window.run("pinflex.set({hide: ['--']})")  # those of rigid
    assert window.run(count) == 3
    window.run("pinflex.set({hide: [], table: true})")
    rows = window.run(
        "return [...document.querySelectorAll('#table tbody tr')].map(r => [...r.cells].map("
        "c => c.textContent))"
    )
    values = {row[0]: [told(text) for text in row[1:]] for row in rows}
    for j, motor in enumerate(run.motors):
        now, _, largest = values[motor]
        assert now == pytest.approx(run.torque[K, j], rel=THREE, abs=1e-3)
        assert largest == pytest.approx(max(run.torque[:, j], key=abs), rel=THREE)
    for name in run.links:
        assert values[name][0] == pytest.approx(1e-6 * run.link(name).von_mises[K].max(), rel=THREE)
    window.run("const box = document.querySelectorAll('#table input')[1]; box.focus(); box.click()")
    assert window.run("return pinflex.state.hide") == ["motor_2"]
    assert window.run("return document.activeElement.id") == "curve-0-1"
    window.run("pinflex.seek(arguments[0])", run.t[40])
    now = window.run("return document.querySelector('#table tbody td').textContent")
    assert told(now) == pytest.approx(run.torque[40, 0], rel=THREE, abs=1e-3)


def test_a_drag_zooms_and_a_double_click_goes_back(window: Browser, run: Result) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    window.run("pinflex.seek(0)")
    svg = window.driver.find_element("css selector", "#plots svg")
    width = svg.size["width"]
    actions = ActionChains(window.driver, duration=20)
    actions.move_to_element_with_offset(svg, round(-0.1 * width), 0).click_and_hold()
    actions.move_by_offset(round(0.3 * width), 0).release().perform()
    a, b = window.run("return pinflex.state.zoom")
    assert 0 < a < b < run.t[-1]
    assert b - a == pytest.approx(0.3 * width / (width - 50) * run.t[-1], rel=0.05)  # axes 50 px
    path = window.run(
        "return document.querySelector('#plots .curve:not(.rigid)').getAttribute('d')"
    )
    x = [float(step.split()[0]) for step in path.replace("L", "M").split("M")[1:]]
    assert (x[0], x[-1]) == (pytest.approx(42), pytest.approx(width - 8))  # px: from edge to edge
    body = window.driver.find_element("tag name", "body")
    body.send_keys("z")
    assert np.ptp(window.run("return pinflex.state.zoom")) == pytest.approx((b - a) / 2, rel=1e-3)
    svg = window.driver.find_element("css selector", "#plots svg")
    ActionChains(window.driver, duration=20).double_click(svg).perform()
    assert window.run("return pinflex.state.zoom") is None
    assert a < window.run("return pinflex.state.t") < b  # where it was clicked


def test_tables_pictures_and_links_are_taken_away(window: Browser, run: Result) -> None:
    from PIL import Image

    lines = window.run("return pinflex.saveCurves()").splitlines()
    column = lines[0].split(",").index("motor torque motor_2 [N m]")
    values = [float(line.split(",")[column]) for line in lines[1:]]
    assert values == pytest.approx(run.torque[:, 1], abs=1e-5)
    url = window.run("return pinflex.image()")
    with Image.open(io.BytesIO(b64decode(url.split(",")[1]))) as picture:
        size = window.run("return [pane.clientWidth, pane.clientHeight]")
        assert picture.size == tuple(int(SHARP * n) for n in size)
        ends = [picture.convert("RGB").getpixel((14, round(SHARP * y))) for y in (108, 280)]
    viridis = [(253, 231, 37), (68, 1, 84)]
    assert np.abs(np.subtract(ends, viridis)).max() < 40  # the legend, drawn in strips of a pixel
    link = window.driver.execute_async_script(
        "pinflex.set({link: 'distal_2', zoom: [0.02, 0.1]}); pinflex.copyLink().then(arguments[0])"
    )
    asked = dict(part.split("=") for part in link.partition("#")[2].split("&"))
    assert float(asked["t"]) == pytest.approx(run.t[K], rel=1e-5)
    assert (asked["run"], asked["link"], asked["zoom"]) == ("2", "distal_2", "0.02,0.1")


def test_everything_has_a_name_and_is_reached_by_keys(window: Browser) -> None:
    window.driver.execute_cdp_cmd("Accessibility.enable", {})
    nodes = window.driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
    roles = {
        "button",
        "checkbox",
        "radio",
        "combobox",
        "slider",
        "spinbutton",
        "DisclosureTriangle",
    }
    named = [n["name"].get("value", "") for n in nodes if n.get("role", {}).get("value") in roles]
    assert len(named) > 15
    assert all(named)
    window.run(
        "document.activeElement.blur(); window.met = [];"
        "addEventListener('focusin', e => met.push(e.target.id))"
    )
    body = window.driver.find_element("tag name", "body")
    body.send_keys("\ue004" * 45)  # Tab
    met = set(window.run("return met"))
    assert {"pane", "field", "play", "time", "mag", "speed", "worst", "plots"} <= met
    body.send_keys("l")
    assert window.run("return pinflex.state.link") == "distal_1"
    body.send_keys("t")
    state = window.run("return pinflex.state")
    assert (state["link"], state["table"]) == (None, True)
    body.send_keys("1")
    assert window.run("return pinflex.state.run") == 0
