"""What a robot's sensors read, without noise: encoders, strain gauges and inertial units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinflex.actuation.motors import motor_axes
from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.evaluation.compiled import Compiled
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.kinematics import motion_of
from pinflex.text import brief


@dataclass(frozen=True)
class Encoder:
    """Reads the position of a motor (rad | m), to the nearest of its steps.

    Attributes:
        motor: A motor. resolution: Step [rad | m]; 0: none.
    """

    __repr__ = brief

    motor: str
    resolution: float = 0.0


@dataclass(frozen=True)
class StrainGauge:
    """Reads the normal strain [-] along a flexible link at a point of a section.

    Plane sections: u' - y v'' - z w'' with y and z from the centre line.

    Attributes:
        link: A flexible link. x: Place along it [m]. y, z: Point in the section [m].
    """

    __repr__ = brief

    link: str
    x: float
    y: float = 0.0
    z: float = 0.0


@dataclass(frozen=True)
class Imu:
    """Reads specific force [m/s^2] (9.81 up where it rests) and turn rate [rad/s], shape (6,).

    Both in the axes of the frame: R' (a - g), R' w.

    Attributes:
        frame: A link frame.
    """

    __repr__ = brief

    frame: str


Sensor = Encoder | StrainGauge | Imu


class Placed(Protocol):
    """A sensor at its place."""

    def read(self, compiled: Compiled, state: Sequence[Array]) -> Array:
        """What it reads at y, v and a, of shape (1, n) each."""


def placed(mechanism: Mechanism, name: str, sensor: object) -> Placed:
    """A sensor at its place.

    Raises:
        DescriptionError: It is none, or what it sits on does not exist.
    """
    where = f"{mechanism.name}: sensors: {name}"
    if isinstance(sensor, Encoder):
        return _Encoder(mechanism, sensor, where)
    if isinstance(sensor, StrainGauge):
        return _Gauge(mechanism, sensor, where)
    if isinstance(sensor, Imu):
        return _Imu(mechanism, sensor)
    raise DescriptionError(f"{where}: no sensor. Give pf.Encoder, pf.StrainGauge or pf.Imu.")


class _Encoder:
    def __init__(self, mechanism: Mechanism, given: Encoder, where: str) -> None:
        names = mechanism.motors
        if given.motor not in names:
            raise DescriptionError(
                f"{where}: {given.motor}: not a motor.{nearest(given.motor, names)}"
            )
        if not 0.0 <= given.resolution < np.inf:
            raise DescriptionError(f"{where}: resolution: {given.resolution}. Give 0 or more.")
        self._axes, self._at = motor_axes(mechanism), names.index(given.motor)
        self._step = float(given.resolution)

    def read(self, compiled: Compiled, state: Sequence[Array]) -> Array:
        position = self._axes.read(state[0][0])[self._at]
        counted = self._step * np.round(position / self._step) if self._step else position
        return np.array(counted)


class _Gauge:
    def __init__(self, mechanism: Mechanism, given: StrainGauge, where: str) -> None:
        self.at, self.row = gauge_row(mechanism, given, where)

    def read(self, compiled: Compiled, state: Sequence[Array]) -> Array:
        return np.array(self.row @ state[0][0, self.at])


def gauge_row(mechanism: Mechanism, given: StrainGauge, where: str) -> tuple[slice, Array]:
    """Where in y the coordinates of a gauge's body are, and what each does to its strain."""
    parts = mechanism.parts
    if given.link not in parts:
        raise DescriptionError(
            f"{where}: {given.link}: no such flexible link.{nearest(given.link, parts)}"
        )
    part = parts[given.link]
    if not 0.0 <= given.x <= part.length:
        raise DescriptionError(f"{where}: x: {given.x}. Allowed: 0 to {part.length:g} m.")
    slots = [s for s in mechanism.flexible.expansion.slots if s.link == given.link]
    slot = next(s for s in reversed(slots) if given.x >= s.offset or s is slots[0])
    if slot.body.solid is not None:
        raise DescriptionError(f"{where}: {given.link} is a solid. Gauges sit on beams.")
    fields = slot.body.fields(np.array([given.x - slot.offset]))
    row = np.zeros(slot.body.n)
    for field, factor in (("axial", 1.0), ("curvature_v", -given.y), ("curvature_w", -given.z)):
        if field in fields:
            row += factor * fields[field][0]
    first = int(mechanism.flexible.rigid.nq)
    return slice(first + slot.eta.start, first + slot.eta.stop), row


class _Imu:
    def __init__(self, mechanism: Mechanism, given: Imu) -> None:
        self._place = mechanism.frame(given.frame)
        self._gravity = np.array(mechanism.description.gravity, dtype=float)

    def read(self, compiled: Compiled, state: Sequence[Array]) -> Array:
        Y, V, A = state
        poses, rates = compiled.motions(Y, V, A, [self._place.joint])
        _, turn, v, a = motion_of(poses[0], rates[0], self._place.placement)
        R = turn[0]
        return np.concatenate([R.T @ (a[0, :3] - self._gravity), R.T @ v[0, 3:]])
