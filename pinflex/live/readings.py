"""What a simulator tells of an instant, and the states that it keeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.text import brief


@dataclass(frozen=True)
class Motors:
    """The motors at an instant, in the order of `robot.motors`, shape (nm,) each.

    Attributes:
        position, velocity, acceleration: rad | m, and per second. torque: N m | N.
    """

    __repr__ = brief

    position: Array
    velocity: Array
    acceleration: Array
    torque: Array


@dataclass(frozen=True)
class FrameNow:
    """A frame at an instant, in the world.

    Attributes:
        position: Of its origin [m], shape (3,). rotation: World <- frame, shape (3, 3).
        velocity, acceleration: Of its origin, then angular [m/s, rad/s, ...], shape (6,).
    """

    __repr__ = brief

    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class LinkNow:
    """A flexible link at an instant.

    Attributes:
        x: Stations along it [m], shape (nx,).
        deflection: u v w [m] and rx ry rz [rad], in its beam frame, shape (nx, 6).
        strain: Largest normal strain of each section, normal stress over E [-], shape (nx,).
        stress: Largest von Mises stress of each section [Pa], shape (nx,).
    """

    __repr__ = brief

    x: Array
    deflection: Array
    strain: Array
    stress: Array


@dataclass(frozen=True)
class Snapshot:
    """All that a simulator goes on with; it belongs to the simulator that made it."""

    __repr__ = brief

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
