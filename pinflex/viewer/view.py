"""One self-contained page that plays a run in a browser: offline, from file://, no server.

The page holds three.js (the folder vendor), the player (the folder page) and the arrays of the
runs, the first and the last deflated. Its content security policy names the two scripts by their
hash and allows no network at all; every name of the user's reaches the page as data, never as
markup.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import re
import sys
import tempfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.errors import DescriptionError, nearest
from pinflex.results.archive import by_significance, differences
from pinflex.results.result import Result
from pinflex.results.views import Deviation
from pinflex.text import frozen
from pinflex.viewer.links import FIELDS
from pinflex.viewer.scene import build_scenes, mode_scene, strength
from pinflex.writing import write_text

if TYPE_CHECKING:
    from pinflex.quickest.baselines import Baseline
    from pinflex.quickest.fastest import Fastest

# Data with many arrays as one short text, which a page unpacks (page/load.js).
#
# A number is kept to a millionth of the largest one of its array, or as coarsely as `Coarse` says,
# as an integer. Motion is smooth in time and along a link, so second differences are small: their
# high bytes, gathered, deflate to almost nothing. Equal arrays are kept once.

STEPS = 2**20  # of the largest magnitude of an array
Steps = npt.NDArray[np.int32]
_LEVEL = 2  # of zlib: 4 takes half as long again for 4 % less
_DIGITS = np.frombuffer(  # none that HTML escapes
    b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_|~",
    np.uint8,
)
_ALONG = 2  # differences along the second axis, at most
_ENOUGH = 8  # entries of a second axis that may be smooth: fewer are components of a vector


@dataclass(frozen=True)
class Coarse:
    """An array kept to `1 / steps` of its largest number."""

    values: Array
    steps: int


def pack(data: Any) -> str:
    """Lists, mappings, numbers, texts and arrays (time first) as text of deflated bytes."""
    pieces: dict[tuple[Any, ...], dict[str, Any]] = {}
    size = 0

    def placed(value: Any) -> Any:
        nonlocal size
        if isinstance(value, np.generic):
            return value.item()
        steps = STEPS
        if isinstance(value, Coarse):
            value, steps = value.values, value.steps
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{type(value).__name__} has no place in a page")
        step, along, coded = _coded(value, steps)
        piece = coded, value.shape, step, along
        if piece not in pieces:
            pieces[piece] = {"packed": size, "shape": value.shape, "step": step, "along": along}
            size += len(coded)
        return pieces[piece]

    head = json.dumps(data, default=placed, allow_nan=False).encode()
    return deflated(len(head).to_bytes(4, "little"), head, *(coded for coded, *_ in pieces))


def deflated(*parts: bytes, level: int = _LEVEL) -> str:
    """Bytes in zlib's format, as text: a word of four is five digits, 6 % less than base64."""
    deflate = zlib.compressobj(level)
    data = b"".join([*[deflate.compress(part) for part in parts], deflate.flush()])
    words = np.frombuffer(data + bytes(-len(data) % 4), ">u4").astype(np.int64)
    digits = words[:, None] // 85 ** np.arange(4, -1, -1) % 85
    return str(_DIGITS[digits].tobytes()[: -(-5 * len(data) // 4)], "ascii")


def _coded(values: Array, count: int) -> tuple[float, int, bytes]:
    """Size of a step, differences along the second axis, and bytes by significance."""
    if not np.isfinite(np.sum(values)):
        values = np.nan_to_num(values)
    if values.dtype.kind == "f":
        step = float(np.abs(values).max(initial=0.0)) / count or 1.0
        rounded = values / step
        steps = np.rint(rounded, out=rounded).astype(np.int32)
    else:
        step, steps = 1.0, values.astype(np.int32)
    along, steps = _along(differences(differences(steps)))
    return step, along, by_significance(steps).tobytes()


def _along(steps: Steps) -> tuple[int, Steps]:
    """Differences along the second axis as often as makes the numbers shorter."""
    if steps.ndim < 2 or steps.shape[1] < _ENOUGH:
        return 0, steps
    best, times, shortest = steps, 0, _bits(steps)
    for n in range(1, _ALONG + 1):
        steps = differences(steps, 1)
        if (bits := _bits(steps)) < shortest:
            best, times, shortest = steps, n, bits
    return times, best


def _bits(steps: Steps) -> float:
    sizes = np.abs(steps).astype(np.float32)  # in single precision a logarithm takes a quarter
    return float(np.log2(1 + sizes).sum(dtype=np.float64))


FRAME = 640  # [px] height of a page in a notebook
# Files of the folder page, in this order one script and one style sheet.
PLAYER = (
    *("load", "state", "layout", "theme", "viewer", "meshes", "sweep", "base", "bodies", "links"),
    *("arrows", "paths", "scene", "motion", "ghost", "camera", "compass", "colours", "legend"),
    *("labels", "hover", "chart", "zoom", "names", "plots", "beam", "table", "export", "controls"),
    "player",
)
STYLE = ("theme", "layout", "stage", "dock", "beam", "small")
# Steps of the largest number of an array of a link, where a millionth is more than can be seen:
# positions and stresses to 8e-6 of it, section forces and directions of sections to 1.3e-4.
COARSE = {"disp": 2**16, "y_disp": 2**12, "fields": 2**16, "sections": 2**12}
_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; \
script-src {hashes}{allowed}; style-src 'unsafe-inline'; img-src data: blob:; \
media-src blob:; base-uri 'none'; form-action 'none'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="generator" content="pinflex"><title>{title}</title>
<style>{css}</style></head><body><div id="app"></div>
<noscript>This page plays a motion and needs JavaScript.</noscript>
<script type="text/plain" id="pinflex-data">{data}</script>{more}
<!-- three.js, copyright 2010-2026 three.js authors, MIT licence; see https://threejs.org -->
<script type="text/plain" id="pinflex-viewer">{viewer}</script>
<script>{player}</script>
</body></html>
"""


def write_html(
    runs: Result | Mapping[str, Result],
    path: str | Path,
    *,
    field: str = "von_mises",
    scale: float | str = "auto",
    title: str | None = None,
    rigid: Result | None = None,
    limit: float | None = None,
    meshes: Sequence[str | Path] | None = (),
    first: str | None = None,
    off_path: Mapping[str, Deviation] | None = None,
) -> Path:
    """Write one page that plays a run; it needs no network, no server and no pinflex to be read.

    Several runs of one mechanism, by the words that it shows, are switched, overlaid, subtracted.

    Returns:
        The file written.
    """
    labels = () if isinstance(runs, Result) else tuple(runs)
    results = [runs] if isinstance(runs, Result) else list(runs.values())
    if not results:
        raise DescriptionError("view: no run was given. Give at least one.")
    if rigid is None and labels:
        rigid = next((run for run in results if run.level == "rigid"), None)
    page = _settings(results, field, limit) | {"first": 0 if first is None else labels.index(first)}
    away = [(off_path or {}).get(words) for words in labels]
    scenes = build_scenes(results, rigid, _scale(scale), meshes, away)
    for scene, words in zip(scenes, labels, strict=False):
        scene["label"] = words
    return _write(scenes, path, title or scenes[0]["name"], page)


def write_modes_html(shapes: Iterable[tuple[float, Result]], path: str | Path) -> Path:
    """Write one page with a picker of mode shapes, played by the same player."""
    bare: dict[str, Any] = {"forces": [], "torques": [], "plots": [], "track": None}
    scenes = [
        mode_scene(result) | {"mode": {"frequency": float(frequency)}} | bare
        for frequency, result in shapes
    ]
    if not scenes:
        raise DescriptionError("view: no mode shape was given. Compute at least one mode.")
    page = {"field": "displacement", "limit": None}
    return _write(scenes, path, f"{scenes[0]['name']}: mode shapes", page)


_RACING = 300  # instants of each of up to six runs
_ABOVE = 6.0  # times the band: further from rest a curve runs along the top of its plot


def write_race(found: Fastest, rows: Sequence[Baseline], path: str | Path) -> Path:
    """Write one page of the fastest motion and the best of each usual profile.

    One plot has how far every platform is from rest; lines mark the instants from which all robots
    stay within the band.
    """
    best = {row.name.partition(" + ")[0]: row for row in reversed(rows)}  # the first to be still
    racers = [("fastest", found.runs["nominal"], found.rest, found.settled)]
    racers += [
        (row.name, row.run, row.rest, row.settled)
        for row in sorted(best.values(), key=lambda row: row.settled)
    ]
    runs = [run for _, run, *_ in racers]
    words = [
        f"{name}, still at {still:.4g} s" if np.isfinite(still) else f"{name}, not still"
        for name, *_, still in racers
    ]
    away = [1e3 * np.linalg.norm(run.frame(found.frame).position - rest, axis=1)
            for _, run, rest, _ in racers]  # fmt: skip
    high = _ABOVE * 1e3 * found.band
    scenes = build_scenes(runs, meshes=(), instants=_RACING)
    for k, scene in enumerate(scenes):
        order = sorted(range(len(runs)), key=lambda j: j != k)  # its own curve in front
        curves = [
            {"name": racers[j][0], "y": np.minimum(np.interp(scene["t"], runs[j].t, away[j]), high),
             "colour": j, "rigid": False} for j in order
        ]  # fmt: skip
        rest = {"title": f"{found.frame} from rest", "unit": "mm", "curves": curves, "race": True}
        scene |= {"label": words[k], "plots": [rest, *scene["plots"]]}
        scene["marks"] = [
            {"t": racer[3], "colour": j, "name": words[j], "own": j == k}
            for j, racer in enumerate(racers) if np.isfinite(racer[3])
        ]  # fmt: skip
    page = _settings(runs, "von_mises", None) | {"first": 0}
    return _write(scenes, path, f"{found.name}: the fastest move and the usual ones", page)


def _settings(results: Sequence[Result], field: str, limit: float | None) -> dict[str, Any]:
    """Field shown at first, and the stress above which the colour changes [MPa]."""
    if field not in FIELDS:
        raise DescriptionError(f"view: field: {field!r} is not drawn." + nearest(field, FIELDS))
    return {"field": field, "limit": _lowest_strength(results) if limit is None else 1e-6 * limit}


@frozen
class Page:
    """A page that was written: a path for programs, and shown in place by a notebook."""

    path: Path

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)

    def open(self) -> None:
        """Open the page in a browser, where somebody would see it."""
        if has_desktop():
            import webbrowser

            webbrowser.open(self.path.resolve().as_uri())

    def _repr_html_(self) -> str:
        # a frame of its own, which may run the player's scripts and nothing of the notebook's
        page = html.escape(self.path.read_text("utf-8"))
        return (
            '<iframe sandbox="allow-scripts allow-downloads" style="border:0" width="100%" '
            f'height="{FRAME}" title="pinflex: {html.escape(self.path.stem)}" srcdoc="{page}">'
            "</iframe>"
        )


@dataclass(frozen=True)
class More:
    """What a page has beside the player.

    Attributes:
        script, style: Behind the player's own. data: Deflated, read as `inflated("pinflex-live")`.
        allowed: Sources of scripts, and other directives, that its policy allows too.
    """

    script: str = ""
    style: str = ""
    data: bytes = b""
    allowed: str = ""

    @property
    def element(self) -> str:
        """The data in the page."""
        if not self.data:
            return ""
        data = deflated(self.data, level=9)
        return f'\n<script type="text/plain" id="pinflex-live">{data}</script>'


@public
def view(
    result: Result | Mapping[str, Result],
    path: str | Path | None = None,
    open_browser: bool = False,
    **options: Any,
) -> Page:
    """Write the page of a run and, on a desktop, open it; a notebook shows it in place.

    Args:
        result: The run, or several of one mechanism by the words that the page shows; of several
            the last is shown first.
        path: Where to write; default a file in a temporary folder.
        open_browser: Open the page; left out where nobody could see it (CI, ssh, no display).
        **options: As in `write_html`.

    Returns:
        The page; it can be used as a path.
    """
    runs = {"": result} if isinstance(result, Result) else dict(result)
    if path is None:
        names = (_slug(str(run.meta.get("name", "result"))) for run in runs.values())
        path = Path(tempfile.mkdtemp(prefix="pinflex-")) / f"{next(names, 'result')}.html"
    if not isinstance(result, Result):
        options = {"first": next(reversed(runs), None), **options}
    page = Page(write_html(result, path, **options))
    if open_browser:
        page.open()
    return page


def has_desktop() -> bool:
    """True if a browser window opened now would be seen by somebody."""
    if os.environ.get("CI") or os.environ.get("SSH_CONNECTION"):
        return False
    shown = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return sys.platform in ("win32", "darwin") or bool(shown)


def page_text(
    scenes: list[dict[str, Any]], title: str, page: dict[str, Any], more: More | None = None
) -> str:
    """The whole page as text."""
    more = more or More()
    player = f'"use strict";\n(async () => {{\n{_joined(PLAYER, "js")}\n{more.script}}})();'
    hash_, viewer = _viewer()
    runs = [_coarse(scene) | {"t": scene["t"].tolist()} for scene in scenes]
    return _PAGE.format(
        hashes=f"'sha256-{hash_}' 'sha256-{_sha256(player)}'",
        title=html.escape(title),
        css=_joined(STYLE, "css") + more.style,
        allowed=more.allowed,
        more=more.element,
        data=pack({"title": title, "file": _slug(title), "first": 0, **page, "runs": runs}),
        viewer=viewer,
        player=player,
    )


def _coarse(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with arrays of links marked to be kept as coarsely as a picture may have them."""

    def marked(value: Any, steps: int) -> Any:
        if isinstance(value, dict):
            return {k: marked(v, steps) for k, v in value.items()}
        return Coarse(value, steps)

    links = [
        {k: marked(v, COARSE[k]) if k in COARSE else v for k, v in link.items()}
        for link in scene["links"]
    ]
    return {**scene, "links": links}


def _lowest_strength(results: Sequence[Result]) -> float | None:
    """Lowest yield strength [MPa] among the flexible links, where known."""
    every = (strength(result, link) for result in results for link in result.meta.get("links", {}))
    return min(filter(None, every), default=None)


def _write(
    scenes: list[dict[str, Any]], path: str | Path, title: str, page: dict[str, Any]
) -> Path:
    path = Path(path)
    if path.is_dir():
        path = path / f"{_slug(scenes[0]['name'])}.html"
    return write_text(path, page_text(scenes, title, page))  # its newlines are part of the hash


def _scale(scale: float | str) -> float | str:
    if scale == "auto":
        return "auto"
    try:
        value = float(scale)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < 1e9:
        raise DescriptionError(
            f'view: scale: {scale!r} is no magnification. Give a number >= 0 or "auto".'
        )
    return value


@cache
def _viewer() -> tuple[str, str]:
    """Hash and deflated text of three.js."""
    text = (files("pinflex.viewer") / "vendor" / "three.min.js").read_text("utf-8")
    text = text.replace("\r\n", "\n")
    return _sha256(text), deflated(text.encode(), level=4)


@cache
def _joined(names: tuple[str, ...], kind: str) -> str:
    folder = files("pinflex.viewer") / "page"
    texts = ((folder / f"{name}.{kind}").read_text("utf-8") for name in names)
    return "\n".join(texts).replace("\r\n", "\n")


def _sha256(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _slug(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "result"
