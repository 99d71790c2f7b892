"""Measured values, those of a fitted model, and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.viewer.panels import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MEASURED, _MODEL = "0.35", "#c8553d"
_MOST = 6  # panels of a figure that can be read
_FEW = 40  # points that are drawn as points

Compared = tuple[str, str, str, Array, Array, Array, "Array | None"]


def residuals(panels: Sequence[Compared]) -> Figure:
    """One column per quantity: both curves above, model less measured below.

    Args:
        panels: Title, axis x, unit, and x, measured, model and standard deviations, shape (n,).
    """
    shown = list(panels)[:_MOST]
    figure = new_figure(max(5.0, 3.6 * len(shown)), 4.6, layout="constrained")
    axes = figure.subplots(2, len(shown), squeeze=False, height_ratios=(2.0, 1.0), sharex="col")
    for (title, along, unit, x, measured, model, std), (top, low) in zip(
        shown, axes.T, strict=True
    ):
        few = len(x) <= _FEW
        style = {"linestyle": "none", "markersize": 4} if few else {"linewidth": 1.0}
        top.plot(x, measured, color=_MEASURED, label="measured", marker="o" if few else "", **style)
        top.plot(x, model, color=_MODEL, label="model", marker="x" if few else "", **style)
        low.axhline(0.0, color="0.7", linewidth=0.8)
        apart = np.asarray(model) - np.asarray(measured)
        if std is not None and few:
            low.errorbar(x, apart, yerr=1.96 * std, color=_MODEL, fmt="x", markersize=4,
                         linewidth=0.9)  # fmt: skip
        else:
            low.plot(x, apart, color=_MODEL, marker="x" if few else "", **style)
        top.set_title(title, loc="left", fontsize=9)
        top.set_ylabel(unit, fontsize=8)
        low.set_ylabel(f"model - measured [{unit}]", fontsize=7)
        low.set_xlabel(along, fontsize=8)
    axes[0, 0].legend(fontsize=7, frameon=False)
    for ax in axes.flat:
        ax.tick_params(labelsize=7)
        ax.spines[["top", "right"]].set_visible(False)
    return figure
