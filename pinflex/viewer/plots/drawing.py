"""The one convention of `.plot()`: axes are returned, `ax` is taken, several panels have names.

A figure of one panel gives its axes, of several an array of them, colour scales last or beside
their panel. `panel` draws one of several alone, which then also goes on axes of the caller's.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.errors import DescriptionError, nearest
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Figures of panels in one style: open, thin frames, set by hand or by matplotlib.
#
# Colours are the colour-blind-safe set of Okabe and Ito (2008).

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
    rows: int,
    columns: int,
    height: float = HEIGHT,
    room: Room | None = Room(),
    width: float = WIDTH,
    **grid: Any,
) -> tuple[Figure, Any]:
    """A figure and its axes (rows, columns), with open, thin frames; `room` is of `WIDTH`."""
    sizes: dict[str, Any] = {"height_ratios": grid.pop("height_ratios", None)}
    figure = new_figure(width, height, layout=None if room else "constrained")
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
        if room is not None:
            _set_names(ax, figure)
    return figure, axes


def stack(
    parts: Iterable[Callable[[Axes], object]],
    height: float = HEIGHT,
    room: Room | None = None,
    legend: int | None = 0,
) -> Figure:
    """A figure of panels below each other, over one horizontal axis; the first has the heading.

    `legend`: the panel whose legend stays; None: those of all.
    """
    draws = list(parts)
    figure, axes = panels(len(draws), 1, height, room, sharex=True)
    for k, (ax, draw) in enumerate(zip(axes[:, 0], draws, strict=True)):
        draw(ax)
        ax.xaxis.set_visible(k == len(draws) - 1)  # a line tells where the others end
        if k:
            title(ax, "")
        if legend not in (None, k) and ax.get_legend():
            ax.get_legend().remove()
    return figure


_NAMES = 0.55, 0.27  # [in] from the axes that they name: left, below


def _set_names(ax: Axes, figure: Figure) -> None:
    """Names of the axes at one distance: those of a stack of panels stand above each other."""
    from matplotlib.transforms import ScaledTranslation

    scale, (left, below) = figure.dpi_scale_trans, _NAMES
    ax.yaxis.set_label_coords(0.0, 0.5, ax.transAxes + ScaledTranslation(-left, 0.0, scale))
    ax.xaxis.set_label_coords(0.5, 0.0, ax.transAxes + ScaledTranslation(0.0, -below, scale))
    ax.ticklabel_format(axis="y", scilimits=(-3, 4))  # longer numbers would reach the name


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


_ALONE = 0.75  # of the usual height, for one panel of several
_LISTED = 8  # names in an error


@dataclass(frozen=True)
class Drawing:
    """A figure, and its panels one by one.

    Attributes:
        whole: Makes the figure; None: its one panel alone is the figure.
        panels: By name, draws one panel on axes; its further axes (a scale) it adds itself.
        height: Of one panel alone [in].
    """

    whole: Callable[[], Figure] | None
    panels: Mapping[str, Callable[[Axes], object]]
    height: float = _ALONE * HEIGHT

    def axes(
        self, panel: str | None = None, ax: Axes | None = None, path: str | Path | None = None
    ) -> Any:
        """Draw, and return the axes: one, or an array of several."""
        if panel is None and ax is not None:
            panel = self._only()
        if panel is not None and panel not in self.panels:
            raise DescriptionError(f"plot: panel {panel!r}: no such panel.{self._names(panel)}")
        if ax is None:
            whole = self.whole if panel is None else None
            make = whole or self._alone(panel or self._only())
            drawn = shown_axes(make) if path is None else axes_of(make())
        else:
            self.panels[str(panel)](styled(ax))
            title(ax, "")  # a heading is of figures of our own, as in `axes.draw`
            drawn = ax
        if path is not None:
            save(drawn, path)
        return drawn

    def _alone(self, panel: str) -> Callable[[], Figure]:
        def make() -> Figure:
            figure, axes = panels(1, 1, self.height, None)
            self.panels[panel](axes[0, 0])
            return figure

        return make

    def _only(self) -> str:
        """The panel that `ax` is for."""
        if len(self.panels) == 1:
            return next(iter(self.panels))
        how = f"Name one: panel=...{self._names('')}" if self.panels else "Leave ax out."
        raise DescriptionError(f"plot: this figure has several panels, and `ax` holds one. {how}")

    def _names(self, panel: str) -> str:
        return nearest(panel, self.panels, _LISTED)


def save(axes: Any, path: str | Path) -> Path:
    """Write the figure that axes stand in; returns the file.

    Runs of equal bytes are all that a curve on white has: looked for alone they take a fifth of the
    time off.
    """
    path = check_figure(path)
    figure = np.atleast_1d(axes).flat[0].get_figure(root=True)
    quick = {"pil_kwargs": {"compress_level": 1, "compress_type": zlib.Z_RLE}}
    with replaced(path) as part:
        figure.savefig(part, **(quick if path.suffix == ".png" else {}))
    return path


def check_figure(path: str | Path) -> Path:
    """The path of a figure, if there is such a kind; its folder is made."""
    path = Path(path)
    if path.suffix not in (".png", ".pdf", ".svg"):
        raise DescriptionError(f"{path}: no such kind of figure. Allowed: .png, .pdf, .svg.")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
