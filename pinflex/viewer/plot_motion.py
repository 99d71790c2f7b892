"""A motion over time: position, velocity and acceleration, one above the other."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.viewer.drawing import Drawing
from pinflex.viewer.panels import COLOURS, aligned, legend_above, panels, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pinflex.description.trajectory import Motion

_INSTANTS = 1001
_LENGTHS = ("x", "y", "z")
_PANELS = ("position", "velocity", "acceleration")


def plot_motion(
    motion: Motion, until: float | None = None, panel: str | None = None, ax: Axes | None = None
) -> Any:
    """Axes with position, velocity and acceleration over time."""
    each = {name: partial(_draw, motion, until, name) for name in _PANELS}
    return Drawing(partial(figure, motion, until), each).axes(panel, ax)


def figure(motion: Motion, until: float | None = None) -> Figure:
    """Three panels, a curve for each coordinate."""
    fig, axes = panels(3, 1, 5.6, sharex=True)
    for name, ax in zip(_PANELS, axes[:, 0], strict=True):
        _curves(motion, until, name, ax)
        ax.label_outer()
    _head(motion, axes[0, 0])
    aligned(*axes[:, 0])
    return fig


def _draw(motion: Motion, until: float | None, panel: str, ax: Axes) -> None:
    _curves(motion, until, panel, ax)
    _head(motion, ax)


def _curves(motion: Motion, until: float | None, panel: str, ax: Axes) -> None:
    t = np.linspace(0.0, until or motion.duration, _INSTANTS)
    values = motion.evaluate(t)[_PANELS.index(panel)]
    for k, coordinate in enumerate(motion.names):
        ax.plot(t, values[:, k], color=COLOURS[k % len(COLOURS)], lw=1.0, label=coordinate)
    per = ("", "/s", "/s²")[_PANELS.index(panel)]
    ax.set_ylabel(f"{panel} [{' | '.join(u + per for u in _units(motion))}]")
    ax.set_xlabel("time [s]")


def _head(motion: Motion, ax: Axes) -> None:
    legend_above(ax, len(motion.names))
    title(ax, f"{motion.kind} motion of the {motion.target}")


def _units(motion: Motion) -> tuple[str, ...]:
    names = set(motion.names)
    if motion.target != "platform" or (names & set(_LENGTHS) and names - set(_LENGTHS)):
        return ("rad", "m")
    return ("m",) if names & set(_LENGTHS) else ("rad",)
