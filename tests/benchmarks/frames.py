"""Frames of pages that compute while a slider is dragged: `python -m tests.benchmarks.frames`.

The animation plays in headless Chromium, which draws in software, and a slider moves twenty times
a second, and once a second. Printed: gaps between frames (requestAnimationFrame) and tasks above
50 ms (PerformanceObserver), which depend on what else the machine does, said by its load; the CPU
time of the longest task of the page's own thread, which does not; the time from a move of the
slider to its curves; and how sharply it was drawn (pixels a pixel of the page), in motion and at
rest.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

from tests.browser.frames import Frames, dragged
from tests.browser.trying import opened, pages

MODELS = ("delta", "ur5", "3rrr")
SIZES = ((1280, 800), (390, 844))
LONG = 50.5  # [ms] a frame that is too long, and the clock's grain


def line(found: Frames) -> str:
    """Frames in words."""
    gaps, own, waits = found.gaps, found.own, found.waits
    worst = found.long.max(initial=0.0)
    return (
        f"gaps {np.median(gaps):.0f}, {np.percentile(gaps, 95):.0f}, {gaps.max():.0f} ms (median, "
        f"95 %, most), {np.mean(gaps > LONG):.0%} above 50; {len(found.long)} long tasks, worst "
        f"{worst:.0f}; own CPU at most {own.max():.0f}; to the curve {np.median(waits):.0f}, "
        f"{waits.max():.0f} ms (median, most)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("models", nargs="*", default=MODELS)
    asked = parser.parse_args()
    for browser, model, page in pages(asked.models):
        for size in SIZES:
            opened(browser, page, size, "play=1")
            print(f"{model}, {size[0]} x {size[1]}, load {os.getloadavg()[0]:.1f}")
            for words, moves, every in (("dragged", 60, 50), ("single moves", 5, 1000)):
                print(f"  {words}: {line(dragged(browser, 'damping', moves, every))}")
            moving = browser.run("return pinflex.sharpness.now")
            browser.run("pinflex.set({play: false})")
            time.sleep(1.5)
            still = browser.run("return pinflex.sharpness.now")
            print(f"  pixels in motion {moving:.2f}, at rest {still:.2f}", flush=True)


if __name__ == "__main__":
    main()
