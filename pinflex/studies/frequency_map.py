"""Natural frequencies along a motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, IntArray
from pinflex.description.motion import Motion
from pinflex.errors import ConvergenceError, DescriptionError, SceneError
from pinflex.levels.modes import Modes, modes
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.solver.solve import default_motion
from pinflex.studies.check import is_loaded
from pinflex.studies.tracking import matched
from pinflex.text import brief
from pinflex.viewer.panels import COLOURS, DPI, HEIGHT, panels, title
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDE = 1 / 15  # a lowest frequency below this share of the highest: on a logarithmic axis
_SPARE = 4  # modes followed beside those shown: one of them may come down among the shown


@dataclass(frozen=True)
class FrequencyMap:
    """Frequencies of the same modes at poses along a motion.

    Attributes:
        name: Of the mechanism.
        t: Instants of the motion [s], shape (n,).
        frequencies: Hz, shape (n, count); nan where there is no equilibrium. A column follows one
            shape from instant to instant, so columns may cross.
        preload: "gravity" or "none".
        missing: What there is to say about instants without frequencies; "" if there are none.
    """

    __repr__ = brief

    name: str
    t: Array
    frequencies: Array
    preload: str
    missing: str


def frequency_map(
    mechanism: Mechanism,
    motion: Motion | None = None,
    *,
    count: int = 6,
    instants: int = 41,
    preload: str = "gravity",
) -> FrequencyMap:
    """Natural frequencies with the motors locked at instants of a motion.

    Args:
        mechanism: Mechanism with at least one flexible link.
        motion: Default: the motion of the YAML.
        count: How many modes to follow.
        instants: How many poses, evenly in time.
        preload: As in `modes`.

    Returns:
        The frequencies.

    Raises:
        DescriptionError: No motion, or fewer than two instants.
        ConvergenceError: No static equilibrium at any pose.
        MotionError, SingularityError: The motion cannot be followed.
    """
    if instants < 2:
        raise DescriptionError(f"frequency_map: instants: {instants}. Give at least 2.")
    if motion is None:
        motion = default_motion(mechanism)
    end = mechanism.description.solve.until or motion.duration
    t = np.linspace(0.0, min(end, motion.duration) or end, instants)
    poses = nominal(mechanism, motion, t).q
    dynamics = Equations(mechanism.flexible)
    preload = preload if is_loaded(mechanism) else "none"
    rows, last, missing = [], None, ""
    for time, q in zip(t, poses, strict=True):
        try:
            pose_modes = modes(mechanism, q, count=count + _SPARE, preload=preload)
        except SceneError as error:
            missing = missing or f"no equilibrium at {time:.4g} s: {error}"
            rows.append(np.full(count, np.nan))
            continue
        order: IntArray = np.arange(len(pose_modes.frequencies))
        if last is not None:
            order, _ = matched(last, pose_modes.shapes, dynamics.mass(pose_modes.y))
        last = pose_modes.shapes[:, order]
        rows.append(_first(pose_modes, order, count))
    if all(np.isnan(row).all() for row in rows):
        raise ConvergenceError(f"{mechanism.name}: {missing}")
    return FrequencyMap(mechanism.name, t, np.array(rows), preload, missing)


def plot_frequency_map(along: FrequencyMap) -> Figure:
    """Frequency against time along the motion, one line a mode; the lowest of the first marked."""
    figure, axes = panels(1, 1, HEIGHT, None)
    ax = axes[0, 0]
    draw_frequencies(ax, along.t, along.frequencies, "s", "no static equilibrium")
    ax.set_xlabel("time along the motion [s]")
    about = "under gravity" if along.preload == "gravity" else "undeformed"
    title(ax, f"{along.name}: natural frequencies along the motion, motors locked, {about}")
    return figure


def draw_frequencies(ax: Axes, t: Array, frequencies: Array, unit: str, gap: str) -> None:
    """One line a mode, numbered; the lowest frequency of all marked.

    Args:
        ax: Where to draw.
        t: Poses, shape (n,), in `unit`: time of a motion, or a coordinate.
        frequencies: Hz, shape (n, count); nan where there is none.
        unit: For the mark.
        gap: What poses at the end lack that have no frequencies.
    """
    frequencies = frequencies[:, np.isfinite(frequencies).any(axis=0)]
    for i, column in enumerate(frequencies.T):
        ax.plot(t, column, color=COLOURS[i % len(COLOURS)], lw=1.3, clip_on=False)
    known = np.isfinite(frequencies).all(axis=1)
    top, bottom = float(np.nanmax(frequencies)), float(np.nanmin(frequencies))
    n = int(np.flatnonzero(known)[-1])
    wide = 0 < bottom < _WIDE * top
    if wide:
        ax.set_yscale("log")
        low, high = bottom / (top / bottom) ** 0.12, top * (top / bottom) ** 0.06
    else:
        low, high = min(0.0, 1.06 * bottom), 1.06 * top
    ax.set_ylim(low, high)

    def height(f: Array) -> Array:  # 0 to 1 of the axis
        return np.asarray(
            np.log(f / low) / np.log(high / low) if wide else (f - low) / (high - low)
        )

    for group in _close_together(height(frequencies[n]), 0.045):
        ax.annotate(
            ", ".join(str(i + 1) for i in sorted(group)),
            (t[n], float(np.mean(frequencies[n][group]))), (5, 0), va="center",
            textcoords="offset points", fontsize=9, annotation_clip=False,
            color=COLOURS[group[0] % len(COLOURS)] if len(group) == 1 else "0.2",
        )  # fmt: skip
    lowest = np.where(known, np.min(frequencies, axis=1), np.inf)
    k = int(np.argmin(lowest))
    if np.ptp(lowest[known]) > 1e-3 * lowest[k]:  # otherwise no pose is worse than another
        ax.plot(t[k], lowest[k], "o", mfc="white", mec="0.2", ms=5, zorder=5, clip_on=False)
        early, below = k < len(lowest) / 2, height(lowest[k]) > 0.08
        ax.annotate(
            f"lowest {lowest[k]:.4g} Hz at {t[k]:.4g} {unit}", (t[k], lowest[k]),
            (8 if early else -8, -14 if below else 10), textcoords="offset points", fontsize=8,
            ha="left" if early else "right", bbox={"fc": "w", "ec": "none", "pad": 1}, zorder=4,
        )  # fmt: skip
    if not known.all() and n + 1 < len(t):
        ax.axvspan(t[n], t[-1], color="0.95", zorder=0)
        middle, place = (t[n] + t[-1]) / 2, ax.get_xaxis_transform()
        ax.text(middle, 0.5, gap, transform=place, fontsize=9, ha="center", color="0.4")
    ax.set_xlim(t[0], t[-1])
    ax.set_ylabel("natural frequency [Hz]")


def save_frequency_map(along: FrequencyMap, path: str | Path) -> Path:
    """Write the figure (.png, .pdf, .svg); returns the file."""
    path = check_figure(path)
    with replaced(path) as part:
        plot_frequency_map(along).savefig(part, dpi=DPI)
    return path


def check_figure(path: str | Path) -> Path:
    """The path of a figure, if there is such a kind; its folder is made."""
    path = Path(path)
    if path.suffix not in (".png", ".pdf", ".svg"):
        raise DescriptionError(f"{path}: no such kind of figure. Allowed: .png, .pdf, .svg.")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _first(pose_modes: Modes, order: IntArray, count: int) -> Array:
    frequencies = pose_modes.frequencies[order][:count]
    return np.append(frequencies, np.full(count - len(frequencies), np.nan))


def _close_together(heights: Array, least: float) -> list[list[int]]:
    """Indices of heights, those closer than `least` to their neighbour in one group."""
    groups: list[list[int]] = []
    for i in np.argsort(heights):
        if groups and heights[i] - heights[groups[-1][-1]] < least:
            groups[-1].append(int(i))
        else:
            groups.append([int(i)])
    return groups
