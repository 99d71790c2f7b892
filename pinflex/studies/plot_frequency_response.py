"""The figure of `pinflex frf`: magnitude, phase and coherence."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.studies.frequency_response import FrequencyResponse
from pinflex.viewer.drawing import Drawing
from pinflex.viewer.panels import COLOURS, Room, panels, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEIGHTS = {"magnitude": 2.0, "phase": 1.0, "coherence": 0.8}  # of the panels, relative
_WIDE = 200.0  # from the first to the last frequency: beyond, tens alone have numbers


def drawing(study: FrequencyResponse) -> Drawing:
    """The figure, and its panels by name."""
    parts = _parts(study)
    single = len(study.outputs) == 1
    each = {
        part if single else f"{part} {_bare(output)}": partial(_panel, study=study, k=k, part=part)
        for k, output in enumerate(study.outputs)
        for part in parts
    }
    return Drawing(partial(figure, study), each)


def figure(study: FrequencyResponse) -> Figure:
    """One column an output: magnitude, phase, and coherence where a measured one has it."""
    parts = _parts(study)
    heights = [_HEIGHTS[part] for part in parts]
    room = Room(left=0.8, bottom=0.45, between=(0.75, 0.12))
    n = len(study.outputs)
    fig, axes = panels(
        len(heights), n, 1.15 * sum(heights) + 1.0, room, sharex=True, height_ratios=heights
    )
    for k in range(n):
        for row, part in enumerate(parts):
            ax = axes[row, k]
            _panel(ax, study, k, part)
            if row:
                title(ax, "")
            if row < len(parts) - 1:
                ax.set_xlabel("")
            if row and k:
                ax.set_ylabel("")
    return fig


def _parts(study: FrequencyResponse) -> list[str]:
    coherent = any(one.coherence is not None for one in study.measured)
    return [part for part in _HEIGHTS if part != "coherence" or coherent]


def _bare(name: str) -> str:
    return name.split(" [")[0]


def _unit(name: str) -> str:
    return name.split("[")[-1].rstrip("]").split(" | ")[0]


def _panel(ax: Axes, study: FrequencyResponse, k: int, part: str) -> None:
    """Magnitude, phase or coherence of one output."""
    f, H, output = study.frequencies, study.response[:, k], study.outputs[k]
    of: dict[str, Callable[[Array], Array]] = {"magnitude": np.abs, "phase": _phase}
    if part in of:
        ax.semilogx(f, of[part](H), color=COLOURS[0], lw=1.2, label="model")
    for one in study.measured:
        inside = (one.frequencies >= f[0]) & (one.frequencies <= f[-1])
        shown = one.coherence if part == "coherence" else of[part](one.response)
        if one.output == _bare(output) and shown is not None:
            colour = COLOURS[2 if part == "coherence" else 1]
            ax.semilogx(
                one.frequencies[inside], shown[inside], color=colour, lw=0.8, label="measured"
            )
            if part == "magnitude":
                ax.legend(frameon=False, fontsize=8, title=f"agreement {one.agreement:.3f}",
                          title_fontsize=8)  # fmt: skip
    unit = f"{_unit(output)} per {_unit(study.input)}"
    labels = {"magnitude": f"magnitude [{unit}]", "phase": "phase [deg]"}
    ax.set_ylabel(labels.get(part, "coherence [-]"))
    ax.set_xlabel("frequency [Hz]")
    title(ax, f"{_bare(study.input)} to {_bare(output)}")
    _scale(ax, part)
    ax.set_xlim(f[0], f[-1])
    _decades(ax, f[-1] / f[0])
    ax.grid(True, which="major", color="0.9", lw=0.6)


def _decades(ax: Axes, ratio: float) -> None:
    """Plain numbers below a logarithmic axis, as many as there is room for."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    plain = FuncFormatter(lambda value, _: f"{value:g}")
    ax.xaxis.set_major_formatter(plain)
    ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if ratio < _WIDE else (5.0,)))
    ax.xaxis.set_minor_formatter(plain if ratio < _WIDE else FuncFormatter(lambda *_: ""))
    ax.tick_params(which="minor", labelsize=8, width=0.4)


def _scale(ax: Axes, part: str) -> None:
    if part == "magnitude":
        ax.set_yscale("log")
    elif part == "phase":
        ax.set_ylim(-190, 190)
        ax.set_yticks([-180, -90, 0, 90, 180])
    else:
        ax.set_ylim(0.0, 1.05)


def _phase(H: Any) -> Any:
    """In degrees, -180 where it is half a turn either way, which round-off decides."""
    degrees = np.rad2deg(np.angle(H))
    return np.where(degrees > 179.9, degrees - 360.0, degrees)
