"""Figures of results: torques, platform deviation, stress along the links, spectra.

Every function returns a matplotlib Figure: no window, no global state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.results.quantities import QUANTITIES
from pinflex.results.result import Result, peak, same_grid
from pinflex.results.views import Deviation, LinkView
from pinflex.viewer.plots.drawing import COLOURS, HEIGHT, Room, panels, stack, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Amplitude spectrum of a record, its peaks, and the natural frequencies that they may be.

_PADDING = 4  # spectra are computed on a grid this many times finer than 1 / duration


def amplitudes(t: Array, values: Array, after: float = 0.0) -> tuple[Array, Array]:
    """One-sided amplitude spectrum (Hann window, trend removed, padded to four times).

    Returns:
        Frequencies [Hz] and amplitudes in the unit of values: a sine of height a peaks at a.
    """
    keep = t >= after
    if np.count_nonzero(keep) < 16:
        raise DescriptionError(
            f"spectrum: {np.count_nonzero(keep)} instants after {after:g} s are too few (16). "
            f"Choose an earlier start than {after:g} s, or solve with more samples."
        )
    grid = np.linspace(t[keep][0], t[-1], np.count_nonzero(keep))  # equal steps, as the FFT needs
    window = np.hanning(len(grid))
    even = np.interp(grid, t, values)
    series = window * (even - np.polynomial.Polynomial.fit(grid, even, 1)(grid))
    count = _PADDING * len(grid)
    amplitude = 2 * np.abs(np.fft.rfft(series, count)) / window.sum()
    return np.fft.rfftfreq(count, grid[1] - grid[0]), np.asarray(amplitude)


def highest(frequency: Array, amplitude: Array, count: int) -> list[tuple[float, float]]:
    """The highest peaks (Hz, amplitude), placed between bins by a parabola through three."""
    if not amplitude.max() > 0:
        return []
    level = np.log(np.maximum(amplitude, 1e-12 * amplitude.max()))
    bins = maxima(level, np.log(2), level.max() - np.log(100))
    kept: list[int] = []
    for i in sorted(bins, key=lambda i: -amplitude[i]):
        # lobes of a higher peak fall like 1 / (pi d (d^2 - 1)) at d unpadded bins (Hann)
        away = [max(abs(i - k) / _PADDING, 1.5) for k in kept]
        lobes = [amplitude[k] / (np.pi * d * (d**2 - 1)) for k, d in zip(kept, away, strict=True)]
        if amplitude[i] > 2 * max(lobes, default=0.0):
            kept.append(int(i))
    found = []
    for i in kept[:count]:
        left, top, right = level[i - 1 : i + 2]
        shift = 0.5 * (left - right) / (left - 2 * top + right)
        height = np.exp(top - 0.25 * (left - right) * shift)
        found.append((float(frequency[i] + shift * frequency[1]), float(height)))
    return sorted(found)


def maxima(height: Array, prominence: float = 0.0, least: float = -np.inf) -> list[int]:
    """Local maxima of at least `least`, by `prominence` above the valley to a higher one.

    Of the two valleys the higher one counts. A flat top is found at its middle, an end is none.
    """
    change = np.flatnonzero(np.diff(height)) + 1  # where a new value begins
    starts, stops = np.append(0, change), np.append(change, len(height))
    level = height[starts]
    tops = 1 + np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] > level[2:]))
    kept = []
    for k in tops[level[tops] >= least]:
        if prominence <= 0:
            kept.append(int(starts[k] + stops[k] - 1) // 2)
            continue
        higher = np.flatnonzero(level > level[k])
        left, right = higher[higher < k].max(initial=-1), higher[higher > k].min(initial=len(level))
        valley = max(level[left + 1 : k + 1].min(), level[k:right].min())
        if level[k] - valley >= prominence:
            kept.append(int(starts[k] + stops[k] - 1) // 2)
    return kept


def modes_near(f: float, natural: Sequence[float], resolution: float) -> str:
    """Numbers of the natural frequencies that a peak may be: they shift with pose and load."""
    near = [i for i, own in enumerate(natural, 1) if abs(own - f) <= max(resolution, 0.03 * f)]
    if not near:
        return ""
    several = len(near) > 1
    return f"\nmode{'s' if several else ''} {near[0]}" + (f"-{near[-1]}" if several else "")


RIGID = "#000000"
_COMPONENTS = {  # of a section, in the beam frame
    "u": ("stretch", "m"),
    "v": ("deflection", "m"),
    "w": ("deflection", "m"),
    "rx": ("twist", "rad"),
    "ry": ("slope", "rad"),
    "rz": ("slope", "rad"),
}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PARTS = {  # of a deviation: components, and units by whether it is small
    "position": ("x y z", ("mm", "µm")),
    "rotation": ("rx ry rz", ("mrad", "µrad")),
}


def torques(rigid: Result, others: Mapping[str, Result]) -> Figure:
    """One panel per motor, rigid and flexible, with the difference from rigid below it."""
    motors = rigid.motors
    if not motors:
        raise DescriptionError("torques: the result has no motors. Name them under `actuated`.")
    for run in others.values():
        same_grid(run, rigid)
    columns = min(3, len(motors))
    bands = -(-len(motors) // columns)
    apart = 0.35 if bands == 1 else 0.55  # titles stand between bands, below the times
    figure, axes = panels(
        2 * bands, columns, bands * HEIGHT, Room(top=0.45, right=0.1, between=(0.6, apart)),
        height_ratios=[3, 1.4] * bands, sharex=True,
    )  # fmt: skip
    for i, motor in enumerate(motors):
        band, column = divmod(i, columns)
        above, below = axes[2 * band, column], axes[2 * band + 1, column]
        # dashed and on top: where the levels agree, rigid stays visible
        dashed: dict[str, Any] = {"color": RIGID, "lw": 1.0, "ls": (0, (5, 4)), "zorder": 5}
        above.plot(rigid.t, rigid.torque[:, i], label="rigid", **dashed)
        for n, (label, run) in enumerate(others.items()):
            colour = COLOURS[n % len(COLOURS)]
            width = 0.9 + 0.7 * (len(others) - 1 - n)  # thinner on top: where they agree, all show
            above.plot(run.t, run.torque[:, i], color=colour, lw=width, label=label)
            below.plot(run.t, run.torque[:, i] - rigid.torque[:, i], color=colour, lw=width)
        title(above, motor)
        below.axhline(0.0, color="0.6", lw=0.6, zorder=0)
        unit, word = rigid.unit(f"torque/{motor}"), _torque_word(rigid, motor)
        if column == 0 or unit != rigid.unit(f"torque/{motors[i - 1]}"):
            above.set_ylabel(f"{word} [{unit}]")
            below.set_ylabel(f"difference [{unit}]")
        if i + columns >= len(motors):
            below.set_xlabel("time [s]")
        above.xaxis.set_visible(False)
        below.tick_params(labelbottom=True)
    for spare in axes[-2:, len(motors) - (bands - 1) * columns :].flat:
        spare.remove()
    _legend(figure, axes[0, 0])
    return figure


def deviation(
    rigid: Result, flexible: Result, frame: str = "platform", still: Result | None = None
) -> Figure:
    """Position and rotation of a frame relative to the rigid run, in world axes.

    In mm and mrad, or in thousandths of them where that is all there is.
    """
    calm = None if still is None else still.deviation_from(rigid, frame)
    dashes = "" if still is None else f"; dashed: {still.level}"
    heading = f"{frame}: {flexible.level} minus {rigid.level}{dashes}"
    return distance(flexible.deviation_from(rigid, frame), calm, heading)


def distance(away: Deviation, calm: Deviation | None = None, heading: str = "") -> Figure:
    """Position and rotation of a deviation, in mm and mrad or in thousandths of them."""
    parts = [partial(draw_distance, away=away, part=part, calm=calm) for part in _PARTS]
    figure = stack(parts, room=Room(), legend=None)
    title(figure.axes[0], heading)
    return figure


def draw_distance(ax: Axes, away: Deviation, part: str, calm: Deviation | None = None) -> None:
    """Position or rotation of a deviation on given axes."""
    names, units = _PARTS[part]
    values = getattr(away, part)
    fine = 1e-12 < peak(values) < 1e-5  # below that it is round-off
    factor = 1e6 if fine else 1e3
    values = factor * values
    ax.axhline(0.0, color="0.6", lw=0.6, zorder=0)
    for i, name in enumerate(names.split()):
        # a planar mechanism has components at round-off: they would only clutter
        if peak(values[:, i]) > 1e-3 * peak(values) or peak(values) == 0:
            ax.plot(away.t, values[:, i], color=COLOURS[i], lw=1.0, label=name)
            if calm is not None:
                slow = factor * getattr(calm, part)[:, i]
                style: dict[str, Any] = {"lw": 0.8, "ls": (0, (4, 3)), "alpha": 0.7}
                ax.plot(away.t, slow, color=COLOURS[i], **style)
    ax.set_ylabel(f"{part} [{units[fine]}]")
    ax.set_xlabel("time [s]")
    ax.legend(frameon=False, ncols=3, loc="upper right", fontsize=8)
    ax.margins(y=0.15)


def stress_map(result: Result, links: Sequence[str] | None = None) -> Figure:
    """Von Mises stress [MPa] of each flexible link over time and place, on one colour scale."""
    names = tuple(result.links if links is None else links)
    if not names:
        raise DescriptionError(
            f"stress_map: a {result.level} result has no flexible links to show. "
            'Solve with level="quasistatic", "ked" or "coupled".'
        )
    views = [result.link(name) for name in names]
    top = max(peak(view.von_mises) for view in views) / 1e6 or 1.0
    each = 1.3 if len(views) < 5 else 0.9  # [in]
    figure, axes = panels(
        len(views), 1, max(HEIGHT, 0.8 + each * len(views)), Room(right=1.0, between=(0.0, 0.32)),
        sharex=True,
    )  # fmt: skip
    for ax, view in zip(axes[:, 0], views, strict=True):
        image = draw_stress(ax, view, top)
        ax.xaxis.set_visible(ax is axes[-1, 0])
    axes[-1, 0].set_xlabel("time [s]")
    low, high = axes[-1, 0].get_position(), axes[0, 0].get_position()
    place = (high.x1 + 0.02, low.y0, 0.02, high.y1 - low.y0)
    bar = figure.colorbar(image, cax=figure.add_axes(place))
    bar.set_label("von Mises stress [MPa]", size=9)
    bar.ax.tick_params(width=0.6, labelsize=8)
    bar.outline.set_visible(False)
    return figure


def draw_stress(ax: Axes, view: LinkView, top: float) -> Any:
    """Von Mises stress of one link over time and place on given axes; returns the image."""
    from matplotlib.colors import PowerNorm
    from matplotlib.image import NonUniformImage

    t, x = view.result.t, 1e3 * view.x
    image = NonUniformImage(  # a smooth pcolormesh looks the same and takes ten times as long
        ax,
        interpolation="bilinear",
        extent=(t[0], t[-1], x[0], x[-1]),
        cmap="cividis",
        norm=PowerNorm(0.5, 0.0, top),  # links that bear little show where they bear it
    )
    image.set_data(t, x, view.von_mises.T / 1e6)
    ax.add_image(image)
    ax.set(xlim=(t[0], t[-1]), ylim=(x[0], x[-1]))
    worst = view.result.worst_stress(link=view.name)
    spot = worst.t, 1e3 * worst.x
    for colour, width in (("white", 2.6), ("black", 1.0)):  # seen on any colour, and outside
        ax.plot(*spot, "o", mfc="none", mec=colour, ms=6, mew=width, clip_on=False, zorder=5)
    title(ax, f"{view.name}: {worst.value / 1e6:.3g} MPa at {worst.t:.4g} s")
    ax.set_ylabel("x [mm]")
    return image


def spectrum(
    result: Result,
    quantity: str,
    reference: Result | None = None,
    after: float = 0.0,
    peaks: int = 4,
    natural: Sequence[float] = (),
    ax: Axes | None = None,
) -> Figure:
    """Amplitude spectrum of one quantity, its highest peaks labelled in Hz."""
    values, label, unit = signal(result, quantity)
    if reference is not None:
        same_grid(result, reference)
        values = values - signal(reference, quantity)[0]
        label += f" minus {reference.level}"
    frequency, amplitude = amplitudes(result.t, values, after)
    found = highest(frequency, amplitude, peaks)
    if ax is None:
        ax = panels(1, 1, room=Room(top=0.55 if len(natural) else 0.3))[1][0, 0]
    figure = figure_of(ax)
    added = QUANTITIES.get(quantity)
    colour = COLOURS[0] if added is None or added.colour is None else added.colour
    ax.plot(frequency, amplitude, color=colour, lw=1.0)
    line = 1.0 / (result.t[-1] - max(after, result.t[0]))
    box = {"fc": "white", "ec": "none", "pad": 0.5, "alpha": 0.8}
    text: dict[str, Any] = {"ha": "center", "fontsize": 8, "linespacing": 1.1, "bbox": box}
    for f, a in found:
        ax.plot(f, a, "o", color=COLOURS[1], ms=4)
        words = f"{f:.1f} Hz" + modes_near(f, natural, line)
        ax.annotate(words, (f, a), (0, 6), textcoords="offset points", **text)
    title(ax, f"{label}, {result.level}" + (f", after {after:g} s" if after else ""))
    for i, f in enumerate(natural):
        name = None if i else "natural frequencies at home"
        ax.axvline(f, color="0.55", lw=0.7, ls=(0, (2, 2)), zorder=0, label=name)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel(f"amplitude [{unit}]")
    # beyond the peaks there is only the decay of the window
    end = min(frequency[-1], 2.5 * max((f for f, _ in found), default=frequency[-1]))
    ax.set_xlim(0.0, end)
    _logarithmic(ax, amplitude[frequency <= end])
    if len(natural):
        _legend(figure, ax)
    return figure


def _logarithmic(ax: Axes, shown: Array) -> None:
    if shown.max() > 0:  # a quantity that never moves has no logarithm
        ax.set_yscale("log")
        ax.set_ylim(max(shown.min(), 1e-5 * shown.max()) / 2, 9 * shown.max())  # and labels
        if (y := ax.get_ylim())[1] > 100 * y[0]:  # else numbers stand between the powers too
            ax.yaxis.set_major_formatter(_power_of_ten)
            ax.yaxis.minorticks_off()


def _power_of_ten(value: float, _: float) -> str:
    """A power of ten as plain text: matplotlib's own is parsed as mathematics, which is slow."""
    return "10" + str(round(np.log10(value))).translate(_RAISED)


