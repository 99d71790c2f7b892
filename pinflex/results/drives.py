"""Drives of a result: torque, speed and power on both sides of the gear, and their peaks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pinflex.arrays import Array
from pinflex.doors import door
from pinflex.report import Table, table
from pinflex.results.views import Stored, View, peak, rms
from pinflex.text import frozen

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinflex.results.result import Result


_SHOWN = ("motor_torque", "motor_speed", "motor_power", "torque", "speed", "power")
_PEAKS = (*_SHOWN, "deflection")
_BEYOND = 1e9  # of a limit: a motor faster than its curve goes


@frozen
class DriveView(View):
    """One drive of a result, on the motor's side of the gear and on the joint's.

    Of an elastic drive the coordinate of the joint is the motor's over the gear ratio; `position`
    and `speed` are those of the link.
    """

    kind = "drive"
    arrays: ClassVar[Mapping[str, str]] = {key: f"drive/NAME/{key}" for key in _SHOWN}

    def plot(self, ax: Axes | None = None) -> Any:
        """Draw motor torque over motor speed, with the limit curve; returns the axes.

        Args:
            ax: Where to draw; default: axes of a new figure.
        """
        return door("viewer.plots.axes", "plot_drive")(self.result, self.name, ax)

    result: Result
    name: str

    motor_position = Stored("drive/NAME/motor_position")
    """Angle of the motor [rad], shape (nt,)."""
    motor_speed = Stored("drive/NAME/motor_speed")
    """Speed of the motor [rad/s], shape (nt,)."""
    motor_torque = Stored("drive/NAME/motor_torque")
    """Torque of the motor: rotor, friction, and the gear with its losses [N m], (nt,)."""
    motor_power = Stored("drive/NAME/motor_power")
    """Mechanical power of the motor [W], shape (nt,)."""
    position = Stored("drive/NAME/position")
    """Position of the link behind the gear [rad | m], shape (nt,)."""
    speed = Stored("drive/NAME/speed")
    """Speed of the link behind the gear [rad/s | m/s], shape (nt,)."""
    torque = Stored("drive/NAME/torque")
    """Torque that the gear gives out [N m | N], shape (nt,)."""
    power = Stored("drive/NAME/power")
    """Power that the gear gives out [W], shape (nt,)."""
    deflection = Stored("drive/NAME/deflection")
    """Joint position minus motor position over the gear ratio [rad | m], shape (nt,)."""

    @property
    def limit_curve(self) -> Array:
        """Points motor speed [rad/s], motor torque [N m], shape (n, 2); n = 0 for none."""
        known = self.result.meta["drives"][self.name].get("limit_curve", ())
        return np.array(known, float).reshape(-1, 2)

    @property
    def use(self) -> float | None:
        """Largest motor torque over the limit at its speed; infinite beyond the last speed."""
        curve = self.limit_curve
        return share_of_limit(curve, self.motor_speed, self.motor_torque) if len(curve) else None


def share_of_limit(curve: Array, speed: Array, torque: Array) -> float:
    """Largest torque over the limit at its speed; infinite where the curve has ended."""
    fast, size = np.abs(speed), np.abs(torque)
    limit = np.interp(fast, curve[:, 0], curve[:, 1])
    limit = np.where(fast > curve[-1, 0] * (1 + 1e-12), 0.0, limit)
    none = np.where(size > 0, np.inf, 0.0)
    return float(np.max(np.where(limit > 0, size / np.where(limit > 0, limit, 1.0), none)))


@frozen
class DriveRow:
    """Largest values of one drive in one run, to choose a motor by.

    Attributes:
        joint: Its joint. level: Of the run.
        motor_torque, motor_rms: Peak and rms torque of the motor [N m]. motor_speed: [rad/s].
        motor_power: [W].
        torque, rms: Peak and rms torque at the joint [N m | N]. speed: Of the link [rad/s | m/s].
        power: [W]. deflection: Of the gear [rad | m].
        use: Motor torque over its limit curve; None without one, infinite beyond its speeds.
    """

    joint: str
    level: str
    motor_torque: float
    motor_rms: float
    motor_speed: float
    motor_power: float
    torque: float
    rms: float
    speed: float
    power: float
    deflection: float
    use: float | None


def drive_row(label: str, run: Result, joint: str) -> DriveRow:
    """The largest values of a drive of a run."""
    d = run.drive(joint)
    values = {key: run.array(f"drive/{joint}/{key}") for key in _PEAKS}
    return row_of(label, joint, values, d.limit_curve)


def row_of(label: str, joint: str, values: Mapping[str, Array], curve: Array) -> DriveRow:
    """The largest values of a drive."""
    torque, speed = values["motor_torque"], values["motor_speed"]
    use = min(share_of_limit(curve, speed, torque), _BEYOND) if len(curve) else None
    largest = {key: peak(values[key]) for key in _PEAKS}
    return DriveRow(
        joint, label, motor_rms=rms(torque), rms=rms(values["torque"]), use=use, **largest
    )


def drive_table(rows: Sequence[DriveRow]) -> Table:
    """The rows, motor side and joint side."""
    limited = [("of limit", "use", _use)] if any(r.use is not None for r in rows) else []
    return table(
        "Drives: torque [N m], rms, speed [rad/s], power [W] of the motor; the same at the joint",
        rows, "joint", "level", ("motor", "motor_torque"), ("rms", "motor_rms"),
        ("speed", "motor_speed"), ("power", "motor_power"), ("joint", "torque"), "rms", "speed",
        *limited, names=(20, 12), once=True,
    )  # fmt: skip


def _use(x: float | None) -> str:
    return "-" if x is None else "too fast" if x >= _BEYOND else f"{100 * x:.3g} %"
