"""How a search for the best design went."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, BoolArray
from pinflex.viewer.panels import new_figure
from pinflex.viewer.tornado import short_key

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def histories(
    aims: Array, kept: BoolArray, label: str, parameters: Sequence[str], first: Array, best: Array
) -> Figure:
    """The aim over the designs tried, and how far every parameter has moved.

    Args:
        aims: The minimised output of each design, shape (designs,).
        kept: Whether it kept every limit, shape (designs,).
        label: Name and unit of the aim.
        parameters: Their names; `first` and `best`: their values, shape (n,).
        first: See above. best: See above.
    """
    figure = new_figure(10.0, max(2.8, 0.9 + 0.26 * len(parameters)), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    kept, number = np.asarray(kept, bool), np.arange(1, len(aims) + 1)
    left.plot(number, aims, color="0.75", linewidth=0.8, zorder=1)
    left.scatter(number[kept], aims[kept], s=14, color="#3566a8", label="keeps every limit")
    left.scatter(number[~kept], aims[~kept], s=14, facecolor="none", edgecolor="#c8553d",
                 linewidth=0.9, label="breaks a limit")  # fmt: skip
    left.set_xlabel("design", fontsize=8)
    left.set_ylabel(label, fontsize=8)
    left.legend(fontsize=7, frameon=False)
    change = 100.0 * (np.asarray(best) / np.asarray(first) - 1.0)
    rows = np.arange(len(parameters))[::-1]
    right.barh(rows, change, color=np.where(change >= 0, "#3566a8", "#c8553d"))
    right.set_yticks(rows, [short_key(name) for name in parameters], fontsize=7)
    right.axvline(0.0, color="0.2", linewidth=0.8)
    right.set_xlabel("change of the parameter [%]", fontsize=8)
    for ax in (left, right):
        ax.tick_params(labelsize=7)
        ax.spines[["top", "right"]].set_visible(False)
    return figure
