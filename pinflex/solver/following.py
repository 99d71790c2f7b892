"""What a digital controller takes from the motion: references of motors and rigid torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pinflex.actuation.drive import breaks, path_between
from pinflex.actuation.motors import motor_axes
from pinflex.arrays import Array, IntArray
from pinflex.description.control import Control, Effort, Travel
from pinflex.description.digital import DigitalPid, is_system
from pinflex.description.motion import Motion
from pinflex.errors import DescriptionError, MotionError
from pinflex.integrators.prescribed import read, tabulated
from pinflex.levels.rigid import solve_rigid
from pinflex.mechanics.mechanism import Mechanism

_SAME = 1e-9  # of a period: times so near are one
_INSTANTS = 401  # between which torques of a rigid motion that is not smooth are interpolated


def rigid_torques(
    mechanism: Mechanism, motion: Motion, start: float, end: float
) -> Callable[[Array], Array]:
    """Motor torques of the rigid mechanism at times in [start, end] s, (k,) to (k, nm).

    Polynomials of pieces, exact to round-off; of sampled motions and the like, which have none, an
    interpolant. Zero where its motors do not determine its motion.
    """

    def exact(t: Array) -> Array:
        times, at = np.unique(t, return_inverse=True)
        return solve_rigid(mechanism, motion, times).torque[at]

    motors = len(mechanism.rigid.motors)
    try:
        corners = breaks(motion, mechanism.rigid.loads)
        table = tabulated(exact, [slice(0, motors)], start, end, corners)
    except MotionError:
        return lambda t: np.zeros((len(t), motors))
    if table is not None:
        return partial(read, table)
    from scipy.interpolate import PchipInterpolator

    # On a grid of its own: how often a run is sampled must not change what drives it.
    t = np.linspace(start, end, _INSTANTS)
    return PchipInterpolator(t, exact(t))  # type: ignore[no-any-return]


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

    def told(t: Array) -> Array:
        of = path(t)
        return np.stack([of.position - home, of.velocity], axis=1)

    motors = _sampled(told, control.period, 0.0, 0.0, end)
    followed, at = _motors(mechanism, control.follow, control.measures)
    n, given_rate = len(control.measures), None if pid is None else pid.rate
    given = control.reference if pid is None else pid.reference

    def reference(t: float) -> Array:
        m = np.zeros(n)
        if given is not None:
            m[:] = given(t)
        m[followed] = motors(t)[0, at]
        return m

    def rate(t: float) -> Array:
        v = np.zeros(n)
        if given_rate is not None:
            v[:] = given_rate(t)
        v[followed] = motors(t)[1, at] if t <= end else 0.0
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
        if 0 <= k < len(values) and abs(x - k) <= _SAME:
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
