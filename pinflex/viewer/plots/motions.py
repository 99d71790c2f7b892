"""Figures of what moves: modes, a motion, a command and what follows it, the fastest motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.results.result import Result
from pinflex.viewer.export.pictures import BASE, GREY, PALE, polylines, view_of
from pinflex.viewer.plots.drawing import (
    COLOURS,
    WIDTH,
    Drawing,
    Room,
    legend_above,
    panels,
    stack,
    title,
)
from pinflex.viewer.scene import mode_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pinflex.inversion.command import Command
    from pinflex.inversion.verify import Followed
    from pinflex.levels.modes import Modes
    from pinflex.quickest.baselines import Baseline
    from pinflex.quickest.fastest import Fastest


# Modes: frequencies as bars split by what deforms, and a shape as lines.

_NAMED = 6  # of what deforms: the rest is one colour
_REST = "0.8"


def plot_frequencies(found: Modes, ax: Axes | None = None) -> Any:
    """Axes with a bar for each frequency, split by the shares of the energy."""
    height = 1.1 + 0.24 * len(found.frequencies)
    return Drawing(None, {"frequencies": partial(_bars, found=found)}, height).axes(None, ax)


def _bars(ax: Axes, found: Modes) -> None:
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


def _parts(found: Modes) -> list[tuple[str, Array, str]]:
    """Parts that hold most of the energy of these modes: name, share in each mode, colour."""
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
_RATES = ("position", "velocity", "acceleration")


def plot_motion(
    motion: Motion, until: float | None = None, panel: str | None = None, ax: Axes | None = None
) -> Any:
    """Axes with position, velocity and acceleration over time."""
    each = {name: partial(_draw_motion, motion, until, name) for name in _RATES}
    return Drawing(partial(stack, each.values(), 5.6, Room()), each).axes(panel, ax)


def _draw_motion(motion: Motion, until: float | None, panel: str, ax: Axes) -> None:
    """A curve for each coordinate."""
    t = np.linspace(0.0, until or motion.duration, _INSTANTS)
    values = motion.evaluate(t)[_RATES.index(panel)]
    for k, coordinate in enumerate(motion.names):
        ax.plot(t, values[:, k], color=COLOURS[k % len(COLOURS)], lw=1.0, label=coordinate)
    per = ("", "/s", "/s²")[_RATES.index(panel)]
    ax.set_ylabel(f"{panel} [{' | '.join(u + per for u in _motion_units(motion))}]")
    ax.set_xlabel("time [s]")
    legend_above(ax, len(motion.names))
    title(ax, f"{motion.kind} motion of the {motion.target}")


def _motion_units(motion: Motion) -> tuple[str, ...]:
    names = set(motion.names)
    if motion.target != "platform" or (names & set(_LENGTHS) and names - set(_LENGTHS)):
        return ("rad", "m")
    return ("m",) if names & set(_LENGTHS) else ("rad",)


# The figure of `pinflex command --verify`: the platform off its path, the motors, the torques.

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
    """The curve of a panel for one motion, as a function of the first samples of its run."""
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
