"""Histograms of random designs, with the share of every parameter in the variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.viewer.panels import new_figure
from pinflex.viewer.tornado import short_key

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 6  # outputs drawn


def histograms(
    samples: Mapping[str, Array],
    units: Mapping[str, str],
    quantiles: Array,
    parameters: Sequence[str],
    total: Array,
) -> Figure:
    """One row per output: its histogram with quantiles, and total Sobol indices as bars.

    Args:
        samples: Values by output. units: Theirs.
        quantiles: Low, median, high, shape (outputs, 3).
        parameters: Random parameters.
        total: Total indices, shape (outputs, parameters).
    """
    names = list(samples)[:_MOST]
    height = max(1.7, 0.55 + 0.22 * len(parameters))
    figure = new_figure(10.0, 0.3 + height * len(names), layout="constrained")
    axes = figure.subplots(len(names), 2, squeeze=False, width_ratios=(1.2, 1.0))
    for k, name in enumerate(names):
        left, right = axes[k]
        values = samples[name][np.isfinite(samples[name])]
        left.hist(values, bins="auto", color="#8fa9cc", edgecolor="white", linewidth=0.4)
        for x, style in zip(quantiles[k], (":", "-", ":"), strict=True):
            left.axvline(x, color="#1f3a5f", linestyle=style, linewidth=1.2)
        unit = f" [{units[name]}]" if units.get(name) else ""
        left.set_xlabel(f"{name}{unit}, with 5 %, median, 95 %", fontsize=8)
        left.set_yticks([])
        order = np.argsort(np.nan_to_num(total[k]))
        right.barh(np.arange(len(order)), np.nan_to_num(total[k])[order], color="#3566a8")
        right.set_yticks(
            np.arange(len(order)), [short_key(parameters[i]) for i in order], fontsize=7
        )
        right.set_xlim(0, max(1.0, float(np.nanmax(np.nan_to_num(total[k])))))
        right.set_xlabel("share of the variance, with interactions", fontsize=8)
        for ax in (left, right):
            ax.tick_params(labelsize=7)
            ax.spines[["top", "right", "left"]].set_visible(False)
        right.tick_params(axis="y", length=0)
    return figure
