"""Pages that compute, at random places of their sliders: `python -m tests.benchmarks.live`.

For each model a page is written and opened in headless Chromium; its sliders are moved to places at
random, and what the page has computed is held against

- the native kernel in the same steps and what `pinflex.recovery` reads off it: what differs is
  round-off. Beside it stands what a payload 1e-15 heavier changes of the native run: less cannot be
  asked of a page; and
- `pf.solve` with the page's own overrides at a hundredth of its tolerance (what the page tells as
  its error should cover that).

Printed: largest differences of torque, platform (of how far it is off the rigid robot, which may be
micrometres; and in metres) and stress; told over true error; times from a move to the torques and
to everything; and the longest pieces of drawing that a re-run adds to a frame of the animation
(median and largest over the run).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

import pinflex as pf
from tests.browser.chromium import Browser
from tests.browser.trying import (
    TOL,
    bends_apart,
    differences,
    moved,
    opened,
    pages,
    same_steps,
    somewhere,
)

MODELS = ("delta", "ur5", "3rrr")
KEYS = ("torque", "platform", "stress")
TOLD = (*KEYS, "deflection")
METRES = "platform [m]"


def heavier(overrides: list[str]) -> list[str]:
    """The same with a payload 1e-15 heavier."""
    (payload,) = (x for x in overrides if x.startswith("payload="))
    block = json.loads(payload.removeprefix("payload="))
    block["mass"] *= 1.0 + 1e-15
    return [x for x in overrides if x != payload] + [f"payload={json.dumps(block)}"]


def of_run(run: pf.Result, platform: str, links: Iterable[str]) -> dict[str, Any]:
    """A run as `moved` has that of a page."""
    stress = {link: run.arrays[f"link/{link}/stress/von_mises"].ravel() for link in links}
    return {"torque": run.torque, "position": run.frames[platform].position, "stress": stress}


def round_off(found: dict[str, Any], run: pf.Result, mechanism: pf.Mechanism) -> dict[str, float]:
    """`differences`, and how far the platform is from that of the run."""
    position = run.frames[mechanism.description.platform].position.ravel()
    metres = float(np.abs(np.ravel(found["position"]) - position).max())
    return differences(found, run, mechanism) | {METRES: metres}


def row(browser: Browser, model: str, page: Path, places: int, seed: int) -> dict[str, Any]:
    """What is printed of a model."""
    opened(browser, page)
    rng = np.random.default_rng(seed)
    same, grown, true, told, times, tables = [], [], [], [], [], 0.0
    for _ in range(places):
        found = moved(browser, somewhere(browser, rng))
        mechanism = pf.load(model, found["overrides"])
        t = np.array(found["t"])
        native = same_steps(mechanism, t)
        same.append(round_off(found, native, mechanism))
        other = same_steps(pf.load(model, heavier(found["overrides"])), t)
        other = of_run(other, mechanism.description.platform, found["stress"])
        grown.append(round_off(other, native, mechanism))
        run = pf.solve(mechanism, tol=TOL / 100, samples=len(t))
        true.append(differences(found, run, mechanism) | bends_apart(native, run))
        told.append([found["error"][key] / true[-1][key] for key in TOLD])
        times.append(found["took"])
        tables = max(tables, found["tables"])
    pieces = browser.run("return pinflex.live.pieces")
    return {
        "same": {key: max(x[key] for x in same) for key in (*KEYS, METRES)},
        "grown": {key: max(x[key] for x in grown) for key in (*KEYS, METRES)},
        "true": {key: max(x[key] for x in true) for key in TOLD},
        "told": np.quantile(told, (0.0, 0.5, 1.0), axis=0).T.tolist(),
        "tables": tables,
        "times": {key: float(np.median([x[key] for x in times])) for key in ("torque", "error")},
        "pieces": {name: (float(np.median(x)), max(x)) for name, x in pieces.items()},
    }


def lines(found: dict[str, Any]) -> list[str]:
    """A row in words."""
    off = {
        key: ", ".join(f"{k} {x:.1e}" for k, x in found[key].items())
        for key in ("same", "grown", "true")
    }
    told = ", ".join(
        f"{key} {a:.2f} to {c:.2f} (median {b:.2f})"
        for key, (a, b, c) in zip(TOLD, found["told"], strict=True)
    )
    pieces = sorted(found["pieces"].items(), key=lambda x: -x[1][0])[:4]
    drawn = ", ".join(f"{name} {a:.0f} ({b:.0f})" for name, (a, b) in pieces)
    return [
        f"off the native kernel    {off['same']}",
        f"of a payload 1e-15 more  {off['grown']}",
        f"off pf.solve             {off['true']}",
        f"told over true error     {told}",
        f"told of tables           {found['tables']:.1e}",
        "ms to torques, to all    " + ", ".join(f"{x:.0f}" for x in found["times"].values()),
        f"ms a piece of drawing    {drawn}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("models", nargs="*", default=MODELS)
    parser.add_argument("--places", type=int, default=20)
    parser.add_argument("--seed", type=int, default=31)
    asked = parser.parse_args()
    for browser, model, page in pages(asked.models):
        print(f"{model}, {asked.places} places, {page.stat().st_size / 1e6:.2f} MB")
        found = row(browser, model, page, asked.places, asked.seed)
        print("".join(f"  {line}\n" for line in lines(found)), end="", flush=True)


if __name__ == "__main__":
    main()
