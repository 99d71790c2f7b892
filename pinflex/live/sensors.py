"""What a robot's sensors read, without noise: encoders, strain gauges and inertial units."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array
from pinflex.description.reading.schema import shown
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.evaluation.compiled import Compiled
from pinflex.mechanics.evaluation.frames import motion_of
from pinflex.mechanics.mechanism import Mechanism
from pinflex.text import frozen


@frozen
class Encoder:
    """Reads the position of a motor (rad | m), to the nearest of its steps.

    Attributes:
        motor: A motor. resolution: Step [rad | m]; 0: none.
    """

    motor: str
    resolution: float = 0.0


@frozen
class StrainGauge:
    """Reads the normal strain [-] along a flexible link at a point of a section.

    Plane sections: u' - y v'' - z w'' with y and z from the centre line.

    Attributes:
        link: A flexible link. x: Place along it [m]. y, z: Point in the section [m].
    """

    link: str
    x: float
    y: float = 0.0
    z: float = 0.0


@frozen
class Imu:
    """Reads specific force [m/s^2] (9.81 up where it rests) and turn rate [rad/s], shape (6,).

    Both in the axes of the frame: R' (a - g), R' w.

    Attributes:
        frame: A link frame.
    """

    frame: str


Sensor = Encoder | StrainGauge | Imu
_FAR = 1e3  # [m] from the centre line of a beam: beyond any section


def number(value: object) -> float:
    """A number as a float, not a number where it is none."""
    try:
        return math.nan if isinstance(value, str | bytes) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan


# What a sensor reads at y, v and a, of shape (1, n) each.
Read = Callable[[Compiled, Sequence[Array]], Array]


def placed(mechanism: Mechanism, name: str, sensor: object) -> Read:
    """A sensor at its place; raises DescriptionError where it is none, or what it sits on."""
    where = f"{mechanism.name}: sensors: {name}"
    if isinstance(sensor, Encoder):
        return _encoder(mechanism, sensor, where)
    if isinstance(sensor, StrainGauge):
        at, row = gauge_row(mechanism, sensor, where)
        return lambda compiled, state: np.array(row @ state[0][0, at])
    if isinstance(sensor, Imu):
        return _imu(mechanism, sensor)
    raise DescriptionError(f"{where}: no sensor. Give pf.Encoder, pf.StrainGauge or pf.Imu.")


def _encoder(mechanism: Mechanism, given: Encoder, where: str) -> Read:
    names = mechanism.motors
    if given.motor not in names:
        raise DescriptionError(f"{where}: {given.motor}: not a motor.{nearest(given.motor, names)}")
    if not 0.0 <= number(given.resolution) < np.inf:
        said = shown(given.resolution)
        raise DescriptionError(f"{where}: resolution: {said}. Give 0 or more.")
    axes, at, step = motor_axes(mechanism), names.index(given.motor), float(given.resolution)

    def read(compiled: Compiled, state: Sequence[Array]) -> Array:
        position = axes.read(state[0][0])[at]
        return np.array(step * np.round(position / step) if step else position)

    return read


def gauge_row(mechanism: Mechanism, given: StrainGauge, where: str) -> tuple[slice, Array]:
    """Where in y the coordinates of a gauge's body are, and what each does to its strain."""
    parts = mechanism.parts
    if given.link not in parts:
        raise DescriptionError(
            f"{where}: {given.link}: no such flexible link.{nearest(given.link, parts)}"
        )
    part = parts[given.link]
    for axis, low, high in (("x", 0.0, part.length), ("y", -_FAR, _FAR), ("z", -_FAR, _FAR)):
        if not low <= number(getattr(given, axis)) <= high:
            said = shown(getattr(given, axis))
            raise DescriptionError(f"{where}: {axis}: {said}. Allowed: {low:g} to {high:g} m.")
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


def _imu(mechanism: Mechanism, given: Imu) -> Read:
    place = mechanism.frame(given.frame)
    gravity = np.array(mechanism.description.gravity, dtype=float)

    def read(compiled: Compiled, state: Sequence[Array]) -> Array:
        y, v, a = state
        poses, rates = compiled.motions(y, v, a, [place.joint])
        _, turn, v, a = motion_of(poses[0], rates[0], place.placement)
        R = turn[0]
        return np.concatenate([R.T @ (a[0, :3] - gravity), R.T @ v[0, 3:]])

    return read


# What a simulator tells of an instant, and the states that it keeps.


@frozen
class Motors:
    """The motors at an instant, in the order of `robot.motors`, shape (nm,) each.

    Attributes:
        position, velocity, acceleration: rad | m, and per second. torque: N m | N.
    """

    position: Array
    velocity: Array
    acceleration: Array
    torque: Array


@frozen
class FrameNow:
    """A frame at an instant, in the world.

    Attributes:
        position: Of its origin [m], shape (3,). rotation: World <- frame, shape (3, 3).
        velocity, acceleration: Of its origin, then angular [m/s, rad/s, ...], shape (6,).
    """

    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array


@frozen
class LinkNow:
    """A flexible link at an instant.

    Attributes:
        x: Stations along it [m], shape (nx,).
        deflection: u v w [m] and rx ry rz [rad], in its beam frame, shape (nx, 6).
        strain: Largest normal strain of each section, normal stress over E [-], shape (nx,).
        stress: Largest von Mises stress of each section [Pa], shape (nx,).
    """

    x: Array
    deflection: Array
    strain: Array
    stress: Array


@frozen
class Snapshot:
    """All that a simulator goes on with; it belongs to the simulator that made it."""

    of: int
    led: bool
    steps: int
    state: tuple[bytes, ...]


class Log:
    """Every so-many-th state from step `first` on.

    Attributes:
        t: Times [s].
    """

    def __init__(self, every: int, first: int) -> None:
        self._every, self._first, self.t = every, first, list[float]()
        self._rows: list[tuple[Array, ...]] = []

    def keep(self, step: int, t: float, found: Sequence[Array]) -> None:
        """The state at instant 1 of `found`, if it is this one's turn."""
        if (step - self._first) % self._every == 0:
            self.t.append(t)
            self._rows.append(tuple(column[1].copy() for column in found))

    def columns(self) -> list[Array]:
        """y, v, a, s, lam, torque and power at its instants, shapes (nt, n)."""
        return [np.array(x) for x in zip(*self._rows, strict=True)]

    def work(self) -> Array:
        """Energy put in by the motors and taken by damping so far [J], shape (nt, 2)."""
        power, h = self.columns()[-1], np.diff(self.t)[:, None]
        work = np.zeros((len(self.t), 2))
        np.cumsum(0.5 * h * (power[1:] + power[:-1]), axis=0, out=work[1:])
        return work
