"""Axes for `.plot()` of a run and of its views: curves on one pair of them, or all of a figure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.results.drives import DriveView
from pinflex.results.lazy import without_time
from pinflex.results.quantities import QUANTITIES, key_of
from pinflex.results.result import Deviation, Result, peak
from pinflex.viewer import plot
from pinflex.viewer.plot import deviation, spectrum, stress_map, torques
from pinflex.viewer.plots.drawing import (
    COLOURS,
    Drawing,
    Room,
    panels,
    shown_axes,
    styled,
    title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Figure of motor torque over motor speed, with the limit curves of the motors.


def torque_speed(result: Result, drives: Sequence[str] | None = None) -> Figure:
    """Motor torque over motor speed of each drive, with its limit curve where there is one."""
    names = tuple(result.drives if drives is None else drives)
    if not names:
        raise DescriptionError(
            "torque_speed: the result has no drives. Write joints.NAME.drive: {gear: ...}."
        )
    columns = min(3, len(names))
    bands = -(-len(names) // columns)
    figure, axes = panels(
        bands, columns, max(3.0, 2.6 * bands), Room(top=0.45, right=0.1, between=(0.6, 0.7))
    )
    for ax, name in zip(axes.flat, names, strict=False):
        draw_torque_speed(ax, result.drive(name))
    for ax in axes[:, 1:].flat:
        ax.set_ylabel("")
    for spare in axes.flat[len(names) :]:
        spare.remove()
    return figure


def draw_torque_speed(ax: Axes, view: DriveView) -> None:
    """Motor torque over motor speed of one drive on given axes."""
    curve = view.limit_curve
    ax.axhline(0.0, color="0.6", lw=0.6, zorder=0)
    ax.axvline(0.0, color="0.6", lw=0.6, zorder=0)
    ax.plot(view.motor_speed, view.motor_torque, color=COLOURS[0], lw=1.0)
    for way, sign in ((1, 1), (1, -1), (-1, 1), (-1, -1)) if len(curve) else ():
        ax.plot(way * curve[:, 0], sign * curve[:, 1], color=COLOURS[1], lw=1.0)
    title(ax, view.name)
    if view.use is not None:
        share = "beyond" if view.use > 1e3 else f"{100 * view.use:.3g} % of"
        ax.text(0.04, 0.52, f"{share}\nthe limit", transform=ax.transAxes, fontsize=8)
    ax.set_xlabel("motor speed [rad/s]")
    ax.set_ylabel("motor torque [N m]")


_FEW = 8  # curves that a legend still tells apart


def plot_run(result: Result, quantity: str | None = None, ax: Axes | None = None) -> Any:
    """Axes with a quantity of a run over time."""
    quantity = quantity or _usual_quantity(result)
    kind, _, name = quantity.partition("/")
    if quantity == "stress" or (kind == "link" and name in result.links):
        return _stress(result, None if quantity == "stress" else name, ax)
    if kind == "loop" and name.endswith("/orbit"):
        return _orbit(result, name.removesuffix("/orbit"), ax)
    curves, label = _curves(result, quantity)
    heading = f"{result.meta.get('name', '')}, {result.level}"
    if without_time(quantity):
        rows = np.arange(len(result.array(quantity)), dtype=float)
        return draw(rows, curves, label, heading, ax, "row")
    return draw(result.t, curves, label, heading, ax)


def _orbit(result: Result, name: str, ax: Axes | None) -> Any:
    """Axes with the way of a pin's centre in its hole, and the circle where it touches."""
    place = 1e6 * result.array(f"loop/{name}/orbit")
    on: Axes = shown_axes(lambda: panels(1, 1)[0]) if ax is None else styled(ax)
    gap = result.meta["settings"].get("clearances", {}).get(name)
    if gap is not None:
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        on.plot(1e6 * gap * np.cos(turn), 1e6 * gap * np.sin(turn), color="0.6", lw=0.8)
    on.plot(place[:, 0], place[:, 1], color=COLOURS[0], lw=0.5, marker=".", ms=2)
    on.set_aspect("equal")
    on.set_xlabel("x in the hole [µm]")
    on.set_ylabel("y in the hole [µm]")
    if ax is None:
        title(on, f"{result.meta.get('name', '')}, orbit of {name}")
    return on


def plot_spectrum(result: Result, quantity: str, ax: Axes | None = None, **options: Any) -> Any:
    """Axes with the amplitude spectrum of a quantity."""
    if ax is None:
        return shown_axes(partial(plot.spectrum, result, quantity, **options))
    plot.spectrum(result, quantity, ax=styled(ax), **options)
    return ax


