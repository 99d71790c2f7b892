"""The work-precision figure of `pinflex bench`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from pinflex.studies.bench import Bench
from pinflex.viewer.drawing import Drawing
from pinflex.viewer.panels import COLOURS, panels, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_METHODS = ("rigid", "quasistatic", "ked", "alpha", "radau")
_NAMES = {"alpha": "coupled, alpha", "radau": "coupled, radau"}
_MARKERS = ("o", "s", "^", "D")
_PANEL = 3.0  # [in]


def drawing(study: Bench) -> Drawing:
    """The figure, and its panels by output."""
    each = {name: partial(_alone, study=study, name=name) for name in _outputs(study)}
    return Drawing(partial(figure, study), each)


def figure(study: Bench) -> Figure:
    """CPU seconds against error, log-log, one panel an output; the Pareto set is joined."""
    outputs = _outputs(study)
    columns = min(2, len(outputs))
    rows = -(-len(outputs) // columns)
    fig, axes = panels(rows, columns, rows * _PANEL + 0.5, None)
    colours, markers = _looks(study)
    for ax, name in zip(axes.flat, outputs, strict=False):
        _panel(ax, study, name, colours, markers)
    handles = _handles(study, colours, markers)
    for spare in axes.flat[len(outputs) :]:  # one at most: the legend fills it
        spare.set_axis_off()
        spare.legend(handles=handles, loc="center left", frameon=False, fontsize=8)
    if len(outputs) == axes.size:
        fig.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False, fontsize=8)
    return fig


def _outputs(study: Bench) -> list[str]:
    return [name for name in study.own_error if any(p.errors.get(name) for p in study.points)]


def _looks(study: Bench) -> tuple[dict[str, str], dict[int, str]]:
    """Colours of methods, markers of numbers of modes."""
    modes = sorted({p.case.modes for p in study.points if p.case.modes is not None})
    colours = dict(zip(_METHODS, COLOURS[4:] + COLOURS[:3], strict=False))
    return colours, dict(zip(modes, _MARKERS, strict=False))


def _alone(ax: Any, study: Bench, name: str) -> None:
    looks = _looks(study)
    _panel(ax, study, name, *looks)
    ax.legend(handles=_handles(study, *looks), frameon=False, fontsize=8)


def _panel(
    ax: Any, study: Bench, name: str, colours: Mapping[str, str], markers: Mapping[int, str]
) -> None:
    """One output."""
    known = [p for p in study.points if p.errors.get(name)]
    for p in known:
        marker = markers.get(p.case.modes or 0, "o")
        ax.loglog(p.cpu, p.errors[name], marker, color=colours[p.case.method], ms=5, mew=0)
    front = [p for p in study.pareto(name) if p.errors[name]]
    ax.loglog(
        [p.cpu for p in front], [p.errors[name] for p in front],
        "-o", color="0.25", lw=0.8, mfc="none", mec="0.25", ms=9, mew=0.8, zorder=1,
    )  # fmt: skip
    ax.axhspan(1e-12, study.own_error[name], color="0.92", zorder=0)
    low = min(study.own_error[name], *(p.errors[name] for p in front))
    high = max((p.errors[name] for p in known), default=1.0)
    ax.set_ylim(0.4 * low, 2.0 * max(high, 1.0))
    ax.margins(x=0.06)
    ax.grid(True, which="major", color="0.9", lw=0.6)
    ax.set_ylabel("relative error [-]")
    ax.set_xlabel("CPU time [s]")
    title(ax, name)


def _handles(study: Bench, colours: Mapping[str, str], markers: Mapping[int, str]) -> list[Any]:
    """Of the legend: methods, numbers of modes, the Pareto set."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    used = [m for m in _METHODS if any(p.case.method == m and not p.failed for p in study.points)]
    dot: dict[str, Any] = {"ls": "", "mew": 0, "ms": 5}
    return [
        *(Line2D([], [], marker="o", color=colours[m], label=_NAMES.get(m, m), **dot)
          for m in used),
        *(Line2D([], [], marker=marker, color="0.5", label=f"{study.key}: {n}, any colour", **dot)
          for n, marker in markers.items()),
        Line2D([], [], marker="o", mfc="none", color="0.25", lw=0.8, label="none better (Pareto)"),
        Patch(color="0.92", label="below the reference's own error"),
    ]  # fmt: skip
