"""A motion over time: position, velocity and acceleration, one above the other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.viewer.panels import COLOURS, aligned, panels, shown_axes, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pinflex.description.trajectory import Motion

_INSTANTS = 1001
_LENGTHS = ("x", "y", "z")


def plot_motion(motion: Motion, until: float | None = None) -> Any:
    """Axes of the figure, as pyplot's.

    Args:
        motion: What to draw. until: End [s]; default: its duration.
    """
    return shown_axes(lambda: figure(motion, until))


def figure(motion: Motion, until: float | None = None) -> Figure:
    """Three panels, a curve for each coordinate.

    Args:
        motion: What to draw. until: End [s]; default: its duration.
    """
    t = np.linspace(0.0, until or motion.duration, _INSTANTS)
    fig, axes = panels(3, 1, 5.6, sharex=True)
    length = motion.target == "platform" and all(name in _LENGTHS for name in motion.names)
    angle = motion.target == "platform" and not set(motion.names) & set(_LENGTHS)
    unit = "m" if length else "rad" if angle else "rad | m"
    names = ("position", "velocity", "acceleration")
    for ax, name, per, values in zip(
        axes[:, 0], names, ("", "/s", "/s²"), motion.evaluate(t), strict=True
    ):
        for k, coordinate in enumerate(motion.names):
            ax.plot(t, values[:, k], color=COLOURS[k % len(COLOURS)], lw=1.0, label=coordinate)
        ax.set_ylabel(f"{name} [{' | '.join(u + per for u in unit.split(' | '))}]")
    if motion.names:
        axes[0, 0].legend(frameon=False, fontsize=8, ncols=min(len(motion.names), 6))
    title(axes[0, 0], f"{motion.kind} motion of the {motion.target}")
    axes[-1, 0].set_xlabel("time [s]")
    aligned(*axes[:, 0])
    return fig