def plot_deviation(away: Deviation, panel: str | None = None, ax: Axes | None = None) -> Any:
    """Axes with position and rotation of a deviation."""
    each = {
        part: partial(plot.draw_distance, away=away, part=part) for part in ("position", "rotation")
    }
    return Drawing(partial(plot.distance, away), each).axes(panel, ax)


def plot_drive(result: Result, name: str, ax: Axes | None = None) -> Any:
    """Axes with the motor torque over the motor speed of a drive."""
    each = {name: partial(draw_torque_speed, view=result.drive(name))}
    return Drawing(partial(torque_speed, result, [name]), each).axes(None, ax)


def draw(
    t: Array,
    curves: dict[str, Array],
    label: str,
    heading: str,
    ax: Axes | None,
    along: str = "time [s]",
) -> Axes:
    """Curves over time on one pair of axes."""
    own = ax is None
    on: Axes = shown_axes(lambda: panels(1, 1)[0]) if ax is None else styled(ax)
    for k, (name, values) in enumerate(curves.items()):
        on.plot(t, values, color=COLOURS[k % len(COLOURS)], lw=1.0, label=name)
    on.set_xlabel(along)
    on.set_ylabel(label)
    if own:
        title(on, heading)
    if 1 < len(curves) <= _FEW:
        on.legend(frameon=False, fontsize=8, ncols=min(len(curves), 4))
    return on


def _usual_quantity(result: Result) -> str:
    if result.motors:
        return "torque"
    return f"frame/{result.frames[0]}" if result.frames else f"joint/{result.joints[0]}"


def _curves(result: Result, quantity: str) -> tuple[dict[str, Array], str]:
    """Curves by name, and the label of their axis."""
    kind, _, name = quantity.partition("/")
    if quantity == "torque":
        if not result.motors:
            raise DescriptionError("plot: the result has no motors. Name them under `actuated`.")
        units = dict.fromkeys(result.unit(f"torque/{motor}") for motor in result.motors)
        return dict(
            zip(result.motors, result.torque.T, strict=True)
        ), f"torque [{' | '.join(units)}]"
    if quantity in result.arrays or quantity in QUANTITIES:
        return _of_array(result, quantity)
    if kind == "frame" and (name in result.frames or name == "platform"):
        position = result.frame(name).position
        return dict(zip("xyz", position.T, strict=True)), f"position {name} [m]"
    if kind == "loop":
        force = result.loop(name).force
        some = peak(force) or 1.0  # a planar loop has components at round-off
        kept = {f"F{a}": f for a, f in zip("xyz", force.T, strict=True) if peak(f) > 1e-9 * some}
        return kept, f"force {name} [N]"
    values, label, unit = plot.signal(result, quantity)
    return {label: values}, f"{label} [{unit}]"


def _of_array(result: Result, key: str) -> tuple[dict[str, Array], str]:
    """Components of an array by name; of a field along a link, where it is largest."""
    values, known = result.array(key), key_of(key)
    label, names = key, known.columns if known is not None else ()
    if key in QUANTITIES:
        label = QUANTITIES[key].label
    elif key.startswith("link/") and values.ndim > 1 and not without_time(key):
        others = tuple(k for k in range(values.ndim) if k != 1)
        place = int(np.abs(values).max(axis=others).argmax())
        values = values[:, place]
        x = result.link(key.split("/")[1]).x
        at = f"node {place}" if "/mesh/" in key else f"x = {1e3 * x[place]:.4g} mm"
        label = f"{key} at {at}"
    elif key.startswith(("joint/", "nominal/")):
        names = tuple(result.joints)
    flat = values.reshape(len(values), -1)
    if len(names) != flat.shape[1]:
        names = tuple(str(k) for k in range(flat.shape[1])) if flat.shape[1] > 1 else (key,)
    unit = result.unit(key)
    return dict(zip(names, flat.T, strict=True)), f"{label} [{unit}]" if unit else label


def _stress(result: Result, link: str | None, ax: Axes | None) -> Any:
    """A map for each link, or of one link on given axes."""
    if ax is None:
        return shown_axes(partial(plot.stress_map, result, None if link is None else [link]))
    if link is None:
        raise DescriptionError(
            "plot: stress has a map for each link, which one `ax` does not hold. Plot one: "
            'run.links["NAME"].plot(ax=ax).'
        )
    view = result.link(link)
    image = plot.draw_stress(styled(ax), view, peak(view.von_mises) / 1e6 or 1.0)
    bar = plot.figure_of(ax).colorbar(image, ax=ax)
    bar.set_label("von Mises stress [MPa]", size=9)
    ax.set_xlabel("time [s]")
    return ax


# The figures of a comparison, by name: torques, deviation, stress, spectrum.

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
