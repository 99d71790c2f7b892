"""What a digital controller takes from the motion: references of motors and rigid torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pinflex.actuation.drive import path_between
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array, IntArray, others
from pinflex.description.blocks.control import Control, DigitalPid, Effort, Travel, is_system
from pinflex.description.motions.motion import Motion
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism

_SAME_INSTANT = 1e-9  # of a period: times so near are one


def following(
    mechanism: Mechanism,
    motion: Motion,
    control: Control,
    end: float,
    torques: Callable[[float, float], Callable[[Array], Array]],
) -> Control:
    """The control with what its `follow` and `rigid_torque` ask for."""
    found = control
    if any(control.follow):
        found = _referred(mechanism, motion, found, end)
    if any(control.rigid_torque):
        own = control.forward
        fed, at = _motors(mechanism, control.rigid_torque, control.drives)
        torque = _sampled(torques(0.0, end), control.period, 0.5, control.delay, end)

        def forward(t: float) -> Array:
            u = np.zeros(len(control.drives)) if own is None else np.array(own(t), float)
            u[fed] += torque(t)[at]
            return u

        found = replace(found, forward=forward)
    return replace(found, follow=(), rigid_torque=())


def _referred(mechanism: Mechanism, motion: Motion, control: Control, end: float) -> Control:
    """References of the followed measures: travel and speed that the motion gives their motors."""
    law = control.law
    pid = law if isinstance(law, DigitalPid) else None
    if pid is None and not is_system(law):
        raise DescriptionError(
            "control.follow: a function of time knows its own reference. Take digital_pid or a "
            "system as law."
        )
    path = path_between(mechanism, motion, 0.0, end)
    home = motor_axes(mechanism).read(mechanism.home)

    n, given_rate = len(control.measures), None if pid is None else pid.rate
    given = control.reference if pid is None else pid.reference
    followed, at = _motors(mechanism, control.follow, control.measures)
    other = others(n, followed)

    def told(t: Array) -> Array:
        of, found = path(t), np.zeros((len(t), 2, n))
        found[:, 0, followed] = (of.position - home)[:, at]
        found[:, 1, followed] = of.velocity[:, at]
        return found

    motors = _sampled(told, control.period, 0.0, 0.0, end)

    def of_motors(t: float, row: int, given: Callable[[float], Array] | None) -> Array:
        m = np.array(motors(t)[row])
        if given is not None and len(other):
            m[other] = np.broadcast_to(given(t), n)[other]
        return m

    def reference(t: float) -> Array:
        return of_motors(t, 0, given)

    def rate(t: float) -> Array:
        v = of_motors(t, 1, given_rate)
        if t > end:
            v[followed] = 0.0
        return v

    if pid is not None:
        return replace(control, law=replace(pid, reference=reference, rate=rate))
    return replace(control, reference=reference)


def _sampled(
    function: Callable[[Array], Array], period: float | None, part: float, delay: float, end: float
) -> Callable[[float], Array]:
    """A function of times as one of single times; at (k + part) period + delay it is known.

    Past the end (s) of the run it stays as it is there.
    """
    assert period is not None
    begin = part * period + delay
    times = begin + np.arange(int(end / period) + 2) * period
    values = list(function(np.minimum(times, end)))

    def at(t: float) -> Array:
        x = (t - begin) / period
        k = round(x)
        if 0 <= k < len(values) and abs(x - k) <= _SAME_INSTANT:
            return np.asarray(values[k])
        return np.asarray(function(np.array([min(t, end)]))[0])

    return at


def _motors(
    mechanism: Mechanism, asked: tuple[bool, ...], those: tuple[object, ...]
) -> tuple[IntArray, IntArray]:
    """Numbers of what is asked for, and of its motors."""
    names = list(mechanism.motors)
    picked = [k for k, on in enumerate(asked) if on]
    joints = [one.joint for k in picked if isinstance(one := those[k], Travel | Effort)]
    unknown = [joint for joint in joints if joint not in names]
    if unknown:
        raise DescriptionError(
            f"{mechanism.name}: control: {unknown[0]} is no motor, and the motion tells what "
            f"motors do. Motors: {', '.join(names)}."
        )
    return np.array(picked), np.array([names.index(joint) for joint in joints])
