"""The figures of a comparison, by name: torques, deviation, stress, spectrum."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.results.result import Result, peak
from pinflex.viewer.plot import deviation, spectrum, stress_map, torques
from pinflex.viewer.plots.axes import torque_speed
from pinflex.viewer.plots.drawing import DPI
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


# Figures as .png files, drawn once and with few artists.


def write_png(figure: Figure, path: Path) -> None:
    """Draw a figure into a file: opaque, so without a channel for that.

    Runs of equal bytes are all that a curve on white has: looked for alone they take half the time
    of zlib's default and 6 % fewer bytes than that on four channels.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    for ax in figure.axes:
        _marks_for_minor_ticks(ax.yaxis)
    canvas: Any = FigureCanvasAgg(figure)  # whose calls have no types
    canvas.draw()
    seen = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3])
    Image.fromarray(seen).save(path, dpi=(DPI, DPI), compress_level=1, compress_type=zlib.Z_RLE)


def _marks_for_minor_ticks(axis: Axis) -> None:
    """Draw the minor ticks of a vertical axis, where they have no labels, as one line of marks.

    Each tick of matplotlib is three lines and two texts, and a logarithm has fifty of them.
    """
    from matplotlib import rcParams
    from matplotlib.markers import TICKLEFT
    from matplotlib.ticker import NullLocator

    places = axis.get_minorticklocs()
    if not len(places) or any(axis.get_minor_formatter().format_ticks(list(places))):
        return
    low, high = sorted(axis.get_view_interval())
    places = places[(places >= low) & (places <= high)]
    size, width = rcParams["ytick.minor.size"], rcParams["ytick.minor.width"]
    axis.axes.plot(
        np.zeros(len(places)), places, transform=axis.axes.get_yaxis_transform(), ls="none",
        marker=TICKLEFT, ms=size, mew=width, color=rcParams["ytick.color"], clip_on=False,
    )  # fmt: skip
    axis.set_minor_locator(NullLocator())


_MAPS = 6  # stress maps on a page: more links show no more


def figures_of(
    rigid: Result, others: Mapping[str, Result], natural: Sequence[float] = ()
) -> dict[str, Callable[[], Figure]]:
    """Functions that draw what the results allow, by name.

    Torques of all levels; deviation, stress and spectrum of the last.
    """
    figures: dict[str, Callable[[], Figure]] = {}
    if rigid.motors:
        figures["torques"] = partial(torques, rigid, others)
    for label, run in list(others.items())[-1:]:
        if run.drives:
            figures[f"torque_speed_{label}"] = partial(torque_speed, run)
        if rigid.meta.get("platform"):
            still = None if label == "quasistatic" else others.get("quasistatic")
            figures[f"deviation_{label}"] = partial(
                deviation, rigid, run, rigid.meta["platform"], still
            )
        if run.links:
            figures[f"stress_{label}"] = partial(stress_map, run, _most_loaded(run))
            if len(run.t) >= 16 and run.level != "quasistatic":  # which has no vibration
                figures[f"spectrum_{label}"] = partial(
                    spectrum, run, _liveliest(run), natural=natural
                )
    return figures


def save_all(
    rigid: Result,
    others: Mapping[str, Result],
    folder: str | Path,
    natural: Sequence[float] = (),
    tell: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Write the figures that the results allow as .png files; returns their paths."""
    figures = figures_of(rigid, others, natural)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, (name, figure) in enumerate(figures.items(), 1):
        tell(f"drawing {number} of {len(figures)}")
        paths.append(folder / (re.sub(r"[^\w.-]+", "_", name) + ".png"))
        with replaced(paths[-1]) as part:
            write_png(figure(), part)
    return paths


def _most_loaded(run: Result) -> tuple[str, ...]:
    """Links worth a map, in the order of the run."""
    stress = {name: peak(run.link(name).von_mises) for name in run.links}
    kept = sorted(stress, key=lambda name: -stress[name])[:_MAPS]
    return tuple(name for name in run.links if name in kept)


def _liveliest(run: Result) -> str:
    """The bending deflection that is largest over all links."""
    height = {
        f"link/{name}/{axis}": peak(run.link(name).deflection[:, :, column])
        for name in run.links
        for column, axis in ((1, "v"), (2, "w"))
    }
    return max(height, key=lambda quantity: height[quantity])
