"""Figure of motor torque over motor speed, with the limit curves of the motors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinflex.errors import DescriptionError
from pinflex.results.drives import DriveView
from pinflex.results.result import Result
from pinflex.viewer.panels import COLOURS, Room, panels, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
