"""What a digital controller takes from the motion: references of motors and rigid torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pinflex.actuation.drive import breaks, path_between
from pinflex.actuation.motors import motor_axes
from pinflex.arrays import Array
from pinflex.description.control import Control, Effort, Travel
from pinflex.description.digital import DigitalPid, is_system
from pinflex.description.motion import Motion
from pinflex.errors import DescriptionError, MotionError
from pinflex.integrators.prescribed import read, tabulated
from pinflex.levels.rigid import solve_rigid
from pinflex.mechanics.mechanism import Mechanism

_INSTANTS = 401  # between which torques of a rigid motion that is not smooth are interpolated


def rigid_torques(
    mechanism: Mechanism, motion: Motion, start: float, end: float
) -> Callable[[Array], Array]:
    """Motor torques of the rigid mechanism at times in [start, end] s, (k,) to (k, nm).

    Polynomials of pieces, exact to round-off; of sampled motions and the like, which have none, an
    interpolant. Zero where its motors do not determine its motion.

    Args:
        mechanism: Mechanism. motion: Its motion. start, end: Of the run [s].
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


def following(mechanism: Mechanism, motion: Motion, control: Control, end: float) -> Control:
    """The control with what its `follow` and `rigid_torque` ask for.

    Args:
        mechanism: Mechanism. motion: Its motion. control: A digital controller.
        end: Of the run [s].
    """
    found = control
    if any(control.follow):
        found = _referred(mechanism, motion, found, end)
    if any(control.rigid_torque):
        torque, own = rigid_torques(mechanism, motion, 0.0, end), control.forward
        fed, at = _motors(mechanism, control.rigid_torque, control.drives)

        def forward(t: float) -> Array:
            u = np.zeros(len(control.drives)) if own is None else np.array(own(t), float)
            u[fed] += torque(np.array([min(t, end)]))[0, at]
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
    path, home = (
        path_between(mechanism, motion, 0.0, end),
        motor_axes(mechanism).read(mechanism.home),
    )
    followed, at = _motors(mechanism, control.follow, control.measures)
    n, given_rate = len(control.measures), None if pid is None else pid.rate
    given = control.reference if pid is None else pid.reference

    def reference(t: float) -> Array:
        m = np.zeros(n) if given is None else np.array(np.broadcast_to(given(t), n), float)
        m[followed] = (path(np.array([min(t, end)])).position[0] - home)[at]
        return m

    def rate(t: float) -> Array:
        v = np.zeros(n) if given_rate is None else np.array(given_rate(t), float)
        v[followed] = path(np.array([t])).velocity[0, at] if t <= end else 0.0
        return v

    if pid is not None:
        return replace(control, law=replace(pid, reference=reference, rate=rate))
    return replace(control, reference=reference)


def _motors(
    mechanism: Mechanism, asked: tuple[bool, ...], those: tuple[object, ...]
) -> tuple[list[int], list[int]]:
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
    return picked, [names.index(joint) for joint in joints]
