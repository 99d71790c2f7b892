"""The path that the platform has to follow, on a uniform grid with rest before and after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pinflex.actuation.motors import motor_axes
from pinflex.actuation.nominal import Nominal, nominal
from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.description.motions.motion_keys import PLATFORM_COORDINATES
from pinflex.description.robots.urdf import Limits, limits
from pinflex.errors import DescriptionError, MotionError
from pinflex.mechanics.assembly import independent_rows
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import PlatformCoordinates
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.drives import share_of_limit

if TYPE_CHECKING:
    from pinflex.inversion.command import Command


@dataclass(frozen=True)
class Target:
    """What the platform shall do.

    Attributes:
        t: Uniform times [s], shape (nt,). before: Rest before the motion begins [s].
        names: Platform coordinates that are imposed.
        position: Their values [m | rad], shape (nt, k).
        motors: Motor positions of the rigid mechanism on the path [m | rad], shape (nt, nm).
        gain: Platform coordinates by motor positions of the rigid mechanism, shape (nt, k, nm).
        idle: Motions of the motors that do not move the platform, shape (nt, nm - k, nm).
        path: The rigid mechanism's motion.
    """

    t: Array
    before: float
    names: tuple[str, ...]
    position: Array
    motors: Array
    gain: Array
    idle: Array
    path: Nominal

    def at(self, some: list[int]) -> Target:
        """Some of the instants."""
        keys = ("t", "position", "motors", "gain", "idle")
        cut = {key: getattr(self, key)[some] for key in keys}
        return replace(self, **cut, path=self.path.at(some))


def delayed(motion: Motion, before: float) -> Motion:
    """The motion with a rest of `before` [s] ahead of it."""
    law = motion.law

    def later(t: Array) -> tuple[Array, Array, Array]:
        p, v, a = law(np.maximum(t - before, 0.0))
        moving = (t >= before)[:, None]
        return p, np.where(moving, v, 0.0), np.where(moving, a, 0.0)

    corners = (before, *(before + t for t in motion.switches))
    return replace(motion, law=later, duration=motion.duration + before, spec={}, corners=corners)


def target(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    before: float,
    names: Sequence[str] | None = None,
) -> Target:
    """The platform's path of a motion of the platform, or of joints of the rigid mechanism.

    Raises:
        DescriptionError: No platform, or more coordinates than motors.
        MotionError: The rigid mechanism cannot follow the path.
    """
    frame = mechanism.description.platform
    if frame is None:
        raise DescriptionError(
            f"{mechanism.name}: a command needs the frame that shall follow the path. Write "
            "`platform: FRAME`."
        )
    path = nominal(mechanism, delayed(motion, before), t)
    dynamics, axes = Equations(mechanism.rigid), motor_axes(mechanism)
    every = PlatformCoordinates(
        dynamics, mechanism.rigid.expansion.frames[frame], PLATFORM_COORDINATES
    )
    at = dynamics.kinematics(path.q)
    position, J = every.at(at)
    position[:, 3:] = np.unwrap(position[:, 3:], axis=0)
    closed = dynamics.close(path.q).J
    gain = np.array([_by_motors(mechanism, *pair) for pair in zip(closed, J, strict=True)])
    nm = len(axes.v_at)
    chosen = tuple(names or (motion.names if motion.target == "platform" else ()))
    chosen = chosen or _independent(position, gain[0], nm)
    if len(chosen) > nm:
        raise DescriptionError(
            f"{mechanism.name}: {len(chosen)} platform coordinates ({', '.join(chosen)}) for {nm} "
            f"motors. Name at most {nm} of them in `coordinates`."
        )
    columns = [PLATFORM_COORDINATES.index(name) for name in chosen]
    gain = gain[:, columns]
    idle = np.array([np.linalg.svd(G)[2][len(chosen) :] for G in gain]).reshape(len(t), -1, nm)
    motors = axes.read(path.q)
    if len(axes.paired):
        motors = np.unwrap(motors, axis=0)
    if np.linalg.matrix_rank(gain[0]) < len(chosen):
        raise MotionError(
            f"{mechanism.name}: the motors cannot move {', '.join(chosen)} independently at the "
            "start. Name other platform coordinates."
        )
    return Target(t, before, chosen, position[:, columns], motors, gain, idle, path)


def _independent(position: Array, gain: Array, count: int) -> tuple[str, ...]:
    """Platform coordinates that motors move independently, at most `count` of them.

    Rotations are weighed by the size of the path `position` (nt, 6), in m; `gain` is (6, nm).
    """
    size = np.linalg.norm(position[:, :3] - position[0, :3], axis=1).max()
    unit = np.array([1.0, 1.0, 1.0, size, size, size])[:, None]
    kept, _ = independent_rows(gain * unit, PLATFORM_COORDINATES)
    return tuple(PLATFORM_COORDINATES[k] for k in kept[:count])


def _by_motors(mechanism: Mechanism, closed: Array, J: Array) -> Array:
    """Platform coordinates by motor positions, shape (6, nm): the passive joints follow."""
    motors, passive = mechanism.rigid.motors, mechanism.rigid.free
    if not len(closed):
        return np.asarray(J[:, motors])
    follow = -np.linalg.lstsq(closed[:, passive], closed[:, motors], rcond=1e-12)[0]
    return np.asarray(J[:, motors] + J[:, passive] @ follow)


# What a command asks of motors, against what they can do: URDF limits and limit curves.


def require_within_limits(mechanism: Mechanism, found: Command) -> None:
    """Refuse torques and speeds of joints beyond the URDF's."""
    known = limits(mechanism.description.urdf_text)
    for k, name in enumerate(mechanism.description.actuated):
        limit = known.get(name, Limits())
        speed = "m/s" if found.units[k] == "N" else "rad/s"
        for values, most, unit, what in (
            (found.torque[:, k], limit.effort, found.units[k], "effort"),
            (found.velocity[:, k], limit.velocity, speed, "velocity"),
        ):
            at = int(np.argmax(np.abs(values)))
            if 0.0 < most < abs(values[at]):
                raise MotionError(
                    f"{mechanism.name}: command: {name} needs {abs(values[at]):.4g} {unit} at t = "
                    f"{found.t[at]:.4g} s, the URDF's {what} limit is {most:g}. Slow the motion "
                    "down, or lift the check (limited=False, --beyond-limits).",
                    joint=name,
                )


def require_within_curves(mechanism: Mechanism, found: Command) -> None:
    """Refuse what is beyond the limit curve of a drive."""
    for name, side in found.drives.items():
        curve = np.array(found.limit_curves[name])
        if not len(curve):
            continue
        used = share_of_limit(curve, side["motor_speed"], side["motor_torque"])
        if used > 1.0:
            fastest = float(np.max(np.abs(side["motor_speed"])))
            raise MotionError(
                f"{mechanism.name}: command: {name} needs "
                + (f"{100 * used:.0f} % of its motor's" if np.isfinite(used) else "more than its")
                + f" limit_curve; its motor turns at up to {fastest:.4g} rad/s. Slow the motion "
                "down, or lift the check (limited=False, --beyond-limits).",
                joint=name,
            )
