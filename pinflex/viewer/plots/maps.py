"""Figures of a map of poses: curves along one coordinate or a motion, maps over two; of play."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.results.play import Play, PlayMap
from pinflex.results.pose_map import PoseMap, free, free_stiffness
from pinflex.viewer.plot import figure_of
from pinflex.viewer.plots.drawing import COLOURS, WIDTH, Drawing, panels, stack, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_PANELS = 3  # a row
_PREFIXES = (("M", 1e6), ("k", 1e3), ("", 1.0))
_WIDE = 1 / 15  # a lowest frequency below this share of the highest: on a logarithmic axis
_FLAT = 0.02  # of the largest value: what varies less needs no lines of equal height


@dataclass(frozen=True)
class _Cut:
    """The part of a map that is drawn: one or two coordinates, the others at their middle."""

    drawn: list[int]
    x: list[Array]
    labels: list[str]
    frequencies: Array
    stiffness: dict[str, Array]


def plot_map(poses: PoseMap) -> Figure:
    """Frequencies, and below them how stiff the platform is along each axis that gives way.

    Stiffness is here 1/C_xx (others free), the force per displacement along its own axis. Axes
    along which the platform is rigid are named in the title.
    Of a grid with more than two coordinates, the others are drawn at their middle.
    """
    cut = _cut(poses)
    alone = len(cut.drawn) == 1
    curves = _curves(poses, cut).values()
    figure = stack(curves, 3.2 * len(curves), legend=None) if alone else _maps(cut)
    figure.suptitle(_title(poses, cut.drawn), x=0.01, ha="left", fontsize=10)
    return figure


def axes_of_map(
    poses: PoseMap,
    panel: str | None = None,
    ax: Axes | None = None,
    path: str | Path | None = None,
) -> Any:
    """Axes of `plot_map`."""
    cut = _cut(poses)
    each: Mapping[str, Callable[[Axes], object]] = (
        _curves(poses, cut)
        if len(cut.drawn) == 1
        else {
            name: partial(_map, name=name, values=values, cut=cut)
            for row in _rows(cut)
            for name, values in row.items()
        }
    )
    return Drawing(lambda: plot_map(poses), each).axes(panel, ax, path)


def _cut(poses: PoseMap) -> _Cut:
    sizes = [len(values) for values in poses.grid.values()]
    wide = [k for k, size in enumerate(sizes) if size > 1]
    if not wide:
        raise DescriptionError(f"{poses.name}: one pose makes no plot. Give a grid with a:b:n.")
    drawn = wide[:2]
    cut = tuple(slice(None) if k in drawn else size // 2 for k, size in enumerate(sizes))
    frequencies, stiffness = poses.frequencies[cut], _stiffness(poses.compliance[cut])
    frequencies = frequencies[..., np.isfinite(frequencies).any(axis=tuple(range(len(drawn))))]
    if not frequencies.size:
        raise DescriptionError(f"{poses.name}: no pose of the middle of the grid has an answer.")
    x = [list(poses.grid.values())[k] for k in drawn]
    names = [list(poses.grid)[k] for k in drawn]
    labels = [f"{name} from home [{poses.units[name]}]" for name in names]
    if poses.along_motion:
        labels = ["time along the motion [s]"]
    return _Cut(drawn, x, labels, frequencies, stiffness)


def _title(poses: PoseMap, drawn: list[int]) -> str:
    """State of the motors, load, coordinates that are not drawn, rigid directions."""
    rest = [
        f"{name} = {values[len(values) // 2]:.4g}"
        for k, (name, values) in enumerate(poses.grid.items())
        if k not in drawn
    ]
    motors = "free in frequencies" if poses.free_motors else "locked"
    return ", ".join(
        [
            f"{poses.name}: {'along the motion, ' * poses.along_motion}motors {motors}",
            "under gravity" if poses.preload == "gravity" else "undeformed",
            *rest,
            *([f"platform rigid along {', '.join(poses.rigid)}"] if poses.rigid else []),
        ]
    )


def _curves(poses: PoseMap, cut: _Cut) -> dict[str, Callable[[Axes], object]]:
    """Panels by name, along one coordinate."""
    stiff = {"stiffness": partial(_stiffness_panel, cut=cut)} if cut.stiffness else {}
    return {"frequencies": partial(_frequency_panel, poses=poses, cut=cut), **stiff}


def _frequency_panel(ax: Axes, poses: PoseMap, cut: _Cut) -> None:
    unit = poses.units[list(poses.grid)[cut.drawn[0]]]
    _draw_frequencies(ax, cut.x[0], cut.frequencies, unit)
    ax.set_xlabel(cut.labels[0])


def _stiffness_panel(ax: Axes, cut: _Cut) -> None:
    from matplotlib.ticker import LogFormatter

    for k, (name, values) in enumerate(cut.stiffness.items()):
        # dashed and on top: of two equal ones both are seen
        dashes = (0, (4, 4)) if k % 2 else "-"
        style: dict[str, Any] = {"lw": 1.3, "ls": dashes, "zorder": 2 + k % 2, "label": name}
        ax.plot(cut.x[0], values, color=COLOURS[k], **style)
    ax.set_yscale("log")
    for part in (ax.yaxis.set_major_formatter, ax.yaxis.set_minor_formatter):
        part(LogFormatter(minor_thresholds=(1.5, 0.4)))
    ax.tick_params(which="minor", labelsize=8, width=0.4)
    ax.set_ylabel("stiffness")
    ax.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    ax.set_xlabel(cut.labels[0])


def _rows(cut: _Cut) -> list[dict[str, Array]]:
    """Panels by name: the first frequencies, and the axes that give way, translations first."""
    f = cut.frequencies
    rows = [
        {f"mode {k + 1} [Hz]": f[..., k] for k in range(min(_PANELS, f.shape[-1]))},
        dict([*cut.stiffness.items()][:_PANELS]),
    ]
    return [row for row in rows if row]


def _maps(cut: _Cut) -> Figure:
    """One panel each."""
    rows = _rows(cut)
    columns = max(map(len, rows))
    height = 0.6 + len(rows) * WIDTH / columns * 0.95
    figure, axes = panels(len(rows), columns, height, None, sharex=True, sharey=True)
    for row, line in zip(rows, axes, strict=True):
        for ax, (name, values) in zip(line, row.items(), strict=False):
            _map(ax, name.replace(" [", "\n[") if "Hz" not in name else name, values, cut)
            ax.label_outer()
        for spare in line[len(row) :]:
            spare.remove()
    return figure


def _map(ax: Axes, name: str, values: Array, cut: _Cut) -> None:
    """One quantity over two coordinates, with its scale of colours."""
    from matplotlib.ticker import ScalarFormatter

    flat = np.ptp(values[np.isfinite(values)]) <= _FLAT * np.nanmax(np.abs(values))
    # a scale that resolves a thousandth: ticks of few digits, and no colours of round-off
    middle, spread = float(np.nanmean(values)), _FLAT * float(np.nanmax(np.abs(values)))
    scale: dict[str, Any] = {"vmin": middle - spread, "vmax": middle + spread} if flat else {}
    image = ax.pcolormesh(
        *cut.x, values.T, cmap="viridis", shading="gouraud", rasterized=True, **scale
    )
    if not flat:
        lines = ax.contour(*cut.x, values.T, 6, colors="white", linewidths=0.6)
        ax.clabel(lines, fontsize=7, fmt=lambda level: f"{level:.4g}")
    bar = figure_of(ax).colorbar(
        image, ax=ax, pad=0.02, aspect=30, format=ScalarFormatter(useOffset=False)
    )
    bar.ax.tick_params(width=0.6, labelsize=7)
    bar.outline.set_visible(False)
    title(ax, name)
    ax.set_xlabel(cut.labels[0])
    ax.set_ylabel(cut.labels[1])


def _stiffness(compliance: Array) -> dict[str, Array]:
    """1/C_ii (others free) of the axes that give way at every pose that has numbers."""
    shown = {}
    for i, values in enumerate(np.moveaxis(free_stiffness(compliance), -1, 0)):
        known = np.isfinite(compliance[..., i, i])
        if known.any() and np.all((values[known] > 0) & (values[known] < np.inf)):
            size = float(np.max(values[known]))
            prefix, factor = next((p, f) for p, f in _PREFIXES if size > f or not p)
            unit = "N/m" if i < 3 else "N m/rad"
            shown[f"{free(i)} [{prefix}{unit}]"] = values / factor
    return shown


def _draw_frequencies(ax: Axes, t: Array, frequencies: Array, unit: str) -> None:
    """One line a mode, numbered; the lowest frequency of all marked."""
    frequencies = frequencies[:, np.isfinite(frequencies).any(axis=0)]
    for i, column in enumerate(frequencies.T):
        ax.plot(t, column, color=COLOURS[i % len(COLOURS)], lw=1.3, clip_on=False)
    known = np.isfinite(frequencies).all(axis=1)
    top, bottom = float(np.nanmax(frequencies)), float(np.nanmin(frequencies))
    n = int(np.flatnonzero(known)[-1])
    wide = 0 < bottom < _WIDE * top
    if wide:
        ax.set_yscale("log")
        low, high = bottom / (top / bottom) ** 0.12, top * (top / bottom) ** 0.06
    else:
        low, high = min(0.0, 1.06 * bottom), 1.06 * top
    ax.set_ylim(low, high)
    for group in _close_together(_heights(ax, frequencies[n]), 0.045):
        ax.annotate(
            ", ".join(str(i + 1) for i in sorted(group)),
            (t[n], float(np.mean(frequencies[n][group]))), (5, 0), va="center",
            textcoords="offset points", fontsize=9, annotation_clip=False,
            color=COLOURS[group[0] % len(COLOURS)] if len(group) == 1 else "0.2",
        )  # fmt: skip
    lowest = np.where(known, np.min(frequencies, axis=1), np.inf)
    if np.ptp(lowest[known]) > 1e-3 * lowest.min():  # otherwise no pose is worse than another
        _mark_lowest(ax, t, lowest, unit)
    if not known.all() and n + 1 < len(t):
        ax.axvspan(t[n], t[-1], color="0.95", zorder=0)
        middle, place = (t[n] + t[-1]) / 2, ax.get_xaxis_transform()
        ax.text(middle, 0.5, "no answer", transform=place, fontsize=9, ha="center", color="0.4")
    ax.set_xlim(t[0], t[-1])
    ax.set_ylabel("natural frequency [Hz]")


def _mark_lowest(ax: Axes, t: Array, lowest: Array, unit: str) -> None:
    k = int(np.argmin(lowest))
    ax.plot(t[k], lowest[k], "o", mfc="white", mec="0.2", ms=5, zorder=5, clip_on=False)
    early, below = k < len(lowest) / 2, _heights(ax, lowest[[k]])[0] > 0.08
    ax.annotate(
        f"lowest {lowest[k]:.4g} Hz at {t[k]:.4g} {unit}", (t[k], lowest[k]),
        (8 if early else -8, -14 if below else 10), textcoords="offset points", fontsize=8,
        ha="left" if early else "right", bbox={"fc": "w", "ec": "none", "pad": 1}, zorder=4,
    )  # fmt: skip


def _heights(ax: Axes, values: Array) -> Array:
    """Heights of values on the vertical axis, 0 to 1."""
    points = np.column_stack([np.zeros(len(values)), values])
    return np.asarray((ax.transData - ax.transAxes).transform(points)[:, 1])


def _close_together(heights: Array, least: float) -> list[list[int]]:
    """Indices of heights, those closer than `least` to their neighbour in one group."""
    groups: list[list[int]] = []
    for i in np.argsort(heights):
        if groups and heights[i] - heights[groups[-1][-1]] < least:
            groups[-1].append(int(i))
        else:
            groups.append([int(i)])
    return groups


# The play of a platform: its outline at a pose, and the outlines over the workspace.

_ALONG = ("x", "y", "z")
_ROOM = 0.42  # of the distance between poses that the largest outline reaches to each side
_HIGH, _LOW = 0.8 * WIDTH, 0.45 * WIDTH  # [in], of a map and of a curve
_LENGTHS = ((1.0, "m"), (1e3, "mm"), (1e6, "um"), (1e9, "nm"))


def axes_of_play(play: Play, along: tuple[str, str], ax: Axes | None = None) -> Any:
    """Axes of the outline of a play."""
    return Drawing(None, {"outline": lambda on: _outline(on, play, along)}).axes(None, ax)


def axes_of_plays(plays: PlayMap, ax: Axes | None = None, path: str | Path | None = None) -> Any:
    """Axes of a map of plays."""
    height = _HIGH if _varied(plays)[1:] else _LOW
    return Drawing(None, {"play": lambda on: _draw_plays(on, plays)}, height).axes(None, ax, path)


def _outline(ax: Axes, play: Play, along: tuple[str, str]) -> None:
    rim = play.outline(along)
    if not np.all(np.isfinite(rim)):
        raise DescriptionError(f"{play.name}: the platform is free there. Draw other axes.")
    factor, names = 1.0, []
    for k, axis in enumerate(along):
        factor, unit = _unit(float(np.max(np.abs(rim[:, k]))))
        unit, factor = (unit, factor) if axis in _ALONG else ("mrad", 1e3)
        rim[:, k] *= factor
        names.append(f"{axis} [{unit}]")
    closed = np.vstack([rim, rim[:1]])
    ax.fill(*closed.T, color=COLOURS[0], alpha=0.15, lw=0)
    ax.plot(*closed.T, color=COLOURS[0], lw=1.3)
    ax.plot(0.0, 0.0, "+", color="0.3")
    if all(axis in _ALONG for axis in along):
        ax.set_aspect("equal")
    ax.set(xlabel=names[0], ylabel=names[1])


def _varied(plays: PlayMap) -> list[int]:
    found = [k for k, values in enumerate(plays.grid.values()) if len(values) > 1][:2]
    if not found:
        raise DescriptionError(f"{plays.name}: one pose makes no plot. Give a grid with a:b:n.")
    return found


def _draw_plays(ax: Axes, plays: PlayMap) -> None:
    """The longest way over one or two coordinates, in the second case with outlines."""
    drawn = _varied(plays)
    names = [list(plays.grid)[k] for k in drawn]
    x = [plays.grid[name] for name in names]
    sizes = plays.plays.shape
    cut = tuple(slice(None) if k in drawn else size // 2 for k, size in enumerate(sizes))
    each = plays.plays[cut]
    far = np.vectorize(lambda p: np.nan if p is None else p.farthest[0], otypes=[float])(each)
    far = np.where(np.isfinite(far), far, np.nan)
    if not np.isfinite(far).any():
        raise DescriptionError(f"{plays.name}: no pose of the middle of the grid has an answer.")
    factor, unit = _unit(float(np.nanmax(far)))
    title(ax, f"{plays.name}: play of the platform, motors still")
    labels = [f"{name} from home [{plays.units[name]}]" for name in names]
    ax.set_xlabel("time along the motion [s]" if names == ["t"] else labels[0])
    if len(drawn) == 1:
        ax.plot(x[0], far * factor, color=COLOURS[0], lw=1.3)
        ax.set_ylabel(f"longest way to a side [{unit}]")
        ax.set_ylim(bottom=0.0)
        return
    _outlines(ax, x, each, far, (factor, unit))
    ax.set_ylabel(labels[1])


def _outlines(ax: Axes, x: list[Array], each: Any, far: Array, of: tuple[float, str]) -> None:
    from matplotlib.collections import PolyCollection

    step = min(float(np.min(np.diff(values))) for values in x)
    largest = float(np.nanmax(far))
    larger = _ROOM * step / largest
    rims, colours = [], []
    for at in np.ndindex(*each.shape):
        if np.isfinite(far[at]):
            middle = np.array([x[0][at[0]], x[1][at[1]]])
            rims.append(middle + larger * each[at].outline())
            colours.append(far[at] * of[0])
    drawn = PolyCollection(rims, array=np.array(colours), cmap="viridis", lw=0.4, ec="0.2")
    ax.add_collection(drawn)
    low, high = (np.array([values[k] for values in x]) for k in (0, -1))
    ax.set_xlim(low[0] - 0.6 * step, high[0] + 0.6 * step)
    ax.set_ylim(low[1] - 0.6 * step, high[1] + 0.6 * step)
    ax.set_aspect("equal")
    bar = figure_of(ax).colorbar(drawn, ax=ax, pad=0.02, aspect=30)
    bar.set_label(f"longest way to a side [{of[1]}]", fontsize=9)
    bar.ax.tick_params(width=0.6, labelsize=7)
    bar.outline.set_visible(False)
    ax.set_xlabel(f"{ax.get_xlabel()}; outlines in x-y {_round(larger)} times larger")


def _unit(size: float) -> tuple[float, str]:
    """Factor and unit in which a length has one to three digits before the point."""
    return next((pair for pair in _LENGTHS if size * pair[0] >= 1.0), _LENGTHS[-1])


def _round(x: float) -> str:
    return f"{float(f'{x:.2g}'):g}"
