"""Feedback: what is measured, what is driven, and the law between them.

    u(t) = law(t, m, dm/dt, int m dt)      m: measured outputs,  u: voltages of patches, torques

A law is any function of these; `pid` makes the usual one. It is evaluated inside the implicit step,
so gains limit the physics, not the step size. With a `period` the law is that of a digital
controller: measured at t = k period, held from then (and a delay) on, saturated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.digital import is_system
from pinflex.errors import DescriptionError
from pinflex.text import brief

Law = Callable[[float, Array, Array, Array], Array]


@dataclass(frozen=True)
class Deflection:
    """Measures the deflection of a flexible link in its own frame, m.

    Attributes:
        link: Flexible link. x: Where along the beam [m]. direction: y or z of the beam.
    """

    link: str
    x: float
    direction: str = "y"


@dataclass(frozen=True)
class Travel:
    """Measures how far a joint of one freedom is from home, rad | m."""

    joint: str


@dataclass(frozen=True)
class Voltage:
    """Drives a piezoelectric patch of a flexible link, V."""

    patch: str


@dataclass(frozen=True)
class Effort:
    """Drives a joint of one freedom, N m | N; a motor only if motors are driven by torque."""

    joint: str


@dataclass(frozen=True)
class Control:
    """A feedback, usable on any model: `solve(mechanism, control=Control(...))`.

    Attributes:
        measures: What is measured.
        drives: What is driven.
        law: u (nu,) of t [s], m, dm/dt and the integral of m, each of shape (nm,). With a period
            also a scipy or python-control system from `reference` - m to u (a continuous one is
            made discrete by Tustin's rule), or an object with a state of its own: every run works
            on a copy of it.
        names: Name of each drive in the result; default: the patch or the joint.
        period: Sample time of a digital controller [s]; None: the law acts continuously.
        delay: From measurement to output of a digital controller [s].
        limit: Largest |u| of each drive of a digital controller; default: for joints the effort
            limits of the URDF, for patches none.
        reference: Values that m should have, (nm,), by time: what a system is compared with.
        forward: Feed-forward of a digital controller, (nu,), by time; taken in the middle of the
            time that it is held.
        follow: Of each measure whether its reference is the motion's, which moves that motor.
        rigid_torque: Of each drive whether the torque that the motion asks of that motor, links
            rigid, is fed forward.
    """

    __repr__ = brief

    measures: tuple[Deflection | Travel, ...]
    drives: tuple[Voltage | Effort, ...]
    law: Law | Any
    names: tuple[str, ...] = ()
    period: float | None = None
    delay: float = 0.0
    limit: tuple[float, ...] = ()
    reference: Callable[[float], Array] | None = None
    forward: Callable[[float], Array] | None = None
    follow: tuple[bool, ...] = ()
    rigid_torque: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        period, sampled = self.period, (self.delay, self.limit, self.reference, self.forward)
        if period is not None and not 0.0 < period < np.inf:
            raise DescriptionError(f"control.period: {period} s. Give a time above 0 s.")
        if not 0.0 <= self.delay < np.inf:
            raise DescriptionError(f"control.delay: {self.delay} s. Give 0 s or more.")
        if period is None and (any(sampled[:2]) or sampled[2] or sampled[3] or _digital(self.law)):
            raise DescriptionError(
                "control: delay, limit, reference, forward, a system as law and a law with a state "
                "are those of a digital controller. Give its period [s]."
            )
        self._require_followed()
        if len(self.limit) not in (0, len(self.drives)) or any(not x > 0 for x in self.limit):
            raise DescriptionError(
                f"control.limit: {list(self.limit)} for {len(self.drives)} drives. Give a number "
                "above 0 for each, or none."
            )

    def _require_followed(self) -> None:
        for what, flags, kind in (
            ("follow", zip(self.follow, self.measures, strict=False), Travel),
            ("rigid_torque", zip(self.rigid_torque, self.drives, strict=False), Effort),
        ):
            if any(on and not isinstance(one, kind) for on, one in flags):
                raise DescriptionError(f"control.{what}: the motion tells what motors do only.")

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each drive."""
        own = (d.patch if isinstance(d, Voltage) else d.joint for d in self.drives)
        return self.names or tuple(own)


def _digital(law: Any) -> bool:
    """Whether a law makes sense at sample instants only: a system, or one with a state."""
    return is_system(law) or hasattr(law, "applied")


@dataclass(frozen=True)
class StateLaw:
    """x' = A x + B e, u = C x + D e + E e', with e = m - target.

    Attributes:
        A, B, C, D, E: Shapes (n, n), (n, nm), (nu, n), (nu, nm), (nu, nm).
        target: Values that the measures should have, shape (nm,).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    E: Array
    target: Array


@dataclass(frozen=True)
class Pid:
    """u_i = kp_i m_i + ki_i int m_i dt + kd_i dm_i/dt; each drive has its own measure.

    Attributes:
        kp, ki, kd: Gains, shape (n,); negative ones oppose what is measured.
        target: Values the measures should have, shape (n,).
    """

    kp: Array
    ki: Array
    kd: Array
    target: Array

    def __call__(self, t: float, m: Array, rate: Array, total: Array) -> Array:
        """u at time t (s)."""
        error = m - self.target
        return np.asarray(self.kp * error + self.ki * (total - self.target * t) + self.kd * rate)

    def linear(self, measures: int) -> StateLaw:
        """The same in state space, of so many measures: states are integrals of e."""
        kp, ki, kd, target = (
            np.broadcast_to(x, measures) for x in (self.kp, self.ki, self.kd, self.target)
        )
        n, one = measures, np.eye(measures)
        return StateLaw(np.zeros((n, n)), one, np.diag(ki), np.diag(kp), np.diag(kd), target)


@public
def pid(
    kp: float | Sequence[float] = 0.0,
    ki: float | Sequence[float] = 0.0,
    kd: float | Sequence[float] = 0.0,
    target: float | Sequence[float] = 0.0,
) -> Pid:
    """A PID law, or without ki a PD law; numbers or one of each per measure.

    Args:
        kp: Gain of the measure.
        ki: Gain of its integral [1/s].
        kd: Gain of its rate [s].
        target: Value that the measure is to have.
    """
    kp_, ki_, kd_, target_ = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in (kp, ki, kd, target))
    )
    return Pid(kp_, ki_, kd_, target_)
