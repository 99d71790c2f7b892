"""The figure of `pinflex frf`: magnitude, phase and coherence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.studies.frequency_response import FrequencyResponse
from pinflex.viewer.panels import COLOURS, Room, panels, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure(study: FrequencyResponse) -> Figure:
    """One column an output: magnitude, phase, and coherence where a measured one has it."""
    coherent = any(one.coherence is not None for one in study.measured)
    heights = [2.0, 1.0, 0.8][: 2 + coherent]
    room = Room(left=0.8, bottom=0.45, between=(0.75, 0.12))
    n = len(study.outputs)
    fig, axes = panels(
        len(heights), n, 1.15 * sum(heights) + 1.0, room, sharex=True, height_ratios=heights
    )
    for k, name in enumerate(study.outputs):
        _column(axes[:, k], study, k)
        title(axes[0, k], f"{study.input.split(' [')[0]} to {name.split(' [')[0]}")
        axes[0, k].set_ylabel(f"magnitude [{_unit(name)} per {_unit(study.input)}]")
        axes[-1, k].set_xlabel("frequency [Hz]")
    axes[1, 0].set_ylabel("phase [deg]")
    if coherent:
        axes[2, 0].set_ylabel("coherence [-]")
    return fig


def _unit(name: str) -> str:
    return name.split("[")[-1].rstrip("]").split(" | ")[0]


def _column(axes: Any, study: FrequencyResponse, k: int) -> None:
    f, H = study.frequencies, study.response[:, k]
    bare = study.outputs[k].split(" [")[0]
    axes[0].loglog(f, np.abs(H), color=COLOURS[0], lw=1.2, label="model")
    axes[1].semilogx(f, _phase(H), color=COLOURS[0], lw=1.2)
    for one in study.measured:
        if one.output != bare:
            continue
        inside = (one.frequencies >= f[0]) & (one.frequencies <= f[-1])
        x, y = one.frequencies[inside], one.response[inside]
        axes[0].loglog(x, np.abs(y), color=COLOURS[1], lw=0.8, label="measured")
        axes[1].semilogx(x, _phase(y), color=COLOURS[1], lw=0.8)
        if one.coherence is not None:
            axes[2].semilogx(x, one.coherence[inside], color=COLOURS[2], lw=0.8)
            axes[2].set_ylim(0.0, 1.05)
        axes[0].legend(frameon=False, fontsize=8, title=f"agreement {one.agreement:.3f}",
                       title_fontsize=8)  # fmt: skip
    axes[1].set_ylim(-190, 190)
    axes[1].set_yticks([-180, -90, 0, 90, 180])
    axes[0].set_xlim(f[0], f[-1])
    for ax in axes:
        ax.grid(True, which="major", color="0.9", lw=0.6)


def _phase(H: Any) -> Any:
    """In degrees, -180 where it is half a turn either way, which round-off decides."""
    degrees = np.rad2deg(np.angle(H))
    return np.where(degrees > 179.9, degrees - 360.0, degrees)
