"""Boxes of what stands on a page: within the window, and apart from one another."""

from __future__ import annotations

import itertools

from tests.browser.chromium import Browser

# Places of everything that stands on the page, by name: [left, top, right, bottom]. A caption that
# scrolls, and what is in a list that scrolls, count as the box about them.
PLACES = """
const names = '#head h1, #levels, #against, #readout span, .chip, #legend-title, #scale, #keys > *,'
  + '#views, #triad, #ruler, #export > summary, #options > summary, #play, #time, #clock, #speed,'
  + '#mag, #mag-number, #worst, #plots, .side, .panel, .list', out = {};
document.querySelectorAll(names).forEach((e, i) => {
  const r = e.getBoundingClientRect();
  if (r.width && r.height && e.checkVisibility() && !e.closest('.panel .grid'))
    out[(e.id || e.className || e.tagName) + ' ' + i] = [r.left, r.top, r.right, r.bottom];
});
return out"""
MARKS = """
const stage = document.getElementById('stage').getBoundingClientRect();
return [...document.querySelectorAll('.mark:not([hidden])')].map(m => {
  const r = m.getBoundingClientRect();
  return [m.textContent, r.left - stage.left, r.top - stage.top, stage.right - r.right,
    stage.bottom - r.bottom]; })"""


def apart(browser: Browser, state: str) -> None:
    """Nothing that stands on the page is beyond the window or over something else."""
    browser.run(state)
    width, height = browser.run("return [innerWidth, innerHeight]")
    places = browser.run(PLACES)
    for name, (left, top, right, bottom) in places.items():
        inside = left >= -0.5 and top >= -0.5 and right <= width + 0.5 and bottom <= height + 0.5
        assert inside, (state, name, left, top, right, bottom)
    for (one, a), (other, b) in itertools.combinations(places.items(), 2):
        across, down = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
        assert across < 1 or down < 1, (state, one, a, other, b)
    for text, *margins in browser.run("pinflex.frame();" + MARKS):
        assert min(margins) >= -0.5, (state, text, margins)


def violations(browser: Browser) -> list[str]:
    """What axe-core, which the page has been given, finds against accessibility."""
    return list(
        browser.driver.execute_async_script(
            "const done = arguments[0]; axe.run({resultTypes: ['violations']}).then(found =>"
            " done(found.violations.map(v => v.id + ': ' + v.nodes.map(n => n.target).join())))"
        )
    )
