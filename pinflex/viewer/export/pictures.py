"""Pictures and films of a run, by a browser where there is one, as lines by matplotlib if not."""

from __future__ import annotations

import base64
import io
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, PinflexError
from pinflex.results.result import Result
from pinflex.viewer.links import FIELDS, centreline, triangles
from pinflex.viewer.scene import build_scene
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Pictures and films of a page, by a headless Chromium where there is one.
#
# One run of the browser makes one picture or a whole film: the page itself draws every instant and
# leaves the pictures in its own text, which the browser prints. No port is opened, and no process
# stays behind.

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
MACOS = "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome"
_GROUND = 48  # colours of a .gif kept for the background
FLAGS = (
    "--headless=new",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # software WebGL where there is no graphics card
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
)


def find_browser() -> str | None:
    """Path of a Chromium, or None; PINFLEX_BROWSER names the one to take."""
    wish = os.environ.get("PINFLEX_BROWSER")
    names = (wish,) if wish else (*BROWSERS, MACOS)
    return next((found for found in map(shutil.which, names) if found), None)


def browser() -> str:
    """Path of a Chromium."""
    found = find_browser()
    if found:
        return found
    raise PinflexError(
        f"capture: no Chromium was found (looked for {', '.join(BROWSERS)}). Pictures and films "
        "are drawn by it. Install chromium, or name one in PINFLEX_BROWSER; the page itself "
        "saves a picture or a film from its Display menu."
    )


def picture(
    page: str | Path,
    path: str | Path,
    at: float | None = None,
    size: tuple[int, int] = (1280, 800),
    **state: object,
) -> Path:
    """Save the whole page at one instant as a .png."""
    path = Path(path).resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    if at is not None:
        state["t"] = at
    _run(page, {"shadow": 1, "sharp": 2, **state}, size, [f"--screenshot={path}"])
    if not path.is_file():
        raise PinflexError(
            f"capture: {browser()} wrote no {path.name}. Open {page} in it to see why."
        )
    return path


