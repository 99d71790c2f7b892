"""Frames of a page whose slider is dragged: how far apart, and how much of them is its own work.

How long a frame lasts depends on what else the machine does; the CPU time of the page's thread does
not, and is what a page can be held to anywhere.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.browser.chromium import Browser
from tests.browser.trying import until

_WATCH = """
const w = window.watched = {at: [], long: []};
const mark = (now) => { w.at.push(now); w.id = requestAnimationFrame(mark); };
mark(performance.now());
w.long_tasks = new PerformanceObserver((l) => {
  w.long.push(...l.getEntries().map((e) => e.duration));
});
w.long_tasks.observe({type: "longtask"});"""
_SEEN = """
const w = window.watched;
cancelAnimationFrame(w.id);
w.long_tasks.disconnect();
return {at: w.at, long: w.long, waits: pinflex.live.waits}"""
_DRAG = """
const [name, moves, every, done] = arguments, s = document.getElementById("live-" + name);
let k = 0;
const id = setInterval(() => {
  s.value = +s.min + (s.max - s.min) * (0.5 - 0.5 * Math.cos(k / 8));
  s.dispatchEvent(new Event("input", {bubbles: true}));
  if (++k >= moves) { clearInterval(id); done(); }
}, every);"""


@dataclass(frozen=True)
class Frames:
    """All in ms.

    Attributes:
        gaps: Between frames of the browser. long: Its tasks above 50 ms.
        own: CPU time of each task of the page's thread.
        waits: From a move of the slider to its curves.
    """

    gaps: np.ndarray[Any, Any]
    long: np.ndarray[Any, Any]
    own: np.ndarray[Any, Any]
    waits: np.ndarray[Any, Any]


def dragged(browser: Browser, name: str, moves: int, every: int = 50) -> Frames:
    """What the browser does while a slider is moved every few ms."""
    trace = _Trace(browser)
    browser.run("pinflex.live.waits = {};" + _WATCH)
    browser.driver.execute_async_script(_DRAG, name, moves, every)
    until(browser, "return pinflex.live.done === pinflex.live.sent")
    seen = browser.run(_SEEN)
    waits = np.array(list(seen["waits"].values()), float)
    return Frames(np.diff(seen["at"]), np.array(seen["long"], float), trace.own(), waits)


class _Trace:
    """The tracing of a browser, which says the CPU time of every task."""

    def __init__(self, browser: Browser) -> None:
        from websocket import create_connection  # comes with selenium

        profile = Path(browser.driver.capabilities["chrome"]["userDataDir"])
        port, path = (profile / "DevToolsActivePort").read_text().split()
        self._socket = create_connection(
            f"ws://127.0.0.1:{port}{path}", suppress_origin=True, timeout=60
        )
        categories = ["toplevel", "devtools.timeline"]
        config = {"includedCategories": categories, "excludedCategories": ["*"]}
        self._ask("Tracing.start", {"transferMode": "ReportEvents", "traceConfig": config})
        self._until(lambda said: said.get("id") == 1)

    def _ask(self, method: str, given: dict[str, Any]) -> None:
        self._socket.send(json.dumps({"id": 1, "method": method, "params": given}))

    def _until(self, found: Any) -> list[dict[str, Any]]:
        said = [json.loads(self._socket.recv())]
        while not found(said[-1]):
            said.append(json.loads(self._socket.recv()))
        return said

    def own(self) -> np.ndarray[Any, Any]:
        """CPU time [ms] of each task of the thread that has drawn frames, and end the tracing."""
        self._ask("Tracing.end", {})
        said = self._until(lambda x: x.get("method") == "Tracing.tracingComplete")
        self._socket.close()
        events = [
            e
            for x in said
            if x.get("method") == "Tracing.dataCollected"
            for e in x["params"]["value"]
        ]
        drew = {(e["pid"], e["tid"]) for e in events if e["name"] == "FireAnimationFrame"}
        return np.array([
            e.get("tdur", 0) / 1e3 for e in events
            if (e["pid"], e["tid"]) in drew and e["name"].endswith("RunTask") and e["ph"] == "X"
        ])  # fmt: skip
