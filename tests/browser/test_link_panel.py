"""A link opened by a click: stress and section forces along it, one of them over time; its CSV.

Claims:
    Pages, pictures, figures
    - diagrams of a link = Result: von Mises, N V M along x, over time; CSV | 1.3e-4 of the largest
      of the run | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pinflex.results.result import Result
from tests.browser.chromium import Browser

OPEN = "return document.querySelector('#beam h2')?.textContent"


def test_a_click_on_a_link_opens_it_and_escape_closes_it(browser: Browser, page: Path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser.open(page, "t=0.03")
    assert browser.run("return document.getElementById('beam').hidden")
    x, y = browser.run("return pinflex.pixel('distal_3', 10)")
    body = browser.driver.find_element("tag name", "body")
    size = body.size
    ActionChains(browser.driver).move_to_element_with_offset(
        body, round(x - size["width"] / 2), round(y - size["height"] / 2)
    ).click().perform()
    assert browser.run(OPEN) == "distal_3"
    assert "link=distal_3" in browser.run("pinflex.copyLink(); return location.hash")
    assert browser.run("return pinflex.beam.station") == pytest.approx(10, abs=1)
    body.send_keys("\ue00c")  # Escape
    assert browser.run("return document.getElementById('beam').hidden")
    body.send_keys("l")  # and by the keyboard alone
    assert browser.run(OPEN) == "distal_1"
    body.send_keys("l")
    assert browser.run(OPEN) == "distal_2"
    assert browser.errors() == []


def test_its_diagrams_are_those_of_the_run(browser: Browser, page: Path, run: Result) -> None:
    k = 40
    browser.open(page, f"t={run.t[k]}&link=distal_2&at=0.5")
    beam = browser.run("return pinflex.beam")
    assert beam["quantities"] == ["von_mises", "N", "Vy", "Mz"]  # the others are nothing
    rows, link = beam["rows"], run.link("distal_2")
    along = np.array(rows[2 : 2 + len(beam["x"])], float)
    assert along[:, 0] == pytest.approx(1e3 * link.x, abs=3e-4)  # to a millionth of 220 mm
    wanted = [1e-6 * link.von_mises[k], *(link.resultant[k, :, i] for i in (0, 1, 5))]
    for column, values in zip(along[:, 1:].T, wanted, strict=True):
        # 2^12 steps of the largest of the run: 1.2e-4 of it
        assert column == pytest.approx(values, abs=1.3e-4 * 8 * np.abs(values).max())
    middle = beam["station"]
    over = np.array(rows[-len(run.t) :], float)
    largest = np.abs(link.resultant[:, middle, 5]).max()
    assert over[:, 0] == pytest.approx(run.t, abs=1e-6)
    assert over[:, 4] == pytest.approx(link.resultant[:, middle, 5], abs=2e-4 * largest)
    shown = browser.run(
        "return [...document.querySelectorAll('#diagrams figure .values')].map(v => v.textContent)"
    )
    told = [float(text.replace("\u2212", "-")) for text in shown]
    assert told == pytest.approx([w[middle] for w in wanted], rel=6e-3, abs=1e-3)


def test_a_click_in_a_diagram_chooses_the_place_and_the_quantity(
    browser: Browser, page: Path
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser.open(page, "t=0.03&link=distal_1&at=0", size=(1440, 900))
    figure = browser.driver.find_elements("css selector", "#diagrams figure")[3]
    ActionChains(browser.driver).move_to_element(
        figure.find_element("tag name", "svg")
    ).click().perform()
    title = browser.run("return document.querySelector('#history b').textContent")
    assert title.startswith("Mz at x = ")
    assert browser.run("return pinflex.state.at") == pytest.approx(0.5, abs=0.2)
