"""A film of the page, and the plots under a finger, on a phone held upright.

Claims:
    Pages, pictures, figures
    - the film of a page is a WebM of the drawing, as long as the motion | 0.8 to 3 s for 1 s |
      passes
"""

from __future__ import annotations

from pathlib import Path

import pytest

from pinflex.results.result import Result
from tests.browser.chromium import Browser

UPRIGHT = (390, 844)


def test_the_film_is_a_video_of_the_drawing(browser: Browser, page: Path) -> None:
    browser.open(page, "speed=0.2", size=UPRIGHT)
    start, size, seconds, pictures = browser.driver.execute_async_script(
        """const done = arguments[0], make = URL.createObjectURL;
        URL.createObjectURL = blob => { window.made = blob; return make(blob); };
        document.getElementById('film').click();
        const look = async () => {
          if (!window.made) { setTimeout(look, 50); return; }
          const start = [...new Uint8Array(await made.slice(0, 4).arrayBuffer())];
          const video = document.createElement('video');
          video.muted = true;
          video.onended = () => done(
            [start, [video.videoWidth, video.videoHeight], video.currentTime,
              video.getVideoPlaybackQuality().totalVideoFrames]);
          video.onloadeddata = () => video.play();
          video.src = make(made);
        };
        look();"""
    )
    assert bytes(start) == b"\x1a\x45\xdf\xa3"  # WebM
    assert size == browser.run("return [pane.clientWidth, pane.clientHeight]")
    assert 0.8 < seconds < 3  # 1 s, on a busy machine a bit more
    assert pictures >= 2
    assert browser.errors() == []


def test_a_finger_moves_the_cursor_scrolls_the_plots_and_hides_a_curve(
    browser: Browser, page: Path, run: Result
) -> None:
    def touch(kind: str, *points: tuple[float, float]) -> None:
        at = [{"x": x, "y": y} for x, y in points]
        browser.driver.execute_cdp_cmd(
            "Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": at}
        )

    browser.open(page, "t=0&sharp=0.5", size=UPRIGHT)
    browser.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
    try:
        left, top, width = browser.run(
            "const r = document.querySelector('#plots svg').getBoundingClientRect();"
            "return [r.left, r.top, r.width]"
        )
        touch("Start", (left + 150, top + 40))
        touch("End")
        wanted = (150 - 42) / (width - 50) * run.t[-1]  # axes from 42 px to 8 px before the end
        assert browser.run("return pinflex.state.t") == pytest.approx(wanted, rel=0.02)
        name = browser.run(
            "const r = plots.querySelector('[data-name=motor_2]').getBoundingClientRect();"
            "return [r.left + r.width / 2, r.top + r.height / 2]"
        )
        touch("Start", tuple(name))
        touch("End")
        hidden = "return pinflex.state.hide"
        assert any(browser.run(hidden) == ["motor_2"] for _ in range(200))  # a click comes later
        touch("Start", (300, top + 40))
        for x in range(290, 60, -20):
            touch("Move", (x, top + 40))
        touch("End")
        assert any(browser.run("return plots.scrollLeft") > 50 for _ in range(200))
        assert browser.run("return pinflex.state.zoom") is None
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
