"""A command held against the equations: forward coupled runs with it and with the rigid one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinflex.actuation.path import motor_axes
from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.blocks.control import Control, Effort, Travel, digital_pid
from pinflex.description.motions.motion import Motion
from pinflex.inversion.command import Command
from pinflex.inversion.target import delayed
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.results.result import Result, peak
from pinflex.results.views import Deviation
from pinflex.rotations import zyx_angles

_SAMPLES = 401
_TOL = 1e-4  # of time integration, relative to the largest deflection


@dataclass(frozen=True)
class Followed:
    """How well the platform followed its path in a forward run.

    Attributes:
        during, after: Largest distance from the path while it moves and in the rest after it [m].
        turned_during, turned_after: The same of its orientation [rad].
        stopped, turned_stopped: Largest distance [m] and turn [rad] once the motors have stopped,
            over as long again as that rest: what still rings then is off the path.
        swing: Largest peak-to-peak motion along an axis in the rest after it [m].
        off_path: From the path, in the coordinates that the command imposes; zero in the others.
            Its rotation is of the angles rx ry rz, of which a command may impose one.
        run: The coupled run. ideal: The rigid mechanism on the path.
    """

    during: float
    after: float
    turned_during: float
    turned_after: float
    stopped: float
    turned_stopped: float
    swing: float
    off_path: Deviation
    run: Result
    ideal: Result


def followed(mechanism: Mechanism, motion: Motion, found: Command, tol: float = _TOL) -> Followed:
    """Run level coupled with a command from equilibrium, and look at the platform.

    The path is that of the rigid mechanism, in the coordinates that the command imposes; the run
    knows nothing of how the command was found.
    """
    end, frame = float(found.t[-1]), str(mechanism.description.platform)
    until = end + found.after
    run = solve(
        mechanism, found.motion, level="coupled", start="static", tol=tol, samples=_SAMPLES,
        until=until, asked=("platform",),  # a torque that nearly vanishes has a higher floor
    )  # fmt: skip
    path = delayed(motion, found.before)
    ideal = solve(mechanism, path, level="rigid", samples=_SAMPLES, until=until)
    here, there = (x.frame(frame) for x in (run, ideal))
    turned = zyx_angles(here.rotation) - zyx_angles(there.rotation)  # what is imposed: no vector
    turned = ((turned + np.pi) % (2.0 * np.pi) - np.pi)[:, ::-1]
    imposed = np.array([name in found.coordinates for name in ("x", "y", "z", "rx", "ry", "rz")])
    away = here.position - there.position
    off = Deviation(run.t, away * imposed[:3], turned * imposed[3:])
    moving, stopped = run.t <= end - found.after, run.t > end
    after = ~moving & ~stopped
    swing = np.ptp(off.position[after], axis=0) if np.any(after) else np.zeros(0)
    return Followed(
        during=peak(off.norm[moving]),
        after=peak(off.norm[after]),
        turned_during=peak(off.angle[moving]),
        turned_after=peak(off.angle[after]),
        stopped=peak(off.norm[stopped]),
        turned_stopped=peak(off.angle[stopped]),
        swing=peak(swing),
        off_path=off,
        run=run,
        ideal=ideal,
    )


# track(): a digital controller that follows a command: its torque as feed-forward, plus PID.

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
