"""Pictures and films without a browser: the robot as lines in space, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.viewer.links import FIELDS, centreline, triangles
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_DPI = 100
# Elevation and azimuth [deg] for a mechanism flat in x, y, z, or (last) in none.
_VIEWS = ((8, -8), (8, -80), (58, -90), (20, -58))
BASE = "\0base"  # marks a line as no link of the user's
GREY, PALE = "#56637a", "#c3c9d2"


def still(scene: dict[str, Any], path: Path, at: float, field: str, title: str) -> Path:
    """Write one instant as a .png."""
    figure, draw = _canvas(scene, field, title, (12.8, 8.0))
    draw(int(np.argmin(np.abs(scene["t"] - at))))
    with replaced(path) as part:
        figure.savefig(part, dpi=_DPI)
    return path


def film(
    scene: dict[str, Any], path: Path, field: str, title: str, seconds: float, fps: int
) -> Path:
    """Write the whole motion as a .gif."""
    import io

    from PIL import Image

    figure, draw = _canvas(scene, field, title, (8.0, 5.0))
    count = max(2, round(seconds * fps))
    frames = []
    for t in np.linspace(scene["t"][0], scene["t"][-1], count):
        draw(int(np.argmin(np.abs(scene["t"] - t))))
        shot = io.BytesIO()
        figure.savefig(shot, dpi=_DPI * 0.8)
        frames.append(Image.open(shot).convert("RGB").quantize(96))
    with replaced(path) as part:
        frames[0].save(
            part, save_all=True, append_images=frames[1:], duration=round(1000 / fps), loop=0
        )
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
