"""A page that computes with its sliders moved, and what native runs have in its place."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pinflex as pf
from pinflex.arrays import Array
from pinflex.solver.solve import result_from, scene_of
from tests.browser.chromium import Browser
from tests.browser.native import apart, inside

TOL = 1e-3  # of the pages


def opened(
    browser: Browser, page: Path, size: tuple[int, int] = (1280, 800), wish: str = "sharp=0.3"
) -> None:
    """Open a page as its address wishes and wait for its kernel."""
    browser.open(page, wish, size=size)
    until(browser, "return !!(pinflex.live && pinflex.live.ready)")


def pages(models: Sequence[str]) -> Iterator[tuple[Browser, str, Path]]:
    """A browser and, one after the other, the pages of some models."""
    with tempfile.TemporaryDirectory() as folder:
        browser = Browser(Path(folder) / "profile")
        try:
            for model in models:
                yield browser, model, pf.live_page(model, Path(folder) / f"{model}.html").path
        finally:
            browser.driver.quit()


def until(browser: Browser, script: str) -> None:
    for _ in range(1200):
        if browser.run(script):
            return
        time.sleep(0.05)
    raise AssertionError(browser.run("return document.getElementById('live-status').textContent"))


GOT = """
const g = pinflex.live.got;
return {t: [...g.t], torque: [...g.torque], position: [...g.track.position], error: g.error,
  stress: Object.fromEntries(Object.entries(g.fields).map(([k, f]) => [k, [...f.von_mises]])),
  tables: g.told, took: pinflex.live.times, overrides: pinflex.live.overrides(),
  command: pinflex.live.commandLine()}"""


def moved(browser: Browser, settings: dict[str, float]) -> dict[str, Any]:
    """What the page has computed at settings of its sliders."""
    browser.run("pinflex.live.move(arguments[0])", settings)
    until(browser, "return pinflex.live.done === pinflex.live.sent")
    return dict(browser.run(GOT))


def somewhere(browser: Browser, rng: np.random.Generator) -> dict[str, float]:
    """A place of every slider, at random."""
    ranges = browser.run(
        "return Object.fromEntries(pinflex.live.sliders.map((s) => [s.name, [s.low, s.high]]))"
    )
    places = {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}
    return places | {name: float(round(x)) for name, x in places.items() if name == "shaper"}


def same_steps(mechanism: pf.Mechanism, t: Array) -> pf.Result:
    """The page's run by the native kernel, and everything read off it by `pinflex.recovery`."""
    scene, run = scene_of(mechanism, "coupled"), inside(mechanism, t)
    return result_from(mechanism, scene.motion, run, scene.spec, time.perf_counter())


def differences(found: dict[str, Any], run: pf.Result, mechanism: pf.Mechanism) -> dict[str, float]:
    """By quantity, the largest difference of a page from a run, over the largest value.

    torque; platform: of how far it is off the rigid robot; stress: of each link's own.
    """
    name = mechanism.description.platform
    rigid = pf.solve(mechanism, level="rigid", samples=len(run.t)).frames[name].position
    position = run.frames[name].position
    off = np.array(found["position"]).reshape(-1, 3) - position
    out = {
        "torque": apart(found["torque"], run.torque),
        "platform": float(np.abs(off).max() / np.abs(position - rigid).max()),
        "stress": 0.0,
    }
    for link, stress in found["stress"].items():
        x, drawn = run.arrays[f"link/{link}/x"], len(stress) // len(run.t)
        wanted = run.arrays[f"link/{link}/stress/von_mises"]
        if drawn == len(x):
            out["stress"] = max(out["stress"], apart(stress, wanted))
        else:  # the page draws some of the stations
            most = np.reshape(stress, (-1, drawn)).max(), wanted.max()
            out["stress"] = max(out["stress"], abs(most[0] - most[1]) / most[1])
    return out


def bends_apart(run: pf.Result, other: pf.Result, gears: Sequence[str] = ()) -> dict[str, float]:
    """Largest difference of how far links bend [m], and gears give way [rad], over the largest."""

    def bends(r: pf.Result) -> Array:
        return np.concatenate([r.link(name).deflection[:, :, :3] for name in r.links], axis=1)

    out = {"deflection": apart(bends(run), bends(other))}
    if gears:
        found, wanted = (np.array([r.drive(n).deflection for n in gears]) for r in (run, other))
        out["gear deflection"] = apart(found, wanted)
    return out
