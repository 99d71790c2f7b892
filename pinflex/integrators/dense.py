"""A run of equal steps at samples that lie between its steps.

Positions and velocities are the cubics through the values and slopes at both ends of a step; they
err with its fourth power. Accelerations, multipliers, torques and signals, whose error falls with
the square of the step as the method's own, go straight from step to step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinflex.actuation.drive import MotorPath
from pinflex.actuation.path import MotorAxes
from pinflex.arrays import Array, IntArray
from pinflex.integrators.problem import Run

_CURVED = 0.125  # of a second difference: what a straight line misses at most of a parabola


def between(run: Run, t: Array, led: tuple[MotorAxes, MotorPath] | None) -> Run:
    """The run at samples, each between two of its instants, and what straight lines may miss.

    `settings["interpolated"]`: by how much torques are off at most [N m | N].

    Args:
        run: Of equal steps.
        t: Samples (s), shape (n,), no earlier than its first instant and no later than its last.
        led: Motors that follow their motion, and the motion at the samples.
    """
    h = float(run.t[-1] - run.t[0]) / (len(run.t) - 1)
    at = np.clip(((t - run.t[0]) / h).astype(np.intp), 0, len(run.t) - 2)
    x = np.clip((t - run.t[at]) / h, 0.0, 1.0)[:, None]
    x[t >= run.t[-1]] = 1.0
    system, v = run.system, _cubic(run.v, h * run.a, at, x)
    pairs = zip(run.y[:-1], run.y[1:], strict=True)
    moves = np.array([system.difference(first, last) for first, last in pairs])[at]
    ways = x * x * (3 - 2 * x) * moves + h * x * (1 - x) * ((1 - x) * run.v[at] - x * run.v[at + 1])
    y = np.array([system.integrate(run.y[k], dy) for k, dy in zip(at, ways, strict=True)])
    a = _straight(run.a, at, x)
    if led is not None:
        axes, path = led
        axes.write(y, path.position)
        v[:, system.motors], a[:, system.motors] = path.velocity, path.acceleration
    signals = run.signals
    if signals is not None:
        u, measured = (_straight(z, at, x) for z in (signals.u, signals.measured))
        signals = replace(signals, u=u, measured=measured)
    missed = _CURVED * np.abs(np.diff(run.torque, 2, axis=0)).max(initial=0.0)
    work = None if run.work is None else _cubic(run.work, np.gradient(run.work, axis=0), at, x)
    return replace(
        run, t=t, y=y, v=v, a=a, lam=_straight(run.lam, at, x),
        torque=_straight(run.torque, at, x), signals=signals, work=work,
        s=None if run.s is None else _straight(run.s, at, x),
        settings={**run.settings, "interpolated": float(missed)},
    )  # fmt: skip


def _straight(values: Array, at: IntArray, x: Array) -> Array:
    return (1 - x) * values[at] + x * values[at + 1]


def _cubic(values: Array, slopes: Array, at: IntArray, x: Array) -> Array:
    """Through values (n, k), with slopes per step."""
    rise = values[at + 1] - values[at]
    bend = (1 - x) * (slopes[at] - rise) + x * (rise - slopes[at + 1])
    return np.asarray(values[at] + x * rise + x * (1 - x) * bend)
