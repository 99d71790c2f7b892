"""The figures of a comparison, by name: torques, deviation, stress, spectrum."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pinflex.results.result import Result, peak
from pinflex.viewer.images import write_png
from pinflex.viewer.plot import deviation, spectrum, stress_map, torques
from pinflex.viewer.torque_speed import torque_speed
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
