"""Dark mode, views, forces, paths, tables and links, each in detail in one window.

Claims:
    Pages, pictures, figures
    - views, axes, scale bar; values at arrows; path at true scale; CSV and link of a page | 3 %
      (perspective); 3 digits; 1e-5 | passes
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pinflex.results.result import Result
from pinflex.viewer.view import write_html
from tests.browser.chromium import Browser

THEMES = ("light", "dark")


@pytest.fixture(scope="module")
def two(run: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    warned = Result(run.t, run.arrays, {**run.meta, "warnings": ["deflections are not small."]})
    path = tmp_path_factory.mktemp("two") / "two.html"
    return write_html({"ked": run, "coupled": warned}, path, first="coupled")


@pytest.fixture
def themed(browser: Browser) -> Iterator[Browser]:
    yield browser
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def _theme(browser: Browser, theme: str) -> None:
    feature = {"name": "prefers-color-scheme", "value": theme}
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})


def test_dark_follows_the_system_or_the_wish(themed: Browser, two: Path) -> None:
    shades = {}
    for theme in THEMES:
        _theme(themed, theme)
        themed.open(two, "t=0.03&peak=0")
        shades[theme] = themed.pixels()[:20].mean()
    assert shades["light"] > 230
    assert shades["dark"] < 90
    themed.run("pinflex.set({theme: 'light'})")
    assert themed.pixels()[:20].mean() == pytest.approx(shades["light"], abs=1)
    assert "theme=light" in themed.run("pinflex.copyLink(); return location.hash")


def test_views_scale_bar_and_axes(browser: Browser, page: Path) -> None:
    browser.open(page, "t=0.03", size=(1440, 900))
    seen = {}
    for name in ("front", "side", "top", "iso", "fit"):
        browser.run("document.getElementById('view-' + arguments[0]).click()", name)
        a, b = (browser.run("return pinflex.pixel('distal_1', arguments[0])", i) for i in (0, 20))
        seen[name] = np.subtract(b, a)
    browser.run("pinflex.look('top')")
    line = browser.centreline("distal_1")
    chord, pixels = np.linalg.norm(line[20] - line[0]), np.linalg.norm(seen["top"])
    bar = browser.run(
        "const r = document.getElementById('ruler');"
        "return [r.getBoundingClientRect().width, r.innerText]"
    )
    length = float(bar[1].split()[0]) * (1e-3 if bar[1].endswith("mm") else 1.0)
    assert length / bar[0] == pytest.approx(chord / pixels, rel=0.03)  # in perspective
    assert abs(seen["front"][1]) < 2  # px: the robot is flat
    texts = browser.run(
        "return [...document.querySelectorAll('#triad text')].map(t => t.textContent)"
    )
    assert sorted(texts) == ["x", "y", "z"]


@pytest.mark.parametrize("view", ["fit", "iso", "front", "side", "top"])
def test_letters_of_the_axes_do_not_cover_each_other(browser: Browser, page: Path, view) -> None:
    """An axis that nearly points at the reader is as short as its letter is high."""
    browser.open(page)
    browser.run("pinflex.look(arguments[0]); pinflex.frame()", view)
    boxes = browser.run(
        "return [...document.querySelectorAll('#triad text')].map(t => {"
        " const r = t.getBoundingClientRect(); return [r.left, r.right, r.top, r.bottom]; })"
    )
    for a, b in itertools.combinations(boxes, 2):
        across, down = min(a[1], b[1]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[2], b[2])
        assert across <= 0 or down <= 4  # px: of a line's height letters leave 4 free


def test_forces_have_their_values_at_the_arrows(browser: Browser, page: Path, run: Result) -> None:
    browser.open(page, f"t={run.t[18]}&force=1&torque=1&peak=0")
    told = browser.run(
        "return [...document.querySelectorAll('.mark.force:not([hidden])')].map(m => m.innerText)"
    )
    forces = [np.linalg.norm(run.joint(m).reaction[18, :3]) for m in run.motors]
    assert f"{max(forces):.1f} N" in told
    torques = browser.run(
        "return [...document.querySelectorAll('.mark.torque:not([hidden])')].map(m => m.innerText)"
    )
    assert f"{run.torque[18, 0]:.2f} N m" in [text.replace("\u2212", "-") for text in torques]
    titles = browser.run(
        "return [...document.querySelectorAll('#plots b')].map(b => b.textContent)"
    )
    assert any("joint force" in title for title in titles)


def test_the_path_is_at_true_scale_unless_it_is_magnified(browser: Browser, page: Path) -> None:
    shown = {}
    for path in ("true", "magnified", "off"):
        browser.open(page, f"t=0.03&mag=60&path={path}&peak=0&ghost=off")
        shown[path] = browser.pixels()
    for one, other in (("true", "off"), ("magnified", "true")):
        assert 20 < np.any(shown[one] != shown[other], axis=2).sum() < 0.03 * 700 * 1000
    orange = np.abs(shown["true"] - (213, 94, 0)).max(axis=2) < 30
    assert orange.sum(axis=1).max() < 200  # a line, not a brush


def test_curves_and_links_are_saved_as_csv_and_the_link_is_copied(
    browser: Browser, page: Path, run: Result
) -> None:
    browser.open(page, f"t={run.t[9]}&mag=30")
    text = browser.run("return pinflex.saveCurves()")
    lines = text.splitlines()
    assert len(lines) == 1 + len(run.t)
    heads = lines[0].split(",")
    k = heads.index("motor torque motor_2 [N m]")
    column = [float(line.split(",")[k]) for line in lines[1:]]
    assert column == pytest.approx(run.torque[:, 1], abs=1e-5)
    link = browser.driver.execute_async_script("pinflex.copyLink().then(arguments[0])")
    time.sleep(0.1)
    browser.driver.get("about:blank")
    browser.driver.get(link)
    browser.wait()
    state = browser.run("return pinflex.state")
    assert (state["t"], state["mag"]) == (pytest.approx(run.t[9], rel=1e-5), 30)
    assert browser.errors() == []
