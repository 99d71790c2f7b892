"""Measured values, those of a fitted model, and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.viewer.drawing import Drawing
from pinflex.viewer.panels import COLOURS, new_figure, styled
from pinflex.viewer.panels import title as heading

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MEASURED, _MODEL = "0.35", COLOURS[1]
_MOST = 6  # panels of a figure that can be read
_FEW = 40  # points that are drawn as points

Compared = tuple[str, str, str, Array, Array, Array, "Array | None"]


def residuals(panels: Sequence[Compared]) -> Drawing:
    """One column per quantity: both curves above, model less measured below."""
    each = {p[0]: partial(_both, compared=p) for p in panels}
    below = {f"difference {p[0]}": partial(_difference, compared=p) for p in panels}

    def whole() -> Figure:
        shown = list(panels)[:_MOST]
        figure = new_figure(max(5.0, 3.6 * len(shown)), 4.6, layout="constrained")
        axes = figure.subplots(2, len(shown), squeeze=False, height_ratios=(2.0, 1.0), sharex="col")
        for k, (compared, (top, low)) in enumerate(zip(shown, axes.T, strict=True)):
            _both(styled(top), compared)
            _difference(styled(low), compared)
            top.label_outer()
            heading(low, "")
            low.set_ylabel(low.get_ylabel(), fontsize=8)
            if k:
                top.get_legend().remove()
        return figure

    return Drawing(whole, each | below)


def _both(ax: Axes, compared: Compared) -> None:
    title, along, unit, x, measured, model, _ = compared
    few = len(x) <= _FEW
    ax.plot(x, measured, color=_MEASURED, label="measured", marker="o" if few else "", **_style(x))
    ax.plot(x, model, color=_MODEL, label="model", marker="x" if few else "", **_style(x))
    heading(ax, title)
    ax.set_xlabel(along)
    ax.set_ylabel(unit)
    _room(ax, x, along)
    ax.legend(fontsize=8, frameon=False)


def _difference(ax: Axes, compared: Compared) -> None:
    title, along, unit, x, measured, model, std = compared
    few, apart = len(x) <= _FEW, np.asarray(model) - np.asarray(measured)
    ax.axhline(0.0, color="0.7", linewidth=0.8)
    if std is not None and few:
        ax.errorbar(x, apart, yerr=1.96 * std, color=_MODEL, fmt="x", markersize=4, linewidth=0.9)
    else:
        ax.plot(x, apart, color=_MODEL, marker="x" if few else "", **_style(x))
    heading(ax, title)
    ax.set_xlabel(along)
    ax.set_ylabel(f"model - measured [{unit}]")
    _room(ax, x, along)


def _style(x: Array) -> dict[str, Any]:
    few = len(x) <= _FEW
    return {"linestyle": "none", "markersize": 4} if few else {"linewidth": 1.0}


def _room(ax: Axes, x: Array, along: str) -> None:
    """Points stand away from the frame; what is counted has whole ticks."""
    if len(x) <= _FEW:
        ax.margins(x=0.08)
    if np.array_equal(x, np.round(x)) and "[" not in along:
        from matplotlib.ticker import MaxNLocator

        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
