"""How a search for the best design went."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, BoolArray
from pinflex.viewer.drawing import Drawing
from pinflex.viewer.panels import new_figure, styled
from pinflex.viewer.tornado import DOWN, UP, bar_height, short_key

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def histories(
    aims: Array, kept: BoolArray, label: str, parameters: Sequence[str], first: Array, best: Array
) -> Drawing:
    """The aim over the designs tried ("search"), how far every parameter has moved ("change")."""
    change = 100.0 * (np.asarray(best) / np.asarray(first) - 1.0)
    search = partial(_search, aims=aims, kept=np.asarray(kept, bool), label=label)
    moved = partial(_change, parameters=parameters, change=change)

    def whole() -> Figure:
        figure = new_figure(10.0, max(2.8, bar_height(len(parameters))), layout="constrained")
        for ax, draw in zip(
            figure.subplots(1, 2, width_ratios=(1.2, 1.0)), (search, moved), strict=True
        ):
            draw(styled(ax))
        return figure

    return Drawing(whole, {"search": search, "change": moved})


def _search(ax: Axes, aims: Array, kept: BoolArray, label: str) -> None:
    from matplotlib.ticker import MaxNLocator

    number = np.arange(1, len(aims) + 1)
    ax.plot(number, aims, color="0.75", linewidth=0.8, zorder=1)
    ax.scatter(number[kept], aims[kept], s=14, color=UP, label="keeps every limit")
    if not np.all(kept):
        ax.scatter(number[~kept], aims[~kept], s=14, facecolor="none", edgecolor=DOWN,
                   linewidth=0.9, label="breaks a limit")  # fmt: skip
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlabel("design")
    ax.set_ylabel(label)
    ax.margins(x=0.03)
    ax.legend(fontsize=8, frameon=False)


def _change(ax: Axes, parameters: Sequence[str], change: Array) -> None:
    rows = np.arange(len(parameters))[::-1]
    ax.barh(rows, change, color=np.where(change >= 0, UP, DOWN).tolist(), height=0.7)
    ax.set_yticks(rows, [short_key(name) for name in parameters])
    ax.axvline(0.0, color="0.2", linewidth=0.8)
    ax.set_xlabel("change of the parameter [%]")
    ax.margins(x=0.05)
    ax.spines["left"].set_visible(False)
    ax.tick_params(axis="y", length=0)
