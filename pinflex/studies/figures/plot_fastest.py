"""The figure of `pinflex move`: speeds, platforms, torques of the fastest and of others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.quickest.baselines import Baseline
from pinflex.quickest.fastest import Fastest
from pinflex.results.result import Result
from pinflex.viewer.plots.drawing import COLOURS, Drawing, panels, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_LEAST = 1e-8  # m: below it a distance is nothing to look at
_SHOWN = 5  # motions beside the fastest: the first to be still


PANELS = ("speed", "platform", "torque")


def plot_fastest(
    found: Fastest, rows: Sequence[Baseline] = (), panel: str | None = None, ax: Axes | None = None
) -> Any:
    """Axes with speed along the path, distance of the platform from rest, and largest torque."""
    each = {name: partial(_draw, found=found, rows=rows, panel=name) for name in PANELS}
    return Drawing(partial(figure, found, rows), each).axes(panel, ax)


def figure(found: Fastest, rows: Sequence[Baseline] = ()) -> Figure:
    """Three panels, the same time below each other."""
    fig, axes = panels(3, 1, 6.6, None, sharex=True)
    for ax, panel in zip(axes[:, 0], PANELS, strict=True):
        _draw(ax, found, rows, panel)
        ax.label_outer()
    for ax in axes[1:, 0]:
        title(ax, "")
        if ax.get_legend():
            ax.get_legend().remove()
    return fig


def _draw(ax: Axes, found: Fastest, rows: Sequence[Baseline], panel: str) -> None:
    motions = [("fastest", found.motion, found.runs["nominal"], found.settled)]
    motions += [(row.name, row.motion, row.run, row.settled) for row in rows[:_SHOWN]]
    end = 1.6 * max(motion.duration for _, motion, _, _ in motions)
    band = 1e3 * found.band
    for k, (name, motion, run, still) in enumerate(motions):
        colour = COLOURS[k % len(COLOURS)]
        t = run.t[run.t <= end]
        values = _values(found, motion, run, panel)(t)
        ax.plot(t, values, color=colour, lw=0.9 if k else 1.6, label=name)
        if panel == "platform" and np.isfinite(still):
            ax.plot([still], [band], "o", color=colour, ms=5)
    if panel == "platform":
        ax.set_yscale("log")
    if panel != "speed":
        limit = band if panel == "platform" else 100.0
        ax.axhline(limit, color="0.5", lw=0.8, ls="--")
    ax.set_ylabel(_LABELS[panel])
    ax.set_xlabel("time [s]")
    if len(motions) > 1:  # at the right, where all are at rest
        ax.legend(loc="upper right", frameon=False, fontsize=8)
    title(ax, f"{found.name}: the fastest move; dots: all robots within {1e6 * found.band:g} um")


_LABELS = {
    "speed": "speed along the path [1/s]",
    "platform": "nominal robot from rest [mm]",
    "torque": "largest torque [% of limit]",
}


def _values(found: Fastest, motion: Motion, run: Result, panel: str) -> Callable[[Array], Array]:
    """What a panel shows of one motion, at the first samples of its run."""
    if panel == "speed":
        far = np.linalg.norm([*found.moves.values()])
        return lambda t: np.asarray(np.linalg.norm(motion.evaluate(t)[1], axis=1) / far)
    if panel == "platform":
        away = np.linalg.norm(run.frame(found.frame).position - found.rest, axis=1)
        return lambda t: np.maximum(1e3 * away[: len(t)], 1e3 * _LEAST)
    push = np.abs(run.torque / found.limits.torque).max(axis=1)
    return lambda t: np.asarray(100.0 * push[: len(t)])
