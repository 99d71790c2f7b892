"""Histograms of random designs, with the share of every parameter in the variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.viewer.drawing import Drawing
from pinflex.viewer.panels import COLOURS, new_figure, styled
from pinflex.viewer.tornado import short_key

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 6  # outputs drawn


def histograms(
    samples: Mapping[str, Array],
    units: Mapping[str, str],
    quantiles: Array,
    parameters: Sequence[str],
    total: Array,
) -> Drawing:
    """One row per output: its histogram with quantiles, and total Sobol indices as bars."""
    each = {}
    for k, (name, values) in enumerate(samples.items()):
        label = name + (f" [{units[name]}]" if units.get(name) else "")
        each[name] = partial(_histogram, values=values, lines=quantiles[k], label=label)
        each[f"variance {name}"] = partial(_shares, parameters=parameters, total=total[k])

    def whole() -> Figure:
        rows = min(len(samples), _MOST)
        height = max(1.9, 0.6 + 0.22 * len(parameters))
        figure = new_figure(10.0, 0.3 + height * rows, layout="constrained")
        axes = figure.subplots(rows, 2, squeeze=False, width_ratios=(1.2, 1.0))
        for draw, ax in zip(each.values(), axes.flat, strict=False):
            draw(styled(ax))
        return figure

    return Drawing(whole, each)


def _histogram(ax: Axes, values: Array, lines: Array, label: str) -> None:
    ax.hist(
        values[np.isfinite(values)], bins="auto", color=COLOURS[5], edgecolor="white", linewidth=0.4
    )
    for x, style in zip(lines, (":", "-", ":"), strict=True):
        ax.axvline(x, color=COLOURS[0], linestyle=style, linewidth=1.2)
    ax.set_xlabel(f"{label}, with 5 %, median, 95 %")
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)


def _shares(ax: Axes, parameters: Sequence[str], total: Array) -> None:
    order = np.argsort(np.nan_to_num(total))
    ax.barh(np.arange(len(order)), np.nan_to_num(total)[order], color=COLOURS[0], height=0.7)
    ax.set_yticks(np.arange(len(order)), [short_key(parameters[i]) for i in order])
    ax.set_xlim(0, max(1.0, float(np.nan_to_num(total).max(initial=0.0))))
    ax.set_xlabel("share of the variance, with interactions")
    ax.spines["left"].set_visible(False)
    ax.tick_params(axis="y", length=0)
