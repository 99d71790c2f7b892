"""The figure of `pinflex command --verify`: the platform off its path, the motors, the torques."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.results.result import Result
from pinflex.viewer.plots.drawing import COLOURS, Drawing, legend_above, panels, stack, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pinflex.inversion.command import Command
    from pinflex.inversion.verify import Followed
    from pinflex.quickest.baselines import Baseline
    from pinflex.quickest.fastest import Fastest


_TINY = 1e-10  # m: below it a distance is round-off


def plot_command(found: Command, panel: str | None = None, ax: Axes | None = None) -> Any:
    """Axes with the motors' motion and torques of one command."""
    each = {name: partial(_draw_command, found=found, panel=name) for name in ("motors", "torque")}
    return Drawing(partial(stack, each.values(), 4.8, legend=1), each).axes(panel, ax)


def _draw_command(ax: Axes, found: Command, panel: str) -> None:
    """Motor positions from their first ones, or torques."""
    moves = panel == "motors"
    values = found.position - found.position[0] if moves else found.torque
    for k, motor in enumerate(found.motors):
        ax.plot(found.t, values[:, k], color=COLOURS[k % len(COLOURS)], lw=1.0, label=motor)
    units = dict.fromkeys(("m" if u == "N" else "rad") if moves else u for u in found.units)
    ax.set_ylabel(f"{'motors, from start' if moves else 'torque'} [{' | '.join(units)}]")
    ax.set_xlabel("time [s]")
    legend_above(ax, len(found.motors))
    title(ax, f"{found.name}: {found.level} command")
    _moving(ax, found)


def command_figure(commands: Mapping[str, Command], runs: Mapping[str, Followed]) -> Figure:
    """Platform error of each command, what the found one adds to the rigid one, and torques."""
    fig, axes = panels(3, 1, 6.6, None, sharex=True)
    error, moves, torque = axes[:, 0]
    for k, (level, x) in enumerate(runs.items()):
        error.semilogy(x.run.t, 1e3 * np.maximum(x.off_path.norm, _TINY), color=COLOURS[k], lw=1.0,
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


# The figure of `pinflex move`: speeds, platforms, torques of the fastest and of others.

_LEAST = 1e-8  # m: below it a distance is nothing to look at
_SHOWN = 5  # motions beside the fastest: the first to be still


PANELS = ("speed", "platform", "torque")


def plot_fastest(
    found: Fastest,
    rows: Sequence[Baseline] = (),
    panel: str | None = None,
    ax: Axes | None = None,
    path: str | Path | None = None,
) -> Any:
    """Axes with speed along the path, distance of the platform from rest, and largest torque."""
    each = {name: partial(_draw, found=found, rows=rows, panel=name) for name in PANELS}
    return Drawing(partial(stack, each.values(), 6.6), each).axes(panel, ax, path)


def _draw(ax: Axes, found: Fastest, rows: Sequence[Baseline], panel: str) -> None:
    motions = [("fastest", found.motion, found.runs["nominal"], found.rest, found.settled)]
    motions += [(row.name, row.motion, row.run, row.rest, row.settled) for row in rows[:_SHOWN]]
    end = 1.6 * max(motion.duration for _, motion, *_ in motions)
    band = 1e3 * found.band
    for k, (name, motion, run, rest, still) in enumerate(motions):
        colour = COLOURS[k % len(COLOURS)]
        t = run.t[run.t <= end]
        values = _values(found, motion, run, rest, panel)(t)
        ax.plot(t, values, color=colour, lw=0.9 if k else 1.6, label=name)
        if panel == "platform" and np.isfinite(still):
            ax.plot([still], [band], "o", color=colour, ms=5)
    if panel == "platform":
        ax.set_yscale("log")
    if panel != "speed":
        limit = band if panel == "platform" else 100.0
        ax.axhline(limit, color="0.5", lw=0.8, ls="--")
    ax.set_ylabel(_LABELS[panel])
    ax.set_xlabel("time [s]")
    if len(motions) > 1:  # at the right, where all are at rest
        ax.legend(loc="upper right", frameon=False, fontsize=8)
    title(ax, f"{found.name}: the fastest move; dots: all robots within {1e6 * found.band:g} um")


_LABELS = {
    "speed": "speed along the path [1/s]",
    "platform": "nominal robot from rest [mm]",
    "torque": "largest torque [% of limit]",
}


def _values(
    found: Fastest, motion: Motion, run: Result, rest: Array, panel: str
) -> Callable[[Array], Array]:
    """What a panel shows of one motion, at the first samples of its run."""
    if panel == "speed":
        far = np.linalg.norm([*found.moves.values()])
        if motion.target != found.target:  # a command's: of the platform that follows
            rate = np.gradient(run.frame(found.frame).position, run.t, axis=0)
            return lambda t: np.asarray(np.linalg.norm(rate[: len(t)], axis=1) / far)
        return lambda t: np.asarray(np.linalg.norm(motion.evaluate(t)[1], axis=1) / far)
    if panel == "platform":
        away = np.linalg.norm(run.frame(found.frame).position - rest, axis=1)
        return lambda t: np.maximum(1e3 * away[: len(t)], 1e3 * _LEAST)
    push = np.abs(run.torque / found.limits.torque).max(axis=1)
    return lambda t: np.asarray(100.0 * push[: len(t)])
