"""The figure of `pinflex command --verify`: the platform off its path, the motors, the torques."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.inversion.command import Command
from pinflex.inversion.verify import Followed
from pinflex.viewer.plots.drawing import COLOURS, Drawing, legend_above, panels, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_LEAST = 1e-10  # m: below it a distance is round-off


def plot_command(found: Command, panel: str | None = None, ax: Axes | None = None) -> Any:
    """Axes with the motors' motion and torques of one command."""
    each = {name: partial(_draw, found=found, panel=name) for name in ("motors", "torque")}
    return Drawing(partial(_alone, found), each).axes(panel, ax)


def _alone(found: Command) -> Figure:
    """Motor positions from their first ones, and torques."""
    fig, axes = panels(2, 1, 4.8, None, sharex=True)
    for ax, panel in zip(axes[:, 0], ("motors", "torque"), strict=True):
        _draw(ax, found, panel)
        ax.label_outer()
    axes[0, 0].get_legend().remove()
    title(axes[1, 0], "")
    return fig


def _draw(ax: Axes, found: Command, panel: str) -> None:
    moves = panel == "motors"
    values = found.position - found.position[0] if moves else found.torque
    for k, motor in enumerate(found.motors):
        ax.plot(found.t, values[:, k], color=COLOURS[k % len(COLOURS)], lw=1.0, label=motor)
    units = dict.fromkeys(_place(u) if moves else u for u in found.units)
    ax.set_ylabel(f"{'motors, from start' if moves else 'torque'} [{' | '.join(units)}]")
    ax.set_xlabel("time [s]")
    legend_above(ax, len(found.motors))
    title(ax, f"{found.name}: {found.level} command")
    _moving(ax, found)


def _place(unit: str) -> str:
    return "m" if unit == "N" else "rad"


def figure(commands: Mapping[str, Command], runs: Mapping[str, Followed]) -> Figure:
    """Platform error of each command, what the found one adds to the rigid one, and torques."""
    fig, axes = panels(3, 1, 6.6, None, sharex=True)
    error, moves, torque = axes[:, 0]
    for k, (level, x) in enumerate(runs.items()):
        error.semilogy(x.run.t, 1e3 * np.maximum(x.off_path.norm, _LEAST), color=COLOURS[k], lw=1.0,
                       label=f"{level} command")  # fmt: skip
    error.set_ylabel("platform off its path [mm]")
    error.legend(frameon=False, fontsize=8, ncols=2)
    found = next(iter(commands.values()))
    title(error, f"{found.name}: {found.level} command, level coupled")
    rigid = commands.get("rigid")
    for k, motor in enumerate(found.motors):
        colour = COLOURS[k % len(COLOURS)]
        if rigid is not None and rigid is not found:
            apart = found.position[:, k] - rigid.position[:, k]
            moves.plot(found.t, 1e3 * apart, color=colour, lw=1.0, label=motor)
            torque.plot(
                rigid.t, rigid.torque[:, k], color=colour, lw=0.8, ls=(0, (4, 3)), alpha=0.7
            )
        torque.plot(found.t, found.torque[:, k], color=colour, lw=1.0, label=motor)
    units = " | ".join(dict.fromkeys("mm" if u == "N" else "mrad" for u in found.units))
    moves.set_ylabel(f"motors, beyond rigid [{units}]")
    torque.set_ylabel(f"torque [{' | '.join(dict.fromkeys(found.units))}]")
    torque.set_xlabel("time [s]")
    torque.legend(frameon=False, fontsize=8, ncols=min(len(found.motors), 6))
    if rigid is not None and rigid is not found:
        title(torque, "dashed: rigid command")
    for ax in axes[:, 0]:
        _moving(ax, found)
    return fig


def _moving(ax: Any, found: Command) -> None:
    """Shade the rest before and after the platform's motion."""
    end = float(found.t[-1])
    for span in ((0.0, found.before), (end - found.after, end)):
        ax.axvspan(*span, color="0.95", zorder=0, lw=0)
