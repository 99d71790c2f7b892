"""track(): a digital controller that follows a command: its torque as feed-forward, plus PID."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.actuation.motors import motor_axes
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.blocks.control import Control, Effort, Travel, digital_pid
from pinflex.inversion.command import Command
from pinflex.mechanics.mechanism import Mechanism, takes_model

Gains = float | Sequence[float]


@public
@takes_model
def track(
    mechanism: Mechanism,
    found: Command,
    kp: Gains,
    kd: Gains = 0.0,
    ki: Gains = 0.0,
    *,
    period: float,
    delay: float = 0.0,
    limit: Sequence[float] = (),
) -> Control:
    """A digital controller of the motors: the torque of a command plus PID on their positions.

    For `solve(mechanism, found.motion, level="coupled", start="static", control=...)`.

    Args:
        mechanism: That of the command.
        found: The command: its torque is fed forward, its motor motion is the reference.
        kp, kd, ki: Gains [N m/rad | N/m, times s, per s], numbers or one for each motor.
        period: Sample time [s]. delay: From measurement to output [s].
        limit: Largest torque of each motor; default: the effort limits of the URDF. The integral
            does not wind up there.
    """
    from scipy.interpolate import CubicSpline

    home, end = motor_axes(mechanism).read(mechanism.home), float(found.t[-1])
    curves = [CubicSpline(found.t, x) for x in (found.position, found.velocity, found.torque)]
    position, velocity, torque = curves

    def reference(t: float) -> Array:
        return np.asarray(position(min(t, end)) - home)

    def rate(t: float) -> Array:
        return np.asarray(velocity(t) if t <= end else np.zeros(len(home)))

    def forward(t: float) -> Array:
        return np.asarray(torque(min(t, end)))

    law = digital_pid(kp, ki, kd, period=period, reference=reference, rate=rate)
    return Control(
        measures=tuple(Travel(name) for name in found.motors),
        drives=tuple(Effort(name) for name in found.motors),
        law=law,
        period=period,
        delay=delay,
        limit=tuple(limit),
        forward=forward,
    )
