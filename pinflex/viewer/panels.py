"""Figures of panels in one style: open, thin frames, set by hand or by matplotlib.

Colours are the colour-blind-safe set of Okabe and Ito (2008).
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
WIDTH, HEIGHT, DPI = 7.0, 4.5, 150  # [in], [in], [dots/in]
_SHOWN: ContextVar[bool] = ContextVar("shown", default=False)


@dataclass(frozen=True)
class Room:
    """Space [in] about and between panels, set by hand: found by matplotlib it costs a drawing."""

    left: float = 0.75
    right: float = 0.15
    top: float = 0.3
    bottom: float = 0.5
    between: tuple[float, float] = (0.6, 0.25)


def new_figure(width: float, height: float, **options: Any) -> Figure:
    """An empty figure: of pyplot inside `shown_axes`, else one that no window knows of."""
    if _SHOWN.get():
        from matplotlib import pyplot

        return pyplot.figure(figsize=(width, height), dpi=DPI, **options)
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI, **options)


def shown_axes(make: Callable[[], Figure]) -> Any:
    """Axes of a figure made as pyplot's, which a notebook or a window shows."""
    token = _SHOWN.set(True)
    try:
        return axes_of(make())
    finally:
        _SHOWN.reset(token)


def axes_of(figure: Figure) -> Any:
    """The axes of a figure: one, or an array of several, shape (n,)."""
    axes = figure.axes
    return axes[0] if len(axes) == 1 else np.array(axes, dtype=object)


def styled(ax: Axes) -> Axes:
    """Axes with open, thin frames and small texts."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_linewidth(0.6)
    ax.tick_params(width=0.6, labelsize=8)
    ax.xaxis.label.set_fontsize(9)
    ax.yaxis.label.set_fontsize(9)
    ax.margins(x=0.01)
    return ax


def panels(
    rows: int, columns: int, height: float = HEIGHT, room: Room | None = Room(), **grid: Any
) -> tuple[Figure, Any]:
    """A figure and its axes (rows, columns), with open, thin frames."""
    sizes: dict[str, Any] = {"height_ratios": grid.pop("height_ratios", None)}
    figure = new_figure(WIDTH, height, layout=None if room else "constrained")
    if room is not None:
        wide, high = WIDTH - room.left - room.right, height - room.top - room.bottom
        across, down = room.between
        sizes |= {"left": room.left / WIDTH, "right": 1 - room.right / WIDTH}
        sizes |= {"bottom": room.bottom / height, "top": 1 - room.top / height}
        sizes["wspace"] = across * columns / max(wide - across * (columns - 1), 0.1)
        sizes["hspace"] = down * rows / max(high - down * (rows - 1), 0.1)
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw=sizes, **grid)
    for ax in axes.flat:
        styled(ax)
    return figure, axes


def aligned(*axes: Axes) -> None:
    """Names of the vertical axes one above the other, at the left edge of the figure."""
    for ax in axes:
        ax.yaxis.set_label_coords(-0.55 / (ax.get_position().width * WIDTH), 0.5)


def legend_above(ax: Axes, count: int) -> None:
    """A legend in one line at the right of the heading, where no curve is."""
    if count:
        right: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.99)}
        text: dict[str, Any] = {"frameon": False, "fontsize": 8, "borderaxespad": 0.0}
        ax.legend(ncols=min(count, 6), **right, **text)


def title(ax: Axes, text: str) -> None:
    """A small heading at the left."""
    # at y = 1 by word: to find that nothing stands above, matplotlib lays out every tick twice
    ax.set_title(text, loc="left", fontsize=9, y=1.0)