def figure_of(ax: Axes) -> Figure:
    """The figure that axes stand in."""
    return cast("Figure", ax.get_figure(root=True))


def signal(result: Result, quantity: str) -> tuple[Array, str, str]:
    """Time series, label and unit of a quantity."""
    kind, _, name = quantity.partition("/")
    if quantity in QUANTITIES and result.array(quantity).ndim == 1:
        return result.array(quantity), QUANTITIES[quantity].label, QUANTITIES[quantity].unit
    if kind == "torque":
        view = result.joint(name)
        return view.torque, f"{_torque_word(result, name)} {name}", result.unit(quantity)
    if kind == "joint" and result.joint(name).position.ndim == 1:
        return result.joint(name).position, f"position {name}", result.unit(f"joint/q/{name}")
    name, _, axis = name.rpartition("/")
    if kind == "frame" and axis in ("x", "y", "z"):
        return result.frame(name).position[:, "xyz".index(axis)], f"{name} {axis}", "m"
    if kind == "link" and axis in _COMPONENTS:
        field = result.link(name).deflection[:, :, [*_COMPONENTS].index(axis)]
        station = int(np.argmax(np.abs(field).max(axis=0)))
        at = f"x = {1e3 * result.link(name).x[station]:.4g} mm"
        word, unit = _COMPONENTS[axis]
        return field[:, station], f"{name}: {word} {axis} at {at}", unit
    forms = ("torque/MOTOR", "joint/JOINT", "frame/FRAME/x", "link/LINK/v")
    raise DescriptionError(
        f"spectrum: quantity {quantity!r} is not known." + nearest(quantity, forms),
        quantity=quantity,
    )


def _torque_word(result: Result, motor: str) -> str:
    return "force" if result.unit(f"torque/{motor}") == "N" else "torque"


def _legend(figure: Figure, ax: Axes) -> None:
    handles, labels = ax.get_legend_handles_labels()
    style: dict[str, Any] = {"ncols": len(labels), "frameon": False, "fontsize": 9}
    figure.legend(handles, labels, loc="upper center", **style)
