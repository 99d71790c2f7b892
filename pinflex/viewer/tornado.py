"""Tornado chart of relative sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.viewer.drawing import Drawing
from pinflex.viewer.panels import new_figure, styled, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UP, DOWN = "#0072B2", "#D55E00"  # of `panels.COLOURS`: more, and less
_BARS = 12  # of a panel: the rest is too small to matter


def tornado(parameters: Sequence[str], outputs: Sequence[str], table: Array) -> Drawing:
    """One panel per output, its longest bars on top."""
    columns = np.nan_to_num(np.asarray(table, float)).T
    each = {
        output: partial(_bars, parameters=parameters, output=output, column=column)
        for output, column in zip(outputs, columns, strict=True)
    }
    height = bar_height(min(len(parameters), _BARS))

    def whole() -> Figure:
        across = min(len(outputs), 2)
        down = -(-len(outputs) // across)
        figure = new_figure(5.6 * across, 0.2 + down * height, layout="constrained")
        axes = figure.subplots(down, across, squeeze=False)
        for ax in axes.flat[len(outputs) :]:
            ax.remove()
        for draw, ax in zip(each.values(), axes.flat, strict=False):
            draw(styled(ax))
        return figure

    return Drawing(whole, each, height)


def _bars(ax: Axes, parameters: Sequence[str], output: str, column: Array) -> None:
    order = np.argsort(-np.abs(column), kind="stable")[:_BARS][::-1]
    colours = [UP if column[i] >= 0 else DOWN for i in order]
    ax.barh(np.arange(len(order)), column[order], color=colours, height=0.7)
    ax.set_yticks(np.arange(len(order)), [short_key(parameters[i]) for i in order])
    ax.axvline(0.0, color="0.2", linewidth=0.8)
    reach = 1.25 * max(float(np.max(np.abs(column))), 1e-3)
    ax.set_xlim(-reach, reach)
    for place, i in enumerate(order):
        side = "left" if column[i] >= 0 else "right"
        ax.annotate(
            f"{column[i]:+.2f}", (column[i], place), (3 if side == "left" else -3, 0),
            textcoords="offset points", ha=side, va="center", fontsize=7,
        )  # fmt: skip
    title(ax, output)
    ax.set_xlabel("change [%] for 1 % more")
    ax.spines["left"].set_visible(False)
    ax.tick_params(axis="y", length=0)


def bar_height(bars: int) -> float:
    """Height [in] of a panel with so many bars."""
    return 0.85 + 0.26 * bars


def short_key(key: str) -> str:
    """The key without the words that all have."""
    return key.removeprefix("flexible.").replace(".section.", " ").replace(".material.", " ")
