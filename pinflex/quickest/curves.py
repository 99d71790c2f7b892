"""Motors whose torque falls with their speed: the `limit_curve` of a drive.

    |tau| <= L(|v|)

with tau the motor's torque times the ratio, v the joint's speed. Between two points of a curve a
step keeps the line of the piece that it is at, and those of the pieces beside it where the curve
bends down. Where it bends up, as that of a motor of constant power, the line lies below the curve
beyond its piece: a step stays inside there, and the next one looks further.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.description.blocks.joints import JointExtra
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.system import System
from pinflex.recovery.meta import motor_side

if TYPE_CHECKING:
    from pinflex.quickest.programme import Rows

_NEAR = 0.4  # of what torque and speed may use, below which a step does not reach the curve


@dataclass(frozen=True)
class Curve:
    """The limit curve of one motor, in units of its joint.

    Attributes:
        name: Of the joint. motor: Its number. row: Its velocity row. extra: What the YAML says.
        speed: Of its points, from 0 on [rad/s | m/s], (n,). torque: There [N m | N], (n,).
        room: Share of it that may be taken.
    """

    name: str
    motor: int
    row: int
    extra: JointExtra
    system: System = field(repr=False)
    speed: Array
    torque: Array
    room: float = 1.0

    @property
    def peak(self) -> float:
        """Largest torque [N m | N]."""
        return float(self.torque.max())

    def used(self, tau: Array, v: Array, a: Array) -> Array:
        """What torque takes and speed takes away, as a share of the peak; 1 on the curve.

        Torques of all motors (k, nm), their speeds and accelerations.
        """
        needed = self._needed(tau, v, a)[0]
        fast = np.abs(v[:, self.motor])
        beyond = np.maximum(fast / self.speed[-1] - 1.0, 0.0)
        return np.asarray(1.0 + beyond + (np.abs(needed) - self._most(fast)) / self.peak)

    def hold(self, rows: Rows, tau: Array, by: Array, v: Array, v_by: Array, a: Array,
             within: float = 1.0) -> None:  # fmt: skip
        """Rows of a step at instants: torques (k, nm), speeds, and both by the numbers."""
        needed, gain = self._needed(tau, v, a)
        speed, way = v[:, self.motor], np.where(v[:, self.motor] < 0.0, -1.0, 1.0)
        slopes = np.diff(self.torque) / np.diff(self.speed)
        starts = self.torque[:-1] - slopes * self.speed[:-1]
        here = np.searchsorted(self.speed[1:-1], np.abs(speed), side="right")
        most, slower = self._most(np.abs(speed)), way[:, None] * v_by[:, self.motor]
        for aside in (-1, 0, 1):
            piece = np.clip(here + aside, 0, len(slopes) - 1)
            down = slopes[np.minimum(here, piece)] >= slopes[np.maximum(here, piece)]
            fresh = down & ((piece == here) == (aside == 0))
            for sign in (1.0, -1.0):
                near = 1.0 + (sign * needed - most) / self.peak > _NEAR
                at = np.flatnonzero(fresh & near)
                slope = slopes[piece[at]]
                row = sign * gain[at, None] * by[at, self.motor] - slope[:, None] * slower[at]
                now = sign * needed[at] - slope * np.abs(speed[at])
                top = starts[piece[at]] - (1.0 - within) * self.peak
                rows.one(row, now, top, slack=-1, unit=self.peak)

    def _most(self, fast: Array) -> Array:
        return np.asarray(np.interp(fast, self.speed, self.torque))

    def _needed(self, tau: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Motor torque times the ratio, and its derivative by the joint's; both over the room.

        With losses the rotor's inertia has another share in it, which a step leaves to the next.
        """
        k = self.motor
        needed, _, gain = motor_side(self.system, self.row, self.extra, tau[:, k], v[:, k], a[:, k])
        return needed / self.room, gain / self.room


def curves_of(mechanism: Mechanism) -> tuple[Curve, ...]:
    """Those of a robot's motors."""
    found, system = [], mechanism.rigid
    for k, name in enumerate(mechanism.motors):
        extra = mechanism.description.joints.get(name)
        if extra is None or extra.drive is None or not extra.drive.limit_curve:
            continue
        ratio = abs(extra.drive.gear)
        speed, torque = np.array(extra.drive.limit_curve).T
        if speed[0] > 0.0:
            speed, torque = np.append(0.0, speed), np.append(torque[0], torque)
        row = int(system.motors[k])
        found.append(Curve(name, k, row, extra, system, speed / ratio, torque * ratio))
    return tuple(found)


def reduced(curves: tuple[Curve, ...], room: float) -> tuple[Curve, ...]:
    """The curves, of which a share may be taken."""
    return tuple(replace(curve, room=room) for curve in curves)
