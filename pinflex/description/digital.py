"""Laws of digital controllers, with a state: a linear system, and a PID that does not wind up.

A law is called once a sample, with t, m, dm/dt and the integral of m. One that has a method
`applied` is told afterwards the output that the limits left of its own.

Source: Astrom, Wittenmark (1997), Computer-Controlled Systems, ch. 8 (Tustin, PID, anti-windup).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.errors import DescriptionError

_SAME = 1e-6  # relative: two sample times


def is_system(law: Any) -> bool:
    """Whether a law is a scipy or python-control system, of which some are callable too."""
    return hasattr(law, "dt") and any(hasattr(law, name) for name in ("A", "num", "zeros"))


@dataclass
class DigitalPid:
    """u = kp e + ki int e dt + kd de/dt with e = reference - m, once a sample.

    The integral stands still while the output is saturated and e would drive it further
    (conditional integration).

    Attributes:
        kp, ki, kd: Gains, shape (n,). period: Sample time [s].
        reference, rate: Of m, (n,) by time; rate None: the reference stands still.
        limit: Largest |u| that the law itself asks for, shape (n,).
    """

    kp: Array
    ki: Array
    kd: Array
    period: float
    reference: Callable[[float], Array]
    rate: Callable[[float], Array] | None = None
    integral: Array = field(default_factory=lambda: np.zeros(1))
    _error: Array = field(default_factory=lambda: np.zeros(1))
    _asked: Array = field(default_factory=lambda: np.zeros(1))

    def __call__(self, t: float, m: Array, rate: Array, total: Array) -> Array:
        """u at the sample at time t (s)."""
        self._error = e = np.asarray(self.reference(t)) - m
        wanted = 0.0 if self.rate is None else np.asarray(self.rate(t))
        return np.asarray(self.kp * e + self.ki * self.integral + self.kd * (wanted - rate))

    def applied(self, asked: Array, given: Array) -> None:
        """Integrate the error, but not further into a limit.

        Args:
            asked: Output with the feed-forward. given: What the limits left of it.
        """
        beyond = asked - given
        winding = beyond * self.ki * self._error > 0.0
        self.integral = self.integral + ~winding * (self.period * self._error)


@public
def digital_pid(
    kp: float | Sequence[float] = 0.0,
    ki: float | Sequence[float] = 0.0,
    kd: float | Sequence[float] = 0.0,
    *,
    period: float,
    reference: float | Sequence[float] | Callable[[float], Array] = 0.0,
    rate: Callable[[float], Array] | None = None,
) -> DigitalPid:
    """A PID law of a digital controller with anti-windup, for `Control(..., period=period)`.

    Args:
        kp, ki, kd: Gains, numbers or one of each per measure; positive ones oppose the error.
        period: Sample time [s], that of the control.
        reference: Values the measures should have, or a function of time that gives them.
        rate: Rates of the reference by time.
    """
    gains = [np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in (kp, ki, kd)]
    known = np.atleast_1d(np.asarray(0.0 if callable(reference) else reference, dtype=np.float64))
    follow = reference if callable(reference) else lambda t: known
    size = np.broadcast_shapes(*(g.shape for g in gains), known.shape)
    kp_, ki_, kd_ = (np.broadcast_to(g, size) for g in gains)
    return DigitalPid(kp_, ki_, kd_, period, follow, rate, np.zeros(size))


@dataclass
class LinearLaw:
    """x' = A x + B e, u = C x + D e at sample k, with e = reference - m."""

    A: Array
    B: Array
    C: Array
    D: Array
    reference: Callable[[float], Array] | None
    x: Array

    def __call__(self, t: float, m: Array, rate: Array, total: Array) -> Array:
        """u at the sample at time t (s); the state goes one sample on."""
        e = -m if self.reference is None else np.asarray(self.reference(t)) - m
        u = self.C @ self.x + self.D @ e
        self.x = self.A @ self.x + self.B @ e
        return np.asarray(u)


def linear_law(
    system: Any, period: float, reference: Callable[[float], Array] | None = None
) -> LinearLaw:
    """The law of a scipy or python-control system (state space, transfer function, zpk).

    Raises:
        DescriptionError: No system, or one of another sample time.
    """
    from scipy.signal import cont2discrete

    A, B, C, D, dt = _matrices(system)
    if not dt:
        A, B, C, D, _ = cont2discrete((A, B, C, D), period, method="bilinear")
    elif dt is not True and abs(dt / period - 1.0) > _SAME:
        raise DescriptionError(
            f"control.period: {period:g} s, but the system's sample time is {dt:g} s. Give the "
            "same."
        )
    return LinearLaw(A, B, C, D, reference, np.zeros(len(A)))


def _matrices(system: Any) -> tuple[Array, Array, Array, Array, Any]:
    """A, B, C, D and the sample time (None, 0: continuous; True: not said) of a system."""
    found = system
    if hasattr(system, "to_ss"):  # scipy's transfer functions and zeros-poles-gain
        found = system if hasattr(system, "A") else system.to_ss()
    elif hasattr(system, "num") and not hasattr(system, "A"):  # python-control's
        import control

        found = control.ss(system)
    if not all(hasattr(found, name) for name in "ABCD"):
        raise DescriptionError(
            f"control.law: {type(system).__name__} is no function and no linear system. Give a "
            "function of (t, m, rate, total), or a scipy.signal or python-control system."
        )
    A, B, C, D = (np.atleast_2d(np.asarray(getattr(found, name), float)) for name in "ABCD")
    return A.reshape(len(A), -1), B, C, D, getattr(found, "dt", None)
