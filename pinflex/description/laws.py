"""The laws of time behind the motions: position, velocity and acceleration of t >= 0.

Module functions, bound by `functools.partial`, so that a Motion can be pickled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pinflex.arrays import Array

SNAP = 1e-12  # [-] of the duration: a grid time that rounds to a switching instant is past it

Kinematics = tuple[Array, Array, Array]


def cycloid(u: Array) -> Kinematics:
    """s(u) = u - sin(2 pi u)/(2 pi) and its two derivatives."""
    w = 2.0 * np.pi
    return u - np.sin(w * u) / w, 1.0 - np.cos(w * u), w * np.sin(w * u)


def quintic(u: Array) -> Kinematics:
    """s(u) = 10 u^3 - 15 u^4 + 6 u^5 and its two derivatives."""
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    return s, 30.0 * (u * (1.0 - u)) ** 2, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)


def nonic(u: Array) -> Kinematics:
    """s(u) = 126 u^5 - 420 u^6 + 540 u^7 - 315 u^8 + 70 u^9: four rates vanish at both ends."""
    s = u**5 * (126.0 - u * (420.0 - u * (540.0 - u * (315.0 - 70.0 * u))))
    flat = u * (1.0 - u)
    return s, 630.0 * flat**4, 2520.0 * flat**3 * (1.0 - 2.0 * u)


def trapezoid(r: float, u: Array) -> Kinematics:
    """Speed 1/(1 - r) between ramps of length r; the acceleration is continuous from the right."""
    speed, past = 1.0 / (1.0 - r), u + SNAP
    rise, fall = 0.5 * speed / r * u**2, 1.0 - 0.5 * speed / r * (1.0 - u) ** 2
    s = np.where(u < r, rise, np.where(u < 1.0 - r, speed * (u - 0.5 * r), fall))
    ds = speed * np.minimum(1.0, np.minimum(u, 1.0 - u) / r)
    return s, ds, speed / r * ((past < r).astype(np.float64) - (past >= 1.0 - r))


def move(
    shape: Callable[[Array], Kinematics], delta: Array, duration: float, t: Array
) -> Kinematics:
    """delta s(t/T), then rest."""
    u = np.minimum(t / duration, 1.0)
    s, ds, dds = shape(u)
    on, rate = u < 1.0 - SNAP, delta / duration
    return np.outer(s, delta), np.outer(ds * on, rate), np.outer(dds * on, rate / duration)


def spin_up(speed: Array, duration: float, t: Array) -> Kinematics:
    """Speed along the cycloid s(t/T), so that the angle starts with its first three rates zero."""
    u = np.minimum(t / duration, 1.0)
    s, ds, _ = cycloid(u)
    turn = duration * (0.5 * u**2 + (np.cos(2.0 * np.pi * u) - 1.0) / (4.0 * np.pi**2))
    angle = turn + np.maximum(t - duration, 0.0)
    return np.outer(angle, speed), np.outer(s, speed), np.outer(ds, speed / duration)


def harmonic(amplitude: Array, omega: float, phase: float, smooth: float, t: Array) -> Kinematics:
    """f g: g = sin(omega t + phase) - sin(phase), f the quintic fade-in."""
    angle = omega * t + phase
    g, dg, ddg = np.sin(angle) - np.sin(phase), omega * np.cos(angle), -(omega**2) * np.sin(angle)
    if smooth > 0.0:
        f, df, ddf = quintic(np.minimum(t / smooth, 1.0))
        df, ddf = df / smooth, ddf / smooth**2
        g, dg, ddg = f * g, df * g + f * dg, ddf * g + 2.0 * df * dg + f * ddg
    return np.outer(g, amplitude), np.outer(dg, amplitude), np.outer(ddg, amplitude)


def circle(rest: Array, z0: complex, omega: float, ramp: float, t: Array) -> Kinematics:
    """rest, with z0 exp(i theta) on its first two columns; theta' rises to omega as a quintic."""
    theta, rate, gain = omega * t, np.full_like(t, omega), np.zeros_like(t)
    if ramp > 0.0:
        u = np.minimum(t / ramp, 1.0)
        s, ds, _ = quintic(u)
        turned = ramp * u**4 * (2.5 - 3.0 * u + u**2)  # integral of s over the ramp [s]
        theta = omega * (turned + np.maximum(t - ramp, 0.0))
        rate, gain = omega * s, omega * ds / ramp
    z = z0 * np.exp(1j * theta)
    p, v, a = (np.zeros((len(t), len(rest))) for _ in range(3))
    for out, x in ((p, z), (v, 1j * rate * z), (a, (1j * gain - rate**2) * z)):
        out[:, 0], out[:, 1] = x.real, x.imag
    return p + rest, v, a


def spline_law(spline: Any, last: float, periodic: bool, t: Array) -> Kinematics:
    """A spline with its derivatives, clamped at its end or repeated."""
    u = np.mod(t, last) if periodic else np.minimum(t, last)
    on = (t < last)[:, None] | periodic
    return spline(u), np.where(on, spline(u, 1), 0.0), np.where(on, spline(u, 2), 0.0)


# Checks: key path, what is wrong with the value, what is allowed or what to do.
