"""Pictures and films of a run, by a browser where there is one, as lines by matplotlib if not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinflex.errors import DescriptionError, PinflexError
from pinflex.results.result import Result
from pinflex.viewer.export import capture, lines
from pinflex.viewer.scene import build_scene

SECONDS, FPS = 6.0, 20  # of a film


@dataclass(frozen=True)
class Picture:
    """A file that was written, and what there is to say about it ("" for nothing)."""

    path: Path
    note: str = ""


def instant(result: Result, text: str) -> float:
    """Instant [s] that a text names: a number within the run, or "worst".

    The worst instant is that of the largest von Mises stress, in a section or on a surface.
    """
    if text == "worst":
        if not result.links:
            raise DescriptionError("view: worst: a rigid run has no stress. Give a time in s.")
        own = [result.arrays.get(f"link/{name}/mesh/von_mises") for name in result.links]
        stress = [*(result.link(name).von_mises for name in result.links), *own]
        peaks = np.max([s.max(axis=1) for s in stress if s is not None], axis=0)
        return float(result.t[int(np.argmax(peaks))])
    first, last = float(result.t[0]), float(result.t[-1])
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not first <= value <= last:
        raise DescriptionError(
            f"view: {text!r} is no instant of the run. Allowed: {first:g} to {last:g} s, or worst."
        )
    return value


def still(
    result: Result, page: Path, path: Path, at: float, field: str, scale: float | str
) -> Picture:
    """Write one instant as a .png."""
    if capture.find_browser():
        return Picture(capture.picture(page, path, at))
    scene = build_scene(result, scale=scale, meshes=None)
    return Picture(lines.still(scene, path, at, field, scene["name"]), _without("picture"))


def film(result: Result, page: Path, path: Path, field: str, scale: float | str) -> Picture:
    """Write the whole motion as a .gif or .mp4; arguments as in `still`."""
    if capture.find_browser():
        return Picture(capture.film(page, path, seconds=SECONDS, fps=FPS))
    if path.suffix != ".gif":
        raise PinflexError(
            f"view: {path.name}: no Chromium was found, which draws its pictures. Install chromium "
            "(and ffmpeg), or ask for --gif, which can do without."
        )
    scene = build_scene(result, scale=scale, meshes=None)
    written = lines.film(scene, path, field, scene["name"], SECONDS, FPS // 2)
    return Picture(written, _without("film"))


def _without(kind: str) -> str:
    return f"no Chromium was found: the {kind} shows lines, drawn by matplotlib"
