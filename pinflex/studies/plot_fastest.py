"""The figure of `pinflex move`: speeds, platforms, torques of the fastest and of others."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.quickest.baselines import Baseline
from pinflex.quickest.fastest import Fastest
from pinflex.viewer.plots.drawing import COLOURS, Drawing, legend_above, panels, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEAST = 1e-8  # m: below it a distance is nothing to look at
_SHOWN = 5  # motions beside the fastest: the first to be still


def plot_fastest(found: Fastest, rows: Sequence[Baseline] = ()) -> Any:
    """Axes with speed along the path, distance of the platform from rest, and largest torque."""
    return Drawing(partial(figure, found, rows), {}).axes(None, None)


def figure(found: Fastest, rows: Sequence[Baseline] = ()) -> Figure:
    """Three panels, the same time below each other."""
    fig, axes = panels(3, 1, 6.6, None, sharex=True)
    speed, away, torque = axes[:, 0]
    motions = [("fastest", found.motion, found.runs["nominal"], found.settled)]
    motions += [(row.name, row.motion, row.run, row.settled) for row in rows[:_SHOWN]]
    end = 1.6 * max(motion.duration for _, motion, _, _ in motions)
    frame = found.frame
    far = np.linalg.norm([*found.moves.values()])
    for k, (name, motion, run, still) in enumerate(motions):
        t = run.t[run.t <= end]
        look = {"color": COLOURS[k % len(COLOURS)], "lw": 1.6 if k == 0 else 0.9, "label": name}
        speed.plot(t, np.linalg.norm(motion.evaluate(t)[1], axis=1) / far, **look)
        place = run.frame(frame).position
        distance = np.linalg.norm(place - found.rest, axis=1)[: len(t)]
        away.semilogy(t, np.maximum(1e3 * distance, 1e3 * _LEAST), **look)
        push = np.abs(run.torque / found.limits.torque).max(axis=1)[: len(t)]
        torque.plot(t, 100.0 * push, **look)
        if np.isfinite(still):
            away.plot([still], [1e3 * found.band], "o", color=look["color"], ms=5)
    away.axhline(1e3 * found.band, color="0.5", lw=0.8, ls="--")
    torque.axhline(100.0, color="0.5", lw=0.8, ls="--")
    speed.set_ylabel("speed along the path [1/s]")
    away.set_ylabel("nominal robot from rest [mm]")
    torque.set_ylabel("largest torque [% of limit]")
    torque.set_xlabel("time [s]")
    legend_above(speed, 3)
    title(speed, f"{found.name}: the fastest move; dots: all robots within {1e6 * found.band:g} um")
    return fig
