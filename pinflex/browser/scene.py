"""A scene with its sliders as one packed text that a page unpacks (page/worker.js)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.browser import sliders
from pinflex.browser.image import laid_out
from pinflex.browser.recipe import live_scene, recipe, tables_of
from pinflex.description.description import Description
from pinflex.mechanics.mechanism import load

# Of the tolerance: resolution of the steps. Two corrections of each then leave a tenth of it.
RESOLUTION = 0.5


@dataclass(frozen=True)
class LiveScene:
    """What the page computes by.

    Attributes:
        header, values: See page/heap.js and page/solver.js.
        left_out: Sliders that do not work here, with the reason.
    """

    header: dict[str, Any]
    values: Array
    left_out: dict[str, str]


def scene_of_page(description: Description, t: Array) -> LiveScene:
    """The scene of a description at samples t (s), with every slider that it may have.

    Raises:
        DescriptionError: A page cannot run it.
    """
    mechanism = load(description)
    live_scene(mechanism)  # a payload would be told instead of what is the matter
    proposed = sliders.proposed(mechanism)
    # Absent, not zeroed, in every other run; here it has to be there to be moved.
    base = [x for s in proposed if s.name == sliders.PAYLOAD for x in s.for_tables(1.0)]
    found = sliders.changes(description, proposed, tables_of, base)
    scene = live_scene(load(description, base))
    tol = scene.spec.tol or 1e-3
    made = recipe(scene, RESOLUTION * tol, t, found.pattern)
    header, line = laid_out(made.image)
    parts, at = [line], len(line)

    def put(values: Array) -> list[int]:
        nonlocal at
        parts.append(np.asarray(values, float).ravel())
        at += parts[-1].size
        return [at - parts[-1].size, parts[-1].size]

    header |= made.header | {"tol": tol, "sliders": [
        _slider(s, found.changes.get(s.name), put) for s in found.sliders
    ]}  # fmt: skip
    return LiveScene(header, np.concatenate(parts), found.left_out)


def _slider(slider: sliders.Slider, change: sliders.Change | None, put: Any) -> dict[str, Any]:
    out = {key: x for key, x in asdict(slider).items() if key not in ("keys", "made_by")}
    out["keys"] = slider.keys
    out["made"] = 1.0
    if change is None:
        return out | {"change": None}
    told = {"kind": change.kind, "nodes": change.nodes.tolist(), "error": change.error}
    values = change.values
    if change.kind == "polynomial":
        columns, which = change.columns()
        told["columns"], told["count"] = put(columns), columns.shape[1]
        values = {name: np.asarray(x, float) for name, x in which.items()}
    arrays = [
        [name, put(entries), put(values[name]) if values[name].size else None]
        for name, entries in change.entries.items()
    ]
    return out | {"change": told | {"arrays": arrays}}


def packed(scene: LiveScene, wasm: bytes, script: str) -> bytes:
    """Kernel, script, header and numbers one after the other, each with its length before it.

    Numbers are split by the significance of their bytes, which deflates better.
    """
    head = json.dumps(scene.header, allow_nan=False).encode()
    planes = np.ascontiguousarray(scene.values, "<f8").view(np.uint8).reshape(-1, 8).T.tobytes()
    pieces: Sequence[bytes] = (wasm, script.encode(), head, planes)
    return b"".join(len(p).to_bytes(4, "little") + p for p in pieces)