def captured_film(
    page: str | Path,
    path: str | Path,
    *,
    seconds: float = 6.0,
    fps: int = 20,
    size: tuple[int, int] = (960, 600),
    **state: object,
) -> Path:
    """Save the whole motion as a .gif, .mp4 or .webm with its legend."""
    path = Path(path)
    if path.suffix not in (".gif", ".mp4", ".webm"):
        raise DescriptionError(
            f"capture: {path.name}: {path.suffix!r} is no film. Allowed: .gif, .mp4, .webm."
        )
    ffmpeg = shutil.which("ffmpeg")
    if path.suffix != ".gif" and ffmpeg is None:
        raise PinflexError(
            f"capture: {path.name}: ffmpeg was not found. Install it, or ask for a .gif."
        )
    state |= {"shots": max(2, round(seconds * fps)), "size": f"{size[0]}x{size[1]}", "ui": 0}
    printed = _run(page, state, size, ["--dump-dom"])
    own = printed[printed.rfind('id="pinflex-shots"') :]  # before it: icons of the viewer
    found = re.findall(r"data:image/png;base64,([A-Za-z0-9+/=]+)", own)
    shots = [base64.b64decode(s) for s in found]
    if not shots:
        raise PinflexError(
            f"capture: {browser()} drew nothing of {page}. Open it there to see why."
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        _gif(shots, path, fps)
    else:
        _encode(str(ffmpeg), shots, path, fps)
    return path


def _run(page: str | Path, state: dict[str, object], size: tuple[int, int], task: list[str]) -> str:
    page = Path(page).resolve()
    if not page.is_file():
        raise DescriptionError(f"capture: {page}: no such page. Write it with pinflex.view first.")
    address = f"{page.as_uri()}#{urlencode(state)}"
    sandbox = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with tempfile.TemporaryDirectory(
        prefix="pinflex-browser-", ignore_cleanup_errors=True
    ) as profile:
        command = [browser(), *FLAGS, *sandbox, f"--user-data-dir={profile}"]
        command += [f"--window-size={size[0]},{size[1]}", "--virtual-time-budget=10000"]
        try:
            done = subprocess.run(
                [*command, *task, address], capture_output=True, text=True, timeout=600, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise PinflexError(
                f"capture: {command[0]} did not finish in {error.timeout:g} s. Ask for fewer or "
                "smaller pictures (fps, seconds, size)."
            ) from None
    if done.returncode:
        raise PinflexError(
            f"capture: {command[0]} failed ({done.returncode}): {done.stderr.strip()[-300:]}"
        )
    return done.stdout


def _gif(shots: list[bytes], path: Path, fps: int) -> None:
    from PIL import Image  # comes with matplotlib

    frames = [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]
    palette = _palette(frames)
    still = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    still[0].save(path, save_all=True, append_images=still[1:], duration=round(1000 / fps), loop=0)


def _palette(frames: list[Any]) -> Any:
    """One palette for all pictures, so that nothing flickers.

    A palette by area would be spent on the background and lose the few pixels of a path or a peak;
    one by colour would leave steps in the background, so that has some of its own.
    """
    from PIL import Image

    some = frames[:: max(1, len(frames) // 4)]
    width, height = some[0].size
    sample = Image.new("RGB", (width, height * len(some)))
    for i, frame in enumerate(some):
        sample.paste(frame, (0, i * height))
    edge = some[0].crop((width - 2, 0, width, height))
    whole = edge.quantize(_GROUND).getpalette() or []
    whole = whole[: 3 * _GROUND]
    rest = sample.quantize(256 - _GROUND, method=Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette((whole + rest)[: 3 * 256])
    return palette


def _encode(ffmpeg: str, shots: list[bytes], path: Path, fps: int) -> None:
    codec = (
        ["-c:v", "libx264", "-crf", "18"] if path.suffix == ".mp4" else ["-crf", "30", "-b:v", "0"]
    )
    command = [ffmpeg, "-y", "-loglevel", "error", "-f", "image2pipe", "-framerate", str(fps)]
    command += ["-c:v", "png", "-i", "-", *codec, "-pix_fmt", "yuv420p"]
    command += ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", str(path)]
    done = subprocess.run(command, input=b"".join(shots), capture_output=True, check=False)
    if done.returncode:
        raise PinflexError(f"capture: ffmpeg failed: {done.stderr.decode(errors='replace')[-300:]}")


# Pictures and films without a browser: the robot as lines in space, drawn by matplotlib.

_DPI = 100
# Elevation and azimuth [deg] for a mechanism flat in x, y, z, or (last) in none.
_VIEWS = ((8, -8), (8, -80), (58, -90), (20, -58))
BASE = "\0base"  # marks a line as no link of the user's
GREY, PALE = "#56637a", "#c3c9d2"


def drawn_picture(scene: dict[str, Any], path: Path, at: float, field: str, title: str) -> Path:
    """Write one instant as a .png."""
    figure, draw = _canvas(scene, field, title, (12.8, 8.0))
    draw(int(np.argmin(np.abs(scene["t"] - at))))
    with replaced(path) as part:
        figure.savefig(part, dpi=_DPI)
    return path


def drawn_film(
    scene: dict[str, Any], path: Path, field: str, title: str, seconds: float, fps: int
) -> Path:
    """Write the whole motion as a .gif."""
    figure, draw = _canvas(scene, field, title, (8.0, 5.0))
    shots = []
    for t in np.linspace(scene["t"][0], scene["t"][-1], max(2, round(seconds * fps))):
        draw(int(np.argmin(np.abs(scene["t"] - t))))
        shot = io.BytesIO()
        figure.savefig(shot, dpi=_DPI * 0.8)
        shots.append(shot.getvalue())
    with replaced(path) as part:
        _gif(shots, part, fps)
    return path


def _canvas(
    scene: dict[str, Any], field: str, title: str, size: tuple[float, float]
) -> tuple[Figure, Callable[[int], None]]:
    """A figure and what draws instant k into it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped,unused-ignore]

    figure = Figure(figsize=size)
    axes: Any = figure.add_axes((0.14, 0.0, 0.86, 0.95), projection="3d")
    mag = scene["scale"]
    label, unit, factor = FIELDS[field]
    values = {link["name"]: factor * np.abs(_field(link, field)) for link in scene["links"]}
    top = max((float(v.max()) for v in values.values()), default=0.0) or 1.0
    colours = ScalarMappable(Normalize(0.0, top), "viridis")
    figure.text(0.03, 0.93, title, weight="bold", size=13)
    caption = figure.text(0.03, 0.89, "", size=9)
    if values:
        bar = figure.colorbar(colours, cax=figure.add_axes((0.03, 0.3, 0.014, 0.45)))
        bar.ax.set_title(f"{label} [{unit}]", size=10, loc="left", pad=10)
        bar.outline.set_visible(False)

    some = np.linspace(0, len(scene["t"]) - 1, 12).astype(int).tolist()
    cloud = np.concatenate([line for k in some for line, _ in polylines(scene, k, mag)])
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    extent = np.maximum(high - low, 0.1 * (float((high - low).max()) or 1.0))
    axes.view_init(*view_of(extent))
    reach, middle = extent / 2, (low + high) / 2

    def draw(k: int) -> None:
        axes.clear()
        axes.set_axis_off()
        for line, _ in polylines(scene, k, 0.0):
            axes.plot(*line.T, color=PALE, lw=1.0, clip_on=False)
        for line, name in polylines(scene, k, mag):
            if name in values:
                pieces = np.stack([line[:-1], line[1:]], axis=1)
                shown = colours.to_rgba((values[name][k, :-1] + values[name][k, 1:]) / 2)
                style = {"colors": shown, "linewidths": 3.5, "clip_on": False}
                axes.add_collection3d(Line3DCollection(pieces, **style))
            else:
                base = name == BASE
                style = {"lw": 1.0 if base else 2.5, "marker": "o", "ms": 4, "clip_on": False}
                axes.plot(*line.T, color=PALE if base else GREY, **style)
        for axis, c, r in zip("xyz", middle, reach, strict=True):
            axes.set(**{f"{axis}lim": (c - r, c + r)})
        axes.set_box_aspect(reach, zoom=1.3)
        caption.set_text(f"t = {scene['t'][k]:.4g} s, deflection \u00d7{mag:g}")

    return figure, draw


def view_of(extent: Array) -> tuple[int, int]:
    """Elevation and azimuth [deg] from which a mechanism of this extent, (3,), is seen well."""
    return _VIEWS[int(extent.argmin()) if extent.min() < 0.15 * extent.max() else -1]


def magnified(body: dict[str, Any], k: int, mag: float) -> Array:
    """Affine map (3, 4) that draws a body at instant k."""
    pose = body["rigid"][min(k, len(body["rigid"]) - 1)]
    return np.asarray(pose if body["disp"] is None else pose + mag * body["disp"][k]).reshape(3, 4)


def _field(link: dict[str, Any], field: str) -> Array:
    if field in link["surface"]:  # at a station, the largest of the points nearest to it
        nearest = np.abs(triangles(link["mesh"])[0][:, :1] - link["x"]).argmin(axis=1)
        stress = link["surface"][field]
        largest = [stress[:, nearest == i].max(axis=1, initial=0.0) for i in range(len(link["x"]))]
        return np.stack(largest, axis=1)
    if field in link["fields"]:
        return np.asarray(link["fields"][field])
    return np.asarray(np.linalg.norm(link["disp"], axis=2))


def polylines(scene: dict[str, Any], k: int, mag: float) -> list[tuple[Array, str]]:
    """Lines of an instant [m], each with the name of its flexible link, `BASE` or ""."""
    lines = [(centreline(link, k, mag), link["name"]) for link in scene["links"]]
    for body in scene["bodies"]:
        pose = magnified(body, k, mag)
        points = np.array(body["points"]).reshape(-1, 3)
        if len(points) > 2:
            points = np.concatenate([points, points[:1]])
        if len(points):
            lines.append((points @ pose[:, :3].T + pose[:, 3], BASE if body["base"] else ""))
    return lines


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
    if find_browser():
        return Picture(picture(page, path, at))
    scene = build_scene(result, scale=scale, meshes=None)
    return Picture(drawn_picture(scene, path, at, field, scene["name"]), _without("picture"))


def film(result: Result, page: Path, path: Path, field: str, scale: float | str) -> Picture:
    """Write the whole motion as a .gif or .mp4; arguments as in `still`."""
    if find_browser():
        return Picture(captured_film(page, path, seconds=SECONDS, fps=FPS))
    if path.suffix != ".gif":
        raise PinflexError(
            f"view: {path.name}: no Chromium was found, which draws its pictures. Install chromium "
            "(and ffmpeg), or ask for --gif, which can do without."
        )
    scene = build_scene(result, scale=scale, meshes=None)
    written = drawn_film(scene, path, field, scene["name"], SECONDS, FPS // 2)
    return Picture(written, _without("film"))


def _without(kind: str) -> str:
    return f"no Chromium was found: the {kind} shows lines, drawn by matplotlib"
