"""Modes drawn: frequencies as bars split by what deforms, and a shape as lines."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pinflex.arrays import Array
from pinflex.results.result import Result
from pinflex.viewer.export.pictures import BASE, GREY, PALE, polylines, view_of
from pinflex.viewer.plots.drawing import (
    COLOURS,
    WIDTH,
    Drawing,
    aligned,
    legend_above,
    panels,
    title,
)
from pinflex.viewer.scene import mode_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pinflex.description.motions.trajectory import Motion


_NAMED = 6  # of what deforms: the rest is one colour
_REST = "0.8"


class Found(Protocol):
    """What is drawn of the modes: see `pinflex.levels.modes.Modes`."""

    frequencies: Array
    share: Array
    links: tuple[str, ...]
    preload: str
    free_motors: bool
    about: str


def plot_frequencies(found: Found, ax: Axes | None = None) -> Any:
    """Axes with a bar for each frequency, split by the shares of the elastic energy."""
    height = 1.1 + 0.24 * len(found.frequencies)
    return Drawing(None, {"frequencies": partial(_bars, found=found)}, height).axes(None, ax)


def _bars(ax: Axes, found: Found) -> None:
    f, rows = found.frequencies, np.arange(1, len(found.frequencies) + 1)
    left = np.zeros(len(f))
    for name, share, colour in _parts(found):
        ax.barh(rows, share * f, left=left, color=colour, height=0.7, label=name)
        left = left + share * f
    ax.barh(rows, f - left, left=left, color=_REST, height=0.7, label="_rest")
    for row, value in zip(rows, f, strict=True):
        ax.annotate(f"{value:.4g}", (max(value, 0.0), row), (3, 0), va="center", fontsize=7,
                    textcoords="offset points")  # fmt: skip
    ax.invert_yaxis()
    ax.set_yticks(rows)
    ax.set_xlim(1.1 * min(float(f.min(initial=0.0)), 0.0), 1.1 * float(f.max(initial=1e-9)))
    ax.set_xlabel("natural frequency [Hz]")
    ax.set_ylabel("mode")
    motors = "free" if found.free_motors else "locked"
    state = {"gravity": "under gravity", "none": "undeformed"}.get(found.preload, found.about)
    title(ax, f"{state}, motors {motors}")
    if ax.get_legend_handles_labels()[1]:
        beside: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
        text: dict[str, Any] = {"frameon": False, "fontsize": 8, "title_fontsize": 8}
        ax.legend(title="energy", alignment="left", **beside, **text)


def _parts(found: Found) -> list[tuple[str, Array, str]]:
    """What holds most of the energy of these modes: name, share in each mode, colour."""
    share = np.asarray(found.share)
    if not share.size:
        return []
    whole = share.sum(axis=1, keepdims=True)
    share = share / np.where(whole > 0, whole, 1.0)
    order = np.argsort(-share.sum(axis=0), kind="stable")
    named = sorted(int(k) for k in order[:_NAMED] if share[:, k].max() > 0.005)
    parts = [(found.links[k], share[:, k], COLOURS[i]) for i, k in enumerate(named)]
    rest = 1.0 - np.sum([p[1] for p in parts], axis=0)
    return [*parts, ("others", rest, _REST)] if rest.max() > 0.005 else parts


def shape_axes(run: Result, heading: str, ax: Axes | None = None) -> Any:
    """Axes with a period of a mode as lines: undeformed, and both ends of the swing."""
    draw = partial(_shape, scene=mode_scene(run, meshes=None), heading=heading)
    return Drawing(None, {"shape": draw}, 0.75 * WIDTH).axes(None, ax)


def _shape(ax: Axes, scene: dict[str, Any], heading: str) -> None:
    """Lines seen from the side that the pictures have, without perspective."""
    quarter = (len(scene["t"]) - 1) // 4
    swing = [(0, 0.0), (3 * quarter, scene["scale"]), (quarter, scene["scale"])]
    cloud = np.concatenate([line for k, mag in swing for line, _ in polylines(scene, k, mag)])
    across, up = _screen(*view_of(np.ptp(cloud, axis=0)))
    links = {link["name"] for link in scene["links"]}
    for (k, mag), alpha in zip(swing, (1.0, 0.35, 1.0), strict=True):
        for line, name in polylines(scene, k, mag):
            pale = not mag or name == BASE
            colour = PALE if pale else COLOURS[0] if name in links else GREY
            ax.plot(line @ across, line @ up, color=colour, alpha=alpha, lw=1.0 if pale else 2.0)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_axis_off()
    title(ax, heading)


def _screen(elevation: float, azimuth: float) -> tuple[Array, Array]:
    """Directions to the right and up of a view with these angles [deg], each (3,)."""
    e, a = np.deg2rad(elevation), np.deg2rad(azimuth)
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)])
    return right, up


# A motion over time: position, velocity and acceleration, one above the other.

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
