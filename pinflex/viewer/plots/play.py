"""Figures of the play of a platform: its outline at a pose, and the outlines over the workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.results.play import Play, PlayMap
from pinflex.viewer.plot import figure_of
from pinflex.viewer.plots.drawing import COLOURS, WIDTH, Drawing, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ALONG = ("x", "y", "z")
_ROOM = 0.42  # of the distance between poses that the largest outline reaches to each side
_HIGH, _LOW = 0.8 * WIDTH, 0.45 * WIDTH  # [in], of a map and of a curve
_UNITS = ((1.0, "m"), (1e3, "mm"), (1e6, "um"), (1e9, "nm"))


def axes_of_play(play: Play, along: tuple[str, str], ax: Axes | None = None) -> Any:
    """Axes of the outline of a play."""
    return Drawing(None, {"outline": lambda on: _outline(on, play, along)}).axes(None, ax)


def axes_of_plays(plays: PlayMap, ax: Axes | None = None, path: str | Path | None = None) -> Any:
    """Axes of a map of plays."""
    height = _HIGH if _wide(plays)[1:] else _LOW
    return Drawing(None, {"play": lambda on: _draw(on, plays)}, height).axes(None, ax, path)


def _outline(ax: Axes, play: Play, along: tuple[str, str]) -> None:
    rim = play.outline(along)
    if not np.all(np.isfinite(rim)):
        raise DescriptionError(f"{play.name}: the platform is free there: no outline.")
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


def _wide(plays: PlayMap) -> list[int]:
    found = [k for k, values in enumerate(plays.grid.values()) if len(values) > 1][:2]
    if not found:
        raise DescriptionError(f"{plays.name}: one pose makes no plot. Give a grid with a:b:n.")
    return found


def _draw(ax: Axes, plays: PlayMap) -> None:
    """The longest way over one or two coordinates, in the second case with outlines."""
    drawn = _wide(plays)
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
    _map(ax, x, each, far, (factor, unit))
    ax.set_ylabel(labels[1])


def _map(ax: Axes, x: list[Array], each: Any, far: Array, of: tuple[float, str]) -> None:
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
    return next((pair for pair in _UNITS if size * pair[0] >= 1.0), _UNITS[-1])


def _round(x: float) -> str:
    return f"{float(f'{x:.2g}'):g}"
