"""What a command asks of motors, against what they can do: URDF limits and limit curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinflex.description.urdf import Limits, limits
from pinflex.errors import MotionError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.drives import share_of_limit

if TYPE_CHECKING:
    from pinflex.inversion.command import Command


def require_within_limits(mechanism: Mechanism, found: Command) -> None:
    """Refuse torques and speeds of joints beyond the URDF's."""
    known = limits(mechanism.description.urdf_text)
    for k, name in enumerate(mechanism.description.actuated):
        limit = known.get(name, Limits())
        speed = "m/s" if found.units[k] == "N" else "rad/s"
        for values, most, unit, what in (
            (found.torque[:, k], limit.effort, found.units[k], "effort"),
            (found.velocity[:, k], limit.velocity, speed, "velocity"),
        ):
            at = int(np.argmax(np.abs(values)))
            if 0.0 < most < abs(values[at]):
                raise MotionError(
                    f"{mechanism.name}: command: {name} needs {abs(values[at]):.4g} {unit} at t = "
                    f"{found.t[at]:.4g} s, the URDF's {what} limit is {most:g}. Slow the motion "
                    "down, or lift the check (limited=False, --beyond-limits).",
                    joint=name,
                )


def require_within_curves(mechanism: Mechanism, found: Command) -> None:
    """Refuse what is beyond the limit curve of a drive."""
    for name, side in found.drives.items():
        curve = np.array(found.limit_curves[name])
        if not len(curve):
            continue
        used = share_of_limit(curve, side["motor_speed"], side["motor_torque"])
        if used > 1.0:
            fastest = float(np.max(np.abs(side["motor_speed"])))
            raise MotionError(
                f"{mechanism.name}: command: {name} needs "
                + (f"{100 * used:.0f} % of its motor's" if np.isfinite(used) else "more than its")
                + f" limit_curve; its motor turns at up to {fastest:.4g} rad/s. Slow the motion "
                "down, or lift the check (limited=False, --beyond-limits).",
                joint=name,
            )
