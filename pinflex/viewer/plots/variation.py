"""Tornado chart of relative sensitivities."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array, BoolArray
from pinflex.viewer.plots.drawing import COLOURS, Drawing, panels, title

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
    height, across = bar_height(min(len(parameters), _BARS)), min(len(outputs), 2)
    down = -(-len(outputs) // across)
    whole = partial(_side_by_side, each.values(), down, across, 0.2 + down * height, 5.6 * across)
    return Drawing(whole, each, height)


def _side_by_side(
    draws: Iterable[Callable[[Axes], object]],
    rows: int,
    columns: int,
    height: float,
    width: float = 10.0,
    shares: Sequence[float] | None = None,
) -> Figure:
    """A figure of panels row by row, as many as there is room for; `shares`: of its width."""
    figure, axes = panels(rows, columns, height, None, width, width_ratios=shares)
    some = [*draws]
    for ax in axes.flat[len(some) :]:
        ax.remove()
    for draw, ax in zip(some, axes.flat, strict=False):
        draw(ax)
    return figure


def _ranked(ax: Axes, names: Sequence[str], values: Array, colours: Any) -> None:
    """Bars from below, each with the name of its parameter."""
    ax.barh(np.arange(len(values)), values, color=colours, height=0.7)
    ax.set_yticks(np.arange(len(values)), [short_key(name) for name in names])
    ax.spines["left"].set_visible(False)
    ax.tick_params(axis="y", length=0)


def _bars(ax: Axes, parameters: Sequence[str], output: str, column: Array) -> None:
    order = np.argsort(-np.abs(column), kind="stable")[:_BARS][::-1]
    colours = [UP if column[i] >= 0 else DOWN for i in order]
    _ranked(ax, [parameters[i] for i in order], column[order], colours)
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


def bar_height(bars: int) -> float:
    """Height [in] of a panel with so many bars."""
    return 0.85 + 0.26 * bars


def short_key(key: str) -> str:
    """The key without the words that all have."""
    return key.removeprefix("flexible.").replace(".section.", " ").replace(".material.", " ")


# Histograms of random designs, with the share of every parameter in the variance.

_MOST_OUTPUTS = 6  # outputs drawn


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

    rows = min(len(samples), _MOST_OUTPUTS)
    height = 0.3 + max(1.9, 0.6 + 0.22 * len(parameters)) * rows
    whole = partial(_side_by_side, each.values(), rows, 2, height, shares=(1.2, 1.0))
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
    _ranked(ax, [parameters[i] for i in order], np.nan_to_num(total)[order], COLOURS[0])
    ax.set_xlim(0, max(1.0, float(np.nan_to_num(total).max(initial=0.0))))
    ax.set_xlabel("share of the variance, with interactions")


# How a search for the best design went.


def histories(
    aims: Array, kept: BoolArray, label: str, parameters: Sequence[str], first: Array, best: Array
) -> Drawing:
    """The aim over the designs tried ("search"), how far every parameter has moved ("change")."""
    change = 100.0 * (np.asarray(best) / np.asarray(first) - 1.0)
    each = {
        "search": partial(_search, aims=aims, kept=np.asarray(kept, bool), label=label),
        "change": partial(_change, parameters=parameters, change=change),
    }
    height = max(2.8, bar_height(len(parameters)))
    return Drawing(partial(_side_by_side, each.values(), 1, 2, height, shares=(1.2, 1.0)), each)


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
    upwards = change[::-1]
    _ranked(ax, parameters[::-1], upwards, np.where(upwards >= 0, UP, DOWN).tolist())
    ax.axvline(0.0, color="0.2", linewidth=0.8)
    ax.set_xlabel("change of the parameter [%]")
    ax.margins(x=0.05)


# Measured values, those of a fitted model, and their differences.

_MEASURED, _MODEL = "0.35", COLOURS[1]
_MOST_PANELS = 6  # panels of a figure that can be read
_FEW = 40  # points that are drawn as points

Compared = tuple[str, str, str, Array, Array, Array, "Array | None"]


def residuals(every: Sequence[Compared]) -> Drawing:
    """One column per quantity: both curves above, model less measured below."""
    each = {p[0]: partial(_both, compared=p) for p in every}
    below = {f"difference {p[0]}": partial(_difference, compared=p) for p in every}

    def whole() -> Figure:
        shown = list(every)[:_MOST_PANELS]
        width = max(5.0, 3.6 * len(shown))
        figure, axes = panels(
            2, len(shown), 4.6, None, width, height_ratios=(2.0, 1.0), sharex="col"
        )
        for k, (compared, (top, low)) in enumerate(zip(shown, axes.T, strict=True)):
            _both(top, compared)
            _difference(low, compared)
            top.label_outer()
            title(low, "")
            low.set_ylabel(low.get_ylabel(), fontsize=8)
            if k:
                top.get_legend().remove()
        return figure

    return Drawing(whole, each | below)


def _both(ax: Axes, compared: Compared) -> None:
    name, along, unit, x, measured, model, _ = compared
    few = len(x) <= _FEW
    ax.plot(x, measured, color=_MEASURED, label="measured", marker="o" if few else "", **_style(x))
    ax.plot(x, model, color=_MODEL, label="model", marker="x" if few else "", **_style(x))
    title(ax, name)
    ax.set_xlabel(along)
    ax.set_ylabel(unit)
    _room(ax, x, along)
    ax.legend(fontsize=8, frameon=False)


def _difference(ax: Axes, compared: Compared) -> None:
    name, along, unit, x, measured, model, std = compared
    few, apart = len(x) <= _FEW, np.asarray(model) - np.asarray(measured)
    ax.axhline(0.0, color="0.7", linewidth=0.8)
    if std is not None and few:
        ax.errorbar(x, apart, yerr=1.96 * std, color=_MODEL, fmt="x", markersize=4, linewidth=0.9)
    else:
        ax.plot(x, apart, color=_MODEL, marker="x" if few else "", **_style(x))
    title(ax, name)
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
