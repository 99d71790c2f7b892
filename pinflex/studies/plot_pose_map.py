"""Figures of a map of poses: curves along one coordinate, or maps over two."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.studies.frequency_map import check_figure, draw_frequencies
from pinflex.studies.pose_map import PoseMap
from pinflex.studies.stiffness import free, free_stiffness
from pinflex.viewer.panels import COLOURS, DPI, WIDTH, panels, title
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANELS = 3  # a row
_PREFIXES = (("M", 1e6), ("k", 1e3), ("", 1.0))
_FLAT = 0.02  # of the largest value: what varies less needs no lines of equal height


def plot_pose_map(poses: PoseMap) -> Figure:
    """Frequencies, and below them how stiff the platform is along each axis that gives way.

    Stiffness is here 1/C_xx (others free), the force per displacement along its own axis. Axes
    along which the platform is rigid are named in the title.
    Of a grid with more than two coordinates, the others are drawn at their middle.
    """
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
    draw = _curves if len(drawn) == 1 else _maps
    figure: Figure = draw(frequencies, stiffness, x, labels)
    figure.suptitle(_title(poses, drawn), x=0.01, ha="left", fontsize=10)
    return figure


def _title(poses: PoseMap, drawn: list[int]) -> str:
    """State of the motors, load, coordinates that are not drawn, rigid directions."""
    rest = [
        f"{name} = {values[len(values) // 2]:.4g}"
        for k, (name, values) in enumerate(poses.grid.items())
        if k not in drawn
    ]
    return ", ".join(
        [
            f"{poses.name}: motors {'free in frequencies' if poses.free_motors else 'locked'}",
            "under gravity" if poses.preload == "gravity" else "undeformed",
            *rest,
            *([f"platform rigid along {', '.join(poses.rigid)}"] if poses.rigid else []),
        ]
    )


def save_pose_map(poses: PoseMap, path: str | Path) -> Path:
    """Write the figure (.png, .pdf, .svg); returns the file."""
    path = check_figure(path)
    with replaced(path) as part:
        plot_pose_map(poses).savefig(part, dpi=DPI)
    return path


def _curves(frequencies: Array, stiffness: dict[str, Array], x: list[Array], labels: Any) -> Figure:
    figure, axes = panels(1 + bool(stiffness), 1, 3.2 * (1 + bool(stiffness)), None, sharex=True)
    draw_frequencies(axes[0, 0], x[0], frequencies, labels[0].split("[")[1][:-1], "no answer")
    if stiffness:
        ax = axes[1, 0]
        for k, (name, values) in enumerate(stiffness.items()):
            # dashed and on top: of two equal ones both are seen
            dashes = (0, (4, 4)) if k % 2 else "-"
            ax.plot(x[0], values, color=COLOURS[k], lw=1.3, ls=dashes, zorder=2 + k % 2, label=name)
        ax.set_yscale("log")
        ax.set_ylabel("stiffness")
        ax.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1, 0].set_xlabel(labels[0])
    return figure


def _maps(frequencies: Array, stiffness: dict[str, Array], x: list[Array], labels: Any) -> Figure:
    """One panel each: the first frequencies, and the axes that give way, translations first."""
    from matplotlib.ticker import ScalarFormatter

    rows = [
        {
            f"mode {k + 1} [Hz]": frequencies[..., k]
            for k in range(min(_PANELS, frequencies.shape[-1]))
        },
        {name.replace(" [", "\n["): v for name, v in [*stiffness.items()][:_PANELS]},
    ]
    rows = [row for row in rows if row]
    columns = max(map(len, rows))
    height = 0.6 + len(rows) * WIDTH / columns * 0.95
    figure, axes = panels(len(rows), columns, height, None, sharex=True, sharey=True)
    for row, line in zip(rows, axes, strict=True):
        for ax, (name, values) in zip(line, row.items(), strict=False):
            flat = np.ptp(values[np.isfinite(values)]) <= _FLAT * np.nanmax(np.abs(values))
            # a scale that resolves a thousandth: ticks of few digits, and no colours of round-off
            middle, spread = float(np.nanmean(values)), _FLAT * float(np.nanmax(np.abs(values)))
            scale = {"vmin": middle - spread, "vmax": middle + spread} if flat else {}
            image = ax.pcolormesh(
                *x, values.T, cmap="viridis", shading="gouraud", rasterized=True, **scale
            )
            if not flat:
                lines = ax.contour(*x, values.T, 6, colors="white", linewidths=0.6)
                ax.clabel(lines, fontsize=7, fmt=lambda level: f"{level:.4g}")
            bar = figure.colorbar(
                image, ax=ax, pad=0.02, aspect=30, format=ScalarFormatter(useOffset=False)
            )
            bar.ax.tick_params(width=0.6, labelsize=7)
            bar.outline.set_visible(False)
            title(ax, name)
        for spare in line[len(row) :]:
            spare.remove()
        line[0].set_ylabel(labels[1])
    for ax in axes[-1]:
        ax.set_xlabel(labels[0])
    return figure


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
