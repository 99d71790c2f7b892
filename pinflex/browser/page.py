"""The page that computes: the player's page with the kernel, the scene and its sliders in it."""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.browser import sliders
from pinflex.browser.recipe import laid_out, live_scene, recipe, tables_of, times
from pinflex.description.description import Description, read
from pinflex.errors import DescriptionError, PinflexError
from pinflex.kernel import build
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.results.result import Result
from pinflex.viewer.scene import build_scene, build_scenes
from pinflex.viewer.view import More, Page, _settings, page_text
from pinflex.writing import write_text

# A scene with its sliders as one packed text that a page unpacks (page/worker.js).

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
    """The scene of a description at samples t (s), with every slider that it may have."""
    mechanism = load(description)
    live_scene(mechanism)  # a payload would be told instead of what is the matter
    proposed = sliders.proposed(mechanism)
    # Absent, not zeroed, in every other run; here it has to be there to be moved.
    base = [x for s in proposed if s.name == sliders.PAYLOAD for x in s.for_tables(1.0)]
    found = sliders.changes(description, proposed, tables_of, base)
    made, tol = [], 1e-3
    for slider in (None, *(s for s in found.sliders if s.acts == "motion")):
        on = [] if slider is None else slider.overrides(1.0)
        scene = live_scene(load(description, [*base, *on]))
        tol = scene.spec.tol or 1e-3
        at = t if slider is None else np.linspace(0.0, times(scene)[-1], len(t))
        made.append(recipe(scene, RESOLUTION * tol, at, found.pattern))
    headers, line = laid_out(each.image for each in made)
    headers = [head | each.header for head, each in zip(headers, made, strict=True)]
    parts, size = [line], len(line)

    def put(values: Array) -> list[int]:
        nonlocal size
        parts.append(np.asarray(values, float).ravel())
        size += parts[-1].size
        return [size - parts[-1].size, parts[-1].size]

    header = headers[0] | {"tol": tol, "shaped": headers[1:], "sliders": [
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
    values, coded = change.values, change.coded
    if coded is not None:
        whole = np.where(coded.whole < 0, -2 * coded.whole - 1, 2 * coded.whole)
        told |= {
            "basis": put(coded.basis),
            "whole": put(2.0**52 + whole),
            "steps": put(coded.steps),
        }
        ends = np.cumsum([len(e) for e in change.entries.values()])[:-1]
        which = np.split(2 * coded.which + coded.negative, ends)
        values = {n: np.diff(x, prepend=0) for n, x in zip(change.entries, which, strict=True)}
    arrays = [
        [name, put(np.diff(entries, prepend=0)), put(values[name]) if values[name].size else None]
        for name, entries in change.entries.items()
    ]
    return out | {"change": told | {"arrays": arrays}}


def packed(scene: LiveScene, wasm: bytes, script: str) -> bytes:
    """Kernel, script, header and numbers one after the other, each with its length before it.

    Numbers are split by the significance of their bytes, and what headers say of one thing stands
    together: both deflate better.
    """
    plain = {key: x for key, x in scene.header.items() if key != "shaped"}
    headers = [plain, *(plain | shaped for shaped in scene.header["shaped"])]
    together = {key: [header[key] for header in headers] for key in plain}
    head = json.dumps(together, allow_nan=False, separators=(",", ":")).encode()
    planes = np.ascontiguousarray(scene.values, "<f8").view(np.uint8).reshape(-1, 8).T.tobytes()
    pieces: Sequence[bytes] = (wasm, script.encode(), head, planes)
    return b"".join(len(p).to_bytes(4, "little") + p for p in pieces)


# The kernel as WebAssembly: out of the wheel, or compiled on the first use and kept.

_BESIDE = Path(build.__file__).parent


@cache
def wasm() -> bytes:
    """The kernel for a page, of the C sources as they are."""
    name = build.wasm_name()
    for folder in (_BESIDE, _cache()):
        if (folder / name).exists():
            return (folder / name).read_bytes()
    folder = _BESIDE if os.access(_BESIDE, os.W_OK) else _cache()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        return build.compile_wasm(folder / name).read_bytes()
    except RuntimeError as error:
        raise PinflexError(
            f"a page that computes needs the kernel as WebAssembly, which is not there: {error}. "
            'Install it (pip install "pinflex[page]"), or write a page that plays.'
        ) from error


def _cache() -> Path:
    """A folder of this user's for what is compiled once."""
    home = os.environ.get("XDG_CACHE_HOME")
    if home or Path.home().is_dir():
        return (Path(home) if home else Path.home() / ".cache") / "pinflex"
    return Path(tempfile.gettempdir()) / "pinflex"


# In this order one script of the page's other thread.
WORKER = ("heap", "march", "settle", "start", "recover", "solver", "worker")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_ALLOWED = " 'wasm-unsafe-eval'; worker-src blob:"  # of the kernel; `eval` stays forbidden


@public
def live_page(
    model: str | Path | Description,
    path: str | Path,
    overrides: Sequence[str] = (),
    *,
    field: str = "von_mises",
    scale: float | str = "auto",
    meshes: Sequence[str | Path] | None = (),
) -> Page:
    """Write a page with sliders that solves the scene again in the browser, offline.

        pf.live_page("delta", "delta.html")

    The sliders are payload, speed of the move, damping, stiffness of the gears and thickness of
    sections, as far as the scene has them. Level coupled runs in the page, by the same compiled
    code as WebAssembly.

    Args:
        model: YAML file, its folder, a shipped name, or a Description.
        path: Where to write.
        overrides: "key.path=value" changes of the YAML.
        field: Colour, as in `view`. scale: Magnification. meshes: Folders with the URDF's meshes.
    Returns:
        The page; it can be used as a path.
    Raises:
        DescriptionError: A page cannot run the scene; the message says why.
        PinflexError: The kernel is not there as WebAssembly, nor can it be compiled.
    """
    description = model if isinstance(model, Description) else read(model)
    description = description.with_overrides(list(overrides))
    mechanism = load(description)
    tol = live_scene(mechanism).spec.tol
    run = solve(mechanism, level="coupled", tol=tol)
    shown = build_scene(run, None, scale, meshes)
    page = _settings([run], field, None)
    return _written(path, description, _command(model, overrides), [shown], 0, run, page)


def live_comparison(
    mechanism: Mechanism, runs: Mapping[str, Result], path: str | Path, command: str
) -> Page:
    """Write the page of runs by level, whose run of level coupled answers to sliders.

    `command`: the model as the command line has it. Raises DescriptionError where a page cannot run
    the scene.
    """
    if "coupled" not in runs:
        raise DescriptionError("compare: the page computes level coupled. Add it to --levels.")
    about, results = mechanism.description, list(runs.values())
    folders: list[str | Path] = [*about.package_dirs, *([about.path.parent] if about.path else [])]
    shown = build_scenes(results, runs.get("rigid"), "auto", folders, [None] * len(results))
    shown = [scene | {"label": level} for scene, level in zip(shown, runs, strict=True)]
    k = list(runs).index("coupled")
    page = _settings(results, "von_mises", None) | {"first": k}
    return _written(path, about, command, shown, k, runs["coupled"], page)


def _written(
    path: str | Path, description: Description, command: str, shown: list[dict[str, Any]], k: int,
    run: Result, page: dict[str, Any],
) -> Page:  # fmt: skip
    """The page of scenes, the k-th of which is the run that sliders change."""
    live = scene_of_page(description, np.asarray(shown[k]["t"], float))
    _pick_stations(live, shown[k], run)
    page["live"] = {
        "model": command, "tol": live.header["tol"], "motors": list(run.motors), "run": k,
        "left_out": live.left_out, "sliders": [
            {key: x for key, x in s.items() if key != "change"} for s in live.header["sliders"]
        ],
    }  # fmt: skip
    more = More(_text("live.js"), _text("live.css"), packed(live, wasm(), worker_text()), _ALLOWED)
    return Page(write_text(Path(path), page_text(shown, shown[k]["name"], page, more)))


def _pick_stations(live: LiveScene, shown: dict[str, Any], run: Result) -> None:
    """Let the page compute the stations that it shows."""
    for header in (live.header, *live.header["shaped"]):
        for link, drawn in zip(header["outputs"]["links"], shown["links"], strict=True):
            every = run.arrays[f"link/{link['name']}/x"]
            assert link["name"] == drawn["name"]
            link["kept"] = np.searchsorted(every, drawn["x"] - 1e-9).tolist()


def _command(model: Any, overrides: Sequence[str]) -> str:
    """The model as the command line has it, with its own overrides."""
    name = model.name if isinstance(model, Description) else str(model)
    return " ".join([name, *(f"--set '{change}'" for change in overrides)])


@cache
def worker_text() -> str:
    """The script of the other thread, without comments and indentation: the page is to be small."""
    script = _COMMENT.sub("", "\n".join(_text(f"{name}.js") for name in WORKER))
    return "\n".join(line for line in map(str.strip, script.splitlines()) if line)


def _text(name: str) -> str:
    text = (files("pinflex.browser") / "page" / name).read_text("utf-8")
    return text.replace("\r\n", "\n")
