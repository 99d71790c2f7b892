"""Tornado chart of relative sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.viewer.panels import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UP, _DOWN = "#3566a8", "#c8553d"
_BARS = 12  # of a panel: the rest is too small to matter


def tornado(parameters: Sequence[str], outputs: Sequence[str], table: Array) -> Figure:
    """One panel per output, its longest bars on top.

    Args:
        parameters: Names of the bars.
        outputs: Titles of the panels.
        table: Relative sensitivities, shape (parameters, outputs).
    """
    bars = min(len(parameters), _BARS)
    columns = min(len(outputs), 2)
    rows = -(-len(outputs) // columns)
    figure = new_figure(5.6 * columns, 0.7 + rows * (0.6 + 0.26 * bars), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for ax in axes.flat[len(outputs) :]:
        ax.remove()
    for k, (output, ax) in enumerate(zip(outputs, axes.flat, strict=False)):
        column = np.nan_to_num(np.asarray(table, float)[:, k])
        order = np.argsort(-np.abs(column), kind="stable")[:bars][::-1]
        colours = [_UP if column[i] >= 0 else _DOWN for i in order]
        ax.barh(np.arange(len(order)), column[order], color=colours, height=0.7)
        ax.set_yticks(np.arange(len(order)), [short_key(parameters[i]) for i in order], fontsize=7)
        ax.axvline(0.0, color="0.2", linewidth=0.8)
        reach = 1.25 * max(float(np.max(np.abs(column))), 1e-3)
        ax.set_xlim(-reach, reach)
        for place, i in enumerate(order):
            side = "left" if column[i] >= 0 else "right"
            ax.annotate(
                f"{column[i]:+.2f}", (column[i], place), (3 if side == "left" else -3, 0),
                textcoords="offset points", ha=side, va="center", fontsize=7,
            )  # fmt: skip
        ax.set_title(output, loc="left", fontsize=9)
        ax.set_xlabel("change [%] for 1 % more", fontsize=8)
        ax.tick_params(labelsize=7)
        ax.spines[["top", "right", "left"]].set_visible(False)
        ax.tick_params(axis="y", length=0)
    return figure


def short_key(key: str) -> str:
    """The key without the words that all have."""
    return key.removeprefix("flexible.").replace(".section.", " ").replace(".material.", " ")
